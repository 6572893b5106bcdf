"""How a controller's set-points move: from tick to tick the next joint angles, for every kind of motion.

A drive is asked once a tick. It gets joint angles [rad] and speeds [rad/s] and answers the next angles, all
(6,).

Force mode: along selected axes of a task frame the arm presses, along the others it follows its set-points.

    v <- (1 - damping) v + scaling / M (F_wanted - F) h        every h = 2 ms,

the law of the controller ``force-mode`` on each axis; see there what of it is public. The mass M turns with
the radius of gyration `GYRATION_M`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array, crosses, unit
from polish_sim.motion import inverse_near
from polish_sim.motion.kinematics import inverse_on_branch
from polish_sim.spatial import from_pose, inverse, transform
from polish_sim.ur.kinematics import joint_speeds, pose_from, tool_at

LEVER_M = 0.25  #: A line's rotation takes as long as a way of this length for each radian


class Profile(NamedTuple):
    """From rest to rest at limited speed and acceleration."""

    ramp: float  #: Time in which it gains speed [s]
    duration: float  #: [s]

    def place(self, t: float) -> float:
        """Share of the way after ``t`` [s]."""
        whole = self.duration
        ramp = self.ramp
        if t >= whole or whole == 0.0:
            return 1.0
        speed = 1.0 / (whole - ramp)
        if t < ramp:
            return 0.5 * speed * t * t / ramp
        left = whole - t
        return 1.0 - 0.5 * speed * left * left / ramp if left < ramp else speed * (t - 0.5 * ramp)


def profile(length: float, a: float, v: float, t: float) -> Profile:
    """The profile at a speed ``v`` and an acceleration ``a``, or in a time ``t`` [s] where that is above
    0."""
    if length < 1e-9:
        return Profile(0.0, max(t, 0.0))
    if t > 0.0:
        most = 0.25 * a * t * t
        ramp = 0.5 * t if most <= length else 0.5 * t * (1.0 - math.sqrt(1.0 - length / most))
        return Profile(ramp, t)
    ramp = min(v / a, math.sqrt(length / a))
    return Profile(ramp, length / (a * ramp) + ramp)


class JointWay:
    """All joints at once."""

    def __init__(self, start: Array, end: Array, reach: float) -> None:
        self.start = start
        self.end = end.copy()
        self.reach = reach  #: Of the TCP [m], which a blend is measured by
        self.length = float(np.abs(end - start).max())  #: [rad]; of a line or circle [m]

    def at(self, share: float) -> Array:
        """On the straight line in joint space."""
        return self.start + share * (self.end - self.start)


class ToolWay:
    """The TCP along a line, or a circle through ``via``, turning about one axis."""

    def __init__(
        self, start: Array, tcp: Array, pose: Array, via: Array | None = None, fixed: bool = False
    ) -> None:
        """From joint angles ``start`` (6,) [rad] to a ``pose`` (6,) [m, rad] of the TCP, a transform ``tcp``
        (4, 4) on the flange.

        ``via`` (6,) [m, rad]: a pose the circle leads through, of which the position counts; ``fixed``: the
        orientation stays as it is to the arc.
        """
        self._inverse = inverse(tcp)
        self._q = start.copy()
        first, last = tool_at(start, tcp)[0], from_pose(pose)
        self._p, self._R = first[:3, 3], Rotation.from_matrix(first[:3, :3])
        self._way = last[:3, 3] - self._p
        self._turn = (Rotation.from_matrix(last[:3, :3]) * self._R.inv()).as_rotvec()
        self._angle = 0.0
        if via is None:
            self.reach = float(np.linalg.norm(self._way))
            self.end = inverse_near(self.pose(1.0) @ self._inverse, start)
        else:
            self._on_circle(via[:3] - self._p, self._way, fixed)
            self.reach = self._angle * float(np.linalg.norm(self._arm))
            self.end = self._followed()
        self.length = max(self.reach, LEVER_M * float(np.linalg.norm(self._turn)))

    def pose(self, share: float) -> Array:
        """Pose of the TCP."""
        if self._angle:
            turned = Rotation.from_rotvec(share * self._angle * self._axis)
            p = self._p - self._arm + turned.apply(self._arm)
        else:
            p = self._p + share * self._way
        return transform((Rotation.from_rotvec(share * self._turn) * self._R).as_matrix(), p)

    def at(self, share: float) -> Array:
        """By the inverse kinematics of the pose."""
        q = self._q.copy()
        if not inverse_on_branch(np.ascontiguousarray(self.pose(share) @ self._inverse), q, q):
            raise ValueError("the way leads out of the arm's reach")
        self._q[:] = q
        return q

    def _followed(self) -> Array:
        kept = self._q.copy()
        for share in np.linspace(0.0, 1.0, 50):
            end = self.at(float(share))
        self._q = kept
        return end

    def _on_circle(self, b: Array, c: Array, fixed: bool) -> None:
        """The circle through the start, ``b`` and ``c`` from there [m]."""
        axis = crosses(b, c)
        size = float(axis @ axis)
        if size < 1e-16:
            raise ValueError("movec: the three points lie on a line")
        center = (crosses(axis, b) * (c @ c) + crosses(c, axis) * (b @ b)) / (2.0 * size)
        self._arm = -center
        self._axis = axis / math.sqrt(size)
        last = c - center
        angle = math.atan2(float(self._axis @ crosses(self._arm, last)), float(self._arm @ last))
        self._angle = angle % (2.0 * math.pi)
        if fixed:
            self._turn = self._angle * self._axis


Way = JointWay | ToolWay


@dataclass
class _Under:
    """A way and how it is followed."""

    way: Way
    profile: Profile
    blend: float  #: Radius [m]
    clock: float = 0.0  #: Since its begin [s]

    def here(self) -> Array:
        """Joint angles now."""
        return self.way.at(self.profile.place(self.clock))


class Moves:
    """One move after the other; where the next begins before the last has ended, what is left of that is
    added."""

    def __init__(self) -> None:
        self._under: list[_Under] = []

    def begin(self, way: Way, a: float, v: float, t: float, blend: float) -> None:
        """Begin a move from the end of the last."""
        self._under.append(_Under(way, profile(way.length, a, v, t), blend))

    def advance(self, q: Array, qd: Array, dt: float) -> Array:
        """Sum of the moves under way."""
        for move in self._under:
            move.clock += dt
        *others, last = self._under
        at = sum((move.here() - move.way.end for move in others), np.zeros(6)) + last.here()
        self._under = [*(move for move in others if move.clock < move.profile.duration), last]
        return at

    def done(self) -> bool:
        """Whether the last move has ended, or is so near to its end that the next may begin."""
        last = self._under[-1]
        left_s = last.profile.duration - last.clock
        left = (1.0 - last.profile.place(last.clock)) * last.way.reach
        return left_s <= 0.0 or (left_s <= last.profile.ramp and left <= last.blend)

    @property
    def under_way(self) -> bool:
        """Whether anything still moves."""
        return len(self._under) > 1 or self._under[-1].clock < self._under[-1].profile.duration

    @property
    def end(self) -> Array:
        """Where the last leads."""
        return self._under[-1].way.end


class Servo:
    """Follows goals behind a filter of second order, critically damped, which lags by the look-ahead time.

    What the gain does on a robot is not public: here it does nothing.
    """

    def __init__(self, q: Array) -> None:
        self.aim(q.copy(), 0.1)

    def aim(self, goal: Array, lookahead: float) -> None:
        """Take a goal [rad] and the look-ahead time [s]."""
        self.goal = goal
        self.lookahead = lookahead

    def advance(self, q: Array, qd: Array, dt: float) -> Array:
        """A step of the filter."""
        w = 2.0 / self.lookahead
        speed = (qd + dt * w * w * (self.goal - q)) / (1.0 + 2.0 * w * dt + w * w * dt * dt)
        return q + dt * speed

    def done(self) -> bool:
        """At once: the programme waits for the time it gave."""
        return True


class _Speeds:
    """Accelerates to speeds and holds them; at rest it is a stop."""

    order: float  #: Of the norm that is limited, as of numpy

    def __init__(self, goal: Array, *most: float) -> None:
        self.aim(goal.copy(), *most)

    def aim(self, goal: Array, *most: float) -> None:
        """Take speeds (6,) and the largest acceleration of all or of each half of them."""
        self.goal = goal
        self.most = most
        self._short = True

    def nearer(self, speeds: Array, dt: float) -> Array:
        """The speeds a step later: each part accelerates at its limit."""
        parts = list[Array]()
        self._short = False
        count = len(self.most)
        for now, goal, a in zip(np.split(speeds, count), np.split(self.goal, count), self.most, strict=True):
            size = float(np.linalg.norm(goal - now, self.order))
            late = size > a * dt
            self._short = self._short or late
            parts.append(now + (goal - now) * (a * dt / size) if late else goal)
        return np.concatenate(parts)

    def done(self) -> bool:
        """Whether the speed is reached."""
        return not self._short


class JointSpeeds(_Speeds):
    """Of the joints [rad/s] at an acceleration of the leading one [rad/s^2]."""

    order = np.inf

    def advance(self, q: Array, qd: Array, dt: float) -> Array:
        """On from the speeds the joints have."""
        return q + dt * self.nearer(qd, dt)


class ToolSpeed(_Speeds):
    """A twist of the TCP [m/s, rad/s] at accelerations of both halves [m/s^2], [rad/s^2]."""

    order = 2

    def __init__(self, tcp: Array, goal: Array, *most: float) -> None:
        super().__init__(goal, *most)
        self._tcp = tcp
        self.twist: Array | None = None  #: Of the TCP; None before it moves

    def advance(self, q: Array, qd: Array, dt: float) -> Array:
        """On from the twist it had."""
        J = tool_at(q, self._tcp)[1]
        self.twist = self.nearer(J @ qd if self.twist is None else self.twist, dt)
        return q + dt * joint_speeds(J, self.twist)


Drive = Moves | Servo | JointSpeeds | ToolSpeed
"""A motion under way: ``advance`` gives the joint angles after a step, ``done`` whether the programme
continues."""
GYRATION_M = 0.25  #: Of the virtual mass [m]
BACK_HZ = 5.0  #: Rate at which the axes that follow return to their set-points [1/s]
FREE_DAMPING = 0.05  #: Of freedrive: it comes to rest where nothing pulls
TO_ORIGIN, FIXED, ALONG_SPEED = 1, 2, 3  #: Types of force mode


class Compliance:
    """Force mode as set by a programme."""

    def __init__(self, mass: float, damping: float, scaling: float) -> None:
        self.mass = mass
        self.damping = damping
        self.scaling = scaling
        self.speed = np.zeros(6)  #: Along the task frame's axes
        self.free = False  #: Freedrive

    def set(self, frame: Array, selection: Array, wrench: Array, kind: int, limits: Array) -> None:
        """Take a task frame (a pose in the base frame) and what to press with there."""
        self._frame = from_pose(frame)
        self.kind = kind
        self.selection = selection != 0
        self.wrench = wrench
        self.limits = np.abs(limits)

    def axes(self, p: Array, twist: Array) -> Array:
        """The task frame's axes (3, 3) with the TCP at ``p`` moving with a ``twist``."""
        R = self._frame[:3, :3]
        if self.kind == TO_ORIGIN:
            y = self._frame[:3, 3] - p
            if np.linalg.norm(y) > 1e-6:
                y = unit(y)
                x = crosses(y, R[:, 2])
                x = unit(x if np.linalg.norm(x) > 1e-6 else crosses(y, R[:, 1]))
                return np.column_stack([x, y, crosses(x, y)])
        if self.kind == ALONG_SPEED:
            x = twist[:3] - (twist[:3] @ R[:, 2]) * R[:, 2]
            if np.linalg.norm(x) > 1e-4:
                x = unit(x)
                return np.column_stack([x, crosses(R[:, 2], x), R[:, 2]])
        return np.asarray(R)

    def twist(self, pose: Array, moved: Array, wanted: Array, force: Array, dt: float) -> Array:
        """Twist of the TCP, base axes.

        Args:
            pose: Of the TCP as commanded, (4, 4).
            moved: Twist of the set-points.
            wanted: Pose of the set-points, (4, 4).
            force: On the tool, torque about the TCP, base axes.
            dt: Tick [s].
        """
        R = self.axes(pose[:3, 3], moved)
        off = pose_from(wanted, pose)
        follow = _turned(R.T, moved + BACK_HZ * off)
        masses = self.mass * np.array([1.0, 1.0, 1.0, *[GYRATION_M**2] * 3])
        damping = FREE_DAMPING if self.free else self.damping
        pushed = self.scaling / masses * (self.wrench + _turned(R.T, force)) * dt
        speed = np.clip((1.0 - damping) * self.speed + pushed, -self.limits, self.limits)
        self.speed = np.where(self.selection, speed, 0.0)
        return _turned(R, np.where(self.selection, self.speed, follow))


def _turned(R: Array, six: Array) -> Array:
    return np.concatenate([R @ six[:3], R @ six[3:]])
