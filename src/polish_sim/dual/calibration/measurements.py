"""Measurements of two bases, and both bases from them; one class for each way to measure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from polish_sim.arrays import Array, Bools
from polish_sim.dual.calibration.circle import BaseFrame, Circle, base_from_meeting_axes, fit_circle_without_outliers
from polish_sim.dual.calibration.matched_points import fit_frame_without_outliers, relative_frame
from polish_sim.errors import CalibrationError

T = TypeVar("T")

ROBOTS = ("master", "follower")
LEAST_POSES = 10


class Group(NamedTuple):
    """Points measured together and their residuals."""

    name: str
    points: Array
    """[m], shape (n, 3)."""
    residuals: Array
    """Distance of each from the fit [m], shape (n,)."""
    used: Bools
    """Shape (n,)."""


class BaseCalibration(NamedTuple):
    """The follower's base in the master's, and the fits it rests on."""

    T_master_follower: Array
    """Shape (4, 4)."""
    covariance: Array
    """Of its origin [m] and rotation [rad], master axes, shape (6, 6)."""
    noise: float
    """Standard deviation of one coordinate of one measurement [m]."""
    groups: tuple[Group, ...]
    bases: Mapping[str, tuple[Array, Array]] = MappingProxyType({})
    """T_tracker_base and its covariance, robot by robot; empty where no tracker was used."""
    circles: Mapping[str, tuple[Circle, ...]] = MappingProxyType({})
    """Circles of axes 1 and 2, robot by robot."""
    frames: Mapping[str, BaseFrame] = MappingProxyType({})
    """The bases with the gap between their axes, robot by robot."""


class BaseMeasurements(Protocol):
    """Measurements that determine both bases."""

    def fit(self, noise: float | None = None) -> BaseCalibration:
        """Both bases; ``noise``: standard deviation of one coordinate [m], None takes it from the residuals.

        Raises:
            CalibrationError: If they do not determine the bases.
        """
        ...


@dataclass(frozen=True)
class AxisArcs:
    """Target seen by a tracker while axis 1, then axis 2 turns alone, robot by robot."""

    arcs: Mapping[str, tuple[Array, Array]]
    """Points in the order of rising joint angle, tracker frame [m], each (n, 3)."""

    def fit(self, noise: float | None = None) -> BaseCalibration:
        """Both bases from four circles."""
        circles: dict[str, tuple[Circle, ...]] = {}
        frames: dict[str, BaseFrame] = {}
        for robot in ROBOTS:
            circles[robot] = tuple(
                _named(f"the {robot}'s axis {axis}", fit_circle_without_outliers, points, noise)
                for axis, points in enumerate(self.arcs[robot], 1)
            )
            frames[robot] = _named(f"the {robot}", base_from_meeting_axes, *circles[robot])
        groups = [
            Group(f"{robot}, axis {axis + 1}", self.arcs[robot][axis], np.linalg.norm(c.residuals, axis=1), c.used)
            for robot in ROBOTS
            for axis, c in enumerate(circles[robot])
        ]
        bases = {robot: (base.T, base.covariance) for robot, base in frames.items()}
        each = [c.noise for pair in circles.values() for c in pair]
        found = _between(bases, float(np.sqrt(np.mean(np.square(each)))), groups)
        return found._replace(circles=circles, frames=frames)


@dataclass(frozen=True)
class TrackedPoses:
    """A target at points known in the robot's base, seen by a tracker, robot by robot."""

    points: Mapping[str, tuple[Array, Array]]
    """Where the tracker saw the target and where the robot says it was, its base [m], each (n, 3)."""

    def fit(self, noise: float | None = None) -> BaseCalibration:
        """Both bases by matched points (Kabsch)."""
        found = {
            robot: _named(f"the {robot}", fit_frame_without_outliers, *self.points[robot], noise) for robot in ROBOTS
        }
        groups = [
            Group(f"{robot}, poses", self.points[robot][0], np.linalg.norm(f.residuals, axis=1), f.used)
            for robot, f in found.items()
        ]
        bases = {robot: (f.x, f.covariance) for robot, f in found.items()}
        return _between(bases, float(np.sqrt(np.mean([f.noise[0] ** 2 for f in found.values()]))), groups)


@dataclass(frozen=True)
class Handshake:
    """Points both tools touched, as each robot says where its tip was; no tracker."""

    points_master: Array
    """Master base [m], shape (n, 3)."""
    points_follower: Array
    """Follower base [m], shape (n, 3)."""

    def fit(self, noise: float | None = None) -> BaseCalibration:
        """The follower's base in the master's; the noise is that of both touches together."""
        both = None if noise is None else float(np.sqrt(2.0)) * noise
        found = fit_frame_without_outliers(self.points_master, self.points_follower, both)
        distance = np.linalg.norm(found.residuals, axis=1)
        group = Group("touches of both", self.points_master, distance, found.used)
        return BaseCalibration(found.x, found.covariance, float(found.noise[0] / np.sqrt(2.0)), (group,))


def _named(what: str, fit: Callable[..., T], *arguments: Any) -> T:
    """A fit whose errors say whose it is."""
    try:
        return fit(*arguments)
    except CalibrationError as error:
        raise CalibrationError(f"{what}: {error}") from error


def _between(bases: Mapping[str, tuple[Array, Array]], noise: float, groups: list[Group]) -> BaseCalibration:
    T, covariance = relative_frame(*bases[ROBOTS[0]], *bases[ROBOTS[1]])
    return BaseCalibration(T, covariance, noise, tuple(groups), bases)
