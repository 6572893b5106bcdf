"""`polish-sim plan`: from a part's STL to a tool path, with its figures and a picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

import typer

from polish_sim.cli import console
from polish_sim.cli.output_folder import claimed
from polish_sim.cli.rendering import prepare_headless
from polish_sim.cli.run import (
    Config,
    ContactForce,
    Feed,
    Out,
    Overwrite,
    PadDiameter,
    Pattern,
    Region,
    Set,
    Stepover,
    Units,
    Up,
)
from polish_sim.cli.scenario_options import build_scenario
from polish_sim.config import Scenario
from polish_sim.errors import InputError

PartFile = Annotated[
    str, typer.Argument(metavar="PART", help="STL file, or the name of a shipped part.", show_default=False)
]
Overlap = Annotated[
    float | None,
    typer.Option("--overlap", metavar="PERCENT", help="Overlap of neighbouring turns, percent of the pad diameter."),
]
LeadIn = Annotated[str | None, typer.Option("--lead-in", metavar="NAME", help="normal, tangent or arc.")]
LeadAngle = Annotated[
    float | None, typer.Option("--lead-angle", metavar="DEG", help="Tool axis leans this far forward (deg).")
]
TiltAngle = Annotated[
    float | None, typer.Option("--tilt-angle", metavar="DEG", help="Tool axis leans this far to the left (deg).")
]


def plan(
    part: PartFile,
    pattern: Pattern = None,
    stepover: Stepover = None,
    overlap: Overlap = None,
    pad_diameter: PadDiameter = None,
    region: Region = None,
    up: Up = None,
    units: Units = None,
    lead_in: LeadIn = None,
    lead_angle: LeadAngle = None,
    tilt_angle: TiltAngle = None,
    contact_force: ContactForce = None,
    feed: Feed = None,
    config: Config = None,
    set_: Set = None,
    out: Out = None,
    overwrite: Overwrite = False,
) -> None:
    """Plan a tool path on a part: path.csv, path.json, metrics.json and path.png."""
    given = {
        "--part": part,
        "--pattern": pattern,
        "--stepover": stepover,
        "--pad-diameter": pad_diameter,
        "--region": region,
        "--up": up,
        "--units": units,
        "--lead-in": lead_in,
        "--lead-angle": lead_angle,
        "--tilt-angle": tilt_angle,
        "--contact-force": contact_force,
        "--feed": feed,
    }
    scenario = _with_overlap(build_scenario(Scenario(), given, config, set_ or []), stepover, overlap)
    prepare_headless()
    # Lazy: --help must not wait for the numerical libraries.
    from polish_sim.analysis.path_plot import plot_plan
    from polish_sim.analysis.report import save_plots
    from polish_sim.exchange import write_plan
    from polish_sim.planning import plan_part

    with claimed(out, "plan", overwrite) as folder, console.progress() as observer:
        result = plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad, observer)
        write_plan(folder.draft, result)
        observer.stage("draw")
        save_plots(folder.draft, {"path.png": plot_plan(result)})
    for note in result.notes:
        console.note(f"note: {note}")
    console.table(f"plan of {result.mesh.name}", ["figure", "unit", "value"], _rows(result.figures))
    console.say(f"folder: {folder.final}")


def _with_overlap(scenario: Scenario, stepover: float | None, overlap: float | None) -> Scenario:
    """Set the step-over that leaves neighbouring turns the overlap asked for."""
    if overlap is None:
        return scenario
    if stepover is not None:
        raise InputError("--overlap and --stepover both set the distance between turns: give one of them.")
    if not 0.0 <= overlap < 100.0:
        raise InputError(f"--overlap {overlap:g} is not a percentage from 0 to below 100.")
    distance = 2.0 * scenario.pad.radius_m * (1.0 - 0.01 * overlap)
    return replace(scenario, plan=replace(scenario.plan, stepover_m=distance))


def _rows(m: Mapping[str, Any]) -> list[list[str]]:
    mm, percent = 1e3, 1e2
    spread = f"{m['stepover_p5_m'] * mm:.2f} to {m['stepover_p95_m'] * mm:.2f}"
    return [
        ["facets", "", str(m["facets"])],
        ["path length", "m", f"{m['path_length_m']:.3f}"],
        ["cycle time at the feed", "s", f"{m['cycle_time_s']:.0f}"],
        ["step-over, mean", "mm", _or_dash(m["stepover_mean_m"], f"{m['stepover_mean_m'] * mm:.2f}")],
        ["step-over, p5 to p95", "mm", _or_dash(m["stepover_mean_m"], spread)],
        ["coverage by the pad", "%", f"{m['coverage'] * percent:.1f}"],
        ["within 0.55 step-overs", "%", f"{m['coverage_stepover'] * percent:.1f}"],
        ["self crossings", "", str(m["self_crossings"])],
        ["retracts", "", str(m["retracts"])],
        ["largest distance to surface", "mm", f"{m['max_distance_to_surface_m'] * mm:.1g}"],
        ["planned in", "s", f"{m['plan_time_s']:.2f}"],
    ]


def _or_dash(value: float, text: str) -> str:
    """The text, or a dash where there is no value: a path without neighbouring turns has no step-over."""
    return "-" if math.isnan(value) else text
