"""The part as it really is: displaced from its nominal place and bent, seeded.

Plans are made on the drawing; force control earns its keep on the difference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, dots, norms
from polish_sim.cell.contact import RealPart
from polish_sim.config import PartConfig
from polish_sim.config.cell import PAD_TOP
from polish_sim.geometry.distance_field import bend_field, build_distance_field
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.field_lookup import NODES, OUTSIDE, DistanceField
from polish_sim.geometry.surface import Surface
from polish_sim.kernels import Record, Vector3, dot, kernel, minus
from polish_sim.spatial import rotations_from_vectors, transform

WAVELENGTHS = (0.04, 0.15)  # of the form error [m]
NORMAL_SHARE = 0.7  # least share of the displacement along the normal
_WAVES = 8
FIELD_SPACING = 0.001  # of the signed distance grid [m]
FIELD_BAND = 0.008  # half width of the band around the surface, at least [m]
DEEPEST_BAND = 0.02  # and at most: memory grows with it [m]
COARSE_SPACING = 0.004  # of the whole part's grid, for the crash check [m]
COARSE_BAND = 0.016  # [m]
FACING = 0.1  # least cosine between a facet's normal and the tool axis for the pad to press on it [-]
_MARGIN = 0.01  # around what the pad can touch: displacement, pressing, band [m]


class Touch(NamedTuple):
    """Where the pad moves on the nominal part, work frame."""

    positions: Array  #: Tool points on the part [m], shape (n, 3)
    axes: Array  #: Unit tool axes from the part to the tool, shape (n, 3)
    pad_radius: float  #: [m]
    depth: float = FIELD_BAND  #: How deep below its surface the part is modelled [m]


class FormError(NamedTuple):
    """A smooth bend: a sum of plane waves, its points in the work frame."""

    numbers: Array  #: Wave vectors [rad/m], shape (k, 3)
    phases: Array  #: [rad], shape (k,)
    scale: float = 1.0  #: [m]
    middle: float = 0.0  #: Of the sum

    def __call__(self, at: Array) -> Array:
        """Outward shift of the surface at points (n, 3): [m], (n,)."""
        return self.scale * (np.sin(at @ self.numbers.T + self.phases).sum(axis=1) - self.middle)

    def on_grid(self, corners: Array, steps: Array) -> Array:
        """The same at each of some steps (n, 3) from each of some corners (k, 3): [m], (k, n)."""
        start, on = corners @ self.numbers.T + self.phases, steps @ self.numbers.T
        waves = np.sin(start) @ np.cos(on).T + np.cos(start) @ np.sin(on).T
        return self.scale * (waves - self.middle)


def bend_of(config: PartConfig, points: Array, rng: np.random.Generator) -> FormError:
    """Draw a form error, scaled to its peak-to-peak size on some ``points`` (n, 3) [m], work frame."""
    lengths = rng.uniform(*WAVELENGTHS, _WAVES)
    directions = rng.normal(size=(_WAVES, 3))
    numbers = 2.0 * np.pi * directions / np.linalg.norm(directions, axis=1, keepdims=True) / lengths[:, None]
    waves = FormError(numbers, rng.uniform(0.0, 2.0 * np.pi, _WAVES))
    values = waves(points)
    span = np.ptp(values)
    scale = config.form_error_m / span if span > 0.0 else 0.0
    return waves._replace(scale=scale, middle=0.5 * float(values.max() + values.min()))


def displacement_of(config: PartConfig, normal: Array, center: Array, rng: np.random.Generator) -> Array:
    """Draw where the part really sits: pose of the real work frame in the nominal one, shape (4, 4).

    At least 0.7 of the displacement is along the region's mean outward ``normal``, up or down; the part is
    turned about ``center`` [m]; both (3,) in the work frame.
    """
    along = rng.uniform(NORMAL_SHARE, 1.0) * rng.choice([-1.0, 1.0])
    across = np.cross(normal, rng.normal(size=3))
    across /= np.linalg.norm(across)
    shift = config.displacement_m * (along * normal + np.sqrt(1.0 - along**2) * across)
    axis = rng.normal(size=3)
    R = rotations_from_vectors(config.rotation_rad * axis / np.linalg.norm(axis))
    return transform(R, center - R @ center + shift)


@dataclass(frozen=True, eq=False)
class PartFields:
    """Signed distances of a part before its errors, work frame; they are the costly part of it."""

    near: DistanceField  #: Where the pad can touch
    coarse: DistanceField  #: The whole part, for the crash check


def build_part_fields(surface: Surface, touch: Touch) -> PartFields:
    """Sample the distance to a whole surface (work frame): finely where the pad goes, coarsely all over."""
    near = build_distance_field(
        pressed_side(surface, touch), FIELD_SPACING, touch.depth, bounds=touched_box(touch)
    )
    return PartFields(near, build_distance_field(surface, COARSE_SPACING, COARSE_BAND))


def build_real_part(
    fields: PartFields,
    config: PartConfig,
    T_base_work: Array,
    region: Surface,
    up: Array,
    rng: np.random.Generator,
) -> RealPart:
    """Displace and bend the part of ``fields``, whose work frame lies nominally at ``T_base_work`` (4, 4).

    The errors are sized on the polished ``region``; where its normals cancel out, the displacement is along
    ``up``, work frame, shape (3,).
    """
    points = spread_over(region)
    normal = region.normal_sum
    size = np.linalg.norm(normal) / float(region.facet_areas.sum())
    normal = normal / np.linalg.norm(normal) if size > 0.1 else up
    bent = replace(fields, near=bend_field(fields.near, bend_of(config, points, rng).on_grid))
    return place_part(bent, displacement_of(config, normal, points.mean(axis=0), rng), T_base_work, normal)


def spread_over(region: Surface) -> Array:
    """Points all over a region, a quarter of the shortest wave apart or less [m], shape (n, 3).

    Facets alone do not do: a plane may have two, which say nothing of the waves between them.
    """
    corners = region.vertices[region.faces]
    edges = norms(corners - np.roll(corners, 1, axis=1)).max(axis=1)
    cuts = np.maximum(np.ceil(4.0 * edges / WAVELENGTHS[0]), 1.0).astype(int)
    points = []
    for n in np.unique(cuts):
        i, j = (grid.ravel() for grid in np.mgrid[:n, :n])
        shares = (np.stack([i, j], axis=1)[i + j < n] + 1.0 / 3.0) / n
        weights = np.column_stack([shares, 1.0 - shares.sum(axis=1)])
        points.append((weights @ corners[cuts == n]).reshape(-1, 3))
    return np.concatenate(points)


def place_part(fields: PartFields, T_work_real: Array, T_base_work: Array, normal: Array) -> RealPart:
    """A part displaced by ``T_work_real``, both (4, 4); its mean outward ``normal`` (3,) in its work
    frame."""
    T_base_real = T_base_work @ T_work_real
    rotation, position = np.ascontiguousarray(T_base_real[:3, :3]), np.ascontiguousarray(T_base_real[:3, 3])
    x, y, z = rotation @ normal
    return RealPart(fields.near, fields.coarse, rotation, position, (float(x), float(y), float(z)))


def pressed_side(surface: Surface, touch: Touch) -> Surface:
    """The facets that face the tool: what lies under the pad.

    The pad's depth is counted from this side. From the nearest side, whichever it is, a pad on a thin plate
    would be pushed out at the bottom once it is half through.
    """
    return surface.restrict(np.flatnonzero(facing_tool(surface, touch)))


def facing_tool(surface: Surface, touch: Touch) -> Bools:
    """Which facets face the tool where it comes nearest to them, shape (m,)."""
    normals, _ = facet_normals(surface.vertices, surface.faces)
    _, nearest = cKDTree(touch.positions).query(surface.vertices[surface.faces].mean(axis=1))
    return dots(normals, touch.axes[nearest]) > FACING


def touched_box(touch: Touch) -> Array:
    """Box around everything the pad's disc can touch, corners (2, 3) [m], work frame."""
    half = (
        touch.pad_radius * np.sqrt(np.clip(1.0 - touch.axes**2, 0.0, 1.0))
        + _MARGIN
        + touch.depth
        - FIELD_BAND
    )
    return np.stack([(touch.positions - half).min(axis=0), (touch.positions + half).max(axis=0)])


def build_fixture(surface: Surface, touch: Touch, T_base_work: Array) -> RealPart:
    """A fixture where it is drawn, finely where the pad goes by (``touch``, the tool's whole way)."""
    way, high = touch.positions, PAD_TOP * touch.axes
    box = touched_box(
        touch._replace(positions=np.vstack([way, way + high]), axes=np.vstack([touch.axes, touch.axes]))
    )
    near = build_distance_field(surface, FIELD_SPACING, 2.0 * FIELD_SPACING, bounds=box)
    coarse = build_distance_field(surface, COARSE_SPACING, COARSE_BAND)
    R, p = np.ascontiguousarray(T_base_work[:3, :3]), np.ascontiguousarray(T_base_work[:3, 3])
    return RealPart(near, coarse, R, p)


def no_part() -> RealPart:
    """Nothing to touch: everywhere is outside."""
    table = np.full((1, 1, 1), OUTSIDE, np.int32)
    bricks = np.full((1, NODES, NODES, NODES), FIELD_BAND, np.float32)
    field = DistanceField(np.zeros(3), FIELD_SPACING, FIELD_BAND, table, bricks)
    return RealPart(field, field, np.eye(3), np.zeros(3))


# A part that does not lie still: a sine along its mean normal, and shifts a fault may give it.
#
# It moves without tilting, in addition to the motion of a robot that carries it; its velocity enters the
# contact. The drawn part stays at rest.

SHIFT_SPEED = 0.02  # of a part that slips [m/s]


class PartMotion(Record):
    """How the part moves; base frame."""

    axis: Vector3  #: Unit direction of the sine, out of the polished region
    rest: Vector3  #: Origin of the work frame when the part is at rest [m]
    place: Vector3  #: The same while a robot carries the part [m]
    amplitude: float  #: Of the sine [m]
    frequency: float  #: Angular, of the sine [rad/s]
    start: float  #: Of the sine [s]
    shift: Vector3  #: Displacement beside the sine [m]
    goal: Vector3  #: Where ``shift`` moves to at ``SHIFT_SPEED`` [m]
    velocity: Vector3  #: Of its origin now [m/s]
    turning: Vector3  #: Its angular velocity [rad/s]


def build_part_motion(config: PartConfig, part: RealPart) -> PartMotion:
    """The motion a scenario asks for, from the start of the run on."""
    return PartMotion(
        axis=part.normal, rest=part.position, place=part.position, amplitude=config.motion_m,
        frequency=2.0 * math.pi * config.motion_hz,
    )  # fmt: skip


@kernel
def move_part(motion: PartMotion, t: float, dt: float, position: Array) -> None:
    """Place the part for the instant ``t`` [s]: the origin of its work frame [m], (3,), and its shift and
    velocity."""
    phase = motion.frequency * (t - motion.start)
    height = motion.amplitude * math.sin(phase)
    speed = motion.amplitude * motion.frequency * math.cos(phase)
    gap = minus(motion.goal, motion.shift)
    left = math.sqrt(dot(gap, gap))
    share = 0.0 if left == 0.0 else min(SHIFT_SPEED * dt / left, 1.0)
    for i in range(3):
        step = share * gap[i]
        motion.shift[i] += step
        motion.velocity[i] = speed * motion.axis[i] + step / dt
        position[i] = motion.place[i] + height * motion.axis[i] + motion.shift[i]
