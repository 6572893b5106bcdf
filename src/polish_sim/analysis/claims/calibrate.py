"""What is asked of a calibration; of a user's readings, whose truth nobody knows, less (layer 8c)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from polish_sim.analysis.claims.claim import DEGREES, Claim
from polish_sim.analysis.claims.dual import TOOL_ON_PART

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
