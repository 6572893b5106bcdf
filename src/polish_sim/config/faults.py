"""Section [faults] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class FaultsConfig:
    """What goes wrong in the run, on purpose."""

    events: str = key(
        "", "NAME@TIME, ...: seconds from the start, or contact+TIME; 'polish-sim list faults' names them; empty = none"
    )
