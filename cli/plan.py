"""`polish-sim plan`: from a part's mesh to a tool path, with its figures and a picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from polish_sim.cli import console
from polish_sim.cli import option_types as o
from polish_sim.cli.idle_options import refuse_idle_in, refuse_idle_on_path, refuse_one_robot
from polish_sim.cli.option_groups import (
    ConfigOptions,
    MasterOptions,
    OutputOptions,
    PatternOptions,
    RegionOptions,
    ToolOptions,
    takes_groups,
)
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.cli.rendering import prepare_headless
from polish_sim.cli.scenario_options import build_scenario, given_options
from polish_sim.config import Scenario


@takes_groups
def plan(
    part: o.PartFile,
    *,
    region: RegionOptions,
    pattern: PatternOptions,
    tool: ToolOptions,
    dual: o.Dual = False,
    master: MasterOptions,
    settings: ConfigOptions,
    export: o.Export = None,
    output: OutputOptions,
) -> None:
    """Plan a tool path on a part: path.csv, path.json, metrics.json and path.png."""
    given = given_options({"part": part}, region, pattern, tool, master)
    refuse_taken(output.out, output.overwrite)
    if dual:
        refuse_idle_in("dual", given)
    else:
        refuse_one_robot(given)
    base = Scenario(experiment="dual" if dual else "surface")
    scenario = build_scenario(base, given, settings.config, settings.set_ or [])
    prepare_headless()
    # Lazy: --help must not wait for the numerical libraries.
    import numpy as np

    from polish_sim.analysis.path_plot import plot_plan
    from polish_sim.cli.planning import plan_for_two
    from polish_sim.dual.gripper import seat_text
    from polish_sim.exchange import ExportSetup, check_formats, export_plan, write_plan
    from polish_sim.experiments import time_law
    from polish_sim.experiments.report import save_plots
    from polish_sim.planning import PATTERNS, plan_part

    refuse_idle_on_path(scenario.plan, {name: known.listens for name, known in PATTERNS.items()}, given)
    formats = check_formats(export or [])
    setup = ExportSetup(scenario.process, scenario.spindle, part_pose=scenario.part.pose)
    with claimed(output.out, "plan", output.overwrite) as folder, console.progress() as observer:
        asked = (scenario.part, scenario.plan, scenario.process, scenario.pad, observer)
        result = plan_for_two(scenario, observer) if dual else plan_part(*asked)
        observer.stage("time the motion")
        result.figures.update(time_law(scenario, result.path))
        write_plan(folder.draft, result)
        export_plan(folder.draft, result, formats, setup)
        observer.stage("draw")
        save_plots(folder.draft, {"path.png": plot_plan(result, "Once around the rim" if dual else "")})
    for note in result.notes:
        console.note(f"note: {note}")
    if dual:
        console.note(f"part: {seat_text(np.array(result.figures['T_gripper_work']))}")
    console.table(f"plan of {result.mesh.name}", ["figure", "unit", "value"], _rows(result.figures))
    console.say(f"folder: {folder.final}")


def _rows(m: Mapping[str, Any]) -> list[list[str]]:
    mm, cm2, percent = 1e3, 1e4, 1e2
    spread = " / ".join(console.number_or_dash(m[f"stepover_{name}_m"], mm, ".2f") for name in ("p5", "p95"))
    return [
        ["facets", "", str(m["facets"])],
        ["region, of the part's surface", "cm^2", f"{m['region_area_m2'] * cm2:.1f} of {m['part_area_m2'] * cm2:.1f}"],
        ["path length in contact", "m", f"{m['path_length_m']:.3f}"],
        ["  through the air, leads included", "m", f"{m['air_length_m']:.3f}"],
        ["time in contact, at the feed", "s", f"{m['time_in_contact_s']:.1f}"],
        ["time in contact, smoothed motion", "s", console.number_or_dash(m["motion_time_s"], 1.0, ".1f")],
        ["cycle time, at the feed, air included", "s", f"{m['cycle_time_s']:.1f}"],
        [
            "way at the full feed, starts and stops included",
            "%",
            console.number_or_dash(m["feed_kept"], percent, ".1f"),
        ],
        ["least feed, starts and stops left out", "mm/s", console.number_or_dash(m["feed_least_m_s"], mm, ".2f")],
        ["  at, along the path with its leads", "m", console.number_or_dash(m["feed_least_at_m"], 1.0, ".3f")],
        ["step-over, mean", "mm", console.number_or_dash(m["stepover_mean_m"], mm, ".2f")],
        ["step-over, p5 / p95", "mm", spread],
        ["region covered by the pad", "%", f"{m['coverage'] * percent:.1f}"],
        ["  within 0.55 step-overs", "%", f"{m['coverage_stepover'] * percent:.1f}"],
        ["crossings of the path with itself", "", str(m["self_crossings"])],
        ["pad in the part, at most", "mm", f"{m['pad_in_part_max_m'] * mm:.3g}"],
        ["retracts", "", str(m["retracts"])],
        ["tool axis turned by smoothing, at most", "deg", f"{math.degrees(m['axis_deviation_max_rad']):.3g}"],
        ["largest distance to surface", "mm", f"{m['max_distance_to_surface_m'] * mm:.1g}"],
        ["planned in", "s", f"{m['plan_time_s']:.2f}"],
    ]
