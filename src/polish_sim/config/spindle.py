"""Section [spindle] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class SpindleConfig:
    """The spindle that turns the pad."""

    speed_rpm: float = key(6000.0, "speed, 0 = off [1/min]", 0.0, 60000.0)
    imbalance_m_s: float = key(0.0063, "balance grade e omega of what turns, G6.3 = 0.0063, 0 = none [m/s]", 0.0, 1.0)
    rotating_mass_kg: float = key(0.3, "what turns [kg]", 0.0, 10.0)
