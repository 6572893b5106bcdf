"""A finished plan as commands take it: its path, the settings it was made with, the part it was made on."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polish_sim.cli.options import Given, named_options, with_options
from polish_sim.config import Scenario
from polish_sim.errors import InputError, named_place, refuse_idle
from polish_sim.experiments.registry import PATH_OPTIONS
from polish_sim.scenario_file import load_scenario, merge

if TYPE_CHECKING:
    from polish_sim.planning import ToolPath


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
