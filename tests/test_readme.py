"""What the README tells a newcomer to paste first needs no file, and works as processes of their own.

All of it runs in tests/docs/test_pasted.py, in a folder with the files that it names.
"""

import shlex
import subprocess
import sys

from tests.builders.pasted import ROOT, commands_in, text_of

TRY_IT = text_of(ROOT / "README.md").partition("## Try it")[2].partition("\n## ")[0]


def test_the_first_commands_run_in_an_empty_folder(tmp_path):
    commands = [command for command in commands_in(TRY_IT) if command.startswith("sonocal ")]
    assert [command.split()[1] for command in commands[:5]] == [
        "demo",
        "calibrate",
        "export",
        "info",
        "sample",
    ]
    for command in commands[:4]:
        subprocess.run(
            [sys.executable, "-m", *shlex.split(command)], cwd=tmp_path, check=True, capture_output=True
        )
    assert (tmp_path / "calibration" / "plus.xml").exists()


def test_the_readme_opens_with_a_picture():
    opening = text_of(ROOT / "README.md").partition("\n## ")[0]
    assert "](docs/pictures/calibration.png)" in opening
