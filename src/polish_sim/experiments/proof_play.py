"""One play of a path in the cell under limits that leave a margin: where it fails, and states to resume from.

The guards get limits tighter by the margin, so that a part that is displaced and bent as the scenario draws
it runs too. A failure is a guard that comes nearer to its limit than that, or an exact force that leaves its
band.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.metrics import force_shares
from polish_sim.arrays import Array, diagonal_of
from polish_sim.cell import Observer
from polish_sim.cell import guards as guard
from polish_sim.cell.cell import Cell
from polish_sim.cell.guards import NO_STOP, forget_shares, guard_shares
from polish_sim.cell.stroke import FEEDING, Stroke, cycle_time
from polish_sim.config import Checked, FaultsConfig
from polish_sim.control.signals import CompiledController, Course
from polish_sim.experiments.assembly import Workplace, build_cell, course_for, strokes_for
from polish_sim.experiments.rows import most_astray
from polish_sim.experiments.surface import remove_material
from polish_sim.log import PROCESS_PHASE, RemovalMap

MARGIN = 0.2
"""Share of a guard's limit that the nominal part leaves, for other noise and for parts as they are drawn."""
DRAWN_MARGIN = 0.1  #: The same on a part that is displaced and bent
#: Times as much as in the proof the gears of another seed shake the arm at the same place
SHAKEN = 1.4
CHUNK_S = 0.5  #: Simulated time between looks; what is slowed reaches as far (`AROUND_S`) [s]
SETTLED_M = 1e-3  #: Of a stroke on which the force may settle [m]
#: Share of the limit of the surface's place that is kept, however the part is drawn
LEAST_OFFSET = 0.4
BAND, ASTRAY = "force error", "tangential error"
SAVE_EVERY_S = 2.0  #: Simulated time between saved states [s]
SAVED = 12  #: States kept; with the beginnings of strokes
DYNAMIC = (guard.JUMP, guard.FORCE, guard.TORQUE, guard.OVERLOAD, guard.SPINDLE)
"""Guards that a slower feed keeps quiet."""
OFFSETS = (guard.HIGH, guard.LOW, guard.RISEN, guard.FALLEN)  #: Guards of the surface's place


class Failure(NamedTuple):
    """Where a plan fails."""

    why: str
    s: float  #: Arc length of the plan [m]
    code: int  #: Of the guard; `NO_STOP` where the force left its band
    landing: bool  #: Before the feed of a stroke began
    off: float = 0.0  #: How far the force was off, where it left its band [N]


class _Saved(NamedTuple):
    """A state to resume from."""

    s: float  #: Everything of the path up to here has been played [m]
    pieces: int  #: That were played up to here
    state: CellSnapshot


class Play:
    """A path under way on one part: as drawn, or as a seed draws it.

    Raises:
        PolishSimError: As of `build_cell`.
    """

    def __init__(self, usual: Checked, seed: int | None, place: Workplace) -> None:
        part, nominal = usual.part, seed is None
        if nominal:
            part = replace(
                part, real_file="", displacement_m=0.0, rotation_rad=0.0, form_error_m=0.0, motion_m=0.0
            )
        process = replace(usual.process, changes="", learn="")
        seed = usual.seed if seed is None else seed
        self.usual = usual
        self.scenario = replace(usual, part=part, process=process, faults=FaultsConfig(), seed=seed)
        self.nominal, self.margin = nominal, MARGIN if nominal else DRAWN_MARGIN
        self.passing: dict[str, tuple[float, float]] = {}  #: Largest shares of the limits, and where
        self.worked_s, self.wanted = 0.0, True
        self.found: list[Failure] = []  #: What has to be mended before it can continue
        self._timed: list[Stroke] = []
        self._saved: list[_Saved] = []
        self._begin(place)

    def _begin(self, place: Workplace) -> None:
        """A cell at the start of a path, its guards' limits tightened."""
        self.place = place
        self.cell = build_cell(self.scenario, place, strokes=self._strokes())
        self._tighten()
        # Kernels are compiled here, not by two threads at once.
        self.pieces = [self.cell.play(1)]

    def _strokes(self) -> list[Stroke]:
        """The strokes of the path; to time a motion takes about as long as to play it."""
        known = {id(stroke.motion) for stroke in self._timed}
        self._timed = strokes_for(self.scenario, self.place)
        self.worked_s += sum(
            stroke.motion.playing_time for stroke in self._timed if id(stroke.motion) not in known
        )
        return self._timed

    def _tighten(self) -> None:
        """Leave the margin to every limit; to the surface's place on the drawing, what the part may be off
        it."""
        guards, part, path = self.cell.state.guards, self.usual.part, self.place.path
        kept = 1.0 - self.margin
        guards.contact_lost, guards.singular_value = kept * guards.contact_lost, guards.singular_value / kept
        extent = diagonal_of(path.in_contact.positions)
        # From where the force is first held: how far the part lies off there counts no more.
        drawn = part.rotation_rad * extent + part.form_error_m
        less = drawn if self.nominal else self.margin * guards.offset
        guards.offset = max(guards.offset - less, LEAST_OFFSET * guards.offset)

    def removal(self) -> RemovalMap:
        """What was taken off the part up to here."""
        run = self.cell.result(self.pieces)
        return remove_material(self.place, self.cell, run)[0]

    def go_back(self, place: Workplace, until: float) -> None:
        """Resume a path as it is mended now, from the last state before ``until`` [m] of the path."""
        self._saved[:] = [state for state in self._saved if state.s <= until]
        if not self._saved:
            # The path may begin elsewhere now, and the sensor is zeroed there with the arm at rest.
            self._begin(place)
            return
        self.place, cell, scenario = place, self.cell, self.scenario
        del self.pieces[self._saved[-1].pieces :]
        strokes = self._strokes()
        course = course_for(cell.controller, scenario, place, strokes)
        use_strokes(cell, strokes, course, self._saved[-1].state)
        sequence, motion = cell.state.sequence, cell.kernel.stroke.motion
        if sequence.stage == FEEDING:
            # The motion may have been timed anew: the clock is that of the place.
            sequence.clock = np.interp(
                sequence.s, motion.places, np.arange(len(motion.places)) * motion.spacing
            )

    def play_on(self, observer: Observer) -> list[Failure]:
        """Play on to the end, until it is not ``wanted`` any more, or to where the path has to be mended.

        All of that is looked for to the end of the stroke or to a stop. States are saved on the way to the
        first failure.
        """
        cell, saved = self.cell, self._saved
        total, dt = cycle_time(cell.strokes), cell.kernel.engine.dt
        status, next_save, stroke = cell.state.status, 0.0, cell.stroke_number
        found = self.found = list[Failure]()
        while self.wanted and not cell.done and not (found and cell.stroke_number != stroke):
            forget_shares(cell.state.guards)
            self.pieces.append(cell.play(round(CHUNK_S / dt)))
            steps = self.pieces[-1].trace
            self.worked_s += len(steps) * dt
            t = status.steps * dt
            observer.progress(min(t, total), total)
            failure = self._failure(steps)
            self._keep_shares()
            if failure is not None:
                found.append(failure)
                if status.stop != NO_STOP:
                    break
                stroke = cell.stroke_number
            elif not found and (t >= next_save or status.arrived):
                saved.append(_Saved(_done_until(cell), len(self.pieces), save_cell(cell)))
                next_save = t + SAVE_EVERY_S
                del saved[:-SAVED]
        return found

    def _failure(self, steps: NDArray[np.void]) -> Failure | None:
        """What went wrong in the steps just played, if anything: the exact force left its band, a guard came
        nearer to its limit than the margin allows, or one tripped."""
        cell, s, force = self.cell, steps["path_s_m"], steps["normal_force_n"]
        status, path, usual = cell.state.status, self.place.path, self.scenario.process.contact_force_n
        wanted = path.force_at(s, usual)
        fed = steps["phase"] == PROCESS_PHASE
        # After landing the force has the first millimetre of the feed to settle.
        held = fed & (s > cell.kernel.stroke.start_s + SETTLED_M)
        ever, often = force_shares(force, wanted, path.largest_force(usual), held)
        used = np.maximum(SHAKEN * ever, often)
        astray = np.where(fed, steps["tangential_error_m"], 0.0) / most_astray(self.scenario.robot)
        for name, shares in ((BAND, used), (ASTRAY, astray)):
            self._note(name, float(shares.max()), float(s[shares.argmax()]))
        stage, at = cell.state.sequence.stage, float(cell.state.target.s)
        if status.stop != NO_STOP:
            return Failure(self._reason(int(status.stop)), at, int(status.stop), stage < FEEDING)
        beyond = np.flatnonzero(used > 1.0 - self.margin)
        if len(beyond):
            k = beyond[0]
            said = f"the force leaves its band: {force[k]:.1f} N of {wanted[k]:.3g} N asked"
            return Failure(said, float(s[k]), NO_STOP, not fed[k], abs(wanted[k] - force[k]))
        near = guard_shares(cell.state.guards)
        for name, most in self._most().items():
            if near[name].share > most:
                code = guard.SHARES[name]
                return Failure(self._reason(code), near[name].at_m, code, stage < FEEDING)
        return None

    def _reason(self, code: int) -> str:
        return self.cell.reasons[code].partition(":")[0].partition(" (")[0]

    def _most(self) -> dict[str, float]:
        """Largest shares of their limits that are allowed to the guards a slower feed keeps quiet."""
        kept, limit = 1.0 - self.margin, self.scenario.safety.force_limit_n
        asked = self.place.path.largest_force(self.scenario.process.contact_force_n)
        return {
            "force": (asked + kept * (limit - asked)) / limit,
            "torque": kept,
            "reading jumped": kept / SHAKEN,
        }

    def _note(self, name: str, share: float, at_m: float) -> None:
        if share > self.passing.get(name, (-1.0, 0.0))[0]:
            self.passing[name] = share, at_m

    def _keep_shares(self) -> None:
        """Keep how near the guards came to the scenario's limits."""
        safety, guards = self.scenario.safety, self.cell.state.guards
        limits = dict.fromkeys(OFFSETS, float(guards.offset) / safety.offset_limit_m)
        limits[guard.LOST] = float(guards.contact_lost) / safety.contact_lost_s
        limits[guard.SINGULAR] = safety.singular_value_limit / float(guards.singular_value)
        for name, (share, at_m) in guard_shares(guards).items():
            self._note(name, share * limits.get(guard.SHARES[name], 1.0), at_m)


def _done_until(cell: Cell) -> float:
    """Arc length of the plan up to which a change would not have changed what was played [m]."""
    sequence, stroke = cell.state.sequence, cell.kernel.stroke
    return stroke.start_s + (sequence.s if sequence.stage >= FEEDING else 0.0)


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


def save_cell(cell: Cell) -> CellSnapshot:
    """Copy what changes while a cell runs without a fault or a stop; between two calls of `Cell.play`."""
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
    cell.draws, cell.touched = saved.draws.copy(), None
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


def use_strokes(cell: Cell, strokes: Sequence[Stroke], course: Course | None, saved: CellSnapshot) -> None:
    """Continue from where a cell was saved with other strokes on the same part, and their ``course`` for a
    controller that prepares for it.

    The one under way is replaced by that of its number; its time and place are kept.
    """
    cell.strokes = tuple(strokes)
    cell.course = course
    if course is not None and isinstance(cell.controller, CompiledController):
        cell.use_controller(cell.controller)
    restore_cell(cell, saved)
