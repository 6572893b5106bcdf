"""Removal of `run surface` and `run dual` on displaced parts, at one feed and with ``--even-removal``: a
table and a picture.

    python -m benchmarks.even_removal [--proof] [--part NAME]... [--seed 700]... [--before 1] [--force 40]
    [--overrun MM] [--as-drawn] [--out FOLDER]

At one feed: step-over 8 mm, 10 mm/s. Even: step-over 4.2 mm, at the feed with which by the plan's model as
much comes off as in the first run at one feed. Both on the arm ``ur5e``; with ``--proof`` the even plan is
proven first. A line for each part and seed: standard deviation over mean of the region, the same a pad's
radius inside the border, time and mean removal over those of the first run at one feed that was not stopped.
``--before N`` runs at one feed with N seeds only. ``ring`` is a flat ring, 180 and 90 mm across;
``hub_dual`` is the hub's rim in `run dual`, whose plans are not proven.
``--as-drawn`` leaves the part where the plan has it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import trimesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from polish_sim.analysis.removal_plot import removal_colors
from polish_sim.config import Scenario
from polish_sim.dual.dual import run_dual
from polish_sim.experiments import default_scenario
from polish_sim.experiments.assembly import check
from polish_sim.experiments.even_removal import _Problem, even_out, plan_removal, planned
from polish_sim.experiments.proof import prove
from polish_sim.experiments.result import RunResult
from polish_sim.experiments.surface import run_surface
from polish_sim.planning import PlanResult
from polish_sim.scenario_file import override

HUB_DUAL = "hub_dual"
PARTS = ("freeform", "saddle", "ring", "plate_two_holes", HUB_DUAL)
ONE_FEED = ("plan.stepover_m=0.008", "process.feed_m_s=0.01")
EVEN = ("plan.stepover_m=0.0042", "process.feed_m_s=0.021", "plan.removal=even")
AS_DRAWN = ("part.displacement_m=0", "part.rotation_rad=0", "part.form_error_m=0")


def main() -> None:
    """Print the table and draw a seed of each part both ways."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", action="append", default=[])
    parser.add_argument("--seed", type=int, action="append", default=[])
    parser.add_argument("--before", type=int, default=99)
    parser.add_argument("--force", type=float, default=40.0)
    parser.add_argument("--overrun", type=float, default=0.0, help="of the even plan [mm], 0 = its own")
    parser.add_argument("--proof", action="store_true")
    parser.add_argument("--as-drawn", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("results/even_removal"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    for part in asked.part or PARTS:
        with TemporaryDirectory() as folder:
            common = [f"part.file={part_file(part, Path(folder))}", f"process.contact_force_n={asked.force}"]
            common += ["robot.arm=ur5e", *(AS_DRAWN if asked.as_drawn else ())]
            maps = compare(part, common, asked)
        np.savez(asked.out / f"{part}.npz", **maps)
    files = [asked.out / f"{part}.npz" for part in PARTS]
    draw_all([file for file in files if file.exists()]).savefig(asked.out / "even_removal.png", dpi=80)


def part_file(part: str, folder: Path) -> str:
    """A shipped part's name, or the file of a ring made here."""
    if part != "ring":
        return "wheel_hub_rim" if part == HUB_DUAL else part
    ring = trimesh.creation.annulus(r_min=0.045, r_max=0.09, height=0.02, sections=128)
    ring.apply_scale(1e3)
    ring.export(folder / "ring.stl")
    return str(folder / "ring.stl")


def compare(part: str, common: list[str], asked: argparse.Namespace) -> dict[str, Any]:
    """Run a part both ways with all seeds; maps of one of them, by the picture's column names."""
    seeds = asked.seed or list(range(700, 705))
    name, run = ("dual", run_dual) if part == HUB_DUAL else ("surface", run_surface)
    usual = override(default_scenario(name), [*common, *ONE_FEED, "safety.proof=none"])
    plan, before = plan_removal(usual), None
    for number, seed in enumerate(seeds):
        if before is not None and number >= asked.before:
            break
        result = run(*planned(replace(usual, seed=seed), plan))
        before = before or (result if result.figures["path_done"] >= 1.0 else None)
        say(part, seed, "one feed", result, before or result)
    assert before is not None, "every run at one feed was stopped"
    even_plan = (*EVEN, f"plan.overrun_m={1e-3 * asked.overrun}")
    scenario, plan = plan_as_much(override(default_scenario(name), [*common, *even_plan]), before)
    if asked.proof and name == "surface":
        plan, scenario = prove(scenario, plan)
    print(*plan.notes, sep="\n", flush=True)
    even = [run(*planned(replace(scenario, seed=seed), plan)) for seed in seeds[:1]]
    say(part, seeds[0], "even", even[0], before)
    for seed in seeds[1:]:
        say(part, seed, "even", run(*planned(replace(scenario, seed=seed), plan)), before)
    return {**columns(before, "before"), **columns(even[0], "even")}


def plan_as_much(asked: Scenario, before: RunResult) -> tuple[Scenario, PlanResult]:
    """The even plan that by its model takes off as much as the run ``before`` did, and its scenario."""
    scenario = check(asked)
    plan = plan_removal(scenario)
    problem = _Problem(scenario, plan, again=True)
    assert before.removal is not None
    more = float(problem.weights @ problem.goal) / before.removal.mean
    process = replace(scenario.process, feed_m_s=scenario.process.feed_m_s * more)
    scenario = replace(scenario, process=process)
    return scenario, even_out(scenario, plan)


def say(part: str, seed: int, name: str, result: RunResult, before: RunResult) -> None:
    """Print a line of the table."""
    m, usual = result.figures, before.figures["cycle_time_s"]
    assert result.removal is not None
    assert before.removal is not None
    print(
        f"{part:16} {seed} {name:9} {100 * m['removal_cv']:5.1f}% inside "
        f"{100 * m['removal_cv_inside']:5.1f}%  {m['cycle_time_s']:6.1f} s "
        f"{m['cycle_time_s'] / usual:.2f}  mean {result.removal.mean / before.removal.mean:.2f}  "
        f"{1e3 * result.scenario.process.feed_m_s:.1f} mm/s  {(m['protective_stop'] or '')[:60]}",
        flush=True,
    )


def columns(result: RunResult, name: str) -> dict[str, Any]:
    """What the picture needs of a run."""
    removal = result.removal
    assert removal is not None
    found = {"vertices": removal.vertices, "triangles": removal.triangles, "relative": removal.relative}
    cv = {"cv": result.figures["removal_cv"], "seed": result.scenario.seed}
    return {f"{name}_{key}": value for key, value in {**found, **cv}.items()}


def draw_all(files: list[Path]) -> Figure:
    """Removal of every part before and after, from above."""
    figure = Figure((4.6 * len(files), 8.4), layout="constrained")
    grid = figure.subplots(2, len(files), squeeze=False)
    for axes, file in zip(grid.T, files, strict=True):
        maps = np.load(file)
        for ax, name, words in zip(axes, ("before", "even"), ("one feed", "even"), strict=True):
            of = {key: maps[f"{name}_{key}"] for key in ("vertices", "triangles", "relative", "cv", "seed")}
            title = f"{file.stem}, {words}\n{100 * of['cv']:.1f}% (seed {of['seed']})"
            draw(ax, of["vertices"], of["triangles"], of["relative"], title)
    return figure


def draw(axes: Any, vertices: Any, triangles: Any, relative: Any, title: str) -> None:
    """The removal from above."""
    x, y = 1e3 * vertices[:, :2].T
    seen = Triangulation(x, y, triangles)
    colors = axes.tripcolor(
        seen, relative, norm=Normalize(0.6, 1.4), cmap=removal_colors(), shading="gouraud"
    )
    axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.figure.colorbar(colors, ax=axes, label="removal / its mean")
    axes.set(xlim=(np.min(x) - 5, np.max(x) + 5))


if __name__ == "__main__":
    main()
