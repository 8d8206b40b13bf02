"""What docs/studies.md tells users to write works as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

from sonocal.studies import METHODS, Scene, built_in_names, load_study
from sonocal.studies.measures import QUANTITIES

PAGE = (Path(__file__).parents[2] / "docs" / "studies.md").read_text(encoding="utf-8")


def test_the_study_on_the_page_is_one(tmp_path):
    text = re.search(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL).group(1)
    path = tmp_path / "short-needle.toml"
    path.write_text(text)
    study = load_study(path)
    assert len(study.cells()) == 12
    assert study.answer.goal == 1.0


def test_the_example_in_python_runs(tmp_path):
    example = re.search(r"```python\n(.*?)```", PAGE, flags=re.DOTALL).group(1)
    done = subprocess.run(
        [sys.executable, "-c", example], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["5", "6", "7", "8", "9", "10"]


def test_every_setting_method_quantity_and_study_is_on_the_page():
    for name in (*Scene.__struct_fields__, *METHODS, *QUANTITIES, *built_in_names()):
        assert f"`{name}`" in PAGE or re.search(rf"\b{name}\b", PAGE), name


def test_the_defaults_on_the_page_are_the_settings_own():
    for names, defaults in re.findall(r"^\| (`[a-z_`, ]+`) \| ([\d., ]+) \|", PAGE, flags=re.MULTILINE):
        fields = re.findall(r"`(\w+)`", names)
        assert [float(value) for value in defaults.split(",")] == [
            getattr(Scene(), field) for field in fields
        ]
