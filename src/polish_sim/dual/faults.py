"""Faults of a cell of two robots: those of one robot, and the master's."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from polish_sim.cell.faults import FAULTS, Fault, set_field

SLOW = 0.5

_MASTERS = {
    "master-stop": ("the master stops itself, as its own guards would", "halted", True),
    "master-silent": ("the host no longer receives the master's position", "unheard", True),
    "master-slow": (f"the master moves at {SLOW:g} of its speed", "slow", 1.0 - SLOW),
}

PAIR_FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        **FAULTS,
        **{
            name: Fault(
                text,
                set_field("master.state", field, value),
                lacking="no second robot: it is one of 'run dual'",
            )
            for name, (text, field, value) in _MASTERS.items()
        },
    }
)
