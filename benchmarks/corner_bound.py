"""`python -m benchmarks.corner_bound [PIECES ...]`: the trial path's best cycle time, by ever finer programmes.

Every corner's least loss comes from the convex programme of `corner_program` (needs the extra `bench`), tip limits
only: no symmetric motion within the tolerance of the two lines loses less. Beside it: exact stops and `certified`.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.corner_program import Corner, least_time_lost
from benchmarks.exact_stop import plan_exact_stop
from polish_sim.motion.certified.smoother import plan_certified
from polish_sim.motion.rules.chain import build_chain
from polish_sim.smoothing.experiment import AXIS_TOLERANCE, TOLERANCE
from polish_sim.smoothing.trial import TRIAL_LIMITS, trial_path


def main() -> None:
    path = trial_path()
    chain = build_chain(path.tips, path.rotations)
    speed, most, jerk = TRIAL_LIMITS.tip_speed, TRIAL_LIMITS.tip_acceleration, TRIAL_LIMITS.tip_jerk
    cosines = np.sum(chain.directions[1:] * chain.directions[:-1], axis=1)
    turns, times = np.unique(np.round(np.arccos(np.clip(cosines, -1.0, 1.0)), 6), return_counts=True)
    ends = float(chain.lengths.sum()) / speed + speed / most + most / jerk
    for pieces in map(int, sys.argv[1:] or ("20", "40", "80", "160")):
        corners = [Corner(float(turn), TOLERANCE * jerk**2 / most**3, speed * jerk / most**2) for turn in turns]
        lost = np.array([least_time_lost(corner, pieces) for corner in corners]) * most / jerk
        print(f"  {pieces:4d} pieces per half corner: best cycle time {ends + float(lost @ times):.4f} s", flush=True)
    for name, plan in (("exact stops", plan_exact_stop), ("certified", plan_certified)):
        _, schedule = plan(chain, TRIAL_LIMITS, TOLERANCE, AXIS_TOLERANCE, None)
        print(f"  {name}, tool only: {schedule.end:.4f} s")


if __name__ == "__main__":
    main()
