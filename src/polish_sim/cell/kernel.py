"""What the compiled loop works on: the engine's memory, the strokes' tables, one record of all that changes.

A cell is saved by it, to run on from there once more, and force and feed are set anew in it while it runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.contact import Flange, Pad, RealPart, Spindle
from polish_sim.cell.engine import EngineViews
from polish_sim.cell.guards import CrashPoints, Guards
from polish_sim.cell.real_part import PartMotion
from polish_sim.cell.robot import RequestLine, Speedl, StopMotion
from polish_sim.cell.stroke import Sequence, Stroke
from polish_sim.cell.wrist_sensor import Payload, WristSensor
from polish_sim.config import ProcessConfig
from polish_sim.control.signals import Answer, CompiledController, Measurement, Target
from polish_sim.kernels import Matrix6, Record, Vector3, Vector6, memory_of

if TYPE_CHECKING:
    from polish_sim.cell.cell import Cell
    from polish_sim.cell.faults import FaultEvent


class Status(Record):
    """How the run stands: written by the loop, read by its callers."""

    steps: int  #: Taken so far
    requests: int  #: Sent to the robot
    stop: int  #: Code of the protective stop, 0 for none, see ``guards.REASONS``
    stop_time: float  #: [s]
    touched: bool  #: After the exact first contact of the stroke
    contact_time: float  #: Of the run's first contact [s], 0 before
    blocked: bool  #: A joint is at its end
    arrived: bool  #: The stroke is done
    ended: bool  #: The run is over
    pause_at_contact: bool  #: Return at the run's first contact
    wait_from: int  #: Step count after which `advance` returns before the next call of the law; 0 = never
    waiting: bool  #: Returned so: the next step begins with the law
    python_error: bool  #: A controller in Python raised an error
    mute: bool  #: A fault: the host no longer sends
    poisoned: bool  #: A fault: the controller's answer is not a number
    tares: int  #: Samples the sensor is zeroed from
    spread: float  #: Sum of squares of their normal force [N^2]


class CellState(Record):
    """Everything of the cell that changes during a run and has a fixed size."""

    status: Status
    motion: PartMotion
    spindle: Spindle
    flange: Flange
    sensor: WristSensor
    payload: Payload
    speedl: Speedl
    sequence: Sequence
    guards: Guards
    stop: StopMotion
    measurement: Measurement
    target: Target
    answer: Answer  #: Of the controller
    wrench: Vector6  #: Exact wrench of the tool on the part, tool axes, tool point
    jacobian: Matrix6  #: Of the tool point at this instant
    tool_on_part: Vector3  #: Tool point in the nominal work frame of a part that is carried [m]
    scratch: Annotated[Array, (5, 3)]  #: Work array


class Lesson(NamedTuple):
    """What an earlier run along the same path learned."""

    slope: Array  #: Change of the tool's depth per arc length, at equal steps of it, shape (n,) [-]
    spacing: float  #: Arc length between rows [m]
    lead: float  #: From a command to the tool's motion [s]
    runs: int  #: Runs before this one, each learned from the one before


class LawMemory(NamedTuple):
    """What a control law gets pointers to, as bytes."""

    context: NDArray[np.uint8]  #: Gains and memory
    course: NDArray[np.uint8]  #: What lies ahead on the path, for laws that prepare for it
    measurement: NDArray[np.uint8]
    target: NDArray[np.uint8]
    answer: NDArray[np.uint8]


class CellKernel(NamedTuple):
    """Everything the compiled loop works on."""

    engine: EngineViews
    pad: Pad
    part: RealPart
    fixture: RealPart  #: What holds it; it stays where it stands
    stroke: Stroke
    crash_points: CrashPoints
    samples: Array  #: Of the wrist sensor, on their way to the host
    requests: RequestLine
    law: LawMemory
    lesson: Lesson
    control_every: int  #: Physics steps a control cycle
    state: CellState


_ENGINE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_LEARNED = ("learned", "known")  # what a law writes into the rows of its course


class CellSnapshot(NamedTuple):
    """A cell between two steps; it belongs to that cell, whatever strokes it then has."""

    stroke: int  #: Number of the one under way
    engine: Array  #: MuJoCo's state of integration
    memory: tuple[NDArray[Any], ...]  #: Records and lines of the cell, see `cell_memory`
    controller: Any  #: Memory of its law, or the attributes of a controller in Python
    learned: dict[str, NDArray[Any]]  #: What it learned along its course, by row
    rng: Any  #: State of the sensor's generator
    draws: Array  #: Numbers drawn and not yet used, shape (k, 12)
    waiting: tuple[FaultEvent, ...]  #: Faults and changes to come
    asked: tuple[FaultEvent, ...]
    first_fault: float | None
    set_points: dict[str, float]
    touched: str | None


def cell_memory(cell: Cell) -> list[NDArray[Any]]:
    """What a cell's compiled loop remembers outside the engine's state and the law's memory."""
    k = cell.kernel
    records = [
        k.state,
        k.pad.material,
        cell.recorder.filled,
        cell.real_arm,
    ]
    return [
        *map(memory_of, records),
        k.samples,
        *k.requests,
        k.part.position,
        k.part.rotation,
        k.engine.speeds_before,
        k.engine.sensordata,
        k.engine.dof_damping,
    ]


def save_cell(cell: Cell) -> CellSnapshot:
    """Copy what changes while a cell runs; between two calls of `Cell.play`."""
    controller = cell.controller
    memory: Any
    course: Any = None
    if isinstance(controller, CompiledController):
        memory = _memory_of_law(controller).copy()
        course = controller.course
    else:
        memory = deepcopy(vars(controller))
    names = () if course is None else course.dtype.names or ()
    engine = np.empty(mujoco.mj_stateSize(cell.model, _ENGINE))
    mujoco.mj_getState(cell.model, cell.data, engine, _ENGINE)
    return CellSnapshot(
        cell.stroke_number, engine, tuple(array.copy() for array in cell.memory()), memory,
        {name: course[name].copy() for name in _LEARNED if name in names}, cell.rng.bit_generator.state,
        cell.draws.copy(), tuple(cell.faults.waiting), tuple(cell.asked), cell.faults.first_time,
        dict(cell.set_points.now), cell.touched,
    )  # fmt: skip


def restore_cell(cell: Cell, saved: CellSnapshot) -> None:
    """Bring a cell back to where it was saved; its strokes and its course stay those it has now."""
    controller = cell.controller
    if isinstance(controller, CompiledController):
        _memory_of_law(controller)[...] = saved.controller
        for name, values in saved.learned.items():
            rows = min(len(values), len(controller.course))
            controller.course[name] = 0
            controller.course[name][:rows] = values[:rows]
    else:
        vars(controller).update(deepcopy(saved.controller))
    cell.rng.bit_generator.state = saved.rng
    cell.draws, cell.touched, cell.asked = saved.draws.copy(), saved.touched, list(saved.asked)
    cell.faults.waiting[:], cell.faults.first_time = saved.waiting, saved.first_fault
    cell.set_points.now.update(saved.set_points)
    cell.begin_stroke(saved.stroke)
    _write(cell, saved)
    # What follows from the state, for those who look on; the loop computes it again.
    mujoco.mj_forward(cell.model, cell.data)
    _write(cell, saved)


def _write(cell: Cell, saved: CellSnapshot) -> None:
    mujoco.mj_setState(cell.model, cell.data, saved.engine, _ENGINE)
    for array, values in zip(cell.memory(), saved.memory, strict=True):
        array[...] = values


def _memory_of_law(controller: CompiledController) -> NDArray[np.void]:
    """The memory of a compiled law, the same memory, shape ()."""
    return np.asarray(controller.context)["memory"]  # type: ignore[no-any-return]


FORCE, FEED = "force_n", "feed_m_s"
SET_POINTS: Mapping[str, str] = MappingProxyType(
    {FORCE: "force to hold along the tool axis [N]", FEED: "speed along the path [m/s]"}
)


class SetPoints:
    """What the host holds now, as shares of what was planned.

    A path that plans its own forces or feeds keeps their proportions. The feed can only be lowered: a motion
    is planned at the fastest its limits allow. Position and depth of the target stay as planned; the force
    loop takes up the rest.
    """

    def __init__(self, process: ProcessConfig) -> None:
        self._usual = {FORCE: process.contact_force_n, FEED: process.feed_m_s}
        self.now = dict(self._usual)
        self._planned: Stroke

    def begin(self, stroke: Stroke) -> Stroke:
        """A stroke as it is to be run: tables of its own, scaled to the set points."""
        self._planned = stroke
        motion = stroke.motion
        own = stroke._replace(force=stroke.force.copy(), motion=motion._replace(rates=motion.rates.copy()))
        self._scale(own)
        return own

    def change(self, name: str, value: float, cell: CellKernel) -> None:
        """Set a set point [SI] from the next step on.

        At another force the springs are pressed in further or less: as after landing, the guard that watches
        where the surface is waits until the force is held before it knows the new depth.
        """
        before = float(cell.stroke.force[0])
        self.now[name] = value
        self._scale(cell.stroke)
        guards = cell.state.guards
        change = float(cell.stroke.force[0]) - before
        if change != 0.0 and self._planned.depth > 0.0:
            guards.depth += min(self._planned.depth / float(self._planned.force[0]) * change, 0.0)
            guards.holding, guards.was_held = 0.0, False

    def _scale(self, stroke: Stroke) -> None:
        force, feed = (self.now[name] / self._usual[name] for name in (FORCE, FEED))
        stroke.force[:] = self._planned.force * force
        stroke.motion.rates[:] = self._planned.motion.rates * feed
