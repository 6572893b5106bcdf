"""Section [simulation] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class SimulationConfig:
    """How the cell is stepped and recorded."""

    timestep_s: float = key(0.001, "physics step [s]", 1e-5, 0.01)
    control_every: int = key(1, "host controller runs every n-th step", 1, 50)
    log_rate_hz: float = key(250.0, "rows recorded per second, 0 = every step [Hz]", 0.0, 1e5)
