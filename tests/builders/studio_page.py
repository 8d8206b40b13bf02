"""The studio's page in Chromium."""

from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.builders.browser import CHROMIUM

AXE = Path(__file__).parents[2] / "scripts" / "page" / "node_modules" / "axe-core" / "axe.min.js"
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
READY = '#numbers:not([data-revision=""])'


class Page:
    """A page, and what it asked for and complained of."""

    def __init__(self, tab):
        self.tab, self.requests, self.troubles = tab, [], []
        tab.on("request", lambda request: self.requests.append(request.url))
        tab.on("console", lambda message: self.troubles.append(message.text))
        tab.on("pageerror", lambda error: self.troubles.append(str(error)))

    def ready(self):
        self.tab.wait_for_selector(READY, timeout=60_000)
        return self

    def text(self, selector):
        """What stands there once what changed is drawn: the page draws with the screen's next picture."""
        self.tab.evaluate(DRAWN)
        return self.tab.inner_text(selector)

    def revision(self):
        return self.tab.get_attribute("#numbers", "data-revision")

    def after(self, act):
        """Do something, and wait for the numbers that come of it."""
        before = self.revision()
        act()
        self.tab.wait_for_selector(
            f'#numbers:not([data-revision="{before}"]):not([data-revision=""])', timeout=30_000
        )


@contextmanager
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no chromium; apt install chromium")
    with playwright.sync_playwright() as api:
        found = api.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        )
        yield found
        found.close()
