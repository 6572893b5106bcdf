"""Section [safety] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


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
    master_timeout_s: float = key(
        0.02, "two robots: longest time the host goes on without hearing where the master is [s]", 0.002, 10.0
    )
    jump_limit_n: float = key(9.0, "largest jump of the sensor's reading within 5 ms, 0 = any [N]", 0.0, 1e4)
    offset_limit_m: float = key(0.005, "how far the surface may be from where it was planned [m]", 1e-4, 0.2)
    stop_latency_s: float = key(0.004, "from a protective stop to the brakes [s]", 0.0, 0.1)
    stop_deceleration_m_s2: float = key(4.0, "deceleration of a protective stop [m/s^2]", 0.1, 50.0)
    retract_speed_m_s: float = key(
        0.05, "speed at which the tool is taken off the part after a stop [m/s]", 0.001, 0.25
    )
