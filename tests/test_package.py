"""The public face: names, version, and what importing it costs."""

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import sonocal as sc

PUBLIC = [
    "AxisScaled", "Calibration", "DegenerateGeometryError", "Diagnostic", "ErrorStatistics", "FormatError",
    "InputError", "Line", "NoConsensusError", "Observations", "Recording", "Similarity", "SonocalError",
    "UnsupportedError", "Volume", "__version__", "calibrate", "calibrate_recording", "load", "read_observations",
    "read_recording", "reconstruct", "write_observations", "write_recording",
]  # fmt: skip


def test_the_exported_names_are_these():
    assert sorted(sc.__all__) == sorted(PUBLIC)
    assert all(hasattr(sc, name) for name in PUBLIC)


def test_the_version_comes_from_one_place():
    assert version("sonocal") == sc.__version__


def test_importing_loads_nothing_heavy():
    code = (
        "import sys, sonocal; print([m for m in ('scipy', 'rich', 'click', 'matplotlib', 'hypothesis') "
        "if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_readers_of_recordings_wait_until_they_are_asked_for():
    code = "import sys, sonocal; print('sonocal.recording' in sys.modules); print(sonocal.read_recording.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "read_recording"]
    with pytest.raises(AttributeError, match="has no attribute 'read_recordings'"):
        _ = sc.read_recordings


def test_registration_loads_no_ultrasound():
    code = (
        "import sys, sonocal.registration; print(sorted(m for m in sys.modules if m.startswith('sonocal')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    rooms = {name.split(".")[1] for name in eval(done.stdout) if "." in name}
    assert rooms == {"_core", "errors", "findings", "geometry", "registration"}


def test_the_face_lists_its_names_before_any_is_used():
    code = "import sonocal; print(dir(sonocal))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(PUBLIC) <= set(eval(done.stdout))


def test_every_error_is_a_sonocal_error():
    errors = [
        sc.InputError,
        sc.FormatError,
        sc.DegenerateGeometryError,
        sc.NoConsensusError,
        sc.UnsupportedError,
    ]
    assert all(issubclass(error, sc.SonocalError) for error in errors)
    assert issubclass(sc.FormatError, sc.InputError)


def test_hints_name_packages_that_an_index_has():
    source = Path(sc.__file__).parent
    assert [path.name for path in source.rglob("*.py") if "sonocal[" in path.read_text("utf-8")] == []
