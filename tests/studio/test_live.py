"""A scan that goes on, followed by the page: what is told of it, what it leaves, and that nothing of it is lost."""

import json
import threading
from contextlib import contextmanager

import click
import numpy as np
import pytest

import sonocal as sc
from sonocal import igtl
from sonocal.cli import main
from sonocal.live import Replay
from sonocal.simulation.sample import sample_sweep
from tests.builders.live import LONG_S, served, until
from tests.builders.studio import heard, running
from tests.builders.studio_page import AXE, Page, browser

SLOW_S = 240
"""A machine that has much else to do is waited for."""


@pytest.fixture(scope="module")
def scanned():
    return sample_sweep(80).recording


@contextmanager
def following(folder, lines, recording, *more, rate_hz=15.0):
    """A studio that follows a recording which is played over and over."""
    with (
        served(recording, rate_hz=rate_hz) as port,
        running(folder, "--live", f"localhost:{port}", "--lines", lines, *more) as one,
    ):
        yield one


def calibrated(socket):
    """The first moment with a calibration."""
    while True:
        told = heard(socket, "live", within=SLOW_S)
        if told["expected_mm"] is not None and not told["refusal"] and told["hold"]:
            return told


def newest(one, after=-1):
    """An image behind one, and what is told of it."""
    while True:
        status, headers, content = one.ask(f"/live/frame?after={after}")
        assert status in (200, 204)
        if status == 200:
            assert len(content) == int(headers["x-width"]) * int(headers["x-height"])
            return json.loads(headers["x-told"])


def test_a_scan_is_followed_and_its_recording_is_opened_at_the_end(sweep, scanned, tmp_path):
    folder, lines = tmp_path / "studio", sweep[1]
    with following(folder, lines, scanned) as one, one.cookie().events() as socket:
        assert heard(socket, "work", phase="live")["targets"] == ["needle"]
        told = calibrated(socket)
        assert told["hold"]["words"] == told["advice"]
        assert {name for name, _, _ in told["tools"]} == {"Probe", "Needle"}
        answer = heard(socket, "answer", within=SLOW_S)
        assert answer["fit"]["used"] > 0
        first = newest(one)
        assert newest(one, first["number"])["number"] > first["number"]
        assert (
            "a scan is being recorded"
            in json.loads(one.ask("/open", "POST", b'{"source": "a"}')[2])["refused"]
        )
        assert one.ask("/live/end", "POST", Origin=None)[0] == 403
        assert one.ask("/live/end", "POST")[0] == 200
        work = heard(socket, "work", phase="looking", within=SLOW_S)
        assert work["name"] == "recording.mhd"
        last = heard(socket, "answer", within=SLOW_S, touched=False)
        assert one.ask("/export", "POST")[0] == 200
        assert one.ask(f"/live/frame?after={first['number']}")[0] == 204
    kept = sc.read_recording(folder / "recording.mhd")
    assert len(kept) == work["frames"] >= told["recorded"]
    command = ["calibrate", str(kept_path := folder / "recording.mhd"), "--lines", str(lines), "--no-report"]
    main.main([*command, "-o", str(tmp_path / "own"), "--on-invalid", "skip"], standalone_mode=False)
    own = (tmp_path / "own" / "observations.csv").read_bytes()
    assert own == (folder / "export" / "observations.csv").read_bytes()
    assert sc.load(tmp_path / "own" / "calibration.json").fit.rms_mm == last["fit"]["rms_mm"]
    assert kept_path.exists()


def test_the_ring_is_where_the_cross_is_once_the_calibration_is_known(sweep, scanned, tmp_path):
    with following(tmp_path / "studio", sweep[1], scanned) as one, one.cookie().events() as socket:
        while calibrated(socket)["expected_mm"] > 3:
            pass
        after, apart = -1, []
        while len(apart) < 5:
            told = newest(one, after)
            after = told["number"]
            if told["rings"][0] and told["crosses"][0]:
                apart.append(np.hypot(*np.subtract(told["rings"][0], told["crosses"][0])))
        assert np.median(apart) < 8


def test_the_volume_grows_and_is_cut_through_the_newest_image(sweep, scanned, tmp_path):
    with (
        following(tmp_path / "studio", sweep[1], scanned, rate_hz=40.0) as one,
        one.cookie().events() as socket,
    ):
        assert one.ask("/live/slices")[0] == 204, "there is none before there is a calibration"
        calibrated(socket)
        seen, last = [], -1
        while len(seen) < 3:
            status, headers, content = one.ask(f"/live/slices?after={last}")
            if status == 200:
                told = json.loads(headers["x-told"])
                assert len(content) == sum(one["width"] * one["height"] for one in told["pictures"])
                assert any(content)
                assert [one["along"] for one in told["pictures"]] == ["z", "y", "x"]
                seen, last = [*seen, told["images"]], told["number"]
            else:
                heard(socket, "live", within=SLOW_S)
        assert seen[-1] > seen[0] > 0


def test_a_server_that_goes_is_waited_for_and_what_came_is_kept(sweep, scanned, tmp_path):
    def played(port=0):
        stop, server = threading.Event(), igtl.Server(port=port)
        how = {"rate_hz": 80.0, "loop": True}
        sender = threading.Thread(target=Replay(scanned).run, args=(server, stop), kwargs=how)
        sender.start()

        def end():
            stop.set()
            sender.join()
            server.close()

        return server.port, end

    port, end = played()
    arguments = ["--live", f"localhost:{port}", "--lines", sweep[1]]
    with running(tmp_path / "studio", *arguments) as one, one.cookie().events() as socket:
        before = calibrated(socket)
        end()
        gone = heard(socket, "live", within=SLOW_S, connected=False)
        assert gone["recorded"] >= before["recorded"]
        assert gone["expected_mm"] is not None
        _, end = played(port)
        try:
            back = heard(socket, "live", within=SLOW_S, connected=True)
            while back["recorded"] <= gone["recorded"]:
                back = heard(socket, "live", within=SLOW_S)
        finally:
            end()
        assert any("connected again" in sentence for _, sentence in back["said"])


def test_what_was_told_to_be_recorded_outlives_the_studio(sweep, scanned, tmp_path):
    folder = tmp_path / "studio"
    with following(folder, sweep[1], scanned) as one, one.cookie().events() as socket:
        while (told := heard(socket, "live", within=SLOW_S))["recorded"] < 30:
            pass
        one.kill()
    kept = sc.read_recording(folder / "recording.mhd")
    assert len(kept) >= told["recorded"]
    assert kept.frames[told["recorded"] - 1].any()
    arguments = [
        "studio",
        "--live",
        "localhost:1",
        "--lines",
        str(sweep[1]),
        "-o",
        str(folder),
        "--no-browser",
    ]
    with pytest.raises(click.ClickException, match="is of an earlier scan, and stays"):
        main.main(arguments, standalone_mode=False)
    with (
        running(folder, folder / "recording.mhd", "--lines", sweep[1]) as one,
        one.cookie().events() as socket,
    ):
        assert heard(socket, "answer", within=SLOW_S)["fit"]["used"] > 0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--live", "localhost:1"], "say with --lines where it is"),
        (["--until", "1mm"], "--until is for --live"),
        (["--live", "localhost:99999", "--lines", "LINES"], "an address must be HOST:PORT"),
        (["--live", "localhost:1", "--lines", "LINES"], "no OpenIGTLink server answers there"),
        (["SWEEP", "--live", "localhost:1", "--lines", "LINES"], "leave INPUT out"),
    ],
)
def test_a_scan_that_cannot_be_followed_is_refused_in_a_sentence(sweep, tmp_path, arguments, sentence):
    names = {"LINES": str(sweep[1]), "SWEEP": str(sweep[0])}
    words = [names.get(one, one) for one in arguments]
    with pytest.raises(click.ClickException, match=sentence):
        main.main(["studio", *words, "-o", str(tmp_path / "studio"), "--no-browser"], standalone_mode=False)
    assert not (tmp_path / "studio").exists()


def test_a_scan_of_nothing_says_so(sweep, tmp_path):
    with igtl.Server() as server:
        arguments = ["--live", f"localhost:{server.port}", "--lines", sweep[1]]
        with running(tmp_path / "studio", *arguments) as one, one.cookie().events() as socket:
            heard(socket, "live", within=SLOW_S)
            assert one.ask("/live/end", "POST")[0] == 200
            told = heard(socket, "work", within=SLOW_S, phase="refused")
    assert "no image came" in told["refused"]["sentence"]


@pytest.fixture(scope="module")
def chromium():
    with browser() as one:
        yield one


FAR = "#far.use, #far.care, #far.stop"
SEEN_FROM_2_M_PX = 38
"""Ten millimetres at 96 px an inch: three times what is read at that distance with good eyes."""


def test_the_page_follows_a_scan_is_read_from_afar_and_ended_by_keyboard(chromium, sweep, scanned, tmp_path):
    with following(tmp_path / "studio", sweep[1], scanned) as one:
        context = chromium.new_context(viewport={"width": 1280, "height": 900})
        page = Page(context.new_page())
        page.tab.goto(one.address)
        page.tab.wait_for_selector("#frame[data-item]", timeout=SLOW_S * 1000)
        page.tab.wait_for_selector(FAR, timeout=SLOW_S * 1000)
        until(lambda: page.text("#hold"), LONG_S)
        assert page.text("#far-unit") == "mm"
        assert "connected" in page.text("#source")
        size = "parseFloat(getComputedStyle(document.getElementById('far')).fontSize)"
        wider = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        for width in (390, 1280, 2560):
            page.tab.set_viewport_size({"width": width, "height": 900})
            assert 0.7 * page.tab.evaluate(size) >= SEEN_FROM_2_M_PX
            assert page.tab.evaluate(wider) <= 0
        if AXE.exists():
            page.tab.evaluate(AXE.read_text(encoding="utf-8"))
            for scheme in ("light", "dark"):
                page.tab.emulate_media(color_scheme=scheme)
                found = page.tab.evaluate("axe.run()")["violations"]
                assert not [(one["id"], [node["html"] for node in one["nodes"]]) for one in found]
        page.tab.keyboard.press("q")
        page.tab.wait_for_selector("#frame[data-frame]", timeout=SLOW_S * 1000)
        page.tab.wait_for_selector("#drop:visible", timeout=SLOW_S * 1000)
        assert not page.tab.locator("#live:visible").count()
        assert "recording.mhd" in page.text("#what")
        assert all(url.startswith(one.origin) for url in page.requests)
        assert not page.troubles
        context.close()


def test_the_page_says_that_the_scanner_is_gone(chromium, sweep, scanned, tmp_path):
    with served(scanned, rate_hz=15.0) as port:
        began = running(tmp_path / "studio", "--live", f"localhost:{port}", "--lines", sweep[1])
        one = began.__enter__()
        page = Page(chromium.new_page())
        page.tab.goto(one.address)
        page.tab.wait_for_selector("#frame[data-item]", timeout=SLOW_S * 1000)
    try:
        page.tab.wait_for_selector("#banner.stop", timeout=SLOW_S * 1000)
        assert "is lost: waits for it" in page.text("#banner")
        assert "connection lost" in page.text("#source")
        page.tab.close()
    finally:
        began.__exit__(None, None, None)
