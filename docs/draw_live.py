"""The pictures of docs/live.md: the screen of ``sonocal live`` at some moments of a simulated sweep.

python -m docs.draw_live
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from sonocal.cli.screen.live import screen_of
from sonocal.live import State, ToolSeen
from sonocal.live.answers import Answers
from sonocal.recording import Item, Recording
from sonocal.simulation.sweep import NEEDLE, SweepOptions, simulate_sweep
from sonocal.sweep import Session

PICTURES = Path(__file__).parent / "pictures"
FRAMES, RATE_HZ, UNTIL_MM = 240, 20.0, 1.2
# Images looked into, for each picture: at the begin, on the way, at the end.
MOMENTS = {"live-begin.svg": 30, "live-lost.svg": 90, "live.svg": FRAMES}
COLUMNS = 104
# Fonts are the reader's own: pages fetch nothing.
FETCHED = re.compile(r"@font-face \{.*?\}\n?", re.DOTALL)


def moments() -> Iterator[tuple[str, State]]:
    """A state a picture."""
    recording = simulate_sweep(options=SweepOptions(frames=FRAMES, rate_hz=RATE_HZ, seed=4)).recording
    session = Session([NEEDLE])
    answers = Answers(session)
    names = {count: name for name, count in MOMENTS.items()}
    for count, item in enumerate(items(recording), 1):
        session.stream.add(item)
        while session.look():
            pass
        if session.looked and (session.looked >= 1.25 * answers.fitted or count in names):
            answers.fit()
        if count in names:
            answers.advise(answers.state)
            yield names[count], at(answers.state, session, count)
    session.close()


def items(recording: Recording) -> Iterator[Item]:
    for i, image in enumerate(recording.frames):
        poses = {(one.source, one.target): one.matrices[i] for one in recording.poses.values()}
        yield Item(float(recording.times[i]), poses, image)


def at(state: State, session: Session, count: int) -> State:
    """As it is shown: with what the network would have said."""
    lost = count == MOMENTS["live-lost.svg"]
    tools = (ToolSeen("Probe", "Tracker", True, 1.0), ToolSeen("Needle", "Tracker", not lost, 0.93))
    said = ((4.1, "localhost:18944: the connection ended between messages; connecting again"),)
    said += ((5.0, "localhost:18944: connected again"),)
    return replace(
        state,
        elapsed_s=count / RATE_HZ,
        images=count,
        recorded=count,
        paired=round(0.93 * count),
        looked=session.looked,
        with_candidates=session.seen,
        tools=tools,
        late=2 * lost,
        said=said * lost,
        ended=f"the predicted error is below {UNTIL_MM:g} mm" if count == FRAMES else "",
    )


def drawn(state: State) -> str:
    console = Console(record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True, highlight=False)
    console.print(screen_of(state, until_mm=UNTIL_MM))
    svg = console.export_svg(title="sonocal live", unique_id="live")
    return re.sub(r"[ \t]+$", "", FETCHED.sub("", svg), flags=re.MULTILINE)


def main() -> None:
    for name, state in moments():
        (PICTURES / name).write_text(drawn(state))
        print(name, state.expected_mm)


if __name__ == "__main__":
    main()
