"""Where the joints are along the stream, and what they allow (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.buffers import CAPACITY, Segments
from polish_sim.motion.certified.corner_parts import Kernel, Sides, new_kernel
from polish_sim.motion.certified.corner_proof import ProofWork, new_proof_work
from polish_sim.motion.certified.corner_shapes import PIECES
from polish_sim.motion.certified.segment_limits import SegmentWork, new_segment_work, segment_limits
from polish_sim.motion.rules.limits import Arm, LimitValues, is_there
from polish_sim.motion.segment_rates import Segment

Array = NDArray[np.float64]

FASTEST, SHARPEST = 1e3, 1e9
"""Stand-ins for infinite limits [m/s, m/s^3]."""


class Robot(NamedTuple):
    """Joint angles at the way points kept, and work space."""

    q: Array
    """[rad], shape (CAPACITY + 1, 6)."""
    vectors: Array
    """Tip, direction and turn axis of two segments in the base frame, shape (2, 3, 3)."""
    frames: Array
    """Their start frames, shape (2, 3, 3)."""
    work: SegmentWork
    proof: ProofWork
    kernel: Kernel
    """A kernel or a bend to be looked at."""
    scaled: Kernel
    """Its smaller copies."""


def new_robot(arm: Arm) -> Robot:
    """A robot at the start of a path."""
    q = np.zeros((CAPACITY + 1, 6))
    q[0] = arm.q_start
    return Robot(
        q,
        np.zeros((2, 3, 3)),
        np.zeros((2, 3, 3)),
        new_segment_work(),
        new_proof_work(PIECES),
        new_kernel(PIECES),
        new_kernel(PIECES),
    )


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def base_segment(segments: Segments, k: int, arm: Arm, robot: Robot, slot: int) -> Segment:
    """Segment ``k`` as seen from the robot's base, kept in one of two slots."""
    chain = segments.chain
    if not is_there(arm):
        return Segment(
            chain.tips[k], chain.rotations[k], chain.lengths[k], chain.directions[k],
            chain.angles[k], chain.turn_axes[k], chain.rolls[k],
        )  # fmt: skip
    tip, direction, turn_axis = robot.vectors[slot, 0], robot.vectors[slot, 1], robot.vectors[slot, 2]
    frame, T = robot.frames[slot], arm.T_base_work
    for i in range(3):
        tip[i], direction[i], turn_axis[i] = T[i, 3], 0.0, 0.0
        for j in range(3):
            tip[i] += T[i, j] * chain.tips[k, j]
            direction[i] += T[i, j] * chain.directions[k, j]
            turn_axis[i] += T[i, j] * chain.turn_axes[k, j]
            frame[i, j] = (
                T[i, 0] * chain.rotations[k, 0, j]
                + T[i, 1] * chain.rotations[k, 1, j]
                + T[i, 2] * chain.rotations[k, 2, j]
            )
    return Segment(tip, frame, chain.lengths[k], direction, chain.angles[k], turn_axis, chain.rolls[k])


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def base_sides(segments: Segments, k: int, arm: Arm, robot: Robot) -> Sides:
    """The corner before segment ``k`` as seen from the robot's base."""
    return Sides(
        base_segment(segments, k - 1, arm, robot, 0),
        base_segment(segments, k, arm, robot, 1),
        (segments.spans[k - 1], segments.spans[k]),
    )


@njit(cache=True, error_model="numpy")
def axis_radius(limits: LimitValues) -> float:
    """Tip length that takes as long as a turn of the axis by one radian, at full speed [m]."""
    if math.isinf(limits.axis_speed) or math.isinf(limits.tip_speed):
        return 1.0
    return limits.tip_speed / limits.axis_speed


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def fill_limits(segments: Segments, k: int, feed: float, limits: LimitValues, arm: Arm, robot: Robot) -> int:
    """Write generalised length of a segment and the limits along it, and the joints at its end.

    Args:
        segments: Filled at ``k``.
        k: The segment; its geometry is known.
        feed: Cap on the tip's speed [m/s].
        limits: Of tool and joints.
        arm: Tool and robot, or `arm_or_none`.
        robot: Joints at the segment's start; filled with those at its end.

    Returns:
        What `segment_limits` says.
    """
    chain, row = segments.chain, segments.limits[k]
    turn = max(chain.angles[k], abs(chain.rolls[k]))
    span = max(chain.lengths[k], turn * axis_radius(limits))
    segments.spans[k] = span
    q = robot.q[k + 1]
    for j in range(6):
        q[j] = robot.q[k, j]
    status = segment_limits(base_segment(segments, k, arm, robot, 0), span, limits, arm, q, row, robot.work)
    cap = feed * span / chain.lengths[k] if chain.lengths[k] > 0.0 else math.inf
    for i in range(0, 6, 3):
        row[i] = min(row[i], FASTEST, cap)
        row[i + 2] = min(row[i + 2], SHARPEST)
        # More than this is never reached on the way to full speed.
        row[i + 1] = min(row[i + 1], math.sqrt(row[i] * row[i + 2]))
    return int(status)
