"""A recording over a socket into a live calibration, whatever happens on the way."""

import threading
import time
from contextlib import closing, contextmanager

from sonocal import igtl
from sonocal.live import GREETING, Live, Pairing, Replay
from sonocal.recording.formats import GrowingSequence
from sonocal.simulation.sweep import NEEDLE, SweepOptions, simulate_sweep
from sonocal.sweep import Session

LONG_S = 60.0


def swept(frames=40, seed=4, **options):
    """A simulated sweep of a needle."""
    return simulate_sweep(options=SweepOptions(frames=frames, seed=seed, **options)).recording


def until(condition, long_s=LONG_S):
    """Wait for it."""
    end = time.monotonic() + long_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.005)


@contextmanager
def live_at(port, folder, *, pairing=None, options=None, **how):
    """A live calibration that records into a folder."""
    stream = GrowingSequence(folder / "recording.mhd")
    session = Session([NEEDLE], stream=stream, **(options or {}))
    with (
        closing(stream),
        igtl.Client("127.0.0.1", port, greeting=GREETING) as client,
        Live(client, session, pairing=pairing or Pairing(), **how) as running,
    ):
        yield running


def played(recording, folder, faults=None, *, rate_hz=400.0, apart=False, **how):
    """A recording played into a live calibration to its end: the calibration, and the last moment."""
    stop = threading.Event()
    with igtl.Server() as server, live_at(server.port, folder, **how) as running:
        Replay(recording, faults, apart=apart).run(server, stop, rate_hz=rate_hz)
        assert server.flush(LONG_S)
        until(lambda: running.client.quiet_s > 0.3)
        found = running.finish()
        return found, running.state


@contextmanager
def served(recording, rate_hz=200.0, **how):
    """A recording that is played over and over: the port."""
    stop = threading.Event()
    with igtl.Server() as server:
        sender = threading.Thread(
            target=Replay(recording).run, args=(server, stop), kwargs={"rate_hz": rate_hz, "loop": True} | how
        )
        sender.start()
        try:
            yield server.port
        finally:
            stop.set()
            sender.join()
