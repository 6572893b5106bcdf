"""What the robot does after a guard spoke: it brakes, goes back along the tool axis, and stands.

The stop reaches the robot by its own line; until then it goes on with what it was last told. The retract is the
robot's own motion: the controller is not asked any more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.speedl import AGE, SpeedlState
from polish_sim.config import Scenario
from polish_sim.control.signals import Measurement
from polish_sim.kernel_cache import njit

Array = NDArray[np.float64]

SENT, BRAKING, GOING_BACK, ENDING, STANDING = 0.0, 1.0, 2.0, 3.0, 4.0
STRAY = 0.005  # across the tool axis: so far from it the retract is given up (singularity, a joint's end) [m]
SHORT = 0.001  # a retract may fall short by this and still be one [m]
_PATIENCE = 2.0  # the retract may take this many times as long as planned

STAGE, SINCE, BRAKED_AT, HEIGHT = 0, 1, 2, 3


class StopMotion(NamedTuple):
    """How the robot stops."""

    latency: float
    """From the guard to the brakes [s]."""
    firmness: float
    """Deceleration as a multiple of speedl's."""
    clearance: float
    """Length of the retract [m]; 0 for none."""
    speed: float
    """Of the retract [m/s]."""
    state: Array
    """Stage, time in it [s], when the brakes came on [s], height gone back [m]; shape (4,)."""
    start: Array
    """Where the retract began [m], shape (3,)."""
    axis: Array
    """Direction of the retract, against the tool axis, shape (3,)."""


def brakes_of(scenario: Scenario) -> Array:
    """Deceleration of a protective stop [m/s^2], [rad/s^2], shape (2,): speedl's limits, both as much firmer."""
    robot, deceleration = scenario.robot, scenario.safety.stop_deceleration_m_s2
    turning = robot.angular_acceleration_rad_s2 * deceleration / robot.linear_acceleration_m_s2
    return np.array([deceleration, turning])


def build_stop_motion(scenario: Scenario, clearance: float) -> StopMotion:
    """How this scenario's robot stops; ``clearance`` [m] is how far it goes back."""
    safety = scenario.safety
    return StopMotion(
        safety.stop_latency_s,
        safety.stop_deceleration_m_s2 / scenario.robot.linear_acceleration_m_s2,
        clearance,
        safety.retract_speed_m_s,
        np.zeros(4),
        np.zeros(3),
        np.zeros(3),
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def steer_stop(
    stop: StopMotion, robot: SpeedlState, m: Measurement, inside: bool, since_stop: float, t: float, dt: float
) -> float:
    """Tell the robot what to do next, from the stop on.

    Args:
        stop: How it stops; its state is written.
        robot: The velocity interface; from the brakes on its acting request is written.
        m: Tool pose.
        inside: False if a joint was at the end of its range in the last step.
        since_stop: Time since the guard spoke [s].
        t: Time [s].
        dt: Physics step [s].

    Returns:
        Multiple of speedl's acceleration limits that holds for this step.
    """
    state = stop.state
    state[SINCE] += dt
    if state[STAGE] == SENT:
        if since_stop < stop.latency - 0.5 * dt:
            return 1.0
        _turn_to(state, BRAKING)
        state[BRAKED_AT] = t
    elif state[STAGE] == BRAKING and _at_rest(robot):
        _turn_to(state, GOING_BACK if stop.clearance > 0.0 else STANDING)
        for i in range(3):
            stop.start[i], stop.axis[i] = m.position[i], -m.rotation[i, 2]
    elif state[STAGE] == GOING_BACK and _back_enough(stop, m, inside):
        _turn_to(state, ENDING)
    elif state[STAGE] == ENDING and _at_rest(robot):
        _turn_to(state, STANDING)
    going = stop.speed if state[STAGE] == GOING_BACK else 0.0
    robot.clock[AGE] = 0.0
    for i in range(3):
        robot.request[i], robot.request[3 + i] = going * stop.axis[i], 0.0
    return 1.0 if state[STAGE] == GOING_BACK else stop.firmness


@njit(cache=True, error_model="numpy", forceinline=True)
def _turn_to(state: Array, stage: float) -> None:
    state[STAGE], state[SINCE] = stage, 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _at_rest(robot: SpeedlState) -> bool:
    size = 0.0
    for i in range(6):
        size += abs(robot.twist[i])
    return size == 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _back_enough(stop: StopMotion, m: Measurement, inside: bool) -> bool:
    """Whether the retract is done, or cannot go on as it should."""
    height = away = 0.0
    for i in range(3):
        gone = m.position[i] - stop.start[i]
        height += gone * stop.axis[i]
        away += gone * gone
    stop.state[HEIGHT] = height
    late = stop.state[SINCE] > _PATIENCE * stop.clearance / stop.speed + 0.5
    return height >= stop.clearance or away - height * height > STRAY**2 or late or not inside
