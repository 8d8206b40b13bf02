"""The closed forms run as wide as this processor does: a wheel that cannot ask it would be slow in silence."""

import platform
from pathlib import Path

import pytest

from sonocal import _core

CPUINFO = Path("/proc/cpuinfo")
NEEDED = {"avx512": {"avx512f", "avx512dq", "avx512vl"}, "avx2": {"avx2", "fma"}, "base": set()}


def test_the_widest_kernel_is_chosen_that_the_system_says_runs_here():
    if platform.machine() not in ("x86_64", "AMD64"):
        assert _core.kernel() == "base"
        return
    if not CPUINFO.is_file():
        pytest.skip("this system does not list what its processor runs")
    flags = next(line for line in CPUINFO.read_text().splitlines() if line.startswith("flags")).split()
    assert _core.kernel() == next(name for name, needs in NEEDED.items() if needs <= set(flags))
