"""The command line on recordings: calibrate, detect, tool, info."""

import gzip
import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.simulators.late import late_scan
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.detection import detect
from sonocal.existing.matrix import slicer_form
from sonocal.export.itk import affine_tfm
from sonocal.observations.velocities import velocities_of
from sonocal.recording import (
    ArrayFrames,
    ImageGeometry,
    Poses,
    Recording,
)
from sonocal.recording.formats import read_recording, write_recording
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear, curvilinear_3d
from sonocal.sweep import tabulate
from sonocal.targets import read_lines
from tests.builders.recordings import (
    random_poses,
    random_recording,
)
from tests.builders.targets import PHANTOM, POINT
from tests.builders.tracked_tools import AXIS, TIP, pivoting, spinning
from tests.builders.trackers import SHAPE, marker_places, vicon_markers


def run(*arguments, width=80):
    return CliRunner(env={"COLUMNS": str(width), "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    sweep = simulate_sweep(
        curvilinear(250, 250, 0.48),
        BATH,
        SweepOptions(frames=80, rate_hz=8, sigma_px=0.5, sigma_mm=0.3, seed=2),
    )
    return sweep, write_sweep(sweep, tmp_path_factory.mktemp("swept"))


@pytest.fixture(scope="module")
def tools(tmp_path_factory):
    """Recordings of a needle: pivots about two of its points, a spin, and what goes wrong."""
    folder = tmp_path_factory.mktemp("tools")
    rng = np.random.default_rng(0)
    slipped = pivoting(rng)
    slipped[120:, :3, 3] += [1.0, 0.5, 0.0]
    made = {
        "pivot": pivoting(rng),
        "spin": spinning(rng),
        "second": pivoting(rng, tip=TIP + 100 * AXIS),
        "little": pivoting(rng, tilt_deg=6.0),
        "slipped": slipped,
        "still": pivoting(rng, n=50, tilt_deg=0.001),
    }
    for name, matrices in made.items():
        write_tracker(folder / f"{name}.igs.mha", Needle=matrices)
    return folder


def write_tracker(path, **tools):
    poses = [Poses.of(tool, "Tracker", matrices) for tool, matrices in tools.items()]
    write_recording(Recording(times=np.arange(len(poses[0])) / 20, poses={p.name: p for p in poses}), path)


def points_csv(sweep, path, noise_px=0.5):
    """The true points with noise, as a hand or another program would give them."""
    frames = np.flatnonzero(sweep.truth.visible)
    points = sweep.truth.points_px[frames] + np.random.default_rng(0).normal(0, noise_px, (len(frames), 2))
    rows = [f"{i},{u!r},{v!r}" for i, (u, v) in zip(frames, points.tolist(), strict=True)]
    path.write_text("\n".join(["frame,u_px,v_px", *rows]) + "\n")
    return path


def calibrated_with_sheet(paths, out):
    """The command's run on a recording and its needle, which writes these files and no others."""
    done = run("calibrate", paths[0], "--lines", paths[1], "-o", out, "--no-report")
    assert done.exit_code == 0, done.output
    assert sorted(p.name for p in out.iterdir()) == [
        "calibration.json",
        "contact-sheet.png",
        "observations.csv",
    ]


def missed(calibration, sweep):
    places = np.array([[0, 0], [249, 0], [0, 249], [249, 249], [125, 125]])
    apart = calibration.probe_from_image @ places - sweep.truth.probe_from_image @ places
    return np.sqrt((apart**2).sum(axis=1).mean())


def test_a_recording_and_a_needle_are_enough(swept, tmp_path):
    sweep, paths = swept
    out = tmp_path / "out"
    calibrated_with_sheet(paths, out)
    found = sc.load(out / "calibration.json")
    assert missed(found, sweep) < 0.6
    recorded = found.provenance["recorded"]
    assert {name: entry["input"] for name, entry in recorded.items()} == {
        "recording": "sweep.igs.mha",
        "lines": "needle.toml",
    }
    assert found.provenance["options"]["centre"] == "head"


def test_the_table_beside_a_calibration_is_its_own_input(swept, tmp_path):
    """Validation knows the rows again, and calibrating from them gives the same."""
    _, paths = swept
    out = tmp_path / "out"
    run("calibrate", paths[0], "--lines", paths[1], "-o", out, "--no-report")
    rows = sc.read_observations(out / "observations.csv")
    found = sc.load(out / "calibration.json")
    assert (found.provenance["input"], found.provenance["sha256"]) == ("observations.csv", rows.sha256)
    again = sc.calibrate(rows, image_size_px=(250, 250))
    np.testing.assert_allclose(again.probe_from_image.matrix, found.probe_from_image.matrix, atol=1e-6)


def test_the_noise_tells_the_threshold_to_the_end_of_every_command(swept, tmp_path):
    """Calibrate, its report and findings, validate, export and info: all with the number that "auto" came to."""
    sweep, paths = swept
    out = tmp_path / "out"
    done = run("calibrate", paths[0], "--lines", paths[1], "--threshold-mm", "auto", "-o", out)
    assert done.exit_code == 0, done.output
    assert sorted(p.name for p in out.iterdir()) == [
        *("calibration.json", "contact-sheet.png", "observations.csv", "report.html")
    ]
    found = sc.load(out / "calibration.json")
    assert missed(found, sweep) < 0.6
    options = found.provenance["options"]
    assert options["threshold_asked"] == "auto"
    assert 0 < options["threshold_mm"] == found.threshold_mm < 5
    assert found.residuals_mm[found.inlier].max() <= found.threshold_mm
    written = (out / "calibration.json", out / "observations.csv")
    for command in (
        ("validate", *written, "-o", out),
        ("export", written[0], "--to", "plus", "-o", out / "plus.xml"),
        ("info", written[0]),
        ("calibrate", written[1], "--threshold-mm", "auto", "--no-report", "-o", tmp_path / "again"),
    ):
        done = run(*command)
        assert done.exit_code == 0, done.output
    again = sc.load(tmp_path / "again" / "calibration.json")
    np.testing.assert_allclose(again.probe_from_image.matrix, found.probe_from_image.matrix, atol=1e-9)
    assert again.threshold_mm == pytest.approx(found.threshold_mm, rel=1e-9)


def test_candidates_of_images_and_their_table_are_one_detection(swept, tmp_path):
    """What detect writes is what calibrate chooses among."""
    sweep, paths = swept
    done = run("detect", paths[0], "--lines", paths[1], "-o", tmp_path / "c.csv")
    assert done.exit_code == 0, done.output
    rows = sc.read_observations(tmp_path / "c.csv")
    assert done.output.startswith(f"Wrote {len(rows)} candidates")
    expected = tabulate(sweep.recording, sweep.lines, detect(read_recording(paths[0]))).observations
    np.testing.assert_array_equal(rows.points_px, expected.points_px)
    np.testing.assert_array_equal(rows.sigma_px, expected.sigma_px)
    np.testing.assert_allclose(rows.segments_mm, expected.segments_mm, atol=1e-6)
    run("calibrate", paths[0], "--lines", paths[1], "-o", tmp_path / "out", "--no-report")
    chosen = sc.read_observations(tmp_path / "out" / "observations.csv")
    candidates = {(f, *p) for f, p in zip(rows.frame.tolist(), rows.points_px.tolist(), strict=True)}
    places = [(f, *p) for f, p in zip(chosen.frame.tolist(), chosen.points_px.tolist(), strict=True)]
    assert np.mean([place in candidates for place in places]) > 0.9  # a second look finds a few more


def test_info_shows_points_as_they_stand_in_their_file(tmp_path):
    (tmp_path / "p.csv").write_text("frame,u_px,v_px,sigma_px,target\n0,10.5,20,0.5,a\n7,1,2,0.25,\n")
    assert json.loads(run("info", tmp_path / "p.csv", "--json").stdout) == {
        "frame": [0, 7],
        "points_px": [[10.5, 20.0], [1.0, 2.0]],
        "target": ["a", ""],
        "sigma_px": [0.5, 0.25],
        "source": "p.csv",
    }


@pytest.mark.parametrize("command", ["calibrate", "detect"])
@pytest.mark.parametrize("option", [("--mask", "mask.png"), ("--centre", "mass")])
def test_what_is_for_images_is_refused_for_volumes_before_anything_is_detected(tmp_path, command, option):
    still = SweepOptions(frames=2, rate_hz=1, seed=2)
    paths = write_sweep(simulate_sweep(curvilinear_3d(32, 3.6), options=still), tmp_path)
    done = run(command, paths[0], "--lines", paths[1], *option, "-o", tmp_path / "out")
    assert done.exit_code == 1
    assert done.stderr == (
        f"Error: sweep.igs.mha: has no 2D images; lines in volumes are found without {option[0]}, leave it out\n"
    )
    assert not (tmp_path / "out").exists()


def test_the_report_of_a_recording_shows_its_frames(swept, tmp_path):
    _, paths = swept
    done = run("calibrate", paths[0], "--lines", paths[1], "-o", tmp_path)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count('class="picture"') == page.count('class="found"') == page.count('class="tracked"') == 12


def test_the_report_of_volumes_shows_the_needle_through_them(tmp_path):
    sweep = simulate_sweep(curvilinear_3d(48, 2.4), options=SweepOptions(frames=20, rate_hz=8, seed=2))
    paths = write_sweep(sweep, tmp_path)
    frames = np.flatnonzero(sweep.truth.visible)
    rows = [f"{i},{u!r},{v!r},{w!r}" for i in frames for u, v, w in sweep.truth.points_px[i].tolist()]
    (tmp_path / "points.csv").write_text("\n".join(["frame,u_px,v_px,w_px", *rows]) + "\n")
    done = run(
        *(
            "calibrate",
            paths[0],
            "--lines",
            paths[1],
            "--points",
            tmp_path / "points.csv",
            "-o",
            tmp_path / "out",
        )
    )
    assert done.exit_code == 0, done.output
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count('class="picture"') == page.count('class="tracked"') == 12
    assert page.count('class="found"') == 24
    assert "carried into the volume" in page


def test_given_points_are_taken_instead_of_detection(swept, tmp_path):
    sweep, paths = swept
    points = points_csv(sweep, tmp_path / "points.csv")
    done = run(
        "calibrate", paths[0], "--lines", paths[1], "--points", points, "-o", tmp_path / "out", "--no-report"
    )
    assert done.exit_code == 0, done.output
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["calibration.json", "observations.csv"]
    found = sc.load(tmp_path / "out" / "calibration.json")
    assert missed(found, sweep) < 0.6
    assert found.provenance["recorded"]["points"]["input"] == "points.csv"
    assert "centre" not in found.provenance["options"]
    np.testing.assert_array_equal(found.area_px, [[0, 0], [249, 249]])


def test_a_real_recording_gives_what_its_table_gives(data_folder, tmp_path):
    """The whole path from PLUS's recording, device set and points equals the path from the finished table."""
    folder = data_folder / "recordings"
    table = sc.read_observations(data_folder / "observations" / "fcal12_ascension.csv").select_split(
        "calibration"
    )
    rows = zip(table.frame, table.target, *table.points_px.T.tolist(), strict=True)
    text = "\n".join(["frame,target,u_px,v_px", *(f"{f},{t},{u!r},{v!r}" for f, t, u, v in rows)])
    (tmp_path / "points.csv").write_text(text)
    done = run(
        *("calibrate", folder / "fCal_Test_Calibration_3NWires.igs.mha"),
        *("--lines", folder / "PlusDeviceSet_fCal_Sim_SpatialCalibration_1.2.xml"),
        *(
            "--points",
            tmp_path / "points.csv",
            "-o",
            tmp_path / "out",
            "--model",
            "anisotropic",
            "--no-report",
        ),
    )
    assert done.exit_code == 0, done.output
    found = sc.load(tmp_path / "out" / "calibration.json")
    expected = sc.calibrate(table, model="anisotropic", image_size_px=(820, 616))
    places = np.array([[0, 0], [819, 0], [0, 615], [819, 615]])
    np.testing.assert_allclose(found.probe_from_image @ places, expected.probe_from_image @ places, atol=2e-3)


def test_a_latency_is_undone_and_kept(tmp_path):
    options = SweepOptions(frames=160, rate_hz=20, sigma_px=0.5, sigma_mm=0.3, seed=2, latency_s=0.1)
    sweep = simulate_sweep(curvilinear(250, 250, 0.48), BATH, options)
    paths = write_sweep(sweep, tmp_path)
    points = points_csv(sweep, tmp_path / "points.csv")
    arguments = ("calibrate", paths[0], "--lines", paths[1], "--points", points, "--no-report")
    run(*arguments, "-o", tmp_path / "right", "--latency", "0.1")
    run(*arguments, "-o", tmp_path / "wrong")
    right, wrong = (sc.load(tmp_path / name / "calibration.json") for name in ("right", "wrong"))
    assert (right.latency_s, wrong.latency_s) == (0.1, None)
    assert missed(right, sweep) < 0.6
    assert right.fit.rms_mm < 0.5 * wrong.fit.rms_mm


def test_a_folder_of_images_and_a_tracker_on_another_clock_are_a_recording(swept, tmp_path):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    sweep, paths = swept
    (tmp_path / "images").mkdir()
    stamps = ["file,time_s"]
    for i, (image, time) in enumerate(
        zip(sweep.recording.frames, sweep.recording.times.tolist(), strict=True)
    ):
        pillow.fromarray(image).save(tmp_path / "images" / f"{i:03d}.png")
        stamps.append(f"{i:03d}.png,{time!r}")
    (tmp_path / "images" / "frames.csv").write_text("\n".join(stamps))
    tracker = Recording(times=sweep.recording.times + 1000, poses=sweep.recording.poses)
    write_recording(tracker, tmp_path / "tracker.igs.mha")
    points = points_csv(sweep, tmp_path / "points.csv")
    common = ("--lines", paths[1], "--points", points, "--no-report", "-o")
    away = run(
        "calibrate", tmp_path / "images", "--poses", tmp_path / "tracker.igs.mha", *common, tmp_path / "a"
    )
    assert away.exit_code == 1
    assert "they do not overlap; bring both to one clock" in away.stderr
    clock = ("--poses", tmp_path / "tracker.igs.mha", "--latency", "1000")
    assert "PLUS sequence metafile" in run("info", tmp_path / "images", *clock).output
    done = run("calibrate", tmp_path / "images", *clock, *common, tmp_path / "a")
    assert done.exit_code == 0, done.output
    run("calibrate", paths[0], *common, tmp_path / "b")
    joined, direct = (sc.load(tmp_path / name / "calibration.json") for name in "ab")
    assert joined.latency_s == 1000
    np.testing.assert_allclose(joined.probe_from_image.matrix, direct.probe_from_image.matrix, atol=1e-6)


def test_a_recording_without_a_visible_needle_is_refused_and_its_contact_sheet_stays(tmp_path):
    hidden = SweepOptions(frames=40, rate_hz=4, hidden_share=1.0)
    paths = write_sweep(simulate_sweep(curvilinear(200, 200, 0.6), options=hidden), tmp_path)
    done = run("calibrate", paths[0], "--lines", paths[1], "-o", tmp_path / "out")
    assert done.exit_code == 1
    assert "candidates in 40 images were tried" in done.stderr
    assert f"Note: {tmp_path / 'out' / 'contact-sheet.png'} shows the candidates" in done.stderr
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["contact-sheet.png"]


def altered(sweep, path, change):
    """The recording with every image changed."""
    frames = np.stack([change(np.asarray(frame)) for frame in sweep.recording.frames])
    channels = frames.shape[3] if frames.ndim == 4 else 1
    image = ImageGeometry(frames.shape[2:0:-1], channels, frames.dtype.name, "MF", np.eye(4))
    write_recording(replace(sweep.recording, frames=ArrayFrames(frames), image=image), path)
    return path


def test_a_threshold_that_any_image_keeps_is_asked_to_be_smaller(swept, tmp_path):
    _, (path, lines, *_) = swept
    done = run("calibrate", path, "--lines", lines, "-o", tmp_path / "out", "--threshold-mm", "1000")
    assert done.exit_code == 1
    assert "so many agree by chance within 1e+03 mm; give a smaller threshold" in done.stderr


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (np.zeros_like, "no candidate was found in 80 images"),
        (lambda image: np.full_like(image, 90), "no candidate was found in 80 images"),
        (lambda image: np.full_like(image, 255), "no candidate was found in 80 images"),
        (
            lambda image: np.random.default_rng(int(image.sum())).integers(0, 255, image.shape, np.uint8),
            "images were tried, and so few agree by chance",
        ),
        (lambda image: image[::20, ::20], "frame 0: detection needs 2D images of 16 px or more a side"),
    ],
    ids=["black", "constant", "white", "noise", "tiny"],
)
def test_images_that_show_nothing_are_refused_in_one_sentence(swept, tmp_path, change, sentence):
    sweep, paths = swept
    path = altered(sweep, tmp_path / "bad.igs.mha", change)
    done = run("calibrate", path, "--lines", paths[1], "-o", tmp_path / "out")
    assert done.exit_code == 1
    error = done.stderr.splitlines()[-1]
    assert error.startswith("Error: bad.igs.mha")
    assert sentence in error


@pytest.mark.parametrize(
    "change",
    [
        lambda image: np.clip(image * 1.5, 0, 255).astype(np.uint8),
        lambda image: image.astype(np.uint16) * 200,
        lambda image: np.repeat(image[..., None], 3, axis=2),
    ],
    ids=["saturated", "16 bit", "colour"],
)
def test_unusual_pixels_give_a_calibration_all_the_same(swept, tmp_path, change):
    sweep, paths = swept
    path = altered(sweep, tmp_path / "odd.igs.mha", change)
    done = run("calibrate", path, "--lines", paths[1], "-o", tmp_path / "out", "--no-report")
    assert done.exit_code == 0, done.output
    assert missed(sc.load(tmp_path / "out" / "calibration.json"), sweep) < 1


def test_volumes_are_calibrated_and_their_contact_sheet_is_written(tmp_path):
    sweep = simulate_sweep(
        curvilinear_3d(64, 1.8),
        options=SweepOptions(frames=30, rate_hz=3, sigma_px=0.1, sigma_mm=0.3, seed=2),
    )
    paths, out = write_sweep(sweep, tmp_path), tmp_path / "out"
    calibrated_with_sheet(paths, out)
    places = np.array([[32, 8, 32], [20, 30, 40], [44, 50, 24]])
    true, found = sweep.truth.probe_from_image, sc.load(out / "calibration.json").probe_from_image
    assert np.linalg.norm(found @ places - true @ places, axis=1).max() < 1.5
    done = run(
        "detect", paths[0], "--lines", paths[1], "-o", tmp_path / "c.csv", "--sheet", tmp_path / "sheet.png"
    )
    assert done.exit_code == 0, done.output
    assert (tmp_path / "sheet.png").read_bytes().startswith(b"\x89PNG")


def test_volumes_without_a_visible_needle_are_refused_and_their_contact_sheet_stays(tmp_path):
    hidden = SweepOptions(frames=12, rate_hz=3, hidden_share=1.0)
    paths = write_sweep(simulate_sweep(curvilinear_3d(48, 2.4), options=hidden), tmp_path)
    done = run("calibrate", paths[0], "--lines", paths[1], "-o", tmp_path / "out")
    assert done.exit_code == 1
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["contact-sheet.png"]


def test_a_mask_says_where_to_look(swept, tmp_path):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    _, paths = swept
    mask = np.zeros((250, 250), dtype=np.uint8)
    mask[:, 125:] = 255
    pillow.fromarray(mask).save(tmp_path / "mask.png")
    arguments = (paths[0], "--lines", paths[1], "-o", tmp_path / "c.csv")
    everywhere = run("detect", *arguments)
    assert everywhere.exit_code == 0, everywhere.output
    assert sc.read_observations(tmp_path / "c.csv").points_px[:, 0].min() < 100
    run("detect", *arguments, "--overwrite", "--mask", tmp_path / "mask.png", "--centre", "mass")
    assert sc.read_observations(tmp_path / "c.csv").points_px[:, 0].min() > 120
    pillow.fromarray(mask[:200]).save(tmp_path / "mask.png")
    done = run("calibrate", *arguments, "--mask", tmp_path / "mask.png")
    assert done.exit_code == 1
    assert done.stderr == (
        "Error: mask.png: is 250 x 200 px where the images are 250 x 250; draw the mask over one of them\n"
    )


@pytest.mark.parametrize(
    ("arguments", "status", "sentence"),
    [
        (
            ["sweep.igs.mha"],
            1,
            "sweep.igs.mha: is a recording; say with --lines which needle or wires were seen in it",
        ),
        (
            ["observations.csv", "--lines", "needle.toml"],
            1,
            "observations.csv: is a table of sightings, which has its lines in it; leave out --lines",
        ),
        (
            ["needle.toml"],
            1,
            "needle.toml: is a file of needles, wires or points; give it with --lines "
            "(in Python: targets.read_lines)",
        ),
        (
            ["observations.csv", "--probe", "P"],
            2,
            "--probe is for recordings; give their needle or wires with --lines",
        ),
        (
            ["sweep.igs.mha", "--lines", "needle.toml", "--fit-split", "a"],
            2,
            "--fit-split is for tables; a recording has no splits",
        ),
        (
            ["sweep.igs.mha", "--lines", "needle.toml", "--points", "p.csv", "--count", "3"],
            2,
            "--count is for detection; with --points nothing is detected",
        ),
    ],
)
def test_what_does_not_go_together_is_said(swept, tmp_path, monkeypatch, arguments, status, sentence):
    _, paths = swept
    monkeypatch.chdir(paths[0].parent)
    (paths[0].parent / "observations.csv").write_text("frame,target,u_px,v_px,x0_mm\n")
    done = run("calibrate", *arguments, "-o", tmp_path / "out")
    assert done.exit_code == status
    assert done.stderr.splitlines()[-1] == f"Error: {sentence}"
    assert not (tmp_path / "out").exists()


def test_what_is_wrong_with_the_recording_is_said_with_the_calibration(swept, tmp_path):
    """Flips and lost poses of the tools that took part; a tool that did not has no say."""
    sweep, paths = swept
    needle = sweep.recording.poses["tracker_from_needle"]
    lost = Poses("Needle", "Tracker", needle.matrices, np.arange(len(needle)) % 4 > 0)
    other = Poses("Stylus", "Tracker", needle.matrices, np.zeros(len(needle), dtype=bool))
    poses = {**sweep.recording.poses, "tracker_from_needle": lost, "tracker_from_stylus": other}
    write_recording(replace(sweep.recording, poses=poses), tmp_path / "a.igs.mha")
    text = (tmp_path / "a.igs.mha").read_bytes().replace(b"Orientation = MF", b"Orientation = UN", 1)
    (tmp_path / "a.igs.mha").write_bytes(text)
    points = points_csv(sweep, tmp_path / "points.csv")
    done = run(
        *("calibrate", tmp_path / "a.igs.mha", "--lines", paths[1], "--points", points),
        *("-o", tmp_path / "out", "--no-report"),
    )
    assert done.exit_code == 0, done.output
    found = {d.code: d.message for d in sc.load(tmp_path / "out" / "calibration.json").diagnostics}
    assert "orientation-changed" in found
    assert found["invalid-poses"].startswith("NeedleToTracker: 20 of 80 poses are invalid (25 %)")
    assert "no-pose" in found


def test_pivot_and_spin_make_a_needle_file(tools, tmp_path):
    done = run(
        "tool", tools / "pivot.igs.mha", "--spin", tools / "spin.igs.mha", "-o", tmp_path / "needle.toml"
    )
    assert done.exit_code == 0, done.output
    assert done.output.startswith("Sound: expect the tip to +-0.")
    (line,), _ = read_lines(tmp_path / "needle.toml")
    assert (line.name, line.frame) == ("needle", "Needle")
    tip, back = line.segment_mm
    assert np.linalg.norm(tip - TIP) < 0.2
    along = (back - tip) / np.linalg.norm(back - tip)
    assert np.degrees(np.arcsin(np.linalg.norm(np.cross(along, AXIS)))) < 0.2
    # To where the shaft passes its marker, unless a length is given.
    assert abs(back @ AXIS) < 0.5
    run(
        *(
            "tool",
            tools / "pivot.igs.mha",
            "--spin",
            tools / "spin.igs.mha",
            "--length",
            "120",
            "--name",
            "rod",
        ),
        *("-o", tmp_path / "needle.toml", "--overwrite"),
    )
    (line,), _ = read_lines(tmp_path / "needle.toml")
    assert line.name == "rod"
    assert np.linalg.norm(np.diff(line.segment_mm, axis=0)) == pytest.approx(120)


def test_two_pivots_make_a_needle_and_a_spin_alone_its_line(tools, tmp_path):
    done = run("tool", tools / "pivot.igs.mha", "--second", tools / "second.igs.mha", "--json")
    record = json.loads(done.stdout)
    tip, second = np.array(record["needle"]["line"]["segment_mm"])
    np.testing.assert_allclose([tip, second], [TIP, TIP + 100 * AXIS], atol=0.2)
    assert len(record["points"]) == 2
    done = run("tool", "--spin", tools / "spin.igs.mha", "--length", "80", "-o", tmp_path / "a.toml")
    assert done.exit_code == 0, done.output
    (line,), _ = read_lines(tmp_path / "a.toml")
    off = np.cross(line.segment_mm - TIP, AXIS)
    assert np.abs(off).max() < 0.5


def test_a_stylus_and_two_touches_make_a_needle(tools, tmp_path):
    """The stylus' own pivot gives its tip; one recording holds both touches."""
    rng = np.random.default_rng(3)
    run("tool", tools / "pivot.igs.mha", "-o", tmp_path / "tip.toml")
    text = (tmp_path / "tip.toml").read_text().replace('"Needle"', '"Stylus"')
    (tmp_path / "stylus.toml").write_text(text)
    targets = np.array([[5.0, -3.0, -20.0], [6.0, -2.0, -140.0]])
    stylus = pivoting(rng, n=60, noise_mm=0.05)
    here = np.where(np.arange(60) < 30, 0, 1)
    stylus[:, :3, 3] += targets[here] - [100, -50, -1000]
    needle = np.tile(np.eye(4), (60, 1, 1))
    write_tracker(tmp_path / "touch.igs.mha", Needle=needle, Stylus=stylus)
    done = run(
        *("tool", tmp_path / "touch.igs.mha", "--frames", "0:29", "--second-frames", "30:59"),
        *("--stylus", "Stylus", "--stylus-tip", tmp_path / "stylus.toml", "-o", tmp_path / "needle.toml"),
    )
    assert done.exit_code == 0, done.output
    (line,), _ = read_lines(tmp_path / "needle.toml")
    np.testing.assert_allclose(line.segment_mm, targets, atol=0.2)
    whole = run("tool", tmp_path / "touch.igs.mha", "--stylus", "Stylus", "--stylus-tip", "-18,2,-157")
    assert whole.exit_code == 1
    assert "the stylus tip moved by" in whole.stderr


def test_a_divot_on_a_moving_marker_needs_its_name(tmp_path):
    rng = np.random.default_rng(4)
    reference = random_poses(rng, 200)
    write_tracker(tmp_path / "a.igs.mha", Needle=reference @ pivoting(rng), Reference=reference)
    assert "poses share a tip within" in run("tool", tmp_path / "a.igs.mha").stderr
    found = json.loads(run("tool", tmp_path / "a.igs.mha", "--reference", "Reference", "--json").stdout)
    np.testing.assert_allclose(found["points"][0]["tip_mm"], TIP, atol=0.2)


def test_poses_that_are_not_rigid_are_refused_or_skipped(tools, tmp_path):
    matrices = pivoting(np.random.default_rng(5))
    matrices[17, :3, :3] *= 1.1
    write_tracker(tmp_path / "a.igs.mha", Needle=matrices)
    refused = run("tool", tmp_path / "a.igs.mha")
    assert refused.stderr == (
        "Error: a.igs.mha, frame 17: NeedleToTracker is not rigid (det R = 1.33); "
        "drop such frames with --on-invalid skip\n"
    )
    found = json.loads(run("tool", tmp_path / "a.igs.mha", "--on-invalid", "skip", "--json").stdout)
    assert found["points"][0]["inlier"].count(False) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["little.igs.mha"],
            ["warning little-tilt", "tilted by 5.2 deg rms", "known to +-0.", "Use with care"],
        ),
        (["slipped.igs.mha"], ["warning slipped-tip", " mm apart in different thirds", "Use with care"]),
    ],
)
def test_a_doubtful_tool_comes_with_a_warning_first(tools, arguments, words):
    done = run("tool", *(tools / name for name in arguments), width=200)
    assert done.exit_code == 0
    assert done.output.startswith("warning ")
    for word in words:
        assert word in done.output


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["still.igs.mha"], 1, "still.igs.mha: the tool hardly turned (0.00 deg rms), so any tip fits"),
        (["spin.igs.mha"], 1, "spin.igs.mha: the tool turned about one axis only"),
        (
            ["--spin", "pivot.igs.mha", "--length", "9"],
            1,
            "pivot.igs.mha: the tool turned about more than one axis",
        ),
        (
            ["--spin", "spin.igs.mha"],
            1,
            "a spin alone does not tell the needle's length; give it with --length",
        ),
        (
            ["pivot.igs.mha", "--tool", "Nadel"],
            1,
            "has no transforms of Nadel; the transforms in it are NeedleToTracker",
        ),
        (
            ["pivot.igs.mha", "--frames", "300:400"],
            1,
            "pivot.igs.mha: has frames 0 to 199, none of which is in the range",
        ),
        (["pivot.igs.mha", "--frames", "all"], 2, "'all' is not a range of frames such as 0:250"),
        (["pivot.igs.mha", "--stylus", "Stylus"], 2, "--stylus and --stylus-tip go together"),
        ([], 2, "Missing argument 'RECORDING'; give it, or --spin."),
    ],
)
def test_what_cannot_be_a_tool_is_refused_and_nothing_is_written(
    tools, tmp_path, monkeypatch, arguments, status, words
):
    monkeypatch.chdir(tools)
    done = run("tool", *arguments, "-o", tmp_path / "needle.toml")
    assert done.exit_code == status
    assert words in done.stderr
    assert not (tmp_path / "needle.toml").exists()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """One file of every kind, and words that info must show of it."""
    folder = tmp_path_factory.mktemp("files")
    write_recording(random_recording(0, orientation="MN"), folder / "a.igs.mha")
    flipped = (folder / "a.igs.mha").read_bytes().replace(b"Orientation = MFA", b"Orientation = MN ", 1)
    (folder / "a.igs.mha").write_bytes(flipped)
    write_recording(random_recording(0, size=None), folder / "tracker.igs.mha")
    (folder / "poses.csv").write_text(
        "t,Probe_qw,Probe_qx,Probe_qy,Probe_qz,Probe_x,Probe_y,Probe_z\n" + "0,1,0,0,0,1,2,3\n"
    )
    (folder / "needle.toml").write_text(
        '[[line]]\nname = "n"\nframe = "Needle"\nfrom_mm = [0, 0, 0]\nto_mm = [3, 4, 0]\n'
    )
    (folder / "stylus.toml").write_text(POINT)
    (folder / "devices.xml").write_text(PHANTOM)
    (folder / "points.csv").write_text("frame,u_px,v_px\n0,1,2\n")
    (folder / "wire.csv").write_text("u_px,v_px,x_mm,y_mm,z_mm\n1,2,3,4,5\n")
    return folder


SHOWN = {
    "a.igs.mha": [
        "PLUS sequence metafile",
        "7 x 4 px",
        "flipped to MF",
        "ProbeToTracker",
        "note orientation-changed",
    ],
    "tracker.igs.mha": ["No images: a tracker alone.", "NeedleToTracker"],
    "poses.csv": ["CSV of poses", "ProbeToTracker"],
    "needle.toml": ["needles and wires", "5.0"],
    "stylus.toml": ["points", "0.00, 0.50, -150.00"],
    "devices.xml": ["PLUS device set", "PhantomToReference"],
    "points.csv": ["points found in images"],
    "wire.csv": ["With places."],
}


@pytest.mark.parametrize("name", SHOWN)
@pytest.mark.parametrize("width", [80, 200])
def test_info_fits_the_terminal_and_says_what_there_is(files, name, width):
    done = run("info", files / name, width=width)
    assert done.exit_code == 0, done.output
    for words in SHOWN[name]:
        assert words in done.output
    assert max(map(len, done.output.splitlines())) <= width
    assert "…" not in done.output
    assert json.loads(run("info", files / name, "--json").stdout)


def test_info_says_what_is_wrong_first(tmp_path):
    good = random_recording(0, n=40)
    pixels = np.stack(list(good.frames))
    frozen = ArrayFrames(pixels[np.minimum(np.arange(40), 20)])
    stuck = Poses.of("Probe", "Tracker", np.repeat(good.poses["tracker_from_probe"].matrices[:1], 40, axis=0))
    times = np.arange(40) / 20 + np.where(np.arange(40) > 30, 2.0, 0.0)
    bad = replace(
        good,
        frames=frozen,
        poses={**good.poses, stuck.name: stuck},
        times=times,
        image=ImageGeometry.of(frozen),
    )
    write_recording(bad, tmp_path / "a.igs.mha")
    done = run("info", tmp_path / "a.igs.mha", width=200)
    assert done.output.startswith("warning gaps\n  1 gap is longer than 4 usual intervals of 50 ms")
    for code in (
        "warning invalid-poses",
        "warning frozen-images",
        "note static-tool",
        "note orientation-unknown",
    ):
        assert code in done.output
    quick = json.loads(run("info", tmp_path / "a.igs.mha", "--quick", "--json").stdout)
    assert "frozen-images" not in [d["code"] for d in quick["diagnostics"]]
    assert [(t["name"], t["poses"]) for t in quick["tools"]] == [
        ("ProbeToTracker", 40),
        ("NeedleToTracker", 40),
    ]


def test_a_tip_is_compared_with_where_it_was_said_to_be(tools, tmp_path):
    """Three numbers, our own file, PLUS's StylusTipToStylus and 3D Slicer's transform are one place."""
    place = np.eye(4)
    place[:3, 3] = TIP + np.array([3.0, 0.0, 4.0])
    row = " ".join(map(repr, map(float, place.ravel())))
    (tmp_path / "plus.xml").write_text(
        '<PlusConfiguration><CoordinateDefinitions><Transform From="StylusTip" To="Needle" '
        f'Matrix="{row}"/></CoordinateDefinitions></PlusConfiguration>'
    )
    (tmp_path / "tip.tfm").write_bytes(affine_tfm(slicer_form(place), "", ""))
    (tmp_path / "tip.toml").write_text(
        POINT.replace("Stylus", "Needle").replace("0.0, 0.5, -150", ", ".join(map(str, place[:3, 3])))
    )
    said = [
        ",".join(map(repr, place[:3, 3].tolist())),
        *(tmp_path / name for name in ("plus.xml", "tip.tfm", "tip.toml")),
    ]
    for one in said:
        done = run("tool", tools / "pivot.igs.mha", "--tool", "Needle", f"--expected={one}", "--json")
        assert done.exit_code == 0, done.output
        found = json.loads(done.stdout)["expected"]
        assert found["distance_mm"] == pytest.approx(5.0, abs=0.3)
        assert found["sentence"].endswith("more than that leaves open.")
        shown = run("tool", tools / "pivot.igs.mha", "--tool", "Needle", f"--expected={one}")
        assert found["sentence"] in " ".join(shown.output.split())
    (tmp_path / "plus.xml").write_text(
        (tmp_path / "plus.xml").read_text().replace('To="Needle"', 'To="Pointer"')
    )
    refused = run("tool", tools / "pivot.igs.mha", "--tool", "Needle", "--expected", tmp_path / "plus.xml")
    assert refused.exit_code == 1
    assert (
        "has 0 transforms of a tip to Needle where it must have one, such as NeedleTipToNeedle"
        in refused.output
    )
    alone = run(
        "tool", "--spin", tools / "spin.igs.mha", "--tool", "Needle", "--length", "100", "--expected=1,2,3"
    )
    assert alone.exit_code == 1
    assert "has no tip to compare with --expected" in alone.output


def test_info_joins_several_files_of_poses_and_says_how_times_were_read(tmp_path):
    for name in ("Probe", "Needle"):
        rows = [f"{1_700_000_000_000 + 50 * i},1,0,0,0,{i},0,0" for i in range(20)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["Timestamp,qw,qx,qy,qz,x,y,z", *rows]))
    done = run("info", tmp_path / "Probe.csv", "--poses", tmp_path / "Needle.csv", width=200)
    assert done.exit_code == 0, done.output
    for words in (
        "ProbeToTracker",
        "NeedleToTracker",
        "20.0 a second",
        "Timestamp was read as milliseconds, since",
    ):
        assert words in done.output


def test_angles_and_markers_are_told_on_the_command_line(tmp_path):
    (tmp_path / "Probe.csv").write_text("t,rx_deg,ry_deg,rz_deg,x,y,z\n0,10,20,30,1,2,3\n1,0,0,0,1,2,3\n")
    refused = run("info", tmp_path / "Probe.csv")
    assert refused.exit_code == 1
    assert "with --angles: ZYX or another order of axes" in refused.stderr
    assert run("info", tmp_path / "Probe.csv", "--angles", "ZYX").exit_code == 0
    labels = "abcd"
    places = marker_places(random_poses(np.random.default_rng(0), 12))
    (tmp_path / "markers.csv").write_text(vicon_markers(places, labels))
    assert "or say with --markers which are of one tool" in run("info", tmp_path / "markers.csv").stderr
    points = [
        f'[[point]]\nname = "{label}"\nframe = "Probe"\nat_mm = {place.tolist()}\n'
        for label, place in zip(labels, SHAPE, strict=True)
    ]
    (tmp_path / "points.toml").write_text("\n".join(points))
    done = run("info", tmp_path / "markers.csv", "--markers", tmp_path / "points.toml", width=200)
    assert done.exit_code == 0, done.output
    assert "4 markers were fitted to the model given, 0.00 mm" in done.output
    wrong = run("info", tmp_path / "markers.csv", "--markers", tmp_path / "markers.csv")
    assert "name a file of points (.toml), each a marker in its tool's frame" in wrong.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("calibrate", "needle.toml", "--lines", "Probe.csv"),
            "needle.toml: is a file of needles, wires or points; give it with --lines",
        ),
        (
            ("info", "Probe.csv", "--poses", "needle.toml"),
            "needle.toml: is a file of needles, wires or points; name",
        ),
        (
            ("tool", "needle.toml"),
            "needle.toml: is a file of needles, wires or points; give it with --lines",
        ),
        (
            ("info", "needle.toml", "--poses", "Probe.csv"),
            "--poses is for recordings, and needle.toml is none",
        ),
        (("info", "packed.csv"), "packed.csv: is compressed (gzip); unpack it first"),
        (
            ("calibrate", "Probe.csv", "--lines", "packed.csv"),
            "packed.csv: is compressed (gzip); unpack it first",
        ),
        (("calibrate", "packed.csv"), "packed.csv: is compressed (gzip); unpack it first"),
    ],
)
def test_files_in_each_others_place_and_packed_ones_are_called_what_they_are(
    tmp_path, monkeypatch, arguments, words
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "needle.toml").write_text(POINT)
    (tmp_path / "Probe.csv").write_text("t,qw,qx,qy,qz,x,y,z\n0,1,0,0,0,1,2,3\n")
    (tmp_path / "packed.csv").write_bytes(gzip.compress((tmp_path / "Probe.csv").read_bytes()))
    done = run(*arguments)
    assert done.exit_code in (1, 2)
    assert words in " ".join(done.stderr.split())


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """A table with times of a needle that is late by 130 ms."""
    folder = tmp_path_factory.mktemp("late")
    sc.write_observations(late_scan(2, "usual", 0.13, frames=300).observations, folder / "late.csv")
    return folder / "late.csv"


def test_a_table_s_lag_is_told_and_its_moved_rows_are_written(late, tmp_path):
    done = run("calibrate", late, "--latency", "estimate", "-o", tmp_path / "out", width=200)
    assert done.exit_code == 0, done.output
    assert "Lag: the tracker's stamps are 1" in done.stdout
    assert "ms, 95 %), estimated with the calibration; undone." in done.stdout
    record = json.loads((tmp_path / "out" / "calibration.json").read_text())
    low, high = record["latency_interval_s"]
    assert low < 0.13 < high
    assert record["provenance"]["input"] == "observations.csv"
    assert record["provenance"]["recorded"]["table"]["input"] == "late.csv"
    assert "estimated with the calibration" in (tmp_path / "out" / "report.html").read_text()
    moved = tmp_path / "out" / "observations.csv"
    again = run(
        "calibrate", moved, "--latency", "estimate", "--json", "--no-report", "-o", tmp_path / "again"
    )
    assert again.exit_code == 0, again.output
    low, high = json.loads(again.stdout)["latency_interval_s"]
    assert low < 0 < high


def test_a_latency_in_seconds_is_for_recordings_and_no_word_but_estimate_is_known(late):
    assert "--latency is for recordings" in run("calibrate", late, "--latency", "0.13").stderr
    refused = run("calibrate", late, "--latency", "guess")
    assert refused.exit_code == 2
    assert "'guess' is neither a number of seconds nor estimate" in refused.stderr


def test_detected_candidates_have_the_velocities_of_their_needles(swept, tmp_path):
    _, (recording, lines, *_) = swept
    done = run("detect", recording, "--lines", lines, "-o", tmp_path / "few.csv", "--count", 1)
    assert done.exit_code == 0, done.output
    assert np.isfinite(velocities_of(sc.read_observations(tmp_path / "few.csv"))).any()
