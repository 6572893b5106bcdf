"""A cell goes back to where it was saved, and runs on as if it had never been further."""

from dataclasses import replace

import numpy as np
import pytest

from polish_sim.cell import Cell
from polish_sim.cell.cell import CellRun, Played
from polish_sim.experiments import default_scenario, prepare_surface
from polish_sim.experiments.assembly import build_cell, build_part
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.proof_play import restore_cell, save_cell, use_strokes
from polish_sim.scenario_file import override
from tests.kept import plate_file

SHORT = (
    f"part.file={plate_file()}", "plan.stepover_m=0.05", "process.feed_m_s=0.06",
    "process.approach_speed_m_s=0.02", "simulation.log_rate_hz=0",
)  # fmt: skip


def cell(*changes: str, seed: int = 500) -> Cell:
    scenario = replace(override(default_scenario("surface"), [*SHORT, *changes]), seed=seed)
    place = prepare_surface(*planned(scenario))
    return build_cell(scenario, place, build_part(scenario, place))


def played(one: Cell, before: list[Played], piece: int) -> CellRun:
    """The run of a cell played before, and now in pieces to its end."""
    rest = []
    while not one.done:
        rest.append(one.play(piece))
    return one.result([*before, *rest])


@pytest.mark.parametrize(("controller", "arm"), [("hybrid-pi", "ideal"), ("hybrid-adaptive", "ur5e")])
def test_a_restored_cell_runs_on_as_if_it_had_never_been_cut(controller, arm):
    settings = (
        f"controller.name={controller}", f"robot.arm={arm}", "process.max_feed_s=2",
        "faults.events='sensor-noise@contact+1'", "process.changes='force_n=15@contact+0.7'",
    )  # fmt: skip
    whole, one = cell(*settings).run(), cell(*settings)
    assert whole.trace.phase.max() >= 2
    before = [one.play(1000), one.play(777)]
    saved = save_cell(one)
    same_bytes(played(one, before, 301), whole)
    restore_cell(one, saved)
    same_bytes(played(one, before, 500), whole)


def test_strokes_and_course_can_be_exchanged_on_the_way():
    """Exchanged for equal ones nothing changes; for slower ones the rest of the run takes longer."""
    one, runs = cell("controller.name=hybrid-adaptive", "process.max_feed_s=2"), []
    before = [one.play(3000)]
    saved = save_cell(one)
    slow = [s._replace(motion=s.motion._replace(rates=0.5 * s.motion.rates)) for s in one.strokes]
    for strokes in (None, one.strokes, slow):
        restore_cell(one, saved)
        if strokes is not None:
            use_strokes(one, strokes, one.course)
        runs.append(played(one, before, 500))
    same_bytes(runs[1], runs[0])
    fed, fed_slowly = (np.ptp(run.trace.path_s_m) for run in runs[1:])
    assert 0.5 < fed_slowly / fed < 0.75


def same_bytes(run: CellRun, other: CellRun) -> None:
    assert (run.stop_reason, run.safety) == (other.stop_reason, other.safety)
    assert run.trace.normal_force_n.tobytes() == other.trace.normal_force_n.tobytes()
    for name in ("q_rad", "wrench_measured_tool"):
        assert run.log[name].tobytes() == other.log[name].tobytes()


def test_ctrl_c_while_a_law_is_compiled_is_not_lost_in_compiled_code():
    class Law:
        @property
        def address(self) -> int:
            raise KeyboardInterrupt

    one = cell()
    one.controller.law = Law()
    with pytest.raises(KeyboardInterrupt):
        one.use_controller(one.controller)
