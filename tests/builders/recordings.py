"""Recordings with every kind of content."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording


def random_poses(rng, n, spread_mm=100.0):
    matrices = np.tile(np.eye(4), (n, 1, 1))
    matrices[:, :3, :3] = Rotation.random(n, random_state=rng).as_matrix()
    matrices[:, :3, 3] = rng.uniform(-spread_mm, spread_mm, (n, 3))
    return matrices


def random_recording(
    seed, n=5, size=(7, 4), dtype="uint8", channels=1, orientation="MFA", tools=("Probe", "Needle")
):
    """A recording with every kind of content: invalid poses, a missing one, fields nobody knows."""
    rng = np.random.default_rng(seed)
    poses = {}
    for tool in tools:
        status = tuple(rng.choice(["OK", "INVALID"], n).tolist())
        valid = np.array([s == "OK" for s in status])
        one = Poses(tool, "Tracker", random_poses(rng, n), valid, status)
        poses[one.name] = one
    image, frames = None, ArrayFrames(np.empty((0, 0, 0)))
    if size is not None:
        shape = (n, *size[::-1], *((channels,) if channels > 1 else ()))
        frames = ArrayFrames(random_pixels(rng, shape, dtype))
        image = ImageGeometry.of(frames, len(size), orientation)
    return Recording(
        times=np.sort(rng.uniform(0, 100, n)),
        frames=frames,
        poses=poses,
        image=image,
        image_valid=np.full(n, size is not None),
        fields={"SomethingNew": "17 of 4", "UltrasoundImageType": "BRIGHTNESS"},
        item_fields={
            "FrameNumber": tuple(map(str, range(n))),
            "ImageStatus": ("OK" if size is not None else "INVALID",) * n,
            "Sometimes": ("yes", *(None,) * (n - 1)),
        },
    )


def random_pixels(rng, shape, dtype):
    if np.dtype(dtype).kind == "f":
        return rng.normal(size=shape).astype(dtype)
    info = np.iinfo(dtype)
    return rng.integers(info.min, info.max, shape, dtype=dtype, endpoint=True)


def assert_same(a, b):
    """Two recordings hold the same, to the last bit."""
    assert len(a) == len(b)
    assert a.times.tobytes() == b.times.tobytes()
    assert a.poses.keys() == b.poses.keys()
    for name, poses in a.poses.items():
        assert poses.matrices.tobytes() == b.poses[name].matrices.tobytes()
        assert poses.status == b.poses[name].status
        np.testing.assert_array_equal(poses.valid, b.poses[name].valid)
    assert dict(a.item_fields) == dict(b.item_fields)
    np.testing.assert_array_equal(a.image_valid, b.image_valid)
    assert len(a.frames) == len(b.frames)
    for one, other in zip(a.frames, b.frames, strict=True):
        assert one.dtype == other.dtype
        assert one.shape == other.shape
        assert one.tobytes() == other.tobytes()


def stored_file(tmp_path, code, size):
    """A sequence of two frames whose stored axes point as `code` says; every pixel is different."""
    count = int(np.prod(size)) * 2
    header = [
        "ObjectType = Image",
        f"NDims = {len(size) + 1}",
        f"DimSize = {' '.join(map(str, size))} 2",
        "ElementType = MET_USHORT",
        "ElementSpacing = " + " ".join(str(0.1 * (k + 1)) for k in range(len(size))) + " 1",
        f"UltrasoundImageOrientation = {code}",
        "Seq_Frame0000_Timestamp = 0",
        "Seq_Frame0001_Timestamp = 1",
        "ElementDataFile = LOCAL\n",
    ]
    pixels = np.arange(count, dtype="<u2").reshape(2, *size[::-1])
    path = tmp_path / "a.mha"
    path.write_bytes("\n".join(header).encode() + pixels.tobytes())
    return path, pixels
