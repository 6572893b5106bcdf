"""Section [guide] of the scenario (layer 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from polish_sim.config.key import key


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
