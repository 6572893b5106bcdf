"""A closed curve through points with four continuous derivatives: a periodic quintic spline (layer 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from polish_sim.errors import SmoothingError

Array = NDArray[np.float64]

LEAST_POINTS = 6
DEGREE = 5


@dataclass(frozen=True)
class ClosedSpline:
    """A closed curve over a parameter that grows by chord length, once round from 0 to ``length``."""

    curve: BSpline
    length: float
    """Sum of the chords [m]."""

    def __call__(self, u: Array, derivative: int = 0) -> Array:
        """Points [m], or derivatives by the parameter, at parameters ``u`` [m] of any lap, shape (k, 3)."""
        return np.asarray(self.curve(np.mod(u, self.length), nu=derivative))

    def tangents(self, u: Array) -> Array:
        """Unit tangents, shape (k, 3)."""
        slope = self(u, 1)
        return np.asarray(slope / np.linalg.norm(slope, axis=1, keepdims=True))


def fit_closed_spline(points: Array) -> ClosedSpline:
    """The curve through points and back to the first one.

    Args:
        points: Points in order, the first not repeated [m], shape (n, 3).

    Returns:
        The curve, C4 everywhere.

    Raises:
        SmoothingError: Fewer than six points, or two neighbours in one place.
    """
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < LEAST_POINTS:
        raise SmoothingError(f"a closed quintic curve needs {LEAST_POINTS} points (n, 3) or more; got {points.shape}.")
    round_trip = np.concatenate([points, points[:1]])
    chords = np.linalg.norm(np.diff(round_trip, axis=0), axis=1)
    if chords.min() <= 1e-9:
        k = int(np.argmin(chords))
        raise SmoothingError(f"points {k + 1} and {(k + 1) % len(points) + 1} are in one place: leave one out.")
    u = np.concatenate([[0.0], np.cumsum(chords)])
    return ClosedSpline(make_interp_spline(u, round_trip, k=DEGREE, bc_type="periodic"), float(u[-1]))
