"""A page, opened in Chromium as a user would: wide, narrow and printed."""

import shutil
from typing import NamedTuple

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


class Opened(NamedTuple):
    """What a browser did with a page.

    Attributes:
        requests: what it fetched, but for data in the page itself.
        troubles: what it complained of.
        overflow: px that the page is wider than a wide window.
        narrow: px that any part is wider than its place, 420 px wide: cut off, or hidden behind a bar.
        printed: the page as PDF.
    """

    requests: list[str]
    troubles: list[str]
    overflow: int
    narrow: int
    printed: bytes


def opened(path):
    playwright = pytest.importorskip("playwright.sync_api")
    requests, troubles = [], []
    with playwright.sync_playwright() as api:
        browser = api.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        )
        tab = browser.new_page()
        tab.on("request", lambda request: requests.append(request.url))
        tab.on("console", lambda message: troubles.append(message.text))
        tab.on("pageerror", lambda error: troubles.append(str(error)))
        tab.goto(path.as_uri())
        overflow = tab.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        tab.set_viewport_size({"width": 420, "height": 900})
        narrow = tab.evaluate(
            "[document.documentElement, ...document.querySelectorAll('table, figure, div')]"
            ".map(one => one.scrollWidth - one.clientWidth)"
        )
        tab.emulate_media(media="print")
        printed = tab.pdf(format="A4", prefer_css_page_size=True)
        browser.close()
    fetched = [url for url in requests if not url.startswith("data:")]
    return Opened(fetched, troubles, overflow, max(narrow), printed)
