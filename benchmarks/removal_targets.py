"""A ramp of removal 1:2 across a plate on displaced parts, and what the optimisation takes.

    python -m benchmarks.removal_targets [--seed 700]... [--out FOLDER]

A line for each seed: rms deviation of removal over target from its mean, of the whole plate and a pad's
radius inside; least-squares slope of the removal from one side to the other (1.0 to 2.0 asked, so 2.0). Then
wall times of planning freeform at a step-over of 8 mm with and without ``--even-removal``, and of its dwell
alone, the least of three.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.even_removal import draw
from polish_sim.analysis.inspect_plot import write_ply
from polish_sim.analysis.metrics import spreads
from polish_sim.arrays import Array
from polish_sim.config import Scenario
from polish_sim.experiments import default_scenario
from polish_sim.experiments.assembly import check
from polish_sim.experiments.even_removal import even_out, plan_removal, planned
from polish_sim.experiments.surface import run_surface
from polish_sim.log import RemovalMap
from polish_sim.planning import plan_part
from polish_sim.scenario_file import override

COMMON = ("robot.arm=ur5e", "safety.proof=none")
PLATE = (
    *COMMON,
    "part.file=plate",
    "process.contact_force_n=40",
    "plan.stepover_m=0.004",
    "process.feed_m_s=0.021",
)


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, action="append", default=[])
    parser.add_argument("--out", type=Path, default=Path("results/removal_targets"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    usual = override(default_scenario("surface"), PLATE)
    scenario = check(override(usual, [f"plan.removal={write_ramp(asked.out / 'ramp.ply', usual)}"]))
    plan = plan_removal(scenario)
    print(plan.notes[-1])
    for seed in asked.seed or range(700, 705):
        found = run_surface(*planned(replace(scenario, seed=seed), plan))
        assert found.removal is not None
        print(f"ramp on plate, seed {seed}: {followed(found.removal)}", flush=True)
    figure = Figure((6.0, 5.0), layout="constrained")
    last = found.removal
    draw(figure.subplots(), last.vertices, last.triangles, last.relative, "plate, ramp 1:2")
    figure.savefig(asked.out / "ramp.png", dpi=100)
    times()


def target(x: Array) -> Array:
    """1 at the least x, 2 at the greatest."""
    return 1.0 + (x - x.min()) / np.ptp(x)


def write_ramp(file: Path, scenario: Scenario) -> Path:
    """The map of the ramp over the plate's region."""
    mesh = plan_part(scenario.part, scenario.plan).ready.ground.mesh
    colors = np.zeros((len(mesh.vertices), 3), dtype=np.uint8)
    shown = {"target": ("<f4", target(mesh.vertices[:, 0]))}
    write_ply(file, "ramp", (mesh.vertices, mesh.normals, mesh.triangles), colors, shown)
    return file


def followed(removal: RemovalMap) -> str:
    """How well a run's map follows the ramp."""
    wanted = target(removal.vertices[:, 0])
    whole, inside = spreads(removal.exposure / wanted, removal.areas, removal.vertices, removal.border, 0.025)
    weights = np.sqrt(removal.areas)
    columns = np.stack([np.ones_like(wanted), wanted - 1.0], axis=1)
    level, rise = np.linalg.lstsq(columns * weights[:, None], removal.exposure * weights, rcond=None)[0]
    return f"{100 * whole:.1f}% rms, inside {100 * inside:.1f}%, from 1 to {1.0 + rise / level:.2f}"


def times() -> None:
    """Wall times of planning freeform at 8 mm."""
    plain = override(default_scenario("surface"), [*COMMON, "part.file=freeform", "plan.stepover_m=0.008"])
    even = check(override(plain, ["plan.removal=even"]))
    plan = plan_removal(replace(even, plan=replace(even.plan, removal="", overrun_m=0.01)))
    least("plan without", lambda: plan_removal(plain))
    least("dwell alone", lambda: even_out(even, plan))
    least("plan with --even-removal", lambda: plan_removal(even))


def least(name: str, call: Callable[[], object]) -> None:
    """Print the least time of three calls after one that compiles."""
    call()
    found = []
    for _ in range(3):
        begin = time.perf_counter()
        call()
        found.append(time.perf_counter() - begin)
    print(f"{name:26} {min(found):.2f} s", flush=True)


if __name__ == "__main__":
    main()
