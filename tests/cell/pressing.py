"""A pad pressed on a part by hand, and the elastic foundation's wrench by quadrature: the known truth."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad_vec
from scipy.optimize import brentq

from polish_sim.arrays import Array
from polish_sim.cell import RealPart, build_pad, press_pad
from polish_sim.config import PadConfig

DOWN = np.diag([1.0, -1.0, -1.0])  # R_base_pad of a pad that looks straight down
PAD = PadConfig()
ELASTIC = replace(PAD, damping_s_m=0.0, friction=0.0)
HEAD_STIFFNESS = 20000.0 / 3.0  # [N/m]
PRESSED = 0.004  # D of 20 N on a flat part [m]


class Wrench(NamedTuple):
    """Force [N] and torque about the pad's centre [N m] of the part on the pad, base frame."""

    force: Array
    torque: Array


def press(
    part: RealPart,
    center: Array,
    R_base_pad: Array = DOWN,
    config: PadConfig = ELASTIC,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    turning: tuple[float, float, float] = (0.0, 0.0, 0.0),
    spin: float = 0.0,
) -> Wrench:
    """What the compiled contact says."""
    force, torque = np.zeros(3), np.zeros(3)
    press_pad(
        build_pad(config), part, spin, np.ascontiguousarray(R_base_pad), np.array(center, dtype=float),
        np.array(velocity), np.array(turning), force, torque,
    )  # fmt: skip
    return Wrench(force, torque)


def foundation(
    depth_and_normal: Callable[[Array], tuple[Array, Array]],
    center: Array,
    R_base_pad: Array,
    config: PadConfig = ELASTIC,
) -> Wrench:
    """Integral of k / A depth n over the disc: rings of 360 points, adaptive in the radius.

    Args:
        depth_and_normal: Points (n, 3) to depths below the surface (n,) and outward normals (n, 3).
        center: Centre of the face [m].
        R_base_pad: Pad frame.
        config: Radius and stiffness.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    around = np.cos(angle)[:, None] * R_base_pad[:, 0] + np.sin(angle)[:, None] * R_base_pad[:, 1]

    def ring(r: float) -> Array:
        depth, normal = depth_and_normal(center + r * around)
        force = np.maximum(depth, 0.0)[:, None] * normal
        return 2.0 * np.pi * r * np.concatenate([force, np.cross(r * around, force)], axis=1).mean(axis=0)

    total, _ = quad_vec(ring, 0.0, config.radius_m, epsrel=1e-4, epsabs=1e-12)
    total *= config.stiffness_n_m / (np.pi * config.radius_m**2)
    return Wrench(total[:3], total[3:])


def below_sphere(radius: float) -> Callable[[Array], tuple[Array, Array]]:
    """Depth and normal of points in a ball whose top is at the origin."""

    def depth_and_normal(points: Array) -> tuple[Array, Array]:
        offset = points + [0.0, 0.0, radius]
        distance = np.linalg.norm(offset, axis=1)
        return radius - distance, offset / distance[:, None]

    return depth_and_normal


def working_depth(radius: float) -> float:
    """How deep the pad itself sits in a ball when head spring and pad together are pressed in by D [m]."""

    def surplus(depth: float) -> float:
        force = foundation(below_sphere(radius), np.array([0.0, 0.0, -depth]), DOWN).force[2]
        return float(force - HEAD_STIFFNESS * (PRESSED - depth))

    return float(brentq(surplus, 1e-4, PRESSED, xtol=1e-9))
