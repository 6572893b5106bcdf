"""A random-orbital sander against a fixed spindle with the same pad on the same path: maps, and a closed
form.

    python -m benchmarks.orbital [--part plate] [--seed 700] [--out FOLDER]

On a plane an orbit takes off F v / (s u) everywhere inside: force, sliding speed, step-over, feed. The line
says how near the run's mean comes two pad radii inside the border, and the deviation there, of both tools.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from benchmarks.even_removal import draw
from polish_sim.experiments import default_scenario
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.surface import run_surface
from polish_sim.job.tools import read_tools
from polish_sim.planning import plan_part
from polish_sim.scenario_file import merge, override

TOOLS = ("spindle-pad", "orbital-sander-50")


def main() -> None:
    """Print a line for each tool and draw both maps."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", default="plate")
    parser.add_argument("--seed", type=int, default=700)
    parser.add_argument("--out", type=Path, default=Path("results/orbital"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    usual = override(
        default_scenario("surface"),
        [
            f"part.file={asked.part}",
            "robot.arm=ur5e",
            "safety.proof=none",
            "plan.pattern=raster",
            "pad.choice=given",
        ],
    )
    usual = replace(usual, seed=asked.seed)
    plan = plan_part(usual.part, usual.plan, usual.process, usual.pad)
    figure = Figure((11.0, 5.0), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2), TOOLS, strict=True):
        tool = read_tools()[name]
        scenario = merge(usual, tool.settings(), "")
        found = run_surface(*planned(scenario, replace(plan, tool=plan.tool._replace(pad=scenario.pad))))
        removal, process = found.removal, scenario.process
        assert removal is not None
        away, _ = cKDTree(removal.vertices[removal.border[:, 0]]).query(removal.vertices)
        weights = np.where(away > 2.0 * tool.radius_m, removal.areas, 0.0)
        mean = float(weights @ removal.exposure / weights.sum())
        deviation = math.sqrt(float(weights @ (removal.exposure / mean - 1.0) ** 2 / weights.sum()))
        exact = process.contact_force_n * tool.slide_m_s / (usual.plan.stepover_m * process.feed_m_s)
        beside = f"{100 * (mean / exact - 1.0):+.2f}% of the closed form" if exact > 0.0 else ""
        f = found.figures
        print(
            f"{asked.part}, {name:18} whole {100 * f['removal_cv']:.1f}%, two radii inside "
            f"{100 * deviation:.1f}%, mean there {mean:.4g} N/m {beside} {f['protective_stop'] or ''}",
            flush=True,
        )
        draw(axes, removal, f"{asked.part}, {name}: {100 * f['removal_cv']:.1f}%")
    figure.savefig(asked.out / f"{asked.part}.png", dpi=100)


if __name__ == "__main__":
    main()
