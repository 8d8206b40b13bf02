"""Trackers and images without a server of their own, served as PLUS would serve them."""

from sonocal.devices.ndi import Ndi
from sonocal.devices.opened import open_tracker, open_video
from sonocal.devices.optitrack import OptiTrack
from sonocal.devices.relay import relay, relaying
from sonocal.devices.tracker import Reading, Tracker
from sonocal.devices.video import Video

__all__ = [
    "Ndi",
    "OptiTrack",
    "Reading",
    "Tracker",
    "Video",
    "open_tracker",
    "open_video",
    "relay",
    "relaying",
]
