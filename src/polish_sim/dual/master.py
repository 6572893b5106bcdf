"""How the master moves the part while the follower works: along a line, about an axis, or as a file says."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from polish_sim.arrays import Array, chord_lengths, midpoints
from polish_sim.calibration.tables import Measured
from polish_sim.config import DualConfig
from polish_sim.dual.arms import ClosedChain
from polish_sim.dual.carrier import RAMP_PEAK
from polish_sim.errors import InputError
from polish_sim.planning import ToolPath
from polish_sim.spatial import inverse, rotations_from_vectors, transform

TIME = "time_s"
FLANGE = "flange_"  #: What the columns of a place begin with where the poses are the flange's
#: Faster between lines is a jump: the arm's tool speed and joints' [m/s], [rad/s]
JUMP_M_S, JUMP_RAD_S = 1.0, np.pi


class PartWay(NamedTuple):
    """A motion of a part: its origin goes along, and the part moves in its own frame. Smooth, C2 or
    better."""

    #: Times (n,) [s] to how far its origin has gone, its robot's base [m], (n, 3)
    shift: Callable[[Array], Array]
    turn: Callable[[Array], Array]  #: Times (n,) [s] to how it has moved in its own frame, shape (n, 4, 4)
    lasts: float = math.inf  #: How long it lasts [s]
    file: MasterPath | None = None  #: Where it comes from, if from a file

    def __call__(self, T_base_start: Array, times: Array) -> Array:
        """Poses of the part at times [s], (n, 4, 4), from that at time zero, (4, 4)."""
        poses = T_base_start @ self.turn(times)
        poses[:, :3, 3] += self.shift(times)
        return poses


def along_line(velocity: Array, leg: float) -> Callable[[Array], Array]:
    """Constant speed along a line, and back after every ``leg`` [s], turning as steeply as it sets off from
    rest; C2."""

    def shift(times: Array) -> Array:
        number, since = np.divmod(times, leg + math.pi / RAMP_PEAK)
        gone = np.minimum(since, leg) + np.sin(RAMP_PEAK * np.maximum(since - leg, 0.0)) / RAMP_PEAK
        return np.where(number % 2.0, leg - gone, gone)[:, None] * velocity

    return shift


def about_axis(axis: Array, center: Array, rate: float) -> Callable[[Array], Array]:
    """A turn at a constant rate [rad/s], right-handed, about an axis of the part through ``center`` [m], work
    frame."""

    def turn(times: Array) -> Array:
        R = rotations_from_vectors(rate * times[:, None] * axis)
        return transform(R, center - R @ center)

    return turn


def through_poses(times: Array, poses: Array) -> PartWay:
    """Through poses (n, 4, 4) at rising times from zero [s]: splines of positions and rotations, both C2."""
    places = CubicSpline(times, poses[:, :3, 3] - poses[0, :3, 3])
    turned = RotationSpline(times, Rotation.from_matrix((inverse(poses[0]) @ poses)[:, :3, :3]))
    end = times[-1]

    def shift(t: Array) -> Array:
        return places(np.clip(t, 0.0, end))

    def turn(t: Array) -> Array:
        return transform(turned(np.clip(t, 0.0, end)).as_matrix(), np.zeros(3))

    return PartWay(shift, turn, end)


class MasterPath(NamedTuple):
    """Poses over time from a user's file, base of the master."""

    times: Array  #: From zero, increasing [s], shape (n,)
    poses: Array  #: Shape (n, 4, 4)
    of_flange: bool  #: Whether they are those of the flange; else of the part
    columns: Measured  #: Says where a row stands

    def part_poses(self, chain: ClosedChain) -> Array:
        """The part's poses by the chain the host believes, shape (n, 4, 4)."""
        return self.poses @ chain.T_flange_gripper @ chain.T_gripper_work if self.of_flange else self.poses

    def place(self, time: float) -> str:
        """The file and the line that is reached at a time [s] or next after it."""
        row = min(int(np.searchsorted(self.times, time)), len(self.times) - 1)
        return f"'{self.columns.file}', {self.columns.place(row)}"


def read_master_path(file: Path) -> MasterPath:
    """Read poses over time.

    Columns in any order: ``time_s``; the place ``x_mm..z_mm`` or ``x_m..z_m`` of the part's origin, or of the
    flange's if they begin with ``flange_``; the orientation ``qw..qz``, ``rx_rad..rz_rad`` or ``r11..r33``.
    Base of the master. Raises InputError naming the line, also for time that does not increase or a jump.
    """
    columns = Measured.read(file, "pose", "poses over time")
    columns.need((TIME,), "the time of each pose [s]")
    of_flange = any(name.startswith(FLANGE) for name in columns.texts)
    both = [name for name in ("x_mm", "x_m") if of_flange and name in columns.texts]
    if both:
        raise InputError(
            f"'{file}' says where the part is ({both[0]}) and where the flange is ({FLANGE}...): one follows "
            "from the other. Leave one of them out."
        )
    what = "the flange" if of_flange else "the part"
    poses = transform(
        columns.rotations(what), columns.points(FLANGE if of_flange else "", f"the place of {what}")
    )
    times = columns.column(TIME)
    if len(times) < 2:
        raise InputError(f"'{file}' has one pose: a motion needs two or more.")
    columns.refuse(
        np.diff(times, prepend=-np.inf) <= 0.0,
        lambda row: f"{TIME} is {times[row]:g} after {times[row - 1]:g}, it must increase.",
    )
    _refuse_jumps(columns, what, times, poses)
    return MasterPath(times - times[0], poses, of_flange, columns)


def _refuse_jumps(columns: Measured, what: str, times: Array, poses: Array) -> None:
    steps = np.diff(times)
    way = chord_lengths(poses[:, :3, 3])
    turn = Rotation.from_matrix(np.swapaxes(poses[:-1, :3, :3], 1, 2) @ poses[1:, :3, :3]).magnitude()
    columns.refuse(
        np.r_[False, (way > JUMP_M_S * steps) | (turn > JUMP_RAD_S * steps)],
        lambda row: (
            f"{what} would jump by {1e3 * way[row - 1]:.4g} mm and {np.degrees(turn[row - 1]):.4g} deg in "
            f"{steps[row - 1]:.4g} s. The arm does {1e3 * JUMP_M_S:g} mm/s and {np.degrees(JUMP_RAD_S):g} "
            "deg/s at most: give the poses between, or more time."
        ),
    )


def master_motion(config: DualConfig, path: ToolPath, up: Array, chain: ClosedChain) -> PartWay:
    """The motion that is asked for along the follower's path, on the side ``up`` of the part, in the believed
    chain; InputError if its file cannot be used."""
    if config.master_path:
        file = read_master_path(Path(config.master_path))
        return through_poses(file.times, file.part_poses(chain))._replace(file=file)
    size = np.linalg.norm(config.master_direction)
    velocity = config.master_speed_m_s * (np.array(config.master_direction) / size)
    leg = config.master_travel_m / max(config.master_speed_m_s, 1e-9)
    turn = about_axis(up / np.linalg.norm(up), middle_of(path), config.master_turn_rad_s)
    return PartWay(along_line(velocity, leg), turn)


def middle_of(path: ToolPath) -> Array:
    """The middle of what is worked on, every millimetre of it counted alike, work frame [m], shape (3,)."""
    ends = path.process[1:] & path.process[:-1]
    between = midpoints(path.positions_work)[ends]
    return np.average(between, axis=0, weights=np.diff(path.s)[ends])
