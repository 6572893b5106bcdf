"""How well the shaking of the arm by its gears is foreseen: the estimate before a run beside how the run ends.

    python -m benchmarks.shaking

Every part at several feeds with `hybrid-pi`, the refusal switched off.
"""

from __future__ import annotations

import math

from polish_sim.cell.linear_arm import measure_shaking
from polish_sim.experiments import default_scenario, prepare_surface, run_experiment, surface
from polish_sim.experiments.part_setup import placed_strokes, placed_tool
from polish_sim.scenario_file import override

STEPOVERS = {"sphere_50": 0.012, "freeform": 0.016, "saddle": 0.016, "cylinder": 0.016, "wheel_hub_rim": 0.016}  # [m]
FEEDS = (0.03, 0.045, 0.06, 0.1, 0.15, 0.2)  # [m/s]


def main() -> None:
    """Print a row a run."""
    surface.SHAKEN = math.inf  # type: ignore[misc]
    print(f"{'part':15} {'feed mm/s':>9} {'estimate / limit':>17}  end")
    for part, stepover in STEPOVERS.items():
        for feed in FEEDS:
            changes = [f"part.file={part}", f"plan.stepover_m={stepover}", f"process.feed_m_s={feed}"]
            scenario = override(default_scenario("surface"), changes)
            task = prepare_surface(scenario)
            placed = placed_tool(task.plan.path, task.reach)
            strokes = placed_strokes(scenario, task.plan.path, placed, 0.0, scenario.plan.clearance_m)
            share = measure_shaking(scenario, strokes, task.reach.q_start).jump_n / scenario.safety.jump_limit_n
            stop = run_experiment(scenario, task.plan).stop_reason
            end = "to the end" if stop is None else stop.split(":")[0]
            print(f"{part:15} {1e3 * feed:9.0f} {share:17.2f}  {end}", flush=True)


if __name__ == "__main__":
    main()
