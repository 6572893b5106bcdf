"""Everything that changes while a cell runs, saved to run on from there once more."""

from __future__ import annotations

from copy import deepcopy
from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.faults import FaultEvent
from polish_sim.control.signals import CompiledController
from polish_sim.kernels import memory_of

if TYPE_CHECKING:
    from polish_sim.cell.cell import Cell

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
