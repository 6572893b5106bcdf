"""Where two robots, part and tool stand: as they really do, and as calibration makes the host believe.

The simulated calibration before a run: bases by single axes turned before a laser tracker, the tool by
touches of a fixed point, marks on the part by touches of a fixed point too; last the tool itself touches the
marks on the part the other robot holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, directions_at, perpendicular
from polish_sim.calibration.matched_points import frame_offset
from polish_sim.cell import tool_on_flange
from polish_sim.config import DualConfig
from polish_sim.dual.arms import NOMINAL_ARMS, ClosedChain, PairArms
from polish_sim.dual.calibrate import (
    Q_NEAR,
    Bases,
    TcpTrial,
    reached,
    simulate_arcs,
    simulate_touches,
)
from polish_sim.dual.calibration.arm import read_arm_calibration
from polish_sim.dual.calibration.bases import ROBOTS, fit_bases, read_base_calibration
from polish_sim.dual.calibration.pair import (
    LEAST_NOISE,
    ClosingTouches,
    PairAdjustment,
    PairParts,
    adjust_pair,
)
from polish_sim.dual.calibration.tool import fit_tool_frame, fit_tool_point, read_tool_calibration
from polish_sim.dual.scene import GRIPPER_LENGTH
from polish_sim.errors import CalibrationError, ConfigError, ReachError, place_in_mm
from polish_sim.geometry import Region, Surface
from polish_sim.spatial import (
    apply,
    from_pose,
    inverse,
    rotation_to_axis,
    rotations_from_vectors,
    to_pose,
    transform,
)

#: Where the simulated tracker sees the master
T_TRACKER_MASTER = from_pose([2.5, -0.8, -0.4, 0.0, 0.0, 2.0])
ARC_POINTS = 200
LEAST_APART = 0.2  #: Between the bases of two arms, each 0.15 m wide [m]
SAME_POSE = 1e-8  #: Poses that differ by less are the same but for rounding [m], [-]
#: A part whose frame is that of the gripper's face, as the hub's is
ON_FACE = np.eye(4)
FAR_M, FAR_RAD = 0.01, 0.1  #: Farther off, a calibration is of another tool or of robots elsewhere [m], [rad]
INSIDE = 0.9  #: Share of the way from the middle to the edge: a pointer does not find an edge itself
#: A region this narrow for its length does not fix the turn about it: marks then cover the part
NARROW = 0.1


def spread_marks(region: Region, surface: Surface, count: int) -> Array:
    """Marks on a part that are touched to find it: far apart, in directions evenly spread about the region's
    middle, its length and its width counting alike.

    Returns T_work_tool, the tool's z axis into the part, shape (count, 4, 4).
    """
    for candidate in (region.surface, surface):
        points = candidate.vertices[np.unique(candidate.faces)]
        middle = points.mean(axis=0)
        _, widths, axes = np.linalg.svd(points - middle, full_matrices=False)
        if widths[1] > NARROW * widths[0]:
            break
    angle = 2.0 * np.pi * np.arange(count) / count
    directions = directions_at(angle) @ (axes[:2] / widths[:2, None])
    outmost = points[np.argmax((points - middle) @ directions.T, axis=0)]
    there = candidate.closest(middle + INSIDE * (outmost - middle))
    R = [rotation_to_axis(-normal[None], perpendicular(normal))[0] for normal in there.normals]
    return transform(np.stack(R), there.positions)


class Site(NamedTuple):
    """Where the tool touches marks on the part."""

    T_master_work: Array  #: Where the master holds the part meanwhile, its base, shape (4, 4)
    T_work_tool: Array  #: The tool at each mark, its z axis into the part, shape (k, 4, 4)
    q_near: Mapping[str, Array] = MappingProxyType(dict.fromkeys(ROBOTS, Q_NEAR))
    """Joints of both robots meanwhile, roughly [rad], shape (6,) each."""

    @property
    def marks_work(self) -> Array:
        """The marks as drawn [m], shape (k, 3)."""
        return self.T_work_tool[:, :3, 3]


def tracker_sees(T_master_follower: Array) -> Bases:
    """Both bases as they really stand before the simulated tracker."""
    return dict(zip(ROBOTS, (T_TRACKER_MASTER, T_TRACKER_MASTER @ T_master_follower), strict=True))


def find_parts(
    config: DualConfig, true: ClosedChain, site: Site, rng: np.random.Generator, arms: PairArms = NOMINAL_ARMS
) -> PairParts:
    """Measure bases, tool and part one by one; bases found along with the arms' tables are taken.

    Raises ReachError if the master cannot touch with a mark of a part held like that.
    """
    tracker, touch = (_noise(noise, arms) for noise in (config.tracker_noise_m, config.touch_noise_m))
    turned = simulate_arcs(
        tracker_sees(true.T_master_follower), ARC_POINTS, config.tracker_noise_m, rng, arms.standing(rng)
    )
    circles = fit_bases(turned, tracker)
    T_master_follower, covariance = arms.bases or (circles.T_master_follower, circles.covariance)
    master, follower = (
        TcpTrial(noise=config.touch_noise_m, read=arms.reading(robot, rng), q_near=site.q_near[robot])
        for robot in ROBOTS
    )
    tool = fit_tool_frame(simulate_touches(follower, true.T_flange_tool, rng), touch)
    marks = [
        fit_tool_point(_touch_with_mark(master, mark, rng), touch)
        for mark in apply(true.T_flange_work, site.marks_work)
    ]
    parts = PairParts(
        T_master_follower,
        covariance,
        tool.tip.point,
        tool.tip.covariance[:3, :3],
        np.stack([mark.point for mark in marks]),
        np.stack([mark.covariance[:3, :3] for mark in marks]),
        np.sqrt(tool.tip.noise[0] ** 2 + np.mean([mark.noise[0] ** 2 for mark in marks])),
        tool.T_flange_tool[:3, :3],
    )
    if arms.gears and not any(gears.any() for gears in arms.known.values()):
        # Errors of gears belong together: many readings of one place are no better than one.
        parts = parts._replace(
            bases_covariance=covariance * (config.arm_poses or ARC_POINTS),
            tip_covariance=parts.tip_covariance * follower.poses,
            marks_covariance=parts.marks_covariance * master.poses,
        )
    return parts


def _noise(noise: float, arms: PairArms) -> float | None:
    """What a fit takes for the noise of a measurement [m]; None, its own residuals: gears err by more than
    that."""
    return None if arms.gears else max(noise, LEAST_NOISE)


def _touch_with_mark(trial: TcpTrial, mark: Array, rng: np.random.Generator) -> Array:
    """A fixed point touched with a mark on the part, at (3,) on the master's flange [m]."""
    try:
        return simulate_touches(trial, transform(np.eye(3), mark), rng).touches
    except ReachError as error:
        raise ReachError(
            f"the master cannot turn the part about one of its marks, {place_in_mm(mark)} from its flange, "
            "to find where the part is held: it is held too far out, or the part is too large. Hold it "
            "closer to the gripper's face and axis with --set dual.part_on_gripper=[x,y,z,rx,ry,rz] (m, rad)."
        ) from error


def touch_marks(
    true: ClosedChain,
    site: Site,
    count: int,
    noise: float,
    rng: np.random.Generator,
    arms: PairArms = NOMINAL_ARMS,
) -> ClosingTouches:
    """Touch the part's marks with the tool, one after the other, ``count`` times, each coordinate off by
    ``noise`` rms [m].

    From round to round the tool is turned about its axis: what is not square about its tip then shows as
    such. Raises ReachError if an arm off its table cannot do it: then what it reads is not known.
    """
    marks = len(site.T_work_tool)
    mark = np.arange(count) % marks
    rounds = max(-(-count // marks), 1)
    spin = np.zeros((count, 3))
    spin[:, 2] = 2.0 * np.pi * (np.arange(count) // marks) / rounds
    T_work_tool = site.T_work_tool[mark] @ transform(rotations_from_vectors(spin), np.zeros(3))
    T_follower_flange = true.follower_flange(site.T_master_work, T_work_tool)
    T_follower_flange[:, :3, 3] += noise * rng.standard_normal((count, 3))
    T_master_flange = np.tile(true.master_flange(site.T_master_work), (count, 1, 1))
    said = [
        reached(T, arms.reading(robot, rng), site.q_near[robot]) if count and arms.reading(robot, rng) else T
        for robot, T in zip(ROBOTS, (T_master_flange, T_follower_flange), strict=True)
    ]
    return ClosingTouches(said[0], said[1], mark)


class PairFrames(NamedTuple):
    """The chain of two robots."""

    true: ClosedChain
    believed: ClosedChain


def settled_bases(config: DualConfig) -> DualConfig:
    """The same with the bases where they really stand: as the simulated calibration it names planted them.

    Raises InputError if the calibration cannot be read, CalibrationError if it is another pair's, ConfigError
    if another place of the follower's base is asked for.
    """
    file = config.arms_file or config.bases_file
    if not file:
        return config
    read = read_arm_calibration if config.arms_file else read_base_calibration
    planted = read(Path(file), config.pair).T_true
    if planted is None:
        return config
    if len(config.follower_pose) == 6 and np.abs(from_pose(config.follower_pose) - planted).max() < SAME_POSE:
        return config
    if config.follower_pose != DualConfig().follower_pose:
        raise ConfigError(
            f"'dual.follower_pose' is {_pose_text(_follower_pose(config))}, but '{file}' was measured on "
            f"simulated robots that stand at {_pose_text(planted)}: leave one of them out."
        )
    return replace(config, follower_pose=to_pose(planted))


def true_chain(config: DualConfig, T_gripper_work: Array = ON_FACE) -> ClosedChain:
    """The chain as it really is, the part's frame on the gripper's face unless another place (4, 4) is given.

    Raises ConfigError if no pose is given, or another one than the calibration's; else as `settled_bases`.
    """
    T_flange_gripper = transform(np.eye(3), np.array([0.0, 0.0, GRIPPER_LENGTH]))
    return ClosedChain(
        _follower_pose(settled_bases(config)), T_flange_gripper, T_gripper_work, tool_on_flange()
    )


def _follower_pose(config: DualConfig) -> Array:
    if not config.follower_pose:
        raise ConfigError(
            "'dual.follower_pose' is empty: say where the follower's base stands in the master's."
        )
    T = from_pose(config.follower_pose)
    apart = np.linalg.norm(T[:3, 3])
    if apart < LEAST_APART:
        raise ConfigError(
            f"'dual.follower_pose' puts the follower's base {1e3 * apart:.4g} mm from the master's: no two "
            f"arms stand there. Give {1e3 * LEAST_APART:g} mm or more, about 1100 mm is good."
        )
    return T


def _pose_text(T: Array) -> str:
    """A pose as `--set dual.follower_pose` takes it; rounded to nanometres."""
    return "[" + ",".join(f"{number:.9g}" for number in to_pose(T)) + "]"


def calibrated_frames(
    config: DualConfig, true: ClosedChain, site: Site, rng: np.random.Generator, arms: PairArms
) -> PairFrames:
    """The true chain beside the one the host believes, from calibrations on file or those simulated before
    the run.

    Raises:
        InputError: A calibration cannot be read.
        CalibrationError: It is another pair's or another tool's, or does not fit where the robots stand.
    """
    parts = _given(config, true, find_parts(config, true, site, rng, arms))
    # A calibration from a file is believed as it is.
    count = 0 if config.bases_file or config.tool_file or config.arms_file else config.closing_touches
    closing = touch_marks(true, site, count, config.touch_noise_m, rng, arms)
    noise = parts.touch_noise if arms.gears else config.touch_noise_m
    adjusted = adjust_pair(parts, site.marks_work, closing, noise)
    return PairFrames(true, believed_chain(adjusted, parts.R_flange_tool, true))


def believed_chain(adjusted: PairAdjustment, R_flange_tool: Array, true: ClosedChain) -> ClosedChain:
    """The chain as it was found; the part's place is found together with the gripper's."""
    return ClosedChain(
        adjusted.T_master_follower,
        adjusted.T_flange_work @ inverse(true.T_gripper_work),
        true.T_gripper_work,
        transform(R_flange_tool, adjusted.tip),
    )


def tool_errors(true: ClosedChain, believed: ClosedChain, T_master_work: Array, T_work_tool: Array) -> Array:
    """From the tool as wanted to the tool as it is on the part [m], (n, 3), if both arms do what the believed
    chain asks for.

    ``T_master_work``: where the host wants the part, base of the master, (4, 4); ``T_work_tool``: the tool on
    it, (n, 4, 4). Work frame.
    """
    T_master_flange = believed.master_flange(T_master_work)
    T_follower_flange = believed.follower_flange(T_master_work, T_work_tool)
    T_work_master = inverse(T_master_flange @ true.T_flange_gripper @ true.T_gripper_work)
    is_now = T_work_master @ true.T_master_follower @ T_follower_flange @ true.T_flange_tool
    return is_now[:, :3, 3] - T_work_tool[:, :3, 3]


def _given(config: DualConfig, true: ClosedChain, parts: PairParts) -> PairParts:
    """What was found, replaced by what files say."""
    if config.bases_file:
        T = read_base_calibration(Path(config.bases_file), config.pair).T_master_follower
        parts = parts._replace(T_master_follower=T)
    if config.bases_file or config.arms_file:
        T = parts.T_master_follower
        what = f"'{config.bases_file or config.arms_file}' puts the follower's base"
        cure = f"set the cell up as it was: --set dual.follower_pose={_pose_text(T)}"
        _check_near(what, "dual.follower_pose", T, true.T_master_follower, cure)
    if config.tool_file:
        T = read_tool_calibration(Path(config.tool_file))
        what = f"'{config.tool_file}' puts the tool"
        cure = "the one of `calibrate tcp --cell-tool`, or none: the run then finds its own"
        _check_near(what, "the cell's tool", T, true.T_flange_tool, cure)
        parts = parts._replace(tip=T[:3, 3], R_flange_tool=T[:3, :3])
    return parts


def _check_near(what: str, wanted: str, T: Array, T_true: Array, cure: str) -> None:
    off, turn = frame_offset(T, T_true)
    if off > FAR_M or turn > FAR_RAD:
        raise CalibrationError(
            f"{what} at {place_in_mm(T[:3, 3])}, {1e3 * off:.1f} mm and {np.degrees(turn):.2f} deg from "
            f"{wanted}, {place_in_mm(T_true[:3, 3])}: it was made elsewhere. Use one made here, or {cure}."
        )
