"""The robot's velocity interface ``speedl(twist, acceleration, time)`` down to the joint servos.

The commanded tool velocity follows the request within linear and angular acceleration limits, acts after a latency
and decelerates to rest by itself when the time given runs out. Joint speeds come from the damped inverse of the
Jacobian at the measured joints; they are scaled to their limits together, so that the direction is kept.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import Scenario
from polish_sim.kernel_cache import njit
from polish_sim.motion import JOINT_LIMITS

Array = NDArray[np.float64]

SPARE = 200  # steps the latency can grow by while running
_PROBE_EVERY = 8  # steps between looks at how near a singularity is

STEPS, AGE, WEAKEST = 0, 1, 2  # of the clock
NUMBER = 6  # of a request, behind its twist


class SpeedlModel(NamedTuple):
    """Limits of the interface."""

    latency: int
    """Steps from request to action."""
    acceleration: float
    """[m/s^2]"""
    angular_acceleration: float
    """[rad/s^2]"""
    timeout: float
    """A request holds this long [s]."""
    joint_speed: float
    """[rad/s]"""
    lowest: Array
    """Joint positions [rad], shape (6,)."""
    highest: Array
    """Joint positions [rad], shape (6,)."""
    damping_onset: float
    """Smallest singular value below which the inverse is damped [-]."""


class SpeedlState(NamedTuple):
    """Memory of the interface."""

    line: Array
    """Requests under way: twist and its number, shape (latency + SPARE + 1, 7)."""
    twist: Array
    """Tool velocity commanded now, shape (6,)."""
    request: Array
    """Request acting now: twist and its number, shape (7,)."""
    clock: Array
    """Steps taken, age of the acting request [s], smallest singular value, shape (3,)."""
    joints: Array
    """Commanded joint positions [rad], shape (6,)."""
    speeds: Array
    """Commanded joint speeds [rad/s], shape (6,)."""
    probe: Array
    """Running estimate of the weakest direction, shape (6,)."""
    work: Array
    """Work arrays: a 6x6 matrix and two vectors, shape (8, 6)."""


def build_speedl(scenario: Scenario) -> SpeedlModel:
    """The robot's velocity interface as a scenario wants it."""
    robot, dt = scenario.robot, scenario.simulation.timestep_s
    return SpeedlModel(
        round(robot.command_latency_s / dt),
        robot.linear_acceleration_m_s2,
        robot.angular_acceleration_rad_s2,
        robot.command_timeout_s,
        robot.joint_speed_limit_rad_s,
        JOINT_LIMITS[:, 0].copy(),
        JOINT_LIMITS[:, 1].copy(),
        2.0 * scenario.safety.singular_value_limit,
    )


def build_speedl_state(model: SpeedlModel, joints: Array) -> SpeedlState:
    """Fresh memory of a robot at rest at ``joints`` [rad], shape (6,)."""
    return SpeedlState(
        np.zeros((model.latency + SPARE + 1, 7)),
        np.zeros(6),
        np.zeros(7),
        np.array([0.0, 0.0, 1.0]),
        joints.copy(),
        np.zeros(6),
        np.full(6, 1.0 / math.sqrt(6.0)),
        np.zeros((8, 6)),
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def pass_request(model: SpeedlModel, state: SpeedlState, requested: Array, number: float, dt: float) -> None:
    """Send the newest request down the line and let the one that arrives act.

    Args:
        model: Limits.
        state: Memory; ``request`` and its age are written.
        requested: Twist the host asked for last, shape (6,).
        number: Counts the host's requests; an unchanged number ages.
        dt: Physics step [s].
    """
    state.clock[STEPS] += 1.0
    length = state.line.shape[0]
    slot = int(state.clock[STEPS]) % length
    for i in range(6):
        state.line[slot, i] = requested[i]
    state.line[slot, NUMBER] = number
    due = (slot - model.latency) % length
    if state.line[due, NUMBER] > state.request[NUMBER]:
        for i in range(7):
            state.request[i] = state.line[due, i]
        state.clock[AGE] = 0.0
    else:
        state.clock[AGE] += dt


@njit(cache=True, error_model="numpy", forceinline=True)
def limit_acceleration(model: SpeedlModel, state: SpeedlState, dt: float, firmness: float = 1.0) -> None:
    """Move the commanded twist toward the acting request within ``firmness`` times the acceleration limits."""
    alive = 1.0 if state.clock[AGE] < model.timeout else 0.0
    for start, limit in ((0, firmness * model.acceleration), (3, firmness * model.angular_acceleration)):
        x = alive * state.request[start] - state.twist[start]
        y = alive * state.request[start + 1] - state.twist[start + 1]
        z = alive * state.request[start + 2] - state.twist[start + 2]
        size = math.sqrt(x * x + y * y + z * z)
        share = 1.0 if size <= limit * dt else limit * dt / size
        state.twist[start] += share * x
        state.twist[start + 1] += share * y
        state.twist[start + 2] += share * z


@njit(cache=True, error_model="numpy", forceinline=True)
def resolve_joints(model: SpeedlModel, state: SpeedlState, jacobian: Array, dt: float) -> bool:
    """Joint speeds for the commanded twist, and the joint positions they lead to.

    Args:
        model: Limits.
        state: Memory; ``speeds``, ``joints`` and the smallest singular value are written.
        jacobian: Geometric Jacobian at the tool point, base frame, shape (6, 6).
        dt: Physics step [s].

    Returns:
        False if a joint would leave its range; it is held there.
    """
    A, y = state.work[0:6], state.work[6]
    if int(state.clock[STEPS]) % _PROBE_EVERY == 0:
        _gram(jacobian, 0.0, A)
        state.clock[WEAKEST] = _weakest_direction(A, state.probe, y)
    # Damping grows from nothing at the onset, so that the inverse is exact away from singularities.
    damping = 0.5 * max(model.damping_onset - state.clock[WEAKEST], 0.0)
    _gram(jacobian, damping * damping, A)
    _cholesky(A)
    _solve(A, state.twist, y)
    fastest = 0.0
    for j in range(6):
        total = 0.0
        for i in range(6):
            total += jacobian[i, j] * y[i]
        state.speeds[j] = total
        fastest = max(fastest, abs(total))
    scale = 1.0 if fastest <= model.joint_speed else model.joint_speed / fastest
    inside = True
    for j in range(6):
        state.speeds[j] *= scale
        wanted = state.joints[j] + state.speeds[j] * dt
        if wanted < model.lowest[j] or wanted > model.highest[j]:
            inside = False
            state.speeds[j] = 0.0
        else:
            state.joints[j] = wanted
    return inside


@njit(cache=True, error_model="numpy", forceinline=True)
def _gram(jacobian: Array, damping: float, A: Array) -> None:
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(6):
                total += jacobian[i, k] * jacobian[j, k]
            A[i, j] = total
            A[j, i] = total
        A[i, i] += damping + 1e-12


@njit(cache=True, error_model="numpy", forceinline=True)
def _cholesky(A: Array) -> None:
    """Factor in place; the lower triangle holds the factor."""
    for i in range(6):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            A[i, j] = math.sqrt(max(total, 1e-18)) if i == j else total / A[j, j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _solve(L: Array, b: Array, x: Array) -> None:
    for i in range(6):
        total = b[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]
    for i in range(5, -1, -1):
        total = x[i]
        for k in range(i + 1, 6):
            total -= L[k, i] * x[k]
        x[i] = total / L[i, i]


@njit(cache=True, error_model="numpy", forceinline=True)
def _weakest_direction(A: Array, probe: Array, x: Array) -> float:
    """Smallest singular value of J from J J^T by one inverse iteration; ``probe`` remembers the direction.

    Args:
        A: J J^T, shape (6, 6); overwritten.
        probe: Unit vector of the last iteration, shape (6,); overwritten.
        x: Work array, shape (6,).
    """
    _cholesky(A)
    _solve(A, probe, x)
    size = 0.0
    for i in range(6):
        size += x[i] * x[i]
    size = math.sqrt(size)
    for i in range(6):
        probe[i] = x[i] / size
    return 1.0 / math.sqrt(size)
