"""Messages over loopback, lost or in order, and what they cost; a recording played into a live calibration.

python -m benchmarks.live [--seconds 10] [--frames 400]

Processor time is the receiving process' own: whoever sends runs in another one.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import sonocal as sc
from sonocal import igtl
from sonocal.live import GREETING, Live
from sonocal.recording import Recording
from sonocal.recording.formats import GrowingSequence
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from sonocal.sweep import Session
from sonocal.targets import Line, read_lines

WIDE, HIGH, TOOLS = 820, 616, ("ProbeToTracker", "NeedleToTracker", "StylusToTracker")
# A machine that does much else lets a sender rest for seconds.
QUIET_S, WAIT_S = 5.0, 60.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--frames", type=int, default=400)
    parser.add_argument("--send", nargs=2, type=float, metavar=("HZ", "SECONDS"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.send:
        send(*asked.send)
        return
    print(
        f"one image of {WIDE} x {HIGH} and {len(TOOLS)} transforms a frame, {asked.seconds:g} s on loopback"
    )
    for rate_hz in (60.0, 200.0):
        for name, receive in (("sonocal", ours), ("pyigtl", theirs)):
            print(f"{rate_hz:4g} Hz {name:8}", received(rate_hz, asked.seconds, receive))
    for name, probe in (("500 x 500", None), (f"{WIDE} x {HIGH}", curvilinear(WIDE, HIGH, 0.2))):
        print(f"{asked.frames} frames of {name} played into live:", played(asked.frames, probe))


def send(rate_hz: float, seconds: float) -> None:
    """Serve frames at a rate, from the first client on; says the port, then how many frames were late."""
    chance = np.random.default_rng(0)
    images = [igtl.Image.of(chance.integers(0, 256, (HIGH, WIDE), dtype=np.uint8)) for _ in range(8)]
    pose = igtl.Transform(np.eye(4))
    with igtl.Server() as server:
        print(server.port, flush=True)
        server.wait_for_peer(WAIT_S)
        begin = time.monotonic()
        for i in range(round(rate_hz * seconds)):
            time.sleep(max(0.0, begin + i / rate_hz - time.monotonic()))
            stamp = igtl.stamp_of(1.0 + i)
            server.send(igtl.Message(images[i % len(images)], "Image", stamp))
            for tool in TOOLS:
                server.send(igtl.Message(pose, tool, stamp))
        took = time.monotonic() - begin
        server.flush(WAIT_S)
        print(f"{took:.2f} {sum(peer.dropped for peer in server.peers)}", flush=True)
        sys.stdin.readline()


def received(rate_hz: float, seconds: float, receive: Any) -> str:
    """What of a server's frames arrives, and what that costs."""
    command = [sys.executable, "-m", "benchmarks.live", "--send", str(rate_hz), str(seconds)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as sender:
        assert sender.stdin is not None
        assert sender.stdout is not None
        try:
            begin = time.process_time()
            stamps = receive(int(sender.stdout.readline()))
            spent = time.process_time() - begin
            took, dropped = sender.stdout.readline().split() if stamps is not None else ("0", "0")
        finally:
            sender.stdin.close()
            sender.kill() if stamps is None else sender.wait()
    if stamps is None:
        return "is not installed"
    count = round(rate_hz * seconds)
    images = stamps["Image"]
    order = all(np.all(np.diff(one) > 0) for one in stamps.values())
    poses = min(len(stamps.get(tool, ())) for tool in TOOLS)
    return (
        f"{count - len(images)} of {count} images lost, {count - poses} of the poses of one tool; in order: {order}; "
        f"{spent:.2f} s of processor time (sent within {took} s, {dropped} dropped by the sender)"
    )


def ours(port: int) -> dict[str, list[float]]:
    """Stamps by device, as `igtl.Client` receives them."""
    found: dict[str, list[float]] = {"Image": []}
    with igtl.Client("127.0.0.1", port) as client:
        while not client.received or client.quiet_s < QUIET_S:
            for message in client.take(0.1):
                found.setdefault(message.name, []).append(message.stamp_s)
    return found


def theirs(port: int) -> dict[str, list[float]] | None:
    """The same as pyigtl receives them, asked as often as it can be without keeping a processor busy."""
    try:
        import pyigtl
    except ImportError:
        return None
    found: dict[str, list[float]] = {"Image": []}
    client = pyigtl.OpenIGTLinkClient("127.0.0.1", port)
    try:
        last = time.monotonic() + WAIT_S
        while time.monotonic() < last:
            for message in client.get_latest_messages():
                found.setdefault(message.device_name, []).append(message.timestamp)
                last = time.monotonic() + QUIET_S
            time.sleep(0.001)
    finally:
        client.stop()
    return found


def played(frames: int, probe: Any) -> str:
    """A sweep that ``sonocal replay`` serves, in a live calibration."""
    options = SweepOptions(frames=frames, rate_hz=20.0, seed=4)
    simulated = simulate_sweep(options=options) if probe is None else simulate_sweep(probe, BATH, options)
    with tempfile.TemporaryDirectory() as folder:
        source, lines, _ = write_sweep(simulated, folder)
        command = [sys.executable, "-m", "sonocal", "replay", str(source), "--port", "0", "--rate", "30"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            said = server.stdout.readline()
            port = int(said.partition(" on 127.0.0.1:")[2].partition(",")[0])
            return followed(port, Path(folder), read_lines(lines)[0], frames)


def followed(port: int, folder: Path, lines: tuple[Line, ...], frames: int) -> str:
    """How much of it is paired, whether the end is that of the recording, and what it cost."""
    begin = time.process_time()
    session = Session(lines, stream=GrowingSequence(folder / "recording.mhd"))
    with igtl.Client("127.0.0.1", port, greeting=GREETING) as client, Live(client, session) as running:
        while running.pairing.images < frames and client.quiet_s < WAIT_S:
            time.sleep(0.03)
        found = running.finish()
        state = running.state
    spent_ms = 1e3 * (time.process_time() - begin)
    kept = sc.read_recording(folder / "recording.mhd")
    begin = time.process_time()
    offline = sc.calibrate_recording(kept, lines)
    offline_ms = 1e3 * (time.process_time() - begin)
    apart = np.abs(
        found.calibration.probe_from_image.matrix - offline.calibration.probe_from_image.matrix
    ).max()
    session.close()
    return (
        f"{whole(kept)} of {frames} paired, {state.dropped} dropped, {state.late} late; "
        f"equal to offline to {apart:.1g}; "
        f"{spent_ms / frames:.1f} ms of processor time an image in all, with {state.fits} fits on the way "
        f"(offline {offline_ms / frames:.1f})"
    )


def whole(recording: Recording) -> int:
    """How many images have every pose."""
    valid = [one.valid for one in recording.poses.values()]
    return int(np.all([recording.image_valid, *valid], axis=0).sum())


if __name__ == "__main__":
    main()
