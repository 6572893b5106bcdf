"""Teach to polish: a hand drags the tool along a part, its recording becomes a path: filtered, fitted, put
on the part."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import splev, splprep
from scipy.signal import butter, sosfilt, sosfiltfilt
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation, RotationSpline

from polish_sim.arrays import Array, Figures, chord_lengths, dots, foot_on_chord, norms, rms, unit
from polish_sim.cell import SILENT, Observer, tool_on_flange
from polish_sim.config import Checked, DragConfig, HandConfig, SimulationConfig
from polish_sim.errors import PlanError
from polish_sim.exchange import path_csv, read_path
from polish_sim.experiments.free_space import free_log
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.result import RunResult
from polish_sim.geometry import PartMesh, Surface, fit_surface, select_region
from polish_sim.geometry.surface import ClosestPoints
from polish_sim.hand_guiding.arm import believe_arm, guided_arm, hand_of, torque_arm
from polish_sim.hand_guiding.cell import HandMotion, run_guided
from polish_sim.hand_guiding.teach import (
    HELD,
    HOLD_S,
    MOVING,
    RELEASE_S,
    MoveTable,
    PlayedMove,
    TaughtMove,
    figures_of_moves,
    move_columns,
    run_teach,
    servos_hold,
    trace_of_move,
)
from polish_sim.identification.excitation import ramped
from polish_sim.motion import forward
from polish_sim.planning.moves.travel import move_in, path_of
from polish_sim.planning.part_plan import load_mesh
from polish_sim.planning.toolpath import PROCESS, ToolPath, arc_length, interpolate
from polish_sim.spatial import apply, inverse

DEGREE = 3
MOVING_SHARE = 0.2  #: A hand slower than this share of its usual speed has not begun, or has ended [-]
SHORTEST_M = 0.01  #: Less way than this teaches nothing [m]
#: The recording is fitted at places this far apart, so that a slow hand does not weigh more [m]
EVEN_M = 0.0005


class Taught(NamedTuple):
    """A path that was taught."""

    path: ToolPath
    knots: int  #: Of the fit
    off_surface: float  #: Largest distance by which the fitted way was moved onto the part [m]


def teach_path(
    t: Array, positions: Array, surface: Surface, filter_hz: float, tolerance: float, spacing: float
) -> Taught:
    """Make a path, all of it process, from a recording.

    Args:
        t: Times of the recording, evenly spaced [s], shape (n,).
        positions: The tool point then, work frame [m], shape (n, 3); hardly moved: PlanError.
        surface: The part it was shown on: points are put on it, its normals become tool axes.
        filter_hz: Low-pass, forth and back [Hz].
        tolerance: Of the spline from the filtered way, rms [m].
        spacing: Distance of the path's points [m].
    """
    moved = _moving(t, positions, filter_hz)
    s = arc_length(moved)
    rising = np.concatenate([[True], np.diff(s) > 0.0])
    even = np.linspace(0.0, s[-1], max(8 * (DEGREE + 1), math.ceil(s[-1] / EVEN_M)))
    way = interpolate(even, s[rising], moved[rising])
    s = arc_length(way)
    at = np.linspace(0.0, s[-1], max(2, round(s[-1] / spacing)) + 1)
    fitted, _ = splprep(way.T, u=s, k=DEGREE, s=len(way) * tolerance**2)
    points = np.column_stack(splev(at, fitted))
    found = surface.closest(points)
    off = norms(points - found.positions).max()
    return Taught(path_through(surface, found), len(fitted[0]) - 2 * DEGREE, off)


def path_through(surface: Surface, found: ClosestPoints) -> ToolPath:
    """A path through points of a part, all of it process; the part's normals are the tool axes."""
    along = unit(np.gradient(found.positions, axis=0))
    moved = np.concatenate([[True], chord_lengths(found.positions) > 1e-6])
    return path_of(
        move_in(PROCESS, found.positions[moved], found.normals[moved], 0),
        surface.normal_curvature(found.facets, found.barycentric, along)[moved],
    )


def _moving(t: Array, positions: Array, filter_hz: float) -> Array:
    """The low-passed way from where the hand begins to where it ends."""
    rate = 1.0 / np.median(np.diff(t))
    sections = butter(2, min(filter_hz / (0.5 * rate), 0.99), output="sos")
    positions = sosfiltfilt(sections, positions, axis=0)
    speed = norms(np.gradient(positions, t, axis=0))
    going = np.flatnonzero(speed > MOVING_SHARE * np.percentile(speed, 75))
    whole = slice(going[0], going[-1] + 1) if len(going) else slice(0, 0)
    length = arc_length(positions[whole])[-1] if len(going) > 1 else 0.0
    if length < SHORTEST_M:
        raise PlanError(
            f"the tool was moved by {1e3 * length:.2f} mm: too little to teach a path. Drag it further than "
            f"{1e3 * SHORTEST_M:g} mm."
        )
    return positions[whole]


# A hand that drags the tool along a path, with the wander, tremor and wobble of a person's.


TREMOR_HZ = (8.0, 12.0)  #: Where a person's hand trembles [Hz]
RAMP_S = 0.8  #: The hand sets off and stops during this time [s]


TAUGHT = "taught.csv"  #: The file of the taught path


def drag_table(
    positions: Array,
    rotations: Array,
    drag: DragConfig,
    hand: HandConfig,
    dt: float,
    rng: np.random.Generator,
) -> tuple[MoveTable, HandMotion]:
    """Where the hand wants the tool at every step, along positions (m, 3), base frame, and tool frames (m, 3,
    3); and what it means to do, without wander, tremor and wobble."""
    s = arc_length(positions)
    begin = HOLD_S + RELEASE_S + hand.before_s
    end = begin + s[-1] / drag.speed_m_s + RAMP_S
    t = np.arange(round((end + hand.after_s) / dt)) * dt
    way = np.clip(ramped(t - begin, RAMP_S, end - begin).q * drag.speed_m_s, 0.0, s[-1])
    points = interpolate(way, s, positions)
    turned = RotationSpline(s, Rotation.from_matrix(rotations))(way)
    moving = (t >= begin) & (t < end)
    # The hand's unsteadiness sets in as it sets off, so that the tool starts where the servos hold it.
    steady = np.clip((t - HOLD_S - RELEASE_S) / hand.before_s, 0.0, 1.0)[:, None]
    shake = steady * (
        _noise(rng, len(t), dt, drag.wander_m, 0.0, drag.wander_hz)
        + _noise(rng, len(t), dt, drag.tremor_m, *TREMOR_HZ)
    )
    wobble = Rotation.from_rotvec(steady * _noise(rng, len(t), dt, drag.wobble_rad, 0.0, drag.wander_hz))
    grip = (t >= HOLD_S).astype(float)
    wanted = _motion(points + shake, (turned * wobble).as_matrix(), grip, dt)
    table = MoveTable(wanted, servos_hold(t), np.where(moving, MOVING, HELD).astype(np.int8))
    return table, _motion(points, turned.as_matrix(), grip, dt)


def _motion(positions: Array, rotations: Array, grip: Array, dt: float) -> HandMotion:
    return HandMotion(
        positions, np.gradient(positions, dt, axis=0), np.ascontiguousarray(rotations), grip.copy()
    )


def _noise(rng: np.random.Generator, steps: int, dt: float, rms: float, low: float, high: float) -> Array:
    """Band-limited noise of three axes with a given rms, shape (steps, 3)."""
    settle = round(4.0 / max(high - low, 1e-3) / dt)
    edges, kind = ([low, high], "band") if low else (high, "low")
    band = butter(2, edges, kind, fs=1.0 / dt, output="sos")
    noise = sosfilt(band, rng.standard_normal((settle + steps, 3)), axis=0)[settle:]
    return noise * rms / np.maximum(np.sqrt(np.mean(noise**2, axis=0)), 1e-300)


# What a hand drags the tool along: a part's rim or a path's file, placed before the arm.

RIM = "rim"
SPACING_M = 0.001


class DragTask(NamedTuple):
    """A part, what is shown on it, and the way the arm does it."""

    mesh: PartMesh
    surface: Surface
    path: ToolPath  #: What the hand means to show, work frame
    reach: Reach


def prepare_drag(scenario: Checked) -> DragTask:
    """Load the part and the path to teach, and check that the arm can follow it; PolishSimError if not."""
    plan = scenario.plan
    mesh = load_mesh(scenario.part)
    surface = fit_surface(mesh, plan.feature_angle_rad)
    if scenario.drag.follow == RIM:
        margin = plan.edge_margin_m or scenario.pad.radius_m
        region = select_region(surface, mesh, plan.region, plan.feature_angle_rad, margin, margin)
        loop = region.components()[0].boundary_loops[0]
        s = arc_length(loop)
        at = np.linspace(0.0, s[-1], max(4, round(s[-1] / SPACING_M)) + 1)
        path = path_through(surface, surface.closest(interpolate(at, s, loop)))
    else:
        path = read_path(Path(scenario.drag.follow))
        path = path.rows(path.segment == PROCESS)
    if len(path.s) < 2 or arc_length(path.positions_work)[-1] < SPACING_M:
        raise PlanError(f"'{scenario.drag.follow}' has no way on the part to be dragged along.")
    return DragTask(mesh, surface, path, PartPlacing(scenario, mesh, surface, path, pressed_in=False).reach())


MODE = "assist"  #: The mode a path is taught in, unless another is asked for


def run_guiding(scenario: Checked, observer: Observer = SILENT) -> RunResult:
    """Guide the arm along a path where the scenario names one, else through the moves of the trial."""
    return run_drag(scenario, observer) if scenario.drag.follow else run_teach(scenario, observer)


def run_drag(scenario: Checked, observer: Observer) -> RunResult:
    """Let a hand drag the tool along a part's rim or a path, and make a path of the recording.

    The part is not touched: contact is not simulated. Returns no path if the arm stopped itself or was
    interrupted. Raises PolishSimError if part or path cannot be used or reached, or the mode is unknown.
    """
    observer.stage("prepare the part")
    task = prepare_drag(scenario)
    mode = scenario.guide.mode or MODE
    drag, reach = scenario.drag, task.reach
    grip = hand_of(scenario.hand)._replace(
        turn_stiffness=drag.turn_stiffness_nm_rad, turn_damping=drag.turn_damping_nm_s_rad
    )
    model = torque_arm(scenario, (task.mesh, reach.T_base_work))
    arm = guided_arm(scenario, mode, model, believe_arm(scenario), grip)
    table, meant = drag_table(
        apply(reach.T_base_work, task.path.positions_work), reach.rotations(task.path.axes_work), drag,
        scenario.hand, scenario.simulation.timestep_s, np.random.default_rng(scenario.seed),
    )  # fmt: skip
    observer.stage("drag by hand")
    started = time.perf_counter()
    run = run_guided(arm, task.reach.q_start, table.motion, table.servos, observer)
    move = TaughtMove(mode, "rim" if scenario.drag.follow == "rim" else "file", math.nan, 0.0)
    play = PlayedMove(move, table, run)
    figures = figures_of_moves(scenario, [play], 1, time.perf_counter() - started)
    figures["T_base_work"] = task.reach.T_base_work.tolist()
    asked = play._replace(table=table._replace(motion=meant))
    path: ToolPath | None = None
    if run.stop_reason is None and not run.interrupted:
        taught, more = _teach(scenario.drag, scenario.simulation, task, table.phase, run.rows["read"])
        path = taught.path
        figures = figures | more
    files = {} if path is None else {TAUGHT: path_csv(path)}
    return RunResult(
        scenario,
        free_log(scenario, [asked], move_columns),
        trace_of_move(asked),
        figures,
        path,
        files=files,
    )


def _teach(
    drag: DragConfig, simulation: SimulationConfig, task: DragTask, phase: NDArray[np.int8], read: Array
) -> tuple[Taught, Figures]:
    """The recording at the log's rate as a path, and how near it came."""
    every = simulation.log_every
    # What the encoders say is all that is known of the tool.
    read = np.ascontiguousarray(read[::every])
    T_work_tool = inverse(task.reach.T_base_work) @ forward(read) @ tool_on_flange()
    clock: Array = np.arange(len(read)) * np.float64(every * simulation.timestep_s)
    recorded = T_work_tool[:, :3, 3]
    taught = teach_path(clock, recorded, task.surface, drag.filter_hz, drag.fit_rms_m, drag.spacing_m)
    moving = phase[::every] == MOVING
    figures: Figures = dict(measure_taught(recorded[moving], taught.path, task.path))
    counts = {
        "points_recorded": int(moving.sum()),
        "knots": taught.knots,
        "points_taught": len(taught.path.s),
    }
    return taught, figures | counts | {"off_surface_max_m": taught.off_surface}


def distance_to_line(points: Array, line: Array) -> Array:
    """Distances (n,) [m] of points (n, 3) to a dense polyline (m, 3)."""
    near = cKDTree(line).query(points)[1]
    best = np.full(len(points), np.inf)
    for first in (np.maximum(near - 1, 0), np.minimum(near, len(line) - 2)):
        away, chord = points - line[first], line[first + 1] - line[first]
        best = np.minimum(best, foot_on_chord(away, chord)[1])
    return best


def measure_taught(recorded: Array, taught: ToolPath, meant: ToolPath) -> dict[str, float]:
    """Compare the recorded tool points (n, 3), work frame, and the path taught from them with the path that
    was meant.

    recorded_deviation_max_m, _rms_m; taught_deviation_max_m, _rms_m: distances to the meant path;
    taught_missed_max_m: of the meant path to the taught one, so that nothing was left out;
    taught_axis_error_max_rad: tool axis against that of the nearest meant point; taught_length_m.
    """
    raw = distance_to_line(recorded, meant.positions_work)
    off = distance_to_line(taught.positions_work, meant.positions_work)
    near = cKDTree(meant.positions_work).query(taught.positions_work)[1]
    aligned = dots(taught.axes_work, meant.axes_work[near])
    return {
        "recorded_deviation_max_m": raw.max(),
        "recorded_deviation_rms_m": rms(raw),
        "taught_deviation_max_m": off.max(),
        "taught_deviation_rms_m": rms(off),
        "taught_missed_max_m": distance_to_line(meant.positions_work, taught.positions_work).max(),
        "taught_axis_error_max_rad": np.arccos(np.clip(aligned, -1.0, 1.0)).max(),
        "taught_length_m": taught.length_m,
    }
