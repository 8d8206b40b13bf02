"""Volumes that are PLUS's, to the voxel."""

import numpy as np
import pytest
from benchmarks.simulators.fields import path, probe_from_image, recorded

import sonocal as sc
from sonocal import InputError, UnsupportedError
from sonocal.existing import read_existing
from sonocal.reconstruction import reconstruct_like_plus

NWIRE = "recordings/PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml"
SPINE = "volumes/SpinePhantomFreehand.igs.mha"
REFERENCES = [
    (
        SPINE,
        "volumes/SonixRP_TRUS_D70mm_NN_LATE.xml",
        "volumes/vtkVolumeReconstructorTestNNLATEvolumeRef.mha",
    ),
    (SPINE, "volumes/SpinePhantom_NN_MEAN.xml", "volumes/vtkVolumeReconstructorTestNNMEANvolumeRef.mha"),
    (SPINE, "volumes/SpinePhantom_LN_MAXI.xml", "volumes/vtkVolumeReconstructorTestLNMAXIvolumeRef.mha"),
    ("recordings/NwirePhantomFreehand.igs.mha", NWIRE, "recordings/NwirePhantomFreehandReconstructed.mha"),
]
HEAD = '<PlusConfiguration version="2.1"><CoordinateDefinitions/><VolumeReconstruction OutputSpacing="0.5 0.5 0.5" '


@pytest.mark.parametrize(("sweep", "devices", "volume"), REFERENCES)
def test_every_voxel_is_that_of_plus(data_folder, sweep, devices, volume):
    there = sc.read_recording(data_folder / volume)
    sweep, devices = sc.read_recording(data_folder / sweep), data_folder / devices
    made = reconstruct_like_plus(sweep, read_existing(devices), devices)
    np.testing.assert_array_equal(made.values, there.frames[0])
    offset = np.array(there.fields["Offset"].split(), dtype=float)
    np.testing.assert_allclose(made.grid.origin_mm, offset, atol=5e-4)


def settings(tmp_path, text, inside=""):
    file = tmp_path / "devices.xml"
    file.write_text(f"{HEAD}{text}>{inside}</VolumeReconstruction></PlusConfiguration>")
    return file


def made(tmp_path, text, inside="", **more):
    return reconstruct_like_plus(
        recorded(path(8)),
        probe_from_image(),
        settings(tmp_path, f'ReferenceCoordinateFrame="Tracker" {text}', inside),
        **more,
    )


@pytest.mark.parametrize("how", ["MEAN", "MAXIMUM", "LATEST"])
@pytest.mark.parametrize("interpolation", ["NEAREST_NEIGHBOR", "LINEAR"])
def test_the_three_codes_of_plus_differ_in_few_voxels(tmp_path, how, interpolation):
    """In fixed point a place is rounded to 2^-14: a pixel now and then falls on the other side of a voxel's edge."""
    volumes = [
        made(
            tmp_path, f'Interpolation="{interpolation}" CompoundingMode="{how}" Optimization="{code}"'
        ).values
        for code in ("NONE", "PARTIAL", "FULL")
    ]
    assert np.mean(volumes[0] != volumes[1]) < 1e-3
    assert np.mean(np.abs(volumes[0].astype(int) - volumes[2]) > 1) < 0.01


def test_an_importance_mask_weighs_pixels(tmp_path):
    from sonocal.files.png import png

    mask = np.zeros((80, 100), dtype=np.uint8)
    mask[:, :50] = 7
    (tmp_path / "mask.png").write_bytes(png(mask))
    text = 'CompoundingMode="IMPORTANCE_MASK" ImportanceMaskFilename="mask.png" Optimization="NONE"'
    half = made(tmp_path, text)
    clipped = made(tmp_path, 'CompoundingMode="MEAN" Optimization="NONE"')
    assert 0.4 * clipped.filled < half.filled < 0.6 * clipped.filled


def test_holes_are_filled_along_sticks(tmp_path):
    holes = '<HoleFilling><HoleFillingElement Type="STICK" StickLengthLimit="9" NumberOfSticksToUse="1"/></HoleFilling>'
    sparse = made(tmp_path, 'CompoundingMode="MEAN"').values
    filled = made(tmp_path, 'CompoundingMode="MEAN" FillHoles="ON"', holes).values
    assert np.count_nonzero(filled) > 1.02 * np.count_nonzero(sparse)
    np.testing.assert_array_equal(filled[sparse > 0], sparse[sparse > 0])


@pytest.mark.parametrize(
    ("text", "inside", "error", "words"),
    [
        ('Interpolation="CUBIC"', "", UnsupportedError, "Interpolation of VolumeReconstruction is CUBIC"),
        ('Optimization="GPU_ACCELERATION_OPENCL"', "", UnsupportedError, "made with NONE, PARTIAL, FULL"),
        (
            'ClipRectangleSize="3"',
            "",
            InputError,
            "ClipRectangleSize of VolumeReconstruction is 2 finite numbers",
        ),
        (
            'FillHoles="ON"',
            '<HoleFilling><HoleFillingElement Type="GAUSSIAN"/></HoleFilling>',
            UnsupportedError,
            "STICK",
        ),
        ('CompoundingMode="IMPORTANCE_MASK"', "", InputError, "needs ImportanceMaskFilename"),
        ('EnableFanAnglesAutoDetect="TRUE"', "", UnsupportedError, "EnableFanAnglesAutoDetect"),
    ],
)
def test_what_is_not_done_as_plus_does_is_refused(tmp_path, text, inside, error, words):
    with pytest.raises(error, match=words):
        made(tmp_path, text, inside)


def test_a_device_set_without_volumes_is_refused(tmp_path):
    file = tmp_path / "devices.xml"
    file.write_text("<PlusConfiguration/>")
    with pytest.raises(InputError, match=r"devices\.xml: has no element VolumeReconstruction"):
        reconstruct_like_plus(recorded(path(3)), probe_from_image(), file)
