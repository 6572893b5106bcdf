"""Section [hand] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


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
