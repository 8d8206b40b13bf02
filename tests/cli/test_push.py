"""A calibration into a running program: shown, asked about, seen to be there."""

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal import InputError, igtl
from sonocal.cli import main
from sonocal.simulation.scene import simulate_observations
from tests.builders.plus_server import FakePlus

OLD = {
    "TransformValue": "0.2 0 0 1 0 0.2 0 2 0 0 0.2 3 0 0 0 1",
    "TransformDate": "052226_101500",
    "TransformError": "0.75",
}


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    path = tmp_path_factory.mktemp("pushed") / "calibration.json"
    sc.calibrate(simulate_observations(seed=2).observations).save(path)
    return path


def pushed(calibration, server, *more):
    return CliRunner().invoke(main, ["export", str(calibration), "--push", server.address, "--force", *more])


def test_plus_gets_the_matrix_and_saves_it(calibration):
    with FakePlus({"ImageToProbe": OLD}) as server:
        result = pushed(calibration, server, "--yes")
    assert result.exit_code == 0, result.output
    ours = sc.load(calibration)
    np.testing.assert_array_equal(server.matrix("ImageToProbe"), ours.probe_from_image.matrix)
    held = server.held["ImageToProbe"]
    assert held["TransformPersistent"] == "TRUE"
    assert float(held["TransformError"]) == ours.fit.rms_mm
    assert server.saved == ["its own"]
    assert server.versions == {2}
    for words in ("has ImageToProbe of 052226_101500 (error 0.75 mm)", "Corners of the image move by up to"):
        assert words in result.output


def test_a_transform_that_is_new_gets_its_name_from_the_frames(calibration):
    with FakePlus() as server:
        result = pushed(
            calibration, server, "--yes", "--image", "Us", "--probe", "Marker", "--save-as", "new.xml"
        )
    assert result.exit_code == 0, result.output
    assert "has no UsToMarker; it gets" in result.output
    assert (list(server.held), server.saved) == (["UsToMarker"], ["new.xml"])


def test_without_an_answer_nothing_changes(calibration):
    with FakePlus({"ImageToProbe": OLD}) as server:
        result = pushed(calibration, server)
    assert result.exit_code == 1
    assert "nobody is there to be asked whether to put it there; say --yes" in result.output
    assert (server.held, server.saved) == ({"ImageToProbe": OLD}, [])


@pytest.mark.parametrize(
    "broken, sentence",
    [
        ("GetTransform", "does not tell ImageToProbe ("),
        ("UpdateTransform", "refuses UpdateTransform ('Unable to <write>"),
        ("SaveConfig", "refuses SaveConfig ("),
        ("forgetful", "said that it took ImageToProbe and holds another matrix"),
    ],
)
def test_a_refusal_is_said(calibration, broken, sentence):
    with FakePlus({"ImageToProbe": OLD}, broken=broken) as server:
        result = pushed(calibration, server, "--yes")
    assert result.exit_code == 1
    assert sentence in result.output


def test_a_server_that_knows_no_commands_is_said():
    with (
        FakePlus(broken="silent") as server,
        igtl.Client(*igtl.address(server.address)) as client,
        pytest.raises(InputError, match=r"answers nothing to GetTransform within 0\.3 s; is it a PlusServer"),
    ):
        igtl.PlusServer(client, server.address, timeout_s=0.3).transform("ImageToProbe")


def test_slicer_gets_a_transform(calibration):
    with igtl.Server() as server:
        address = f"127.0.0.1:{server.port}"
        result = CliRunner().invoke(
            main, ["export", str(calibration), "--to", "slicer", "--push", address, "--yes", "--force"]
        )
        (arrival,) = server.take(10)
    assert result.exit_code == 0, result.output
    matrix = sc.load(calibration).probe_from_image.matrix
    np.testing.assert_allclose(arrival.message.content.matrix, matrix, rtol=1e-6, atol=1e-5)
    assert (arrival.message.name, arrival.message.version) == ("ImageToProbe", 1)
    assert "Slicer gives no answer" in result.output


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ([], "or --push HOST:PORT"),
        (["--to", "plus", "-o", "plus.xml", "--yes"], "--yes and --save-as are for --push"),
        (["--to", "itk", "--push", "localhost:1"], "--to plus or slicer"),
        (["--to", "slicer", "--push", "localhost:1", "--save-as", "x"], "--save-as is for --to plus"),
        (["-o", "plus.xml"], "Missing option '--to'"),
    ],
)
def test_options_that_do_not_go_together(calibration, arguments, sentence):
    result = CliRunner().invoke(main, ["export", str(calibration), *arguments])
    assert result.exit_code == 2
    assert sentence in result.output
