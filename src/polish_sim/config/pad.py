"""Section [pad] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class PadConfig:
    """The elastic pad (elastic foundation) and its friction."""

    radius_m: float = key(0.025, "pad radius [m]", 0.001, 0.2)
    stiffness_n_m: float = key(20000.0, "stiffness of the whole disc pressed flat [N/m]", 100.0, 1e7)
    points: int = key(100, "sample points of the disc, equal area each; rounded up to fours", 7, 2000)
    damping_s_m: float = key(3.0, "Hunt-Crossley factor a of f = k d (1 + a d_dot) [s/m]", 0.0, 100.0)
    friction: float = key(0.3, "Coulomb friction coefficient [-]", 0.0, 2.0)
    friction_smoothing_m_s: float = key(0.005, "sliding speed at which friction is developed to 71% [m/s]", 1e-5, 1.0)
