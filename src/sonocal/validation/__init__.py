"""How far a calibration is off: each number with its definition, spread and confidence interval."""

from sonocal.validation.check import check_calibration
from sonocal.validation.check_log import (
    CheckLog,
    CheckRecord,
    append_check,
    check_log_path,
    read_check_log,
)
from sonocal.validation.check_result import Check
from sonocal.validation.comparison import Comparison, compare
from sonocal.validation.crosswire import (
    fit_crosswire,
    fixed_point_spread,
    reconstruction_accuracy,
)
from sonocal.validation.held_out import held_out, leave_one_frame_out, leave_one_target_out
from sonocal.validation.nwire import nwire_error, nwire_errors
from sonocal.validation.point_table import PointSightings, parse_point_sightings, read_point_sightings
from sonocal.validation.quantity import Quantity
from sonocal.validation.repeatability import Repeatability, repeatability
from sonocal.validation.standing import CANNOT_SHOW, cannot_show
from sonocal.validation.verdict import Verdict, give_verdict
from sonocal.validation.whole import Validation, validate, validate_points

__all__ = [
    "CANNOT_SHOW",
    "Check",
    "CheckLog",
    "CheckRecord",
    "Comparison",
    "PointSightings",
    "Quantity",
    "Repeatability",
    "Validation",
    "Verdict",
    "append_check",
    "cannot_show",
    "check_calibration",
    "check_log_path",
    "compare",
    "fit_crosswire",
    "fixed_point_spread",
    "give_verdict",
    "held_out",
    "leave_one_frame_out",
    "leave_one_target_out",
    "nwire_error",
    "nwire_errors",
    "parse_point_sightings",
    "read_check_log",
    "read_point_sightings",
    "reconstruction_accuracy",
    "repeatability",
    "validate",
    "validate_points",
]
