"""The first seconds of a stroke, many times: the largest force, lost contact and stops over parts and seeds.

    python -m benchmarks.touch_downs [--seeds 100] [--first 500] [--feed 20] [--part NAME]...

A run lands on the part as its seed draws it, displaced and bent, and feeds for three seconds; plan and place
are made once. A line for each part and controller: the largest exact force and its seed, contact lost, guards
that tripped.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

from polish_sim.cell import Silent
from polish_sim.experiments import default_scenario
from polish_sim.experiments.assembly import build_cell, build_part
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.part_setup import random_streams
from polish_sim.experiments.surface import prepare_surface
from polish_sim.scenario_file import override

PARTS = ("freeform", "saddle", "sphere_100", "wheel_hub_rim", "plate_two_holes")
CONTROLLERS = ("hybrid-pi", "hybrid-adaptive")
FEED_S = 3.0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--feed", type=float, default=20.0)
    parser.add_argument("--part", action="append", default=[])
    asked = parser.parse_args()
    for part in asked.part or PARTS:
        for controller in CONTROLLERS:
            settings = [f"process.feed_m_s={1e-3 * asked.feed}", f"process.max_feed_s={FEED_S}",
                        "plan.clearance_m=0.01", f"part.file={part}"]  # fmt: skip
            base = override(default_scenario("surface"), settings)
            base = replace(base, controller=replace(base.controller, name=controller))
            place = prepare_surface(*planned(base))
            cell = build_cell(base, place, build_part(base, place))
            begun, largest, lost, stops = time.perf_counter(), (0.0, 0), 0.0, list[str]()
            for seed in range(asked.first, asked.first + asked.seeds):
                scenario = replace(base, seed=seed)
                rng = random_streams(seed).sensor
                cell.begin_again(scenario, build_part(scenario, place), rng)
                run = cell.run(Silent())
                force, fed = run.trace.normal_force_n, run.trace.fed
                largest = max(largest, (float(force.max()), seed))
                lost = max(lost, float((force[fed] < 0.5).sum()) * scenario.simulation.timestep_s)
                stops += [f"seed {seed}: {run.stop_reason}"] if run.stop_reason else []
            rate = asked.seeds / (time.perf_counter() - begun)
            print(
                f"{part:16s} {controller:16s} {asked.seeds:5d} runs, {rate:4.1f}/s: largest "
                f"{largest[0]:5.2f} N (seed {largest[1]}), contact lost {lost:.3f} s, {len(stops)} stops",
                flush=True,
            )
            print(*(f"    {stop}" for stop in stops[:3]), sep="\n", end="\n" if stops else "")


if __name__ == "__main__":
    main()
