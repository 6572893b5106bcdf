"""Step cells from Python: actions, observations and rewards in compiled code.

What a step works on is put together once an episode; a step passes its address.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.gears import RealArm
from polish_sim.cell.guards import NO_STOP
from polish_sim.cell.kernel import CellKernel
from polish_sim.cell.loop import advance
from polish_sim.cell.recorder import Recorder
from polish_sim.cell.stroke import FEEDING, RETRACT
from polish_sim.control import hybrid, signals
from polish_sim.control.loops import rotation_error
from polish_sim.kernel_cache import cfunc, njit
from polish_sim.kernels import Bundle, Record, Vector3, Vector6, kernel, matvec, minus, set_to
from polish_sim.log import APPROACH_PHASE, PROCESS_PHASE, RETRACT_PHASE

# Observations: what the host knows. Vectors are in tool axes, everything is divided by a scale.

OBSERVATION = {
    "force": (3, 20.0),
    "torque": (3, 1.0),
    "force_error": (1, 20.0),
    "set_force": (1, 20.0),
    "contact": (1, 1.0),
    "position_error": (3, 0.001),
    "rotation_error": (3, 0.01),
    "velocity": (3, 0.05),
    "turning": (3, 0.5),
    "planned_velocity": (3, 0.05),
    "planned_turning": (3, 0.5),
    "curvature": (1, 10.0),
}
"""Width and scale [SI] of each part, in order: wrench as the sensor gives it, set force less measured force,
planned pose less the encoders', velocities. The last action follows."""
Numbers = NDArray[np.float32]
SEEN = sum(width for width, _ in OBSERVATION.values())
LARGEST = 1000.0  #: A number of an observation is cut off here
_SCALES = np.repeat(
    [scale for _, scale in OBSERVATION.values()], [width for width, _ in OBSERVATION.values()]
)


# Actions: what a policy commands, and the compiled law that passes it on at every cycle of the host.


class ActionContext(Record):
    """What the laws of this file read and write."""

    gains: hybrid.HybridGains
    memory: hybrid.HybridMemory
    command: Vector6  #: The action in SI
    feed: float  #: Share of the planned feed that is granted [-]
    turn: Vector3  #: Work array
    seen: Annotated[Array, (SEEN,)]  #: What was observed last


_CONTEXT = ActionContext.dtype


@kernel
def _offset_plan(c: ActionContext, t: signals.Target, offset: Array, planned: Array) -> None:
    """Add to a planned velocity what keeps the loops of eq. 6 and 7 an ``offset`` in tool axes off the
    planned pose."""
    set_to(c.turn, matvec(t.rotation, offset))
    for i in range(3):
        planned[i] += c.turn[i] / c.gains.orientation.look_ahead


@cfunc(signals.LAW_SIGNATURE)
def _twist_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    c, m, _, out = signals.records_at(context, _CONTEXT, measurement, target, answer)
    set_to(out.twist[0:3], matvec(m.rotation, c.command[0:3]))
    set_to(out.twist[3:6], matvec(m.rotation, c.command[3:6]))
    out.feed = c.feed


@cfunc(signals.LAW_SIGNATURE)
def _servo_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    c, m, t, out = signals.records_at(context, _CONTEXT, measurement, target, answer)
    _offset_plan(c, t, c.command[0:3], t.twist[0:3])
    _offset_plan(c, t, c.command[3:6], t.twist[3:6])
    hybrid.follow_plan(m, t, c.gains, c.memory, out.twist)
    out.feed = c.feed


@cfunc(signals.LAW_SIGNATURE)
def _force_and_feed_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    c, m, t, out = signals.records_at(context, _CONTEXT, measurement, target, answer)
    planned = t.force
    _offset_plan(c, t, c.command[1:4], t.twist[3:6])
    t.force = max(planned + c.command[0], 0.0)
    hybrid.position_by_velocity(m, t, c.gains.position, c.memory, out.twist)
    hybrid.press_hybrid(m, t, c.gains, c.memory, out.twist)
    out.feed, t.force = c.feed, planned  # the guards go by the plan


class ActionKind(NamedTuple):
    """What an action means."""

    law: Any
    text: str
    scale: Mapping[str, float]  #: What 1 stands for [SI], by the names of its numbers


ACTIONS = {
    "twist": ActionKind(
        _twist_law,
        "velocity of the tool, tool axes",
        {"v_x": 0.1, "v_y": 0.1, "v_z": 0.1, "w_x": 1.0, "w_y": 1.0, "w_z": 1.0},
    ),
    "servo": ActionKind(
        _servo_law,
        "offset of the tool's pose from the planned one, tool axes, for hybrid-pi's position loops",
        {"x": 0.005, "y": 0.005, "z": 0.005, "r_x": 0.05, "r_y": 0.05, "r_z": 0.05},
    ),
    "force-and-feed": ActionKind(
        _force_and_feed_law,
        "change of the set force and tilt about tool x and y, for the loops of hybrid-pi",
        {"force": 10.0, "tilt_x": 0.05, "tilt_y": 0.05},
    ),
}
"""Where the tool is fed along a path, each has one more number: -1 grants none of the planned feed, 1 all of
it."""


@kernel
def observe(m: signals.Measurement, t: signals.Target, c: ActionContext) -> None:
    """Write ``c.seen``, what `OBSERVATION` lists."""
    seen = c.seen
    for i in range(6):
        seen[i] = m.wrench[i]
    seen[6], seen[7], seen[8] = t.force - m.wrench[2], t.force, t.contact
    set_to(seen[9:12], matvec(m.rotation.T, minus(t.position, m.position)))
    rotation_error(m.rotation, t.rotation, c.turn)
    set_to(seen[12:15], matvec(m.rotation.T, c.turn))
    set_to(seen[15:18], matvec(m.rotation.T, m.twist[0:3]))
    set_to(seen[18:21], matvec(m.rotation.T, m.twist[3:6]))
    set_to(seen[21:24], matvec(m.rotation.T, t.twist[0:3]))
    set_to(seen[24:27], matvec(m.rotation.T, t.twist[3:6]))
    seen[27] = t.curvature
    for i in range(SEEN):
        value = seen[i] / _SCALES[i]
        seen[i] = min(max(value, -LARGEST), LARGEST) if math.isfinite(value) else 0.0


@cfunc(signals.LAW_SIGNATURE)
def observe_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    """`observe` for a controller: it answers nothing."""
    c, m, t, _ = signals.records_at(context, _CONTEXT, measurement, target, answer)
    observe(m, t, c)


# A step of an environment: the loop from one action to the next.

#: The force is held where its error is within this, as in the scorecard's settling time [N]
BAND_N = 1.0
SPARE = 64  #: Steps a host may be late by
ON_THE_WAY = 0.1  #: Largest dense reward of a step before contact
_ASTRAY_M, _ASKEW_RAD = 0.01, 0.2  # errors of pose at which a step is worth nothing


class EnvState(Record):
    """How an environment stands."""

    every: int  #: Physics steps an action holds
    due: int  #: Steps from which on the next action is asked for
    drawn_from: int  #: Step of the first row of the drawn numbers
    moving: bool  #: The tool is fed along a path
    feed: float  #: Planned speed of that [m/s]
    scale: Vector6  #: What 1 of an action stands for [SI]
    last_stroke: bool
    longest: int  #: Steps of the longest episode
    force_after: float  #: Time in contact from which another force is set [s]; infinite for none
    eventful: bool  #: Faults are planned


class Kept(Bundle):
    """Everything a step works on."""

    cell: CellKernel
    arm: RealArm
    recorder: Recorder  #: Its trace holds the whole episode
    draws: Array  #: Standard normal numbers, shape (k, 12)
    turn: EnvState
    context: ActionContext
    action: NDArray[np.float32]  #: Each number within -1 to 1
    seen: NDArray[np.float32]  #: The observation
    truth: NDArray[np.void]  #: The last step of the trace, shape (1,)


class StepEnd(NamedTuple):
    """How a step ended."""

    reward: float  #: Dense
    asks: bool  #: The next action is asked for; else the stroke or the episode is over
    needs: bool  #: Something is to be done before the next step: noise to be drawn, another force to be set


@kernel
def _reward(trace: NDArray[np.void], steps: int, force: float, turn: EnvState, share: float) -> float:
    """Mean over the steps of how well the ``force`` [N] was held, 0 to 1; see docs/learning.md."""
    total = 0.0
    for k in range(steps):
        step = trace[k]
        if step.phase == APPROACH_PHASE:
            total += ON_THE_WAY * max(0.0, 1.0 - step.position_error_m / _ASTRAY_M)
        elif step.phase < RETRACT_PHASE:
            error = abs(step.normal_force_n - force)
            worth = 0.5 * max(0.0, 1.0 - error / force) + 0.5 * max(0.0, 1.0 - error / BAND_N)
            if turn.moving:
                worth *= max(0.0, 1.0 - step.orientation_error_rad / _ASKEW_RAD)
            total += worth * share if step.phase == PROCESS_PHASE else worth
    return total / max(steps, 1)


@njit
def take_step(k: Kept) -> StepEnd:
    """Command the action until the next one is due."""
    state = k.cell.state
    turn = k.turn
    status = k.cell.state.status
    sizes = k.action.shape[0]
    for i in range(sizes):
        value = min(max(float(k.action[i]), -1.0), 1.0)
        if turn.moving and i == sizes - 1:
            k.context.feed = 0.5 * (value + 1.0)
        else:
            k.context.command[i] = turn.scale[i] * value
    start, force = status.steps, state.target.force
    turn.due += turn.every
    status.wait_from = turn.due
    trace = k.recorder.trace[start:]
    k.recorder.filled.first = start
    draws = k.draws[start - turn.drawn_from :]
    advance(k.cell, k.arm, k.recorder, draws, min(len(draws), len(trace)))
    done = status.steps - start
    share = 1.0
    if turn.moving:
        share = min(state.target.speed / turn.feed, 1.0)
    reward = _reward(trace, done, force, turn, share)
    lifted = turn.last_stroke and state.sequence.stage >= RETRACT
    asks = status.waiting and status.stop == NO_STOP and not lifted and status.steps < turn.longest
    left = len(k.draws) - (status.steps - turn.drawn_from)
    held = state.sequence.time if state.sequence.stage == FEEDING else 0.0
    needs = turn.eventful or left < turn.every + SPARE or held >= turn.force_after
    if done > 0:
        k.truth[0] = trace[done - 1]
    observe(state.measurement, state.target, k.context)
    for i in range(SEEN):
        k.seen[i] = k.context.seen[i]
    for i in range(sizes):
        k.seen[SEEN + i] = k.action[i]
    return StepEnd(reward, asks, needs)
