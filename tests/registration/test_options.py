"""Options are checked once, whatever type of number they come as, and refused in one sentence that names them."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.errors import InputError
from sonocal.registration.options import Options, positive_number, whole_number

NUMBERS = ["threshold_mm", "sigma_px", "sigma_mm", "confidence"]
COUNTS = ["max_samples", "exhaustive_samples", "seed"]
NAMES = [field.name for field in dataclasses.fields(Options)]
positive = st.floats(1e-300, 1e60)


@dataclass(frozen=True)
class Wider(Options):
    """Options of a room further up."""

    tolerance_mm: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._keep("tolerance_mm", positive_number("tolerance_mm", self.tolerance_mm))


@given(st.sampled_from(NUMBERS), st.floats(0.001, 0.999), st.sampled_from([float, np.float64, np.longdouble]))
def test_a_number_is_one_whatever_its_type(name, value, kind):
    found = Options.of(**{name: kind(value)})
    assert type(getattr(found, name)) is float
    assert found == Options.of(**{name: value})
    assert hash(found) == hash(Options.of(**{name: value}))


@given(
    st.sampled_from(COUNTS),
    st.integers(1, 1000),
    st.sampled_from([int, np.int64, np.uint8, np.int16, np.uint64]),
)
def test_a_count_is_one_whatever_its_type(name, value, kind):
    value = value % 127 + 1
    found = Options.of(**{name: kind(value)})
    assert type(getattr(found, name)) is int
    assert found == Options.of(**{name: value})


@pytest.mark.parametrize("name", [*NUMBERS, *COUNTS])
@pytest.mark.parametrize(
    "value", [True, False, np.True_, "5", [5.0], np.array(5.0), 1j, math.nan, np.float64("nan")]
)
def test_what_is_no_number_is_refused_with_its_name(name, value):
    with pytest.raises(InputError, match=f"^{name} must be a (positive|whole) number"):
        Options.of(**{name: value})


@given(st.sampled_from(NUMBERS), st.floats(max_value=0.0, allow_nan=False))
def test_no_number_is_negative_or_zero(name, value):
    with pytest.raises(InputError, match=f"^{name} must be a positive number; got "):
        Options.of(**{name: value})


@given(st.sampled_from(COUNTS), st.integers(max_value=-1) | st.integers(min_value=2**64) | st.floats(0, 10))
def test_no_count_is_below_zero_huge_or_has_a_fraction(name, value):
    with pytest.raises(InputError, match=f"^{name} must be a whole number from "):
        Options.of(**{name: value})


def test_the_ends_of_every_range():
    assert Options(seed=2**64 - 1).seed == 2**64 - 1
    assert Options(exhaustive_samples=0, max_samples=1).max_samples == 1
    assert Options(threshold_mm=math.inf).threshold_mm == math.inf  # all rows agree
    for wrong in (
        {"max_samples": 0},
        {"confidence": 1},
        {"confidence": 1.5},
        {"sigma_px": math.inf},
        {"seed": -1},
    ):
        with pytest.raises(InputError, match=f"^{next(iter(wrong))} must be "):
            Options(**wrong)


@pytest.mark.parametrize("name", ["model", "weighting"])
@pytest.mark.parametrize("value", ["", "Similarity", None, 3])
def test_a_choice_is_one_of_those_that_there_are(name, value):
    with pytest.raises(InputError, match=f"^{name} must be one of .*; got "):
        Options(**{name: value})


@given(st.sampled_from(NAMES), st.data())
def test_a_misspelt_option_is_answered_with_the_one_that_was_meant(name, data):
    place = data.draw(st.integers(1, len(name) - 2))
    misspelt = name[:place] + name[place + 1 :]  # a letter is missing
    with pytest.raises(InputError) as caught:
        Options.of(**{misspelt: 1})
    assert str(caught.value) == f"there is no option {misspelt!r}; did you mean {name!r}?"


def test_an_option_near_to_none_is_answered_with_all_of_them():
    with pytest.raises(InputError) as caught:
        Options.of(quux=1)
    assert all(name in str(caught.value) for name in NAMES)


def test_a_room_further_up_adds_options_and_keeps_the_checks():
    found = Wider.of(tolerance_mm=np.float32(1.5), threshold_mm=3)
    assert type(found) is Wider
    assert (found.tolerance_mm, found.threshold_mm) == (1.5, 3.0)
    with pytest.raises(InputError, match="did you mean 'tolerance_mm'"):
        Wider.of(tolerence_mm=1)
    with pytest.raises(InputError, match=r"tolerance_mm must be a positive number; got -1"):
        Wider.of(tolerance_mm=-1)
    with pytest.raises(InputError, match="seed must be a whole number"):
        Wider.of(seed=0.5)
    with pytest.raises(InputError, match="there is no option 'tolerance_mm'"):
        Options.of(tolerance_mm=1)


def test_options_do_not_change_and_replacing_one_checks_it():
    options = Options()
    with pytest.raises(dataclasses.FrozenInstanceError):
        options.seed = 3
    assert dataclasses.replace(options, seed=np.int8(3)).seed == 3
    with pytest.raises(InputError):
        dataclasses.replace(options, seed=-3)


@given(positive, st.integers(-5, 5))
def test_the_reusable_checks_give_back_what_they_are_given(number, count):
    assert positive_number("x", number) == number
    assert whole_number("n", count, -5, 5) == count
    with pytest.raises(InputError, match=f"^n must be a whole number from {count + 1} to 9; got {count}$"):
        whole_number("n", count, count + 1, 9)


def test_options_that_are_known_are_those_of_their_values_and_types():
    values = ("similarity", "geometric", 5.0, None, 1, 0.99, 100, 200, 1)
    assert Options.known(*values) == Options(*values)
    assert Options.known(*values) is Options.known(*values)
    with pytest.raises(InputError, match="seed must be a whole number"):
        Options.known(*values[:-1], True)
    with pytest.raises(InputError, match="sigma_mm must be a positive number"):
        Options.known(*values[:4], [1.0], *values[5:])
