"""What is often wrong with a set-up, looked for in its data; each finding is a diagnostic with its code.

- implausible-units: lengths are not in mm, or places not in px: the scale or the segments are none that exist.
- scale-differs-from-scanner: mm/px is not what the scanner says. Needs the scanner's mm/px.
- flipped-image: the image is mirrored or upside down. In 2D, needs a roughly known orientation.
- marker-slipped: the marker moved on the probe during the scan. Needs frames in the order of time.
- wrong-tool-frame: lines are not in the probe marker's frame. The probe's poses tell which they are in.
- wrong-end-of-needle: the needle was seen beyond its segment. Needs segments that end where the needle does.
- second-needle: rows that were left out lie one shift away from those used. Of tables of one needle.
- threshold-below-noise: the threshold leaves out rows that are merely noisy.
- latency: image and tracker are not of the same instant. Needs frames in the order of time.
- latency-beyond-tolerance: with that lag undone the answer is another one.
- anisotropic-scale: mm/px differs along u and v. `calibrate` finds it.
"""

from sonocal.setup_checks.copies import check_copies
from sonocal.setup_checks.evidence import Evidence
from sonocal.setup_checks.latency import check_latency
from sonocal.setup_checks.placement import check_flip, check_needle_end, check_tool_frame
from sonocal.setup_checks.refused import Refused, refusal_findings
from sonocal.setup_checks.scale import check_scale
from sonocal.setup_checks.slip import check_slip
from sonocal.setup_checks.units import check_units
from sonocal.setup_checks.whole import check_setup

__all__ = [
    "Evidence",
    "Refused",
    "check_copies",
    "check_flip",
    "check_latency",
    "check_needle_end",
    "check_scale",
    "check_setup",
    "check_slip",
    "check_tool_frame",
    "check_units",
    "refusal_findings",
]
