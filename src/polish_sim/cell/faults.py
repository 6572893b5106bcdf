"""Faults to inject into a run: each a small change of the running cell, at its time.

A fault is planned as ``NAME@TIME``, the time in seconds from the start of the run, or ``NAME@contact+TIME`` from the
exact first contact. It happens before the first physics step at or after its time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from polish_sim.cell.carrier import HALTED, UNHEARD, WANTED_PACE
from polish_sim.cell.contact import DRIVE
from polish_sim.cell.kernel import CLOCK, CONTACT_TIME, MUTE, PAUSE, POISON, STOP, STOP_TIME, CellKernel
from polish_sim.cell.protective_stop import BRAKED_AT, HEIGHT, SENT, SHORT, STAGE, STANDING
from polish_sim.cell.wrist_sensor import NEXT
from polish_sim.errors import ConfigError, unknown_name

JUMP_N = 20.0
DRIFT_N_S = 3.0
PART_M = 0.010
SHAKE_M, SHAKE_HZ = 0.001, 5.0
LATENCY_S = 0.040
SLOW = 0.5
NOISE_TIMES, FRICTION_TIMES = 10.0, 2.0
_AWAY_M = 10.0  # where a missing part goes: out of reach

Inject = Callable[[CellKernel], CellKernel]


class Fault(NamedTuple):
    """Something that goes wrong."""

    text: str
    """What happens, one line."""
    inject: Inject
    """Makes it happen in a running cell."""
    on_part: bool = False
    """Whether it changes nothing without a part to press on."""
    on_master: bool = False
    """Whether it changes nothing without a second robot that carries the part."""


def _sensor_dropout(cell: CellKernel) -> CellKernel:
    return cell._replace(sensor=cell.sensor._replace(reach=math.nan))


def _sensor_zeros(cell: CellKernel) -> CellKernel:
    return cell._replace(sensor=cell.sensor._replace(reach=0.0))


def _sensor_frozen(cell: CellKernel) -> CellKernel:
    cell.sensor_state.clock[NEXT] = math.inf
    return cell


def _bias(newton: float) -> Inject:
    def inject(cell: CellKernel) -> CellKernel:
        cell.sensor.bias[2] += newton
        return cell

    return inject


def _creep(newton_per_second: float) -> Inject:
    def inject(cell: CellKernel) -> CellKernel:
        cell.sensor.creep[2] += newton_per_second * cell.sensor.period
        return cell

    return inject


def _sensor_noise(cell: CellKernel) -> CellKernel:
    return cell._replace(sensor=cell.sensor._replace(noise=NOISE_TIMES * cell.sensor.noise))


def _command_lost(cell: CellKernel) -> CellKernel:
    cell.status[MUTE] = 1.0
    return cell


def _latency_jump(cell: CellKernel) -> CellKernel:
    more = round(LATENCY_S / cell.engine.dt)
    room = cell.speedl_state.line.shape[0] - 1
    return cell._replace(speedl=cell.speedl._replace(latency=min(cell.speedl.latency + more, room)))


def _controller_nan(cell: CellKernel) -> CellKernel:
    cell.status[POISON] = 1.0
    return cell


def _part_missing(cell: CellKernel) -> CellKernel:
    cell.motion.shift[:] = cell.motion.goal[:] = -_AWAY_M * cell.motion.axis
    return cell


def _part_along(metres: float) -> Inject:
    def inject(cell: CellKernel) -> CellKernel:
        cell.motion.goal[:] += metres * cell.motion.axis
        return cell

    return inject


def _part_across(cell: CellKernel) -> CellKernel:
    axis = cell.motion.axis
    across = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    cell.motion.goal[:] += PART_M * across / np.linalg.norm(across)
    return cell


def _part_loose(cell: CellKernel) -> CellKernel:
    cell.motion.swing[:] = SHAKE_M, 2.0 * math.pi * SHAKE_HZ, cell.status[CLOCK] * cell.engine.dt
    return cell


def _spindle_stop(cell: CellKernel) -> CellKernel:
    cell.spindle.state[DRIVE] = 0.0
    return cell


def _friction_jump(cell: CellKernel) -> CellKernel:
    return cell._replace(pad=cell.pad._replace(friction=FRICTION_TIMES * cell.pad.friction))


def _master(entry: int, value: float) -> Inject:
    def inject(cell: CellKernel) -> CellKernel:
        cell.carrier.clock[entry] = value
        return cell

    return inject


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        "sensor-dropout": Fault("the wrist sensor's reading is missing (not a number)", _sensor_dropout),
        "sensor-zeros": Fault("the wrist sensor's reading is all zeros", _sensor_zeros),
        "sensor-frozen": Fault("the wrist sensor's reading no longer changes", _sensor_frozen),
        "sensor-jump": Fault(f"the reading along the tool axis jumps by +{JUMP_N:g} N", _bias(JUMP_N)),
        "sensor-drop": Fault(f"the reading along the tool axis jumps by -{JUMP_N:g} N", _bias(-JUMP_N)),
        "sensor-drift": Fault(f"the reading along the tool axis drifts by -{DRIFT_N_S:g} N/s", _creep(-DRIFT_N_S)),
        "sensor-noise": Fault(f"the sensor's noise grows {NOISE_TIMES:g} times", _sensor_noise),
        "command-lost": Fault("the host sends no more commands: speedl runs out by itself", _command_lost),
        "latency-jump": Fault(f"commands come {1e3 * LATENCY_S:g} ms later than before", _latency_jump),
        "controller-nan": Fault("the controller answers what is no number", _controller_nan),
        "part-missing": Fault("the part is gone, at once", _part_missing, on_part=True),
        "part-high": Fault(
            f"the part rises by {1e3 * PART_M:g} mm along its normal, at 20 mm/s", _part_along(PART_M), on_part=True
        ),
        "part-low": Fault(
            f"the part sinks by {1e3 * PART_M:g} mm along its normal, at 20 mm/s", _part_along(-PART_M), on_part=True
        ),
        "part-shift": Fault(f"the part slips aside by {1e3 * PART_M:g} mm, at 20 mm/s", _part_across, on_part=True),
        "part-loose": Fault(
            f"the part shakes along its normal, {1e3 * SHAKE_M:g} mm at {SHAKE_HZ:g} Hz", _part_loose, on_part=True
        ),
        "spindle-stop": Fault("the spindle's drive fails: it runs down in 0.5 s", _spindle_stop, on_part=True),
        "friction-jump": Fault(f"the pad's friction grows {FRICTION_TIMES:g} times", _friction_jump, on_part=True),
        "master-stop": Fault("the master stops itself, as its own guards would", _master(HALTED, 1.0), on_master=True),
        "master-silent": Fault("the host no longer hears where the master is", _master(UNHEARD, 1.0), on_master=True),
        "master-slow": Fault(f"the master moves at {SLOW:g} of its speed", _master(WANTED_PACE, SLOW), on_master=True),
    }
)


class FaultEvent(NamedTuple):
    """A fault planned for a run."""

    name: str
    time: float
    """[s] from the start of the run, or from first contact."""
    after_contact: bool = False

    def __str__(self) -> str:
        return f"{self.name}@{'contact+' if self.after_contact else ''}{self.time:g}"


def parse_events(text: str) -> tuple[FaultEvent, ...]:
    """Read ``NAME@TIME, NAME@contact+TIME, ...``.

    Raises:
        InputError: A fault is not known; lists the known ones.
        ConfigError: An entry is not NAME@TIME.
    """
    return tuple(_parse_event(entry.strip()) for entry in text.split(",") if entry.strip())


def check_events(events: tuple[FaultEvent, ...], on_part: bool, two_robots: bool = False) -> None:
    """Refuse faults that would change nothing.

    Args:
        events: The planned faults.
        on_part: Whether there is a part to press on.
        two_robots: Whether a second robot carries the part.

    Raises:
        ConfigError: Naming the first such fault.
    """
    for event in events:
        lacking = ""
        if not on_part and (FAULTS[event.name].on_part or event.after_contact):
            lacking = "no part to press on"
        if not two_robots and FAULTS[event.name].on_master:
            lacking = "no second robot: it is one of 'run dual'"
        if lacking:
            raise ConfigError(f"the fault '{event}' would change nothing: there is {lacking}. Leave it out.")


def _parse_event(entry: str) -> FaultEvent:
    name, at, when = entry.partition("@")
    name, when = name.strip(), when.replace(" ", "")
    after_contact = when.startswith("contact+")
    try:
        time = float(when.removeprefix("contact+"))
    except ValueError:
        time = math.nan
    if not at or not (math.isfinite(time) and time >= 0.0):
        raise ConfigError(
            f"the fault '{entry}' is not NAME@TIME: seconds from the start of the run, e.g. sensor-frozen@3.5, or from "
            "first contact, e.g. sensor-frozen@contact+0.5."
        )
    if name not in FAULTS:
        raise unknown_name("fault", name, FAULTS)
    return FaultEvent(name, time, after_contact)


class FaultClock:
    """Injects the planned faults into a running cell, each at its step."""

    def __init__(self, events: tuple[FaultEvent, ...]) -> None:
        self.waiting = list(events)
        self.first_time: float | None = None
        """When the first fault happened [s]."""

    def inject_due(self, cell: CellKernel) -> CellKernel:
        """The cell with every fault that is due now."""
        dt = cell.engine.dt
        now = float(cell.status[CLOCK]) * dt
        for event in [e for e in self.waiting if self._time_of(e, cell) <= now + 0.5 * dt]:
            self.waiting.remove(event)
            cell = FAULTS[event.name].inject(cell)
            self.first_time = now if self.first_time is None else self.first_time
        cell.status[PAUSE] = float(any(e.after_contact for e in self.waiting) and cell.status[CONTACT_TIME] == 0.0)
        return cell

    def steps_to_next(self, cell: CellKernel, most: int) -> int:
        """Steps until the next fault whose time is known, at least one, no more than ``most``."""
        next_time = min((self._time_of(e, cell) for e in self.waiting), default=math.inf)
        if not math.isfinite(next_time):
            return most
        return min(most, max(1, math.ceil(next_time / cell.engine.dt - 1e-6) - int(cell.status[CLOCK])))

    @staticmethod
    def _time_of(event: FaultEvent, cell: CellKernel) -> float:
        """When it happens [s]; infinite while the contact it waits for has not come."""
        contact = float(cell.status[CONTACT_TIME])
        if event.after_contact:
            return contact + event.time if contact > 0.0 else math.inf
        return event.time


# What came of the faults and guards of a run, as figures.


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
