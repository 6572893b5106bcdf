"""One stroke, from free space to free space: its stages, what is to be done, what is remembered (layer 8a)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.timed_path import TimedPath
from polish_sim.motion.trajectory import PathTable

Array = NDArray[np.float64]

TARE, TRAVEL, APPROACH, SEEK, TOUCH_DOWN, PROCESS, RETRACT, DONE = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0

TARE_START = 0.15  # the robot stands still this long before the sensor is zeroed [s]
TARE_TIME = 0.25  # readings averaged for zeroing [s]
TOUCH_DOWN_TIME = 0.35  # from measured contact to the start of the feed [s]
RETRACT_SPEED = 0.02  # [m/s]


class Job(NamedTuple):
    """One stroke, from free space to free space; tables in the base frame."""

    travel: TimedPath
    """From where the last stroke ended to where this one starts, in free space."""
    lead_in: PathTable
    """From the start down to the first process point on the unpressed surface."""
    process: PathTable
    """The process path, pressed in by D = F/k; its shares say how force and feed change along it."""
    motion: TimedPath
    """How it is followed: the target's motion; its places are those of ``process``."""
    depth: float
    """D at the first process point [m]."""
    force: float
    """[N]"""
    contact: float
    """1 if there is a part to press on, 0 for motion in free space."""
    approach_speed: float
    """[m/s]"""
    feed: float
    """[m/s]"""
    threshold: float
    """Measured force that counts as contact [N]."""
    search_depth: float
    """How far past the nominal surface contact is sought [m]."""
    hold: float
    """Time at the end of the path before the retract [s]."""
    feed_time: float
    """The feed stops after this long [s]; infinite for the whole path."""
    lift: float
    """Height of the retract [m]; 0 ends the run without one."""
    start_s: float
    """Arc length of the plan at the first process point [m]."""
    retare: float = 0.0
    """1 if the sensor is zeroed again before this stroke."""


class SequenceState(NamedTuple):
    """Memory of the sequence."""

    stage: Array
    """Stage and time in it [s], shape (2,)."""
    path: Array
    """Place on the active table [m], its speed [m/s], depth of the target below the surface [m], shape (3,)."""
    clock: Array
    """Time of the active motion [s], the rate at which it passes [-], its change [1/s], shape (3,)."""
    quaternion: Array
    """Work array, shape (4,)."""
    tangent: Array
    """Work array, shape (3,)."""
    turning: Array
    """Work array, shape (3,)."""
    place: Array
    """Work array, shape (2,)."""
    row: NDArray[np.int64]
    """Row of the process table, shape (1,)."""
    floor: Array
    """Five standard deviations of the measured force in free space: less is no contact [N], shape (1,)."""


def build_sequence_state() -> SequenceState:
    """Fresh memory, at the start of the tare."""
    return SequenceState(
        np.zeros(2), np.zeros(3), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3),
        np.zeros(2), np.zeros(1, np.int64), np.zeros(1),
    )  # fmt: skip


def begin_next_stroke(state: SequenceState) -> None:
    """Go on with the next stroke's travel; its job must be the one given to ``advance_sequence`` from now on."""
    state.stage[:] = TRAVEL, 0.0
    state.path[:] = 0.0
    state.clock[:] = 0.0, 1.0, 0.0


def expected_duration(job: Job) -> float:
    """How long the job takes if contact is where it is expected [s]."""
    approach = job.travel.duration + (job.lead_in.length / job.approach_speed if job.contact else 0.0)
    feed = min(max(job.motion.playing_time, job.hold), job.feed_time)
    return TARE_START + TARE_TIME + approach + TOUCH_DOWN_TIME * job.contact + feed + job.lift / RETRACT_SPEED
