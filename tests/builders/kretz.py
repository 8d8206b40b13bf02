"""Kretz volumes, written by the description of their layout, and the places of their voxels by its formula."""

import struct

import numpy as np


def element(group, number, value):
    return struct.pack("<HHI", group, number, len(value)) + value


def kretz_bytes(voxels, step_mm=0.5, first_mm=40.0, axis_mm=15.0, beams=None, images=None, changed=None):
    """A volume of (K, J, I) voxels along beams.

    Args:
        voxels: uint8, sample last.
        step_mm: from sample to sample.
        first_mm: radius of the first sample.
        axis_mm: the axis of the images, below the centre of the arc.
        beams: (J,) rad from the middle; None of a volume whose voxels are cubes of `step_mm`.
        images: (K,) rad from the middle.
        changed: elements by (group, number) that are others, or None to leave one out.
    """
    k, j, i = voxels.shape
    held = {(0x0110, 2): b"Nobody\0"}
    held |= {(0xC000, n): struct.pack("<H", size) for n, size in ((1, i), (2, j), (3, k))}
    if beams is None:
        held[0x0010, 0x0022] = struct.pack("<d", step_mm)
    else:
        held[0xC100, 1] = struct.pack("<d", step_mm / 1000)
        held[0xC200, 1], held[0xC200, 2] = (
            struct.pack("<d", first_mm / step_mm),
            struct.pack("<d", -axis_mm / step_mm),
        )
        held[0xC300, 1], held[0xC300, 2] = (
            (np.asarray(a) + np.pi / 2).astype("<f8").tobytes() for a in (images, beams)
        )
    held[0xD000, 1] = voxels.tobytes()
    held |= changed or {}
    body = b"".join(element(*tag, value) for tag, value in held.items() if value is not None)
    return b"KRETZFILE 1.0   " + body + element(0xFFFF, 0xFFFF, b"")


def places_mm(i, step_mm, first_mm, axis_mm, beams, images):
    """(K, J, I, 3): where voxels lie, mm: across the beams, away from the probe, from image to image."""
    r = first_mm + step_mm * np.arange(i)
    theta, phi = np.asarray(beams)[None, :, None], np.asarray(images)[:, None, None]
    q = r * np.cos(theta) - axis_mm
    return np.stack(
        np.broadcast_arrays(r * np.sin(theta), q * np.cos(phi) + axis_mm, -q * np.sin(phi)), axis=-1
    )


def some_toroid(i=9, j=7, k=5, seed=0):
    """The arguments of `kretz_bytes` for a small volume of noise."""
    voxels = np.random.default_rng(seed).integers(0, 255, (k, j, i), dtype=np.uint8)
    return voxels, 0.8, 40.0, 15.0, np.linspace(-0.5, 0.5, j), np.linspace(-0.3, 0.3, k)
