"""The first moment of a command: what is loaded before one is chosen, and ctrl-C while it is."""

import subprocess
import sys

INTERRUPTED = """
import sys
from importlib.abc import MetaPathFinder

class CtrlC(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "sonocal.cli.live":
            raise KeyboardInterrupt

sys.meta_path.insert(0, CtrlC())
from sonocal.__main__ import main
main()
"""


def ran(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_help_and_the_tab_key_load_no_library_of_numbers():
    done = ran(
        "import sys, sonocal.cli.main; print([m for m in ('numpy', 'scipy', 'rich') if m in sys.modules])"
    )
    assert done.stdout.strip() == "[]", done.stderr


def test_ctrl_c_while_modules_load_ends_in_a_word():
    done = ran(INTERRUPTED)
    assert (done.returncode, done.stdout, done.stderr.strip()) == (1, "", "Aborted!")
