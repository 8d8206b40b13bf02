"""Labels of wires that nobody names: how often they are found, called ambiguous, or wrong, and in what time.

Real tables have their labels hidden, dots removed and added, images mirrored; simulated phantoms have known truth; and
where nothing is right (wires displaced, poses shuffled, another phantom, noise) every answer is a wrong one. Thresholds
were found on seeds below 1000.

python -m benchmarks.association [--rows real phantoms volumes needles wrong symmetric rolled] [--seeds 20]
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from pathlib import Path

import numpy as np

import sonocal as sc
from benchmarks.simulators import phantoms
from benchmarks.simulators.phantoms import Dots, spoilt
from sonocal import registration as reg

DATA = Path(__file__).parents[2] / "shared" / "data" / "observations"
TABLES = ("depth15_polaris", "fcal12_ascension", "trus_3nwires")
# (frames, removed, false): what is done to real tables.
REAL = ((5, 0.3, 1.0), (20, 0.3, 1.0), (100, 0.3, 1.0), (20, 0.6, 1.0), (2, 0.0, 0.0))
# Of dots that are given a label: more wrong ones, and the answer is wrong.
MOST_WRONG = 0.05
VOLUME_KINDS = (
    "3 random wires",
    "6 random wires",
    "9 random wires",
    "three N, 10 mm apart",
    "parallel planes",
)
# Hypotheses are the limit here, so that another's work on the machine changes no count.
LIMIT_S = 600.0
MOST = {"hypotheses": 3_000_000}
# Poses of other frames are wrong ones where wires are that far from where they were.
MOVED_MM = 5.0


def real(name: str) -> Dots:
    """A real table's calibration rows, of frames in which every wire was seen."""
    table = sc.read_observations(DATA / f"{name}.csv")
    table = table.select(np.flatnonzero(table.split == "calibration"))
    names, code = np.unique(table.target, return_inverse=True)
    frames, frame = np.unique(table.frame, return_inverse=True)
    wires = np.full((len(frames), len(names), 2, 3), np.nan)
    wires[frame, code] = table.segments_mm
    whole = np.isfinite(wires).all(axis=(1, 2, 3))
    keep = whole[frame]
    return Dots(table.points_px[keep], (np.cumsum(whole) - 1)[frame[keep]], code[keep], wires[whole])


def some_frames(rng: np.random.Generator, dots: Dots, count: int, mirror: int) -> Dots:
    """Frames drawn at random; images mirrored along u (1), v (2) or both (3)."""
    chosen = np.sort(rng.choice(len(dots.wires), min(count, len(dots.wires)), replace=False))
    keep = np.isin(dots.frame, chosen)
    points = dots.points[keep] * [1 - 2 * (mirror & 1), 1 - (mirror & 2)] + 1000.0
    return Dots(points, np.searchsorted(chosen, dots.frame[keep]), dots.truth[keep], dots.wires[chosen])


def outcome(dots: Dots, seed: int) -> tuple[str, float]:
    """What became of one set, and processor time, s."""
    begin = time.process_time()
    most = MOST["hypotheses"]
    found = reg.associate(
        dots.points, dots.wires, frame=dots.frame, seed=seed, time_limit_s=LIMIT_S, max_hypotheses=most
    )
    seconds = time.process_time() - begin
    given = found.labels >= 0
    wrong = np.count_nonzero(given & (dots.truth >= 0) & (found.labels != dots.truth))
    if found.verdict == "found":
        return ("right" if wrong <= MOST_WRONG * given.sum() else "WRONG"), seconds
    return found.verdict, seconds


def line(name: str, results: list[tuple[str, float]]) -> None:
    """Print a row of the table."""
    counts, seconds = Counter(one for one, _ in results), [one for _, one in results]
    names = ("right", "ambiguous", "unfinished", "nothing fits", "WRONG")
    middle, late = np.quantile(seconds, [0.5, 0.95])
    print(
        f"| {name} | " + " | ".join(str(counts[one]) for one in names) + f" | {middle:.2f} | {late:.2f} |",
        flush=True,
    )


def real_rows(seeds: range) -> None:
    """Real tables with hidden labels."""
    for name in TABLES:
        table = real(name)
        for frames, removed, false in REAL:
            results = []
            for seed in seeds:
                rng = np.random.default_rng(seed)
                some = some_frames(rng, table, frames, seed % 4)
                results.append(outcome(spoilt(rng, some, removed, false), seed))
            line(f"{name}, {frames} frames, {removed:.0%} removed, {false:.0%} false", results)


def phantom_rows(seeds: range) -> None:
    """Simulated phantoms of thirteen kinds."""
    for name, make in phantoms.KINDS.items():
        results = []
        for seed in seeds:
            rng = np.random.default_rng(seed)
            dots = phantoms.scan(rng, make(rng), 20)
            results.append(outcome(spoilt(rng, dots, 0.1, 0.2), seed))
        line(f"{name}, 20 frames", results)


def volume_rows(seeds: range) -> None:
    """Lines in volumes of a 3D probe; and where nothing is right."""
    kinds = {name: phantoms.KINDS[name] for name in VOLUME_KINDS}
    for name, make in kinds.items():
        for frames in (2, 5, 20):
            results = []
            for seed in seeds:
                rng = np.random.default_rng(seed)
                dots = phantoms.scan_volumes(rng, make(rng), frames)
                results.append(outcome(spoilt(rng, dots, 0.2, 0.5), seed))
            line(f"volumes: {name}, {frames} frames", results)
    results = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        along = {"turn_rad": 0.002, "shift_mm": (0.3, 0.3, 20.0)}
        results.append(outcome(phantoms.scan_volumes(rng, phantoms.symmetric(rng), 20, **along), seed))
    line("volumes: six parallel wires of a hexagon, along them", results)
    for what in ("wires displaced by 6 mm", "poses shuffled", "noise"):
        results = []
        for seed in seeds:
            rng = np.random.default_rng(seed)
            dots = phantoms.scan_volumes(rng, phantoms.random_wires(rng, 6), 20)
            results.append(refused(WRONG[what](rng, dots), seed))
        line(f"volumes: six random wires: {what}", results)


def needle_rows(seeds: range) -> None:
    """Needles that move one without the other, and one among wires; images and volumes."""
    for volumes in (False, True):
        for count, wires in ((2, 0), (3, 0), (1, 6)):
            for frames in (10, 20):
                results = []
                for seed in seeds:
                    rng = np.random.default_rng(seed)
                    beside = phantoms.random_wires(rng, wires) if wires else None
                    dots = phantoms.scan_needles(rng, count, frames, volumes=volumes, wires=beside)
                    results.append(outcome(spoilt(rng, dots, 0.1, 0.5), seed))
                what = f"{count} needles" if not wires else f"a needle among {wires} wires"
                line(f"{'volumes' if volumes else 'images'}: {what}, {frames} frames", results)


def symmetric_rows(seeds: range) -> None:
    """A phantom that is all alike when it is turned, scanned along its wires."""
    results = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        dots = phantoms.scan(rng, phantoms.symmetric(rng), 20, turn_rad=0.002, shift_mm=(0.3, 0.3, 20.0))
        results.append(outcome(dots, seed))
    line("six parallel wires of a hexagon, along them", results)


def displaced(rng: np.random.Generator, dots: Dots) -> Dots:
    """Every wire 6 mm from where it is said to be, in a direction of its own."""
    # In the phantom's frame: that of the first frame, from which the others are rigid motions of the same wires.
    base = dots.wires[0]
    away = rng.normal(size=(len(base), 3))
    moved = base + 6.0 * (away / np.linalg.norm(away, axis=1, keepdims=True))[:, None]
    return Dots(
        dots.points, dots.frame, dots.truth, np.stack([_carried(base, one, moved) for one in dots.wires])
    )


def _carried(base: np.ndarray, here: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """`moved` by the rigid motion that carries `base` to `here`."""
    x, y = base.reshape(-1, 3), here.reshape(-1, 3)
    u, _, vt = np.linalg.svd((x - x.mean(axis=0)).T @ (y - y.mean(axis=0)))
    turn = vt.T @ np.diag([1, 1, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T
    return (moved - x.mean(axis=0)) @ turn.T + y.mean(axis=0)


def wrong_rows(seeds: range) -> None:
    """Where nothing is right: real tables and a simulated phantom."""
    for name in (*TABLES[:2], "nine random wires"):
        results: dict[str, list[tuple[str, float]]] = {}
        for seed in seeds:
            rng = np.random.default_rng(seed)
            if name in TABLES:
                dots = some_frames(rng, real(name), 20, seed % 4)
            else:
                dots = phantoms.scan(rng, phantoms.random_wires(rng, 9), 20)
            for what, spoil in WRONG.items():
                results.setdefault(what, []).append(refused(spoil(rng, dots), seed))
        for what, each in results.items():
            line(f"{name}: {what}", each)


def rolled_rows(seeds: range) -> None:
    """Poses of the next frame, of ordered frames in a row: what is found is held against the true labels."""
    for name in TABLES:
        table = real(name)
        for step in (1, 4):
            results = []
            for seed in seeds:
                rng = np.random.default_rng(seed)
                begin = int(rng.integers(0, max(1, len(table.wires) - 20 * step)))
                results.append(outcome(rolled(rng, _row(table, begin, step)), seed))
            line(f"{name}, 20 frames, each {step} after the last, poses of the next one", results)


def _row(dots: Dots, begin: int, step: int) -> Dots:
    chosen = np.arange(begin, len(dots.wires), step)[:20]
    keep = np.isin(dots.frame, chosen)
    return Dots(
        dots.points[keep], np.searchsorted(chosen, dots.frame[keep]), dots.truth[keep], dots.wires[chosen]
    )


def refused(dots: Dots, seed: int) -> tuple[str, float]:
    """As `outcome`, where every answer is wrong."""
    verdict, seconds = outcome(
        Dots(dots.points, dots.frame, np.full(len(dots.points), 10**6), dots.wires), seed
    )
    return verdict, seconds


def shuffled(rng: np.random.Generator, dots: Dots) -> Dots:
    """Poses of other frames; none of one that is so near that its labels are right, as where a hand rests."""
    tries = [rng.permutation(len(dots.wires)) for _ in range(200)]
    order = max(tries, key=lambda one: _moved(dots.wires, dots.wires[one]).min())
    moved = _moved(dots.wires, dots.wires[order])
    # Of a scan that hardly moves the half that does most.
    return _without(dots, moved < min(MOVED_MM, float(np.median(moved))), dots.wires[order])


def rolled(rng: np.random.Generator, dots: Dots) -> Dots:
    """Poses of the next frame: where that is near, labels are right all the same."""
    return Dots(dots.points, dots.frame, dots.truth, np.roll(dots.wires, -1, axis=0))


def _moved(wires: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(F,): how far wires are from where they were, across themselves, on average, mm."""
    along = wires[:, :, 1] - wires[:, :, 0]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    away = others.mean(axis=2) - wires[:, :, 0]
    away = away - np.einsum("flk,flk->fl", away, along)[..., None] * along
    return np.asarray(np.linalg.norm(away, axis=-1).mean(axis=1))


def _without(dots: Dots, frames: np.ndarray, wires: np.ndarray) -> Dots:
    """With other wires, and without the dots of some frames."""
    keep = ~frames[dots.frame]
    return Dots(
        dots.points[keep], (np.cumsum(~frames) - 1)[dots.frame[keep]], dots.truth[keep], wires[~frames]
    )


def another(rng: np.random.Generator, dots: Dots) -> Dots:
    """Another phantom in its place, of as many wires."""
    base = phantoms.random_wires(rng, dots.wires.shape[1])
    ends = base + dots.wires[0].mean(axis=(0, 1))
    return Dots(
        dots.points,
        dots.frame,
        dots.truth,
        np.stack([_carried(dots.wires[0], one, ends) for one in dots.wires]),
    )


def noise(rng: np.random.Generator, dots: Dots) -> Dots:
    """Dots anywhere."""
    low, high = (bound(dots.points, axis=tuple(range(dots.points.ndim - 1))) for bound in (np.min, np.max))
    return Dots(rng.uniform(low, high, dots.points.shape), dots.frame, dots.truth, dots.wires)


WRONG = {
    "wires displaced by 6 mm": displaced,
    "poses shuffled": shuffled,
    "another phantom": another,
    "noise": noise,
}
ROWS = {
    "real": real_rows,
    "phantoms": phantom_rows,
    "volumes": volume_rows,
    "needles": needle_rows,
    "symmetric": symmetric_rows,
    "wrong": wrong_rows,
    "rolled": rolled_rows,
}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=list(ROWS))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--hypotheses", type=int, default=MOST["hypotheses"], help="at the most")
    arguments = parser.parse_args()
    MOST["hypotheses"] = arguments.hypotheses
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    print(
        "| what | right | ambiguous | unfinished | nothing fits | wrong | median, s | 95 %, s |\n"
        + "|---" * 8
        + "|"
    )
    for name in arguments.rows:
        ROWS[name](seeds)


if __name__ == "__main__":
    main()
