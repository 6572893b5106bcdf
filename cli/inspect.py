"""`polish-sim inspect`: the quality of any tool path on a part, ours or not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from polish_sim.cli import console
from polish_sim.cli.options import CONFIG_OPTIONS, OUTPUT_OPTIONS, Given, argument, build_scenario, takes
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.cli.run import check_part, plan_facts, planned_part, planned_settings
from polish_sim.config import PlanConfig, Scenario
from polish_sim.errors import InputError
from polish_sim.experiments.registry import REGION_OPTIONS
from polish_sim.row_file import Metrics, save_plots, write_json
from polish_sim.scenario_file import merge

InspectedFile = Annotated[
    Path,
    argument("PATH", "Plan folder, path.json, path.csv, CSV of x,y,z,i,j,k (mm), or APT/CLDATA."),
]


@takes(
    *("--part", "--fixture", "--units", "--up", *REGION_OPTIONS, "--stepover", "--overlap"),
    *("--pad-diameter", "--contact-force", "--feed", *CONFIG_OPTIONS, *OUTPUT_OPTIONS),
)
def inspect(path: InspectedFile, given: Given) -> None:
    """Measure a tool path on a part: metrics.json, coverage.ply and two pictures.

    A plan of ours is measured with its own settings, on its own part unless --part names it; else the
    step-over is the path's. The part is not placed: times keep the tool's limits, not the arm's.
    """
    refuse_taken(given)
    # Lazy: --help must not wait for the numerical libraries.
    from polish_sim.analysis.inspect_plot import plot_distributions, plot_maps, write_coverage_mesh
    from polish_sim.exchange import read_path
    from polish_sim.experiments.cycle import cycle_strokes, time_figures
    from polish_sim.experiments.stroke_motion import check_stroke_rule
    from polish_sim.planning import guessed_stepover, inspect_path

    tool_path = read_path(path)
    beside = path.with_name("path.json")
    facts = plan_facts(beside if path.name == "path.csv" and beside.exists() else path)
    if facts:
        base = merge(Scenario(), planned_settings(path, facts, given), "")
        if given["--part"] is None:
            given = {**given, "--part": planned_part(path, facts["part"])}
    elif given["--part"] is None:
        raise InputError(f"'{path}' does not say which part it was made on: give it with --part.")
    else:  # the step-over is guessed unless something sets it
        base = Scenario(plan=PlanConfig(stepover_m=math.nan))
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
    for note in notes:
        console.note(f"note: {note}")
    console.table(f"{path.name} on {found.mesh.name}", ["figure", "unit", "value"], _rows(found.figures))
    console.say(f"folder: {folder.final}")


def _rows(m: Metrics) -> list[list[str]]:
    mm = 1e3
    percent = 1e2
    mm2 = 1e6
    names = ("min", "p5", "mean", "p95", "max")
    spread = " / ".join(console.number_or_dash(m[f"stepover_{name}_m"], ".2f", mm) for name in names)
    return [
        ["path length in contact", "m", f"{m['path_length_m']:.3f}"],
        ["length / (area / step-over)", "", f"{m['length_ratio']:.3f}"],
        ["time in contact, at the feed", "s", f"{m['time_in_contact_s']:.1f}"],
        ["time in contact, smoothed motion", "s", console.number_or_dash(m["motion_time_s"], ".1f")],
        [
            "cycle time: with air, touch-down and lifts",
            "s",
            console.number_or_dash(m["cycle_time_s"], ".1f"),
        ],
        ["lifts on the way", "", f"{m['lifts']}"],
        ["step-over, min / p5 / mean / p95 / max", "mm", spread],
        ["overlap of neighbouring turns", "% of pad", console.number_or_dash(m["overlap"], ".1f", percent)],
        ["covered by the pad", "%", f"{m['coverage'] * percent:.1f}"],
        ["  within 0.55 step-overs", "%", f"{m['coverage_stepover'] * percent:.1f}"],
        ["time under the pad, mean", "s", f"{m['exposure_mean_s']:.3g}"],
        ["  its variation over the area", "cv", f"{m['exposure_cv']:.3f}"],
        ["  area over twice the median", "mm^2", f"{m['over_polished_area_m2'] * mm2:.4g}"],
        ["crossings of the path with itself", "", f"{m['self_crossings']}"],
        ["sharpest corner", "deg", f"{math.degrees(m['sharpest_corner_rad']):.1f}"],
        ["largest turn of the tool axis", "deg/mm", f"{math.degrees(m['max_axis_rate_rad_m']) * 1e-3:.2f}"],
        ["out of the tool's reach", "mm^2", f"{m['unreachable_area_m2'] * mm2:.4g}"],
        ["tool in the part, at most", "mm", f"{m['pad_in_part_max_m'] * mm:.3g}"],
        ["  over a length of the path", "m", f"{m['pad_in_part_length_m']:.3g}"],
        ["largest distance to surface", "mm", f"{m['max_distance_to_surface_m'] * mm:.2g}"],
    ]
