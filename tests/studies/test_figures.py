"""Every built-in study can be drawn, and figures show what the rows say."""

import msgspec
import numpy as np
import pytest

from sonocal.studies import built_in_names, load_study, run_study, summarise, threads
from sonocal.studies.figures import _Box, _panels, figure_png


@pytest.mark.parametrize("name", built_in_names())
def test_built_in_studies_can_be_drawn_from_few_trials(name, tmp_path):
    study = load_study(name, trials=12)
    factors = {factor: levels[-2:] for factor, levels in study.factors.items()}
    study = msgspec.structs.replace(study, factors=factors)
    with threads() as workers:
        store = run_study(study, tmp_path, workers)
    rows = summarise(store)
    png = figure_png(store, rows)
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    assert png == figure_png(store, rows)
    if study.answer:
        assert any(
            row.method == study.answer.method and row.quantity == study.answer.quantity for row in rows
        )


def test_boxes_are_those_of_the_papers_boxplots():
    values = np.concatenate([np.linspace(1, 3, 101), [4.0, 5.0, -10.0]])
    box = _Box.of(values)
    q1, median, q3 = np.percentile(values, [25, 50, 75])
    assert (box.q1, box.median, box.q3) == (q1, median, q3)
    assert (box.low, box.high) == (1.0, 4.0)
    assert box.outliers.tolist() == [-10.0, 5.0]


def test_boxes_have_panels_for_the_levels_of_further_factors():
    study = load_study("validation")
    assert [panel.title("x") for panel in _panels(study)] == ["x, 2D probe", "x, 3D probe"]
    assert len(list(_panels(load_study("paper-2d")))) == 3
    assert len(list(_panels(load_study("needles")))) == 1  # one method: the levels are its curves
