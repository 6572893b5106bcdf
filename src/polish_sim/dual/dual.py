"""Experiment ``dual`` (paper 2): the master moves the part, the follower works on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from polish_sim.analysis.claim import shortfalls
from polish_sim.analysis.metrics import measure_removal, measure_surface
from polish_sim.arrays import Array, Figures, into_plane, norms, rms, unit
from polish_sim.cell import SILENT, CellRun, Observer, RealPart, Stroke, build_real_part
from polish_sim.cell.gears import build_host_arm
from polish_sim.config import Checked, Scenario
from polish_sim.control import build_controller
from polish_sim.dual import TOOL_ON_PART
from polish_sim.dual.cell import PairCell
from polish_sim.dual.frames import settled_bases
from polish_sim.dual.scene import Held, build_pair_scene, seat_note
from polish_sim.dual.task import DualTask, prepare_dual
from polish_sim.experiments.assembly import Workplace, course_for
from polish_sim.experiments.beliefs import NONE, believe_tool
from polish_sim.experiments.part_setup import (
    path_done,
    random_streams,
)
from polish_sim.experiments.result import RunResult, common_figures
from polish_sim.experiments.surface import areas_after, remove_material
from polish_sim.log import RunLog, Trace, with_column
from polish_sim.motion import forward
from polish_sim.planning import PlanResult
from polish_sim.planning.toolpath import interpolate
from polish_sim.spatial import apply, inverse, matrices, transform


def check_dual(scenario: Checked, plan: PlanResult | None = None, observer: Observer = SILENT) -> Workplace:
    """The path on the held part and how the follower reaches all of it; PolishSimError if it does not."""
    return prepare_dual(scenario, plan, observer).place


def run_dual(scenario: Checked, plan: PlanResult | None = None, observer: Observer = SILENT) -> RunResult:
    """Let the follower run along the part the master moves, pressing on it or, with ``dual.standoff_m``, just
    above it.

    The path is a plan made before, that of an even removal, else once around the part's rim. Raises
    PolishSimError if the part, a calibration or the placement cannot be used.
    """
    scenario = replace(scenario, dual=settled_bases(scenario.dual))
    task = prepare_dual(scenario, plan, observer)
    observer.stage("prepare the cell")
    pressing = scenario.dual.standoff_m == 0.0
    cell = build_dual_cell(scenario, task)
    observer.stage("simulate")
    run = cell.run(observer)
    path = task.place.path
    reach = task.place.reach
    turns = work_turns(run, task)
    errors = pair_errors(run.trace, task.strokes, reach.T_base_work, turns, pressing)
    figures: Figures = measure_pair(run.trace, errors, turns)
    log = run.log
    removal = None
    if pressing:
        force = measure_surface(run.trace, path, scenario.process.contact_force_n)
        figures |= {name: value for name, value in force.items() if name not in figures}
        turns = carried_turns(log, task, _part_on_flange(task, cell.part))
        removal, log = remove_material(task.place, cell, run, turns)
        figures |= measure_removal(removal, scenario.pad.radius_m)
        figures |= {} if plan is None else areas_after(plan, removal)
    figures |= {"chain_residual_m": task.residual, "placement_value": task.reach.value}
    figures["T_gripper_work"] = task.seat.T_gripper_work.tolist()
    figures |= common_figures(
        cell, run, path_done(path, run.trace.path_s_m[run.trace.fed]), reach.T_base_work
    )
    log = with_column(log, "relative_error_m", _at_rows(run, errors.relative))
    return RunResult(scenario, log, run.trace, figures, path, removal)


def build_dual_cell(scenario: Checked, task: DualTask) -> PairCell:
    """Set the cell up, not yet run: the scene from the true frames, the plan from the believed ones."""
    streams = random_streams(scenario.seed)
    place = task.place
    pressing = scenario.dual.standoff_m == 0.0
    scenario = scenario if pressing else replace(scenario, spindle=replace(scenario.spindle, speed_rpm=0.0))
    part = build_real_part(
        place.fields(place.shape, scenario), scenario.part, task.master.T_base_work, place.region.surface,
        place.mesh.up, streams.part,
    )  # fmt: skip
    true = task.frames.true
    held = Held(place.shape.mesh, scenario.dual.density_kg_m3, _part_on_flange(task, part), task.seat.nose)
    model = build_pair_scene(scenario, inverse(true.T_master_follower), held, task.arms.true)
    controller = build_controller(scenario.controller)
    q_start = np.ascontiguousarray(place.reach.q_start[None])
    q_start = task.arms.joints("follower", forward(q_start), q_start)[0]
    host_arm = build_host_arm(
        task.arms.believed["follower"], np.eye(4), task.frames.believed.T_flange_tool,
        task.arms.known["follower"],
    )  # fmt: skip
    cell = PairCell(
        task.master, host_arm, scenario, model, part, task.strokes, q_start, controller, streams.sensor,
        course_for(controller, scenario, place, task.strokes),
    )  # fmt: skip
    believe_tool(cell, streams.payload)
    return cell


def carried_turns(log: RunLog, task: DualTask, T_flange_carried: Array) -> Array:
    """How what the master carries, at (4, 4) on its flange, really stands in the follower's base at the log's
    rows, shape (n, 3, 3)."""
    flanges = task.arms.flanges("master", log["master_q_rad"])
    R_base_master = task.frames.true.T_master_follower[:3, :3].T
    return R_base_master @ flanges[:, :3, :3] @ T_flange_carried[:3, :3]


def work_turns(run: CellRun, task: DualTask) -> Array:
    """How the work frame really stands in the follower's base at the steps of the process, shape (n, 3,
    3)."""
    R = carried_turns(run.log, task, task.frames.true.T_flange_work)
    times = run.log["time_s"]
    wanted = run.trace.time_s[run.trace.fed]
    if len(times) < 2:
        return np.repeat(R[:1], len(wanted), axis=0)
    between = Slerp(times, Rotation.from_matrix(R))
    return between(np.clip(wanted, times[0], times[-1])).as_matrix() if len(wanted) else R[:0]


def _at_rows(run: CellRun, values: Array) -> Array:
    """Values of the steps of the process (k, 3) at the rows of the log, zero outside it, shape (n, 3)."""
    every = np.zeros((len(run.trace.time_s), 3))
    every[run.trace.fed] = values
    rows = np.searchsorted(run.trace.time_s, run.log["time_s"] - 1e-9)
    return every[np.minimum(rows, len(every) - 1)]


def _part_on_flange(task: DualTask, part: RealPart) -> Array:
    """The real part on the master's flange, where it is drawn, shape (4, 4)."""
    T_base_flange = inverse(task.frames.true.T_master_follower) @ task.arms.resting_flange(
        "master", task.master.q[0]
    )
    return inverse(T_base_flange) @ transform(part.rotation, part.position)


def pair_notes(figures: Figures, scenario: Scenario) -> Iterator[str]:
    """How the part was held in a run, and what would bring the tool nearer to its place on it."""
    yield seat_note(figures)
    robot = scenario.robot
    if shortfalls(TOOL_ON_PART, figures) and robot.elastic and robot.compensation == NONE:
        yield (
            "the tool misses its place on the part by what the gears of both arms err; a laser tracker "
            "finds that before the run with --set robot.compensation=tracker --set dual.closing_touches=36."
        )


# How well the tool follows the part.

SPEED_S = 0.05  #: Speeds are averages over this long, as those of the arc [s]
TURNS = 200  #: Turns of a run that are added up: more would add up the servos' trembling


class PairErrors(NamedTuple):
    """Errors at every step of the process, work frame."""

    tracking: Array  #: From the tool point to the target the host had at that moment [m], shape (n, 3)
    #: From where the tool is wanted on the part to where it really is on it [m], shape (n, 3)
    relative: Array


def pair_errors(
    trace: Trace, strokes: list[Stroke], T_base_work: Array, R_base_work: Array, pressing: bool
) -> PairErrors:
    """Errors of the process phase; while pressing the force decides the depth: errors along the tool axis do
    not count.

    ``strokes``: the part at its start, at ``T_base_work`` (4, 4); ``R_base_work``: how the work frame stands
    in the base of the robot with the tool then, shape (n, 3, 3).
    """
    part = trace.fed
    s = trace.path_s_m[part]
    places = np.concatenate([stroke.start_s + stroke.motion.places for stroke in strokes])
    T_work_base = inverse(T_base_work)
    points = apply(T_work_base, np.concatenate([stroke.motion.positions for stroke in strokes]))
    tracking = np.einsum("nij,ni->nj", R_base_work, trace.target_error_m[part])
    relative = trace.tool_on_part_m[part] - interpolate(s, places, points)
    if pressing:
        turns = matrices(np.concatenate([stroke.motion.quaternions for stroke in strokes]))
        axes = unit(interpolate(s, places, turns[:, :, 2] @ T_work_base[:3, :3].T))
        tracking, relative = (into_plane(e, axes) for e in (tracking, relative))
    return PairErrors(tracking, relative)


def measure_pair(trace: Trace, errors: PairErrors, R_base_work: Array) -> Figures:
    """Measure how the tool follows the moving part, over the whole process phase, its ramps included.

    Returns:
        tracking_error_max_m: largest distance from the target along x, y, z of the part (a list; while a
            force is controlled only across the tool axis that is wanted);
        tracking_error_worst_m: the largest of them;
        relative_error_rms_m, relative_error_p95_m, relative_error_max_m: of the distance between the tool on
            the part as it is and as wanted, calibration errors included, the part's own errors not (in
            contact across the tool axis);
        master_way_m: how far the part's origin was moved, from first to last;
        master_turn_rad: how far the part was turned, there and back counted;
        speed_mean_m_s, speed_std_m_s: of the tool point relative to the part, averaged over 50 ms.
    """
    if not len(errors.tracking):
        nothing = float("nan")
        return {"tracking_error_max_m": [nothing] * 3} | dict.fromkeys(
            ("tracking_error_worst_m", "relative_error_rms_m", "relative_error_p95_m", "relative_error_max_m",
             "master_way_m", "master_turn_rad", "speed_mean_m_s", "speed_std_m_s"), nothing,
        )  # fmt: skip
    tracking = np.abs(errors.tracking).max(axis=0)
    relative = norms(errors.relative)
    shift = trace.part_shift_m[trace.fed]
    speed = _speed(trace.time_s, trace.tool_on_part_m)[trace.fed]
    R = R_base_work[:: max(1, len(R_base_work) // TURNS)]
    turns = Rotation.from_matrix(np.swapaxes(R[:-1], 1, 2) @ R[1:])
    return {
        "tracking_error_max_m": tracking.tolist(),
        "tracking_error_worst_m": tracking.max(),
        "relative_error_rms_m": rms(relative),
        "relative_error_p95_m": np.percentile(relative, 95.0),
        "relative_error_max_m": relative.max(),
        "master_turn_rad": turns.magnitude().sum(),
        "master_way_m": np.linalg.norm(shift[-1] - shift[0]),
        "speed_mean_m_s": speed.mean(),
        "speed_std_m_s": speed.std(),
    }


def _speed(time: Array, points: Array) -> Array:
    """Speed of a point (n, 3) over ``SPEED_S`` around every time [s]: the servos' trembling is no way done,
    (n,)."""
    early, late = (np.clip(time + shift, time[0], time[-1]) for shift in (-0.5 * SPEED_S, 0.5 * SPEED_S))
    gone = interpolate(late, time, points) - interpolate(early, time, points)
    return norms(gone) / (late - early)
