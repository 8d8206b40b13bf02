"""A local web page where a person sees a sweep, mends a point, and watches the error change."""

from sonocal.studio.server import serve

__all__ = ["serve"]
