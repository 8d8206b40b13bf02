"""PLUS's error: what PLUS reports for its own matrices, and exact small cases."""

import json

import numpy as np
import pytest

import sonocal as sc
from sonocal.geometry import AxisScaled
from sonocal.validation import nwire_error, nwire_errors

SETS = ["depth15_polaris", "fcal12_ascension", "trus_3nwires"]


def loaded(data_folder, name):
    reference = json.loads((data_folder / "observations" / f"{name}.reference.json").read_text())
    return sc.read_observations(data_folder / "observations" / f"{name}.csv"), reference


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("split", ["calibration", "validation"])
def test_plus_matrices_have_the_errors_that_plus_reports(data_folder, name, split):
    rows, reference = loaded(data_folder, name)
    for one in reference["reference_calibrations"]:
        matrix = np.array(one["image_to_probe"])
        plus = AxisScaled(matrix[:3, :3], matrix[:3, 3], np.ones(3))
        found = nwire_error(plus, rows.select_split(split), reference["nwires"])
        # Four digits: the matrix is printed with six, the pixels with three decimals.
        assert found.value_mm == pytest.approx(one["reported"][f"{split.capitalize()}MeanMm"], rel=1e-4)
        assert found.spread_mm == pytest.approx(one["reported"][f"{split.capitalize()}StdDevMm"], rel=3e-4)


def test_ours_on_depth15_is_no_worse_than_plus(data_folder):
    rows, reference = loaded(data_folder, "depth15_polaris")
    found = sc.calibrate(rows, fit_split="calibration").probe_from_image
    assert nwire_error(found, rows.select_split("validation"), reference["nwires"]).value_mm <= 1.194


def an_n(middle_px):
    """One N in the planes z = 0: sides x = 0 and x = 10, the middle wire from one to the other, seen at v = 5."""
    wires = [[[0, 0, 0], [0, 10, 0]], [[0, 0, 0], [10, 10, 0]], [[10, 0, 0], [10, 10, 0]]]
    points = [[0.0, 5], [middle_px, 5], [10, 5]]
    return sc.Observations(points, np.array(wires, dtype=float), frame=[0, 0, 0], target=["l", "m", "r"])


def test_an_exact_n_has_no_error_and_a_shift_along_it_is_seen_as_plus_sees_it():
    identity = sc.Similarity.identity()
    assert nwire_errors(identity, an_n(5.0), [("l", "m", "r")])[0] == pytest.approx([0.0])
    # Seen at u = 7, the side wires place the middle at (7, 7) and the image at (7, 5).
    assert nwire_errors(identity, an_n(7.0), [("l", "m", "r")])[0] == pytest.approx([2.0])


def test_rows_in_any_order_and_frames_with_a_missing_wire_do_not_matter(data_folder):
    rows, reference = loaded(data_folder, "depth15_polaris")
    fit = sc.calibrate(rows, fit_split="calibration").probe_from_image
    part = rows.select_split("validation").select(np.arange(90))
    order = np.random.default_rng(0).permutation(90)
    nwires = reference["nwires"]
    straight, shuffled = (nwire_errors(fit, r, nwires)[0] for r in (part, part.select(order)))
    np.testing.assert_allclose(np.sort(shuffled), np.sort(straight))
    missing = nwire_errors(fit, part.select(np.arange(1, 90)), nwires)[0]
    assert len(missing) == len(straight) - 1


def test_wires_that_are_not_there_are_named():
    with pytest.raises(sc.InputError) as caught:
        nwire_error(sc.Similarity.identity(), an_n(5.0), [("l", "x", "r")])
    assert str(caught.value) == (
        "observations: no frame shows all three wires of an N; give --nwire LEFT,MIDDLE,RIGHT with names of the "
        "column target, which has l, m, r"
    )
