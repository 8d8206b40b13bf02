import pytest

from sonocal.simulation.sample import sample_sweep
from sonocal.simulation.sweep_files import write_sweep
from tests.builders.studio import running


@pytest.fixture(scope="session")
def sweep(tmp_path_factory):
    """A short recording of a needle in water, and the needle."""
    return write_sweep(sample_sweep(48), tmp_path_factory.mktemp("sweep"))[:2]


@pytest.fixture(scope="module")
def studio(sweep, tmp_path_factory):
    """One that runs, with its cookie; tests that use it leave no edits behind."""
    source, lines = sweep
    with running(tmp_path_factory.mktemp("session") / "studio", source, "--lines", lines) as one:
        yield one.cookie()
