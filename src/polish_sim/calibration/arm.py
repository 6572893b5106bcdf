"""An arm's table, base, gears and the tracker's target on it, from poses a tracker saw.

By least squares of where the tracker saw the target, with prior knowledge: the nominal table and how far a
built arm may be from it. That also fixes what no measurement shows, such as sliding three parallel axes along
themselves. Of an arm with elastic joints whose weight is known, the gears are found along: how much each
winds up below, between and above its catalogue's knees, and its error by the rotor's angle, once and twice a
period.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, parts_between, rms, two_waves
from polish_sim.calibration.fit import Problem, solve
from polish_sim.calibration.matched_points import kabsch, moved_frame, point_slopes
from polish_sim.config import RealArmConfig
from polish_sim.errors import CalibrationError
from polish_sim.motion.kinematics import NOMINAL, link_frames, table_slopes
from polish_sim.spatial import place_of

LEAST_POSES = 20
USUAL_NOISE = 3e-5  #: Of a laser tracker, per coordinate [m]
_PLACEMENT, _GEARS = 9, 42
CATALOGUE = RealArmConfig()  #: Of the gears: where their stiffness changes, and their ratio
_RIGID = np.zeros((6, 7))
_LIKELY = np.repeat([[1e-4, *[2e-5] * 2, *[3e-4] * 4], [6e-4, *[12e-5] * 2, *[3e-4] * 4]], 3, axis=0)
"""What gears may do: wind up, and do so more or less beyond a knee [rad/(N m)], err [rad], standard
deviations, shape (6, 7)."""


class TrackedArm(NamedTuple):
    """Poses of one arm and where a tracker saw the target on its flange."""

    q: Array  #: Joint angles as read [rad], shape (n, 6)
    seen: Array  #: Target, tracker frame [m], shape (n, 3)
    weight: Array | None = None  #: Torques that hold the arm's weight [N m], shape (n, 6); None: rigid joints
    catalogue: RealArmConfig = CATALOGUE

    def rows(self, kept: Bools) -> TrackedArm:
        """Some of the poses."""
        weight = None if self.weight is None else self.weight[kept]
        return self._replace(q=self.q[kept], seen=self.seen[kept], weight=weight)


class Tolerance(NamedTuple):
    """How far a built arm may be from its table, standard deviations."""

    length: float = 5e-4  #: Of d and a [m]
    angle: float = float(np.radians(0.02))  #: Of joint offsets and alpha [rad]


USUAL = Tolerance()


class ArmEstimate(NamedTuple):
    """An arm as calibrated, or as built."""

    table: Array  #: Shape (4, 6)
    T_tracker_base: Array  #: Shape (4, 4)
    target: Array  #: On the flange [m], shape (3,)
    residuals: Array = np.empty((0, 3))  #: Seen minus predicted [m], shape (n, 3)
    #: Of the base's origin [m] and rotation [rad], tracker axes, whatever the table is, (6, 6)
    base_covariance: Array = np.zeros((6, 6))
    gears: Array = _RIGID  #: What joints turn by a unit of each column of `gear_columns`, shape (6, 7)
    catalogue: RealArmConfig = CATALOGUE

    def links_at(self, q: Array, weight: Array | None) -> Array:
        """See `links_behind`."""
        return q if weight is None else links_behind(q, weight, self.gears, self.catalogue)

    def tracked(self, links: Array, noise: float, rng: np.random.Generator) -> Array:
        """Where a tracker sees the target, (n, 3) [m]: the mean of one reading with the links at each of (k,
        n, 6) [rad]; ``noise``: of one of its coordinates [m]."""
        seen = [self.target_at(q) + noise * rng.standard_normal((len(q), 3)) for q in links]
        return np.mean(seen, axis=0)

    def left(self, tracked: TrackedArm) -> Array:
        """Where a tracker saw the target less where it is by this arm [m], shape (n, 3)."""
        return tracked.seen - self.target_at(tracked.q, tracked.weight)

    def target_at(self, q: Array, weight: Array | None = None) -> Array:
        """Where the target is, tracker frame [m], shape (n, 3)."""
        T = self.T_tracker_base @ link_frames(self.links_at(q, weight), self.table)[:, 6]
        return place_of(T, self.target)


def links_behind(q: Array, weight: Array, gears: Array, catalogue: RealArmConfig) -> Array:
    """Angles of the links (n, 6) [rad] with the encoders at ``q``, under torques that hold the weight (n, 6)
    [N m]; ``gears`` as in `ArmEstimate`."""
    return q + np.sum(gear_columns(q, weight, catalogue) * gears, axis=2)


def gear_columns(q: Array, weight: Array, catalogue: RealArmConfig) -> Array:
    """What turns the links off their encoders: torque by parts between the knees, error once and twice, (n,
    6, 7)."""
    parts = parts_between(weight, (catalogue.knee_1_nm, catalogue.knee_2_nm))
    waves = two_waves(2.0 * catalogue.gear_ratio * q)
    return np.concatenate([-np.moveaxis(parts, 0, -1), waves], axis=-1)


def fit_arm(tracked: TrackedArm, noise: float | None, tolerance: Tolerance = USUAL) -> ArmEstimate:
    """The most probable table, base and target of an arm, from twenty poses or more with all joints well
    moved.

    ``noise``: of one coordinate [m], None: a good tracker's, then the residuals'; ``tolerance``: of the
    nominal table. Fewer poses: CalibrationError.
    """
    if noise is None:
        noise = residual_rms([fit_arm(tracked, USUAL_NOISE, tolerance)])
    spread = np.repeat([tolerance.angle, tolerance.length, tolerance.length, tolerance.angle], 6)
    gears = np.zeros(_GEARS) if tracked.weight is None else _LIKELY.ravel()
    return _refined(tracked, np.concatenate([np.full(_PLACEMENT, np.inf), spread, gears]), max(noise, 1e-9))


def fit_placement(tracked: TrackedArm) -> ArmEstimate:
    """Base and target alone, the table taken as nominal: the residual is the table's error."""
    return _refined(tracked, np.concatenate([np.full(_PLACEMENT, np.inf), np.zeros(24 + _GEARS)]), 1.0)


def _refined(tracked: TrackedArm, spread: Array, noise: float) -> ArmEstimate:
    """Least squares; ``spread``: standard deviation of each unknown about its nominal value (75,), 0 keeps it
    there."""
    if len(tracked.q) < LEAST_POSES:
        raise CalibrationError(
            f"{len(tracked.q)} poses cannot determine an arm's table (33 unknowns): give {LEAST_POSES} or "
            "more, 60 are good."
        )
    free = spread > 0.0
    gears = np.eye(_GEARS)
    # Beyond a knee that no pose shows a gear winds up as before it.
    gears[1::7, 0::7] = gears[2::7, 1::7] = -np.eye(6)
    prior = np.eye(len(spread))
    prior[-_GEARS:, -_GEARS:] = gears
    prior = prior[np.ix_(free, free)] / spread[free, None]

    def residuals(arm: ArmEstimate) -> Array:
        off = np.concatenate([np.zeros(_PLACEMENT), (arm.table - NOMINAL).ravel(), arm.gears.ravel()])[free]
        return np.concatenate([-arm.left(tracked).ravel() / noise, prior @ off])[:, None]

    def slopes(arm: ArmEstimate) -> Array:
        J = _slopes(arm, tracked)[:, :, free].reshape(-1, free.sum())
        return np.concatenate([J / noise, prior])[:, None]

    def moved(arm: ArmEstimate, step: Array) -> ArmEstimate:
        whole = np.zeros(len(free))
        whole[free] = step
        return arm._replace(
            table=arm.table + whole[9:33].reshape(4, 6),
            T_tracker_base=moved_frame(arm.T_tracker_base, whole[:6]),
            target=arm.target + whole[6:9],
            gears=arm.gears + whole[33:].reshape(6, 7),
        )

    arm = solve(Problem(residuals, slopes, moved), _start(tracked))
    rows = slopes(arm)[:, 0]
    covariance = np.asarray(np.linalg.pinv(rows.T @ rows)[:6, :6], dtype=np.float64)
    return arm._replace(residuals=arm.left(tracked), base_covariance=covariance)


def _start(tracked: TrackedArm) -> ArmEstimate:
    """The nominal arm, the target on the flange's origin, the base by matched points."""
    own = link_frames(tracked.q)[:, 6, :3, 3]
    stretch = np.linalg.norm(np.std(tracked.seen, axis=0)) / np.linalg.norm(np.std(own, axis=0))
    if not 0.5 < stretch < 2.0:
        raise CalibrationError(
            f"the tracker saw the target move {stretch:.3g} times as far as the arm did: are units mixed "
            "(mm, m)?"
        )
    return ArmEstimate(NOMINAL, kabsch(tracked.seen, own), np.zeros(3), catalogue=tracked.catalogue)


def _slopes(arm: ArmEstimate, tracked: TrackedArm) -> Array:
    """Derivative of the target by base (6), target (3), table (24) and gears (42), shape (n, 3, 75)."""
    frames = arm.T_tracker_base @ link_frames(arm.links_at(tracked.q, tracked.weight), arm.table)
    R = frames[:, 6, :3, :3]
    points = R @ arm.target + frames[:, 6, :3, 3]
    table = table_slopes(frames, points)
    gears = np.zeros((len(points), 3, 6, 7))
    if tracked.weight is not None:
        gears = table[:, :, :6, None] * gear_columns(tracked.q, tracked.weight, tracked.catalogue)[:, None]
    return np.concatenate(
        [point_slopes(arm.T_tracker_base, points), R, table, gears.reshape(len(points), 3, _GEARS)], axis=2
    )


def residual_rms(arms: list[ArmEstimate]) -> float:
    """Rms of the residual of one coordinate of a pose [m]."""
    return rms(np.concatenate([arm.residuals.ravel() for arm in arms]))
