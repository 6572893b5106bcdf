"""Section [controller.baselines] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


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
