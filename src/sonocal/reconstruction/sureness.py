"""How far off a voxel is: what the calibration and the tracker leave unknown of where a pixel was."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.calibration import Calibration
from sonocal.errors import InputError
from sonocal.existing import Existing
from sonocal.geometry import Array
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.placed import Placed, image_matrix
from sonocal.recording import Frames
from sonocal.registration.uncertainty import radius_95

__all__ = ["Repeated", "error_image_um", "refuse_unknown_error"]

MOST_UM = 65535
# Places along u and v at which the error is reckoned; in between it hardly bends.
PLACES = 25
# Of the tracker's noise where two images are mixed as (1 - t) and t, on average over t: 1 - 2 t + 2 t^2.
MIXED = 2 / 3


class Repeated(Frames):
    """One image, as often as there are others."""

    def __init__(self, image: NDArray[Any], count: int) -> None:
        self._image, self._count = image, count
        self.shape, self.dtype = image.shape, image.dtype

    def __len__(self) -> int:
        return self._count

    def read(self, index: int) -> NDArray[Any]:
        """The image, whichever is asked for."""
        return self._image


def refuse_unknown_error(calibration: Calibration | Existing | ArrayLike, options: Options) -> None:
    """Raise where nothing is known of how far off a pixel is.

    Raises:
        InputError: the calibration has no covariance, and the tracker's noise is not given.
    """
    known = isinstance(calibration, Calibration) and calibration.covariance is not None
    if options.error and not (known or options.noise_mm or options.noise_deg):
        raise InputError(
            "error must rest on something: this calibration has no covariance, as matrices of other software have "
            "none; give the tracker's noise, noise_mm and noise_deg, or one of sonocal calibrate"
        )


def error_image_um(
    calibration: Calibration | Existing | ArrayLike, placed: Placed, options: Options
) -> NDArray[np.uint16]:
    """(rows, columns): the distance that 95 % of a pixel's places stay within, in micrometres; at most 65535."""
    u, v = np.linspace(0, placed.width - 1, PLACES), np.linspace(0, placed.height - 1, PLACES)
    points = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    places = (
        np.column_stack([points, 0 * points[:, 0], np.ones(len(points))]) @ image_matrix(calibration)[:3].T
    )
    share = MIXED if options.interpolation == "between" else 1.0
    of_poses = share * _of_poses(places, options)
    radii = _radii(calibration, points, of_poses).reshape(PLACES, PLACES)
    rows = np.array([np.interp(np.arange(placed.width), u, row) for row in radii])
    whole = np.array([np.interp(np.arange(placed.height), v, column) for column in rows.T]).T
    return np.ascontiguousarray(np.clip(np.rint(1000 * whole), 1, MOST_UM), dtype=np.uint16)


def _radii(calibration: Calibration | Existing | ArrayLike, points_px: Array, of_poses: Array) -> Array:
    """(N,) mm, of both errors together.

    Of a calibration's covariance the size rests on few residuals, of the tracker's it is given: the sum has more
    freedom than the first, by the square of their ratio (Welch 1947, Satterthwaite 1946).
    """
    if not isinstance(calibration, Calibration) or calibration.covariance is None:
        return radius_95(of_poses)
    own = calibration.predict(points_px)[1]
    whole = own + of_poses
    more = np.trace(whole, axis1=1, axis2=2) / np.maximum(np.trace(own, axis1=1, axis2=2), 1e-12)
    freedom = calibration.noise.freedom * more**2
    return np.array([radius_95(one, float(few)) for one, few in zip(whole, freedom, strict=True)])


def _of_poses(places_mm: Array, options: Options) -> Array:
    """(N, 3, 3) mm^2, of the tracker's noise: along each axis, and about each axis with the marker's lever arm."""
    turn = np.radians(options.noise_deg)
    squared = np.sum(places_mm**2, axis=1)[:, None, None] * np.eye(3)
    lever = squared - places_mm[:, :, None] * places_mm[:, None, :]
    return np.asarray(options.noise_mm**2 * np.eye(3) + turn**2 * lever)
