"""Tracked tools: the tip by pivoting, the axis by spinning, the needle that follows."""

from sonocal.tools.calibrate import (
    Stylus,
    ToolCalibration,
    calibrate_tool,
    pivot_doubts,
    stylus_tip,
    tool_toml,
)
from sonocal.tools.dragged import register_features
from sonocal.tools.landmark_result import FeatureFit, LandmarkFit, PhantomRegistration, TargetError
from sonocal.tools.landmarks import register_landmarks
from sonocal.tools.needle import (
    DigitisedPoint,
    NeedleCalibration,
    digitise_point,
    needle_from_axis,
    needle_from_points,
    needle_from_spin,
)
from sonocal.tools.pivot import PivotCalibration, calibrate_pivot
from sonocal.tools.rests import Rest
from sonocal.tools.session import ToolSession, find_tool_session
from sonocal.tools.spin import SpinCalibration, calibrate_spin
from sonocal.tools.stepper import StepperCalibration, calibrate_stepper
from sonocal.tools.stretches import Stretch, find_stretches

__all__ = [
    "DigitisedPoint",
    "FeatureFit",
    "LandmarkFit",
    "NeedleCalibration",
    "PhantomRegistration",
    "PivotCalibration",
    "Rest",
    "SpinCalibration",
    "StepperCalibration",
    "Stretch",
    "Stylus",
    "TargetError",
    "ToolCalibration",
    "ToolSession",
    "calibrate_pivot",
    "calibrate_spin",
    "calibrate_stepper",
    "calibrate_tool",
    "digitise_point",
    "find_stretches",
    "find_tool_session",
    "needle_from_axis",
    "needle_from_points",
    "needle_from_spin",
    "pivot_doubts",
    "register_features",
    "register_landmarks",
    "stylus_tip",
    "tool_toml",
]
