"""The page, as a person meets it."""

import json

import pytest

from sonocal.simulation.sample import sample_sweep
from tests.builders.studio import running
from tests.builders.studio_page import AXE, Page, browser


@pytest.fixture(scope="module")
def chromium():
    with browser() as one:
        yield one


@pytest.fixture
def opened(chromium, sweep, tmp_path):
    """A page on the sweep, ready, with the studio behind it."""
    with running(tmp_path / "studio", sweep[0], "--lines", sweep[1]) as one:
        context = chromium.new_context(viewport={"width": 1280, "height": 900})
        page = Page(context.new_page())
        page.tab.goto(one.address)
        yield page.ready(), one
        context.close()


def test_the_page_asks_nobody_else_and_complains_of_nothing(opened):
    page, one = opened
    page.tab.keyboard.press("n")
    page.after(lambda: page.tab.keyboard.press("x"))
    assert all(url.startswith(one.origin) for url in page.requests)
    assert not page.troubles
    assert "key=" not in page.tab.url


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_is_read_by_everybody(opened, scheme):
    if not AXE.exists():
        pytest.skip("no axe-core; npm install --prefix scripts/page")
    page, _ = opened
    page.tab.emulate_media(color_scheme=scheme)
    page.tab.click("#findings summary")
    page.tab.click("#files summary")
    page.tab.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.tab.evaluate("axe.run()")["violations"]
    assert not [(one["id"], [node["html"] for node in one["nodes"]]) for one in found]


@pytest.mark.parametrize("width", [390, 1280, 2560])
def test_nothing_is_cut_off_at_any_width(opened, width):
    page, _ = opened
    page.tab.set_viewport_size({"width": width, "height": 900})
    wider = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert page.tab.evaluate(wider) <= 0
    cut = (
        "[...document.querySelectorAll('p, li, dd, dt, button, summary, figcaption')]"
        ".filter(one => one.scrollWidth > one.clientWidth + 1 && getComputedStyle(one).display !== 'inline')"
        ".map(one => one.outerHTML)"
    )
    assert page.tab.evaluate(cut) == []


def test_a_click_moves_the_point_and_the_numbers_follow_in_both_tabs(opened):
    page, one = opened
    other = Page(page.tab.context.new_page())
    other.tab.goto(one.origin)
    other.ready()
    before = page.text("#number-2")
    page.tab.keyboard.press("n")
    box = page.tab.locator("#frame").bounding_box()
    page.after(lambda: page.tab.mouse.click(box["x"] + 0.3 * box["width"], box["y"] + 0.6 * box["height"]))
    assert (
        page.text("#number-2") != before
        or page.text("#number-3").split()[0] != page.text("#number-3").split()[2]
    )
    other.tab.wait_for_selector(f'#numbers[data-revision="{page.revision()}"]')
    assert [other.text(f"#number-{i}") for i in range(4)] == [page.text(f"#number-{i}") for i in range(4)]


def test_calibrated_and_exported_by_keyboard_alone(opened):
    page, one = opened
    press = page.tab.keyboard.press
    start = [page.text(f"#number-{i}") for i in range(4)]
    press("n")
    frame = page.text("#at")
    page.after(lambda: press("x"))
    assert page.text("#number-3") != start[3]
    page.after(lambda: press("x"))
    page.after(lambda: press("Shift+ArrowRight"))
    press("ArrowRight")
    assert page.text("#at") != frame
    for _ in range(3):
        page.after(lambda: press("z"))
    assert [page.text(f"#number-{i}") for i in range(4)] == start
    press("Space")
    page.tab.wait_for_selector('#play[aria-pressed="true"]')
    press("Space")
    press("e")
    page.tab.wait_for_selector("#files li", timeout=60_000)
    assert "Exported" in page.text("#banner")
    assert one.ask("/files/calibration.json", Cookie=cookies(page))[0] == 200


def cookies(page):
    return "; ".join(f"{one['name']}={one['value']}" for one in page.tab.context.cookies())


def test_a_click_while_the_server_is_away_is_sent_when_it_is_back(chromium, sweep, tmp_path):
    source, lines = sweep
    with running(tmp_path / "studio", source, "--lines", lines) as one:
        context = chromium.new_context()
        page = Page(context.new_page())
        page.tab.goto(one.address)
        page.ready()
        one.kill()
        page.tab.wait_for_selector("#banner.stop")
        assert "connection to sonocal is lost" in page.text("#banner")
        context.close()


def test_names_of_html_are_text(chromium, tmp_path):
    name = "<img src=x onerror=document.title='hurt'>"
    sweep = sample_sweep(24)
    needle = tmp_path / "needle.toml"
    content = f'[[line]]\nname = "{name}"\nframe = "Needle"\nfrom_mm = [0.0, 0.0, 0.0]\nto_mm = [0.0, 0.0, -400.0]\n'
    needle.write_text(content)
    from sonocal.recording.formats import write_recording

    write_recording(sweep.recording, tmp_path / "<b onclick=x>.igs.mha")
    with running(tmp_path / "studio", tmp_path / "<b onclick=x>.igs.mha", "--lines", needle) as one:
        context = chromium.new_context()
        page = Page(context.new_page())
        page.tab.goto(one.address)
        page.ready()
        assert "<b onclick=x>" in page.text("#what")
        assert name in page.text("#target")
        assert page.tab.title() == "sonocal studio"
        assert page.tab.locator("main img, main b").count() == 0
        context.close()


def test_a_recording_that_is_dropped_is_seen_and_its_needle_is_written_in_the_page(chromium, sweep, tmp_path):
    with running(tmp_path / "studio") as one:
        context = chromium.new_context()
        page = Page(context.new_page())
        page.tab.goto(one.address)
        page.tab.set_input_files("#choose", [str(sweep[0])])
        page.tab.wait_for_selector("#frame[data-frame]", timeout=30_000)
        page.tab.wait_for_selector("#needle", timeout=30_000)
        assert "say what was scanned" in page.text("#verdict")
        page.tab.fill("#needle", sweep[1].read_text().replace('"Needle"', '"Stylus"'))
        assert "no tool of this recording" in page.text("#files")
        page.tab.fill("#needle", sweep[1].read_text())
        page.tab.click("#use-needle")
        page.ready()
        page.tab.wait_for_selector("#verdict.use, #verdict.care", timeout=60_000)
        assert json.dumps(page.troubles) == "[]"
        context.close()


def test_the_tour_leads_through_the_page(opened):
    page, _ = opened
    page.tab.click("#tour")
    seen = set()
    while page.tab.locator("#guide[open]").count():
        seen.add(page.text("#guide-title"))
        page.tab.click("#guide-next")
    assert len(seen) == 6
