"""What wheels are called, and how the numbers of two builds are compared."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripts.wheel_targets.compare import MOST_APART, apart
from scripts.wheel_targets.targets import FLOOR, STABLE, TARGETS

NUMBERS = st.dictionaries(
    st.sampled_from("abc"), st.lists(st.floats(-1e6, 1e6), max_size=5), min_size=1
).filter(lambda numbers: any(numbers.values()))


@pytest.mark.parametrize("name", TARGETS)
def test_a_wheel_of_the_floor_is_for_it_alone_and_the_other_for_all_later_ones(name):
    target = TARGETS[name]
    assert target.tag(FLOOR) == f"cp311-cp311-{target.platform}"
    assert target.tag(STABLE) == f"cp312-abi3-{target.platform}"
    # No module of one would be loaded by the other's CPython.
    assert target.module(FLOOR) != target.module(STABLE)
    assert target.suffix in target.module(FLOOR)


def test_no_two_wheels_have_one_name():
    tags = [target.tag(version) for target in TARGETS.values() for version in (FLOOR, STABLE)]
    assert len(set(tags)) == len(tags) == 10


@given(NUMBERS)
def test_numbers_are_not_apart_from_themselves(numbers):
    assert apart(numbers, numbers) == 0


@given(NUMBERS, st.data())
def test_what_differs_is_seen_wherever_it_is(numbers, data):
    kind = data.draw(st.sampled_from([kind for kind, row in numbers.items() if row]))
    place = data.draw(st.integers(0, len(numbers[kind]) - 1))
    for other in (
        numbers[kind][place] + 2 * MOST_APART * (1 + abs(numbers[kind][place])),
        math.nan,
        math.inf,
    ):
        changed = {**numbers, kind: [*numbers[kind][:place], other, *numbers[kind][place + 1 :]]}
        assert not apart(changed, numbers) <= MOST_APART
        assert not apart(numbers, changed) <= MOST_APART
    assert apart({**numbers, kind: numbers[kind][:-1]}, numbers) == math.inf
