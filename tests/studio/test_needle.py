"""The first step of the way: a needle from a pivot and a spin, as the command line finds it, taken for the sweep's."""

import json

import click
import numpy as np
import pytest

from sonocal.cli import main
from sonocal.recording.formats import write_recording
from sonocal.simulation.sample import sample_sweep
from tests.builders.pages import write_poses
from tests.builders.studio import heard, running
from tests.builders.studio_page import AXE, Page, browser
from tests.builders.tracked_tools import pivoting, spinning

TIP, AXIS = np.array([0.0, 0.0, -210.0]), np.array([0.0, 0.0, 1.0])
SLOW_S = 240


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A pivot, a spin, and a sweep of the same needle."""
    folder, rng = tmp_path_factory.mktemp("recorded"), np.random.default_rng(5)
    write_poses(folder / "pivot.igs.mha", Needle=pivoting(rng, tip=TIP))
    write_poses(folder / "spin.igs.mha", Needle=spinning(rng, axis=AXIS, point=TIP))
    write_recording(sample_sweep(48).recording, folder / "sweep.igs.mha")
    return folder


def of_the_command(recorded, folder):
    """What ``sonocal tool`` writes of the same."""
    words = [
        "tool",
        recorded / "pivot.igs.mha",
        "--spin",
        recorded / "spin.igs.mha",
        "-o",
        folder / "needle.toml",
    ]
    main.main([str(word) for word in words], standalone_mode=False)
    return (folder / "needle.toml").read_text()


def send(one, path):
    assert one.ask("/inputs", "PUT", path.read_bytes(), X_Name=path.name)[0] == 200


def asked(one, **what):
    status, _, content = one.ask("/tool", "POST", json.dumps(what).encode())
    return status, json.loads(content)


def test_what_is_found_is_what_the_command_line_finds_and_is_taken_for_the_sweep(recorded, tmp_path):
    with running(tmp_path / "studio") as one, one.cookie().events() as socket:
        for name in ("pivot", "spin", "sweep"):
            send(one, recorded / f"{name}.igs.mha")
        assert one.ask("/open", "POST", b'{"source": "sweep.igs.mha"}')[0] == 200
        heard(socket, "answer", within=SLOW_S)
        files = {"pivot": "pivot.igs.mha", "spin": "spin.igs.mha"}
        assert asked(one, tool="Needle", **files) == (200, {})
        told = heard(socket, "tool", within=SLOW_S, phase="found")
        assert told["toml"] == of_the_command(recorded, tmp_path)
        assert np.linalg.norm(np.subtract(told["tip"]["at_mm"], TIP)) < 1
        assert told["level"] == "use"
        assert told["needle"]["length_mm"] == pytest.approx(210, abs=1)
        assert heard(socket, "work", within=SLOW_S, phase="looking")["targets"] == ["needle", "tip"]
        answer = heard(socket, "answer", within=SLOW_S)
        assert answer["verdict"]["level"] in ("use", "care")
        assert all(tip is None for _, tip in answer["crosses"])
        assert any(needle is not None for needle, _ in answer["crosses"])
    assert (tmp_path / "studio" / "inputs" / "needle.toml").read_text() == told["toml"]


def test_the_command_line_names_them_too(recorded, tmp_path):
    parts = ["--pivot", recorded / "pivot.igs.mha", "--spin", recorded / "spin.igs.mha"]
    with (
        running(tmp_path / "studio", recorded / "sweep.igs.mha", *parts) as one,
        one.cookie().events() as socket,
    ):
        heard(socket, "tool", within=SLOW_S, phase="found")
        answer = heard(socket, "answer", within=SLOW_S)
        while "verdict" not in answer:
            answer = heard(socket, "answer", within=SLOW_S)
        assert answer["fit"]["used"] > 20


def test_a_scan_takes_the_needle_that_was_found_and_does_not_look_for_its_tip(recorded, tmp_path):
    of_the_command(recorded, tmp_path)
    scan = ["studio", "--live", "localhost:1", "--lines", str(tmp_path / "needle.toml"), "--no-browser"]
    with pytest.raises(click.ClickException, match="no OpenIGTLink server answers there"):
        main.main([*scan, "-o", str(tmp_path / "studio")], standalone_mode=False)
    with (tmp_path / "needle.toml").open("a") as file:
        file.write('[[point]]\nname = "bead"\nframe = "Needle"\nat_mm = [1.0, 2.0, 3.0]\n')
    with pytest.raises(click.ClickException, match="holds more than needles and wires"):
        main.main([*scan, "-o", str(tmp_path / "studio")], standalone_mode=False)


def test_a_tip_alone_is_told_and_is_no_needle(recorded, tmp_path):
    with running(tmp_path / "studio") as one, one.cookie().events() as socket:
        send(one, recorded / "pivot.igs.mha")
        assert asked(one, tool="Needle", pivot="pivot.igs.mha")[0] == 200
        told = heard(socket, "tool", within=SLOW_S, phase="found")
        assert (told["needle"], told["toml"], told["kept"]) == (None, None, None)
        assert told["tip"]["within_mm"] < 1


@pytest.mark.parametrize(
    ("what", "sentence"),
    [
        ({"tool": "Needle"}, "name a recording of a pivot"),
        ({"tool": "", "pivot": "pivot.igs.mha"}, "what the needle's marker is called"),
        ({"tool": "Stylus", "pivot": "pivot.igs.mha"}, "Stylus"),
        ({"tool": "Needle", "pivot": "/etc/passwd"}, "no such file was sent"),
        ({"tool": "Needle", "pivot": "../spin.igs.mha"}, "no such file was sent"),
        ({"tool": "Needle", "spin": "spin.igs.mha"}, "a spin alone does not tell the needle's length"),
        ({"tool": "Needle", "spin": "spin.igs.mha", "length_mm": -1}, "the shaft's length must be"),
        ({"tool": "Needle", "spin": "spin.igs.mha", "length_mm": "8"}, "the shaft's length must be"),
        ({"tool": "--help", "pivot": "pivot.igs.mha"}, "--help"),
    ],
)
def test_what_cannot_be_found_is_refused_in_a_sentence(sent, what, sentence):
    status, told = asked(sent, **what)
    assert status == 400
    assert sentence in told["refused"]


@pytest.fixture(scope="module")
def sent(recorded, tmp_path_factory):
    with running(tmp_path_factory.mktemp("studio") / "studio") as one:
        one.cookie()
        for name in ("pivot", "spin"):
            send(one, recorded / f"{name}.igs.mha")
        yield one


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (["--tool", "Needle"], "--tool is for --pivot and --spin"),
        (["--pivot", "PIVOT", "--live", "localhost:1", "--lines", "LINES"], "leave one out"),
        (["--pivot", "missing.mha"], "missing.mha"),
    ],
)
def test_options_that_do_not_go_together_are_refused(recorded, sweep, tmp_path, more, sentence):
    names = {"PIVOT": str(recorded / "pivot.igs.mha"), "LINES": str(sweep[1])}
    with pytest.raises(click.ClickException, match=sentence):
        words = [names.get(one, one) for one in more]
        main.main(["studio", *words, "-o", str(tmp_path / "studio"), "--no-browser"], standalone_mode=False)


def test_the_page_leads_from_the_needle_to_the_export(recorded, tmp_path):
    with browser() as chromium, running(tmp_path / "studio") as one:
        context = chromium.new_context(viewport={"width": 1280, "height": 900})
        page = Page(context.new_page())
        page.tab.goto(one.address)

        def step():
            return page.text("#steps li[aria-current]")

        assert step() == "1 needle"
        page.tab.set_input_files("#pivot", str(recorded / "pivot.igs.mha"))
        page.tab.set_input_files("#spin", str(recorded / "spin.igs.mha"))
        page.tab.wait_for_selector("#spin-name:not(:empty)", timeout=SLOW_S * 1000)
        page.tab.wait_for_selector("#pivot-name:not(:empty)", timeout=SLOW_S * 1000)
        page.tab.focus("#find-needle")
        page.tab.keyboard.press("Enter")
        page.tab.wait_for_selector("#tool-result.use", timeout=SLOW_S * 1000)
        assert "tip" in page.text("#tool-result")
        assert step() == "2 sweep"
        if AXE.exists():
            page.tab.evaluate(AXE.read_text(encoding="utf-8"))
            for scheme in ("light", "dark"):
                page.tab.emulate_media(color_scheme=scheme)
                found = page.tab.evaluate("axe.run()")["violations"]
                assert not [(one["id"], [node["html"] for node in one["nodes"]]) for one in found]
        page.tab.set_input_files("#choose", str(recorded / "sweep.igs.mha"))
        page.tab.wait_for_selector("#verdict.use, #verdict.care", timeout=SLOW_S * 1000)
        assert step() == "3 check"
        page.tab.click("#steps li:nth-child(4) button")
        assert page.tab.evaluate("document.activeElement.id") == "export"
        page.tab.keyboard.press("Enter")
        page.tab.wait_for_selector("#files li", timeout=SLOW_S * 1000)
        assert "Exported" in page.text("#path")
        assert not page.troubles
        context.close()
