"""Trackers and images without a server of their own, served as PLUS would serve them."""

from sonocal.devices.ndi import Ndi
from sonocal.devices.optitrack import OptiTrack
from sonocal.devices.relay import relay
from sonocal.devices.tracker import Reading, Tracker
from sonocal.devices.video import Video

__all__ = ["Ndi", "OptiTrack", "Reading", "Tracker", "Video", "relay"]
