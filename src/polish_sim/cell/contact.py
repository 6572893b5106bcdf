"""The elastic pad pressed on the real part, its spindle, and the active flange behind them.

The pad is an elastic foundation sampled over the disc. Each sample point's depth below the part (signed
distance) gives a normal pressure, linear with a Hunt-Crossley factor, and its sliding velocity gives Coulomb
friction, smooth at zero speed. The sum acts on the sliding head. Engine contact against a triangulated part
chatters or is slow and knows no area of contact.
"""

from __future__ import annotations

import math

import numpy as np

from polish_sim.arrays import Array, directions_at
from polish_sim.cell.engine import HEAD, EngineViews
from polish_sim.cell.gears import slip
from polish_sim.config import HeadConfig, PadConfig, SpindleConfig
from polish_sim.control.loops import low_pass_share
from polish_sim.geometry.field_lookup import DistanceField, look_up
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Bundle, Record, kernel, matvec, minus, set_to
from polish_sim.spatial import GRAVITY


class PadMaterial(Record):
    """What the pad is made of."""

    stiffness: float  #: Normal stiffness of one sample point [N/m]
    damping: float  #: Hunt-Crossley factor [s/m]
    friction: float  #: Coulomb coefficient [-]
    smoothing: float  #: Sliding speed v_s of the smoothed Coulomb law v / sqrt(v^2 + v_s^2) [m/s]


class Pad(Bundle):
    """The disc, sampled; the pad frame has its origin at the face's centre and z out of the tool."""

    material: PadMaterial
    x: Array  #: Sample points on the face, equal area each [m], shape (n,)
    y: Array  #: [m], shape (n,)
    depth: Array  #: Depth of each point below the part [m], negative above it, shape (n,)
    slope: Array  #: Gradient of the distance at each point, work frame, shape (3, n)
    motion: Array  #: Work array: the pad's axes, velocities and the sums in the work frame, shape (7, 3)


class RealPart(Bundle):
    """The part as it really lies in the cell."""

    field: DistanceField  #: Signed distance where the pad can touch, work frame, form error included
    coarse: DistanceField  #: Coarse signed distance of the whole part, for the crash check
    rotation: Array  #: R_base_work of the real part, shape (3, 3)
    position: Array  #: Origin of the work frame in base [m], shape (3,); changes while the part moves
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Mean outward normal of the polished region, base frame; the part moves along it."""


def build_pad(config: PadConfig, spring_scale: float = 1.0) -> Pad:
    """Sample the disc with points of equal area; the real pad is ``spring_scale`` times as stiff as
    configured."""
    points = _spread_points(config.points) * config.radius_m
    n, (x, y) = len(points), np.ascontiguousarray(points.T)
    material = PadMaterial(
        stiffness=config.stiffness_n_m * spring_scale / n,
        damping=config.damping_s_m,
        friction=config.friction,
        smoothing=config.friction_smoothing_m_s,
    )
    return Pad(material, x, y, np.zeros(n), np.zeros((3, n)), np.zeros((7, 3)))


def _spread_points(count: int) -> Array:
    """Points of equal weight on the unit disc: four golden-angle spirals, shape (count rounded up to fours,
    2).

    Every point's ring has the same area; four alike quarters have the disc's centroid and second moments
    exactly. Concentric circles would make the force on a small area of contact depend on how many of them it
    holds: up to 2.6% too soft on a sphere of 50 mm, against 1.1% here, with 100 points.
    """
    place = np.arange(math.ceil(count / 4))
    radius = np.sqrt((place + 0.5) / len(place))
    turn = 0.5 * math.pi * place * (math.sqrt(5.0) - 1.0) / 2.0
    angle = (turn[:, None] + 0.5 * math.pi * np.arange(4)).ravel()
    return np.repeat(radius, 4)[:, None] * directions_at(angle)


@kernel
def press_pad(
    pad: Pad,
    part: RealPart,
    spin: float,
    R_base_pad: Array,
    pad_center: Array,
    pad_velocity: Array,
    pad_turning: Array,
    force: Array,
    torque: Array,
) -> float:
    """Write force [N] and torque about the pad's centre [N m] of the part on the pad, base frame, shape (3,)
    each; returns the largest depth of a point [m], negative above the part.

    Depth and slope of the pad's points are written too. ``spin`` is the spindle's speed about pad z [rad/s],
    ``pad_center`` the centre of the face [m], ``pad_velocity`` its velocity [m/s], ``pad_turning`` the head's
    angular velocity without the spindle [rad/s]; all in the base frame.
    """
    R, w = part.rotation, pad.motion
    # Everything in the work frame of the real part.
    set_to(w[0], matvec(R.T, minus(pad_center, part.position)))
    set_to(w[1], matvec(R.T, R_base_pad[:, 0]))
    set_to(w[2], matvec(R.T, R_base_pad[:, 1]))
    set_to(w[3], matvec(R.T, pad_velocity))
    set_to(w[4], matvec(R.T, pad_turning))
    deepest = _measure_depths(pad, part.field)
    if deepest <= 0.0:
        for i in range(3):
            force[i] = torque[i] = 0.0
        return deepest
    _sum_pressure(pad.material, pad.x, pad.y, pad.depth, pad.slope, w, spin)
    set_to(force, matvec(R, w[5]))
    set_to(torque, matvec(R, w[6]))
    return deepest


@kernel
def _measure_depths(pad: Pad, field: DistanceField) -> float:
    """Depth and slope at every point; returns the largest depth [m]."""
    w = pad.motion
    nodes = field.bricks.reshape(-1)
    per_metre = 1.0 / field.spacing
    cx, cy, cz = w[0, 0], w[0, 1], w[0, 2]
    xx, xy, xz = w[1, 0], w[1, 1], w[1, 2]
    yx, yy, yz = w[2, 0], w[2, 1], w[2, 2]
    deepest = -field.band
    for i in range(pad.x.shape[0]):
        a, b = pad.x[i], pad.y[i]
        distance, gx, gy, gz = look_up(
            field, nodes, per_metre, cx + a * xx + b * yx, cy + a * xy + b * yy, cz + a * xz + b * yz
        )
        pad.depth[i] = -distance
        pad.slope[0, i], pad.slope[1, i], pad.slope[2, i] = gx, gy, gz
        deepest = max(deepest, -distance)
    return deepest


@njit(fastmath={"contract", "reassoc", "nsz", "arcp"})
def _sum_pressure(
    material: PadMaterial, x: Array, y: Array, depths: Array, slope: Array, w: Array, spin: float
) -> None:
    """Sum pressure and friction over the points; without branches, so that the compiler can vectorise.

    Arguments as the fields of `Pad`. The products stand here in full: those of other kernels are not
    ``fastmath``.
    """
    xx, xy, xz = w[1, 0], w[1, 1], w[1, 2]
    yx, yy, yz = w[2, 0], w[2, 1], w[2, 2]
    ux, uy, uz = w[3, 0], w[3, 1], w[3, 2]
    ox, oy, oz = w[4, 0], w[4, 1], w[4, 2]
    # The spindle turns the points within the face; only the head's motion presses them in.
    sx, sy, sz = spin * (xy * yz - xz * yy), spin * (xz * yx - xx * yz), spin * (xx * yy - xy * yx)
    slope_x, slope_y, slope_z = slope[0], slope[1], slope[2]
    k = material.stiffness
    hardening = material.damping
    friction = material.friction
    smoothing = material.smoothing**2
    fx = fy = fz = tx = ty = tz = 0.0
    for i in range(x.shape[0]):
        a, b = x[i], y[i]
        gx, gy, gz = slope_x[i], slope_y[i], slope_z[i]
        size = 1.0 / math.sqrt(gx * gx + gy * gy + gz * gz + 1e-30)
        nx, ny, nz = gx * size, gy * size, gz * size
        rx, ry, rz = a * xx + b * yx, a * xy + b * yy, a * xz + b * yz
        hx, hy, hz = ux + oy * rz - oz * ry, uy + oz * rx - ox * rz, uz + ox * ry - oy * rx
        leaving = nx * hx + ny * hy + nz * hz
        pressure = k * max(depths[i], 0.0) * max(1.0 - hardening * leaving, 0.0)
        vx, vy, vz = hx + sy * rz - sz * ry, hy + sz * rx - sx * rz, hz + sx * ry - sy * rx
        along = nx * vx + ny * vy + nz * vz
        vx, vy, vz = vx - along * nx, vy - along * ny, vz - along * nz
        drag = friction * pressure / math.sqrt(vx * vx + vy * vy + vz * vz + smoothing)
        px, py, pz = pressure * nx - drag * vx, pressure * ny - drag * vy, pressure * nz - drag * vz
        fx, fy, fz = fx + px, fy + py, fz + pz
        tx, ty, tz = tx + (ry * pz - rz * py), ty + (rz * px - rx * pz), tz + (rx * py - ry * px)
    w[5, 0], w[5, 1], w[5, 2] = fx, fy, fz
    w[6, 0], w[6, 1], w[6, 2] = tx, ty, tz


# The spindle: its speed, and the pull of its imbalance.
#
# A rotor of balance grade G has its centre of mass off the axis by e = G / omega; it pulls with m e omega^2,
# turning with the spindle. The physics sees the pull once a step, the sensor at its own rate, aliased if it
# is slow.

RUN_DOWN_S = 0.5  # from full speed to rest when the drive fails


class Spindle(Record):
    """The spindle and the imbalance that turns with it."""

    commanded: float  #: Set speed [rad/s]
    imbalance: float  #: Mass times eccentricity m e [kg m]
    angle: float  #: [rad]
    speed: float  #: [rad/s]
    failed: bool  #: The drive has failed: it runs down


def build_spindle(config: SpindleConfig) -> Spindle:
    """A spindle at its speed, its heavy side along the head's x axis."""
    speed = 2.0 * math.pi * config.speed_rpm / 60.0
    imbalance = config.rotating_mass_kg * config.imbalance_m_s / speed if speed else 0.0
    return Spindle(commanded=speed, imbalance=imbalance, speed=speed)


@kernel
def turn_spindle(spindle: Spindle, dt: float) -> None:
    """Advance it by one step; after a failure of its drive it runs down evenly."""
    wanted = 0.0 if spindle.failed else spindle.commanded
    spindle.speed = max(wanted, spindle.speed - spindle.commanded * dt / RUN_DOWN_S)
    spindle.angle = (spindle.angle + spindle.speed * dt) % (2.0 * math.pi)


@kernel
def pull_of_imbalance(spindle: Spindle, R_base_head: Array, force: Array) -> None:
    """Add the imbalance's pull to a ``force`` on the head's centre of mass [N], base, shape (3,).

    ``R_base_head`` is the head's orientation, shape (3, 3); its z axis is the spindle's.
    """
    pull = spindle.imbalance * spindle.speed**2
    x, y = pull * math.cos(spindle.angle), pull * math.sin(spindle.angle)
    for i in range(3):
        force[i] += R_base_head[i, 0] * x + R_base_head[i, 1] * y


# An active flange: the head's spring with a loop that moves its preload until the force is as asked.
#
# In the slide acts F = k x + P, with the travel x, the stiffness k of the air while its valve is still, and
# the preload P:
#
#     dP/dt = 2 pi f (asked - F),  asked = start force + risen (wanted - start force)
#
# At rest the force is as asked at any travel; motion faster than the bandwidth f meets the air as a spring.
# The flange measures x and F itself. It sees neither friction in its slide nor the error of its weight.

SLIP_M = 2e-5  # way on which the slide's friction builds up, assumed [m]


class Flange(Record):
    """Its loop."""

    share: float  #: Of the force's error it takes off in a step [-]; 0: no flange
    stiffness: float  #: [N/m]
    stroke: float  #: [m]
    start: float  #: Force before contact [N]
    rise: float  #: Share of the ramp done in a step [-]
    most: float  #: Friction of the slide while it moves [N]
    weight: float  #: What is wrong with the compensated weight [N]
    preload: float  #: [N]
    travel: float  #: From the outer end, as measured [m]
    force: float  #: In the slide, as measured [N]
    friction: float  #: Against inward motion [N]
    risen: float  #: Share of the ramp that is done [-]


def build_flange(head: HeadConfig, dt: float) -> Flange:
    """A flange in the air, or none; ``dt``: physics step [s]."""
    flange = head.flange
    return Flange(
        share=low_pass_share(flange.bandwidth_hz, dt),
        stiffness=head.stiffness_n_m * head.spring_scale,
        stroke=head.travel_m,
        start=flange.start_force_n,
        rise=dt / max(flange.ramp_s, dt),
        most=flange.friction_n,
        weight=flange.weight_error * head.mass_kg * GRAVITY,
        preload=flange.start_force_n,
    )


@kernel
def hold_force(flange: Flange, e: EngineViews, wanted: float) -> None:
    """Measure, and set the preload that acts in this step; ``wanted`` [N] is what contact is asked to be."""
    moved = e.qpos[HEAD] - flange.travel
    flange.travel += moved
    flange.friction = slip(flange.friction, moved, flange.most, SLIP_M)
    flange.force = flange.stiffness * flange.travel + flange.preload
    flange.risen = min(flange.risen + flange.rise, 1.0) if flange.travel > 0.0 else 0.0
    asked = flange.start + flange.risen * (wanted - flange.start)
    flange.preload += flange.share * (asked - flange.force)
    # The engine carries the slide's weight; the part of it that is too much lifts the tool.
    push = flange.preload + flange.weight * e.site_xmat[e.tool_site, 2, 2]
    e.qfrc_applied[HEAD] = -push - flange.friction
