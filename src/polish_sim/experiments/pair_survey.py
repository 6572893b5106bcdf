"""How two simulated robots, their tool and their part are measured in a shop before a run (layer 9).

Bases by single axes turned before a laser tracker, the tool by touches of a fixed point, marks on the part by touches
of a fixed point too; last the tool itself touches the marks on the part the other robot holds.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.calibration.frames import ROBOTS
from polish_sim.calibration.pair import ClosingTouches, PairParts
from polish_sim.calibration.pair.adjustment import LEAST_NOISE
from polish_sim.calibration.tool import ToolTouches, fit_tool_frame, fit_tool_point
from polish_sim.config import DualConfig
from polish_sim.errors import ReachError, place_in_mm
from polish_sim.experiments.calibrate_base import TrueBases, simulate_arcs
from polish_sim.experiments.calibrate_tcp import TcpTrial, reached, simulate_touches
from polish_sim.experiments.pair_arms import AS_DRAWN, FollowerBase, PairArms
from polish_sim.motion.coordination import Chain2, follower_flange, master_flange
from polish_sim.spatial import apply, from_pose, transform

Array = NDArray[np.float64]

T_TRACKER_MASTER: Final = from_pose([2.5, -0.8, -0.4, 0.0, 0.0, 2.0])
"""Where the simulated tracker sees the master."""
ARC_POINTS: Final = 200


class Site(NamedTuple):
    """Where the tool touches marks on the part."""

    T_master_work: Array
    """Where the master holds the part meanwhile, its base, shape (4, 4)."""
    T_work_tool: Array
    """The tool at each mark, its z axis into the part, shape (k, 4, 4)."""

    @property
    def marks_work(self) -> Array:
        """The marks as drawn [m], shape (k, 3)."""
        return self.T_work_tool[:, :3, 3]


def tracker_sees(T_master_follower: Array) -> TrueBases:
    """Both bases as they really stand before the simulated tracker."""
    return TrueBases(dict(zip(ROBOTS, (T_TRACKER_MASTER, T_TRACKER_MASTER @ T_master_follower), strict=True)))


def find_parts(
    config: DualConfig, true: Chain2, site: Site, rng: np.random.Generator, arms: PairArms = AS_DRAWN
) -> tuple[PairParts, Array]:
    """Measure bases, tool and part one by one.

    Args:
        config: Noise of the instruments.
        true: The chain as it really is.
        site: The marks.
        rng: Draws the noise.
        arms: Both arms; bases found along with their tables are taken.

    Returns:
        What was found, and how the tool stands on its flange, shape (3, 3).

    Raises:
        ReachError: The master cannot touch with a mark of a part held like that.
    """
    tracker, touch = max(config.tracker_noise_m, LEAST_NOISE), max(config.touch_noise_m, LEAST_NOISE)
    truth = tracker_sees(true.T_master_follower)
    turned = simulate_arcs(truth, ARC_POINTS, config.tracker_noise_m, rng, None if arms.as_drawn else arms.true)
    circles = turned.fit(tracker)
    bases = arms.bases or FollowerBase(circles.T_master_follower, circles.covariance)
    trial = TcpTrial(noise=config.touch_noise_m)
    tool = fit_tool_frame(simulate_touches(trial, true.T_flange_tool, rng, arms.reading("follower")), touch)
    marks = [
        fit_tool_point(_touch_with_mark(trial, mark, rng, arms), touch)
        for mark in apply(true.T_flange_gripper @ true.T_gripper_work, site.marks_work)
    ]
    parts = PairParts(
        bases.T_master_follower,
        bases.covariance,
        tool.tip.point,
        tool.tip.covariance[:3, :3],
        np.stack([mark.point for mark in marks]),
        np.stack([mark.covariance[:3, :3] for mark in marks]),
    )
    return parts, tool.T_flange_tool[:3, :3]


def _touch_with_mark(trial: TcpTrial, mark: Array, rng: np.random.Generator, arms: PairArms) -> ToolTouches:
    """A fixed point touched with a mark on the part, at (3,) on the master's flange [m]."""
    try:
        return simulate_touches(trial, transform(np.eye(3), mark), rng, arms.reading("master")).touches
    except ReachError as error:
        raise ReachError(
            f"the master cannot turn the part about one of its marks, {place_in_mm(mark)} from its flange, to find "
            "where the part is held: it is held too far out, or the part is too large. Hold it closer to the "
            "gripper's face and axis with --set dual.part_on_gripper=[x,y,z,rx,ry,rz] (m, rad)."
        ) from error


def touch_marks(
    true: Chain2, site: Site, count: int, noise: float, rng: np.random.Generator, arms: PairArms = AS_DRAWN
) -> ClosingTouches:
    """Touch the part's marks with the tool, one after the other, as often as asked.

    From round to round the tool is turned about its axis: what is not square about its tip then shows as such.

    Args:
        true: The chain as it really is.
        site: The marks, and where the part is held.
        count: Number of touches.
        noise: Standard deviation of one coordinate of a touch [m].
        rng: Draws the noise.
        arms: Both arms.

    Raises:
        ReachError: An arm off its table cannot do it: then what it reads is not known.
    """
    marks = len(site.T_work_tool)
    mark, rounds = np.arange(count) % marks, max(-(-count // marks), 1)
    spin = np.zeros((count, 3))
    spin[:, 2] = 2.0 * np.pi * (np.arange(count) // marks) / rounds
    T_work_tool = site.T_work_tool[mark] @ transform(Rotation.from_rotvec(spin).as_matrix(), np.zeros(3))
    T_follower_flange = follower_flange(true, site.T_master_work, T_work_tool)
    T_follower_flange[:, :3, 3] += noise * rng.standard_normal((count, 3))
    T_master_flange = np.tile(master_flange(true, site.T_master_work), (count, 1, 1))
    said = [
        reached(T, arms.reading(robot)) if count and arms.reading(robot) else T
        for robot, T in zip(ROBOTS, (T_master_flange, T_follower_flange), strict=True)
    ]
    return ClosingTouches(said[0], said[1], mark)
