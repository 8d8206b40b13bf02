from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from scipy.spatial.transform import Rotation

from sonocal import Similarity

# Fixed examples: a law that fails only on some machine's random draw helps nobody.
settings.register_profile("sonocal", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("sonocal")

DATA = Path(__file__).parent.parent.parent / "shared" / "data"


@pytest.fixture(scope="session")
def data_folder():
    if not DATA.is_dir():
        pytest.skip(f"no real data: {DATA} does not exist")
    return DATA


def random_similarity(seed, scale=None):
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Similarity(rotation, rng.uniform(-200, 200, 3), rng.uniform(0.05, 1) if scale is None else scale)
