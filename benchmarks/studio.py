"""The studio in Chromium: first frame, a click to the changed number, playing; on whatever machine this is.

python -m benchmarks.studio [--frames 400] [--clicks 30]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from tests.builders.studio import running
from tests.builders.studio_page import Page, browser

WIDE, HIGH, MM_PER_PX = 820, 616, 0.2
PLAYED_S = 5.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=400)
    parser.add_argument("--clicks", type=int, default=30)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, browser() as chromium:
        options = SweepOptions(frames=asked.frames, rate_hz=60.0, sigma_px=0.5, sigma_mm=0.5, seed=1)
        source, lines, _ = write_sweep(
            simulate_sweep(curvilinear(WIDE, HIGH, MM_PER_PX), BATH, options), folder
        )
        context = chromium.new_context(viewport={"width": 1400, "height": 1000})
        page = Page(context.new_page())
        begun = time.perf_counter()
        with running(Path(folder) / "studio", source, "--lines", lines) as one:
            page.tab.goto(one.address)
            page.tab.wait_for_selector("#frame[data-frame]")
            early = page.tab.locator('#numbers[data-revision=""]').count() == 1
            print(
                f"first frame {time.perf_counter() - begun:.2f} s after the command, before detection ends: {early}"
            )
            page.tab.wait_for_selector('#numbers:not([data-revision=""])', timeout=600_000)
            taken = [clicked(page) for _ in range(asked.clicks)]
            half, most = np.quantile(taken, [0.5, 0.95]) * 1000
            print(
                f"click to changed number, {asked.clicks} clicks: median {half:.0f} ms, 95 % below {most:.0f} ms"
            )
            print(f"playing {WIDE} x {HIGH} with overlay: {played(page):.1f} frames a second")
            foreign = [url for url in page.requests if not url.startswith(one.origin)]
            print(f"requests outside loopback: {len(foreign)}; console errors: {len(page.troubles)}")


def clicked(page: Page) -> float:
    """Seconds from a key that drops the next worst sighting to the number that comes of it."""
    page.tab.keyboard.press("n")
    begun = time.perf_counter()
    page.after(lambda: page.tab.keyboard.press("x"))
    return time.perf_counter() - begun


def played(page: Page) -> float:
    """Frames a second that were drawn."""
    page.tab.evaluate("document.getElementById('seek').value = 0")
    page.tab.dispatch_event("#seek", "input")
    count = "document.getElementById('frame').drawn.frames"
    before = page.tab.evaluate(count)
    page.tab.click("#play")
    begun = time.perf_counter()
    time.sleep(PLAYED_S)
    drawn = page.tab.evaluate(count) - before
    return drawn / (time.perf_counter() - begun)


if __name__ == "__main__":
    main()
