"""What share of the time the time law of `run surface` loses, by rule, part and feed, robot included.

Run with ``python -m benchmarks.feed_kept``: two minutes or more.
"""

from __future__ import annotations

from dataclasses import replace

from polish_sim.config import Scenario
from polish_sim.experiments import default_scenario
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.part_setup import placed_strokes, placed_tool
from polish_sim.experiments.stroke_motion import feed_figures
from polish_sim.experiments.surface import prepare_surface
from polish_sim.scenario_file import override
from polish_sim.scoring.battery import BATTERY

CASES = (("freeform-30", (0.01, 0.03, 0.06, 0.1)), ("flat-100", (0.03, 0.1)))
RULES = ("joint-jerk", "spline")


def scenario_of(case: str) -> Scenario:
    """A moving case of the battery, its whole path."""
    settings = {each.name: each.settings for each in BATTERY}[case]
    return override(default_scenario("surface"), [*settings, "process.max_feed_s=0"])


def main() -> None:
    """Print a line per part, feed and rule."""
    print(f"{'part':12}{'feed':>10}  {'rule':10}{'time lost':>10}{'feed kept':>11}{'least feed':>12}")
    for case, feeds in CASES:
        scenario = scenario_of(case)
        place = prepare_surface(*planned(scenario))
        for feed in feeds:
            for rule in RULES:
                asked = replace(
                    scenario,
                    process=replace(scenario.process, feed_m_s=feed),
                    smoothing=replace(scenario.smoothing, rule=rule),
                )
                jobs = placed_strokes(asked, place.path, placed_tool(place.path, place.reach), 0.0, 0.0)
                law = feed_figures(jobs)
                lost = 1.0 - sum(job.process.length for job in jobs) / feed / law["motion_time_s"]
                print(
                    f"{case.split('-')[0]:12}{feed * 1e3:6.0f} mm/s  "
                    f"{rule:10}{lost:9.2%}{law['feed_kept']:11.1%}{law['feed_least_m_s'] * 1e3:7.1f} mm/s",
                    flush=True,
                )


if __name__ == "__main__":
    main()
