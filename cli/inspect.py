"""`polish-sim inspect`: the quality of any tool path on a part, ours or not.

A finished plan as commands take it: its path, the settings it was made with, the part it was made on.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from polish_sim.cli import console
from polish_sim.cli.options import (
    CONFIG_OPTIONS,
    OUTPUT_OPTIONS,
    Given,
    argument,
    build_scenario,
    named_options,
    takes,
    with_options,
)
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.config import PartConfig, PlanConfig, Scenario
from polish_sim.errors import InputError, named_place, refuse_idle
from polish_sim.experiments.registry import PATH_OPTIONS, REGION_OPTIONS
from polish_sim.row_file import save_plots, write_json
from polish_sim.scenario_file import load_scenario, merge

if TYPE_CHECKING:
    from polish_sim.planning import ToolPath

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
    """Measure a tool path on a part: metrics.json, coverage.ply and a picture.

    A plan of ours is measured with its own settings, on its own part unless --part names it; other paths
    need --part, their step-over is found, and the defaults are theirs. The part is not placed: times keep
    the tool's limits, not the arm's.
    """
    refuse_taken(given, path)
    from polish_sim.analysis.inspect_plot import plot_maps, write_coverage_mesh
    from polish_sim.exchange import plan_facts, read_cuts, read_path
    from polish_sim.experiments.cycle import cycle_strokes, time_figures
    from polish_sim.experiments.stroke_motion import check_stroke_rule
    from polish_sim.planning import inspect_path
    from polish_sim.planning.quality.figures import path_table

    tool_path = read_path(path)
    beside = path.with_name("path.json")
    source = beside if path.name == "path.csv" and beside.exists() else path
    facts = plan_facts(source)
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
    with claimed(given, "inspect") as folder, console.progress() as observer:
        found = inspect_path(tool_path, *scenario.planned_by, observer, read_cuts(source))
        observer.stage("time the motion")
        strokes = cycle_strokes(scenario, tool_path, found.mesh.noise, observer.progress)
        found.figures.update(time_figures(strokes))
        observer.stage("draw")
        write_json(folder.draft / "metrics.json", found.figures | {"notes": found.notes})
        write_coverage_mesh(folder.draft / "coverage.ply", found)
        save_plots(folder.draft, {"coverage.png": plot_maps(found)})
    console.notes(found.notes)
    console.table(path_table(f"{path.name} on {found.mesh.name}", found.figures))
    console.say_folder(folder.final)


def take_plan(source: Path, scenario: Scenario, given: Given) -> tuple[ToolPath, Scenario]:
    """Read a plan folder, path.json, CSV or APT file and make the scenario say what was planned, and on which
    part.

    Raises:
        InputError: If the plan cannot be read, belongs to another part, or is asked to be planned
            differently.
    """
    from polish_sim.exchange import plan_facts, read_path

    named = named_options(given)
    refuse_idle(named, PATH_OPTIONS, "on a finished plan")
    path = read_path(source)
    facts = plan_facts(source)
    file = {"plan": {"file": str(source.resolve()), "begin_m": scenario.plan.begin_m}}
    if not facts:
        return path, merge(scenario, file, "")
    refuse_idle(named, ("--up", "--units"), "on a finished plan")
    elsewhere = named if "--path" in named else {*named, "--part"}
    scenario = with_plan(scenario, source, facts, elsewhere)
    if "--path" not in named:  # the config of a run along the plan, which says all that was run
        scenario = load_scenario(Path(given["--config"]), scenario)
    scenario = with_options(scenario, given)
    check_part(source, scenario.part.file, facts["part"])
    scenario, proof = merge(scenario, file, ""), facts["proof"] or {}
    process = scenario.process
    force, feed = process.contact_force_n != facts["contact_force_n"], process.feed_m_s != facts["feed_m_s"]
    if (force or feed) and facts["plan"].get("removal"):
        raise InputError(
            f"feed and force of the plan '{source}' are those of its removal: plan again for others."
        )
    # Where it was eased or slowed it was for the force and the feed it was proven at.
    if force and proof.get("eased"):
        path = replace(path, force=None)
    if feed and proof.get("slowed"):
        path = replace(path, feed=None)
    return path, scenario


def _planned_file(source: Path, known: Mapping[str, str], how: str, option: str) -> str:
    for file in (Path(known.get("path", "")), source.parent / known["file"]):
        if file.is_file() and _hash(file) == known["sha256"]:
            return str(file)
    raise InputError(
        f"the plan '{source}' was made {how} '{known['file']}', which is gone or has changed: say where it "
        f"is with {option}, or plan again."
    )


def with_plan(base: Scenario, source: Path, facts: Mapping[str, Any], named: Collection[str]) -> Scenario:
    """A scenario with the settings a plan was made with, without the files options name; older plans do not
    say pad, force and fixture.

    Raises:
        InputError: A file is gone or has changed.
        ConfigError: A setting was edited.
    """
    from polish_sim.geometry.orientation import side_name
    from polish_sim.models import part_path, workpiece_names

    made_on = facts["part"]
    part = {"unit": made_on["unit"]}
    if "--part" not in named:
        name = made_on["name"]
        shipped = name in workpiece_names() and _hash(part_path(name)) == made_on["sha256"]
        part["file"] = name if shipped else _planned_file(source, made_on, "on", "--part")
    if facts["fixture"] and "--fixture" not in named:
        part["fixture_file"] = _planned_file(source, facts["fixture"], "with the fixture", "--fixture")
    if facts["proof"]:
        part["pose"] = facts["proof"]["pose"]
    process = {name: facts[name] for name in ("contact_force_n", "feed_m_s") if facts[name]}
    settings = {"plan": facts["plan"], "part": part, "process": process}
    if facts["pad"]:
        part["up"] = side_name(facts["up"])
        settings["pad"] = {**facts["pad"], "choice": "given"}
    with named_place(f"the plan '{source}'"):
        return merge(base, settings, "")


def check_part(
    source: Path, name: str, part: Mapping[str, str], again: str = "Plan again on this part."
) -> None:
    """Refuse a part that is another file than a plan was made on; ``again`` says what to do."""
    from polish_sim.models import part_path

    file = part_path(name)
    if file.is_file() and _hash(file) != part["sha256"]:
        raise InputError(
            f"the plan '{source}' was made on another file than '{name}' (it was '{part['file']}', "
            f"and its content differs). {again}"
        )


def _hash(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
