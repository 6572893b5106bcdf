"""What is wanted when: tare, travel, approach, touch-down, process, retract, stage after stage (layer 8a).

Transitions use only what the host computer knows: the clock, the path and the *measured* force.
"""

from __future__ import annotations

from numba import njit

from polish_sim.cell.stroke import (
    APPROACH,
    DONE,
    PROCESS,
    RETRACT,
    SEEK,
    TARE,
    TARE_START,
    TARE_TIME,
    TOUCH_DOWN,
    TOUCH_DOWN_TIME,
    TRAVEL,
    Job,
    SequenceState,
)
from polish_sim.cell.stroke_target import place_target
from polish_sim.control.signals import Target

LEAST_SHARE = 0.02  # of the planned feed a controller can slow it to: the run must end


@njit(cache=True, error_model="numpy", forceinline=True)
def advance_sequence(
    job: Job, state: SequenceState, measured_force: float, granted: float, dt: float, target: Target
) -> bool:
    """Move the target on by one step.

    Args:
        job: What is to be done.
        state: Memory.
        measured_force: Force the host believes it presses with [N].
        granted: Share of the planned feed the controller grants [-]; taken as ``LEAST_SHARE`` to 1.
        dt: Step [s].
        target: Written.

    Returns:
        False if contact was sought down to the search depth and not found.
    """
    state.stage[1] += dt
    stage = state.stage[0]
    touching = measured_force > max(job.threshold, state.floor[0])
    if stage == TARE and state.stage[1] >= TARE_START + TARE_TIME - 0.5 * dt:
        _enter(state, APPROACH if job.contact > 0.0 else PROCESS)
    elif stage == TRAVEL and state.clock[0] >= job.travel.duration:
        _enter(state, TARE if job.retare > 0.0 else APPROACH if job.contact > 0.0 else PROCESS)
        state.path[0], state.path[1] = 0.0, 0.0
    elif stage in (APPROACH, SEEK):
        if touching:
            _enter(state, TOUCH_DOWN)
        elif stage == APPROACH and state.path[0] >= job.lead_in.length:
            state.path[2] = 0.0
            _enter(state, SEEK)
        elif state.path[2] >= job.search_depth:
            return False
    elif stage == TOUCH_DOWN and state.stage[1] >= TOUCH_DOWN_TIME:
        _enter(state, PROCESS)
        state.path[0], state.path[1] = 0.0, 0.0
    elif stage == PROCESS:
        arrived = state.clock[0] >= job.motion.duration and state.stage[1] >= job.hold
        if arrived or state.stage[1] >= job.feed_time:
            _enter(state, RETRACT if job.lift > 0.0 else DONE)
            state.path[2] = 0.0
    elif stage == RETRACT and state.path[2] >= job.lift + job.depth:
        _enter(state, DONE)
    place_target(job, state, min(max(granted, LEAST_SHARE), 1.0), dt, target)
    return True


@njit(cache=True, error_model="numpy", forceinline=True)
def _enter(state: SequenceState, stage: float) -> None:
    """Begin a stage."""
    state.stage[0] = stage
    state.stage[1] = 0.0
    if stage == TOUCH_DOWN:
        # The depth at contact is kept; above the surface it is negative.
        state.path[1] = 0.0
    elif stage == PROCESS:
        state.clock[0], state.clock[1], state.clock[2] = 0.0, 1.0, 0.0
