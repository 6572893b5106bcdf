"""The scene of two robots: the master holds the part in a gripper, the follower works on it.

Both come from the one model file. The world frame is the follower's base, so that everything that is true of the
single robot with its tool is true of the follower.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.cell.carrier import FIRST_JOINT, FOLLOWER, MASTER
from polish_sim.cell.scene import add_drawn_part, bend_arm, robot_with_tool, set_options
from polish_sim.config import Scenario
from polish_sim.errors import InputError, ReachError
from polish_sim.geometry import PartMesh
from polish_sim.models import robot_model_path
from polish_sim.motion.kinematics import NOMINAL, is_nominal

# What may touch what in a scene of two robots, before it is compiled.
#
# A cell's own geoms, capsules on the links, touch each other. Besides, pad and shaft touch the other arm and its
# gripper, never the part: the pad's contact with that is computed on its signed distance. Where a way is checked
# beforehand the links count as they are drawn, each shell by its convex hull, because they are up to 4 cm thicker than
# their capsules.

PAD: Final = ("head_pad", "head_plate", "head_shaft")
"""Geoms that are nearer to the part than the housing is."""
CAPSULES, PAD_GROUP, SHELLS, PART = 1, 2, 4, 8
"""Bits of the engine's contact types: a geom of this kind meets what has the bit in its affinity."""


def let_pad_touch(follower: Any, master: Any) -> None:
    """Let pad and shaft of one robot touch what is there of the other."""
    for name in PAD:
        follower.geom(name).contype = PAD_GROUP
    for geom in master.geoms:
        if geom.contype:
            geom.conaffinity |= PAD_GROUP


def let_shells_touch(follower: Any, master: Any, reach: float) -> None:
    """Let what is drawn of one arm meet what is drawn of the other; contacts are found up to ``reach`` [m]."""
    for geom in follower.geoms:
        if geom.name not in PAD and _solid(geom):
            geom.contype |= SHELLS
            geom.margin = reach
    for geom in master.geoms:
        if _solid(geom):
            geom.conaffinity |= PAD_GROUP | SHELLS | PART
            geom.margin = reach


def let_part_touch(part: Any, reach: float) -> None:
    """Let a carried part, as its convex hull, meet both arms."""
    geom = part.geoms[0]
    geom.contype, geom.conaffinity, geom.margin = CAPSULES | PART, CAPSULES | SHELLS, reach


def _solid(geom: Any) -> bool:
    """Whether a geom stands for the arm itself: a shell that is drawn, or what collides and is no capsule."""
    if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
        return True
    return bool(geom.contype) and geom.type != mujoco.mjtGeom.mjGEOM_CAPSULE


Array = NDArray[np.float64]

GRIPPER_LENGTH: Final = 0.1  # from the flange to its face [m]
GRIPPER_RADIUS: Final = 0.04  # [m]
GRIPPER_MASS: Final = 0.9  # [kg]
PAYLOAD_LIMIT: Final = 5.0  # of a UR5e [kg]


class Clearances(NamedTuple):
    """What is to be kept apart where a way is checked beforehand."""

    arms: float
    """Arms and tool from the other arm and its gripper, and from the part [m]."""
    pad: float
    """Pad and shaft from the other arm and its gripper [m]."""


class Held(NamedTuple):
    """A part in the master's gripper."""

    mesh: PartMesh
    """As drawn."""
    density: float
    """[kg/m^3]"""
    T_flange_part: Array
    """Where the real part is on the master's flange, shape (4, 4)."""
    nose: float = 0.0
    """How far the gripper goes on beyond its face, into an opening, until it meets the part [m]."""
    clearances: Clearances | None = None
    """For checks only: the part's hull and the links as drawn collide with what comes this close; None: a cell."""


class BuiltArms(NamedTuple):
    """Both arms as they are built, tables of Denavit-Hartenberg parameters, each (4, 6)."""

    master: Array = NOMINAL
    follower: Array = NOMINAL


AS_DRAWN: Final = BuiltArms()


def build_pair_scene(
    scenario: Scenario, T_follower_master: Array, held: Held, arms: BuiltArms = AS_DRAWN
) -> mujoco.MjModel:
    """Compile the cell of two robots.

    Args:
        scenario: Head, pad, robots and time step.
        T_follower_master: The master's base in the follower's, as it really stands, shape (4, 4).
        held: What the master holds.
        arms: The arms as they are built.

    Returns:
        The compiled model: the follower's joints and controls first, names begin with ``follower_`` and ``master_``.

    Raises:
        ReachError: The part is too heavy for the master.
    """
    scene = _file_without_keyframe(scenario)
    scene.delete(scene.body("base"))
    follower, master = robot_with_tool(scenario), _file_without_keyframe(scenario)
    for arm, table in ((master, arms.master), (follower, arms.follower)):
        if not is_nominal(table):
            bend_arm(arm, table)
    for key in list(follower.keys):
        follower.delete(key)
    master.delete(master.body("tool_mount"))
    part = _add_gripper(master, held)
    let_pad_touch(follower, master)
    if held.clearances is not None:
        reach = max(held.clearances)
        let_shells_touch(follower, master, reach)
        let_part_touch(part, reach)
    scene.worldbody.add_frame().attach_body(follower.body("base"), FOLLOWER, "")
    turn = Rotation.from_matrix(T_follower_master[:3, :3]).as_quat(scalar_first=True)
    stand = scene.worldbody.add_frame(pos=T_follower_master[:3, 3], quat=turn)
    stand.attach_body(master.body("base"), MASTER, "")
    middle = 0.5 * T_follower_master[:3, 3]
    scene.stat.center = [middle[0], middle[1], 0.35]
    return scene.compile()


def part_mass(mesh: PartMesh, density: float) -> float:
    """Mass of a solid part [kg]."""
    return density * _volume_and_center(mesh)[0]


def check_load(mesh: PartMesh, density: float) -> None:
    """Refuse a part that encloses nothing, or is too heavy for the master.

    Raises:
        InputError: Its mesh encloses no volume.
        ReachError: Says what it weighs and what the master carries.
    """
    mass = part_mass(mesh, density)
    if not mass > 0.0:
        raise InputError(
            f"the part's mesh encloses {1e6 * mass / density:.4g} cm^3, so that the master would carry no mass: it is "
            "open or its faces look inwards. Close it, or turn its faces outwards."
        )
    if mass + GRIPPER_MASS > PAYLOAD_LIMIT:
        raise ReachError(
            f"the part weighs {mass:.2f} kg: with the gripper's {GRIPPER_MASS:g} kg the master would carry more than "
            f"its {PAYLOAD_LIMIT:g} kg. Take a smaller part, or its true density with --set dual.density_kg_m3=..."
        )


def _file_without_keyframe(scenario: Scenario) -> Any:
    """The model file, stepped as everything attached to it; a keyframe of one robot fits no scene of two."""
    spec = mujoco.MjSpec.from_file(str(robot_model_path()))
    set_options(spec, scenario)
    for key in list(spec.keys):
        spec.delete(key)
    return spec


def _add_gripper(master: Any, held: Held) -> Any:
    """A plain cylinder on the flange and the part on its face; the robot has been told what it carries."""
    flange = master.body("link_6")
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    half = 0.5 * GRIPPER_LENGTH
    gripper = flange.add_body(name="gripper", gravcomp=1.0)
    gripper.add_geom(
        name="gripper", type=cylinder, size=[GRIPPER_RADIUS, half, 0.0], pos=[0.0, 0.0, half], group=2,
        mass=GRIPPER_MASS, rgba=[0.25, 0.27, 0.30, 1.0],
    )  # fmt: skip
    if held.nose > 0.0:
        gripper.add_geom(
            name="gripper_nose", type=cylinder, size=[GRIPPER_RADIUS, 0.5 * held.nose, 0.0], group=2, mass=0.0,
            pos=[0.0, 0.0, GRIPPER_LENGTH + 0.5 * held.nose], rgba=[0.25, 0.27, 0.30, 1.0],
        )  # fmt: skip
    part = add_drawn_part(master, flange, held.mesh, held.T_flange_part)
    check_load(held.mesh, held.density)
    volume, center = _volume_and_center(held.mesh)
    mass = held.density * volume
    size = np.ptp(held.mesh.vertices, axis=0)
    part.gravcomp, part.mass, part.ipos, part.explicitinertial = 1.0, mass, center, True
    part.inertia = mass / 12.0 * np.maximum((size**2).sum() - size**2, 1e-6)
    return part


def _volume_and_center(mesh: PartMesh) -> tuple[float, Array]:
    """Volume [m^3] and its centre [m] by the divergence theorem; of an open mesh what its faces enclose."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    volume = float(volumes.sum())
    return volume, (volumes @ (a + b + c)) / (4.0 * volume) if volume else np.zeros(3)


# Whether two robots, the part in the gripper and the tool come too close on the way, before anything moves.
#
# The part counts as its convex hull here, and the pad is let near it, as it is to touch it; everything else is drawn as
# it is, see ``pair_touching``.

_SUFFIXES: Final = ("_collision", "_shell", "_seam", "_cap")


class PairContacts:
    """The engine's collision check of a scene of two robots."""

    def __init__(self, model: mujoco.MjModel, clearances: Clearances) -> None:
        """Take a scene that was built with the same clearances, see ``Held``."""
        self._model, self._data, self._clearances = model, mujoco.MjData(model), clearances
        names = [model.geom(g).name for g in range(model.ngeom)]
        self._pad = np.array([name.endswith(PAD) for name in names])
        self._part = model.geom_bodyid == model.body(f"{MASTER}part").id
        self._master = np.array([name.startswith(MASTER) for name in names])

    def first(self, q_master: Array, q_follower: Array) -> str:
        """The first two things too close with joints of both arms [rad], (n, 6) each; empty if there are none."""
        for master, follower in zip(q_master, q_follower, strict=True):
            self._data.qpos[:6], self._data.qpos[FIRST_JOINT:] = follower, master
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_collision(self._model, self._data)
            contacts = self._data.contact
            close = [k for k in range(self._data.ncon) if contacts.dist[k] < self._wanted(*contacts.geom[k])]
            if close:
                pair = contacts.geom[min(close, key=lambda k: float(contacts.dist[k]))]
                return " and ".join(self._name(int(geom)) for geom in pair)
        return ""

    def _wanted(self, one: int, two: int) -> float:
        """Distance two geoms keep [m]: links of one arm only must not run into each other."""
        if self._pad[one] or self._pad[two]:
            return self._clearances.pad
        apart = self._master[one] != self._master[two] or self._part[one] or self._part[two]
        return self._clearances.arms if apart else 0.0

    def _name(self, geom: int) -> str:
        name = str(self._model.geom(geom).name)
        for suffix in _SUFFIXES:
            name = name.removesuffix(suffix)
        return name
