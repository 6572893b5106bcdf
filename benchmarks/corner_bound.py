"""`python -m benchmarks.corner_bound [PIECES ...]`: the trial path's best cycle time, by ever finer
programmes.

Every corner's least loss comes from the convex programme of `corner_program` (needs the extra `bench`), tip
limits
only: no symmetric motion within the tolerance of the two lines loses less. Beside it: exact stops and
`spline`.
"""

from __future__ import annotations

import numpy as np

from benchmarks.corner_program import Corner, least_time_lost
from benchmarks.exact_stop import plan_exact_stop
from benchmarks.table import words
from polish_sim.motion.rules.chain import build_chain
from polish_sim.motion.rules.limits import SmoothingLimits
from polish_sim.motion.spline.motion import smooth_by_spline
from polish_sim.smoothing import AXIS_TOLERANCE, TOLERANCE
from polish_sim.smoothing.smooth import TRIAL_LIMITS, trial_path


def main() -> None:
    chain = trial_path()
    speed, most, jerk = TRIAL_LIMITS.tip_speed, TRIAL_LIMITS.tip_acceleration, TRIAL_LIMITS.tip_jerk
    cosines = np.sum(chain.directions[1:] * chain.directions[:-1], axis=1)
    turns, times = np.unique(np.round(np.arccos(np.clip(cosines, -1.0, 1.0)), 6), return_counts=True)
    ends = float(chain.lengths.sum()) / speed + speed / most + most / jerk
    for pieces in map(int, words(__doc__) or ("20", "40", "80", "160")):
        corners = [
            Corner(float(turn), TOLERANCE * jerk**2 / most**3, speed * jerk / most**2) for turn in turns
        ]
        lost = np.array([least_time_lost(corner, pieces) for corner in corners]) * most / jerk
        print(
            f"  {pieces:4d} pieces per half corner: best cycle time {ends + float(lost @ times):.4f} s",
            flush=True,
        )
    for name, plan in (("exact stops", plan_exact_stop), ("spline", smooth_by_spline)):
        print(f"  {name}, tool only: {plan(chain, TRIAL_LIMITS, TOLERANCE, AXIS_TOLERANCE, None).end:.4f} s")
    _print_corners()


TURNS, LEGS, TOLERANCES = (10, 30, 60, 90, 120, 135, 150, 165), (0.02, 0.005, 0.001), (5e-6, 2e-5, 1e-4)


def _print_corners() -> None:
    """Single corners between two legs: time by that of exact stops."""
    limits = SmoothingLimits()
    for leg in LEGS:
        for tolerance in TOLERANCES:
            cells = []
            for turn in np.radians(TURNS):
                tips = leg * np.array([[-1.0, 0, 0], [0, 0, 0], [np.cos(turn), np.sin(turn), 0]])
                chain = build_chain(tips, np.tile(np.eye(3), (3, 1, 1)))
                end = smooth_by_spline(chain, limits, tolerance, AXIS_TOLERANCE, None).end
                cells.append(f"{end / plan_exact_stop(chain, limits).end:8.4f}")
            print(
                f"  legs {1e3 * leg:4.0f} mm, tolerance {1e6 * tolerance:4.0f} um" + "".join(cells),
                flush=True,
            )


if __name__ == "__main__":
    main()
