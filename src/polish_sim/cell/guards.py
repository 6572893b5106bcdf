"""Protective stops: the conditions under which the simulated robot stops itself (layer 8a)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.wrist_sensor import SensorState
from polish_sim.control.signals import Measurement, Target
from polish_sim.geometry.distance.distance_field import DistanceField, field_distance

Array = NDArray[np.float64]

FORCE, TORQUE, LOST, FROZEN, SINGULAR, CRASH = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
MISSING, CONTROLLER_NAN, JOINT_LIMIT, UNSTABLE, ENGINE_CONTACT, CONTROLLER_ERROR = 7.0, 8.0, 9.0, 10.0, 11.0, 12.0

REASONS: Mapping[float, str] = MappingProxyType(
    {
        FORCE: "measured force above safety.force_limit_n",
        TORQUE: "measured torque above safety.torque_limit_nm",
        LOST: "contact lost for longer than safety.contact_lost_s",
        FROZEN: "wrist sensor reading frozen",
        SINGULAR: "near a singularity of the arm",
        CRASH: "tool, wrist or forearm ran into the part",
        MISSING: "no contact down to process.search_depth_m below the nominal surface: is the part there?",
        CONTROLLER_NAN: "the controller returned a value that is not finite",
        JOINT_LIMIT: "a joint reached the end of its range",
        UNSTABLE: "the simulation became unstable",
        ENGINE_CONTACT: "links of the robot touched each other or the table",
        CONTROLLER_ERROR: "the controller raised an error",
    }
)

_CRASH_ROUNDS = 16  # the links' points are looked at in turn, all within this many steps


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
    singular_value: float
    """[-]"""
    points: Array
    """Sample points on the links, body frames [m], shape (k, 3)."""
    bodies: NDArray[np.int64]
    """Body of each point, shape (k,)."""
    lost: Array
    """Time without contact so far [s], shape (1,)."""


@njit(cache=True, error_model="numpy", forceinline=True)
def check_guards(
    guards: Guards, m: Measurement, target: Target, sensor: SensorState, weakest: float, field: DistanceField,
    R_base_part: Array, p_base_part: Array, xpos: Array, xmat: Array, t: float, count: int, dt: float,
) -> float:  # fmt: skip
    """Code of the first condition that is met, 0 if none; see ``REASONS``."""
    w = m.wrench
    if math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2) > guards.force:
        return FORCE
    if math.sqrt(w[3] ** 2 + w[4] ** 2 + w[5] ** 2) > guards.torque:
        return TORQUE
    if t - sensor.clock[2] > guards.sensor_timeout and t > 2.0 * guards.sensor_timeout:
        return FROZEN
    if weakest < guards.singular_value:
        return SINGULAR
    in_process = target.contact[0] > 0.0
    guards.lost[0] = guards.lost[0] + dt if in_process and w[2] < 0.1 * target.force[0] else 0.0
    if guards.lost[0] > guards.contact_lost:
        return LOST
    if _crashed(guards, field, R_base_part, p_base_part, xpos, xmat, count % _CRASH_ROUNDS):
        return CRASH
    return 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _crashed(
    guards: Guards, field: DistanceField, R_base_part: Array, p_base_part: Array, xpos: Array, xmat: Array, first: int
) -> bool:
    near = 0.5 * field.spacing  # a sheet thinner than the grid is nowhere negative, but never further than this
    for i in range(first, guards.points.shape[0], _CRASH_ROUNDS):
        body, p = guards.bodies[i], guards.points[i]
        R = xmat[body]
        x = xpos[body, 0] + R[0] * p[0] + R[1] * p[1] + R[2] * p[2] - p_base_part[0]
        y = xpos[body, 1] + R[3] * p[0] + R[4] * p[1] + R[5] * p[2] - p_base_part[1]
        z = xpos[body, 2] + R[6] * p[0] + R[7] * p[1] + R[8] * p[2] - p_base_part[2]
        wx = R_base_part[0, 0] * x + R_base_part[1, 0] * y + R_base_part[2, 0] * z
        wy = R_base_part[0, 1] * x + R_base_part[1, 1] * y + R_base_part[2, 1] * z
        wz = R_base_part[0, 2] * x + R_base_part[1, 2] * y + R_base_part[2, 2] * z
        if field_distance(field, wx, wy, wz) < near:
            return True
    return False
