"""`polish-sim inspect`: the quality of any tool path on a part, ours or not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from polish_sim.cli import console
from polish_sim.cli.finished_plan import check_part, with_plan
from polish_sim.cli.options import (
    CONFIG_OPTIONS,
    OUTPUT_OPTIONS,
    Given,
    argument,
    build_scenario,
    named_options,
    takes,
)
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.config import PartConfig, PlanConfig, Scenario
from polish_sim.errors import InputError
from polish_sim.experiments.registry import REGION_OPTIONS
from polish_sim.row_file import save_plots, write_json

InspectedFile = Annotated[
    Path,
    argument("PATH", "Plan folder, path.json, path.csv, CSV of x,y,z,i,j,k (mm), or APT/CLDATA."),
]

# Of a path that is no plan of ours: its part has to be named, the step-over is guessed unless something sets
# it.
UNKNOWN = Scenario(part=PartConfig(file=""), plan=PlanConfig(stepover_m=math.nan))


@takes(
    *("--part", "--fixture", "--units", "--up", *REGION_OPTIONS, "--stepover", "--overlap"),
    *("--pad-diameter", "--contact-force", "--feed", *CONFIG_OPTIONS, *OUTPUT_OPTIONS),
    defaults=UNKNOWN,
)
def inspect(path: InspectedFile, given: Given) -> None:
    """Measure a tool path on a part: metrics.json, coverage.ply and two pictures.

    A plan of ours is measured with its own settings, on its own part unless --part names it; other paths
    need --part, their step-over is found, and the defaults are theirs. The part is not placed: times keep
    the tool's limits, not the arm's.
    """
    refuse_taken(given, path)
    from polish_sim.analysis.inspect_plot import plot_distributions, plot_maps, write_coverage_mesh
    from polish_sim.exchange import plan_facts, read_path
    from polish_sim.experiments.cycle import cycle_strokes, time_figures
    from polish_sim.experiments.stroke_motion import check_stroke_rule
    from polish_sim.planning import guessed_stepover, inspect_path
    from polish_sim.planning.quality.figures import path_table

    tool_path = read_path(path)
    beside = path.with_name("path.json")
    facts = plan_facts(beside if path.name == "path.csv" and beside.exists() else path)
    if facts:
        base = with_plan(Scenario(), path, facts, named_options(given))
    elif given["--part"] is None:
        raise InputError(f"'{path}' does not say which part it was made on: give it with --part.")
    else:
        base = UNKNOWN
    scenario = build_scenario(base, given)
    check_stroke_rule(scenario.smoothing)
    if facts:
        check_part(path, scenario.part.file, facts["part"])
    plan = scenario.plan
    notes = list[str]()
    if math.isnan(plan.stepover_m):
        plan = replace(plan, stepover_m=guessed_stepover(tool_path, scenario.pad, notes))
    with claimed(given, "inspect") as folder, console.progress() as observer:
        found = inspect_path(tool_path, scenario.part, plan, scenario.process, scenario.pad, observer)
        observer.stage("time the motion")
        strokes = cycle_strokes(scenario, tool_path, found.mesh.noise, observer.progress)
        found.figures.update(time_figures(strokes))
        observer.stage("draw")
        notes += found.notes
        write_json(folder.draft / "metrics.json", found.figures | {"notes": notes})
        write_coverage_mesh(folder.draft / "coverage.ply", found)
        save_plots(folder.draft, {"coverage.png": plot_maps(found), "spacing.png": plot_distributions(found)})
    console.notes(notes)
    console.table(path_table(f"{path.name} on {found.mesh.name}", found.figures))
    console.say_folder(folder.final)
