"""A run as a page for the browser: the cell it ran in, its log and its figures (record, scene -> Page); a
plan too."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.analysis.claim import figure_table
from polish_sim.analysis.run_record import RunRecord, changed_settings, other_conditions, stop_mark
from polish_sim.arrays import Array, Indices, Ints, chord_lengths, dots, into_plane, norms
from polish_sim.cell import Stroke, tool_on_flange
from polish_sim.cell.scene import lay_part, robot_with_tool
from polish_sim.config import Scenario
from polish_sim.exchange.log_sources import JOINT_NAMES
from polish_sim.experiments.cycle import cycle_of
from polish_sim.experiments.part_setup import sunk_under
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.registry import claims_shown, experiment
from polish_sim.geometry.mesh import lighter_mesh
from polish_sim.log import PROCESS_PHASE, TOUCH_PHASE, RemovalMap, RunLog
from polish_sim.motion import track
from polish_sim.page import Table
from polish_sim.page.page import Line, Motion, Page, PageBody, Plot, Solid, Wear, box, cylinder
from polish_sim.planning.toolpath import interpolate
from polish_sim.spatial import apply, matrices, transform

if TYPE_CHECKING:
    from polish_sim.planning import PlanResult

ROWS_PER_S = 50.0
MOST_ROWS = 40_000
JOINT_ERROR = 2.5e-4  #: Between rows, at most, where there are not too many [rad]
#: Of the part and of its removal; finer ones are shown by lighter copies
MOST_FACETS, MOST_NODES = 40_000, 40_000
HIDDEN_GROUP = 3  #: Of geoms that are there for contact only
MEASURED = "wrench_measured_tool"
MM, DEG = 1e3, 180.0 / np.pi


def run_page(record: RunRecord, model: Any, notes: Sequence[str] = ()) -> Page:
    """What the page of a run shows; ``model`` is MuJoCo's of the cell, the log has at least one row."""
    scenario, log = record.scenario, record.log
    row, stop = experiment(scenario.experiment), stop_mark(record.metrics)
    kept = shown_rows(clock(log), log["q_rad"])
    bodies, part = scene_bodies(model), part_body(model)
    motion = run_motion(record, model, kept)
    other = other_conditions(scenario, row.defaults)
    tables = (
        figure_table(claims_shown([scenario]), {"this run": record.metrics}, conditions=other),
        Table("Settings changed", ["setting", "here", "otherwise"], changed_settings(scenario, row.defaults)),
    )
    reason = record.metrics.get("protective_stop")
    noted = row.notes_of(record.metrics, scenario)
    bad = [f"bad: {text}." for text in record.metrics.get("bad_figures", ())]
    return Page.of(
        row.title(scenario) + ": with bad figures" * bool(bad),
        row.text,
        tables,
        [*filter(None, [reason]), *bad, *notes, *noted],
    )._replace(
        stop=stop.text if stop else "",
        stop_time=stop.time if stop else None,
        bodies=bodies,
        solids=scene_solids(model),
        part_body=part,
        motion=motion,
        path=record.path.positions_work if record.path else np.empty((0, 3)),
        contact=record.path.process.astype(np.float64) if record.path else np.empty(0),
        wear=_wear(record, record.removal) if record.removal and record.removal.mean > 0.0 else None,
        plots=run_plots(record, motion, kept),
        command=f"polish-sim run {scenario.experiment} --config config.toml",
        made=", ".join(
            [
                f"seed {scenario.seed}",
                *(f"{n} {v}" for n, v in (record.metrics.get("versions") or {}).items()),
            ]
        ),
    )


def clock(log: RunLog) -> Array:
    """Time of a log's rows [s], (n,); one that holds several moves, each from time 0, has them one after the
    other."""
    time = log["time_s"]
    steps = np.diff(time, prepend=time[:1])
    return time[0] + np.cumsum(np.where(steps < 0.0, np.median(steps), steps))


def shown_rows(time: Array, q: Array) -> Indices:
    """Rows of a log (n,) [s] the page has: 50 a second, more where joints (n, k) would be off between
    them."""
    n = len(time)
    every = max(1, round((n - 1) / max(ROWS_PER_S * (time[-1] - time[0]), 1.0)))
    while True:
        kept = np.unique(np.append(np.arange(0, n, every), n - 1))
        if every == 1 or np.abs(interpolate(time, time[kept], q[kept]) - q).max() <= JOINT_ERROR:
            break
        every = -(-every // 2) if every > 2 else 1
    return kept if len(kept) <= MOST_ROWS else np.unique(np.linspace(0, n - 1, MOST_ROWS).astype(np.int64))


# The scene: bodies and what is drawn of them, from a compiled model.


def scene_bodies(model: Any) -> list[PageBody]:
    """The bodies of a model; joints are numbered as in ``qpos``."""
    bodies = []
    for number in range(1, model.nbody):
        rest = transform(matrices(model.body_quat[number]), model.body_pos[number]).tolist()
        body, first = PageBody(int(model.body_parentid[number]) - 1, rest), int(model.body_jntadr[number])
        if first >= 0:
            axis, anchor = model.jnt_axis[first].tolist(), model.jnt_pos[first].tolist()
            slide = str(model.joint(first).name).endswith("slide")
            body = body._replace(axis=axis, anchor=anchor, slide=slide, joint=int(model.jnt_qposadr[first]))
        bodies.append(body)
    return bodies


def part_body(model: Any) -> int:
    """Number of the part's body; -1 if there is none."""
    return next((n - 1 for n in range(1, model.nbody) if str(model.body(n).name).endswith("part")), -1)


def scene_solids(model: Any) -> list[Solid]:
    """What a model draws: meshes, boxes and cylinders, with the colours of their materials."""
    import mujoco

    solids = []
    for g in range(model.ngeom):
        kind, material = int(model.geom_type[g]), int(model.geom_matid[g])
        if model.geom_group[g] == HIDDEN_GROUP:
            continue
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            vertices, faces = _mesh(model, int(model.geom_dataid[g]))
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            vertices, faces = box(model.geom_size[g])
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            vertices, faces = cylinder(
                model.geom_size[g][0], 2.0 * model.geom_size[g][1], -model.geom_size[g][1]
            )
        else:
            continue
        T = transform(matrices(model.geom_quat[g]), model.geom_pos[g])
        plain = np.allclose(model.geom_rgba[g], (0.5, 0.5, 0.5, 1.0))
        color = model.mat_rgba[material] if plain and material >= 0 else model.geom_rgba[g]
        name, body = str(model.geom(g).name), int(model.geom_bodyid[g])
        what = "part" if name.endswith("part") else "cell" if body == 0 else "arm"
        solids.append(Solid(what, body - 1, apply(T, vertices), faces, color[:3].tolist()))
    return solids


def _mesh(model: Any, number: int) -> tuple[Array, Ints]:
    first, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
    start, facets = model.mesh_faceadr[number], model.mesh_facenum[number]
    vertices = np.asarray(model.mesh_vert[first : first + count], dtype=np.float64)
    return lighter_mesh(vertices, model.mesh_face[start : start + facets].copy(), MOST_FACETS)


# How it moved, and the curves beneath, from the log.


def run_motion(record: RunRecord, model: Any, kept: Indices) -> Motion:
    """The rows of a log the page plays back."""
    log, path = record.log, record.path
    s = log["path_s_m"][kept]
    # Where the pad's face would be on the surface: the spring's way and the pad's own are taken back.
    sunk = log["pad_travel_m"] + log["normal_force_n"] / record.scenario.pad.stiffness_n_m
    axes, none = _tool_axis(record, "tcp_quaternion_wxyz"), np.full(len(kept), np.nan)
    return Motion(
        time=clock(log)[kept],
        joints=joint_columns(record, model)[kept],
        pad=(log["tcp_position_m"] - sunk[:, None] * axes)[kept],
        force=log["normal_force_n"][kept],
        asked=_asked_force(record)[kept],
        speed=log["tcp_speed_m_s"][kept],
        error=_sideways(record)[kept],
        curvature=none if path is None else np.interp(s, path.s, path.curvature),
    )


def joint_columns(record: RunRecord, model: Any) -> Array:
    """The columns of the log that move a model, in the order of ``qpos``; what is not in the log stays at
    zero."""
    log, columns = record.log, np.zeros((len(record.log), model.nq))
    for number in range(model.njnt):
        name, at = str(model.joint(number).name), model.jnt_qposadr[number]
        arm = "master_q_rad" if name.startswith("master_") else "q_rad"
        which = next((k for k, joint in enumerate(JOINT_NAMES) if name.endswith(f"{joint}_joint")), None)
        if which is not None and arm in log.names:
            columns[:, at] = log[arm][:, which]
        elif name.endswith("head_slide"):
            columns[:, at] = log["pad_travel_m"]
    return columns


def _asked_force(record: RunRecord) -> Array:
    """The force to hold [N], NaN where the tool is not pressed on the part, shape (n,)."""
    log = record.log
    usual = record.scenario.process.contact_force_n
    pressing = np.isin(log["phase"], [TOUCH_PHASE, PROCESS_PHASE])
    pressing &= (log["normal_force_n"] > 0.0).any()
    s = log["path_s_m"]
    return np.where(pressing, record.path.force_at(s, usual) if record.path else usual, np.nan)


def _tool_axis(record: RunRecord, name: str) -> Array:
    return matrices(record.log[name])[:, :, 2]


def _sideways(record: RunRecord) -> Array:
    """Distance of the tool point from its target across the target's tool axis [m], shape (n,)."""
    off = record.log["tcp_position_m"] - record.log["target_position_m"]
    axis = _tool_axis(record, "target_quaternion_wxyz")
    return norms(into_plane(off, axis))


def run_plots(record: RunRecord, motion: Motion, kept: Indices) -> list[Plot]:
    """The curves under the picture; those that are zero all the time are left out."""
    log, process = record.log, record.scenario.process
    n = len(kept)

    def column(name: str) -> Array:
        return log[name][kept]

    low = np.minimum.reduceat(log["normal_force_min_n"], kept)
    high = np.maximum.reduceat(log["normal_force_max_n"], kept)
    worst = np.maximum.reduceat(_sideways(record), kept)
    limit = record.scenario.robot.joint_speed_limit_rad_s
    twist = column("command_twist")
    axis = _tool_axis(record, "tcp_quaternion_wxyz")[kept]
    along = dots(twist[:, :3], axis)
    across = norms(into_plane(twist[:, :3], axis))
    asked = Line("asked", motion.asked, "asked")
    read = [Line("read by the sensor", column(MEASURED)[:, 2], "1")] if MEASURED in log.names else []
    plots = [
        Plot("Contact force", "N", [*read, asked, Line("exact force", motion.force, "main", low, high)]),
        Plot(
            "Error across the tool",
            "µm",
            [Line("error", 1e6 * motion.error, "main", 0.0 * worst, 1e6 * worst)],
        ),
        Plot(
            "Tool speed",
            "mm/s",
            [
                Line("feed asked", np.full(n, MM * process.feed_m_s), "asked"),
                Line("speed", MM * motion.speed),
            ],
        ),
        joint_plot(column("qd_rad_s"), limit),
        Plot("Command", "mm/s", [Line("into the part", MM * along, "0"), Line("along it", MM * across, "1")]),
    ]
    row = experiment(record.scenario.experiment)
    if row.carried or not row.fed:
        plots[2] = plots[2]._replace(lines=plots[2].lines[1:])
    if "relative_error_m" in log.names:
        apart = 1e6 * norms(column("relative_error_m"))
        plots.insert(1, Plot("Tool from its place on the part", "µm", [Line("distance", apart)]))
    if "hand_force_n" in log.names:
        plots[1] = Plot("Hand", "N", [Line("force", norms(column("hand_force_n")))])
    return [plot for plot in plots if any(np.nan_to_num(line.values).any() for line in plot.lines)]


def joint_plot(rates: Array, limit: float) -> Plot:
    """Speeds of the six joints (n, 6) beside their limit [rad/s]."""
    lines = [
        Line(name.replace("_", " "), 100.0 / limit * rates[:, k], str(k))
        for k, name in enumerate(JOINT_NAMES)
    ]
    return Plot("Joint speeds", "%", lines, f"of the limit, {DEG * limit:.0f}°/s")


def _wear(record: RunRecord, removal: RemovalMap) -> Wear:
    vertices, faces = lighter_mesh(removal.vertices, removal.triangles.astype(np.int32), 2 * MOST_NODES)
    value, unit_, top = removal.relative, "× its mean", 2.0
    if removal.absolute:
        value = 1e6 * removal.preston_1_pa * removal.exposure
        unit_ = "µm"
        top = 2e6 * removal.preston_1_pa * removal.mean
    if len(vertices) != len(value):
        value = value[cKDTree(removal.vertices).query(vertices)[1]]
    spin = record.scenario.spindle.speed_rpm * 2.0 * np.pi / 60.0
    return Wear(vertices, faces, value, "removal", unit_, top, record.scenario.pad.radius_m, spin)


# A plan with the robot that does it.


def plan_page(
    page: Page, scenario: Scenario, result: PlanResult, reach: Reach, strokes: Sequence[Stroke]
) -> Page:
    """The page of a plan, ``page``, with the robot that does it, as long as the cycle takes."""
    from polish_sim.exchange.viewers import path_plots

    spec = robot_with_tool(scenario)
    lay_part(spec, result.mesh, reach.T_base_work, result.path.axes_work)
    model, cycle = spec.compile(), cycle_of(strokes)
    turns = matrices(cycle.quaternions)
    q = track(transform(turns, cycle.positions), tool_on_flange(), reach.q_start).q
    if not np.isfinite(q).all():
        return page
    sunk = sunk_under(cycle.force, scenario.head, scenario.pad)
    pad = cycle.positions - sunk[:, None] * turns[:, :, 2]
    bodies, body = scene_bodies(model), part_body(model)
    steps = np.diff(cycle.time)
    speed = np.append(chord_lengths(cycle.positions) / steps, 0.0)
    pressing = cycle.force > 0.0
    motion = Motion(
        time=cycle.time,
        joints=np.column_stack([q, sunk]),
        pad=pad,
        force=cycle.force,
        asked=np.where(pressing, cycle.force, np.nan),
        speed=speed,
        error=np.zeros(len(pad)),
        curvature=cycle.curvature,
    )
    marks = [solid._replace(body=body) for solid in page.solids if solid.kind not in ("part", "arm")]
    limit = scenario.robot.joint_speed_limit_rad_s
    rates = np.append(np.diff(q, axis=0) / steps[:, None], np.zeros((1, 6)), axis=0)
    return page._replace(
        about=f"{page.about}; the robot does it as long as the cycle takes",
        bodies=bodies,
        solids=[*scene_solids(model), *marks],
        part_body=body,
        motion=motion,
        plots=[*path_plots(motion), joint_plot(rates, limit)],
    )
