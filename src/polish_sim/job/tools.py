"""The tool library: what turns on the arm's end, as settings of the scenario (tools.toml -> Tool -> table);
and the line of a tool's or a job's file that an error is about."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from polish_sim.config import FlangeConfig
from polish_sim.config.key import key
from polish_sim.errors import ConfigError, PolishSimError, check_name, number_text
from polish_sim.experiments.registry import POSITION
from polish_sim.scenario_file import merge
from polish_sim.toml_text import read_toml


@contextmanager
def naming_line(file: Path) -> Iterator[None]:
    """Put a file's name and the line before the errors of the block that have none yet."""
    try:
        yield
    except PolishSimError as error:
        if re.search(r"line \d+[,:)]", str(error)):
            raise
        text = file.read_text(encoding="utf-8", errors="replace")
        raise type(error)(f"{file}, line {line_of(str(error), text)}: {error}") from error


def line_of(message: str, text: str) -> int:
    """Where the key or word stands that a message names first; without one, where the table it names
    begins."""
    lines = [line.partition("#")[0] for line in text.splitlines()]
    place = re.search(r"setup[ _](\d+)(?:.{1,12}?pass[ _](\d+))?", message)
    begin = 0
    for head, count in zip(("[[setup]]", "[[setup.pass]]"), place.groups() if place else (), strict=False):
        heads = [number for number, line in enumerate(lines) if number >= begin and line.strip() == head]
        if count and len(heads) >= int(count):
            begin = heads[int(count) - 1]
    for word in re.findall(r"'([^']+)'", message) + re.findall(r"[a-z_]+\.[a-z_0-9]+", message):
        *table, name = re.split(r"[.:] ?", word)
        start = next(
            (number for number, line in enumerate(lines) if line.strip() == f"[{'.'.join(table)}]"), begin
        )
        value = re.escape(Path(word).name)
        known = rf"(^|[\s{{.\[]){re.escape(name)}\s*[=\].]|[\"']([^\"']*[/:])?{value}[\"']"
        order = (*range(start, len(lines)), *range(start))
        found = next((number for number in order if re.search(known, lines[number])), None)
        if found is not None:
            return found + 1
    return begin + 1


SHIPPED = Path(__file__).with_name("tools.toml")
SPINDLE, ORBITAL, BELT = "spindle", "orbital", "belt"
KINDS = (SPINDLE, ORBITAL, BELT)


@dataclass(frozen=True)
class JobTool:
    """A tool."""

    kind: str = key(
        SPINDLE, "spindle: the pad turns; orbital: it runs on a small orbit; belt: its cover slides"
    )
    text: str = key("", "what it is")
    radius_m: float = key(0.025, "radius of its face [m]", 0.001, 0.2)
    stiffness_n_m: float = key(20000.0, "stiffness of the whole face pressed flat [N/m]", 100.0, 1e7)
    head_stiffness_n_m: float = key(20000.0 / 3.0, "spring behind it [N/m]", 100.0, 1e6)
    moved_kg: float = key(
        0.3, "mass behind which that spring is, which the sensor carries too [kg]", 0.01, 10.0
    )
    head_travel_m: float = key(0.03, "travel of that spring, or stroke of the flange [m]", 0.001, 0.2)
    flange: FlangeConfig = FlangeConfig()
    speed_rpm: float = key(6000.0, "speed of spindle or orbit [1/min]", 0.0, 60000.0)
    speed_most_rpm: float = key(15000.0, "largest speed allowed [1/min]", 0.0, 60000.0)
    orbit_m: float = key(0.0, "radius of the orbit [m]", 0.0, 0.02)
    belt_m_s: float = key(0.0, "speed of the belt [m/s]", 0.0, 50.0)
    force_least_n: float = key(1.0, "least force allowed [N]", 0.5, 200.0)
    force_most_n: float = key(50.0, "largest force allowed [N]", 0.5, 200.0)
    wear_nm: float = key(
        0.0,
        "sliding work, pressure x way over area, after which it takes off half as much; 0 = no wear [N m]",
        0.0,
        1e15,
    )

    @property
    def slide_m_s(self) -> float:
        """Speed at which all of the face slides, beside the turning [m/s]: |v| averaged over the orbit."""
        return {SPINDLE: 0.0, ORBITAL: self.orbit_m * self.speed_rpm * math.tau / 60.0, BELT: self.belt_m_s}[
            self.kind
        ]

    def settings(self) -> dict[str, Any]:
        """The tool as a table of the scenario.

        A quick orbit leaves hardly any friction along the feed: Coulomb's law is smoothed over the sliding
        speed.
        """
        slide = self.slide_m_s
        pad = {"radius_m": self.radius_m, "stiffness_n_m": self.stiffness_n_m, "slide_m_s": slide}
        if slide > 0.0:
            pad["friction_smoothing_m_s"] = slide
        head = {
            "stiffness_n_m": self.head_stiffness_n_m,
            "mass_kg": self.moved_kg,
            "travel_m": self.head_travel_m,
            "flange": asdict(self.flange),
        }
        return ({"controller": {"name": POSITION}} if self.flange.bandwidth_hz else {}) | {
            "pad": pad,
            "head": head,
            "spindle": {"speed_rpm": self.speed_rpm if self.kind == SPINDLE else 0.0},
        }

    def left(self, work: float) -> float:
        """Share of its removal that is left after sliding ``work`` [N m]."""
        return float(0.5 ** (work / self.wear_nm)) if self.wear_nm > 0.0 else 1.0

    def check_force(self, name: str, force: float) -> None:
        """Refuse a force the tool does not bear.

        Raises:
            ConfigError: It is outside its range.
        """
        if not self.force_least_n <= force <= self.force_most_n:
            raise ConfigError(
                f"'contact_force_n' of {number_text(force)} N is outside {number_text(self.force_least_n)} "
                f"to {number_text(self.force_most_n)} N, which '{name}' allows."
            )


def read_tools(file: Path | None = None) -> Mapping[str, JobTool]:
    """The shipped tools by name, and those of a file.

    Raises:
        ConfigError: A key or value is wrong; names tool and key.
    """
    return _tools(SHIPPED) | (_tools(file) if file else {})


def choose_tool(words: str) -> JobTool:
    """A tool by its name, ``NAME`` or ``FILE.toml:NAME``.

    Raises:
        ConfigError: There is no such tool.
    """
    file, _, name = words.rpartition(":")
    tools = read_tools(Path(file) if file else None)
    check_name("tool", name, tools)
    return tools[name]


def _tools(file: Path) -> dict[str, JobTool]:
    tools = {}
    tables = read_toml(file, "tool file", ConfigError)
    with naming_line(file):
        for name, table in tables.items():
            if not isinstance(table, dict):
                raise ConfigError(f"'{name}' is no tool: write [{name}] and its keys below.")
            tool = merge(JobTool(), table, f"{name}.")
            check_name(f"kind of the tool '{name}'", tool.kind, KINDS)
            if tool.kind != SPINDLE and tool.slide_m_s == 0.0:
                raise ConfigError(
                    f"the tool '{name}' does not slide: set '{name}.orbit_m' and speed_rpm, or belt_m_s."
                )
            if tool.speed_rpm > tool.speed_most_rpm:
                raise ConfigError(f"'{name}.speed_rpm' is above its speed_most_rpm.")
            tools[name] = tool
    return tools
