"""`python -m benchmarks.corner_shapes`: find the control points of `motion.spline.curve.SWINGS` again.

One corner between two legs, tip only: the control points off the chain's are moved until the law of time
loses least over several turns. The knots of each swing are given; its largest distance from the chain is made
1 at the end.
"""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import minimize

from polish_sim.motion.rules.chain import build_chain
from polish_sim.motion.rules.limits import SmoothingLimits
from polish_sim.motion.spline import curve
from polish_sim.motion.spline.motion import smooth_by_spline

Array = NDArray[np.float64]

LEG, TOLERANCE = 0.02, 2e-5
TURNS = np.radians([45, 75, 90, 110])


def largest(points: Array) -> float:
    """Distance of a swing from the kink, by the change of slopes and the unit."""
    half = curve.Swing(1.0, 1.0, points).knots
    half = np.concatenate([half, half[-1] + (half[-1] - half[-2]) * np.arange(1, 8)])
    knots = np.concatenate([-half[:0:-1], half])
    t = np.concatenate([np.full(5, knots[0]), knots, np.full(5, knots[-1])])
    greville = np.convolve(t[1:-1], np.full(5, 0.2), "valid")
    control, middle, m = 0.5 * np.abs(greville), len(greville) // 2, len(points)
    control[middle - m + 1 : middle + m] += np.concatenate([points[:0:-1], points])
    x = np.linspace(0.0, half[-1], 4000)
    return float(np.abs(BSpline(t, control, 5)(x) - 0.5 * x).max())


def lost(points: Array) -> float:
    """Mean time of corners that keep the tolerance [s]."""
    size = largest(points)
    swing = curve.Swing(1.0, 1.0 / size, points / size)
    times = []
    for turn in TURNS:
        tips = LEG * np.array([[-1.0, 0, 0], [0, 0, 0], [np.cos(turn), np.sin(turn), 0]])
        chain = build_chain(tips, np.tile(np.eye(3), (3, 1, 1)))
        with patch.object(curve, "SWINGS", (swing,)):
            times.append(smooth_by_spline(chain, SmoothingLimits(), TOLERANCE, 1e-3, None).end)
    return float(np.mean(times))


def main() -> None:
    """Print every swing found from the one that stands."""
    for swing in curve.SWINGS:
        start = swing.points * 1.0
        simplex = np.vstack([start, start + 0.1 * np.eye(len(start))])
        options = {"maxfev": 200, "initial_simplex": simplex, "fatol": 1e-6}
        points = minimize(lost, start, method="Nelder-Mead", options=options).x
        size = largest(points)
        print(
            f"{1e3 * lost(start):.2f} ms, found {1e3 * lost(points):.2f} ms: reach {1.0 / size:.4f}", end=" "
        )
        print(np.round(points / size, 4).tolist(), flush=True)


if __name__ == "__main__":
    main()
