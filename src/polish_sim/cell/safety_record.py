"""What came of the faults and guards of a run, as figures (layer 8a)."""

from __future__ import annotations

import math
from typing import NamedTuple

from polish_sim.cell.faults import FaultClock
from polish_sim.cell.kernel import STOP, STOP_TIME, CellKernel
from polish_sim.cell.protective_stop import BRAKED_AT, HEIGHT, SENT, SHORT, STAGE, STANDING


class SafetyRecord(NamedTuple):
    """Times and ends; None where there was no stop, no fault or no retract."""

    protective_stop_time_s: float | None
    """When the guard spoke [s]."""
    stop_delay_s: float | None
    """From then to the brakes [s]."""
    fault_time_s: float | None
    """When the first fault was injected [s]."""
    fault_to_stop_s: float | None
    """From that fault to the guard [s]; None if the stop came first."""
    retracted: bool | None
    """Whether the tool was taken off as far as it should; None if nothing was to be retracted from."""
    retract_m: float | None
    """How far it was taken [m]."""
    faults_missed: tuple[str, ...]
    """Planned faults whose time did not come."""


def record_safety(cell: CellKernel, faults: FaultClock) -> SafetyRecord:
    """Read the record off a cell after its run."""
    missed = tuple(str(event) for event in faults.waiting)
    if cell.status[STOP] == 0.0:
        return SafetyRecord(None, None, faults.first_time, None, None, None, missed)
    stopped, state = float(cell.status[STOP_TIME]), cell.stop.state
    braked = float(state[BRAKED_AT]) - stopped if state[STAGE] != SENT else math.nan
    since = None if faults.first_time is None or faults.first_time > stopped else stopped - faults.first_time
    due = cell.stop.clearance > 0.0
    back = state[STAGE] == STANDING and bool(state[HEIGHT] >= cell.stop.clearance - SHORT)
    return SafetyRecord(
        stopped, braked, faults.first_time, since, back if due else None, float(state[HEIGHT]) if due else None, missed
    )
