"""The cell: robot, sensor, tool and safety, faults, and how it is simulated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polish_sim.arms import ARMS, FIRST, IDEAL
from polish_sim.config.key import (
    DIAMETER,
    HERTZ_OR_FULL,
    NEWTON,
    OUTPUT,
    PER_MINUTE,
    RUN,
    SENSOR,
    TOOL,
    Option,
    key,
)
from polish_sim.errors import ConfigError
from polish_sim.toml_text import read_toml

RIGID = 1e8  #: Stiffness of a gear that does not give [N m/rad]


def _joints(large: float, wrist: float, text: str, low: float, high: float) -> tuple[float, ...]:
    """A field of six numbers: three large joints and three of the wrist."""
    field: tuple[float, ...] = key((large,) * 3 + (wrist,) * 3, text, low, high, length=6)
    return field


@dataclass(frozen=True)
class RealArmConfig:
    """How a built arm differs from an ideal one; acts unless robot.arm = ideal. Sources: models/README.md."""

    stiffness_1_nm_rad: tuple[float, ...] = _joints(
        31e3, 4.7e3, "gears' torsional stiffness below knee 1; all three 1e8: rigid [N m/rad]", 100.0, RIGID
    )
    stiffness_2_nm_rad: tuple[float, ...] = _joints(50e3, 6.1e3, "between the knees [N m/rad]", 100.0, RIGID)
    stiffness_3_nm_rad: tuple[float, ...] = _joints(57e3, 7.1e3, "above knee 2 [N m/rad]", 100.0, RIGID)
    knee_1_nm: tuple[float, ...] = _joints(14.0, 2.0, "torque from which stiffness_2 holds [N m]", 0.01, 1e4)
    knee_2_nm: tuple[float, ...] = _joints(48.0, 6.9, "torque from which stiffness_3 holds [N m]", 0.01, 1e4)
    lost_motion_rad: tuple[float, ...] = _joints(
        2.9e-4, 2.9e-4, "width of the gears' hysteresis without torque, 0 = none [rad]", 0.0, 0.01
    )
    lost_motion_rise_rad: float = key(
        1e-4, "twist over which that hysteresis builds up again [rad]", 1e-6, 0.01
    )
    damping_nm_s_rad: tuple[float, ...] = _joints(20.0, 3.0, "gears' damping, 0 = none [N m s/rad]", 0.0, 1e4)
    rotor_kg_m2: tuple[float, ...] = _joints(1.7, 0.2, "rotor as felt behind its gear [kg m^2]", 0.01, 10.0)
    gear_ratio: float = key(
        101.0, "ratio of the gears; their error repeats twice a turn of the motor [-]", 1.0, 1000.0
    )
    gear_error_rad: tuple[float, ...] = _joints(
        2.9e-4, 4.4e-4, "gears' transmission error, peak to peak, 0 = none [rad]", 0.0, 0.01
    )
    second_harmonic: float = key(
        0.3, "largest share of the second harmonic in it, drawn by the seed [-]", 0.0, 1.0
    )
    viscous_nm_s_rad: tuple[float, ...] = key(
        (4.75, 10.73, 3.82, 2.95, 1.14, 1.88),
        "viscous friction of the warm motors, 0 = none [N m s/rad]",
        0.0,
        1e3,
        length=6,
    )
    coulomb_nm: tuple[float, ...] = _joints(
        5.0, 1.2, "their Coulomb friction without load, 0 = none [N m]", 0.0, 100.0
    )
    coulomb_driving: float = key(
        0.08, "more of it while the motor drives, by the gear's torque [-]", 0.0, 0.9
    )
    coulomb_driven: float = key(0.05, "more of it while the load drives, by the gear's torque [-]", 0.0, 0.9)
    cold_friction: float = key(0.1, "friction at the start above that of a warm arm, 0 = warm [-]", 0.0, 5.0)
    warming_s: float = key(1200.0, "time constant of the warming up [s]", 1.0, 1e6)
    encoder_rad: float = key(4e-6, "step of the encoders, 0 = none [rad]", 0.0, 0.01)
    servo_side: str = key(
        "motor",
        "encoders that control the position and that the host reads: motor or link",
        words=("motor", "link"),
    )
    link_servo_hz: float = key(0.3, "link: bandwidth of the correction by the encoders there [Hz]", 0.0, 5.0)
    servo_lag_s: float = key(0.002, "low-pass on the servos' set points, 0 = none [s]", 0.0, 0.1)
    kinematics: str = key(
        "calibrated",
        "table the host computes with: calibrated (with the weight acting), uncalibrated or exact",
        words=("calibrated", "uncalibrated", "exact"),
    )
    length_error_m: float = key(0.0005, "links as built, off the nominal table, rms [m]", 0.0, 0.01)
    angle_error_rad: float = key(0.001, "joint zeros and twists as built, rms [rad]", 0.0, 0.02)
    calibration_noise_m: float = key(
        5e-5, "of the points a calibration is made from, rms per axis [m]", 0.0, 0.01
    )
    calibration_poses: int = key(60, "poses of the calibration", 12, 1000)
    missed_every_s: float = key(
        60.0, "mean time between gaps in the link to the host, 0 = none [s]", 0.0, 1e6
    )
    missed_s: float = key(0.0056, "time between its packets then [s]", 0.001, 0.1)


ARM_PRESETS: Mapping[str, Mapping[str, Any]] = {
    IDEAL: {},
    **{name: {"real": arm.gears, "joint_speed_limit_rad_s": min(arm.speed)} for name, arm in ARMS.items()},
}
"""What each word of ``robot.arm`` stands for in [robot] and [robot.real], where it differs from the
defaults."""


@dataclass(frozen=True)
class RobotConfig:
    """The velocity interface of the robot and its start."""

    command_latency_s: float = key(0.006, "from command to motion [s]", 0.0, 0.1)
    linear_acceleration_m_s2: float = key(1.2, "speedl tool acceleration [m/s^2]", 0.05, 20.0)
    angular_acceleration_rad_s2: float = key(6.0, "speedl tool angular acceleration [rad/s^2]", 0.05, 100.0)
    command_timeout_s: float = key(
        0.1, "a speedl command holds for this long, then the robot stops [s]", 0.002, 10.0
    )
    joint_speed_limit_rad_s: float = key(math.pi, "limit of every joint's speed [rad/s]", 0.01, 2 * math.pi)
    payload_error: float = key(0.0, "relative error of the payload mass set in the robot [-]", -0.9, 5.0)
    arm: str = key(
        FIRST,
        f"{', '.join(ARMS)}: imperfect as [robot.real] says; {IDEAL}: the {FIRST} with rigid gears, exact "
        "encoders and table",
        presets=ARM_PRESETS,
    )
    compensation: str = key(
        "none",
        "what the host knows of how its arm is built: none, tracker (measured before the run) or the "
        "compensation.toml of a run",
    )
    real: RealArmConfig = RealArmConfig()

    @property
    def elastic(self) -> bool:
        """Whether its joints are."""
        return self.arm != IDEAL


SENSOR_MODELS: Mapping[str, Mapping[str, float]] = read_toml(
    Path(__file__).with_name("sensors.toml"), "table of sensors", ConfigError
)
"""What each word of ``sensor.model`` stands for, where it differs from the defaults; sources:
models/README.md."""


@dataclass(frozen=True)
class SensorConfig:
    """The six-axis wrist sensor and what the host does with its reading."""

    model: str = key(
        "external",
        "external, ur5e-built-in, axia80 or hex-125hz: stands for the values below; those set by name stay",
        presets=SENSOR_MODELS,
    )
    force_noise_n: float = key(
        0.5, "white noise per sample, rms [N]", 0.0, 20.0, option=Option("--noise", SENSOR, "N", NEWTON)
    )
    torque_noise_nm: float = key(0.02, "white noise per sample, rms [N m]", 0.0, 2.0)
    force_bias_n: float = key(3.0, "size of the seeded constant bias per axis [N]", 0.0, 100.0)
    torque_bias_nm: float = key(0.1, "size of the seeded constant bias per axis [N m]", 0.0, 10.0)
    force_drift_n_s: float = key(
        0.002, "drift per axis, rms after one second of its random walk [N/sqrt(s)]", 0.0, 1.0
    )
    torque_drift_nm_s: float = key(0.0001, "drift per axis [N m/sqrt(s)]", 0.0, 0.1)
    warm_up_force_n: float = key(
        0.0, "largest drift per axis while it warms up, drawn by the seed [N]", 0.0, 100.0
    )
    warm_up_torque_nm: float = key(0.0, "the same of the torques [N m]", 0.0, 10.0)
    warm_up_s: float = key(600.0, "time constant of the warming up [s]", 1.0, 1e6)
    bandwidth_hz: float = key(80.0, "corner of the first-order low-pass, 0 = none [Hz]", 0.0, 490.0)
    rate_hz: float = key(1000.0, "sampling rate [Hz]", 10.0, 10000.0)
    latency_s: float = key(0.002, "from sample to reading [s]", 0.0, 0.1)
    force_quantum_n: float = key(0.02, "smallest step of the reading, 0 = none [N]", 0.0, 5.0)
    torque_quantum_nm: float = key(0.0005, "smallest step of the reading, 0 = none [N m]", 0.0, 0.5)
    force_range_n: float = key(200.0, "the reading saturates here, per axis [N]", 1.0, 1e5)
    torque_range_nm: float = key(8.0, "the reading saturates here, per axis [N m]", 0.1, 1e4)
    cross_talk: float = key(
        0.0,
        "load on one axis that is read in another, shares of their ranges, rms, drawn by the seed [-]",
        0.0,
        0.2,
    )
    overload: float = key(
        0.0, "share of its range above which it is overloaded and the robot stops, 0 = never [-]", 0.0, 10.0
    )
    payload_mass_error: float = key(
        0.0, "relative error of the compensated tool mass, on top of the calibration's [-]", -1.0, 5.0
    )


@dataclass(frozen=True)
class PayloadConfig:
    """How the host learns mass and centre of the tool whose weight it compensates."""

    file: str = key(
        "",
        "calibration.toml of `calibrate payload`; empty = the tool is calibrated before the run from this "
        "sensor's readings at rest in the standard poses, the arm's way between them not simulated",
    )
    poses: int = key(12, "poses of the calibration", 4, 500, option=Option("--poses", SENSOR, "N"))
    settle_s: float = key(0.5, "the arm stands still this long before it reads [s]", 0.05, 60.0)
    average_s: float = key(0.5, "readings are averaged over this time in each pose [s]", 0.005, 600.0)


@dataclass(frozen=True)
class FlangeConfig:
    """An active flange: its loop holds the force of the slide at any stroke, and the arm follows the path."""

    bandwidth_hz: float = key(
        0.0, "of the loop on the force in the slide, 0 = a spring alone [Hz]", 0.0, 50.0
    )
    friction_n: float = key(2.0, "Coulomb friction of the slide [N]", 0.0, 50.0)
    start_force_n: float = key(5.0, "force before contact [N]", 0.0, 50.0)
    ramp_s: float = key(0.1, "from it to the force wanted, after contact [s]", 0.0, 5.0)
    weight_error: float = key(
        0.02, "relative error of the sliding weight, which it compensates by its inclination [-]", -1.0, 1.0
    )


@dataclass(frozen=True)
class HeadConfig:
    """The compliant head: a slide joint along the tool axis that carries the pad."""

    stiffness_n_m: float = key(20000.0 / 3.0, "spring [N/m]; in series with the pad 5000 N/m", 100.0, 1e6)
    damping_n_s_m: float = key(60.0, "damper [N s/m]", 0.0, 1e4)
    mass_kg: float = key(0.3, "sliding mass [kg]", 0.01, 10.0)
    travel_m: float = key(0.03, "travel to the end stop [m]", 0.001, 0.2)
    flange: FlangeConfig = FlangeConfig()
    spring_scale: float = key(
        1.0, "real springs of head and pad by what plan and controller take them for [-]", 0.05, 20.0
    )


#: Height of pad and backing plate in the model [m]; the plate is no wider than the pad
PAD_TOP = 0.022


@dataclass(frozen=True)
class PadConfig:
    """The elastic pad (elastic foundation) and its friction."""

    radius_m: float = key(
        0.025, "pad radius [m]", 0.001, 0.2, option=Option("--pad-diameter", TOOL, "MM", DIAMETER)
    )
    choice: str = key(
        "auto",
        "auto: a face narrower than the default pad gets one that fits and a step-over in proportion; "
        "stepover: with the step-over asked for; given: the pad is what radius_m says. A file or an option "
        "that names radius_m sets given, one that names plan.stepover_m sets stepover",
    )
    stiffness_n_m: float = key(20000.0, "stiffness of the whole disc pressed flat [N/m]", 100.0, 1e7)
    points: int = key(100, "sample points of the disc, equal area each; rounded up to fours", 7, 2000)
    damping_s_m: float = key(3.0, "Hunt-Crossley factor a of f = k d (1 + a d_dot) [s/m]", 0.0, 100.0)
    friction: float = key(0.3, "Coulomb friction coefficient [-]", 0.0, 2.0)
    friction_smoothing_m_s: float = key(
        0.005, "sliding speed at which friction is developed to 71% [m/s]", 1e-5, 100.0
    )
    slide_m_s: float = key(
        0.0,
        "speed at which all of the face slides beside the spindle's turning: of an orbit, or a belt [m/s]",
        0.0,
        100.0,
    )


@dataclass(frozen=True)
class SpindleConfig:
    """The spindle that turns the pad."""

    speed_rpm: float = key(
        6000.0,
        "speed of the spindle, 0 = off [1/min]",
        0.0,
        60000.0,
        option=Option("--spindle-rpm", TOOL, "RPM", PER_MINUTE),
    )
    imbalance_m_s: float = key(
        0.0063, "balance grade e omega of what turns, G6.3 = 0.0063, 0 = none [m/s]", 0.0, 1.0
    )
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
    sensor_timeout_s: float = key(
        0.02, "longest time an unchanged sensor reading is believed [s]", 0.002, 10.0
    )
    master_timeout_s: float = key(
        0.02,
        "two robots: longest time the host continues without news of the master's place [s]",
        0.002,
        10.0,
    )
    jump_limit_n: float = key(
        15.0, "largest jump of the force, seen through the sensor, 0 = any [N]", 0.0, 1e4
    )
    offset_limit_m: float = key(0.005, "how far the surface may be from where it was planned [m]", 1e-4, 0.2)
    stroke_margin: float = key(
        0.05, "share of an active flange's stroke left at either end as it stops, 0 = never [-]", 0.0, 0.4
    )
    tool_in_part: str = key(
        "refuse",
        "a path on which the tool runs into the part: refuse, before anything moves, or allow",
        words=("refuse", "allow"),
    )
    proof: str = key(
        "1",
        "a plan is played in the cell and mended before it is used: none, nominal (on the part as drawn), "
        "or a number of parts as well that seeds displace and bend",
        option=Option("--proof", RUN, "none|nominal|N"),
    )
    stop_latency_s: float = key(0.004, "from a protective stop to the brakes [s]", 0.0, 0.1)
    stop_deceleration_m_s2: float = key(4.0, "deceleration of a protective stop [m/s^2]", 0.1, 50.0)
    retract_speed_m_s: float = key(
        0.05, "speed at which the tool is taken off the part after a stop [m/s]", 0.001, 0.25
    )


@dataclass(frozen=True)
class FaultsConfig:
    """What goes wrong in the run, on purpose."""

    events: str = key(
        "",
        "faults as NAME@TIME, seconds from the start, or NAME@contact+TIME, with commas; 'polish-sim list "
        "faults' names them; empty = none",
        option=Option("--fault", RUN, "NAME@TIME", repeat=True),
    )


@dataclass(frozen=True)
class SimulationConfig:
    """How the cell is stepped and recorded."""

    timestep_s: float = key(0.001, "physics step [s]", 1e-5, 0.01)
    control_every: int = key(1, "host controller runs every n-th step", 1, 50)
    log_rate_hz: float = key(
        250.0,
        "rows recorded per second, 0 = every step [Hz]",
        0.0,
        1e5,
        option=Option("--log-rate", OUTPUT, "HZ|full", HERTZ_OR_FULL),
    )

    @property
    def log_every(self) -> int:
        """Steps from one row of the log to the next."""
        return max(1, round(1.0 / (self.log_rate_hz * self.timestep_s))) if self.log_rate_hz else 1
