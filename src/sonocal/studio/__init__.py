"""A local web page where a person sees a sweep, mends a point, and watches the error change."""

from sonocal.studio.desk import Desk
from sonocal.studio.server import serve
from sonocal.studio.work import BareWork, RecordingWork, TableWork, Work

__all__ = ["BareWork", "Desk", "RecordingWork", "TableWork", "Work", "serve"]
