"""The shipped workpieces' top faces as closed formulas, so that height, slope and curvature are known
exactly.

Every shape is a graph z = f(x, y) over the part's bottom plane z = 0, in metres, z up. The STL files in
``workpieces`` are sampled from these formulas by `generate_workpieces`; tests of the planner and the contact
take truth from here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Graph(NamedTuple):
    """A shape evaluated at points of the plane."""

    height: Array
    """f [m], shape (n,)."""
    gradient: Array
    """(df/dx, df/dy) [-], shape (n, 2)."""
    hessian: Array
    """Second derivatives [1/m], shape (n, 2, 2)."""


class Shape(Protocol):
    """Anything that can be evaluated as a graph over the plane."""

    def evaluate(self, xy: Array) -> Graph:
        """Height, gradient and Hessian at points `xy` [m], shape (n, 2)."""


@dataclass(frozen=True)
class Quadric:
    """A plane, an elliptic or a hyperbolic paraboloid: f = height + (kx x^2 + ky y^2) / 2."""

    height: float
    """Height in the middle [m]."""
    kx: float
    """Second derivative along x [1/m], positive for a trough."""
    ky: float
    """Second derivative along y [1/m]."""

    def evaluate(self, xy: Array) -> Graph:
        """See `Shape`."""
        k = np.array([self.kx, self.ky])
        hessian = np.broadcast_to(np.diag(k), (len(xy), 2, 2)).copy()
        return Graph(self.height + 0.5 * (xy**2) @ k, xy * k, hessian)


@dataclass(frozen=True)
class Cylinder:
    """The top of a cylinder whose axis is parallel to y."""

    height: float
    """Height of the crest [m]."""
    radius: float
    """Radius [m]."""

    def evaluate(self, xy: Array) -> Graph:
        """See `Shape`."""
        x = xy[:, 0]
        root = np.sqrt(self.radius**2 - x**2)
        gradient = np.stack([-x / root, np.zeros_like(x)], axis=1)
        hessian = np.zeros((len(xy), 2, 2))
        hessian[:, 0, 0] = -(self.radius**2) / root**3
        return Graph(self.height - self.radius + root, gradient, hessian)


@dataclass(frozen=True)
class Incline:
    """A level plane that climbs to a higher one over the line x = 0; foot and top of the climb are
    parabolas."""

    height: float
    """Height of the plane at negative x [m]."""
    rise: float
    """How much higher the plane at positive x is [m]."""
    slope: float
    """Steepest slope [-]."""
    rounding: float
    """Radius of curvature at foot and top [m]."""

    def evaluate(self, xy: Array) -> Graph:
        """See `Shape`."""
        x, bend = xy[:, 0], self.rounding * self.slope
        half = 0.5 * (self.rise / self.slope + bend)
        # From each end the climb begins as a parabola and continues straight to the middle, its centre of
        # symmetry.
        inward = np.clip(half - np.abs(x), 0.0, half)
        bent, straight = np.minimum(inward, bend), np.maximum(inward - bend, 0.0)
        climbed = 0.5 * bent**2 / self.rounding + self.slope * straight
        hessian = np.zeros((len(xy), 2, 2))
        hessian[:, 0, 0] = np.where((inward > 0.0) & (inward < bend), -np.sign(x) / self.rounding, 0.0)
        height = np.where(x < 0.0, self.height + climbed, self.height + self.rise - climbed)
        return Graph(height, np.column_stack([bent / self.rounding, np.zeros_like(x)]), hessian)


@dataclass(frozen=True)
class Revolved:
    """Base of shapes f = profile(r) that are the same all around the z axis."""

    height: float
    """Height of the highest point [m]."""
    radius: float
    """Radius of the profile's arc [m]."""

    def profile(self, r: Array) -> tuple[Array, Array, Array]:
        """Profile and its first two derivatives at radii `r` [m], each shape (n,)."""
        raise NotImplementedError

    def evaluate(self, xy: Array) -> Graph:
        """See `Shape`."""
        return radial(xy, *self.profile(np.linalg.norm(xy, axis=1)))


@dataclass(frozen=True)
class SphereCap(Revolved):
    """The top of a sphere."""

    def profile(self, r: Array) -> tuple[Array, Array, Array]:
        """See `Revolved`."""
        root = np.sqrt(self.radius**2 - r**2)
        return self.height - self.radius + root, -r / root, -(self.radius**2) / root**3


@dataclass(frozen=True)
class TorusRim(Revolved):
    """The top of a torus: a ring whose cross-section is an arc, as the crowned rim of a wheel hub."""

    ring_radius: float
    """Distance of the crest from the axis [m]."""

    def profile(self, r: Array) -> tuple[Array, Array, Array]:
        """See `Revolved`."""
        across = r - self.ring_radius
        root = np.sqrt(self.radius**2 - across**2)
        return self.height - self.radius + root, -across / root, -(self.radius**2) / root**3


@dataclass(frozen=True)
class FoldedDome:
    """A shallow dome with six rounded folds that run outwards like spokes and fade out towards the middle.

    f = height - D(r) - a(r) (sum_j G(u_j . x) - N(r)). D is a hyperboloid, N another one. Each of three lines
    through the middle, 60 deg apart, is a fold G: its second derivative is one raised cosine, so a fold turns
    the surface once, without a counter-bend beside it. N is the folds' mean height, taken off so that they do
    not steepen the dome; a fades them in. Circles around the middle cross six crests at right angles.
    """

    height: float
    """Height in the middle [m]."""
    dome_radius: float
    """Radius of curvature of the dome D in the middle [m]."""
    dome_flattening: float
    """Radius at which D turns from a sphere's curvature to a cone's slope [m]."""
    fold_curvature: float
    """Second derivative of a fold at its crest [1/m]."""
    fold_half_width: float
    """Distance from a fold's crest to where it ends [m]."""
    fade_start: float
    """Radius up to which there are no folds [m]."""
    fade_end: float
    """Radius from which the folds have their full strength [m]."""

    def evaluate(self, xy: Array) -> Graph:
        """See `Shape`."""
        dome, folds, fade = self._dome(xy), self._folds(xy), self._fade(xy)
        cross = fade.gradient[:, :, None] * folds.gradient[:, None, :]
        bend = fade.height[:, None, None] * folds.hessian + folds.height[:, None, None] * fade.hessian
        return Graph(
            self.height - dome.height - fade.height * folds.height,
            -dome.gradient - fade.height[:, None] * folds.gradient - folds.height[:, None] * fade.gradient,
            -dome.hessian - bend - cross - cross.transpose(0, 2, 1),
        )

    def _dome(self, xy: Array) -> Graph:
        """How far the dome has dropped."""
        return hyperboloid(xy, self.dome_flattening / self.dome_radius, self.dome_flattening)

    def _folds(self, xy: Array) -> Graph:
        """Sum of the three folds less their mean height."""
        mean_slope = self.fold_curvature * self.fold_half_width * 3.0 / np.pi
        mean = hyperboloid(xy, mean_slope, 0.42 * self.fold_half_width)
        height, gradient, hessian = -mean.height, -mean.gradient, -mean.hessian
        for angle in np.pi / 6 + np.arange(3) * np.pi / 3:
            across = np.array([-np.sin(angle), np.cos(angle)])
            g, slope, curvature = self._fold_profile(xy @ across)
            height = height + g
            gradient = gradient + slope[:, None] * across
            hessian = hessian + curvature[:, None, None] * np.outer(across, across)
        return Graph(height, gradient, hessian)

    def _fold_profile(self, across: Array) -> tuple[Array, Array, Array]:
        """G and its first two derivatives at distances `across` from a fold's crest."""
        k, w = self.fold_curvature, self.fold_half_width
        v = np.clip(across, -w, w)
        phase = np.pi * v / w
        slope = 0.5 * k * (v + w / np.pi * np.sin(phase))
        height = 0.5 * k * (0.5 * v**2 + (w / np.pi) ** 2 * (1.0 - np.cos(phase)))
        return height + slope * (across - v), slope, 0.5 * k * (1.0 + np.cos(phase))

    def _fade(self, xy: Array) -> Graph:
        """A smooth step (fifth degree) of the radius from 0 to 1."""
        length = self.fade_end - self.fade_start
        t = np.clip((np.linalg.norm(xy, axis=1) - self.fade_start) / length, 0.0, 1.0)
        value = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
        slope = 30.0 * t**2 * (1.0 - t) ** 2 / length
        curvature = 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / length**2
        return radial(xy, value, slope, curvature)


def radial(xy: Array, value: Array, slope: Array, curvature: Array) -> Graph:
    """A function of the radius alone, as a graph over the plane.

    Args:
        xy: Points [m], shape (n, 2).
        value: The function at the points' radii, shape (n,).
        slope: Its derivative by the radius, 0 in the middle, shape (n,).
        curvature: Its second derivative, shape (n,).

    Returns:
        Value, gradient and Hessian at the points.
    """
    r = np.linalg.norm(xy, axis=1)
    middle = r < 1e-12
    outwards = xy / np.where(middle, 1.0, r)[:, None]
    around = np.where(middle, curvature, slope / np.where(middle, 1.0, r))
    outer = outwards[:, :, None] * outwards[:, None, :]
    hessian = around[:, None, None] * np.eye(2) + (curvature - around)[:, None, None] * outer
    return Graph(value, slope[:, None] * outwards, hessian)


def hyperboloid(xy: Array, slope: float, rounding: float) -> Graph:
    """A cone pointing down with its tip rounded off: slope (sqrt(r^2 + rounding^2) - rounding).

    Args:
        xy: Points [m], shape (n, 2).
        slope: Slope far from the middle [-].
        rounding: Radius at which the rounding ends [m].

    Returns:
        The cone as a graph over the plane.
    """
    r = np.linalg.norm(xy, axis=1)
    root = np.hypot(r, rounding)
    return radial(xy, slope * (root - rounding), slope * r / root, slope * rounding**2 / root**3)


def normals(graph: Graph) -> Array:
    """Unit normals out of the part, shape (n, 3)."""
    upward = np.column_stack([-graph.gradient, np.ones(len(graph.height))])
    return np.asarray(upward / np.linalg.norm(upward, axis=1, keepdims=True), dtype=np.float64)


def normal_curvature(graph: Graph, directions: Array) -> Array:
    """Curvature of the surface along directions, positive where it is convex seen from outside.

    Args:
        graph: The surface at n points.
        directions: Horizontal parts of tangent directions, any length but 0, shape (n, 2).

    Returns:
        Second over first fundamental form [1/m], shape (n,).
    """
    bend = np.einsum("ni,nij,nj->n", directions, graph.hessian, directions)
    climb = (directions * graph.gradient).sum(axis=1)
    length_squared = (directions**2).sum(axis=1) + climb**2
    return np.asarray(
        -bend / (length_squared * np.sqrt(1.0 + (graph.gradient**2).sum(axis=1))), dtype=np.float64
    )


def principal_curvatures(graph: Graph) -> Array:
    """Largest and smallest normal curvature [1/m], convex positive, shape (n, 2)."""
    steepness = np.linalg.norm(graph.gradient, axis=1)
    level = steepness < 1e-12
    uphill = np.where(level[:, None], [1.0, 0.0], graph.gradient / np.where(level, 1.0, steepness)[:, None])
    across = np.column_stack([-uphill[:, 1], uphill[:, 0]])
    # Second fundamental form in the orthonormal tangent directions uphill and across.
    stretch = np.sqrt(1.0 + steepness**2)
    bend = -graph.hessian / stretch[:, None, None]
    up_up = np.einsum("ni,nij,nj->n", uphill, bend, uphill) / stretch**2
    up_across = np.einsum("ni,nij,nj->n", uphill, bend, across) / stretch
    across_across = np.einsum("ni,nij,nj->n", across, bend, across)
    mean, spread = 0.5 * (up_up + across_across), np.hypot(0.5 * (up_up - across_across), up_across)
    return np.stack([mean + spread, mean - spread], axis=1)
