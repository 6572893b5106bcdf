"""`run surface --path`, `run dual --path`: a finished plan, and the part it was made on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from polish_sim import exchange
from polish_sim.errors import InputError
from polish_sim.experiments.part_setup import part_file
from polish_sim.experiments.registry import PATH_OPTIONS, experiment
from polish_sim.models import workpiece_names
from polish_sim.scenario_file import merge

if TYPE_CHECKING:
    from polish_sim.config import Scenario
    from polish_sim.planning import ToolPath


class GivenPlan(NamedTuple):
    """A path read from disk and the scenario it belongs to."""

    path: ToolPath
    scenario: Scenario


def take_plan(source: Path, scenario: Scenario, given: Mapping[str, Any]) -> GivenPlan:
    """Read a plan and make the scenario say what was planned, and on which part.

    Args:
        source: Plan folder, path.json, CSV or APT file.
        scenario: What is to be run.
        given: Options of the command line by name; None = not given.

    Returns:
        The path and the scenario.

    Raises:
        InputError: If the plan cannot be read, belongs to another part, or is asked to be planned differently.
    """
    if not experiment(scenario.experiment).along_plan:
        raise InputError(
            f"--path is for 'run surface', 'dual' and 'smooth': '{scenario.experiment}' has no path to be given."
        )
    asked = [option for option in PATH_OPTIONS if given.get(option) is not None]
    if asked:
        raise InputError(f"--path is a finished plan: leave {', '.join(asked)} out, or leave --path out to plan anew.")
    path = exchange.read_path(source)
    facts = plan_facts(source)
    named = {"plan": {"file": str(source.resolve())}}
    if not facts:
        return GivenPlan(path, merge(scenario, named, ""))
    part = facts["part"]
    chosen = given.get("--part") is not None or scenario.plan.file != ""
    if not chosen and part["name"] in workpiece_names():
        scenario = merge(scenario, {"part": {"file": part["name"]}}, "")
    elif not chosen:
        raise InputError(f"the plan '{source}' was made on '{part['file']}': say where it is with --part.")
    check_part(source, scenario.part.file, part)
    scenario = merge(scenario, {"plan": facts["plan"], "part": {"unit": part["unit"]}}, "")
    return GivenPlan(path, merge(scenario, named, ""))


def name_path(source: Path, scenario: Scenario) -> Scenario:
    """Write into a scenario where its path is."""
    return merge(scenario, {"plan": {"file": str(source.resolve())}}, "")


def plan_facts(source: Path) -> dict[str, Any]:
    """What a path.json says beside its path; empty for other files."""
    file = source / "path.json" if source.is_dir() else source
    if file.suffix.lower() != ".json":
        return {}
    document = json.loads(file.read_text(encoding="utf-8"))
    if not {"part", "plan"} <= set(document):
        raise InputError(f"'{file}' does not say its part and plan. Give a path.json made by 'plan', or a CSV.")
    return {"part": document["part"], "plan": document["plan"], "up": document.get("up")}


def check_part(source: Path, name: str, part: Mapping[str, str]) -> None:
    """Refuse a part that is another file than a plan was made on."""
    file = part_file(name)
    if file.is_file() and hashlib.sha256(file.read_bytes()).hexdigest() != part["sha256"]:
        raise InputError(
            f"the plan '{source}' was made on another file than '{name}' (it was '{part['file']}', "
            "and its content differs). Plan again on this part."
        )
