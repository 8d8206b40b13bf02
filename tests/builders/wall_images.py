"""Images and volumes of walls, by a formula: a Gaussian pulse along a straight sheet, logarithmically compressed."""

import numpy as np


def wall_image(
    normal,
    through,
    shape=(300, 360),
    *,
    peak=200.0,
    second=17.0,
    second_share=0.4,
    sigma=2.0,
    fading=0.0,
    part=1.0,
    gap=0.0,
    spots=(),
    floor=20.0,
    noise=6.0,
    seed=0,
):
    """Grey levels of a wall with a normal (D,) through a place (D,), (u, v[, w]).

    A second echo lies `second` px behind the first, of a share of its amplitude; the wall fades by `fading` grey levels
    towards the rims, is seen along a `part` of the image's width from the left, with a `gap` of its middle left out;
    `spots` are bright places.
    """
    rng = np.random.default_rng(seed)
    places = np.moveaxis(np.indices(shape)[::-1], 0, -1).astype(float)
    normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    away = (places - through) @ normal
    amplitude = np.exp(-0.5 * (away / sigma) ** 2) + second_share * np.exp(
        -0.5 * ((away - second) / sigma) ** 2
    )
    across = places[..., 0] / (shape[-1] - 1)
    amplitude = np.where((across > part) | (np.abs(across - 0.5) < 0.5 * gap), 0.0, amplitude)
    grey = peak + 255 / 60 * 20 * np.log10(np.maximum(amplitude, 1e-6)) - fading * np.abs(2 * across - 1)
    for spot in spots:
        distance = np.linalg.norm(places - spot, axis=-1)
        grey = np.maximum(grey, 255 - 8 * distance)
    return np.clip(np.maximum(grey, floor + noise * rng.normal(size=shape)), 0, 255).astype(np.uint8)
