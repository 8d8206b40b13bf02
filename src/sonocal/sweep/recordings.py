"""From a recording of whatever targets to a calibration: a needle, wires, walls, cross-wires, targets nobody placed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Unpack

from sonocal.detection import Detections
from sonocal.errors import require
from sonocal.recording import Recording
from sonocal.recording.health import Progress
from sonocal.sweep.calibrate import Sweep
from sonocal.sweep.choice import CandidateCalibration
from sonocal.sweep.options import Keywords
from sonocal.sweep.targets import TargetSweep, looked_for
from sonocal.sweep.unplaced_sweep import UnplacedSweep
from sonocal.targets import Line, Plane, Point, Target, Unplaced

__all__ = ["calibrate_recording", "sweep_of"]


def calibrate_recording(
    recording: Recording,
    lines: Sequence[Target | Unplaced],
    *,
    detections: Detections | Sequence[Detections] | None = None,
    progress: Progress | None = None,
    **options: Unpack[Keywords],
) -> CandidateCalibration:
    """Calibrate a probe from a recording of a needle or wires, or of walls and cross-wires, with nobody clicking.

    Args:
        recording: images, and poses with any latency undone, see `with_latency`.
        lines: the needles and wires, see `read_lines`; or points, lines and planes, see `read_targets`; or such as
            have no place in their frame that is known, see `Unplaced`: a thread in a tank, its floor, a needle that
            was never pivoted. It is found with the calibration (`Calibration.targets`).
        detections: what `detect` found, where that was done before; of points and planes, and of what has no place,
            what `TargetSweep.detect` did.
        progress: called with how many images are done and how many there are.
        **options: any of those of `sonocal.calibrate`, and of the following, by name.

            What to look for in the images:
            count (5, of several wires as many and 3 more, in volumes 3): candidates an image at the most.
            mask (found from the recording): (rows, columns), True where to look; for images.
            centre ("head"): of a bright spot its first echo, without the tail: needles; "mass": all of it, as PLUS
            segments wires; for images.

            What connects the lines to the probe:
            probe ("Probe"): the tool that the probe's marker is called.
            fixed (None): constant ``(target, source) -> (4, 4)``, such as a device set's.
            on_invalid ("raise"): refuse poses marked valid that are not rigid, or "skip" them.

            How images and poses belong together:
            latency (None): "estimate": how much later the tracker stamps an instant than the images do is fitted,
            too, and undone; needle or probe must move.

            What to choose:
            threshold_mm (5, or a fifth of the distance between lines of one frame, so that they are not taken for
            one another): candidates further than this from their needle are wrong; "auto": that is the most, and of
            the chosen rows those are outliers that are further off than 3.3 standard deviations of their noise.
            second_look (True): look again, for fainter ones, near where the calibrated needle must be.

    Returns:
        The calibration, the rows it rests on, and what became of the others.

    Raises:
        NoConsensusError: nothing in the images moves like the needle.
        DegenerateGeometryError: the sightings leave a motion free.
        InputError: the recording lacks images or poses, or an option does not exist or means nothing.
    """
    sweep = sweep_of(recording, lines, **options)
    if not isinstance(sweep, Sweep):
        found = sweep.detect(progress) if detections is None else detections
        return sweep.calibrate([found] if isinstance(found, Detections) else found)
    if detections is None:
        return sweep.calibrate(sweep.detect(progress))
    require("detections", detections, Detections)
    assert isinstance(detections, Detections)
    return sweep.calibrate(detections)


def sweep_of(
    recording: Recording, targets: Sequence[Target | Unplaced], /, **options: Unpack[Keywords]
) -> Sweep | TargetSweep | UnplacedSweep:
    """A needle or wires in a recording; or targets of any kind; or such as have no place, which is asked for.

    Raises:
        InputError, UnsupportedError: as `calibrate_recording`.
    """
    lists = isinstance(targets, Sequence) and not isinstance(targets, str)
    if lists and any(isinstance(one, Unplaced) for one in targets):
        return UnplacedSweep.of(recording, targets, **options)
    known = [one for one in targets if isinstance(one, (Line, Plane, Point))] if lists else []
    if known and len(known) == len(targets):
        wanted = looked_for(known)
        if any(not isinstance(one, Line) for one in wanted):
            return TargetSweep.of(recording, wanted, **options)
        targets = wanted
    return Sweep.of(recording, targets, **options)  # type: ignore[arg-type]  # it refuses what is no line
