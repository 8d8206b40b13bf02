"""The studio in Chromium: first frame, a click to the changed number, playing; on whatever machine this is.

python -m benchmarks.studio [--frames 400] [--clicks 30]
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear

WIDE, HIGH, MM_PER_PX = 820, 616, 0.2
PLAYED_S = 5.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=400)
    parser.add_argument("--clicks", type=int, default=30)
    asked = parser.parse_args()
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as api:
        options = SweepOptions(frames=asked.frames, rate_hz=60.0, sigma_px=0.5, sigma_mm=0.5, seed=1)
        source, lines, _ = write_sweep(
            simulate_sweep(curvilinear(WIDE, HIGH, MM_PER_PX), BATH, options), folder
        )
        chromium = api.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = chromium.new_page(viewport={"width": 1400, "height": 1000})
        requests: list[str] = []
        troubles: list[str] = []
        page.on("request", lambda request: requests.append(request.url))
        page.on("console", lambda message: troubles.append(message.text))
        begun = time.perf_counter()
        command = [sys.executable, "-m", "sonocal", "studio", source, "--lines", lines, "--no-browser"]
        output = ["-o", str(Path(folder) / "studio")]
        process = subprocess.Popen([*map(str, command), *output], stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            address = re.findall(r"http\S+", process.stdout.readline())[0]
            page.goto(address)
            page.wait_for_selector("#frame[data-frame]")
            early = page.locator('#numbers[data-revision=""]').count() == 1
            print(
                f"first frame {time.perf_counter() - begun:.2f} s after the command, before detection ends: {early}"
            )
            page.wait_for_selector('#numbers:not([data-revision=""])', timeout=600_000)
            taken = [clicked(page) for _ in range(asked.clicks)]
            half, most = np.quantile(taken, [0.5, 0.95]) * 1000
            print(
                f"click to changed number, {asked.clicks} clicks: median {half:.0f} ms, 95 % below {most:.0f} ms"
            )
            print(f"playing {WIDE} x {HIGH} with overlay: {played(page):.1f} frames a second")
            foreign = [url for url in requests if not url.startswith(address.split("/?")[0])]
            print(f"requests outside loopback: {len(foreign)}; console errors: {len(troubles)}")
        finally:
            chromium.close()
            process.terminate()
            process.wait()


def clicked(page: Any) -> float:
    """Seconds from a key that drops the next worst sighting to the number that comes of it."""
    page.keyboard.press("n")
    before = page.get_attribute("#numbers", "data-revision")
    begun = time.perf_counter()
    page.keyboard.press("x")
    page.wait_for_selector(f'#numbers:not([data-revision="{before}"])')
    return time.perf_counter() - begun


def played(page: Any) -> float:
    """Frames a second that were drawn."""
    page.evaluate("document.getElementById('seek').value = 0")
    page.dispatch_event("#seek", "input")
    count = "document.getElementById('frame').drawn.frames"
    before = page.evaluate(count)
    page.click("#play")
    begun = time.perf_counter()
    while page.get_attribute("#play", "aria-pressed") == "true" and time.perf_counter() - begun < PLAYED_S:
        time.sleep(0.05)
    drawn = page.evaluate(count) - before
    return drawn / (time.perf_counter() - begun)


if __name__ == "__main__":
    main()
