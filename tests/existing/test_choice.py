"""Which matrix of a file is taken, and what it is called once it was read."""

import numpy as np
import pytest

from sonocal.existing.choice import Choice, chosen
from sonocal.existing.matrix import Matrices, checked

MATRIX = np.array([[0, 0, 0.2, 10], [0.2, 0, 0, 20], [0, 0.2, 0, -30], [0, 0, 0, 1.0]])
FORMS = (None, "direct", "inverse", "slicer")


def called(name, form):
    return chosen(Matrices("a.xml", "PLUS", (checked("a.xml", MATRIX, name),)), Choice(name, form))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("names", "forwards"),
    [
        (("ImageToProbe", "ProbeToImage"), "ImageToProbe"),
        (("probe_from_image", "image_from_probe"), "probe_from_image"),
        (("image_to_probe", "probe_to_image"), "image_to_probe"),
    ],
)
def test_whatever_a_file_calls_it_and_however_it_is_stored_its_name_leads_from_the_image(
    names, forwards, form
):
    for name in names:
        assert called(name, form).said == f"{forwards} of a.xml"


@pytest.mark.parametrize(
    ("form", "name"),
    [(None, "ProbeToTracker"), ("inverse", "TrackerToProbe"), ("slicer", "ProbeToTracker")],
)
def test_a_name_without_an_image_is_turned_with_its_matrix(form, name):
    assert called("ProbeToTracker", form).transform == name


@pytest.mark.parametrize("form", FORMS)
def test_what_has_no_name_gets_none(form):
    assert chosen(Matrices("a.txt", "text", (checked("a.txt", MATRIX),)), Choice(None, form)).transform == ""
