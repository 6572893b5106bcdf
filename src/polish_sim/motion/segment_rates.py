"""Joint angles and derivatives along a motion in time, and along the segments of a chain by their progress.

With x' the tool's twist (linear; angular) and J q' = x', each further derivative of q solves the same system:
J q'' = x'' - J' q', J q''' = x''' - 2 J' q'' - J'' q'. What is subtracted is the tool's own acceleration and
jerk when the joints have none, found by adding the links' motions up from the base.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, by_slices
from polish_sim.errors import ReachError, place_in_mm
from polish_sim.kernel_cache import njit
from polish_sim.motion.derivatives import carried, jet_of
from polish_sim.motion.kinematics import (
    arm_lengths,
    beyond_range,
    jacobian,
    link_frames,
    solve_on_branch,
)
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm
from polish_sim.motion.rules.schedule import Samples, Schedule, Smoothed
from polish_sim.spatial import inverse, place_of, transform

SINGULAR = 1e-14  #: Determinant of the Jacobian below which the arm is singular [m^3]


class JointRates(NamedTuple):
    """Joint angles and their derivatives at n places."""

    q: Array  #: [rad], shape (n, 6)
    first: Array  #: By progress or time, shape (n, 6)
    second: Array
    third: Array


def chain_rates(chain: Chain, nodes: Array, arm: Arm) -> JointRates:
    """Joint angles and derivatives by progress at the same ``nodes`` (m,) of each of n segments, shape (n, m,
    6).

    The chain is in the work frame; see `chebyshev_nodes`. Divide by length^k for derivatives by arc length.

    Raises:
        ReachError: A place cannot be reached, is singular, or has a joint beyond its range.
    """
    n, m = len(chain.lengths), len(nodes)
    starts: Array = 2.0 * np.arange(n, dtype=np.float64)
    # At a constant rate past the end of each segment: derivatives there are not those at rest.
    steady = Schedule(np.arange(n), starts, np.full(n, 1.5), np.tile([0.0, 1.0, 0.0, 0.0], (n, 1)), 2.0 * n)
    tool = Smoothed(chain, steady).sample((starts[:, None] + nodes).ravel())
    rates = sampled_joints(tool, arm, m)
    said = "a joint leaves its range in {}. Begin with the joint turned back, or turn the tool."
    _refuse(np.any(beyond_range(rates.q), axis=1), tool.tips[:, 0], m, said)
    return JointRates(*(column.reshape(n, m, 6) for column in rates))


def chebyshev_nodes(count: int) -> Array:
    """Extremes of a Chebyshev polynomial on [0, 1], both ends included, rising, shape (count,)."""
    return 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count))


def joint_motion(
    tips: Array, rotations: Array, linear: Array, angular: Array, arm: Arm, together: int = 1
) -> JointRates:
    """Joint motion (n, 6) of a tool motion given with its derivatives in time, exact at every sample.

    Tool points (n, 3) [m] and R_work_tool (n, 3, 3) are dense enough to stay on one branch of the arm.
    ``linear`` holds velocity, acceleration and jerk of the tool point, ``angular`` the spatial angular
    velocity and its first two derivatives, (3, n, 3) each, SI, work frame. An error counts as many samples
    ``together`` as one segment.

    Raises:
        ReachError: A sample cannot be reached, or is singular.
    """
    poses = arm.T_base_work @ transform(rotations, tips) @ inverse(arm.T_flange_tool)
    q = np.full((len(tips), 6), np.nan)
    _follow_branch(arm_lengths(), poses, np.array(arm.q_start), q)
    out_of_reach = "the arm cannot reach {}. Move the part or turn the tool."
    _refuse(np.isnan(q[:, 0]), tips, together, out_of_reach)
    rates = by_slices(partial(_rates_at, arm), q, linear.swapaxes(0, 1), angular.swapaxes(0, 1))
    singular = "the arm is singular in {}: joints would have to jump. Move the part or turn the tool."
    _refuse(np.isnan(rates[:, 0, 0]), tips, together, singular)
    return JointRates(q, *np.ascontiguousarray(rates.swapaxes(0, 1)))


def sampled_joints(tool: Samples, arm: Arm, together: int = 1) -> JointRates:
    """Joint motion (n, 6) of a sampled tool motion; see `joint_motion`."""
    linear, angular = tool.tips[:, 1:].swapaxes(0, 1), tool.spins.swapaxes(0, 1)
    return joint_motion(tool.tips[:, 0], tool.rotations, linear, angular, arm, together)


@njit
def _follow_branch(lengths: Array, T_base_flange: Array, q_start: Array, q: Array) -> None:
    """Write joint angles (n, 6) along the poses, on the branch they begin on, up to one out of reach."""
    last = q_start
    for row in range(len(q)):
        if not solve_on_branch(lengths, T_base_flange[row], last, q[row]):
            return
        last = q[row]


def _rates_at(arm: Arm, q: Array, linear: Array, angular: Array) -> Array:
    """Three derivatives of joint angles (n, 6) for those of the tool, (n, 3, 3) each in the work frame, shape
    (n, 3, 6); NaN where the arm is singular."""
    R, frames = arm.T_base_work[:3, :3], link_frames(q)
    # Of every joint its axis and the way to the next one's, the last to the tool point.
    axes, places = frames[:, :6, :3, 2], frames[:, :, :3, 3]
    places[:, 6] = place_of(frames[:, 6], arm.T_flange_tool[:3, 3])
    links, none = np.diff(places, axis=1), np.zeros_like(q)
    twists = np.concatenate([linear @ R.T, angular @ R.T], axis=2)
    J = jacobian(q, arm.T_flange_tool[:3, 3])
    J[np.abs(np.linalg.det(J)) < SINGULAR] = np.nan
    solve = np.linalg.inv(J)
    found: list[Array] = []
    for order in range(1, 4):
        # What the tool does without the derivative that is looked for is the sum over the links.
        spin, tip = np.zeros((order, len(q), 3)), np.zeros((len(q), 3))
        for k in range(6):
            known = [rate[:, k, None] for rate in (*found, none)]
            spin = spin + jet_of(np.multiply, known, carried(spin, axes[:, k]), order)
            tip = tip + carried(spin, links[:, k])[order]
        left = twists[:, order - 1] - np.hstack([tip, spin[-1]])
        found.append((solve @ left[..., None])[..., 0])
    return np.stack(found, axis=1)


def _refuse(failed: Bools, tips: Array, together: int, said: str) -> None:
    """Raise an error for the first place that failed (n,), if any; the place is put into what is ``said``."""
    if failed.any():
        row = int(failed.argmax())
        place = f"segment {row // together + 1}, at {place_in_mm(tips[row])} in the path's frame"
        raise ReachError(said.format(place))
