"""The elastic pad pressed on the real part: an elastic foundation sampled over the disc (layer 8a).

Each sample point's depth below the part (signed distance) gives a normal pressure, linear with a Hunt-Crossley
factor, and its sliding velocity gives Coulomb friction, smooth at zero speed. The sum acts on the sliding head.
Engine contact against a triangulated part chatters or is slow and knows no area of contact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.config import PadConfig
from polish_sim.geometry.distance_field import DistanceField, field_distance, field_gradient

Array = NDArray[np.float64]


class Pad(NamedTuple):
    """The disc, sampled; the pad frame has its origin at the face's centre and z out of the tool."""

    points: Array
    """Sample points on the face [m], shape (n, 2), equal area each."""
    stiffness: float
    """Normal stiffness of one point [N/m]."""
    damping: float
    """Hunt-Crossley factor [s/m]."""
    friction: float
    """Coulomb coefficient [-]."""
    smoothing: float
    """Sliding speed v_s of the smoothed Coulomb law v / sqrt(v^2 + v_s^2) [m/s]."""


class RealPart(NamedTuple):
    """The part as it really lies in the cell."""

    field: DistanceField
    """Signed distance in the work frame, form error included."""
    rotation: Array
    """R_base_work of the real part, shape (3, 3)."""
    position: Array
    """Origin of the work frame in base [m], shape (3,)."""


def build_pad(config: PadConfig) -> Pad:
    """Sample the disc on rings of equal-area cells, each point at the centroid radius of its cell."""
    return Pad(
        _ring_points(config.points) * config.radius_m,
        config.stiffness_n_m / config.points,
        config.damping_s_m,
        config.friction,
        config.friction_smoothing_m_s,
    )


def _ring_points(count: int) -> Array:
    """Points of equal weight on the unit disc, shape (count, 2): rings whose counts grow with their radius."""
    rings = max(1, round(math.sqrt(count / math.pi)))
    shares = (2 * np.arange(rings) + 1) / rings**2
    ends = np.round(np.cumsum(shares) * count).astype(int)
    starts = np.concatenate([[0], ends[:-1]])
    points = []
    for k, (start, end) in enumerate(zip(starts, ends, strict=True)):
        inner, outer = math.sqrt(start / count), math.sqrt(end / count)
        radius = math.sqrt(0.5 * (inner**2 + outer**2)) if start else 0.5 * outer * math.sqrt(2.0)
        angles = 2 * math.pi * (np.arange(end - start) + 0.5 * (k % 2)) / (end - start)
        points.append(radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    return np.concatenate(points)


@njit(cache=True)
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
    """Contact force and torque of the part on the pad.

    Args:
        pad: The sampled disc.
        part: The real part.
        spin: Spindle speed about pad z [rad/s].
        R_base_pad: Pad frame, shape (3, 3).
        pad_center: Centre of the face [m], base, shape (3,).
        pad_velocity: Velocity of the centre [m/s], base, shape (3,).
        pad_turning: Angular velocity of the head without the spindle [rad/s], base, shape (3,).
        force: Written: force on the pad [N], base, shape (3,).
        torque: Written: torque on the pad about its centre [N m], base, shape (3,).

    Returns:
        Largest depth of a point [m]; negative or zero without contact.
    """
    force[:] = 0.0
    torque[:] = 0.0
    R_part = part.rotation
    # The pad's frame in the work frame of the real part.
    ox, oy, oz = pad_center[0] - part.position[0], pad_center[1] - part.position[1], pad_center[2] - part.position[2]
    cx = R_part[0, 0] * ox + R_part[1, 0] * oy + R_part[2, 0] * oz
    cy = R_part[0, 1] * ox + R_part[1, 1] * oy + R_part[2, 1] * oz
    cz = R_part[0, 2] * ox + R_part[1, 2] * oy + R_part[2, 2] * oz
    xx = R_part[0, 0] * R_base_pad[0, 0] + R_part[1, 0] * R_base_pad[1, 0] + R_part[2, 0] * R_base_pad[2, 0]
    xy = R_part[0, 1] * R_base_pad[0, 0] + R_part[1, 1] * R_base_pad[1, 0] + R_part[2, 1] * R_base_pad[2, 0]
    xz = R_part[0, 2] * R_base_pad[0, 0] + R_part[1, 2] * R_base_pad[1, 0] + R_part[2, 2] * R_base_pad[2, 0]
    yx = R_part[0, 0] * R_base_pad[0, 1] + R_part[1, 0] * R_base_pad[1, 1] + R_part[2, 0] * R_base_pad[2, 1]
    yy = R_part[0, 1] * R_base_pad[0, 1] + R_part[1, 1] * R_base_pad[1, 1] + R_part[2, 1] * R_base_pad[2, 1]
    yz = R_part[0, 2] * R_base_pad[0, 1] + R_part[1, 2] * R_base_pad[1, 1] + R_part[2, 2] * R_base_pad[2, 1]
    wx = pad_turning[0] + spin * R_base_pad[0, 2]
    wy = pad_turning[1] + spin * R_base_pad[1, 2]
    wz = pad_turning[2] + spin * R_base_pad[2, 2]
    deepest = -1.0
    for i in range(pad.points.shape[0]):
        a, b = pad.points[i, 0], pad.points[i, 1]
        px, py, pz = cx + a * xx + b * yx, cy + a * xy + b * yy, cz + a * xz + b * yz
        depth = -field_distance(part.field, px, py, pz)
        deepest = max(deepest, depth)
        if depth <= 0.0:
            continue
        _, gx, gy, gz = field_gradient(part.field, px, py, pz)
        size = math.sqrt(gx * gx + gy * gy + gz * gz)
        if size == 0.0:
            continue
        gx, gy, gz = gx / size, gy / size, gz / size
        # Outward normal, lever arm and velocity of the point in the base frame.
        nx = R_part[0, 0] * gx + R_part[0, 1] * gy + R_part[0, 2] * gz
        ny = R_part[1, 0] * gx + R_part[1, 1] * gy + R_part[1, 2] * gz
        nz = R_part[2, 0] * gx + R_part[2, 1] * gy + R_part[2, 2] * gz
        rx = a * R_base_pad[0, 0] + b * R_base_pad[0, 1]
        ry = a * R_base_pad[1, 0] + b * R_base_pad[1, 1]
        rz = a * R_base_pad[2, 0] + b * R_base_pad[2, 1]
        # The spindle's turning moves a point within the face; only the head's motion presses it in.
        along = (
            nx * (pad_velocity[0] + pad_turning[1] * rz - pad_turning[2] * ry)
            + ny * (pad_velocity[1] + pad_turning[2] * rx - pad_turning[0] * rz)
            + nz * (pad_velocity[2] + pad_turning[0] * ry - pad_turning[1] * rx)
        )
        pressure = pad.stiffness * depth * (1.0 - pad.damping * along)
        if pressure <= 0.0:
            continue
        vx = pad_velocity[0] + wy * rz - wz * ry
        vy = pad_velocity[1] + wz * rx - wx * rz
        vz = pad_velocity[2] + wx * ry - wy * rx
        normal_speed = nx * vx + ny * vy + nz * vz
        vx, vy, vz = vx - normal_speed * nx, vy - normal_speed * ny, vz - normal_speed * nz
        drag = pad.friction * pressure / math.sqrt(vx * vx + vy * vy + vz * vz + pad.smoothing**2)
        fx, fy, fz = pressure * nx - drag * vx, pressure * ny - drag * vy, pressure * nz - drag * vz
        force[0] += fx
        force[1] += fy
        force[2] += fz
        torque[0] += ry * fz - rz * fy
        torque[1] += rz * fx - rx * fz
        torque[2] += rx * fy - ry * fx
    return deepest
