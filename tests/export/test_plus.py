from xml.etree import ElementTree

import numpy as np
import pytest

import sonocal as sc
from sonocal.export.plus import plus_xml
from sonocal.simulation.scene import simulate_observations


@pytest.mark.parametrize("dimension", [2, 3])
def test_image_to_probe_equals_the_calibration_to_the_last_bit(dimension):
    found = sc.calibrate(simulate_observations(dimension, 20, seed=1).observations)
    transforms = ElementTree.fromstring(plus_xml(found)).findall("CoordinateDefinitions/Transform")
    assert [(t.get("From"), t.get("To")) for t in transforms] == [("Image", "Probe")]
    numbers = np.array([float(x) for x in transforms[0].get("Matrix").split()]).reshape(4, 4)
    np.testing.assert_array_equal(numbers, found.probe_from_image.matrix)
    assert float(transforms[0].get("Error")) == pytest.approx(found.fit.rms_mm, rel=1e-5)
