"""A calibration while one scans: a session that a server feeds; and a recording that is served as PLUS would."""

from sonocal.live.answers import Advice
from sonocal.live.guide import Guide
from sonocal.live.live import GREETING, Live
from sonocal.live.pairing import Pairing
from sonocal.live.replay import Faults, Replay
from sonocal.live.state import LagSoFar, State, ToolSeen

__all__ = [
    "GREETING",
    "Advice",
    "Faults",
    "Guide",
    "LagSoFar",
    "Live",
    "Pairing",
    "Replay",
    "State",
    "ToolSeen",
]
