"""Cells for tests: short strokes, parts with a formula and their fields, and a pad pressed by hand."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.integrate import quad_vec
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.cell import Cell, CellRun, RealPart, Silent, Stroke, build_scene, no_part, tool_on_flange
from polish_sim.cell.contact import build_pad, press_pad
from polish_sim.cell.real_part import FIELD_BAND, FIELD_SPACING
from polish_sim.cell.stroke import TRAVEL_PACE, feed_pace
from polish_sim.config import PadConfig, Scenario
from polish_sim.control import build_controller
from polish_sim.experiments import default_scenario
from polish_sim.geometry.field_lookup import CELLS, NODES, DistanceField
from polish_sim.models import robot_model_path
from polish_sim.motion import inverse_near
from polish_sim.motion.trajectory import PathTable, TimedPath, build_path_table, time_path
from polish_sim.scenario_file import override
from polish_sim.spatial import inverse, transform

IDEAL_ARM = "robot.arm=ideal"
IDEAL_SENSOR = [
    "sensor.force_noise_n=0", "sensor.torque_noise_nm=0", "sensor.force_bias_n=0", "sensor.torque_bias_nm=0",
    "sensor.force_drift_n_s=0", "sensor.torque_drift_nm_s=0", "sensor.force_quantum_n=0",
    "sensor.torque_quantum_nm=0",
]  # fmt: skip
NOMINAL_PART = ["part.displacement_m=0", "part.rotation_rad=0", "part.form_error_m=0"]
EVERY_STEP = "simulation.log_rate_hz=0"
DOWN = np.diag([1.0, -1.0, -1.0])  # R_base_pad of a pad that looks straight down
PAD = PadConfig()
ELASTIC = replace(PAD, damping_s_m=0.0, friction=0.0)
HEAD_STIFFNESS = 20000.0 / 3.0  # [N/m]
PRESSED = 0.004  # D of 20 N on a flat part [m]
STILL = (0.0, 0.0, 0.0)
Foundation = Callable[[Array], tuple[Array, Array]]


def ideal(experiment: str, *changes: str) -> Scenario:
    """An experiment on the ideal arm, without sensor errors, on a part that is as drawn."""
    return override(default_scenario(experiment), [IDEAL_ARM, *IDEAL_SENSOR, *NOMINAL_PART, *changes])


def tool_pose(x: float, y: float, z: float, tilt: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    """T_base_tool of a tool that looks down, then tilted by a rotation vector [rad]."""
    return transform(Rotation.from_rotvec(tilt).as_matrix() @ DOWN, np.array([x, y, z]))


TOUCH = tool_pose(0.0, -0.5, 0.1)
HOME = np.array(mujoco.MjModel.from_xml_path(str(robot_model_path())).key("home").qpos[:6])


def joints_at(T_base_tool: Array) -> Array:
    """Joint positions of a tool pose, elbow up as at home [rad]."""
    return inverse_near(T_base_tool @ inverse(tool_on_flange()), HOME)


def along_tool(T_base_tool: Array, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    return T_base_tool @ transform(np.eye(3), np.array([x, y, z]))


def path_through(*poses: Array) -> PathTable:
    stack = np.stack(poses)
    return build_path_table(stack[:, :3, 3], stack[:, :3, :3])


def way_through(*poses: Array) -> TimedPath:
    """A straight way through tool poses in free space, from rest to rest."""
    return time_path(path_through(*poses), TRAVEL_PACE)


def free_stroke(*poses: Array, feed: float = 0.05, hold: float = 0.0) -> Stroke:
    """Move through poses in free space and stay at the last."""
    start, path = path_through(poses[0]), path_through(*poses)
    motion, force = time_path(path, feed_pace(feed)), np.zeros(len(path.positions))
    ways = {"travel": way_through(poses[0]), "lead_in": start, "process": path, "motion": motion}
    return Stroke(**ways, force=force, approach_speed=0.005, feed=feed, hold=hold, feed_time=math.inf)


def pressing_stroke(T_base_touch=TOUCH, height=0.005, slide=0.0, hold=1.0, lift=0.0, wanted=20.0, **other):
    """Down from ``height`` [m] onto a nominal surface, 4 mm in for ``wanted`` [N], then ``slide`` [m]."""
    pressed, above = along_tool(T_base_touch, z=0.004), along_tool(T_base_touch, z=-height)
    stroke = free_stroke(pressed, along_tool(pressed, x=slide), feed=0.01, hold=hold)
    ways = {"travel": way_through(T_base_touch), "lead_in": path_through(above, T_base_touch)}
    stroke = stroke._replace(**ways, force=np.full_like(stroke.force, wanted), threshold=2.0)
    return stroke._replace(depth=0.004, contact=True, search_depth=0.01, lift=lift)._replace(**other)


def part_at(field: DistanceField, rotation: Array | None = None, position=(0.0, 0.0, 0.0)) -> RealPart:
    """A part of one field, for contact and crash alike, at a pose in the base frame."""
    R = np.eye(3) if rotation is None else np.ascontiguousarray(rotation)
    return RealPart(field, field, R, np.array(position, dtype=float))


def part_under(T_base_touch: Array = TOUCH, field: DistanceField | None = None) -> RealPart:
    """A part, a plane by default, whose origin is touched at a tool pose, its z axis against the tool's."""
    return part_at(plane() if field is None else field, T_base_touch[:3, :3] @ DOWN, T_base_touch[:3, 3])


def start_of(stroke: Stroke) -> Array:
    """T_base_tool at the start of a stroke."""
    first = stroke.lead_in if stroke.contact else stroke.process
    R = Rotation.from_quat(first.quaternions[0], scalar_first=True).as_matrix()
    return transform(R, first.positions[0])


def cell_for(scenario: Scenario, *strokes: Stroke, part=None, model=None, controller=None) -> Cell:
    """A cell at the start of its first stroke, without table."""
    model, q = model or build_scene(scenario), joints_at(start_of(strokes[0]))
    law, rng = controller or build_controller(scenario.controller), np.random.default_rng(scenario.seed)
    return Cell(scenario, model, part or no_part(), strokes, q, law, rng)


def on_plane(*changes: str, part=None, controller=None, **how: Any) -> Cell:
    """An ideal cell that presses on a plane, every step logged; ``how`` as of `pressing_stroke`."""
    scenario, part = ideal("force", EVERY_STEP, *changes), part or part_under()
    return cell_for(scenario, pressing_stroke(**how), part=part, controller=controller)


def stopped_at(run: CellRun) -> int:
    """Step at which a guard stopped a run with steps of 1 ms."""
    return round(run.safety.protective_stop_time_s / 0.001)


def phases(run: CellRun) -> list[int]:
    return [int(run.trace.phase[k]) for k in np.flatnonzero(np.diff(run.trace.phase, prepend=-1))]


class EachStep(Silent):
    """Calls a function after every physics step; the scenario must log every step."""

    def __init__(self, look: Callable[[Any, Any], None], dt: float = 0.001) -> None:
        self.frame_every_s = dt
        self._look = look

    def frame(self, model: Any, data: Any) -> None:
        self._look(model, data)


def watched(cell: Cell, *quantities: Callable[[], Any]) -> tuple[CellRun, list[Array]]:
    """Run a cell and look at some quantities after every physics step: arrays (steps, ...)."""
    rows: list[list[Array]] = []
    run = cell.run(EachStep(lambda _model, _data: rows.append([np.array(look()) for look in quantities])))
    return run, [np.array(column) for column in zip(*rows, strict=True)]


def drawn_vertices(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """Every vertex of a drawn mesh, base frame [m], shape (n, 3)."""
    mesh, R = model.geom_dataid[geom], data.geom_xmat[geom].reshape(3, 3)
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    return np.asarray(model.mesh_vert[start : start + count] @ R.T + data.geom_xpos[geom])


def meshes_of(model: mujoco.MjModel, body: str) -> Array:
    """Numbers of a body's drawn meshes."""
    on_body = model.geom_bodyid == model.body(body).id
    return np.flatnonzero(on_body & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH))


def sampled(distance: Callable[[Array], Array], low: Sequence[float], high: Sequence[float]) -> DistanceField:
    """Field of a distance function, points (..., 3) to distances (...), in a box [m]."""
    side = CELLS * FIELD_SPACING
    origin = np.array(low, dtype=float)
    shape = np.ceil((np.array(high) - origin) / side).astype(int)
    table = np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    corners = origin + side * np.argwhere(table >= 0)
    steps = FIELD_SPACING * np.arange(NODES)
    nodes = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    bricks = np.clip(distance(corners[:, None, None, None, :] + nodes), -FIELD_BAND, FIELD_BAND)
    return DistanceField(origin, FIELD_SPACING, FIELD_BAND, table, bricks.astype(np.float32, order="C"))


@cache
def plane() -> DistanceField:
    """The plane z = 0, solid below."""
    return sampled(lambda p: p[..., 2], (-0.06, -0.06, -0.016), (0.06, 0.06, 0.016))


@cache
def sphere(radius: float) -> DistanceField:
    """The top of a ball of this radius [m], its highest point at the origin."""
    middle = np.array([0.0, 0.0, -radius])
    low, high = (-0.04, -0.04, -0.032), (0.04, 0.04, 0.008)
    return sampled(lambda p: np.linalg.norm(p - middle, axis=-1) - radius, low, high)


def wall(x: float, height: float = 0.4) -> DistanceField:
    """A wall that fills everything beyond x [m], 0.24 m wide and so high from z = 0 [m]."""
    return sampled(lambda p: x - p[..., 0], (x - 0.016, -0.12, 0.0), (x + 0.016, 0.12, height))


class Wrench(NamedTuple):
    """Force [N] and torque about the pad's centre [N m] of the part on the pad, base frame."""

    force: Array
    torque: Array


def press(part, center, R_base_pad=DOWN, config=ELASTIC, velocity=STILL, turning=STILL, spin=0.0) -> Wrench:
    """What the compiled contact says."""
    found, R = Wrench(np.zeros(3), np.zeros(3)), np.ascontiguousarray(R_base_pad)
    center, velocity, turning = (np.array(vector, dtype=float) for vector in (center, velocity, turning))
    press_pad(build_pad(config), part, spin, R, center, velocity, turning, *found)
    return found


def foundation(depth_and_normal: Foundation, center: Array, R_base_pad: Array, config=ELASTIC) -> Wrench:
    """Integral of k / A depth n over the disc about a centre [m]: rings of 360 points, adaptive in radius.

    ``depth_and_normal`` takes points (n, 3) to depths below the surface (n,) and outward normals (n, 3).
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    around = np.cos(angle)[:, None] * R_base_pad[:, 0] + np.sin(angle)[:, None] * R_base_pad[:, 1]

    def ring(r: float) -> Array:
        depth, normal = depth_and_normal(center + r * around)
        force = np.maximum(depth, 0.0)[:, None] * normal
        return 2.0 * np.pi * r * np.concatenate([force, np.cross(r * around, force)], axis=1).mean(axis=0)

    total, _ = quad_vec(ring, 0.0, config.radius_m, epsrel=1e-4, epsabs=1e-12)
    total *= config.stiffness_n_m / (np.pi * config.radius_m**2)
    return Wrench(total[:3], total[3:])


def below_sphere(radius: float) -> Foundation:
    """Depth and normal of points in a ball whose top is at the origin."""

    def depth_and_normal(points: Array) -> tuple[Array, Array]:
        offset = points + [0.0, 0.0, radius]
        distance = np.linalg.norm(offset, axis=1)
        return radius - distance, offset / distance[:, None]

    return depth_and_normal


def working_depth(radius: float) -> float:
    """How deep the pad itself sits in a ball when head spring and pad together are pressed in by D [m]."""

    def surplus(depth: float) -> float:
        force = foundation(below_sphere(radius), np.array([0.0, 0.0, -depth]), DOWN).force[2]
        return float(force - HEAD_STIFFNESS * (PRESSED - depth))

    return float(brentq(surplus, 1e-4, PRESSED, xtol=1e-9))
