from pathlib import Path

import pytest
from hypothesis import settings

# Fixed examples: a law that fails only on some machine's random draw helps nobody.
settings.register_profile("sonocal", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("sonocal")

DATA = Path(__file__).parent.parent.parent / "shared" / "data"


@pytest.fixture
def few_images(monkeypatch):
    """The sample recording, wherever it is made, is small: where a test is not of that recording."""
    from sonocal.simulation import sample
    from tests.builders.samples import small_sample

    monkeypatch.setattr(sample, "sample_sweep", small_sample)


@pytest.fixture(scope="session")
def data_folder():
    if not DATA.is_dir():
        pytest.skip(f"no real data: {DATA} does not exist")
    return DATA


@pytest.fixture(scope="session")
def cases_folder():
    """Small files that went wrong once."""
    folder = DATA.parent / "cases"
    if not folder.is_dir():
        pytest.skip(f"no cases: {folder} does not exist")
    return folder
