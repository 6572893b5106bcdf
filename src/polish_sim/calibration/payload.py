"""A tool's mass and centre and the sensor's bias from readings at rest: linear least squares.

At rest the sensor reads the weight and its moment, both turning with the pose, and a bias that does not:

    f = m g u + b_f          u = R_base_sensor^T z_base, against gravity
    t = g (m c) x u + b_t    c: centre of mass in the sensor frame

Linear in ten numbers: m, m c, b_f, b_t; six more with a linear drift of the bias. Quantities named ``theta``
are in this order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import pairwise, starmap
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, Indices, Uncertain, crosses, rms
from polish_sim.calibration.fit import Problem, agreeing, fit
from polish_sim.errors import CalibrationError
from polish_sim.motion import forward
from polish_sim.spatial import GRAVITY

MASS, MOMENT, BIAS, DRIFT = 0, slice(1, 4), slice(4, 10), slice(10, 16)
LEAST_READINGS = 3
#: Least spread of the up directions along two axes [-]; 1/sqrt(3) is that of a full sphere
LEAST_SPREAD = 0.02
LARGEST_CONDITION = 1e5  #: Of the whole regressor; beyond it the drift cannot be separated from the rest
LARGEST_REST = 0.3  #: Of weight and its moment, what forces and torques may leave unexplained, rms
LEAST_LEVER = 0.05  #: Of a weight whose moment torques are to follow [m]
FARTHEST = 0.6  #: How far from the sensor's origin a tool's centre of mass may be [m]
LARGEST_EXCESS = 5.0  #: How many times what noise and forces explain the torques may leave
LEAST_TO_COMPARE = 7  #: Readings; torques that go with the pose in any way take four of them
FLOORS = np.repeat([2e-3, 1e-4], 3)  #: Drift and residual motion move readings by this at least [N, N m]


def check_identifiable(up_sensor: Array) -> None:
    """Refuse poses from which mass, centre and bias cannot be separated.

    A weight shows only by how its direction changes in the sensor: readings differ by m g times the
    difference of two up directions, (n, 3), and by its moment. Differences along one line leave the centre
    along that line unseen. The CalibrationError says what is unknown and which pose is missing.
    """
    count = len(up_sensor)
    if count < LEAST_READINGS:
        raise CalibrationError(
            f"{count} reading{'s' if count != 1 else ''} cannot separate mass, centre and bias (10 "
            f"unknowns): {LEAST_READINGS} poses with gravity along different axes of the sensor are the "
            "least, a dozen is good."
        )
    _, spread, axes = np.linalg.svd(up_sensor - up_sensor.mean(axis=0), full_matrices=False)
    spread = spread / np.sqrt(count)
    if spread[0] < LEAST_SPREAD:
        raise CalibrationError(
            f"gravity pulls in nearly the same direction of the sensor in all {count} poses (they differ by "
            f"{np.degrees(spread[0]):.2g} deg rms): neither mass nor centre can be separated from the bias. "
            "Turn the tool: sideways, over head, about its own axis."
        )
    if spread[1] < LEAST_SPREAD:
        x, y, z = axes[0]
        raise CalibrationError(
            f"gravity changes along one line of the sensor only, ({x:.2f}, {y:.2f}, {z:.2f}): the centre of "
            "mass along it cannot be separated from the torque bias. Add a pose that turns the tool about "
            "another axis."
        )


@dataclass(frozen=True)
class PayloadReadings:
    """Readings of a wrist sensor that carries a tool at rest, nothing touching it."""

    time: Array  #: When each was taken [s], shape (n,)
    R_base_sensor: Array  #: How the sensor stood, base z up, shape (n, 3, 3)
    wrenches: Array
    """What it read, sensor axes, about the sensor's origin: sum of m (a - g), so a tool below a sensor that
    looks down pulls with -m g along its z axis; force [N] then torque [N m], shape (n, 6)."""

    def __len__(self) -> int:
        return len(self.time)

    @property
    def up_sensor(self) -> Array:
        """Unit vectors against gravity in the sensor frame, shape (n, 3)."""
        return self.R_base_sensor[:, 2, :]


@dataclass(frozen=True)
class PayloadEstimate(Uncertain):
    """Tool and bias, and how well they are known."""

    #: m [kg], m c [kg m], b_f [N], b_t [N m] and, if asked for, their drift per second, (10,) or (16,)
    theta: Array
    covariance: Array  #: Of theta, shape (p, p)
    residuals: Array  #: Reading minus model [N, N m], all readings, shape (n, 6)
    noise: Array  #: Standard deviation of one reading, given or found from the residuals [N, N m], shape (6,)
    used: Bools  #: Which readings were used, shape (n,); the others are outliers
    #: Condition number of the poses [-]; without drift sqrt(3/2) = 1.22 is the best possible, from up
    #: directions spread over the whole sphere
    condition: float
    zero_time: float  #: Moment at which a drifting bias is b [s]

    @property
    def mass(self) -> float:
        """[kg]"""
        return self.theta[MASS]

    @property
    def center(self) -> Array:
        """Centre of mass in the sensor frame [m], shape (3,)."""
        return self.theta[MOMENT] / self.mass

    @property
    def bias(self) -> Array:
        """Bias [N, N m], shape (6,)."""
        return self.theta[BIAS]

    @property
    def drift(self) -> Array:
        """Drift of the bias [N/s, N m/s], shape (6,); zero if it was not asked for."""
        return self.theta[DRIFT] if len(self.theta) > 10 else np.zeros(6)

    def bias_at(self, time: float) -> Array:
        """Bias at a moment [s], with what it has drifted [N, N m], shape (6,)."""
        return self.bias + self.drift * (time - self.zero_time)

    @property
    def mass_std(self) -> float:
        """[kg]"""
        return self.std[MASS]

    @property
    def center_std(self) -> Array:
        """[m], to first order, shape (3,)."""
        slope = np.column_stack([-self.center, np.eye(3)]) / self.mass
        return np.sqrt(np.diag(slope @ self.covariance[:4, :4] @ slope.T))


def payload_regressor(up_sensor: Array, time: Array | None = None) -> Array:
    """Derivative of the readings by theta, shape (n, 6, 10), or (n, 6, 16) with drift.

    ``up_sensor``: unit vectors against gravity in the sensor frame, (n, 3); ``time``: since the moment of the
    bias [s], (n,), None without drift.
    """
    X = np.zeros((len(up_sensor), 6, 10 if time is None else 16))
    X[:, :3, MASS] = GRAVITY * up_sensor
    X[:, 3:, MOMENT] = crosses(GRAVITY * up_sensor[:, None], np.eye(3))  # (m c) x u g
    X[:, :, BIAS] = np.eye(6)
    if time is not None:
        X[:, :, DRIFT] = time[:, None, None] * np.eye(6)
    return X


def fit_payload(readings: PayloadReadings, drift: bool = False, used: Bools | None = None) -> PayloadEstimate:
    """Estimate tool and bias by least squares, force and torque weighted by their noise, found from the
    residuals.

    Args:
        readings: At least three poses with gravity along different axes of the sensor.
        drift: Whether to fit a linear drift of the bias.
        used: Readings to use, shape (n,); None uses all.

    Raises:
        CalibrationError: If the poses cannot separate the unknowns, or the readings have the wrong sign.
    """
    chosen = np.ones(len(readings), dtype=bool) if used is None else used
    check_identifiable(readings.up_sensor[chosen])
    zero_time = readings.time[chosen].mean()
    since = readings.time - zero_time
    X = payload_regressor(readings.up_sensor, since if drift else None)
    # Gravity and the longest time are brought to 1: the condition depends on neither.
    longest = max(np.abs(since[chosen]).max(), 1e-12)
    scaled = X[chosen] / np.repeat([GRAVITY, 1.0, longest], [4, 6, 6])[: X.shape[2]]
    condition = np.linalg.cond(scaled.reshape(-1, X.shape[2]))
    if condition > LARGEST_CONDITION or X[chosen].size < X.shape[2] ** 2:
        raise CalibrationError(
            f"{chosen.sum()} readings cannot separate the drift from mass, centre and bias: visit poses "
            "again later, and give each reading its time."
        )
    found = fit(_problem(X, readings.wrenches), np.zeros(X.shape[2]), None, chosen)
    if found.x[MASS] <= 0.0:
        raise CalibrationError(
            f"the tool comes out with a mass of {found.x[MASS]:.3g} kg: the readings have the opposite sign "
            "(wanted: the force that holds the tool, upwards when it hangs still), or the orientations are "
            "not R_base_sensor."
        )
    return PayloadEstimate(
        found.x, found.covariance, -found.residuals, found.noise, chosen, condition, zero_time
    )


def fit_without_outliers(readings: PayloadReadings, drift: bool = False) -> PayloadEstimate:
    """`fit_payload` without readings too far off to be noise, at most a quarter; with fewer than seven all
    are used."""
    check_identifiable(readings.up_sensor)
    since = readings.time - readings.time.mean()
    X = payload_regressor(readings.up_sensor, since if drift else None)
    used = agreeing(_problem(X, readings.wrenches), np.zeros(X.shape[2]), "readings")
    return fit_payload(readings, drift, used)


def _problem(X: Array, wrenches: Array) -> Problem[Array]:
    """Forces have one noise and torques another."""
    kinds, start = (slice(3), slice(3, 6)), np.repeat([1.0, 0.05], 3)
    return Problem(lambda theta: X @ theta - wrenches, lambda _: X, kinds=kinds, start=start, floor=FLOORS)


def refuse_doubtful(readings: PayloadReadings, estimate: PayloadEstimate) -> None:
    """Refuse (CalibrationError) readings that follow no weight, or a centre of mass where no tool has it."""
    weight = GRAVITY * estimate.mass
    left = estimate.residuals[estimate.used]
    lever = rms(readings.wrenches[estimate.used, 3:] - estimate.bias[3:])
    for what, unit, rest, whole in (
        ("forces", "N", rms(left[:, :3]), weight),
        ("torques", "N m", rms(left[:, 3:]), max(lever, LEAST_LEVER * weight)),
    ):
        if rest > LARGEST_REST * whole:
            raise CalibrationError(
                f"the {what} do not follow a tool's weight: {rest:.3g} {unit} rms are left of {whole:.3g} "
                f"{unit}. Are columns swapped, a sign lost or units mixed, lines of several tools in one "
                "file, or the orientations not those of the readings?"
            )
    _refuse_other_torques(readings, estimate)
    far = np.linalg.norm(estimate.center)
    if far > FARTHEST:
        raise CalibrationError(
            f"the tool's centre of mass comes out {far:.3g} m from the sensor: are the torques in N m and "
            "the forces in N, as the header says, and the torques about the sensor's origin?"
        )


def _refuse_other_torques(readings: PayloadReadings, estimate: PayloadEstimate) -> None:
    """Refuse torques that go with the pose, but not as a weight's: columns swapped, or the sign of one lost.

    Orientations that are somewhat off leave as much of the forces, times the centre's distance.
    """
    used = estimate.used
    if used.sum() < LEAST_TO_COMPARE:
        return
    poses = np.column_stack([readings.up_sensor, np.ones(len(used))])[used]
    torques = readings.wrenches[used, 3:]
    free = torques - poses @ np.linalg.lstsq(poses, torques)[0]
    noise = rms(free) * math.sqrt(len(free) / (len(free) - poses.shape[1]))
    lever = max(float(np.linalg.norm(estimate.center)), LEAST_LEVER)
    rest = estimate.residuals[used]
    left = rms(rest[:, 3:])
    expected = max(noise, lever * rms(rest[:, :3]), FLOORS[3])
    if left > LARGEST_EXCESS * expected:
        raise CalibrationError(
            f"the torques go with the pose, but not as a tool's weight: {1e3 * left:.3g} mN m rms are left, "
            f"noise and forces explain {1e3 * expected:.2g}. Are columns swapped, is the sign of one lost, "
            "or does a cable pull? Compare the signs with the table in docs/calibration.md."
        )


PAN, LIFT, ELBOW, WRIST_2 = 1.3, -1.59, 1.51, -0.5 * math.pi  #: Joints that stay [rad]: 0.7 m above the table
TOOL_DOWN = -0.5 * math.pi - LIFT - ELBOW  #: Wrist 1, tool straight down [rad]; by pi less: straight up
WRIST_SPEED = 0.6  #: Mean speed of the joint with the longest way between two poses, at most [rad/s]
#: At most [rad/s^2]: 0.42 m from the wrist the tool keeps below the robot's 1.2 m/s^2
WRIST_ACCELERATION = 1.5
LEAST_POSES = 4


class PosePlan(NamedTuple):
    """Where the robot stands still to read its sensor."""

    q: Array  #: Joint angles [rad], shape (n, 6)
    R_base_sensor: Array  #: Orientation of the sensor, shape (n, 3, 3)

    @property
    def move_times(self) -> Array:
        """Time for the way to each pose from the one before [s], shape (n,); 0 to the first."""
        return np.array([0.0, *starmap(move_time, pairwise(self.q))])


def move_time(q_from: Array, q_to: Array) -> float:
    """Time for the way between two poses [s], see ``move``."""
    longest = np.abs(q_to - q_from).max()
    return max(longest / WRIST_SPEED, math.pi * math.sqrt(0.5 * longest / WRIST_ACCELERATION))


def move(q_from: Array, q_to: Array, share: Array) -> Array:
    """Joint angles (k, 6) [rad] from one pose (6,) to another along half a cosine, at shares of the time
    (k,)."""
    return q_from + 0.5 * (1.0 - np.cos(math.pi * share))[:, None] * (q_to - q_from)


@cache
def plan_payload_poses(count: int) -> PosePlan:
    """Spread the up direction of four or more poses evenly over the whole sphere of the sensor.

    Wrist 1 tilts the tool from straight down, out and up; wrist 3 turns it about its axis. The other joints
    stay, so that the arm keeps clear of itself, of the table and of singularities. The tool points down in
    the first pose, each next one is close to the last. Fewer than four poses: CalibrationError.
    """
    if count < LEAST_POSES:
        raise CalibrationError(
            f"{count} poses are too few to calibrate a payload: give {LEAST_POSES} or more."
        )
    # Points of a golden spiral, equal area each.
    index = np.arange(count)
    tilt = np.arccos(1.0 - (2.0 * index + 1.0) / count)
    azimuth = np.mod(index * math.pi * (3.0 - math.sqrt(5.0)) + math.pi, 2.0 * math.pi) - math.pi
    order = _short_way(np.column_stack([tilt, azimuth]))
    q = np.tile([PAN, LIFT, ELBOW, TOOL_DOWN, WRIST_2, 0.0], (count, 1))
    q[:, 3] -= tilt[order]
    q[:, 5] = azimuth[order]
    R = np.ascontiguousarray(forward(q)[:, :3, :3])
    for array in (q, R):
        array.flags.writeable = False
    return PosePlan(q, R)


def _short_way(places: Array) -> Indices:
    """Order in which to visit joint angles (n, 2): from the first always to the nearest not yet seen."""
    order = [0]
    left = list(range(1, len(places)))
    while left:
        ways = np.abs(places[left] - places[order[-1]]).max(axis=1)
        order.append(left.pop(np.argmin(ways)))
    return np.array(order)
