"""Section [head] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


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
