"""Branch ``dual`` (paper 2): two robots on one part; the row of its experiment, and what is asked of it and
of the calibrations it needs."""

from __future__ import annotations

from collections.abc import Mapping

from polish_sim.analysis.claim import PATH_DONE, Claim
from polish_sim.config import PartConfig, Scenario
from polish_sim.experiments.registry import (
    COVER_OPTIONS,
    PART_OPTIONS,
    PATH_OPTIONS,
    REMOVAL_OPTIONS,
    TOOL_OPTIONS,
    TRIAL_OPTIONS,
    WATCH_OPTIONS,
    Experiment,
    always,
)
from polish_sim.page import DEGREES

TOOL_ON_PART = (
    Claim("relative_error_rms_m", "tool on the part, error rms", "mm", high=6e-5),
    Claim("relative_error_p95_m", "  95% below", "mm", high=1e-4),
)
_PAIR = (
    Claim("tracking_error_worst_m", "tracking error, worst axis", "mm", high=1e-4),
    *TOOL_ON_PART,
    Claim("chain_residual_m", "closed chain of the planned joints", "mm", high=1e-9),
    Claim("master_way_m", "way of the part", "mm"),
    Claim("master_turn_rad", "turn of the part", "deg"),
)
BAND_N = 1.5  #: The force is to be held so near what is set
PRESSING_CLAIMS = (
    Claim("force_max_deviation_n", "force error, max", "N", high=BAND_N),
    Claim("force_mean_n", "force, mean", "N", is_mean=True),
    Claim("force_rms_error_n", "force error, rms", "N"),
    Claim("force_within_1n", "force in ±1 N", "%", more_is_better=True),
    Claim("contact_lost_s", "contact lost", "s"),
    *_PAIR,
    Claim("removal_cv", "removal, std / mean", "%"),
    PATH_DONE,
)
FREE_CLAIMS = (*_PAIR, PATH_DONE)  #: At a stand-off there is no force

_TOUCH = Claim("residual_rms_m", "residual of a touch, rms", "mm")
_ROTATION_AND_TOUCH = Claim("rotation_error_rad", "axes, error, all three", "deg"), _TOUCH
_BOUND_SHARE = Claim("bound_share", "  error over that bound", "-", high=1.0)
_POINT = Claim("residual_rms_m", "residual of a point, rms", "mm")
_AXES_SEEN = (
    Claim("origin_std_m", "origin seen by the tracker, 3D std", "mm", high=1.7e-5),
    Claim("axis_std_rad", "first axis, std", "deg", high=0.001 / DEGREES),
    Claim("point_std_1m_m", "a metre from the origin, 3D std", "mm", high=2.7e-5),
    # Several times what the noise of a tracker of 0.03 mm makes of axes that do meet.
    Claim("gap_m", "axes 1 and 2 miss each other by", "mm", high=1e-4),
)
_ORIGIN_STD = Claim("relative_origin_std_m", "follower's origin in the master's, 3D std", "mm")
_ORIGIN_ERROR = Claim("relative_origin_error_m", "follower's origin in the master's, error", "mm")
_FAR_ERROR = Claim("point_error_1m_m", "a metre from the follower's, error", "mm")

_ARM = (
    Claim("heldout_rms_m", "target in poses left out, rms", "mm"),
    Claim("nominal_rms_m", "  with nominal tables, all poses", "mm"),
    Claim("residual_rms_m", "residual of a coordinate, rms", "mm"),
)

CALIBRATIONS: Mapping[str, tuple[Claim, ...]] = {
    "arm": (
        Claim("relative_error_m", "tool of one arm by the other's, rms", "mm", high=1.5e-4),
        Claim("relative_error_nominal_m", "  with nominal tables", "mm"),
        *_ARM,
    ),
    "arm-data": _ARM,
    "tcp": (
        Claim("position_crb_m", "tip, Cramér-Rao bound, 3D rms", "mm", high=3.3e-5),
        Claim("position_error_m", "tip error (three times that)", "mm", high=1e-4),
        Claim("rotation_std_max_rad", "axes, std of the worst", "deg", high=0.045 / DEGREES),
        *_ROTATION_AND_TOUCH,
    ),
    # Gears err by place: many readings of one are no better than one, which the bounds say.
    "tcp-gears": (
        Claim("position_error_m", "tip error", "mm"),
        Claim("position_bound_m", "  bound, by the residual of one touch", "mm"),
        _BOUND_SHARE,
        Claim("position_std_m", "  std if touches were independent", "mm"),
        *_ROTATION_AND_TOUCH,
    ),
    "tcp-data": (
        Claim("position_std_m", "tip, 3D std", "mm", high=3.3e-5),
        Claim("rotation_std_max_rad", "axes, std of the worst", "deg"),
        Claim("noise_m", "noise of a touch, per coordinate", "mm"),
        _TOUCH,
    ),
    "base": (
        *_AXES_SEEN,
        Claim("origin_error_m", "origin, error (three times that)", "mm", high=5.1e-5),
        Claim("axis_error_rad", "first axis, error (three times)", "deg", high=0.003 / DEGREES),
        *(_ORIGIN_STD, _ORIGIN_ERROR, _FAR_ERROR, _POINT),
    ),
    "base-gears": (
        _ORIGIN_ERROR,
        Claim("relative_origin_bound_m", "  bound, by the residual of one point", "mm"),
        _BOUND_SHARE,
        Claim("relative_origin_std_m", "  std if points were independent", "mm"),
        _FAR_ERROR,
        _POINT,
    ),
    "base-data": (
        *_AXES_SEEN,
        _ORIGIN_STD._replace(high=1e-4),
        Claim("noise_m", "noise of a point, per coordinate", "mm"),
        _POINT,
    ),
    "budget": (
        *TOOL_ON_PART,
        Claim("across_error_rms_m", "  across the tool axis, rms", "mm"),
        Claim("across_error_p95_m", "  95% below", "mm"),
        Claim("axial_share", "along the axis, of the mean square", "%"),
        Claim("calibrations_above_share", "calibrations with an rms above 0.06 mm", "%", high=0.02),
        # A true prediction is four of them off once in 16,000 times.
        Claim("deviation_sigma_worst", "drawn minus analysis, worst source", "std", high=4.0),
    ),
}
"""What is asked of each calibration of tool, bases and arms; of a user's measurements, whose truth is
unknown, less."""


DUAL = Experiment(
    "dual",
    "two robots: the master moves the part, the follower polishes its rim meanwhile (paper 2)",
    Scenario(experiment="dual", part=PartConfig(file="wheel_hub_rim")),
    run="polish_sim.dual.dual:run_dual",
    check="polish_sim.dual.checks:check_pair_settings",
    prepare="polish_sim.dual.dual:check_dual",
    claims=lambda scenario: FREE_CLAIMS if scenario.dual.standoff_m > 0.0 else PRESSING_CLAIMS,
    plots=always({"dual.png": "polish_sim.dual.plots:plot_dual"}),
    comparisons={"dual.png": "polish_sim.dual.plots:plot_dual_runs"},
    path_name="around the rim",
    options=(
        *(*PART_OPTIONS, "--real-part", *PATH_OPTIONS, "--path"),
        *("--master-speed", "--master-turn", "--master-path", "--standoff"),
        *("--tool", *TOOL_OPTIONS, "--feed", *TRIAL_OPTIONS, *WATCH_OPTIONS),
    ),
    along_plan=True,
    carried=True,
    band_n=BAND_N,
    faults="polish_sim.dual.cell:PAIR_FAULTS",
    remade=False,
    idle=("guide", "hand", "drag"),
    only_with={REMOVAL_OPTIONS: COVER_OPTIONS},
    not_with={"--master-path": ("--master-speed", "--master-turn", "--part-pose")},
    notes="polish_sim.dual.dual:pair_notes",
)
