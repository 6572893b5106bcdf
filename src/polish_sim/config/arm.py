"""The arm as it really is: gears, friction, encoders, kinematics, servo and link to the host."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key

RIGID = 1e8  #: Stiffness of a gear that does not give [N m/rad]


def _joints(large: float, wrist: float, text: str, low: float, high: float) -> tuple[float, ...]:
    """A field of six numbers: three large joints and three of the wrist."""
    field: tuple[float, ...] = key((large,) * 3 + (wrist,) * 3, text, low, high, length=6)
    return field


@dataclass(frozen=True)
class RealArmConfig:
    """How a UR5e differs from an ideal arm; acts with robot.arm = ur5e. Sources: models/README.md."""

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
    lost_motion_rise_rad: float = key(1e-4, "twist over which that hysteresis builds up again [rad]", 1e-6, 0.01)
    damping_nm_s_rad: tuple[float, ...] = _joints(20.0, 3.0, "gears' damping, 0 = none [N m s/rad]", 0.0, 1e4)
    rotor_kg_m2: tuple[float, ...] = _joints(1.7, 0.2, "rotor as felt behind its gear [kg m^2]", 0.01, 10.0)
    gear_ratio: float = key(100.0, "ratio of the gears; their error repeats twice a turn of the motor [-]", 1.0, 1000.0)
    gear_error_rad: tuple[float, ...] = _joints(
        2.9e-4, 4.4e-4, "gears' transmission error, peak to peak, 0 = none [rad]", 0.0, 0.01
    )
    second_harmonic: float = key(0.3, "largest share of the second harmonic in it, drawn by the seed [-]", 0.0, 1.0)
    viscous_nm_s_rad: tuple[float, ...] = key(
        (4.75, 10.73, 3.82, 2.95, 1.14, 1.88), "viscous friction of the warm motors, 0 = none [N m s/rad]", 0.0, 1e3,
        length=6
    )  # fmt: skip
    coulomb_nm: tuple[float, ...] = _joints(5.0, 1.2, "their Coulomb friction without load, 0 = none [N m]", 0.0, 100.0)
    coulomb_driving: float = key(0.10, "more of it while the motor drives, by the gear's torque [-]", 0.0, 0.9)
    coulomb_driven: float = key(0.05, "more of it while the load drives, by the gear's torque [-]", 0.0, 0.9)
    cold_friction: float = key(0.1, "friction at the start above that of a warm arm, 0 = warm [-]", 0.0, 5.0)
    warming_s: float = key(1200.0, "time constant of the warming up [s]", 1.0, 1e6)
    encoder_rad: float = key(4e-6, "step of the encoders, 0 = none [rad]", 0.0, 0.01)
    servo_side: str = key("motor", "encoders the position is controlled by and the host hears of: motor or link")
    link_servo_hz: float = key(0.3, "link: bandwidth of the correction by the encoders there [Hz]", 0.0, 5.0)
    servo_lag_s: float = key(0.002, "low-pass on the servos' set points, 0 = none [s]", 0.0, 0.1)
    kinematics: str = key(
        "calibrated", "table the host computes with: calibrated (with the weight acting), uncalibrated or exact"
    )
    length_error_m: float = key(0.0005, "links as built, off the nominal table, rms [m]", 0.0, 0.01)
    angle_error_rad: float = key(0.001, "joint zeros and twists as built, rms [rad]", 0.0, 0.02)
    calibration_noise_m: float = key(5e-5, "of the points a calibration is made from, rms per axis [m]", 0.0, 0.01)
    calibration_poses: int = key(60, "poses of the calibration", 12, 1000)
    missed_every_s: float = key(60.0, "mean time between gaps in the link to the host, 0 = none [s]", 0.0, 1e6)
    missed_s: float = key(0.0056, "time between its packets then [s]", 0.001, 0.1)
