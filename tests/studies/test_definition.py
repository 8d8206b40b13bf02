"""Studies as data: what is read, and what is refused."""

import pytest
from click.testing import CliRunner

from sonocal.cli.main import main
from sonocal.errors import FormatError, InputError
from sonocal.studies import (
    Row,
    answer_sentences,
    built_in_names,
    load_study,
)

GOOD = """
name = "mine"
title = "Mine"
trials = 20
methods = ["sonocal", "4point2D"]
[scene]
sigma_px = 2
[factors]
needles = [6, 12]
sigma_mm = [0.5, 1]
[figure]
form = "curves"
quantities = ["target_mm"]
[answer]
goal = 2.0
wanted = "least"
reached = "{x} needles for {goal} mm at {sigma_mm} mm: {value}"
missed = "none: {x} gives {value}"
"""


def written(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return path


def test_every_combination_of_levels_is_a_cell(tmp_path):
    study = load_study(written(tmp_path, GOOD))
    assert [cell.levels for cell in study.cells()] == [
        {"needles": n, "sigma_mm": s} for n in (6, 12) for s in (0.5, 1)
    ]
    for cell in study.cells():
        assert (cell.scene.needles, cell.scene.sigma_mm) == tuple(cell.levels.values())
        assert cell.scene.sigma_px == 2
    assert len({cell.key for cell in study.cells()}) == 4


def test_fields_can_be_set_when_loading(tmp_path):
    study = load_study(written(tmp_path, GOOD), trials=7, seed=3)
    assert (study.trials, study.seed) == (7, 3)
    with pytest.raises(FormatError):
        load_study(written(tmp_path, GOOD), trials=0)


@pytest.mark.parametrize("name", built_in_names())
def test_built_in_studies_load_and_every_method_applies_somewhere(name):
    study = load_study(name)
    assert study.name == name
    assert study.title
    assert {method for cell in study.cells() for method in cell.methods} == set(study.methods)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("trials = 20", "trials = -1", "Expected `int` >= 1 - at `$.trials`"),
        ("trials = 20", "trails = 20", "unknown field `trails`"),
        ("sigma_px = 2", 'sigma_px = "two"', "Expected `float`, got `str` - at `$.scene.sigma_px`"),
        ("sigma_px = 2", "sigma_px = nan", "sigma_px must be a number, zero or more; got nan"),
        ("sigma_px = 2", "sigma_px = -2", "sigma_px must be a number, zero or more; got -2.0"),
        ("needles = [6, 12]", "needles = [6.5]", "factors: Expected `int`, got `float`"),
        ("needles = [6, 12]", "needles = []", "Expected `array` of length >= 1"),
        (
            "needles = [6, 12]",
            "needles = [3]",
            "none of the methods applies; it needs 4 needles of a 2D probe",
        ),
        ("sigma_mm = [0.5, 1]", "sigma = [0.5, 1]", "factors.sigma: is no setting of a scene"),
        ("sigma_px = 2", "outlier_share = 1.0", "the share of outliers is less than 1; got 1"),
        ("sigma_px = 2", "tilt_deg = 100", "a tilt from the normal is at most 90 degrees; got 100"),
        ("sigma_px = 2", "pool = 8", "12 needles cannot be taken from a pool of 8"),
        ("sigma_px = 2", "dimension = 4", "a probe has 2 or 3 dimensions; got 4"),
        ('["sonocal", "4point2D"]', '["sonocal", "magic"]', "there is no 'magic'; there are 5point2D"),
        (
            '["sonocal", "4point2D"]',
            '["sonocal", "3line3D"]',
            "'3line3D' applies to no cell; it needs 3 needles",
        ),
        ('["sonocal", "4point2D"]', '["4point2D"]', "answer.method: 'sonocal' is not among the methods"),
        ('["target_mm"]', '["wrong"]', "there is no quantity 'wrong'"),
        ('["target_mm"]', '["pra_mm"]', "pra_mm needs crosswires"),
        ('name = "mine"', 'name = "../mine"', "at `$.name`"),
        ('name = "mine"', "name = ", "Invalid value"),
    ],
)
def test_nonsense_is_refused_in_a_sentence(tmp_path, old, new, sentence):
    assert old in GOOD
    with pytest.raises(InputError) as caught:
        load_study(written(tmp_path, GOOD.replace(old, new)))
    assert "mine.toml: " in str(caught.value)
    assert sentence in str(caught.value)


def test_a_name_that_is_no_study_lists_those_there_are():
    with pytest.raises(InputError, match=r"there is no study 'paper'; there are .*paper-2d, paper-3d"):
        load_study("paper")
    with pytest.raises(InputError, match="there is no such file"):
        load_study("absent.toml")


def row(x, value):
    numbers = dict.fromkeys(Row.__struct_fields__, 0)
    numbers |= {
        "levels": {"needles": x, "sigma_mm": 1},
        "method": "sonocal",
        "stage": "after",
        "quantity": "target_mm",
    }
    return Row(**(numbers | {"p95": value}))


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ([5, 3, 2, 1.5], "20 needles for 2 mm at 1 mm: 2.00"),
        ([5, 1.9, 2.1, 1.5], "40 needles for 2 mm at 1 mm: 1.50"),  # one level by chance below the goal
        ([5, 4, 3, 2.5], "none: 40 gives 2.50"),
        ([1, 1, 1, 1], "5 needles for 2 mm at 1 mm: 1.00"),
    ],
)
def test_the_answer_is_the_least_level_from_which_all_reach_the_goal(tmp_path, values, sentence):
    study = load_study(written(tmp_path, GOOD))
    rows = [row(x, value) for x, value in zip((5, 10, 20, 40), values, strict=True)]
    assert answer_sentences(study, rows) == [sentence]


def test_the_greatest_level_up_to_which_all_reach_the_goal(tmp_path):
    study = load_study(written(tmp_path, GOOD.replace('"least"', '"greatest"')))
    rows = [row(x, value) for x, value in zip((5, 10, 20, 40), [1, 2, 2.1, 1.9], strict=True)]
    assert answer_sentences(study, rows) == ["10 needles for 2 mm at 1 mm: 2.00"]


def test_the_command_writes_results_summary_and_figure(tmp_path):
    path, out = written(tmp_path, GOOD), tmp_path / "out"
    done = CliRunner().invoke(main, ["study", str(path), "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert {"summary.csv", "summary.json", "mine.png", "manifest.json", "shards"} == {
        p.name for p in out.iterdir()
    }
    assert (out / "mine.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    lines = (out / "summary.csv").read_text().splitlines()
    assert lines[0].startswith("needles,sigma_mm,method,stage,quantity,trials,failed,median")
    assert len(lines) == 1 + 4 * (2 * 2 * 4 + 4)
    assert "needles for 2 mm" in done.output or "none: " in done.output


def test_the_commands_json_is_the_same_each_time(tmp_path):
    path = written(tmp_path, GOOD)
    first, second = (
        CliRunner().invoke(main, ["study", str(path), "-o", str(tmp_path / out), "--json", "--no-figure"])
        for out in ("a", "b")
    )
    assert first.stdout == second.stdout
    assert '"digest"' in first.stdout


def test_without_a_name_the_command_lists_what_there_is():
    done = CliRunner().invoke(main, ["study"])
    assert done.exit_code == 0
    assert [
        line.split()[0] for line in done.output.splitlines() if not line.startswith(" ")
    ] == built_in_names()


def test_a_mistake_is_one_sentence_and_writes_nothing(tmp_path):
    path = written(tmp_path, GOOD.replace("trials = 20", "trials = 0"))
    done = CliRunner().invoke(main, ["study", str(path), "-o", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert done.output.startswith("Error: mine.toml: ")
    assert not (tmp_path / "out").exists()
