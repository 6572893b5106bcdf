"""Cost of one closed-loop step beside a bare step of the same model in the same state."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from numba import njit

from benchmarks.table import Row
from polish_sim.cell import Cell
from polish_sim.cell.engine import mj_step1, mj_step2
from polish_sim.cell.guards import NO_STOP
from polish_sim.cell.kernel import CellKernel
from polish_sim.cell.loop import advance
from polish_sim.cell.recorder import build_recorder
from polish_sim.cell.stroke import FEEDING
from polish_sim.dual.cell import advance_pair
from polish_sim.dual.dual import build_dual_cell
from polish_sim.dual.task import prepare_dual
from polish_sim.experiments import default_scenario
from polish_sim.experiments.surface import prepare_force

STEPS, CHUNK, ROUNDS = 20_000, 500, 7  # a run without pictures goes by as many steps at a time
_ENGINE = ctypes.CDLL(str(next(Path(mujoco.__file__).parent.glob("libmujoco*"))))
# MuJoCo's binding has its steps timed by it, our loop has not
_CLOCK = ctypes.c_void_p.in_dll(_ENGINE, "mjcb_time")
_TIMED = _CLOCK.value
PAIR_START, PAIR_STEPS = 9000, 4000
"""Two robots press and move from here on; steps a round, so that the path is long enough."""


@njit(cache=True)
def _bare_steps(model: int, data: int, steps: int) -> None:
    for _ in range(steps):
        mj_step1(model, data)
        mj_step2(model, data)


def measure() -> Iterator[Row]:
    """Median over interleaved rounds of bare and closed-loop steps."""
    yield from measure_pair()
    for name, controller in (
        ("hybrid-pi", "hybrid-pi"),
        ("hybrid-adaptive", "hybrid-adaptive"),
        ("hybrid-pi as a Python class", "wrapped"),
    ):
        cell = _pressing_cell(controller)
        bare, untimed, loop = _interleaved(cell)
        yield Row(f"{name}: bare mj_step", f"{bare:.2f} us", "")
        yield Row(f"{name}: closed loop", f"{loop:.2f} us", "")
        limit = {"hybrid-pi": "1.6", "hybrid-adaptive": "1.9"}.get(controller, "-")
        yield Row(f"{name}: ratio", f"{loop / bare:.2f}", limit)
        yield Row(f"{name}: ratio to a bare step without the engine's timers", f"{loop / untimed:.2f}", "-")
        scaled = (loop - bare) * 4.5 / bare
        yield Row(
            f"{name}: above bare, scaled to bare = 4.5 us",
            f"{scaled:.2f} us",
            "7 us" if limit != "-" else "-",
        )
    bare, _, loop = _interleaved(_pressing_cell("hybrid-pi", "ur5e"), _pressing_cell("hybrid-pi"))
    yield Row("hybrid-pi on the elastic arm: over a bare step of the ideal one", f"{loop / bare:.2f}", "2.0")


def measure_pair() -> Iterator[Row]:
    """A step of two robots, one moving the part, beside a step of one; CPU time, interleaved."""
    single = _pressing_cell("hybrid-pi")
    one = single.kernel._replace(stroke=single.strokes[0]._replace(hold=np.inf))
    _go_on(one)
    scenario = default_scenario("dual")
    pair = build_dual_cell(scenario, prepare_dual(scenario))
    lone, both_of = build_recorder(CHUNK, 4), build_recorder(CHUNK, 4, pair.row)

    arms = pair.real_arm, pair.master_arm, pair.host_arm

    def step_one() -> None:
        advance(one, single.real_arm, lone, single.rng.standard_normal((CHUNK, 12)), CHUNK)

    def step_both() -> None:
        draws = pair.rng.standard_normal((CHUNK, 12))
        advance_pair(pair.kernel, *arms, pair.master, both_of, draws, CHUNK)

    for _ in range(PAIR_START // CHUNK):
        step_both()
    spent = []
    for _ in range(ROUNDS):
        for step in (step_one, step_both):
            begin = time.process_time()
            for _ in range(PAIR_STEPS // CHUNK):
                step()
            spent.append(time.process_time() - begin)
    if pair.state.status.stop or not pair.state.wrench[2] > 1.0:
        raise RuntimeError("the benchmark's two robots lost contact: the figure would mean nothing")
    alone, both = float(np.median(spent[::2])), float(np.median(spent[1::2]))
    yield Row("two robots: closed loop", f"{1e6 * both / PAIR_STEPS:.2f} us", "")
    yield Row("two robots: over the loop of one", f"{both / alone:.2f}", "2.2")


def _pressing_cell(controller: str, arm: str = "ideal") -> Cell:
    """A cell that has come into contact and holds on."""
    scenario = default_scenario("force")
    law = "hybrid-pi" if controller == "wrapped" else controller
    scenario = replace(
        scenario,
        process=replace(scenario.process, hold_s=1.0),
        controller=replace(scenario.controller, name=law),
        robot=replace(scenario.robot, arm=arm),
    )
    cell = prepare_force(scenario)[1]
    if controller == "wrapped":
        cell.use_controller(_Wrapped(cell.controller))
    cell.run()
    return cell


class _Wrapped:
    """Hides that a controller is compiled, so that the loop calls back into Python each cycle."""

    def __init__(self, controller: object) -> None:
        self._step: Callable[..., object] = controller.step  # type: ignore[attr-defined]
        self._reset: Callable[..., object] = controller.reset  # type: ignore[attr-defined]

    def reset(self, cycle_s: float) -> None:
        self._reset(cycle_s)

    def step(self, measurement: object, target: object) -> object:
        return self._step(measurement, target)


def _go_on(kernel: CellKernel) -> None:
    """Back into the process after the stroke's end."""
    status = kernel.state.status
    status.stop, status.arrived, kernel.state.sequence.stage = NO_STOP, False, FEEDING


def _interleaved(cell: Cell, other: Cell | None = None) -> tuple[float, float, float]:
    """Median cost of a bare step, of one without timers and of a closed-loop step [us].

    Bare steps are those of the ``other`` cell if given.
    """
    resting = other or cell
    kernel = cell.kernel._replace(stroke=cell.strokes[0]._replace(hold=np.inf))
    _go_on(kernel)
    recorder = build_recorder(CHUNK, 4)
    bare_data = mujoco.MjData(resting.model)
    bare_data.qpos[:], bare_data.ctrl[:] = resting.data.qpos, resting.data.ctrl
    bare_data.xfrc_applied[:] = resting.data.xfrc_applied
    bare, untimed, loop = [], [], []
    for _ in range(ROUNDS):
        for clock, spent in ((_TIMED, bare), (None, untimed)):
            _CLOCK.value = clock
            begin = time.perf_counter()
            _bare_steps(resting.kernel.engine.model, bare_data._address, STEPS)
            spent.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        for _ in range(STEPS // CHUNK):
            advance(kernel, cell.real_arm, recorder, cell.rng.standard_normal((CHUNK, 12)), CHUNK)
        loop.append(time.perf_counter() - begin)
    if kernel.state.status.stop or not kernel.state.wrench[2] > 1.0:
        raise RuntimeError("the benchmark's cell lost contact: the figure would mean nothing")
    return tuple(1e6 * float(np.median(spent)) / STEPS for spent in (bare, untimed, loop))  # type: ignore[return-value]
