"""Protective stops: the conditions under which the simulated robot stops itself, and what each is called."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.config import Scenario
from polish_sim.models import robot_model_path

Array = NDArray[np.float64]

FORCE, TORQUE, LOST, FROZEN, SINGULAR, CRASH = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
MISSING, CONTROLLER_NAN, JOINT_LIMIT, UNSTABLE, ENGINE_CONTACT, CONTROLLER_ERROR = 7.0, 8.0, 9.0, 10.0, 11.0, 12.0
NO_READING, JUMP, SILENT_HOST, SPINDLE, HIGH, LOW, RISEN, FALLEN = 13.0, 14.0, 15.0, 16.0, 17.0, 18.0, 19.0, 20.0
MASTER_HALTED, MASTER_SILENT = 21.0, 22.0

REASONS: Mapping[float, str] = MappingProxyType(
    {
        FORCE: "measured force above safety.force_limit_n",
        TORQUE: "measured torque above safety.torque_limit_nm",
        LOST: "contact lost for longer than safety.contact_lost_s",
        FROZEN: "wrist sensor reading frozen",
        NO_READING: "wrist sensor reading missing",
        JUMP: "wrist sensor reading jumped by more than safety.jump_limit_n",
        SINGULAR: "near a singularity of the arm",
        CRASH: "tool, wrist or forearm ran into the part",
        MISSING: "no contact down to process.search_depth_m below the nominal surface: is the part there?",
        HIGH: "the part is higher than planned: contact found more than safety.offset_limit_m above its surface",
        LOW: "the part is lower than planned: contact found more than safety.offset_limit_m below its surface",
        RISEN: "the surface has risen by more than safety.offset_limit_m",
        FALLEN: "the surface has fallen away by more than safety.offset_limit_m: has the part or the reading drifted?",
        SPINDLE: "the spindle is below 80% of its speed",
        CONTROLLER_NAN: "the controller returned a value that is not finite",
        CONTROLLER_ERROR: "the controller raised an error",
        SILENT_HOST: "no command from the host for longer than robot.command_timeout_s",
        MASTER_HALTED: "the master stopped itself",
        MASTER_SILENT: "no position of the master for longer than safety.master_timeout_s",
        JOINT_LIMIT: "a joint reached the end of its range",
        UNSTABLE: "the simulation became unstable",
        ENGINE_CONTACT: "links of the robot touched each other, the table or another robot",
    }
)

FOLLOW_S = 0.005  # the reading is compared with itself, smoothed over this time
SPINDLE_SHARE = 0.8  # of the commanded speed, at least
HELD_S = 0.1  # the force within a quarter of what is wanted for this long counts as held

HELD, DEPTH, WAS_HELD = 0, 1, 2  # of ``Guards.held``


class Guards(NamedTuple):
    """Limits and what they watch."""

    force: float
    """[N]"""
    torque: float
    """[N m]"""
    contact_lost: float
    """[s]"""
    sensor_timeout: float
    """[s]"""
    jump: float
    """Of the reading against itself smoothed [N]; infinite for none."""
    singular_value: float
    """[-]"""
    offset: float
    """Of the surface from where it was planned [m]."""
    master_timeout: float
    """[s]"""
    points: Array
    """Sample points on the links, body frames [m], shape (k, 3)."""
    bodies: NDArray[np.int64]
    """Body of each point, shape (k,)."""
    lost: Array
    """Time without contact so far [s], shape (1,)."""
    smooth: Array
    """The reading's force, smoothed, sensor frame [N], shape (3,)."""
    held: Array
    """Time the force has been held [s], tool's depth at contact, then when it first was [m], 1 once it was; (3,)."""


def build_guards(scenario: Scenario, points: Array, bodies: NDArray[np.int64]) -> Guards:
    """Limits of a scenario.

    Args:
        scenario: The scenario.
        points: Sample points on the links, body frames [m], shape (k, 3).
        bodies: Body of each point, shape (k,).
    """
    safety, sensor = scenario.safety, scenario.sensor
    # Without noise a robot at rest reads the same all the time, which is no fault.
    restless = min(sensor.force_noise_n - sensor.force_quantum_n, sensor.torque_noise_nm) > 0.0
    return Guards(
        safety.force_limit_n,
        safety.torque_limit_nm,
        safety.contact_lost_s,
        safety.sensor_timeout_s if restless else math.inf,
        safety.jump_limit_n or math.inf,
        safety.singular_value_limit,
        safety.offset_limit_m,
        safety.master_timeout_s,
        points,
        bodies,
        np.zeros(1),
        np.zeros(3),
        np.zeros(3),
    )


# Sample points on shaft, spindle, sensor, wrist and forearm that must stay out of the part.

BODIES = ("tool_mount", "link_6", "link_5", "link_4", "link_3")
_SHAFT = "head_shaft"
_SPACING = 0.03  # one point is kept in each cube of this side [m]
_AROUND = 12  # points of a ring around the shaft


def crash_points(model: mujoco.MjModel, arm: str = "") -> tuple[Array, NDArray[np.int64]]:
    """Points spread over the drawn meshes of the links behind the pad, and over the shaft it turns on.

    Args:
        model: The compiled scene.
        arm: What the names of the arm with the tool begin with.

    Returns:
        Points in their bodies' frames [m], shape (k, 3), and the body of each, shape (k,).
    """
    on_shaft = _on_cylinder(model, model.geom(f"{arm}{_SHAFT}").id)
    points, bodies = [on_shaft], [np.full(len(on_shaft), model.body(f"{arm}head").id)]
    for body in (model.body(arm + name).id for name in BODIES):
        drawn = (model.geom_bodyid == body) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
        for geom in np.flatnonzero(drawn):
            R = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
            spread = _thinned(R.apply(_vertices(model, int(model.geom_dataid[geom]))) + model.geom_pos[geom])
            points.append(spread)
            bodies.append(np.full(len(spread), body))
    return np.concatenate(points), np.concatenate(bodies).astype(np.int64)


@cache
def shaft_points() -> Array:
    """Points on the shaft, frame of the tool with the head's spring at rest [m], shape (k, 3)."""
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    points = _on_cylinder(model, model.geom(_SHAFT).id)
    points.setflags(write=False)
    return points


def _on_cylinder(model: mujoco.MjModel, geom: int) -> Array:
    """Points around a cylinder from end to end, frame of its body [m], shape (k, 3)."""
    radius, half = model.geom_size[geom, :2]
    around = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    rings = np.linspace(-half, half, int(np.ceil(2.0 * half / _SPACING)) + 1)
    angle, z = (grid.ravel() for grid in np.meshgrid(around, rings))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    R = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
    return np.asarray(R.apply(points) + model.geom_pos[geom])


def _vertices(model: mujoco.MjModel, mesh: int) -> Array:
    start = model.mesh_vertadr[mesh]
    return np.asarray(model.mesh_vert[start : start + model.mesh_vertnum[mesh]], dtype=np.float64)


def _thinned(points: Array) -> Array:
    _, kept = np.unique(np.round(points / _SPACING).astype(int), axis=0, return_index=True)
    return points[kept]
