"""A table and a data frame are the same thing in two forms."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.observations import observations_csv
from tests.builders.observations import NAME_LISTS, assert_same_table, random_table

pd = pytest.importorskip("pandas", reason="pandas is not installed")
seeds = st.integers(0, 10_000)
SIZES = {2: (640, 480), 3: (64, 48, 32)}


@given(seeds, st.sampled_from([2, 3]), st.booleans(), st.booleans(), NAME_LISTS, NAME_LISTS)
def test_a_table_comes_back_from_its_data_frame(seed, dimension, sigmas, sized, names, notes):
    table = random_table(
        seed, dimension=dimension, sigmas=sigmas, names=names, splits=names, extra={"note": notes}
    )
    table = table.with_sound(image_size_px=SIZES[dimension] if sized else None)
    again = sc.Observations.from_dataframe(table.to_dataframe())
    assert_same_table(again, table)
    assert again.image_size_px == table.image_size_px


@given(seeds, st.sampled_from([2, 3]), st.randoms())
def test_the_index_and_the_order_of_columns_mean_nothing(seed, dimension, random):
    frame = random_table(seed, dimension=dimension, sigmas=True).to_dataframe()
    columns = list(frame.columns)
    random.shuffle(columns)
    again = sc.Observations.from_dataframe(frame[columns].set_index(np.arange(len(frame)) * 7))
    assert observations_csv(again) == observations_csv(sc.Observations.from_dataframe(frame))


def test_what_pandas_writes_is_a_table_of_sightings(tmp_path):
    table = random_table(3, sigmas=True, extra={"note": ["a", "b"]}).with_sound(image_size_px=(640, 480))
    table.to_dataframe().to_csv(tmp_path / "a.csv", index=False)
    again = sc.read_observations(tmp_path / "a.csv")
    np.testing.assert_array_equal(again.points_px, table.points_px)
    assert again.image_size_px == (640, 480)
    from_file = sc.Observations.from_dataframe(pd.read_csv(tmp_path / "a.csv", keep_default_na=False))
    assert observations_csv(from_file) == observations_csv(again)


def test_a_frame_of_the_least_columns_is_a_table():
    frame = random_table(1).to_dataframe()[
        ["u_px", "v_px", "x0_mm", "y0_mm", "z0_mm", "x1_mm", "y1_mm", "z1_mm"]
    ]
    assert sc.Observations.from_dataframe(frame, "mine").source == "mine"
    frame = frame.assign(time_s=0.5, when=pd.Timestamp("2026-01-02"), gap=[None] * len(frame))
    extra = sc.Observations.from_dataframe(frame).extra
    assert (extra["time_s"][0], extra["when"][0][:10], extra["gap"][0]) == ("0.5", "2026-01-02", "")
    assert sc.Observations.from_dataframe(frame).stamps_s()[0] == 0.5


def refusal(frame):
    with pytest.raises(sc.InputError) as refused:
        sc.Observations.from_dataframe(frame)
    return str(refused.value)


def test_what_is_no_table_is_refused_by_what_is_wrong():
    frame = random_table(1).with_sound(image_size_px=(640, 480)).to_dataframe()
    assert refusal("needle.csv") == "frame must be a data frame, with a row a point; got 'needle.csv'"
    assert "lacks the columns v_px, x0_mm; it has" in refusal(frame.drop(columns=["x0_mm", "v_px"]))
    assert "column u_px: 'a' is not a number" in refusal(frame.astype({"u_px": object}).assign(u_px="a"))
    assert "row 0, column u_px: nan is not a finite number" in refusal(frame.assign(u_px=np.nan))
    assert "column frame: some of it are no whole numbers" in refusal(frame.assign(frame=0.5))
    assert "has the column u_px more than once" in refusal(pd.concat([frame, frame[["u_px"]]], axis=1))
    assert "says 2 image sizes" in refusal(frame.assign(image_width_px=[1] + [2] * (len(frame) - 1)))


def test_without_pandas_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(sc.UnsupportedError, match="needs pandas, which is not installed; pip install pandas"):
        random_table(1).to_dataframe()


def test_importing_and_reading_load_no_pandas():
    import subprocess

    code = "import sys, sonocal; sonocal.Observations; print('pandas' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
