"""What a time law does at a raster's U-turns: target's acceleration and jerk, force and tracking, by rule.

Run with ``python -m benchmarks.u_turns [--feed MM_S]``: `run surface` on a flat plate, strokes 25 mm apart,
for 10 s.
"""

from __future__ import annotations

import argparse

import numpy as np

from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.scenario_file import override

RULES = ("none", "joint-jerk", "spline")
PLATE = (
    "robot.arm=ideal",  # no cycles of the link are missed: rows are of even steps
    "part.file=plate",
    "plan.pattern=raster",
    "plan.raster_direction=[1.0, 0.0, 0.0]",
    "plan.stepover_m=0.025",
    "process.max_feed_s=10",
)


LAST_S = 0.5
"""The stop at the end of the time given is the clock's, not the rule's [s]."""


def measure(rule: str, feed: float) -> str:
    """A line of figures of one run at a feed [mm/s]."""
    settings = [*PLATE, f"process.feed_m_s={feed / 1e3}", f"smoothing.rule={rule}"]
    run = run_experiment(override(default_scenario("surface"), settings))
    fed = np.flatnonzero(run.log.fed)
    fed = fed[run.log["time_s"][fed] < run.log["time_s"][fed[-1]] - LAST_S]
    step = float(np.median(np.diff(run.log["time_s"][fed])))
    moved = [run.log["target_position_m"][fed]]
    for _ in range(3):
        moved.append(np.diff(moved[-1], axis=0) / step)
    speed, acceleration, jerk = (float(np.linalg.norm(each, axis=1).max()) for each in moved[1:])
    force, off = run.figures["force_max_deviation_n"], run.figures["tracking_error_max_m"]
    way = float(run.trace.path_s_m.max())
    return (
        f"{rule:10}{speed * 1e3:7.1f} mm/s{acceleration:8.2f} m/s^2{jerk:9.1f} m/s^3{force:8.2f} "
        f"N{off * 1e3:8.2f} mm{way * 1e3:8.0f} mm"
    )


def main() -> None:
    """Print a line per rule."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--feed", type=float, default=100.0, metavar="MM_S")
    feed = parser.parse_args().feed
    print(
        f"{'rule':10}{'speed':>12}{'acceleration':>14}{'jerk':>15}{'force off':>10}{'tracking':>11}"
        f"{'way in 10 s':>11}"
    )
    for rule in RULES:
        print(measure(rule, feed), flush=True)


if __name__ == "__main__":
    main()
