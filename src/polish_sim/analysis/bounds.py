"""What the paper reports and what we ask of a run: the figures shown at the end and checked by --check (layer 8c)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from polish_sim.config import Scenario


class Claim(NamedTuple):
    """One figure of an experiment, how it is shown, what the paper says, and the range asked of it."""

    figure: str
    """Its name in metrics.json."""
    label: str
    unit: str
    """Unit in which it is shown."""
    scale: float
    """Shown value = SI value x scale."""
    paper: str = "-"
    low: float = -math.inf
    """Least value that passes [SI]."""
    high: float = math.inf
    """Largest value that passes [SI]."""
    more_is_better: bool = False

    @property
    def bounded(self) -> bool:
        """Whether anything is asked of the figure."""
        return math.isfinite(self.low) or math.isfinite(self.high)

    def met_by(self, value: float | None) -> bool:
        """Whether a value [SI] passes; an undefined one (None or NaN) never does where a range is asked."""
        return not self.bounded or (value is not None and self.low <= value <= self.high)

    def worst_of(self, values: Sequence[float | None]) -> float:
        """The least good value, or NaN if one is undefined."""
        known = [value for value in values if value is not None and not math.isnan(value)]
        if len(known) < len(values) or not known:
            return math.nan
        return min(known) if self.more_is_better else max(known)


_PATH_DONE: Final = Claim("path_done", "path done", "%", 100.0, "100", low=1.0, more_is_better=True)

_DEGREES: Final = 180.0 / math.pi
_RELATIVE_BASE: Final = (
    Claim("relative_origin_std_m", "follower's origin in the master's, 3D std", "mm", 1e3),
    Claim("relative_origin_error_m", "follower's origin in the master's, error", "mm", 1e3),
    Claim("point_error_1m_m", "a metre from it, error", "mm", 1e3),
    Claim("residual_rms_m", "residual of a point, rms", "mm", 1e3),
)


def _identify(error: float, predicted: float = 0.0285) -> tuple[Claim, ...]:
    """Claims of an identification; the error on a motion that was not fitted falls with the periods logged."""
    return (
        Claim("nrms_heldout_mean", "error held out / range of the torque", "%", 100.0, "-", high=error),
        Claim("nrms_heldout_consistent_mean", "the same, bodies that can exist", "%", 100.0),
        Claim("nrms_heldout_drawing_mean", "the same by the drawing", "%", 100.0),
        Claim("physically_consistent", "bodies that can exist", "", 1.0, "-", low=1.0, more_is_better=True),
        Claim("predicted_error_sigma", "predicted error / noise, one period", "", 1.0, "-", high=predicted),
        Claim("condition_motion", "condition of the motion, SI units", "", 1.0),
        Claim("error_over_crb", "error / Cramér-Rao bound, this draw", "", 1.0),
        Claim("interval_coverage", "95% intervals that hold the truth", "%", 100.0),
        Claim("base_parameters", "base parameters", "", 1.0),
        Claim("design_s", "design of the motion, CPU", "s", 1.0, "-", high=20.0),
        Claim("fit_s", "fit, CPU", "s", 1.0),
    )


_IDENTIFY_DATA: Final = (
    Claim("nrms_heldout_mean", "residual held out / range of the torque", "%", 100.0),
    Claim("nrms_heldout_drawing_mean", "the same by the drawing", "%", 100.0),
    Claim("base_parameters", "base parameters", "", 1.0),
    Claim("condition", "condition, SI units", "", 1.0),
    Claim("physically_consistent", "bodies that can exist", "", 1.0, low=1.0, more_is_better=True),
)
_STEPWISE: Final = (
    Claim("first_step_parameters", "parameters of the first step", "", 1.0),
    Claim("stepwise_over_joint", "error, stepwise / joint", "", 1.0, "-", high=1.01),
)

_TOOL_ON_PART: Final = (
    Claim("relative_error_rms_m", "tool on the part, error rms", "mm", 1e3, high=6e-5),
    Claim("relative_error_p95_m", "  95% below", "mm", 1e3, high=1e-4),
)
_PAIR: Final = (
    Claim("tracking_error_worst_m", "tracking error, worst axis", "mm", 1e3, high=1e-4),
    *_TOOL_ON_PART,
    Claim("chain_residual_m", "closed chain of the planned joints", "mm", 1e3, high=1e-9),
    Claim("master_way_m", "way of the part", "mm", 1e3),
)

CLAIMS: Final[Mapping[str, tuple[Claim, ...]]] = MappingProxyType(
    {
        "arc": (
            Claim("tracking_error_max_m", "tracking error, max", "mm", 1e3, "< 0.3", high=1e-4),
            Claim("tracking_error_rms_m", "tracking error, rms", "mm", 1e3),
            Claim("speed_mean_m_s", "speed, mean", "mm/s", 1e3, "10"),
            Claim("speed_max_deviation_m_s", "speed deviation, max", "mm/s", 1e3, "held", high=1e-4),
            Claim("orientation_error_max_rad", "orientation error, max", "mrad", 1e3),
            _PATH_DONE,
        ),
        "force": (
            Claim("settling_time_3n_s", "settling to ±3 N", "s", 1.0, "< 0.5", high=0.4),
            Claim("settling_time_1n_s", "settling to ±1 N", "s", 1.0),
            Claim("steady_within_3n", "in ±3 N after 0.5 s", "%", 100.0, "most", low=1.0, more_is_better=True),
            Claim("overshoot_n", "overshoot", "N", 1.0),
            Claim("rise_time_s", "rise 10-90%", "s", 1.0),
            Claim("steady_std_n", "steady force, std", "N", 1.0),
            _PATH_DONE,
        ),
        "surface": (
            Claim("force_within_4n", "force in ±4 N", "%", 100.0, "100, six dips", low=0.995, more_is_better=True),
            Claim("force_within_1n", "force in ±1 N", "%", 100.0, more_is_better=True),
            Claim("force_mean_n", "force, mean", "N", 1.0, "20"),
            Claim("force_rms_error_n", "force error, rms", "N", 1.0),
            Claim("force_max_deviation_n", "force error, max", "N", 1.0, "4"),
            Claim("force_error_at_peaks_n", "force error at the peaks", "N", 1.0),
            Claim("force_error_median_n", "force error, median", "N", 1.0),
            Claim("curvature_peaks", "curvature peaks", "", 1.0, "6"),
            Claim("contact_lost_s", "contact lost", "s", 1.0, "0"),
            Claim("tracking_error_max_m", "tangential error, max", "mm", 1e3, "-", high=3e-4),
            Claim("speed_mean_m_s", "speed, mean", "mm/s", 1e3, "constant"),
            Claim("removal_cv", "removal, std / mean", "%", 100.0),
            Claim("under_polished_share", "removal below half its mean", "%", 100.0),
            Claim("over_polished_share", "removal above 1.5 x its mean", "%", 100.0),
            _PATH_DONE,
        ),
        "dual": (
            Claim("force_max_deviation_n", "force error, max", "N", 1.0, high=1.5),
            Claim("force_mean_n", "force, mean", "N", 1.0),
            Claim("force_rms_error_n", "force error, rms", "N", 1.0),
            Claim("force_within_1n", "force in ±1 N", "%", 100.0, more_is_better=True),
            Claim("contact_lost_s", "contact lost", "s", 1.0),
            *_PAIR,
            Claim("removal_cv", "removal, std / mean", "%", 100.0),
            _PATH_DONE,
        ),
        "dual-free": (*_PAIR, _PATH_DONE),
        "smooth": (
            Claim(
                "certified_reduction_largest",
                "certified: error less at a jerk peak, largest",
                "%",
                100.0,
                "14.57",
                low=0.1457,
                more_is_better=True,
            ),
            Claim("certified_reduction_median", "  median of the peaks", "%", 100.0, more_is_better=True),
            Claim("certified_rise_largest", "  largest rise at one", "%", 100.0),
            Claim(
                "certified_reduction_largest_at_equal_time",
                "  largest, equal cycle times",
                "%",
                100.0,
                more_is_better=True,
            ),
            Claim(
                "certified_reduction_median_at_equal_time",
                "  median, equal cycle times",
                "%",
                100.0,
                more_is_better=True,
            ),
            Claim("joint_jerk_reduction_largest", "joint-jerk: largest", "%", 100.0, "14.57", more_is_better=True),
            Claim("joint_jerk_reduction_median", "  median of the peaks", "%", 100.0, more_is_better=True),
            Claim("certified_joint_jerk_ratio_max", "certified: joint jerk / limit", "", 1.0, high=1.0 + 1e-9),
            Claim("joint_jerk_joint_jerk_ratio_max", "joint-jerk: joint jerk / limit", "", 1.0, "< 1"),
            Claim("joint_acceleration_joint_jerk_ratio_max", "joint-acceleration: joint jerk / limit", "", 1.0, "> 1"),
            Claim("certified_cycle_time_s", "certified: cycle time", "s", 1.0),
            Claim("joint_jerk_cycle_time_s", "joint-jerk: cycle time", "s", 1.0, "13.215"),
            Claim("joint_acceleration_cycle_time_s", "joint-acceleration: cycle time", "s", 1.0, "13.169"),
            _PATH_DONE,
        ),
        "teach": (
            Claim("none_peak_n", "hand force, nothing compensated, peak", "N", 1.0, "> 100"),
            Claim("classical_peak_n", "  gravity and friction (classical)", "N", 1.0, "< 30"),
            Claim("fast_peak_ratio_x", "fast move along x, inertia / classical, peak", "", 1.0, "0.714", high=0.45),
            Claim("fast_rms_ratio_x", "  rms", "", 1.0, "-", high=0.30),
            Claim("fast_peak_ratio_y", "along y, peak", "", 1.0, "0.714", high=0.45),
            Claim("fast_rms_ratio_y", "  rms", "", 1.0, "-", high=0.30),
            Claim("assist_fast_peak_ratio_x", "with start-up assist: along x, peak", "", 1.0),
            Claim("assist_fast_rms_ratio_x", "  rms", "", 1.0),
            Claim("assist_fast_peak_ratio_y", "  along y, peak", "", 1.0),
            Claim("assist_fast_rms_ratio_y", "  rms", "", 1.0),
            Claim("slow_peak_n", "  slow moves, peak", "N", 1.0, "-", high=10.0),
            Claim("drift_rad", "hands off, drift", "deg", _DEGREES, "-", high=0.01 / _DEGREES),
            Claim("lent_energy_j", "energy lent, most", "J", 1.0),
            _PATH_DONE,
        ),
        "teach-some": (
            Claim("hand_force_peak_n", "hand force, last mode, peak", "N", 1.0),
            Claim("hand_force_rms_n", "  rms", "N", 1.0),
            Claim("drift_rad", "hands off, drift", "deg", _DEGREES, "-", high=0.01 / _DEGREES),
            Claim("lent_energy_j", "energy lent, most", "J", 1.0),
            _PATH_DONE,
        ),
        # An arm that does not carry itself is not let go.
        "teach-none": (
            Claim("hand_force_peak_n", "hand force, peak", "N", 1.0),
            Claim("hand_force_rms_n", "  rms", "N", 1.0),
            _PATH_DONE,
        ),
        "teach-path": (
            Claim("taught_deviation_max_m", "taught path off what was meant, max", "mm", 1e3),
            Claim("taught_deviation_rms_m", "  rms", "mm", 1e3),
            Claim("recorded_deviation_max_m", "recording off it, max", "mm", 1e3),
            Claim("recorded_deviation_rms_m", "  rms", "mm", 1e3),
            Claim("taught_missed_max_m", "what was meant off the taught path, max", "mm", 1e3),
            Claim("taught_axis_error_max_rad", "tool axis, max", "deg", _DEGREES),
            Claim("points_recorded", "points recorded", "", 1.0),
            Claim("points_taught", "points taught", "", 1.0),
            Claim("hand_force_peak_n", "hand force, peak", "N", 1.0),
            Claim("hand_force_rms_n", "  rms", "N", 1.0),
            _PATH_DONE,
        ),
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
        "calibrate-tcp": (
            Claim("position_crb_m", "tip, Cramér-Rao bound, 3D rms", "mm", 1e3, high=3.3e-5),
            Claim("position_error_m", "tip error (three times that)", "mm", 1e3, high=1e-4),
            Claim("rotation_std_max_rad", "axes, std of the worst", "deg", _DEGREES, high=0.045 / _DEGREES),
            Claim("rotation_error_rad", "axes, error, all three", "deg", _DEGREES),
            Claim("residual_rms_m", "residual of a touch, rms", "mm", 1e3),
        ),
        "calibrate-tcp-data": (
            Claim("position_std_m", "tip, 3D std", "mm", 1e3, high=3.3e-5),
            Claim("rotation_std_max_rad", "axes, std of the worst", "deg", _DEGREES),
            Claim("noise_m", "noise of a touch, per coordinate", "mm", 1e3),
            Claim("residual_rms_m", "residual of a touch, rms", "mm", 1e3),
        ),
        "calibrate-base": (
            Claim("origin_std_m", "origin seen by the tracker, 3D std", "mm", 1e3, high=1.7e-5),
            Claim("axis_std_rad", "first axis, std", "deg", _DEGREES, high=0.001 / _DEGREES),
            Claim("origin_error_m", "origin, error (three times that)", "mm", 1e3, high=5.1e-5),
            Claim("axis_error_rad", "first axis, error (three times)", "deg", _DEGREES, high=0.003 / _DEGREES),
            *_RELATIVE_BASE,
        ),
        "calibrate-base-poses": (
            Claim("origin_error_m", "origin, error", "mm", 1e3),
            Claim("rotation_error_rad", "turn, error", "deg", _DEGREES),
            *_RELATIVE_BASE,
        ),
        "calibrate-base-data": (
            Claim("relative_origin_std_m", "follower's origin in the master's, 3D std", "mm", 1e3),
            Claim("noise_m", "noise of a point, per coordinate", "mm", 1e3),
            Claim("residual_rms_m", "residual of a point, rms", "mm", 1e3),
        ),
        "calibrate-budget": (
            *_TOOL_ON_PART,
            Claim("across_error_rms_m", "  across the tool axis, rms", "mm", 1e3),
            Claim("across_error_p95_m", "  95% below", "mm", 1e3),
            Claim("axial_share", "along the axis, of the mean square", "%", 100.0),
            Claim("calibrations_above_share", "calibrations with an rms above 0.06 mm", "%", 100.0, high=0.02),
            # A true prediction is four of them off once in 16,000 times.
            Claim("deviation_sigma_worst", "drawn minus analysis, worst source", "std", 1.0, high=4.0),
        ),
        "identify": _identify(6e-4),
        "identify-short": _identify(1.3e-3),
        "identify-stepwise": (*_identify(1.3e-3), *_STEPWISE),
        # The bound on the predicted error is the default objective's, and for the default task, random motions under
        # the same limits.
        "identify-other": _identify(6e-4, math.inf),
        "identify-short-other": _identify(1.3e-3, math.inf),
        "identify-stepwise-other": (*_identify(1.3e-3, math.inf), *_STEPWISE),
        "identify-task": _identify(1.3e-3, math.inf),
        "identify-data": _IDENTIFY_DATA,
        "identify-payload-data": (
            Claim("payload_mass_std_kg", "mass, std", "g", 1e3),
            Claim("payload_consistent_as_found", "a body can have these numbers as found", "", 1.0),
            Claim("payload_consistent", "the nearest body can exist", "", 1.0, low=1.0, more_is_better=True),
        ),
        "identify-data-stepwise": (*_IDENTIFY_DATA, *_STEPWISE),
        "calibrate-payload-data": (
            Claim("mass_std_relative", "mass, std", "%", 100.0, high=0.01),
            Claim("center_std_max_m", "centre, std of its worst axis", "mm", 1e3, high=1e-3),
            Claim("residual_rms_n", "residual of the fit, force, rms", "N", 1.0),
            Claim("residual_rms_nm", "residual of the fit, torque, rms", "mN m", 1e3),
            Claim("condition", "condition of the poses", "", 1.0),
        ),
    }
)


def claims_of(scenario: Scenario) -> str:
    """The name in ``CLAIMS`` of what is asked of a run: some moves are no trial, above a part is no force."""
    guide = scenario.guide
    if scenario.experiment == "teach" and scenario.drag.follow:
        return "teach-path"
    if scenario.experiment == "teach" and (guide.mode or guide.direction or guide.duration_s):
        return "teach-none" if guide.mode == "none" else "teach-some"
    if scenario.experiment == "dual" and scenario.dual.standoff_m > 0.0:
        return "dual-free"
    return scenario.experiment


def shortfalls(experiment: str, metrics: Mapping[str, Any]) -> list[Claim]:
    """The claims of an experiment that its figures do not meet."""
    return [claim for claim in CLAIMS[experiment] if not claim.met_by(metrics.get(claim.figure))]


def bound_text(claim: Claim) -> str:
    """The range asked of a figure, as it is shown, e.g. ``<= 0.1``."""
    if math.isfinite(claim.low) and math.isfinite(claim.high):
        return f"{claim.low * claim.scale:g} to {claim.high * claim.scale:g}"
    if math.isfinite(claim.low):
        return f">= {claim.low * claim.scale:g}"
    return f"<= {claim.high * claim.scale:g}" if claim.bounded else "-"


def value_text(claim: Claim, value: float | None) -> str:
    """A figure in its shown unit with three or four significant digits; an undefined one is a dash."""
    if value is None or math.isnan(value):
        return "-"
    return f"{value * claim.scale:.4g}"
