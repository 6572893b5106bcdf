"""A pad pressed on a part by hand, and the elastic foundation's wrench by quadrature: the known truth."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad_vec
from scipy.optimize import brentq

from polish_sim.arrays import Array
from polish_sim.cell import build_pad, press_pad
from polish_sim.config import PadConfig

DOWN = np.diag([1.0, -1.0, -1.0])  # R_base_pad of a pad that looks straight down
PAD = PadConfig()
ELASTIC = replace(PAD, damping_s_m=0.0, friction=0.0)
HEAD_STIFFNESS = 20000.0 / 3.0  # [N/m]
PRESSED = 0.004  # D of 20 N on a flat part [m]
STILL = (0.0, 0.0, 0.0)
Foundation = Callable[[Array], tuple[Array, Array]]


class Wrench(NamedTuple):
    """Force [N] and torque about the pad's centre [N m] of the part on the pad, base frame."""

    force: Array
    torque: Array


def press(part, center, R_base_pad=DOWN, config=ELASTIC, velocity=STILL, turning=STILL, spin=0.0) -> Wrench:
    """What the compiled contact says."""
    found, R = Wrench(np.zeros(3), np.zeros(3)), np.ascontiguousarray(R_base_pad)
    center, velocity, turning = (np.array(vector, dtype=float) for vector in (center, velocity, turning))
    press_pad(build_pad(config), part, spin, R, center, velocity, turning, *found)
    return found


def foundation(depth_and_normal: Foundation, center: Array, R_base_pad: Array, config=ELASTIC) -> Wrench:
    """Integral of k / A depth n over the disc about a centre [m]: rings of 360 points, adaptive in radius.

    ``depth_and_normal`` takes points (n, 3) to depths below the surface (n,) and outward normals (n, 3).
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


def below_sphere(radius: float) -> Foundation:
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
