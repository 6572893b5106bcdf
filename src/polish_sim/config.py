"""The scenario: everything a run depends on, as plain data (layer 1). Lengths in m, angles in rad, forces in N.

Each field carries its meaning and its allowed range: the TOML file, its checks and its comments come from here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

Pose = tuple[float, float, float, float, float, float]

MOST_LEAN_RAD = math.radians(40.0)
"""Further over the pad touches with its edge only."""


def key(default: Any, text: str, low: float = -math.inf, high: float = math.inf, length: int = 0) -> Any:
    """Declare a field with its meaning (unit in brackets) and allowed range, both ends included; a list's length."""
    return field(default=default, metadata={"text": text, "low": low, "high": high, "length": length})


@dataclass(frozen=True)
class PartConfig:
    """Which part is in the cell, where, and how it differs from its drawing."""

    file: str = key("freeform", "STL, PLY or OBJ file, or the name of a shipped part")
    real_file: str = key(
        "",
        "mesh of the part as it really is (file or shipped part, unit and frame of the nominal one): path from `file`, "
        "contact with this; empty = as drawn",
    )
    unit: str = key("mm", "unit of the part's file: mm, cm, m or inch")
    up: str = key("auto", "side turned up: auto, x, y, z, -x, -y, -z, or a direction X,Y,Z")
    pose: tuple[float, ...] = key(
        (), "pose of the work frame in the base frame: x, y, z [m], rotation vector [rad]; empty = chosen", length=6
    )
    displacement_m: float = key(0.001, "how far the real part sits from its nominal place [m]", 0.0, 0.02)
    rotation_rad: float = key(math.radians(0.5), "how far the real part is turned [rad]", 0.0, 0.2)
    form_error_m: float = key(0.0003, "form error of the real part, peak to peak [m]", 0.0, 0.005)
    motion_m: float = key(0.0, "the part moves along its mean normal by a sine of this amplitude [m]", 0.0, 0.02)
    motion_hz: float = key(1.0, "frequency of that motion [Hz]", 0.0, 50.0)


@dataclass(frozen=True)
class PlanConfig:
    """How the tool path covers the region."""

    file: str = key("", "a finished path to run: plan folder, path.json, CSV or APT file; empty = plan anew")
    pattern: str = key("spiral", "spiral, raster, contour or fermat")
    region: str = key(
        "auto",
        "auto, top, all, point:X,Y,Z, box:X0,Y0,Z0,X1,Y1,Z1, polygon:X,Y,Z;X,Y,Z;..., polygon:FILE or faces:FILE (mm)",
    )
    feature_angle_rad: float = key(
        math.radians(30.0),
        "edges that bend by more than this bound a smooth face [rad]",
        math.radians(1.0),
        math.radians(175.0),
    )
    edge_margin_m: float = key(0.0, "how far the region keeps from its edges, along the surface [m]", 0.0, 0.5)
    stepover_m: float = key(0.008, "distance between neighbouring turns [m]", 0.0002, 1.0)
    bridge_m: float = key(0.02, "holes up to this diameter are run over by the pad [m]", 0.0, 0.5)
    order: str = key("inward", "spiral, contour: inward or outward")
    direction: str = key("conventional", "spiral, contour: conventional (what is not done yet on the left) or climb")
    start: tuple[float, ...] = key(
        (),
        "the path begins as near this point as pattern and order allow: x, y, z in the work frame [m]; empty = chosen",
        length=3,
    )
    raster_direction: tuple[float, ...] = key(
        (), "direction of the raster's lines: x, y, z in the work frame; empty = along the region's long axis", length=3
    )
    clearance_m: float = key(0.03, "height of the first and last point above the part [m]", 0.001, 0.5)
    lead_in: str = key("normal", "how the tool lands: normal, tangent or arc")
    lead_angle_rad: float = key(
        0.0, "the tool leans this far forward, along the feed [rad]", -MOST_LEAN_RAD, MOST_LEAN_RAD
    )
    tilt_angle_rad: float = key(
        0.0, "the tool leans this far to the left of the feed [rad]", -MOST_LEAN_RAD, MOST_LEAN_RAD
    )
    axis_smoothing_m: float = key(0.0, "the tool axis is averaged over this length of the path, 0 = not [m]", 0.0, 1.0)
    axis_deviation_rad: float = key(
        math.radians(5.0), "averaging turns the tool axis by no more than this [rad]", 0.0, MOST_LEAN_RAD
    )


@dataclass(frozen=True)
class ProcessConfig:
    """What the tool is asked to do on the part."""

    contact_force_n: float = key(20.0, "force to hold along the tool axis [N]", 0.5, 200.0)
    feed_m_s: float = key(0.01, "speed along the path [m/s]", 1e-4, 0.5)
    approach_speed_m_s: float = key(0.005, "speed of the approach [m/s]", 1e-4, 0.1)
    hold_s: float = key(4.0, "how long `force` holds after first contact [s]", 1.0, 600.0)
    contact_threshold_n: float = key(
        2.0, "measured force that counts as contact; if the sensor is noisier, 5 sigma of its noise do [N]", 0.1, 50.0
    )
    tare: str = key("start", "when the sensor is zeroed in free space: start (of the run) or strokes (before each one)")
    search_depth_m: float = key(0.01, "how far past the nominal surface contact is sought [m]", 0.0, 0.1)
    preston_1_pa: float = key(
        0.0, "wear coefficient of Preston's law, removal = this x pressure x way; 0 = unknown, removal relative [1/Pa]",
        0.0, 1.0,
    )  # fmt: skip
    max_feed_s: float = key(0.0, "stop the feed after this long, 0 = the whole path [s]", 0.0, 1e6)


@dataclass(frozen=True)
class SmoothingConfig:
    """How way points become a motion."""

    rule: str = key(
        "spline",
        "surface: spline, certified, joint-jerk, joint-acceleration, or none: at the feed whatever it takes; "
        "smooth plays the three in the middle",
    )
    tolerance_m: float = key(1e-4, "how far the tool may be from the path, 0 = exact (not with spline) [m]", 0.0, 0.01)
    axis_tolerance_rad: float = key(
        math.radians(0.2), "how far the tool axis may be from its way, 0 = exact (not with spline) [rad]", 0.0, 0.2
    )
    limits_file: str = key("", "TOML file of limits, see 'smooth --limits'; empty = the experiment's own")


@dataclass(frozen=True)
class BaselinesConfig:
    """Gains of the baselines: admittance, impedance-position and force-mode."""

    mass_kg: float = key(
        4.0, "virtual mass of admittance and impedance-position, twice what the wrist sensor carries [kg]", 0.1, 1000.0
    )
    damping_n_s_m: float = key(283.0, "their damper, critical on the nominal springs [N s/m]", 1.0, 1e5)
    stiffness_n_m: float = key(1000.0, "spring of impedance-position, a fifth of the nominal ones [N/m]", 0.0, 1e6)
    mode_gain_scaling: float = key(0.5, "gain scaling of force-mode [-]", 0.01, 2.0)
    mode_damping: float = key(0.025, "damping of force-mode: share of the speed lost per 2 ms [-]", 0.0, 1.0)
    mode_mass_kg: float = key(8.5, "virtual mass of force-mode at a gain scaling of 1, the arm's own [kg]", 0.1, 1000.0)


@dataclass(frozen=True)
class AdaptiveConfig:
    """What hybrid-adaptive believes of cell and sensor, its limits, and which of its laws are on."""

    laws: str = key(
        "touch-down stiffness inertia feed-forward feed learning normal", "laws composed; leave names out to ablate"
    )
    stiffness_n_m: float = key(5000.0, "springs of head and pad in series, as drawn [N/m]", 10.0, 1e7)
    damping_n_s_m: float = key(33.75, "head's damper as felt on the part, c (k_pad/(k_head+k_pad))^2 [N s/m]", 0.0, 1e4)
    damping_lag_s: float = key(0.00225, "time in which its force builds up, c/(k_head+k_pad) [s]", 1e-5, 1.0)
    tool_mass_kg: float = key(2.0, "mass the wrist sensor carries [kg]", 0.01, 100.0)
    tool_mass_doubt: float = key(0.35, "share of its inertia that may be wrong: mass, delay [-]", 0.01, 1.0)
    sensor_latency_s: float = key(0.002, "from force to reading, believed [s]", 0.0, 0.1)
    sensor_bandwidth_hz: float = key(80.0, "low-pass of the sensor, believed [Hz]", 1.0, 500.0)
    usual_noise_n: float = key(0.25, "noise of a reading beyond which the observer slows down, rms [N]", 0.001, 20.0)
    command_delay_s: float = key(0.01, "from command to motion, until measured on the way down [s]", 0.001, 0.1)
    crossover_rad_s: float = key(40.0, "highest crossover of the force loop [rad/s]", 1.0, 500.0)
    observer_rad_s: float = key(30.0, "highest corner of the force observer [rad/s]", 1.0, 500.0)
    delay_share: float = key(0.5, "crossover times command delay, at most [-]", 0.05, 1.5)
    top_speed_m_s: float = key(0.1, "highest speed of the force loop [m/s]", 0.001, 1.0)
    acceleration_m_s2: float = key(1.2, "acceleration the force loop counts on [m/s^2]", 0.05, 20.0)
    force_rate_n_s: float = key(800.0, "fastest rise of the force [N/s]", 1.0, 1e5)
    tool_center_m: float = key(0.1226, "height of the mass the sensor carries above the tool point [m]", 0.0, 1.0)
    stiff_first: float = key(5.0, "stiffness at first touch, as a multiple of the drawn one [-]", 1.0, 50.0)
    feed_error_n: float = key(1.0, "force error for which the feed is slowed [N]", 0.05, 50.0)
    feed_least: float = key(0.1, "share of the planned feed that is always granted [-]", 0.02, 1.0)
    angular_acceleration_rad_s2: float = key(6.0, "angular acceleration the feed counts on [rad/s^2]", 0.05, 100.0)
    learning_length_m: float = key(0.005, "the surface found is averaged over this length of the path [m]", 0.001, 0.1)
    learning_gain: float = key(0.9, "share of what one turn found that the next one expects [-]", 0.0, 1.0)
    normal_rate_1_s: float = key(3.0, "share of the pad's tilt on the part taken back per time [1/s]", 0.0, 20.0)
    normal_limit_rad: float = key(
        math.radians(10.0), "largest correction of the planned axis by the pad's moment [rad]", 0.0, 0.5
    )
    normal_turning_rad_s: float = key(0.3, "fastest correction of the planned axis [rad/s]", 0.001, 3.0)
    head_stiffness_n_m: float = key(20000.0 / 3.0, "spring between tool point and pad, as drawn [N/m]", 10.0, 1e7)
    pad_tilt_stiffness_nm_rad: float = key(
        3.125, "disc pressed flat against tilting, k_pad R^2 / 4, as drawn [N m/rad]", 1e-3, 1e5
    )


@dataclass(frozen=True)
class ControllerConfig:
    """Gains of the shipped control laws (paper 1, eq. 5-7)."""

    name: str = key(
        "hybrid-pi",
        "hybrid-pi, hybrid-adaptive, hybrid-pi-position, position, admittance, impedance-position, force-mode or "
        "FILE.py:CLASS",
    )
    look_ahead_s: float = key(0.1, "T_a: time in which a position or angle error is taken back [s]", 0.01, 10.0)
    position_p: float = key(0.2, "kpp of eq. 6, on the velocity error [-]", 0.0, 0.95)
    position_d_s: float = key(0.0, "kpd of eq. 6, on the velocity error's derivative [s]", 0.0, 0.1)
    position_rate_p: float = key(10.0, "kpp of eq. 5, on the position error [1/s]", 0.0, 60.0)
    position_rate_d: float = key(0.1, "kpd of eq. 5, on the error's derivative [-]", 0.0, 0.95)
    orientation_p: float = key(0.2, "P of eq. 7, on the angular velocity error [-]", 0.0, 0.95)
    orientation_i_hz: float = key(0.2, "I of eq. 7 [1/s]", 0.0, 5.0)
    orientation_d_s: float = key(0.0, "D of eq. 7 [s]", 0.0, 0.1)
    force_p_m_sn: float = key(0.004, "kfp of eq. 5 [m/(s N)]", 0.0, 0.1)
    force_filter_hz: float = key(10.0, "low-pass on the measured force and moment in the loop [Hz]", 0.1, 500.0)
    force_limit_m_s: float = key(0.05, "largest speed the force loop may ask for [m/s]", 0.001, 1.0)
    force_i_m_s2n: float = key(0.012, "kfi of eq. 5 [m/(s^2 N)]", 0.0, 1.0)
    moment_p_rad_snm: float = key(
        0.1, "P of the moment loop about tool y; at 0.3 the tool's inertia rings [rad/(s N m)]", 0.0, 10.0
    )
    moment_i_rad_s2nm: float = key(0.03, "I of the moment loop about tool y [rad/(s^2 N m)]", 0.0, 10.0)
    moment_limit_rad_s: float = key(0.1, "largest turning rate the moment loop may ask for [rad/s]", 0.001, 3.0)
    moment_tilt_limit_rad: float = key(
        math.radians(2.0), "how far the moment loop may tilt the tool from the planned axis [rad]", 0.0, 0.5
    )
    adaptive: AdaptiveConfig = field(default_factory=AdaptiveConfig)
    baselines: BaselinesConfig = field(default_factory=BaselinesConfig)


@dataclass(frozen=True)
class RobotConfig:
    """The velocity interface of the robot and its start."""

    command_latency_s: float = key(0.006, "from command to motion [s]", 0.0, 0.1)
    linear_acceleration_m_s2: float = key(1.2, "speedl tool acceleration [m/s^2]", 0.05, 20.0)
    angular_acceleration_rad_s2: float = key(6.0, "speedl tool angular acceleration [rad/s^2]", 0.05, 100.0)
    command_timeout_s: float = key(0.1, "a speedl command holds for this long, then the robot stops [s]", 0.002, 10.0)
    joint_speed_limit_rad_s: float = key(math.pi, "limit of every joint's speed [rad/s]", 0.01, 2 * math.pi)
    payload_error: float = key(0.0, "relative error of the payload mass the robot was told [-]", -0.9, 5.0)


@dataclass(frozen=True)
class SensorConfig:
    """The six-axis wrist sensor and what the host does with its reading."""

    force_noise_n: float = key(0.5, "white noise per sample, rms [N]", 0.0, 20.0)
    torque_noise_nm: float = key(0.02, "white noise per sample, rms [N m]", 0.0, 2.0)
    force_bias_n: float = key(3.0, "size of the seeded constant bias per axis [N]", 0.0, 100.0)
    torque_bias_nm: float = key(0.1, "size of the seeded constant bias per axis [N m]", 0.0, 10.0)
    force_drift_n_s: float = key(0.002, "drift per axis, rms after one second of its random walk [N/sqrt(s)]", 0.0, 1.0)
    torque_drift_nm_s: float = key(0.0001, "drift per axis [N m/sqrt(s)]", 0.0, 0.1)
    bandwidth_hz: float = key(80.0, "corner of the first-order low-pass, 0 = none [Hz]", 0.0, 490.0)
    rate_hz: float = key(1000.0, "sampling rate [Hz]", 10.0, 10000.0)
    latency_s: float = key(0.002, "from sample to reading [s]", 0.0, 0.1)
    force_quantum_n: float = key(0.02, "smallest step of the reading, 0 = none [N]", 0.0, 5.0)
    torque_quantum_nm: float = key(0.0005, "smallest step of the reading, 0 = none [N m]", 0.0, 0.5)
    force_range_n: float = key(200.0, "the reading saturates here, per axis [N]", 1.0, 1e5)
    torque_range_nm: float = key(8.0, "the reading saturates here, per axis [N m]", 0.1, 1e4)
    payload_mass_error: float = key(
        0.0, "relative error of the compensated tool mass, on top of the calibration's [-]", -1.0, 5.0
    )


@dataclass(frozen=True)
class PayloadConfig:
    """How the host learns mass and centre of the tool whose weight it compensates."""

    file: str = key(
        "",
        "calibration.toml of `calibrate payload`; empty = the tool is calibrated before the run from this sensor's "
        "readings at rest in the standard poses, the arm's way between them not simulated",
    )
    poses: int = key(12, "poses of the calibration", 4, 500)
    settle_s: float = key(0.5, "the arm stands still this long before it reads [s]", 0.05, 60.0)
    average_s: float = key(0.5, "readings are averaged over this time in each pose [s]", 0.005, 600.0)


@dataclass(frozen=True)
class HeadConfig:
    """The compliant head: a slide joint along the tool axis that carries the pad."""

    stiffness_n_m: float = key(20000.0 / 3.0, "spring [N/m]; in series with the pad 5000 N/m", 100.0, 1e6)
    damping_n_s_m: float = key(60.0, "damper [N s/m]", 0.0, 1e4)
    mass_kg: float = key(0.3, "sliding mass [kg]", 0.01, 10.0)
    travel_m: float = key(0.03, "travel to the end stop [m]", 0.001, 0.2)
    spring_scale: float = key(
        1.0, "real springs of head and pad by what plan and controller take them for [-]", 0.05, 20.0
    )


@dataclass(frozen=True)
class PadConfig:
    """The elastic pad (elastic foundation) and its friction."""

    radius_m: float = key(0.025, "pad radius [m]", 0.001, 0.2)
    stiffness_n_m: float = key(20000.0, "stiffness of the whole disc pressed flat [N/m]", 100.0, 1e7)
    points: int = key(100, "sample points of the disc, equal area each; rounded up to fours", 7, 2000)
    damping_s_m: float = key(3.0, "Hunt-Crossley factor a of f = k d (1 + a d_dot) [s/m]", 0.0, 100.0)
    friction: float = key(0.3, "Coulomb friction coefficient [-]", 0.0, 2.0)
    friction_smoothing_m_s: float = key(0.005, "sliding speed at which friction is developed to 71% [m/s]", 1e-5, 1.0)


@dataclass(frozen=True)
class SpindleConfig:
    """The spindle that turns the pad."""

    speed_rpm: float = key(6000.0, "speed, 0 = off [1/min]", 0.0, 60000.0)
    imbalance_m_s: float = key(0.0063, "balance grade e omega of what turns, G6.3 = 0.0063, 0 = none [m/s]", 0.0, 1.0)
    rotating_mass_kg: float = key(0.3, "what turns [kg]", 0.0, 10.0)


@dataclass(frozen=True)
class SafetyConfig:
    """When the simulated robot stops itself."""

    force_limit_n: float = key(50.0, "measured force at which the robot stops [N]", 1.0, 1e4)
    torque_limit_nm: float = key(10.0, "measured torque at which the robot stops [N m]", 0.1, 1e3)
    singular_value_limit: float = key(
        0.02, "smallest singular value of the Jacobian at which the robot stops [-]", 0.0, 1.0
    )
    contact_lost_s: float = key(2.0, "longest time without contact during the process [s]", 0.01, 1e6)
    sensor_timeout_s: float = key(0.02, "longest time an unchanged sensor reading is believed [s]", 0.002, 10.0)
    jump_limit_n: float = key(9.0, "largest jump of the sensor's reading within 5 ms, 0 = any [N]", 0.0, 1e4)
    offset_limit_m: float = key(0.005, "how far the surface may be from where it was planned [m]", 1e-4, 0.2)
    stop_latency_s: float = key(0.004, "from a protective stop to the brakes [s]", 0.0, 0.1)
    stop_deceleration_m_s2: float = key(4.0, "deceleration of a protective stop [m/s^2]", 0.1, 50.0)
    retract_speed_m_s: float = key(
        0.05, "speed at which the tool is taken off the part after a stop [m/s]", 0.001, 0.25
    )


@dataclass(frozen=True)
class FaultsConfig:
    """What goes wrong in the run, on purpose."""

    events: str = key(
        "", "NAME@TIME, ...: seconds from the start, or contact+TIME; 'polish-sim list faults' names them; empty = none"
    )


@dataclass(frozen=True)
class HandConfig:
    """The simulated hand that guides the arm: a spring and a damper to where it wants the tool point."""

    distance_m: float = key(0.3, "length of its minimum-jerk move, centred on the home pose [m]", 0.001, 0.5)
    stiffness_n_m: float = key(4000.0, "its spring [N/m]", 10.0, 1e5)
    damping_n_s_m: float = key(200.0, "its damper, on the difference of the speeds [N s/m]", 0.0, 5000.0)
    turn_stiffness_nm_rad: float = key(
        0.0, "how stiffly it holds the tool's orientation; 0: not [N m/rad]", 0.0, 1000.0
    )
    turn_damping_nm_s_rad: float = key(0.0, "how it damps the tool's turning [N m s/rad]", 0.0, 100.0)
    before_s: float = key(0.3, "it holds the tool still before the move [s]", 0.01, 60.0)
    after_s: float = key(0.5, "and after it [s]", 0.01, 60.0)
    off_s: float = key(60.0, "the last move's arm is then left to itself, drift is measured [s]", 0.0, 600.0)


@dataclass(frozen=True)
class GuideConfig:
    """The arm in torque mode, what its controller believes of it, its law of hand guiding and its limits."""

    mode: str = key("", "none, gravity, classical, inertia or assist; empty = each of them, side by side")
    direction: str = key("", "direction of the hand's move in the base frame: x or y; empty = each")
    duration_s: float = key(0.0, "duration of the hand's move; 0 = fast (0.6 s) and slow (1 s) [s]", 0.0, 60.0)
    coulomb_nm: tuple[float, ...] = key(
        (7.0, 7.0, 5.0, 1.5, 1.5, 1.5), "Coulomb friction of the joints, assumed [N m]", 0.0, 100.0, length=6
    )
    viscous_nm_s_rad: tuple[float, ...] = key(
        (10.0, 10.0, 8.0, 2.0, 2.0, 2.0), "viscous friction of the joints, assumed [N m s/rad]", 0.0, 100.0, length=6
    )
    creep_rad_s: tuple[float, ...] = key(
        (0.0017, 0.0021, 0.0044, 0.0083, 0.0086, 0.0117),
        "speed at which a joint creeps under its full Coulomb friction, believed half more than it is [rad/s]",
        1e-6, 1.0, length=6,
    )  # fmt: skip
    encoder_rad: float = key(5e-7, "step of the joint encoders, 17 bits a turn before a gear of 100 [rad]", 0.0, 0.01)
    payload_kg: float = key(0.0, "mass at the tool point nobody was told of [kg]", 0.0, 20.0)
    model_file: str = key("", "MJCF the controller takes for the arm (identified.xml); empty = the arm as it is")
    mass_scale: float = key(1.0, "believed masses, inertias and rotors by those of the model [-]", 0.1, 3.0)
    friction_scale: float = key(1.0, "believed friction by the true one [-]", 0.0, 3.0)
    tare: float = key(
        1.0, "share of the torque missing while the servos hold that is added later, 0 = none [-]", 0.0, 1.0
    )
    coulomb_share: float = key(0.95, "kc: share of the Coulomb friction compensated [-]", 0.0, 2.0)
    viscous_share: float = key(0.95, "kv: share of the viscous friction compensated [-]", 0.0, 2.0)
    sign_speed_rad_s: float = key(0.01, "vs of tanh(qd / vs) [rad/s]", 1e-4, 1.0)
    inertia_share: float = key(0.8, "alpha: share of the inertia compensated [-]", 0.0, 2.0)
    acceleration_filter_hz: float = key(40.0, "low-pass of the differenced speed [Hz]", 0.5, 400.0)
    observer_hz: float = key(8.0, "momentum observer of the start-up assist [Hz]", 0.1, 200.0)
    assist_share: float = key(0.9, "share of the Coulomb friction the assist takes at standstill [-]", 0.0, 1.0)
    assist_threshold: float = key(0.15, "push from which it takes all of that, by the joint's friction [-]", 0.01, 2.0)
    assist_memory_s: float = key(1.0, "a push that lasts this long without motion is no start [s]", 0.01, 60.0)
    hand_felt: float = key(
        0.04, "push from which the assist mode compensates at all, by the joint's friction, 0 = always [-]", 0.0, 2.0
    )
    joint_speed_limit_rad_s: float = key(math.pi, "protective stop; compensation fades from 90% on [rad/s]", 0.05, 10.0)
    tool_speed_limit_m_s: float = key(1.5, "protective stop; compensation fades from 90% on [m/s]", 0.05, 10.0)
    energy_limit_j: float = key(40.0, "protective stop: energy lent beyond believed friction losses [J]", 0.1, 1e4)


@dataclass(frozen=True)
class DualConfig:
    """Two robots, for the experiment dual: the master holds the part and moves, the follower works on it."""

    follower_pose: tuple[float, ...] = key(
        (-1.1, 0.0, 0.0, 0.0, 0.0, 3.0),
        "where the follower's base really stands in the master's: x, y, z [m], rotation vector [rad]",
        length=6,
    )
    pair: str = key("simulated", "the two robots, as their calibration names them")
    bases_file: str = key(
        "",
        "calibration.toml of `calibrate base`; empty = calibrated before the run with a simulated tracker",
    )
    tool_file: str = key(
        "", "calibration.toml of `calibrate tcp`; empty = calibrated before the run with simulated touches"
    )
    tracker_noise_m: float = key(3e-5, "noise of the simulated tracker per coordinate, rms [m]", 0.0, 0.01)
    touch_noise_m: float = key(5e-5, "noise of simulated touches per coordinate, rms [m]", 0.0, 0.01)
    marks: int = key(3, "marks around the part, touched to find it on the master's flange", 3, 100)
    master_speed_m_s: float = key(0.005, "speed of the part while it is worked on [m/s]", 0.0, 0.25)
    master_direction: tuple[float, ...] = key((0.0, 1.0, 0.0), "direction of that motion, base of the master", length=3)
    standoff_m: float = key(
        0.0, "the tool follows this far above the part and touches nothing, 0 = presses on it [m]", 0.0, 0.1
    )
    density_kg_m3: float = key(2700.0, "density of the part in the gripper [kg/m^3]", 1.0, 25000.0)


@dataclass(frozen=True)
class DragConfig:
    """A hand that drags the tool along a part in `run teach --follow`, and what is made of its recording."""

    follow: str = key(
        "", "rim: the border of the part's region, a pad's radius inside it; or a path's file; empty = paper 3's moves"
    )
    speed_m_s: float = key(0.05, "how fast the hand goes along it [m/s]", 0.001, 0.5)
    wander_m: float = key(0.0005, "slow wander of the hand, per axis, rms [m]", 0.0, 0.01)
    wander_hz: float = key(0.5, "below this frequency [Hz]", 0.01, 5.0)
    tremor_m: float = key(0.0001, "tremor of the hand from 8 to 12 Hz, per axis, rms [m]", 0.0, 0.005)
    wobble_rad: float = key(0.03, "slow wobble of the tool in the hand, per axis, rms [rad]", 0.0, 0.3)
    turn_stiffness_nm_rad: float = key(30.0, "how stiffly the hand holds the tool's orientation [N m/rad]", 0.0, 1000.0)
    turn_damping_nm_s_rad: float = key(10.0, "and damps its turning [N m s/rad]", 0.0, 100.0)
    filter_hz: float = key(4.0, "the recording is low-passed, both ways, at this frequency [Hz]", 0.1, 100.0)
    tolerance_m: float = key(0.0003, "it is simplified to straight lines within this distance: knots [m]", 1e-6, 0.05)
    spacing_m: float = key(0.002, "distance of the taught path's points [m]", 0.0002, 0.05)


@dataclass(frozen=True)
class SimulationConfig:
    """How the cell is stepped and recorded."""

    timestep_s: float = key(0.001, "physics step [s]", 1e-5, 0.01)
    control_every: int = key(1, "host controller runs every n-th step", 1, 50)
    log_rate_hz: float = key(250.0, "rows recorded per second, 0 = every step [Hz]", 0.0, 1e5)


@dataclass(frozen=True)
class Scenario:
    """One run, complete."""

    experiment: str = key("surface", "arc, force, surface, smooth, teach, dual or calibrate-payload")
    seed: int = key(0, "seed of everything random in the run", 0, 2**63 - 1)
    part: PartConfig = field(default_factory=PartConfig)
    plan: PlanConfig = field(default_factory=PlanConfig)
    process: ProcessConfig = field(default_factory=ProcessConfig)
    smoothing: SmoothingConfig = field(default_factory=SmoothingConfig)
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    payload: PayloadConfig = field(default_factory=PayloadConfig)
    head: HeadConfig = field(default_factory=HeadConfig)
    pad: PadConfig = field(default_factory=PadConfig)
    spindle: SpindleConfig = field(default_factory=SpindleConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    faults: FaultsConfig = field(default_factory=FaultsConfig)
    guide: GuideConfig = field(default_factory=GuideConfig)
    hand: HandConfig = field(default_factory=HandConfig)
    dual: DualConfig = field(default_factory=DualConfig)
    drag: DragConfig = field(default_factory=DragConfig)
    simulation: SimulationConfig = field(default_factory=SimulationConfig)
