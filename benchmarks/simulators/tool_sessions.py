"""A long recording of several tools, as a lab makes it before a scan: pivots, a spin, touches, a sweep, and what lies.

NumPy and SciPy alone: what judges an estimator shares nothing with it.
"""

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

RATE_HZ = 20.0
TIPS = {
    "Stylus": np.array([12.0, -4.0, -110.0]),
    "Needle": np.array([-18.0, 2.0, -157.0]),
    "Probe": np.array([5.0, 90.0, 10.0]),
}
SHAFT = np.array([-0.05, 0.1, -0.99]) / np.linalg.norm([-0.05, 0.1, -0.99])


@dataclasses.dataclass
class Did:
    """What a tool did from one item to another."""

    tool: str
    kind: str
    first: int
    last: int


@dataclasses.dataclass
class Session:
    """Times (N,), poses (N, 4, 4) by tool with NaN where lost, and what was done."""

    times: np.ndarray
    poses: dict
    did: list
    seats: dict


def session(seed, *, tracker_mm=0.3, tracker_deg=0.05, tremor_mm=0.3, lost=0.1, touches=4):
    """A session in which one tool after another is taken up, used and put down, in any order."""
    rng = np.random.default_rng([seed, 31])
    hands = {tool: _Hand(rng, tool) for tool in TIPS}
    acts = [("Stylus", "pivot"), ("Needle", "pivot"), ("Needle", "spin"), ("both", "sweep")]
    acts += [("Stylus", "touch")] * touches
    for i in rng.permutation(len(acts)):
        tool, kind = acts[i]
        used = ["Needle", "Probe"] if tool == "both" else [tool]
        seconds = {"pivot": (8, 20), "spin": (6, 15), "touch": (1, 6), "sweep": (10, 20)}[kind]
        count = round(RATE_HZ * rng.uniform(*seconds))
        come = round(RATE_HZ * rng.uniform(1.5, 3.0))
        for name, hand in hands.items():
            if name not in used:
                hand.lie(2 * come + count)
                continue
            hand.go(come)
            getattr(hand, kind)(count)
            hand.put_down(come)
        pause = round(RATE_HZ * rng.uniform(1.5, 4.0))
        for hand in hands.values():
            hand.lie(pause)
    return Session(
        np.arange(len(hands["Stylus"].facing)) / RATE_HZ,
        {name: hand.recorded(tracker_mm, tracker_deg, tremor_mm, lost) for name, hand in hands.items()},
        [one for hand in hands.values() for one in hand.did],
        {name: hand.seats for name, hand in hands.items()},
    )


class _Hand:
    """Where a tool's tip is and how it faces, item after item."""

    def __init__(self, rng, tool):
        self.rng, self.tool = rng, tool
        self.home = rng.uniform(-300, 300, 3), Rotation.random(random_state=rng)
        self.here = self.home
        self.tip, self.facing, self.held, self.resting = [], [], [], []
        self.did, self.seats = [], []

    def lie(self, count):
        """It lies where it was put; what lies on goes on."""
        self._note("still", count)
        self._put(np.tile(self.home[0], (count, 1)), [self.home[1]] * count, held=False, resting=True)

    def go(self, count):
        """It is taken up, and carried to where it is used."""
        place = self.home[0] + self.rng.normal(0, 120, 3)
        facing = self.home[1] * Rotation.from_rotvec(self.rng.normal(0, 0.5, 3))
        self._move(count, place, facing)

    def put_down(self, count):
        """It is carried back, to lie nearly as it did."""
        facing = self.home[1] * Rotation.from_rotvec(self.rng.normal(0, 0.3, 3))
        self.home = self.home[0] + self.rng.normal(0, 15, 3), facing
        self._move(count, *self.home)

    def pivot(self, count):
        """Its tip rests and it is tilted to all sides."""
        t = np.arange(count) / RATE_HZ
        size, speed = np.radians(self.rng.uniform(25, 45)), self.rng.uniform(0.8, 1.5)
        turns = size * np.column_stack(
            [np.sin(speed * t), 1 - np.cos(1.3 * speed * t), np.sin(0.7 * speed * t)]
        )
        self._rest("pivot", count, turns * [1.0, 0.5, 0.6])

    def spin(self, count):
        """It is spun about its shaft, to and fro or round and round, the shaft in a guide."""
        t = np.arange(count) / RATE_HZ
        reach = np.radians(self.rng.uniform(70, 170))
        angle = reach * np.sin(2 * np.pi * t / self.rng.uniform(5, 9))
        wobble = _coloured(self.rng, count, np.radians(0.15), 0.5)
        slide = _coloured(self.rng, count, 0.3, 0.5)[:, :1] * SHAFT
        self._rest("spin", count, angle[:, None] * SHAFT + wobble, slide)

    def touch(self, count):
        """Its tip rests, and the hand is not quite still."""
        t = np.arange(count) / RATE_HZ
        size, phase = np.radians(self.rng.uniform(2, 8)), 2 * np.pi * self.rng.uniform(0.2, 0.5) * t
        swing = size * np.column_stack([np.sin(phase), np.sin(0.7 * phase), 0.3 * np.sin(2 * phase)])
        self._rest("touch", count, swing + _coloured(self.rng, count, np.radians(1.5), 0.3))

    def sweep(self, count):
        """It moves and turns all the time."""
        t = np.arange(count) / RATE_HZ
        waves = self.rng.uniform(0.12, 0.3, (3, 6)) * 2 * np.pi
        phases = self.rng.uniform(0, 2 * np.pi, (3, 6))
        paths = np.sin(t[:, None, None] * waves + phases).mean(axis=1) - np.sin(phases).mean(axis=0)
        place, facing = self.here
        self._note("sweep", count)
        self._put(
            place + 50 * paths[:, :3],
            [facing * Rotation.from_rotvec(0.6 * one) for one in paths[:, 3:]],
            held=True,
            resting=False,
        )

    def recorded(self, tracker_mm, tracker_deg, tremor_mm, lost):
        """What the tracker reports of the marker."""
        rng, tip = self.rng, np.vstack(self.tip)
        held, resting = np.concatenate(self.held), np.concatenate(self.resting)
        n = len(tip)
        tip = tip + _coloured(rng, n, tremor_mm, 0.05) * held[:, None]
        tip = tip + _coloured(rng, n, 2.0, 0.1) * (held & ~resting)[:, None]
        facing = Rotation.concatenate(self.facing)
        poses = np.tile(np.eye(4), (n, 1, 1))
        seen = facing * Rotation.from_rotvec(rng.normal(0, np.radians(tracker_deg), (n, 3)))
        poses[:, :3, :3] = seen.as_matrix()
        poses[:, :3, 3] = tip - facing.apply(TIPS[self.tool]) + rng.normal(0, tracker_mm, (n, 3))
        gone = rng.random(n) < lost / 2
        while gone.mean() < lost:
            at = int(rng.integers(0, n))
            gone[at : at + int(rng.integers(2, 12))] = True
        poses[gone] = np.nan
        return poses

    def _rest(self, kind, count, turns, slide=0.0):
        place, facing = self.here
        self.seats.append((kind, place))
        self._note(kind, count)
        turned = facing * Rotation.from_rotvec(turns)
        self._put(place + facing.apply(np.zeros((count, 3)) + slide), list(turned), held=True, resting=True)

    def _move(self, count, place, facing):
        s = np.linspace(0, 1, count, endpoint=False)
        share = s**3 * (10 - 15 * s + 6 * s**2)
        lift = np.sin(np.pi * s)[:, None] ** 2 * self.rng.normal(0, 40, 3)
        way = (self.here[1].inv() * facing).as_rotvec()
        self._put(
            self.here[0] + share[:, None] * (place - self.here[0]) + lift,
            [self.here[1] * Rotation.from_rotvec(a * way) for a in share],
            held=True,
            resting=False,
        )
        self.here = place, facing

    def _put(self, tips, facings, *, held, resting):
        self.tip.append(tips)
        self.facing += facings
        self.held.append(np.full(len(tips), held))
        self.resting.append(np.full(len(tips), resting))
        if len(tips):
            self.here = tips[-1], facings[-1]

    def _note(self, kind, count):
        first = len(self.facing)
        if self.did and kind == "still" == self.did[-1].kind and self.did[-1].last == first - 1:
            self.did[-1].last += count
        else:
            self.did.append(Did(self.tool, kind, first, first + count - 1))


def _coloured(rng, n, deviation, memory_s):
    """(n, 3): a hand's motion, forgotten in so many seconds."""
    from scipy.signal import lfilter

    keep = np.exp(-1 / (RATE_HZ * memory_s))
    drive = rng.normal(0, np.sqrt(1 - keep**2), (n, 3))
    drive[0] = rng.normal(0, 1, 3)
    return deviation * lfilter([1.0], [1.0, -keep], drive, axis=0)
