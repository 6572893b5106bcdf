"""What is asked of each experiment, by its name: shown at the end of a run and checked by --check."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Final

from polish_sim.analysis.claim import DEGREES, PATH_DONE, Claim
from polish_sim.config import Scenario
from polish_sim.dual.figures import DUAL, TOOL_ON_PART
from polish_sim.hand_guiding.figures import TEACH
from polish_sim.identification.claims import IDENTIFY
from polish_sim.smoothing.figures import SMOOTH

# What is asked of the arc, the force step and the surface.

ONE_ROBOT: Final[Mapping[str, tuple[Claim, ...]]] = {
    "arc": (
        Claim("tracking_error_max_m", "tracking error, max", "mm", 1e3, "< 0.3", high=1e-4),
        Claim("tracking_error_rms_m", "tracking error, rms", "mm", 1e3),
        Claim("speed_mean_m_s", "speed, mean", "mm/s", 1e3, "10"),
        Claim("speed_max_deviation_m_s", "speed deviation, max", "mm/s", 1e3, "held", high=1e-4),
        Claim("orientation_error_max_rad", "orientation error, max", "mrad", 1e3),
        PATH_DONE,
    ),
    "force": (
        Claim("settling_time_3n_s", "settling to ±3 N", "s", 1.0, "< 0.5", high=0.4),
        Claim("settling_time_1n_s", "settling to ±1 N", "s", 1.0),
        Claim("steady_within_3n", "in ±3 N after 0.5 s", "%", 100.0, "most", low=1.0, more_is_better=True),
        Claim("overshoot_n", "overshoot", "N", 1.0),
        Claim("rise_time_s", "rise 10-90%", "s", 1.0),
        Claim("steady_std_n", "steady force, std", "N", 1.0),
        PATH_DONE,
    ),
    "surface": (
        Claim("force_within_4n", "force in ±4 N", "%", 100.0, "100, six dips", low=0.995, more_is_better=True),
        Claim("force_within_1n", "force in ±1 N", "%", 100.0, more_is_better=True),
        Claim("force_mean_n", "force, mean", "N", 1.0, "20"),
        Claim("force_rms_error_n", "force error, rms", "N", 1.0),
        Claim("force_max_deviation_n", "force error, max", "N", 1.0, "4"),
        Claim("force_error_at_peaks_n", "largest error at a peak, mean of the peaks", "N", 1.0),
        Claim("force_error_median_n", "force error, median", "N", 1.0),
        Claim("curvature_peaks", "curvature peaks", "", 1.0, "6"),
        Claim("contact_lost_s", "contact lost", "s", 1.0, "0"),
        Claim("tracking_error_max_m", "tangential error, max", "mm", 1e3, "-", high=3e-4),
        Claim("speed_mean_m_s", "speed, mean", "mm/s", 1e3, "constant"),
        Claim("removal_cv", "removal, std / mean", "%", 100.0),
        Claim("under_polished_share", "removal below half its mean", "%", 100.0),
        Claim("over_polished_share", "removal above 1.5 x its mean", "%", 100.0),
        PATH_DONE,
    ),
}


# What is asked of a calibration; of a user's readings, whose truth nobody knows, less.

_AXES_SEEN: Final = (
    Claim("origin_std_m", "origin seen by the tracker, 3D std", "mm", 1e3, high=1.7e-5),
    Claim("axis_std_rad", "first axis, std", "deg", DEGREES, high=0.001 / DEGREES),
    Claim("point_std_1m_m", "a metre from the origin, 3D std", "mm", 1e3, high=2.7e-5),
    # Several times what the noise of a tracker of 0.03 mm makes of axes that do meet.
    Claim("gap_m", "axes 1 and 2 miss each other by", "mm", 1e3, high=1e-4),
)
_RELATIVE_BASE: Final = (
    Claim("relative_origin_std_m", "follower's origin in the master's, 3D std", "mm", 1e3),
    Claim("relative_origin_error_m", "follower's origin in the master's, error", "mm", 1e3),
    Claim("point_error_1m_m", "a metre from the follower's, error", "mm", 1e3),
    Claim("residual_rms_m", "residual of a point, rms", "mm", 1e3),
)
_BASE_DATA: Final = (
    Claim("relative_origin_std_m", "follower's origin in the master's, 3D std", "mm", 1e3, high=1e-4),
    Claim("noise_m", "noise of a point, per coordinate", "mm", 1e3),
    Claim("residual_rms_m", "residual of a point, rms", "mm", 1e3),
)

_ARM: Final = (
    Claim("heldout_rms_m", "target in poses left out, rms", "mm", 1e3),
    Claim("nominal_rms_m", "  with nominal tables, all poses", "mm", 1e3),
    Claim("residual_rms_m", "residual of a coordinate, rms", "mm", 1e3),
)

CALIBRATE: Final[Mapping[str, tuple[Claim, ...]]] = {
    "calibrate-payload": (
        Claim("mass_error_relative", "mass error", "%", 100.0, high=0.01),
        Claim("center_error_m", "centre error", "mm", 1e3, high=1e-3),
        Claim("residual_force_max_n", "force left, worst of 200 poses", "N", 1.0, high=0.3),
        Claim("residual_force_tared_max_n", "  tared in one of them", "N", 1.0, high=0.3),
        Claim("compensation_error_max_n", "  worst possible pose, no noise", "N", 1.0, high=0.3),
        Claim("residual_rms_n", "residual of the fit, force, rms", "N", 1.0),
        Claim("residual_rms_nm", "residual of the fit, torque, rms", "mN m", 1e3),
        Claim("condition", "condition of the poses", "", 1.0),
        Claim("drift_600s_rms_n", "idle force in 600 s, tared once, rms", "N", 1.0),
        Claim("drift_600s_retared_rms_n", "  tared every 60 s, rms", "N", 1.0),
    ),
    "calibrate-payload-data": (
        Claim("mass_std_relative", "mass, std", "%", 100.0, high=0.01),
        Claim("center_std_max_m", "centre, std of its worst axis", "mm", 1e3, high=1e-3),
        Claim("residual_rms_n", "residual of the fit, force, rms", "N", 1.0),
        Claim("residual_rms_nm", "residual of the fit, torque, rms", "mN m", 1e3),
        Claim("condition", "condition of the poses", "", 1.0),
    ),
    "calibrate-arm": (
        Claim("relative_error_m", "tool of one arm by the other's, rms", "mm", 1e3, high=1.5e-4),
        Claim("relative_error_nominal_m", "  with nominal tables", "mm", 1e3),
        *_ARM,
    ),
    "calibrate-arm-data": _ARM,
    "calibrate-tcp": (
        Claim("position_crb_m", "tip, Cramér-Rao bound, 3D rms", "mm", 1e3, high=3.3e-5),
        Claim("position_error_m", "tip error (three times that)", "mm", 1e3, high=1e-4),
        Claim("rotation_std_max_rad", "axes, std of the worst", "deg", DEGREES, high=0.045 / DEGREES),
        Claim("rotation_error_rad", "axes, error, all three", "deg", DEGREES),
        Claim("residual_rms_m", "residual of a touch, rms", "mm", 1e3),
    ),
    "calibrate-tcp-data": (
        Claim("position_std_m", "tip, 3D std", "mm", 1e3, high=3.3e-5),
        Claim("rotation_std_max_rad", "axes, std of the worst", "deg", DEGREES),
        Claim("noise_m", "noise of a touch, per coordinate", "mm", 1e3),
        Claim("residual_rms_m", "residual of a touch, rms", "mm", 1e3),
    ),
    "calibrate-base": (
        *_AXES_SEEN,
        Claim("origin_error_m", "origin, error (three times that)", "mm", 1e3, high=5.1e-5),
        Claim("axis_error_rad", "first axis, error (three times)", "deg", DEGREES, high=0.003 / DEGREES),
        *_RELATIVE_BASE,
    ),
    "calibrate-base-poses": (
        Claim("origin_error_m", "origin, error", "mm", 1e3),
        Claim("rotation_error_rad", "turn, error", "deg", DEGREES),
        *_RELATIVE_BASE,
    ),
    "calibrate-base-data": (*_AXES_SEEN, *_BASE_DATA),
    "calibrate-base-poses-data": _BASE_DATA,
    "calibrate-budget": (
        *TOOL_ON_PART,
        Claim("across_error_rms_m", "  across the tool axis, rms", "mm", 1e3),
        Claim("across_error_p95_m", "  95% below", "mm", 1e3),
        Claim("axial_share", "along the axis, of the mean square", "%", 100.0),
        Claim("calibrations_above_share", "calibrations with an rms above 0.06 mm", "%", 100.0, high=0.02),
        # A true prediction is four of them off once in 16,000 times.
        Claim("deviation_sigma_worst", "drawn minus analysis, worst source", "std", 1.0, high=4.0),
    ),
}


CLAIMS: Final[Mapping[str, tuple[Claim, ...]]] = MappingProxyType(
    {**ONE_ROBOT, **DUAL, **SMOOTH, **TEACH, **CALIBRATE, **IDENTIFY}
)


def claims_of(scenario: Scenario) -> str:
    """The name in ``CLAIMS`` of what is asked of a run: some moves are no trial, above a part is no force."""
    guide = scenario.guide
    if scenario.experiment == "teach" and scenario.drag.follow:
        return "teach-path"
    if scenario.experiment == "teach" and (guide.mode or guide.direction or guide.duration_s):
        if not guide.mode:
            return "teach-some"
        return "teach-none" if guide.mode == "none" else "teach-one"
    if scenario.experiment == "dual" and scenario.dual.standoff_m > 0.0:
        return "dual-free"
    return scenario.experiment


def shortfalls(experiment: str, metrics: Mapping[str, Any]) -> list[Claim]:
    """The claims of an experiment that its figures do not meet."""
    return [claim for claim in CLAIMS[experiment] if not claim.met_by(metrics.get(claim.figure))]


# When a run is the paper's own trial, so that the paper's figures may stand beside it.

NO_FIGURE: Final = "-"

PAPER_TASKS: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "arc": {"process.feed_m_s": 0.01},
        "force": {"part.file": "plate", "process.contact_force_n": 20.0},
        "surface": {
            "part.file": "freeform",
            "plan.file": "",
            "process.contact_force_n": 20.0,
            "process.feed_m_s": 0.01,
        },
        "smooth": {"plan.file": "", "smoothing.limits_file": ""},
    }
)
"""What of a scenario makes it the trial the papers report, by experiment; others have no such key."""


def is_paper_task(scenario: Scenario) -> bool:
    """Whether part, path, force and feed of a run are those of the paper's trial."""
    task = PAPER_TASKS.get(scenario.experiment, {})
    return all(attrgetter(name)(scenario) == value for name, value in task.items())


def claims_shown(scenarios: Sequence[Scenario]) -> tuple[Claim, ...]:
    """The figures to show of runs of one experiment: what is asked of any of them.

    The paper's figures are left out unless every run is the paper's trial.
    """
    claims = {claim.figure: claim for scenario in scenarios for claim in CLAIMS[claims_of(scenario)]}.values()
    if all(map(is_paper_task, scenarios)):
        return tuple(claims)
    return without_paper(claims)


def without_paper(claims: Iterable[Claim]) -> tuple[Claim, ...]:
    """The same claims without the paper's figures."""
    return tuple(claim._replace(paper=NO_FIGURE) for claim in claims)
