"""From a calibrated sweep to a volume.

A way to give voxels what images say of them is a class of `pieces`, a line in its `KINDS`, and a function of the core.
"""

from sonocal.reconstruction.files import write_array
from sonocal.reconstruction.grid import Grid
from sonocal.reconstruction.like_plus import reconstruct_like_plus
from sonocal.reconstruction.live import LiveVolume
from sonocal.reconstruction.making import reconstruct
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.page import plot_picture, volume_html
from sonocal.reconstruction.previews import Picture, preview
from sonocal.reconstruction.volume import Volume

__all__ = [
    "Grid",
    "LiveVolume",
    "Options",
    "Picture",
    "Volume",
    "plot_picture",
    "preview",
    "reconstruct",
    "reconstruct_like_plus",
    "volume_html",
    "write_array",
]
