"""A local web page where a person sees a sweep, mends a point, and watches the error change."""

from sonocal.studio.feed import Feed
from sonocal.studio.needle import Asked
from sonocal.studio.server import Begin, serve

__all__ = ["Asked", "Begin", "Feed", "serve"]
