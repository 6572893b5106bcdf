"""Faults to inject into a run: each a small change of the running cell, at its time.

A fault is planned as ``NAME@TIME``, the time in seconds from the start of the run, or ``NAME@contact+TIME``
from the exact first contact. It happens before the first physics step at or after its time. Changes of a set
point (`set_points`) are planned as ``NAME=VALUE@TIME`` and happen on the same clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from polish_sim.cell.guards import MEASURED, NO_STOP
from polish_sim.cell.kernel import FORCE, SET_POINTS, CellKernel, CellState, SetPoints
from polish_sim.cell.robot import SENT, SHORT, STANDING
from polish_sim.config import ProcessConfig, Scenario
from polish_sim.errors import ConfigError, check_name, number_text
from polish_sim.tables import number_in

JUMP_N = 20.0
DRIFT_N_S = 3.0
PART_M = 0.010
SHAKE_M, SHAKE_HZ = 0.001, 5.0
LATENCY_S = 0.040
NOISE_TIMES, FRICTION_TIMES = 10.0, 2.0
NO_PART = "no part to press on"
_AWAY_M = 10.0  # where a missing part goes: out of reach


class FaultyCell(Protocol):
    """What a fault changes."""

    kernel: CellKernel
    fault_table: Mapping[str, Fault]
    set_points: SetPoints

    @property
    def state(self) -> CellState:
        """Of the kernel."""


Inject = Callable[[FaultyCell], None]


class Fault(NamedTuple):
    """Something that goes wrong."""

    text: str  #: What happens, one line
    inject: Inject  #: Makes it happen in a running cell
    on_part: bool = False  #: Whether it changes nothing without a part to press on
    lacking: str = ""  #: What is not there in cells of other experiments, which do not know it


def set_field(record: str, field: str, value: float) -> Inject:
    """Give a field of one of the cell's records a value."""
    return lambda cell: setattr(attrgetter(record)(cell), field, value)


def _bias(newton: float, cell: FaultyCell) -> None:
    cell.state.sensor.errors.bias[2] += newton


def _drift(cell: FaultyCell) -> None:
    cell.state.sensor.errors.creep[2] -= DRIFT_N_S * cell.state.sensor.period


def _sensor_noise(cell: FaultyCell) -> None:
    cell.state.sensor.errors.noise *= NOISE_TIMES


def _latency_jump(cell: FaultyCell) -> None:
    robot, room = cell.state.speedl, len(cell.kernel.requests.numbers) - 1
    robot.latency = min(robot.latency + round(LATENCY_S / cell.kernel.engine.dt), room)


def _part_missing(cell: FaultyCell) -> None:
    motion = cell.state.motion
    motion.shift = motion.goal = -_AWAY_M * motion.axis


def _lift(metres: float, cell: FaultyCell) -> None:
    cell.state.motion.goal += metres * cell.state.motion.axis


def _part_across(cell: FaultyCell) -> None:
    axis = cell.state.motion.axis
    across = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    cell.state.motion.goal += PART_M * across / np.linalg.norm(across)


def _part_loose(cell: FaultyCell) -> None:
    motion = cell.state.motion
    motion.amplitude, motion.frequency = SHAKE_M, 2.0 * math.pi * SHAKE_HZ
    motion.start = cell.state.status.steps * cell.kernel.engine.dt


def _friction_jump(cell: FaultyCell) -> None:
    cell.kernel.pad.material.friction *= FRICTION_TIMES


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        "sensor-dropout": Fault(
            "the wrist sensor's reading is missing (not a number)",
            set_field("state.sensor.errors", "reach", math.nan),
        ),
        "sensor-zeros": Fault(
            "the wrist sensor's reading is all zeros", set_field("state.sensor.errors", "reach", 0.0)
        ),
        "sensor-frozen": Fault(
            "the wrist sensor's reading no longer changes", set_field("state.sensor", "next", math.inf)
        ),
        "sensor-jump": Fault(
            f"the reading along the tool axis jumps by +{JUMP_N:g} N", partial(_bias, JUMP_N)
        ),
        "sensor-drop": Fault(
            f"the reading along the tool axis jumps by -{JUMP_N:g} N", partial(_bias, -JUMP_N)
        ),
        "sensor-drift": Fault(f"the reading along the tool axis drifts by -{DRIFT_N_S:g} N/s", _drift),
        "sensor-noise": Fault(f"the sensor's noise grows {NOISE_TIMES:g} times", _sensor_noise),
        "command-lost": Fault(
            "the host sends no more commands: speedl runs out by itself",
            set_field("state.status", "mute", True),
        ),
        "latency-jump": Fault(f"commands come {1e3 * LATENCY_S:g} ms later than before", _latency_jump),
        "controller-nan": Fault(
            "the controller's answer is not a number", set_field("state.status", "poisoned", True)
        ),
        "part-missing": Fault("the part is gone, at once", _part_missing, on_part=True),
        "part-high": Fault(
            f"the part rises by {1e3 * PART_M:g} mm along its normal, at 20 mm/s",
            partial(_lift, PART_M),
            on_part=True,
        ),
        "part-low": Fault(
            f"the part sinks by {1e3 * PART_M:g} mm along its normal, at 20 mm/s",
            partial(_lift, -PART_M),
            on_part=True,
        ),
        "part-shift": Fault(
            f"the part slips aside by {1e3 * PART_M:g} mm, at 20 mm/s", _part_across, on_part=True
        ),
        "part-loose": Fault(
            f"the part shakes along its normal, {1e3 * SHAKE_M:g} mm at {SHAKE_HZ:g} Hz",
            _part_loose,
            on_part=True,
        ),
        "spindle-stop": Fault(
            "the spindle's drive fails: it runs down in 0.5 s",
            set_field("state.spindle", "failed", True),
            on_part=True,
        ),
        "friction-jump": Fault(
            f"the pad's friction grows {FRICTION_TIMES:g} times", _friction_jump, on_part=True
        ),
    }
)


class FaultEvent(NamedTuple):
    """A fault, or a change of a set point, planned for a run."""

    name: str
    time: float  #: [s] from the start of the run, or from first contact
    after_contact: bool = False
    value: float | None = None  #: Of a set point [SI]; None: a fault

    def __str__(self) -> str:
        what = self.name if self.value is None else f"{self.name}={number_text(self.value)}"
        return f"{what}@{'contact+' if self.after_contact else ''}{self.time:.12g}"


def parse_events(text: str, known: Mapping[str, object] = FAULTS) -> tuple[FaultEvent, ...]:
    """Read ``NAME@TIME, NAME@contact+TIME, ...`` of ``known`` faults, or ``NAME=VALUE@TIME, ...`` of
    ``SET_POINTS``.

    Raises:
        InputError: A name is not known; lists the known ones.
        ConfigError: An entry is not written so.
    """
    return tuple(_parse_event(entry, known) for entry in filter(None, map(str.strip, text.split(","))))


def _parse_event(entry: str, known: Mapping[str, object]) -> FaultEvent:
    change = known is SET_POINTS
    kind, form, example = ("change", "NAME=VALUE", "force_n=25") if change else ("fault", "NAME", "part-high")
    what, _, when = entry.partition("@")
    name, equals, number = (word.strip() for word in what.partition("="))
    when = when.replace(" ", "")
    time = number_in(when.removeprefix("contact+"))
    if (equals and not change) or not 0.0 <= time < math.inf:
        raise ConfigError(
            f"the {kind} '{entry}' is not {form}@TIME: seconds from the start of the run, e.g. "
            f"{example}@3.5, or from first contact, e.g. {example}@contact+0.5."
        )
    check_name("set point" if change else kind, name, known)
    value = number_in(number) if change else None
    if value is not None and math.isnan(value):
        raise ConfigError(f"the change '{entry}' has no number for {name}, e.g. force_n=25@3.5.")
    return FaultEvent(name, time, when.startswith("contact+"), value)


def changed_force(process: ProcessConfig, force: float) -> float:
    """The most that is asked for along a path that asks at most for a ``force`` [N], changes included."""
    usual = process.contact_force_n
    changes = parse_events(process.changes, SET_POINTS)
    raised = [change.value or 0.0 for change in changes if change.name == FORCE]
    return force / usual * max([usual, *raised])


def check_events(
    faults: str, process: ProcessConfig, on_part: bool, own: Mapping[str, Fault], known: Mapping[str, Fault]
) -> None:
    """Refuse what is planned to happen and cannot, in a cell with ``own`` faults of all the ``known`` ones.

    Raises:
        PolishSimError: Naming the first that is not written as it should be, is out of range, or would change
            nothing without a part to press on, or is a fault of another experiment's cell.
    """
    for event in parse_events(faults, known) + parse_events(process.changes, SET_POINTS):
        kind, lacking = "fault" if event.value is None else "change", ""
        fault = known.get(event.name)
        if not on_part and (event.after_contact or event.name == FORCE or (fault and fault.on_part)):
            lacking = NO_PART
        elif fault and event.name not in own:
            lacking = fault.lacking
        if lacking:
            raise ConfigError(f"the {kind} '{event}' would change nothing: there is {lacking}. Leave it out.")
        most = math.inf if event.name == FORCE else process.feed_m_s
        if event.value is not None and not 0.0 < event.value <= most:
            raise ConfigError(
                f"the change '{event}' is out of range: {SET_POINTS[event.name]}, above 0"
                + (f", at most the planned {number_text(most)}." if math.isfinite(most) else ".")
            )


def as_planned(scenario: Scenario, events: Sequence[FaultEvent]) -> Scenario:
    """The scenario in which what somebody let happen during a run is planned: run again, it gives the same
    bytes."""
    faults, changes = ([str(e) for e in events if (e.value is None) == fault] for fault in (True, False))
    process, planned = scenario.process, scenario.faults
    return replace(
        scenario,
        faults=replace(planned, events=", ".join([*filter(None, [planned.events]), *faults])),
        process=replace(process, changes=", ".join([*filter(None, [process.changes]), *changes])),
    )


class FaultClock:
    """Injects the planned faults into a running cell and changes its set points, each at its step."""

    def __init__(self, events: tuple[FaultEvent, ...]) -> None:
        self.waiting = list(events)
        self.first_time: float | None = None
        """When the first fault happened [s]."""

    def inject_due(self, cell: FaultyCell) -> None:
        """Let everything happen that is due now."""
        dt, status = cell.kernel.engine.dt, cell.state.status
        now = float(status.steps) * dt
        for event in [e for e in self.waiting if self._time_of(e, cell.kernel) <= now + 0.5 * dt]:
            self.waiting.remove(event)
            if event.value is not None:
                cell.set_points.change(event.name, event.value, cell.kernel)
                continue
            cell.fault_table[event.name].inject(cell)
            self.first_time = now if self.first_time is None else self.first_time
        status.pause_at_contact = any(e.after_contact for e in self.waiting) and status.contact_time == 0.0

    def steps_to_next(self, cell: CellKernel, most: int) -> int:
        """Steps until the next fault whose time is known, at least one, no more than ``most``."""
        next_time = min((self._time_of(e, cell) for e in self.waiting), default=math.inf)
        if not math.isfinite(next_time):
            return most
        return min(most, max(1, math.ceil(next_time / cell.engine.dt - 1e-6) - int(cell.state.status.steps)))

    @staticmethod
    def _time_of(event: FaultEvent, cell: CellKernel) -> float:
        """When it happens [s]; infinite while the contact it waits for has not come."""
        contact = float(cell.state.status.contact_time)
        if event.after_contact:
            return contact + event.time if contact > 0.0 else math.inf
        return event.time


# Faults and guards of a run as figures.


class SafetyRecord(NamedTuple):
    """Times and ends; None where there was no stop, no fault or no retract."""

    fault_time_s: float | None  #: When the first fault was injected [s]
    faults_missed: tuple[str, ...]  #: Planned faults whose time did not come
    protective_stop_time_s: float | None = None  #: When the guard tripped [s]
    #: What it measured then, with its unit; None where there is no limit
    protective_stop_measured: str | None = None
    stop_delay_s: float | None = None  #: From then to the brakes [s]
    fault_to_stop_s: float | None = None  #: From that fault to the guard [s]; None if the stop came first
    #: Whether the tool was taken off as far as it should; None: nothing to retract from
    retracted: bool | None = None
    retract_m: float | None = None  #: How far it was taken [m]


def record_safety(cell: CellKernel, faults: FaultClock) -> SafetyRecord:
    """Read the record off a cell after its run."""
    first, missed = faults.first_time, tuple(map(str, faults.waiting))
    status, stop = cell.state.status, cell.state.stop
    if status.stop == NO_STOP:
        return SafetyRecord(first, missed)
    stopped, found = float(status.stop_time), float(cell.state.guards.found)
    measured = MEASURED.get(int(status.stop), "").format(found, 1e3 * found) or None
    braked = float(stop.braked_at) - stopped if stop.stage != SENT else math.nan
    since = None if first is None or first > stopped else stopped - first
    retracted = height = None
    if stop.clearance > 0.0:
        height = float(stop.height)
        retracted = bool(stop.stage == STANDING and height >= stop.clearance - SHORT)
    return SafetyRecord(first, missed, stopped, measured, braked, since, retracted, height)
