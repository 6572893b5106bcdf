"""The scene: the robot of the model file with this scenario's head, the part, what holds it and the table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import mujoco
import numpy as np

from polish_sim.arms import ARMS, FIRST, ArmTable
from polish_sim.arrays import Array
from polish_sim.cell.contact import RealPart
from polish_sim.config import Scenario
from polish_sim.exchange.log_sources import JOINT_NAMES
from polish_sim.geometry.mesh import PartMesh, lighter_mesh
from polish_sim.models import robot_model_path
from polish_sim.motion.kinematics import NOMINAL, link_poses, use_arm
from polish_sim.spatial import apply, inverse, transform, wxyz

TABLE_TOP = 0.0  # z of the table in the base frame [m]
_FROM_BELOW = -0.2  # z of a tool axis: the tool comes from below
MOST_DRAWN = 100_000  #: Facets; a finer part is drawn by a lighter copy
PART_COLOR, FIXTURE_COLOR = (0.72, 0.74, 0.78, 1.0), (0.45, 0.50, 0.58, 1.0)
_SHELL = (0.80, 0.82, 0.84, 1.0)
STAND_NAMES = ("stand", "stand_arm")
POST_AWAY, _POST = 0.15, 0.02  # of a post from the part it holds, half its thickness [m]


class Box(NamedTuple):
    """A box along the axes of the base frame."""

    middle: Array  #: [m], shape (3,)
    half: Array  #: Half its sides [m], shape (3,)


TABLE = Box(np.array([0.0, -0.57, TABLE_TOP - 0.02]), np.array([0.5, 0.42, 0.02]))
"""In front of the pedestal, its top level with the robot's base."""


class Drawn(NamedTuple):
    """A mesh and where it stands, base frame."""

    mesh: PartMesh
    part: RealPart

    @property
    def pose(self) -> Array:
        """T_base_work, shape (4, 4)."""
        return transform(self.part.rotation, self.part.position)


def build_scene(
    scenario: Scenario, part: Drawn | None = None, axes: Array | None = None, fixture: Drawn | None = None
) -> mujoco.MjModel:
    """Compile the cell; without a part it is for motion in free space.

    ``axes``: as of ``stand_of``. The meshes of part and ``fixture`` are drawn only; the pad's contact and the
    crash check are computed on their signed distance, because the engine would take the convex hull.
    """
    spec = robot_with_tool(scenario)
    if part:
        lay_part(spec, part.mesh, part.pose, axes, fixture)
    return spec.compile()


def lay_part(
    spec: Any, mesh: PartMesh, T_base_part: Array, axes: Array | None = None, fixture: Drawn | None = None
) -> None:
    """Put a part, in its fixture if it has one, on a stand on the table; both are drawn only."""
    add_table(spec)
    add_drawn_part(spec, spec.worldbody, mesh, T_base_part)
    corners = apply(T_base_part, mesh.vertices)
    if fixture:
        add_drawn_part(spec, spec.worldbody, fixture.mesh, fixture.pose, "fixture", FIXTURE_COLOR)
        corners = np.concatenate([corners, apply(fixture.pose, fixture.mesh.vertices)])
    add_stand(spec, stand_of(corners, T_base_part, axes))


def robot_with_tool(scenario: Scenario) -> Any:
    """The robot of the model file with a scenario's head and payload, to compile or attach elsewhere."""
    spec = arm_spec(scenario.robot.arm)
    spec.option.timestep = scenario.simulation.timestep_s
    head = scenario.head
    body, slide, face = spec.body("head"), spec.joint("head_slide"), spec.geom("head_pad")
    body.inertia = body.inertia * (head.mass_kg / body.mass)
    body.mass = head.mass_kg
    slide.stiffness[0], slide.damping[0] = head.stiffness_n_m * head.spring_scale, head.damping_n_s_m
    slide.range = [slide.range[0], head.travel_m]
    face.size = [scenario.pad.radius_m, *face.size[1:]]
    spec.body("tool_mount").gravcomp = 1.0 + scenario.robot.payload_error
    return spec


def arm_spec(name: str) -> Any:
    """The model file with a make of arm, not yet compiled."""
    spec = mujoco.MjSpec.from_file(str(robot_model_path()))
    arm = use_arm(name)
    if arm.links:
        _build_arm(spec, arm)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return spec


def _build_arm(spec: Any, arm: ArmTable) -> None:
    """Make the model file's arm another one: its table, links, servos, and capsules to look at."""
    bend_arm(spec, NOMINAL)
    spec.stat.extent *= sum(arm.a) / sum(ARMS[FIRST].a)
    for number, link in enumerate(arm.links, 1):
        body, j = spec.body(f"link_{number}"), number - 1
        xx, yy, zz, xy, xz, yz = link.inertia
        body.mass, body.ipos, body.fullinertia = link.mass, link.center, [xx, yy, zz, xy, xz, yz]
        for geom in list(body.geoms):
            spec.delete(geom)
        tube = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "mass": 0.0, "rgba": _SHELL}
        drawn = tube | {"contype": 0, "conaffinity": 0, "group": 2}
        shape = {"fromto": link.capsule, "size": [link.radius, 0.0, 0.0]}
        body.add_geom(name=f"link_{number}_shell", **drawn, **shape)
        if number < len(arm.links):
            body.add_geom(name=f"link_{number}_collision", group=3, **tube, **shape)
            after = arm.links[number]  # the next joint's housing reaches from this link to that one
            reach = [0.0, 0.0, link.capsule[2], 0.0, 0.0, arm.d[number] + after.capsule[2]]
            body.add_geom(**drawn, fromto=reach, size=[after.radius, 0.0, 0.0])
        hinge, drive = spec.joint(f"{JOINT_NAMES[j]}_joint"), spec.actuator(JOINT_NAMES[j])
        # Friction, rotor and servo; the engine has them where the joint is rigid.
        hinge.armature, hinge.frictionloss = arm.gears["rotor_kg_m2"][j], arm.gears["coulomb_nm"][j]
        hinge.damping[0] = arm.gears["viscous_nm_s_rad"][j]
        drive.biasprm[1], drive.biasprm[2] = -arm.stiff[j], -arm.damped[j]
        drive.forcerange = [-arm.torque[j], arm.torque[j]]


def bend_arm(spec: Any, table: Array) -> None:
    """Make the arm of a spec one with this table of Denavit-Hartenberg parameters, shape (4, 6)."""
    links = links_of(spec)
    bend_links(links, [link.joints[0] for link in links], table)


def links_of(arm: Any) -> list[Any]:
    """The six links of a spec or a model."""
    return [arm.body(f"link_{number}") for number in range(1, 7)]


def bend_links(links: Sequence[Any], joints: Sequence[Any], table: Array) -> None:
    """Place links and their joints, of a spec or a model, by a table: body ``link_i`` is frame i, its joint
    turns about z of the frame before.
    """
    for link, joint, T in zip(links, joints, link_poses(table), strict=True):
        link.pos = T[:3, 3]
        link.quat = wxyz(T[:3, :3])
        joint.axis = T[2, :3]
        joint.pos = -T[:3, :3].T @ T[:3, 3]


def add_table(spec: Any) -> None:
    """The table before the robot, on its feet."""
    middle, half = TABLE
    box = mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(name="table", type=box, size=half, pos=middle, rgba=[0.60, 0.62, 0.64, 1.0])
    for x in (-1.0, 1.0):
        for y in (-1.0, 1.0):
            foot = [middle[0] + x * (half[0] - 0.04), middle[1] + y * (half[1] - 0.04), middle[2] - 0.365]
            spec.worldbody.add_geom(
                type=box,
                size=[0.03, 0.03, 0.345],
                pos=foot,
                rgba=[0.25, 0.27, 0.30, 1.0],
                contype=0,
                conaffinity=0,
            )


def add_drawn_part(
    spec: Any,
    parent: Any,
    drawn: PartMesh,
    T_parent_part: Array,
    name: str = "part",
    color: Sequence[float] = PART_COLOR,
) -> Any:
    """Draw a part on a body; it has no mass and touches nothing. Returns its own body."""
    mesh, light = spec.add_mesh(name=name), lighter_mesh(drawn.vertices, drawn.faces, MOST_DRAWN)
    mesh.uservert = np.asarray(light.vertices, dtype=np.float32).ravel()
    mesh.userface = np.asarray(light.faces, dtype=np.int32).ravel()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    turn = wxyz(T_parent_part[:3, :3])
    body = parent.add_body(name=name, pos=T_parent_part[:3, 3], quat=turn)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        contype=0,
        conaffinity=0,
        mass=0.0,
        rgba=color,
    )
    return body


def add_stand(spec: Any, boxes: Sequence[Box]) -> None:
    """What carries the part."""
    for name, box in zip(STAND_NAMES, boxes, strict=False):
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            rgba=[0.35, 0.38, 0.42, 1.0],
            size=box.half,
            pos=box.middle,
        )


def stand_of(corners: Array, T_base_part: Array, axes: Array | None) -> list[Box]:
    """Boxes that carry a part with vertices (n, 3) [m] in the base frame; none if the part lies on the table.

    A block under it, or, where the tool comes from below anywhere by its ``axes`` from the part to the tool,
    (n, 3) in the part's frame, a post behind it with an arm.
    """
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    if low[2] - TABLE_TOP <= 0.005:
        return []
    if axes is None or (axes @ T_base_part[2, :3]).min() >= _FROM_BELOW:
        return [_standing(middle, 0.84 * half, low[2])]
    back = low[1] - POST_AWAY
    width = min(0.84 * half[0], POST_AWAY)
    post = _standing(np.array([middle[0], back, 0.0]), np.array([width, _POST, 0.0]), middle[2])
    arm = Box(
        np.array([middle[0], 0.5 * (back + low[1]), middle[2]]), np.array([width, 0.5 * POST_AWAY, _POST])
    )
    return [post, arm]


def _standing(middle: Array, half: Array, top: float) -> Box:
    """A box on the table up to a height [m], a hair of room below and above."""
    height = top - TABLE_TOP
    return Box(
        np.array([*middle[:2], TABLE_TOP + 0.5 * height - 0.0005]),
        np.array([*half[:2], 0.5 * height - 0.0005]),
    )


def touching(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """The first two bodies the engine sees in contact, by their geoms' names; empty if there are none."""
    return " and ".join(model.geom(int(g)).name for g in data.contact[0].geom) if data.ncon else ""


def touching_at(model: mujoco.MjModel, data: mujoco.MjData, q: Array) -> str:
    """`touching` with the first joints of the scene at ``q`` (n,)."""
    data.qpos[: len(q)] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    return touching(model, data)


def on_flange(data: mujoco.MjData, site: str) -> Array:
    """Pose of a site on the flange, shape (4, 4)."""
    flange, there = (
        transform(each.xmat.reshape(3, 3), each.xpos) for each in map(data.site, ("flange", site))
    )
    return inverse(flange) @ there


@cache
def tool_on_flange() -> Array:
    """Pose of the tool frame on the flange, read from the compiled robot, shape (4, 4)."""
    spec = mujoco.MjSpec.from_file(str(robot_model_path()))
    spec.compiler.discardvisual = True  # reading the drawn meshes takes longer than all else
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    T_flange_tool = on_flange(data, "tool")
    T_flange_tool.setflags(write=False)
    return T_flange_tool
