"""The measuring of the house: what it counts, and what it must not fall behind."""

import ast
import subprocess
import sys

from benchmarks import house

from sonocal.calibration import calibrate, fit_rows
from sonocal.simulation.scene import simulate_observations

SOURCE = '''
def documented(x):
    """One.

    Two.
    """
    # a reason

    return x


def bare():
    return 1
'''


def test_lines_are_counted_without_docstring_and_with_comments_and_blanks():
    functions = [node for node in ast.parse(SOURCE).body if isinstance(node, ast.FunctionDef)]
    assert [house.lines_without_docstring(one) for one in functions] == [4, 2]


def test_the_95th_percentile_is_a_value_that_95_of_100_do_not_exceed():
    assert house.median_and_p95(range(1, 101)) == "50.5 / 95"
    assert house.median_and_p95([3]) == "3 / 3"


def test_calls_are_counted_wherever_the_function_is_held_and_no_longer_after():
    import sonocal

    rows = simulate_observations(2, 12, seed=0).observations
    with house.counting(calibrate, fit_rows) as calls:
        sonocal.calibration.calibrate(rows)
        sonocal.calibration.calibrate(rows)
    sonocal.calibration.calibrate(rows)
    assert dict(calls) == {"calibrate": 2, "fit_rows": 2}


def test_a_module_imported_while_calls_are_counted_holds_the_function_itself_after():
    code = (
        "import sonocal\nfrom benchmarks import house\nfrom sonocal.calibration.calibrate import calibrate\n"
        "with house.counting(calibrate):\n    import sonocal.sweep.calibrate as late\n"
        "assert late.calibrate is calibrate, late.calibrate"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=house.ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_the_house_keeps_its_promises():
    found = {what: value for what, value, _ in [*house.rooms(), *house.lengths()]}
    assert int(found["modules in the root of src/sonocal"]) <= 5
    assert found["circles"] == found["arrows upwards, or against the table"] == "0"
    assert int(found["lines of calibrate() without its docstring"]) <= 45


def test_a_recording_is_calibrated_once():
    (_, calls, _), (_, fits, _) = house.fits_of_a_recording(frames=40)
    assert calls == "1"
    assert int(fits) <= 6
