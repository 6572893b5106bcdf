"""A job's file: setups x regions x passes (JOB.toml -> Job). Keys inside a pass are those of
`polish-sim config`."""

from __future__ import annotations

import hashlib
import os
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from polish_sim.config import Checked, PartConfig, Scenario
from polish_sim.config.key import key
from polish_sim.errors import ConfigError, check_name, named_place
from polish_sim.experiments.assembly import check
from polish_sim.experiments.registry import default_scenario
from polish_sim.geometry import fit_surface, load_part, select_region
from polish_sim.job.tools import JobTool, naming_line, read_tools
from polish_sim.models import part_path
from polish_sim.planning.feasibility import widest_piece
from polish_sim.scenario_file import leaves, merge, region_with_file, with_files
from polish_sim.toml_text import read_toml, toml_value

T = TypeVar("T")
SECTIONS = ("plan", "process", "smoothing", "safety", "controller")
"""Sections of the scenario that a pass may set; `[cell]` may set any."""
KEYS_OF_JOB = {
    "part.file": "part",
    "part.fixture_file": "fixture",
    "part.up": "up",
    "plan.region": "regions",
    "seed": "seed",
}
"""Keys of the scenario that the job sets by keys of its own."""


@dataclass(frozen=True)
class JobHead:
    """The job as a whole."""

    part: str = key("freeform", "mesh of the part, or a shipped part")
    fixture: str = key("", "mesh of what holds it; empty = none")
    tools: str = key("", "file of your own tools; empty = the shipped ones")
    parts: int = key(1, "parts of the batch, each displaced as its seed draws it", 1, 1000)
    seed: int = key(0, "of the first part", 0, 2**31)


@dataclass(frozen=True)
class SetupHead:
    """One clamping."""

    name: str = key("", "its name, for the operator")
    up: str = key("auto", "side turned up")
    clamp_s: float = key(60.0, "time to clamp the part, or to turn it [s]", 0.0, 1e5)


@dataclass(frozen=True)
class PassHead:
    """One pass over each region of its setup."""

    tool: str = key("spindle-pad", "of the tool library, see 'polish-sim list tools'")
    grit: int = key(0, "grit of the abrasive, 0 = unknown; for the operator", 0, 10000)
    change_s: float = key(30.0, "time to mount tool and abrasive, where they change [s]", 0.0, 1e5)
    edge_force: float = key(
        1.0, "share of the force at the region's border, rising to 1 over edge_m [-]", 0.1, 1.0
    )
    edge_m: float = key(0.01, "see edge_force [m]", 0.001, 0.2)


@dataclass(frozen=True)
class Zone:
    """Part of a region with a force and a feed of its own."""

    region: str = key("", "as plan.region: box:..., polygon:... or faces:FILE")
    force: float = key(1.0, "times the pass's force [-]", 0.05, 5.0)
    feed: float = key(1.0, "times the pass's feed [-]", 0.05, 5.0)


class Pass(NamedTuple):
    """One pass over one region, ready to be planned."""

    setup: int  #: From 1
    region: int
    number: int
    setup_head: SetupHead
    head: PassHead
    tool: JobTool
    zones: tuple[Zone, ...]
    scenario: Checked

    @property
    def folder(self) -> str:
        """Below the job's folder."""
        return f"setup_{self.setup}/region_{self.region}/pass_{self.number}"

    @property
    def abrasive(self) -> tuple[str, int]:
        """What is mounted for it: tool and grit."""
        return self.head.tool, self.head.grit


class Job(NamedTuple):
    """All passes in order."""

    file: Path
    head: JobHead
    passes: tuple[Pass, ...]
    sha256: str  #: Of the file


def read_job(file: Path) -> Job:
    """Read and check a job's file; nothing is planned or written.

    Raises:
        PolishSimError: A key or value is wrong; names it and its line.
    """
    table = read_toml(file, "job file", ConfigError)
    with naming_line(file):
        setups = table.pop("setup", [])
        cell = table.pop("cell", {})
        if not (isinstance(setups, list) and setups):
            raise ConfigError("a job has at least one [[setup]].")
        if not isinstance(cell, dict):
            raise ConfigError("'cell' is a section: write [cell.robot] and its keys below.")
        head = merge(JobHead(), table, "")
        tools = read_tools(file.parent / head.tools if head.tools else None)
        _refuse_keys_of_job(cell)
        base = merge(default_scenario("surface"), cell, "cell.")
        base = merge(base, {"part": {"file": head.part, "fixture_file": head.fixture}}, "")
        passes = tuple(_passes(base, setups, tools, file))
    return Job(file, head, passes, hashlib.sha256(file.read_bytes()).hexdigest())


def _passes(base: Scenario, setups: list[Any], tools: Mapping[str, JobTool], file: Path) -> Iterator[Pass]:
    for s, setup in enumerate(setups, 1):
        with named_place(f"setup {s}"):
            found, inner = _split(setup, SetupHead(), ("regions", "pass", "pose"))
            regions = inner.get("regions", ["auto"])
            passes = inner.get("pass", [])
            if not (
                isinstance(regions, list) and regions and all(isinstance(region, str) for region in regions)
            ):
                raise ConfigError("'regions' must be a list of regions, e.g. [\"auto\"].")
            if not (isinstance(passes, list) and passes):
                raise ConfigError("it has no [[setup.pass]].")
            part = {"up": found.up, **({"pose": inner["pose"]} if "pose" in inner else {})}
            clamped = merge(base, {"part": part}, "")
        for r, region in enumerate(regions, 1):
            for p, asked in enumerate(passes, 1):
                with named_place(f"setup {s}, pass {p}"):
                    one = _pass(clamped, (s, r, p), found, region, asked, tools, file.parent)
                yield one


def _pass(
    base: Scenario,
    number: tuple[int, int, int],
    setup: SetupHead,
    region: str,
    asked: Any,
    tools: Mapping[str, JobTool],
    folder: Path,
) -> Pass:
    head, inner = _split(asked, PassHead(), ("zone", *SECTIONS))
    check_name("tool", head.tool, tools)
    tool = tools[head.tool]
    zones = inner.pop("zone", [])
    _refuse_keys_of_job(inner)
    scenario = merge(merge(base, tool.settings(), "tool."), inner, "")
    scenario = with_files(merge(scenario, {"plan": {"region": region}}, ""), folder)
    if not isinstance(zones, list):
        raise ConfigError("'zone' is a list: write [[setup.pass.zone]].")
    tool.check_force(head.tool, scenario.process.contact_force_n)
    read = (_split(zone, Zone(), ())[0] for zone in zones)
    placed = (replace(zone, region=region_with_file(zone.region, folder)) for zone in read)
    return Pass(*number, setup, head, tool, tuple(placed), check(scenario))


def _split(table: Any, default: T, inner: tuple[str, ...]) -> tuple[T, dict[str, Any]]:
    """A table's own keys, checked, and those of its ``inner`` tables."""
    if not isinstance(table, dict):
        raise ConfigError("it is no table of keys.")
    own = {name: value for name, value in table.items() if name not in inner}
    for name in own:
        check_name("key", name, (*vars(default), *inner))
    return merge(default, own, ""), {k: table[k] for k in inner if k in table}  # type: ignore[type-var]


def _refuse_keys_of_job(table: Mapping[str, Any]) -> None:
    """Refuse keys that would be overwritten (ConfigError)."""
    for name, _ in leaves(table):
        if name in KEYS_OF_JOB:
            raise ConfigError(f"'{name}' is '{KEYS_OF_JOB[name]}' in a job: set that instead.")


def begin_job(part: PartConfig, file: Path) -> str:
    """The text of a job's ``file`` for a part, to begin with; it names the part from its own folder.

    Its pad is the first of the shipped tools that is no wider than the largest smooth face, else the smallest
    one; lines run along two axes across the side turned up.
    """
    mesh = load_part(part_path(part.file), part.unit)
    width = widest_piece(select_region(fit_surface(mesh), mesh))
    shipped = read_tools()
    fitting = (name for name, row in shipped.items() if 2.0 * row.radius_m <= width)
    tool = next(fitting, "spindle-pad-12")
    stepover = 0.32 * shipped[tool].radius_m  # 8 mm for 50 mm, as plans have it
    named = os.path.relpath(part.file, file.parent) if Path(part.file).is_file() else part.file
    along, across = np.delete(np.eye(3), np.abs(mesh.up).argmax(), axis=0).tolist()
    return f"""\
# A job: setups x regions x passes. Run it: polish-sim job {shlex.quote(str(file))}
part = {toml_value(named)}
parts = 1  # of the batch

[cell]
# Any key of `polish-sim config surface`; SI units.
part.unit = "{mesh.unit}"
robot.arm = "ur5e"

[[setup]]
name = "as it stands"
up = "auto"
clamp_s = 60.0
regions = ["auto"]  # or box:..., polygon:..., faces:FILE, as --region

[[setup.pass]]
tool = "{tool}"  # polish-sim list tools
grit = 120
plan.pattern = "raster"
plan.raster_direction = {along}
plan.stepover_m = {stepover:.4g}
process.contact_force_n = 20.0
process.feed_m_s = 0.01

[[setup.pass]]
tool = "{tool}"
grit = 240
plan.pattern = "raster"  # across the first pass
plan.raster_direction = {across}
plan.stepover_m = {stepover:.4g}
process.contact_force_n = 15.0
process.feed_m_s = 0.015
# edge_force = 0.7    # less force near edges
# plan.removal = "even"
# [[setup.pass.zone]]
# region = "box:0,0,0,50,50,50"
# force = 0.5
# feed = 1.0
"""
