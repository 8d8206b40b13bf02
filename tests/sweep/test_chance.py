"""Many candidates in a small image agree by chance; whether so many do is weighed, and not counted in thirds."""

from types import SimpleNamespace

import pytest

from sonocal.sweep.agreeing import Agreeing


class Table(SimpleNamespace):
    """Of candidates, as far as chance looks at it: how many, in how many images."""

    def __len__(self):
        return self.candidates


@pytest.mark.parametrize(
    ("count", "by_chance", "chance"), [(110, 37.6, False), (120, 40.1, False), (81, 37.6, True)]
)
def test_nearly_all_images_are_no_chance_though_a_third_would_agree(count, by_chance, chance):
    table = Table(candidates=600, shown=120)
    assert Agreeing(None, count, by_chance).may_be_chance(table) is chance
