"""What the README tells a newcomer to paste works as it stands there."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


def test_the_commands_and_the_example_run_in_an_empty_folder(tmp_path):
    commands = re.findall(r"^    \.venv/bin/sonocal (.+)$", README, flags=re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["demo", "calibrate", "export", "info"]
    for command in commands:
        subprocess.run(
            [sys.executable, "-m", "sonocal", *shlex.split(command)],
            cwd=tmp_path,
            check=True,
            capture_output=True,
        )
    example = re.search(r"```python\n(.*?)```", README, flags=re.DOTALL).group(1)
    done = subprocess.run(
        [sys.executable, "-c", example], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    assert done.stdout.count("[") == 5  # the matrix
    assert (tmp_path / "calibration.json").exists()


def test_the_table_of_sightings_in_the_readme_is_one():
    from sonocal.observations import parse_observations

    rows = re.search(r"(    frame,target.*?)\n\n", README, flags=re.DOTALL).group(1)
    assert len(parse_observations(rows.replace("    ", "").encode(), "README.md")) == 2
