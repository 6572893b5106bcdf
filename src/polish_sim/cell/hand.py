"""The simulated hand: a spring and a damper between where it wants the tool and where the tool is (layer 8a)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.kernel import EngineViews

Array = NDArray[np.float64]


class Hand(NamedTuple):
    """How firmly a hand holds the tool, in the base frame."""

    stiffness: float
    """[N/m]"""
    damping: float
    """[N s/m]"""
    turn_stiffness: float
    """[N m/rad]; 0: the tool may turn in it."""
    turn_damping: float
    """[N m s/rad]"""


class HandMotion(NamedTuple):
    """Where a hand wants the tool, one row a step."""

    positions: Array
    """Tool point, base frame [m], shape (n, 3)."""
    velocities: Array
    """[m/s], shape (n, 3)."""
    rotations: Array
    """Tool frame in the base frame, shape (n, 3, 3)."""
    grip: Array
    """1 while it holds the tool, 0 while its hands are off, shape (n,)."""


@njit(cache=True, error_model="numpy", forceinline=True)
def tool_velocity(e: EngineViews, out: Array) -> None:
    """Velocity of the tool point, which moves with the housing, base frame [m/s], shape (3,)."""
    w, com, tool = e.cvel[e.mount_body], e.subtree_com[e.root_body], e.site_xpos[e.tool_site]
    rx, ry, rz = tool[0] - com[0], tool[1] - com[1], tool[2] - com[2]
    out[0] = w[3] + w[1] * rz - w[2] * ry
    out[1] = w[4] + w[2] * rx - w[0] * rz
    out[2] = w[5] + w[0] * ry - w[1] * rx


@njit(cache=True, error_model="numpy", forceinline=True)
def pull_by_hand(hand: Hand, motion: HandMotion, row: int, e: EngineViews, velocity: Array, force: Array) -> None:
    """Apply the hand's pull to the housing, between tool and wrist sensor.

    Args:
        hand: The hand.
        motion: Where it wants the tool.
        row: This step.
        e: The engine, its positions and velocities of this instant; ``xfrc_applied`` of the housing is written.
        velocity: Of the tool point [m/s], shape (3,).
        force: Written: the hand's force on the tool, base frame [N], shape (3,).
    """
    grip, tool, R = motion.grip[row], e.site_xpos[e.tool_site], e.site_xmat[e.tool_site]
    wanted, applied = motion.rotations[row], e.xfrc_applied[e.mount_body]
    for i in range(3):
        lag = hand.stiffness * (motion.positions[row, i] - tool[i])
        force[i] = grip * (lag + hand.damping * (motion.velocities[row, i] - velocity[i]))
        applied[i] = force[i]
    at = e.xipos[e.mount_body]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turned = 0.0
        for axis in range(3):
            turned += 0.5 * (R[3 * j + axis] * wanted[k, axis] - R[3 * k + axis] * wanted[j, axis])
        turning = hand.turn_stiffness * turned - hand.turn_damping * e.cvel[e.mount_body, i]
        applied[3 + i] = grip * turning + (tool[j] - at[j]) * force[k] - (tool[k] - at[k]) * force[j]
