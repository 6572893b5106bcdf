"""The scene of two robots: the master holds the part in a gripper, the follower works on it.

Both come from the one model file. The world frame is the follower's base, so that everything that is true of
the single robot with its tool is true of the follower.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.scene import add_drawn_part, arm_spec, bend_arm, robot_with_tool
from polish_sim.config import Scenario
from polish_sim.dual.carrier import FIRST_JOINT, FOLLOWER, MASTER
from polish_sim.errors import InputError, ReachError, place_in_mm
from polish_sim.experiments.placement import upright
from polish_sim.geometry import PartMesh, Surface
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.motion.kinematics import is_nominal
from polish_sim.spatial import apply, from_pose, inverse, transform, wxyz

GRIPPER_LENGTH = 0.1  # from the flange to its face [m]
GRIPPER_RADIUS = 0.04  # [m]
GRIPPER_MASS = 0.9  # [kg]
PAYLOAD_LIMIT = 5.0  # of the arm [kg]
TOUCHING = 1e-4  #: A part this close to the gripper is held by it [m]
_SPACING = 0.002  # between the sampled points of the gripper's face [m]
_STEPS = 2000


class Seat(NamedTuple):
    """A part in a gripper."""

    #: The part's frame on the gripper's face, whose z axis looks away from the flange, (4, 4)
    T_gripper_work: Array
    nose: float  #: How far the gripper extends beyond its face, into an opening, until it meets the part [m]


def seat_part(surface: Surface, up: Array, pose: tuple[float, ...] = ()) -> Seat:
    """Hold a part with the side ``up`` away from the gripper, the middle of its box on the gripper's axis.

    ``pose``: where the part's own frame is on the gripper instead [m], [rad], (6,); empty for none. Raises
    ReachError if there is no part in front of the gripper's face.
    """
    corners = surface.control.reshape(-1, 3)
    T_gripper_work = from_pose(pose) if pose else _on_lowest_point(corners, up)
    depth = apply(T_gripper_work, corners)[:, 2].max()
    nose = _gap_to_part(surface, inverse(T_gripper_work), depth)
    if nose is None:
        raise ReachError(
            f"the gripper's face, {2e3 * GRIPPER_RADIUS:g} mm wide, would hold nothing: at "
            f"{place_in_mm(inverse(T_gripper_work)[:3, 3])} of the part there is no part in front of it. Say "
            "where the part's own frame is on the gripper's face with --set "
            "dual.part_on_gripper=[x,y,z,rx,ry,rz] (m, rad)."
        )
    return Seat(T_gripper_work, nose)


def seat_text(T_gripper_work: Array) -> str:
    """Where the gripper takes a part, for the user."""
    T_work_gripper = inverse(T_gripper_work)
    axis = ", ".join(f"{number + 0.0:.3g}" for number in np.round(T_work_gripper[:3, 2], 4))
    return (
        f"held by the gripper at {place_in_mm(T_work_gripper[:3, 3])} of its own frame, gripper's axis "
        f"({axis})"
    )


def seat_note(figures: Mapping[str, Any]) -> str:
    """How the part is held, by the figures of a plan or run."""
    return f"part: {seat_text(np.array(figures['T_gripper_work']))}"


def _on_lowest_point(corners: Array, up: Array) -> Array:
    R = upright(up)
    turned = corners @ R.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    # To a tenth of a millimetre: facets make the box of what is round a little lopsided.
    middle = np.round(0.5 * (low + high), 4)
    return transform(R, -np.array([middle[0], middle[1], low[2]]))


def _gap_to_part(surface: Surface, T_work_gripper: Array, depth: float) -> float | None:
    """How far the gripper's face goes along its axis until it meets the part [m]; None if there is nothing.

    Each step is the distance to the nearest point of the part, so that the face never overshoots.
    """
    line = np.arange(-GRIPPER_RADIUS, GRIPPER_RADIUS + 0.5 * _SPACING, _SPACING)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    inside = np.hypot(x, y) <= GRIPPER_RADIUS + 1e-12
    face = np.stack([x[inside], y[inside], np.zeros(inside.sum())], axis=1)
    way = 0.0
    for _ in range(_STEPS):
        gap = signed_distances(surface, apply(T_work_gripper, face)).min()
        if gap < TOUCHING:
            return way
        way += gap
        face[:, 2] += gap
        if way > depth:
            break
    return None


def load_of(mesh: PartMesh, density: float) -> tuple[float, Array]:
    """Mass [kg] of a part and its centre [m]; InputError if it encloses no volume, ReachError if it is too
    heavy for the master."""
    import trimesh  # slow to import

    body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    mass = density * body.volume
    if not mass > 0.0:
        raise InputError(
            f"the part's mesh encloses {1e6 * body.volume:.4g} cm^3, so that the master would carry no "
            "mass: it is open or its faces look inwards. Close it, or turn its faces outwards."
        )
    if mass + GRIPPER_MASS > PAYLOAD_LIMIT:
        raise ReachError(
            f"the part weighs {mass:.2f} kg: with the gripper's {GRIPPER_MASS:g} kg the master would carry "
            f"more than its {PAYLOAD_LIMIT:g} kg. Take a smaller part, or its true density with --set "
            "dual.density_kg_m3=..."
        )
    return mass, body.center_mass


# The scene of both robots.


#: Geoms that are nearer to the part than the housing is
PAD = ("head_pad", "head_plate", "head_shaft")
CAPSULES, PAD_GROUP, SHELLS, PART = 1, 2, 4, 8
"""Bits of the engine's contact types: a geom of this kind meets those that have the bit in their affinity."""
_SUFFIX = re.compile("(_cap)?(_seam)?(_shell)?(_collision)?$")  #: Of a geom's name, none of the link's


class Clearances(NamedTuple):
    """Distances to keep where a motion is checked beforehand."""

    arms: float  #: Arms and tool from the other arm and its gripper, and from the part [m]
    pad: float  #: Pad and shaft from the other arm and its gripper [m]


class Held(NamedTuple):
    """A part in the master's gripper."""

    mesh: PartMesh  #: As drawn
    density: float  #: [kg/m^3]
    T_flange_part: Array  #: Where the real part is on the master's flange, shape (4, 4)
    #: How far the gripper extends beyond its face, into an opening, until it meets the part [m]
    nose: float = 0.0
    clearances: Clearances | None = None  #: For checks: part and links touch what is this near; None: a cell


def build_pair_scene(
    scenario: Scenario, T_follower_master: Array, held: Held, tables: Mapping[str, Array] | None = None
) -> mujoco.MjModel:
    """Compile the cell of two robots: the follower's joints and controls first.

    Args:
        scenario: Head, pad, robots and time step.
        T_follower_master: The master's base in the follower's, as it really stands, shape (4, 4).
        held: What the master holds; too heavy for it: ReachError.
        tables: Denavit-Hartenberg parameters of ``master`` and ``follower`` as built, (4, 6) each; None:
            nominal.
    """
    scene = arm_spec(scenario.robot.arm)
    master = arm_spec(scenario.robot.arm)
    follower = robot_with_tool(scenario)
    scene.option.timestep = scenario.simulation.timestep_s
    for spec in (scene, follower, master):
        for key in list(spec.keys):  # a keyframe of one robot fits no scene of two
            spec.delete(key)
    scene.delete(scene.body("base"))
    if tables is not None:
        for arm, name in ((master, "master"), (follower, "follower")):
            if not is_nominal(tables[name]):
                bend_arm(arm, tables[name])
    master.delete(master.body("tool_mount"))
    part = _add_gripper(master, held)
    _set_contacts(follower, master, part, held.clearances)
    scene.worldbody.add_frame().attach_body(follower.body("base"), FOLLOWER, "")
    stand = scene.worldbody.add_frame(pos=T_follower_master[:3, 3], quat=wxyz(T_follower_master[:3, :3]))
    stand.attach_body(master.body("base"), MASTER, "")
    middle = 0.5 * T_follower_master[:3, 3]
    scene.stat.center = [middle[0], middle[1], 0.35]
    return scene.compile()


def _add_gripper(master: Any, held: Held) -> Any:
    """A plain cylinder on the flange and the part on its face; the robot compensates the weight of both."""
    flange = master.body("link_6")
    half = 0.5 * GRIPPER_LENGTH
    look = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "group": 2, "rgba": [0.25, 0.27, 0.30, 1.0]}
    gripper = flange.add_body(name="gripper", gravcomp=1.0)
    gripper.add_geom(
        name="gripper", size=[GRIPPER_RADIUS, half, 0.0], pos=[0.0, 0.0, half], mass=GRIPPER_MASS, **look
    )
    if held.nose > 0.0:
        middle = [0.0, 0.0, GRIPPER_LENGTH + 0.5 * held.nose]
        size = [GRIPPER_RADIUS, 0.5 * held.nose, 0.0]
        gripper.add_geom(name="gripper_nose", size=size, pos=middle, mass=0.0, **look)
    part = add_drawn_part(master, flange, held.mesh, held.T_flange_part)
    mass, center = load_of(held.mesh, held.density)
    size = np.ptp(held.mesh.vertices, axis=0)
    part.gravcomp = 1.0
    part.mass = mass
    part.ipos = center
    part.explicitinertial = True
    part.inertia = mass / 12.0 * np.maximum((size**2).sum() - size**2, 1e-6)
    return part


def _set_contacts(follower: Any, master: Any, part: Any, clearances: Clearances | None) -> None:
    """Which geoms may touch which.

    A cell's own geoms, capsules on the links, touch each other. Besides, pad and shaft touch the other arm
    and its gripper, never the part: the pad's contact with the part is computed on its signed distance. Where
    a motion is checked beforehand, contacts are found up to the clearances, the part meets both arms as its
    convex hull, and the links count as they are drawn, each shell by its convex hull: they are up to 4 cm
    thicker than their capsules.
    """
    for name in PAD:
        follower.geom(name).contype = PAD_GROUP
    for geom in master.geoms:
        if geom.contype:
            geom.conaffinity |= PAD_GROUP
    if clearances is None:
        return
    reach = max(clearances)
    for geom in follower.geoms:
        if geom.name not in PAD and _is_solid(geom):
            geom.contype |= SHELLS
            geom.margin = reach
    for geom in master.geoms:
        if _is_solid(geom):
            geom.conaffinity |= PAD_GROUP | SHELLS | PART
            geom.margin = reach
    hull = part.geoms[0]
    hull.contype = CAPSULES | PART
    hull.conaffinity = CAPSULES | SHELLS
    hull.margin = reach


def _is_solid(geom: Any) -> bool:
    """Whether a geom stands for the arm itself: a drawn shell, or a colliding geom that is no capsule."""
    if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
        return True
    return bool(geom.contype) and geom.type != mujoco.mjtGeom.mjGEOM_CAPSULE


def pair_contacts(model: mujoco.MjModel, clearances: Clearances) -> Callable[[Array, Array], str]:
    """The engine's collision check of a scene of two robots, before anything moves.

    The part counts as its convex hull, and the pad may come near it, as it is to touch it. ``model``: a scene
    that was built with the same clearances, see `Held`. What is returned takes joints of master and follower
    [rad], (n, 6) each, and says the first two things too close; empty if there are none.
    """
    data = mujoco.MjData(model)
    names = [model.geom(g).name for g in range(model.ngeom)]
    pad = np.array([name.endswith(PAD) for name in names])
    part = model.geom_bodyid == model.body(f"{MASTER}part").id
    masters = np.array([name.startswith(MASTER) for name in names])

    def least(one: int, two: int) -> float:
        """Distance two geoms must keep [m]: links of one arm only must not run into each other."""
        if pad[one] or pad[two]:
            return clearances.pad
        return clearances.arms if masters[one] != masters[two] or part[one] or part[two] else 0.0

    def first(q_master: Array, q_follower: Array) -> str:
        for master, follower in zip(q_master, q_follower, strict=True):
            data.qpos[:6] = follower
            data.qpos[FIRST_JOINT:] = master
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            contacts = data.contact
            close = [k for k in range(data.ncon) if contacts.dist[k] < least(*contacts.geom[k])]
            if close:
                pair = contacts.geom[min(close, key=lambda k: float(contacts.dist[k]))]
                return " and ".join(_SUFFIX.sub("", names[geom]) for geom in pair)
        return ""

    return first
