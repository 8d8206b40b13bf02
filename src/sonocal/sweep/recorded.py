"""What a recording says beside its images and poses: of its latency, its health and its scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sonocal.calibration import Calibration
from sonocal.recording import Recording, health, stated_scale
from sonocal.setup_checks.scale import scale_deviation, scale_doubt
from sonocal.targets import Target

__all__ = ["as_recorded"]


def as_recorded(
    calibration: Calibration, recording: Recording, targets: Sequence[Target], probe: str
) -> Calibration:
    """The calibration with the latency of its recording, and with what is wrong with that.

    Of the recording's tools, those that took part; of mm/px that it states, where the user says no others.
    """
    tools = {probe.lower(), *(target.frame.lower() for target in targets)}
    poses = {name: one for name, one in recording.poses.items() if one.source.lower() in tools}
    noticed = health(replace(recording, poses=poses), look_at_images=False)
    worth = [one for one in noticed if one.severity == "warning" or one in recording.diagnostics]
    said = stated_scale(recording)
    if said is not None and calibration.options.scanner_mm_per_px is None:
        scales, deviation = calibration.probe_from_image.scales, scale_deviation(calibration.covariance)
        who = f"the recording ({said.where})"
        worth += scale_doubt(scales, deviation, said.mm_per_px, "the calibration", who)
    return replace(calibration.with_findings(worth), latency_s=recording.latency_s or None)
