"""Branch ``smoothing`` (paper 4): one path smoothed and played by every rule; the row of its experiment, and
what is asked of it."""

from __future__ import annotations

import math

from polish_sim.analysis.claim import PATH_DONE, Claim
from polish_sim.config import Scenario, SmoothingConfig, SpindleConfig
from polish_sim.experiments.registry import SEED_OPTIONS, Experiment, always

TOLERANCE = 0.02e-3  #: Of the tip in the paper's trial [m]
AXIS_TOLERANCE = math.radians(0.02)  #: Of the tool axis [rad]

CLAIMS = (
    Claim(
        "spline_reduction_largest",
        "spline: error less at a jerk peak, largest",
        "%",
        "14.57",
        low=0.1457,
        more_is_better=True,
    ),
    Claim("spline_reduction_median", "  median of the peaks", "%", more_is_better=True),
    Claim("spline_rise_largest", "  largest rise at one", "%"),
    Claim(
        "spline_reduction_largest_at_equal_time",
        "  largest, equal cycle times",
        "%",
        more_is_better=True,
    ),
    Claim(
        "spline_reduction_median_at_equal_time",
        "  median, equal cycle times",
        "%",
        more_is_better=True,
    ),
    Claim("joint_jerk_reduction_largest", "joint-jerk: largest", "%", "14.57", more_is_better=True),
    Claim("joint_jerk_reduction_median", "  median of the peaks", "%", more_is_better=True),
    Claim("spline_joint_jerk_ratio_max", "spline: joint jerk / limit", "", high=1.0 + 1e-9),
    Claim("joint_jerk_joint_jerk_ratio_max", "joint-jerk: joint jerk / limit", "", "< 1"),
    Claim("joint_acceleration_joint_jerk_ratio_max", "joint-acceleration: joint jerk / limit", "", "> 1"),
    Claim("spline_cycle_time_s", "spline: cycle time", "s"),
    Claim("joint_jerk_cycle_time_s", "joint-jerk: cycle time", "s", "13.215"),
    Claim("joint_acceleration_cycle_time_s", "joint-acceleration: cycle time", "s", "13.169"),
    PATH_DONE,
)

_JOINTS = (float,) * 6
_PEAKS = [(int, float, float, float)]

SMOOTH = Experiment(
    "smooth",
    "one path played with every smoothing rule on the joint servos (paper 4, fig. 10)",
    Scenario(
        experiment="smooth",
        spindle=SpindleConfig(speed_rpm=0.0),
        smoothing=SmoothingConfig(tolerance_m=TOLERANCE, axis_tolerance_rad=AXIS_TOLERANCE),
    ),
    run="polish_sim.smoothing.smooth:run_smooth",
    prepare="polish_sim.smoothing.smooth:check_smooth",
    claims=always(CLAIMS),
    plots=always({"tracking.png": "polish_sim.smoothing.tracking:plot_tracking"}),
    forms={
        "rules": [str],
        "joint_jerk_limits_rad_s3": _JOINTS,
        "spline_reduction_max": _JOINTS,
        "joint_jerk_at_peaks": _PEAKS,
        "spline_at_peaks": _PEAKS,
    },
    comparisons={"tracking.png": "polish_sim.smoothing.tracking:plot_tracking_runs"},
    options=("--part-pose", "--path", *SEED_OPTIONS, "--dry-run", "--log-rate"),
    paper={"plan.file": "", "smoothing.limits_file": ""},
    title=always("smooth, every rule on the servos"),
    controlled=False,
    on_part=False,
    idle=("process", "controller", "sensor", "payload", "spindle", "safety", "faults", *Experiment.idle),
)
