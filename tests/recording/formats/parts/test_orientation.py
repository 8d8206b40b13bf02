from itertools import permutations, product

import numpy as np
import pytest

from sonocal import FormatError
from sonocal.recording.formats import read_recording
from sonocal.recording.formats.parts.orientation import Orientation
from tests.builders.recordings import stored_file

PAIRS = ("MU", "FN", "AD")
VOLUMES = ["".join(letters) for order in permutations(PAIRS) for letters in product(*order)]
IMAGES = [code for code in VOLUMES if code[2] in "AD"] + [
    a + b for a, b in permutations("MUFN", 2) if a + b not in ("MU", "UM", "FN", "NF")
]


@pytest.mark.parametrize("code", [*IMAGES, "XX"])
def test_image_from_file_says_where_every_pixel_went(tmp_path, code):
    check(*stored_file(tmp_path, code, (4, 3)))


@pytest.mark.parametrize("code", VOLUMES)
def test_image_from_file_says_where_every_voxel_went(tmp_path, code):
    check(*stored_file(tmp_path, code, (4, 3, 2)))


def check(path, pixels):
    recording = read_recording(path)
    dimension = recording.image.dimension
    for frame in range(2):
        for stored in np.ndindex(*pixels.shape[1:]):
            point = np.zeros(4)
            point[:dimension], point[3] = stored[::-1], 1
            u, v, w = (recording.image.image_from_file @ point)[:3].astype(int)
            place = (v, u) if dimension == 2 else (w, v, u)
            assert recording.frames[frame][place] == pixels[(frame, *stored)]
    assert recording.frames.shape == recording.image.size_px[::-1]


def test_what_the_letters_mean(tmp_path):
    """MF is right and down; U is stored mirrored, N upside down, FM on its side."""
    for code, corner in {"MF": (0, 0), "UF": (0, 3), "MN": (2, 0), "UN": (2, 3), "FM": (0, 0)}.items():
        path, _ = stored_file(tmp_path, code, (3, 4) if code == "FM" else (4, 3))
        frame = read_recording(path).frames[0]
        assert frame.shape == (3, 4)
        assert frame[corner] == 0


def test_spacing_follows_its_axis(tmp_path):
    path, _ = stored_file(tmp_path, "FM", (3, 4))
    assert read_recording(path).image.spacing_mm == (0.2, 0.1)


def test_two_letters_make_a_right_handed_frame():
    """As PLUS defines them: MF is MFA, UF is UFD, MN is MND, UN is UNA."""
    for short, full in {"MF": "MFA", "UF": "UFD", "MN": "MND", "UN": "UNA", "FM": "FMD"}.items():
        a, b = (Orientation.parse(code, 3, "x") for code in (short, full))
        assert (a.axes, a.signs) == (b.axes, b.signs)


def test_changes_are_reported(tmp_path):
    codes = {"MFA": [], "UF": ["orientation-changed"], "XX": ["orientation-unknown"]}
    for code, expected in codes.items():
        recording = read_recording(stored_file(tmp_path, code, (4, 3))[0])
        assert [d.code for d in recording.diagnostics] == expected


@pytest.mark.parametrize("code", ["MM", "MU", "Q", "MFAA", "AMF"])
def test_other_letters_are_refused(tmp_path, code):
    path, _ = stored_file(tmp_path, code, (4, 3))
    with pytest.raises(FormatError) as caught:
        read_recording(path)
    assert str(caught.value) == (
        f"a.mha: image orientation '{code}' is none; it has one letter of M/U, one of F/N and perhaps one of A/D, "
        "such as MF or UFA, or is XX where it is not known"
    )
