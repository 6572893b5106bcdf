"""Loops of paper 1 on one axis or three: position, orientation, force and moment by tool velocity (eq. 5 to
7)."""

from __future__ import annotations

import math

from polish_sim.arrays import Array
from polish_sim.kernels import Record, Vector3, add_to, cross, dot, kernel, scaled

# First-order low-pass, in the exact discrete form.


def low_pass_share(corner_hz: float, dt: float) -> float:
    """Share of the way to its input that a first-order low-pass goes in a step [s]."""
    return 1.0 - math.exp(-2.0 * math.pi * corner_hz * dt)


_share = kernel(low_pass_share)


@kernel
def low_pass_step(state: float, value: float, corner_hz: float, dt: float) -> float:
    """Next output of a first-order low-pass whose input is held over the step ``dt`` [s]."""
    return state + _share(corner_hz, dt) * (value - state)


class VelocityGains(Record):
    """PID gains on a velocity error, eq. 6 and 7; position and orientation enter through the look-ahead."""

    look_ahead: float  #: T_a [s]
    p: float  #: kpp [-]; below 1 it is stable at any delay
    d: float  #: kpd [s], on a low-passed acceleration
    i: float  #: [1/s]; eq. 6 has none


class VelocityMemory(Record):
    """Memory of ``velocity_pid``: linear [m] or angular [rad]."""

    integral: Vector3  #: Of the velocity error
    error: Vector3  #: Last velocity error, by second
    rate: Vector3  #: Its low-passed derivative, by second squared
    started: bool


class PositionRateGains(Record):
    """Gains of the position-error law, eq. 5."""

    p: float  #: kpp [1/s]
    d: float  #: kpd [-]


@kernel
def velocity_toward(position: Array, target: Array, feed: Array, look_ahead: float, out: Array) -> None:
    """Desired velocity v01 = feed + (Xd - Xe) / T_a [m/s] (paper 1, eq. 6; the reading of ``v01`` is
    ours)."""
    for i in range(3):
        out[i] = feed[i] + (target[i] - position[i]) / look_ahead


@kernel
def velocity_pid(
    wanted: Array, actual: Array, gains: VelocityGains, dt: float, state: VelocityMemory, out: Array
) -> None:
    """Command v01 + PID(v01 - v) [m/s] (paper 1, eq. 6), or with angular velocities f [rad/s] (eq. 7).

    ``wanted`` is v01, the planned velocity plus the error over the look-ahead, ``actual`` the measured one,
    shape (3,) each.
    """
    for i in range(3):
        error = wanted[i] - actual[i]
        rate = (error - state.error[i]) / dt if state.started else 0.0
        state.rate[i] = low_pass_step(state.rate[i], rate, 10.0, dt)
        state.error[i] = error
        state.integral[i] += error * dt
        out[i] = wanted[i] + gains.p * error + gains.i * state.integral[i] + gains.d * state.rate[i]
    state.started = True


@kernel
def position_pd(
    position: Array, target: Array, velocity: Array, feed: Array, gains: PositionRateGains, out: Array
) -> None:
    """Command Xp_dot = Xd_dot + kpp (Xd - Xe) + kpd d/dt (Xd - Xe) [m/s] (paper 1, eq. 5)."""
    for i in range(3):
        error_rate = feed[i] - velocity[i]
        out[i] = feed[i] + gains.p * (target[i] - position[i]) + gains.d * error_rate


# Orientation error by equivalent rotation vectors (paper 1, fig. 9).


@kernel
def add_axis_rotation(n0: Array, n1: Array, spare: Array, out: Array) -> None:
    """Add the rotation vector that turns unit axis ``n0`` into ``n1`` the short way to ``out`` [rad].

    Parallel axes add nothing. For opposite ones every perpendicular axis is right: ``spare``, a unit vector
    perpendicular to ``n0``, is taken.
    """
    across, cosine = cross(n0, n1), dot(n0, n1)
    sine = math.sqrt(dot(across, across))
    if sine > 1e-12:
        add_to(out, scaled(math.atan2(sine, cosine) / sine, across))
    elif cosine < 0.0:
        add_to(out, scaled(math.pi, spare))


@kernel
def rotation_error(R_actual: Array, R_wanted: Array, out: Array) -> None:
    """Rotation vector from one frame to another by the paper's sum over the three axes, halved [rad].

    Summed over the axes a small rotation ``theta a`` counts twice,
    ``sum theta (a - (a.n_k) n_k) = 2 theta a``; exact to third order in the angle, and zero only where the
    frames agree or are a half turn apart.
    """
    out[0] = out[1] = out[2] = 0.0
    for k in range(3):
        add_axis_rotation(R_actual[:, k], R_wanted[:, k], R_actual[:, (k + 1) % 3], out)
    for i in range(3):
        out[i] *= 0.5


# Force and moment control by tool velocity (paper 1, eq. 5, lower half).


class PiGains(Record):
    """Gains of a PI law, the largest rate it may ask for and the low-pass before it."""

    p: float  #: kfp: [m/(s N)] for a force, [rad/(s N m)] for a moment
    i: float  #: kfi: [m/(s^2 N)] or [rad/(s^2 N m)]
    limit: float  #: Largest rate [m/s] or [rad/s]
    filter_hz: float
    """Corner of the low-pass on the measurement [Hz].

    The sensor feels the tool's own inertia: without the filter a proportional gain kfp feeds kfp m d/dt of
    the command back, which beyond about kfp m 2 pi (sensor bandwidth) = 1 is a limit cycle, whatever the
    part.
    """


class PiMemory(Record):
    """Memory of ``force_pi``."""

    integral: float  #: Of the error [N s] or [N m s]
    measured: float  #: Low-passed [N] or [N m]
    started: bool


@kernel
def force_pi(
    wanted: float, measured: float, highest: float, gains: PiGains, dt: float, state: PiMemory
) -> float:
    """Rate kfp (Fd - Fe) + kfi integral (Fd - Fe) dt, limited, without wind-up [m/s] or [rad/s] (paper 1, eq.
    5).

    ``wanted`` is Fd, ``measured`` Fe [N] or [N m]. The rate is at most ``highest``, and no faster either way
    than its limit. The integral rests while the rate is at a limit and would grow further.
    """
    state.measured = (
        low_pass_step(state.measured, measured, gains.filter_hz, dt) if state.started else measured
    )
    state.started = True
    error = wanted - state.measured
    grown = state.integral + error * dt
    rate = gains.p * error + gains.i * grown
    limited = min(max(rate, -gains.limit), gains.limit, highest)
    if rate == limited or rate * error < 0.0:
        state.integral = grown
    return limited


# Gains are right for one stiffness: kfp k is the loop's crossover, and filter and latency limit that.

FELT_FROM = 0.25  #: Share of the set force by which the force must rise before travel gives a stiffness
LEAST_SHARE = 0.15  #: Of the gains, where a part came towards the tool and its travel gives no stiffness


class FeltMemory(Record):
    """Memory of ``felt_share``; with a ``share`` of 0 it starts anew."""

    travel: float  #: Into the part since contact [m]
    late: float  #: The same through the low-pass of the force [m]
    at_contact: float  #: Force [N]
    share: float  #: Of the gains [-]
    landed: bool


@kernel
def felt_share(
    wanted: float, measured: float, speed: float, stiffness: float, filter_hz: float, dt: float,
    state: FeltMemory,
) -> float:  # fmt: skip
    """Share of the gains that keeps the crossover at most at what they give with a ``stiffness`` [N/m].

    What is felt is force by travel since contact, both through the same low-pass, until the tool has landed:
    later the travel follows the part. ``measured`` is the low-passed force [N], ``speed`` that into the part
    [m/s].
    """
    if state.share == 0.0:
        state.travel = state.late = 0.0
        state.at_contact, state.share, state.landed = measured, 1.0, False
    state.travel += speed * dt
    state.late = low_pass_step(state.late, state.travel, filter_hz, dt)
    rise = measured - state.at_contact
    state.landed = state.landed or measured >= wanted
    if not state.landed and rise > FELT_FROM * wanted:
        state.share = min(max(stiffness * state.late / rise, LEAST_SHARE), 1.0)
    return state.share


# How fast a tool may press without a strike, whatever the springs.

MOST_SHARE = 1.25  #: Of the set force, which is not exceeded
STIFFEST = 4.0  #: Times the drawn stiffness that the springs may have
BRAKING = 0.8  #: Share of the robot's acceleration that is planned with


class StrikeGains(Record):
    """What the bound on the speed into the part counts on."""

    stiffness: float  #: Of the springs, as drawn [N/m]
    acceleration: float  #: The robot's [m/s^2]
    delay: float  #: From motion to reading and from command to motion, together [s]


@kernel
def strike_limit(g: StrikeGains, wanted: float, reading: float, unseen: float) -> float:
    """Speed into the part [m/s] above which the stiffest springs allowed for could be pressed with too much.

    Let F be the last ``reading`` [N], u the travel into the part that it does not show yet, ``unseen`` [m], k
    the stiffness and a the acceleration. Stopped as quickly as the robot can, the tool presses with at most

        F + 4 k (u + v^2 / 2 a) <= 1.25 F_set,    so    v <= sqrt(2 a ((1.25 F_set - F) / 4 k - u)).

    Nothing in it is estimated: F is measured, u is known from encoders and commands.
    """
    room = (MOST_SHARE * wanted - reading) / (STIFFEST * g.stiffness) - max(unseen, 0.0)
    return math.sqrt(2.0 * BRAKING * g.acceleration * max(room, 0.0))
