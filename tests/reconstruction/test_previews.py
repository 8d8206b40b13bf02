"""Pictures of volumes: what is left, front and up where other programs have it, and a page that needs no network."""

import re

import numpy as np
import pytest
from benchmarks.simulators.fields import path, probe_from_image, recorded

import sonocal as sc
from sonocal import InputError
from sonocal.reconstruction import plot_picture, preview, volume_html

MASK = np.ones((80, 100), dtype=bool)
# Of an array [z, y, x] whose axes run left, posterior and superior: head up, left on the right, the face on the left.
SEEN = {"z": (0, False), "y": (1, True), "x": (2, True)}
LETTERS = {"z": "RLPA", "y": "RLIS", "x": "APIS"}


def made(target=None, **options):
    return sc.reconstruct(
        recorded(path(12)),
        probe_from_image(),
        target,
        **{"mask": MASK, "spacing_mm": (0.5, 0.75, 1.0), **options},
    )


@pytest.mark.parametrize("axes", ["lps", "ras"])
@pytest.mark.parametrize("suffix", [".mha", ".nrrd"])
def test_pictures_are_cuts_of_what_simpleitk_sees(tmp_path, suffix, axes):
    itk = pytest.importorskip("SimpleITK")
    file = tmp_path / f"volume{suffix}"
    pictures = preview(made(file, axes=axes), axes)
    turned = itk.DICOMOrient(itk.ReadImage(str(file)), "LPS")
    voxels, first, spacing = itk.GetArrayFromImage(turned), turned.GetOrigin(), turned.GetSpacing()
    for picture in pictures[:3]:
        which, upside_down = SEEN[picture.along]
        axis = "xyz".index(picture.along)
        lps_mm = picture.at_mm * (-1 if axes == "ras" and axis < 2 else 1)
        index = round((lps_mm - first[axis]) / spacing[axis])
        cut = np.take(voxels, index, axis=which)
        np.testing.assert_array_equal(picture.image, cut[::-1] if upside_down else cut)
        assert picture.letters == LETTERS[picture.along]


def test_edges_are_those_of_the_voxels():
    volume = made()
    low = volume.grid.origin_mm - volume.grid.spacing_mm / 2
    high = low + volume.grid.spacing_mm * volume.grid.size
    for axes in ("lps", "ras"):
        for picture in preview(volume, axes):
            left, right, bottom, top = picture.edges_mm
            across, upright = "xyz".index(picture.across), "xyz".index(picture.upright)
            assert {left, right} == {low[across], high[across]}
            assert {bottom, top} == {low[upright], high[upright]}
            assert (left < right) == (axes == "lps")


def test_a_projection_shows_what_is_brightest_along_the_shortest_side():
    volume = made(spacing_mm=0.5)
    sides = volume.grid.spacing_mm * volume.grid.size
    projection = preview(volume)[-1]
    assert projection.at_mm is None
    axis = int(np.argmin(sides))
    assert projection.along == "xyz"[axis]
    brightest = volume.values.max(axis=2 - axis)
    np.testing.assert_array_equal(projection.image, brightest if axis == 2 else brightest[::-1])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_cuts_go_through_the_middle_of_what_is_filled(dtype, tmp_path, monkeypatch):
    monkeypatch.setattr("sonocal.reconstruction.previews.RELEASED_BYTES", 1000)
    file = tmp_path / "volume.mha"
    volume = sc.reconstruct(recorded(path(12), dtype=dtype), probe_from_image(), file, mask=MASK)
    for picture in preview(volume)[:3]:
        axis = "xyz".index(picture.along)
        at = round((picture.at_mm - volume.grid.origin_mm[axis]) / volume.grid.spacing_mm[axis])
        before, _, behind = np.split(volume.values > 0, [at, at + 1], axis=2 - axis)
        half = np.count_nonzero(volume.values) / 2
        assert max(before.sum(), behind.sum()) <= half
        assert picture.image.dtype == dtype


def test_the_page_says_where_the_volume_lies():
    page = volume_html(
        made(error=True, noise_mm=0.2), name="volume.mha", made_of=[("recording", "a<b.mha")]
    ).decode()
    assert page.count("data:image/png;base64,") == 4
    for words in (
        "cut at z = ",
        "the brightest along ",
        "x, mm",
        "mm (95 %, median)",
        "a&lt;b.mha",
        "LPS",
    ):
        assert words.lower() in page.lower(), words
    assert not re.search(r"(src|href)=.https?:", page)


def test_the_scale_bar_is_as_long_as_it_says():
    from matplotlib.figure import Figure

    for picture in preview(made()):
        axis = Figure().add_subplot()
        plot_picture(axis, picture)
        (bar,) = axis.lines
        long = np.ptp(bar.get_xdata()) * abs(np.diff(picture.edges_mm[:2])[0])
        assert f"{long:g} mm" in [text.get_text() for text in axis.texts]
        assert (axis.get_xlabel(), axis.get_ylabel()) == (f"{picture.across}, mm", f"{picture.upright}, mm")


def test_axes_are_lps_or_ras():
    with pytest.raises(InputError, match="axes must be lps or ras; got 'up'"):
        preview(made(), "up")
    with pytest.raises(InputError, match="volume must be of the class Volume"):
        preview(np.zeros((3, 3, 3)))
