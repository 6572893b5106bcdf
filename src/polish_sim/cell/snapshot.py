"""A cell saved while it runs, to run on from there once more, on the same strokes or on others."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.cell import Cell
from polish_sim.cell.faults import FaultEvent
from polish_sim.cell.stroke import Stroke
from polish_sim.control.signals import CompiledController, Course

_ENGINE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_LEARNED = ("learned", "known")  # what a law writes into the rows of its course


class CellSnapshot(NamedTuple):
    """A cell between two steps; it belongs to that cell, whatever strokes it then has."""

    stroke: int  #: Number of the one under way
    engine: Array  #: MuJoCo's state of integration
    memory: tuple[NDArray[Any], ...]  #: Records and lines of the cell, see `Cell.memory`
    controller: Any  #: Memory of its law, or the attributes of a controller in Python
    learned: dict[str, NDArray[Any]]  #: What it learned along its course, by row
    rng: Any  #: State of the sensor's generator
    draws: Array  #: Numbers drawn and not yet used, shape (k, 12)
    waiting: tuple[FaultEvent, ...]  #: Faults and changes to come
    asked: tuple[FaultEvent, ...]
    first_fault: float | None
    set_points: dict[str, float]
    touched: str | None


def save_cell(cell: Cell) -> CellSnapshot:
    """Copy what changes while a cell runs; between two calls of `Cell.play`."""
    controller, learned = cell.controller, dict[str, NDArray[Any]]()
    memory: Any
    if isinstance(controller, CompiledController):
        memory, course = _memory_of_law(controller).copy(), controller.course
        learned = {name: course[name].copy() for name in _LEARNED if name in (course.dtype.names or ())}
    else:
        memory = deepcopy(vars(controller))
    engine = np.empty(mujoco.mj_stateSize(cell.model, _ENGINE))
    mujoco.mj_getState(cell.model, cell.data, engine, _ENGINE)
    return CellSnapshot(
        cell.stroke_number, engine, tuple(array.copy() for array in cell.memory()), memory,
        learned, cell.rng.bit_generator.state, cell.draws.copy(),
        tuple(cell.faults.waiting), tuple(cell.asked), cell.faults.first_time,
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


def use_strokes(cell: Cell, strokes: Sequence[Stroke], course: Course | None = None) -> None:
    """Continue with other strokes on the same part, and their ``course`` for a controller that prepares for
    it.

    The one under way is replaced by that of its number; its time and place are kept.
    """
    cell.strokes = tuple(strokes)
    cell.course = course
    cell.begin_stroke(min(cell.stroke_number, len(cell.strokes) - 1))
    if course is not None and isinstance(cell.controller, CompiledController):
        saved = save_cell(cell)
        cell.use_controller(cell.controller)
        restore_cell(cell, saved)
