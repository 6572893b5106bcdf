"""A command of `polish-sim` in a process of its own, and what is wrong with how it ended."""

from __future__ import annotations

import json
import math
import re
import resource
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

PROGRAM = [sys.executable, "-c", "from polish_sim.cli import start; start()"]
LIMIT_S = 900  #: Processor time a command may take
NO_NUMBER = r"\b(nan|inf)\b"


class Call(NamedTuple):
    """A command that has ended."""

    folder: Path  #: Where it has written
    code: int
    text: str
    cpu_s: float

    def said(self, pattern: str) -> list[str]:
        """Its lines that match."""
        lines = (line.strip() for line in self.text.splitlines())
        return [line for line in lines if re.search(pattern, line)]

    @property
    def figures(self) -> dict[str, Any]:
        """Its metrics; empty where it has written none."""
        file = self.folder / "metrics.json"
        return dict(json.loads(file.read_text())) if file.is_file() else {}

    def faults(self, codes: Sequence[int] = (0,)) -> Iterator[str]:
        """What is wrong with any command, but for the exit ``codes`` it may end with."""
        of = self.folder.name
        if "Traceback" in self.text or self.code not in codes:
            yield f"{of}: exit {self.code} after {self.cpu_s:.0f} s: {' '.join(self.text.split())[-300:]}"
        yield from (f"{of}: no number: {line}" for line in self.said(NO_NUMBER))
        yield from (f"{of}: no number: {name}" for name in _not_finite(self.figures))
        yield from (f"{of}: {text}" for text in _contradictions(self.figures))


def call(folder: Path, *words: object) -> Call:
    """Run a command, which writes into ``folder``."""
    if folder.is_dir():  # of an earlier try
        (folder / "metrics.json").unlink(missing_ok=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [*PROGRAM, *map(str, words), "--out", str(folder), "--overwrite"],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_S, LIMIT_S + 30)),
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    folder.with_suffix(".txt").write_text(f"{' '.join(map(str, words))}\n{done.stdout}{done.stderr}")
    return Call(folder, done.returncode, done.stdout + done.stderr, cpu_s)


def _not_finite(value: Any, name: str = "") -> Iterator[str]:
    """Names of the figures that are NaN or infinite."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _not_finite(part, f"{name}.{key}")
    elif isinstance(value, list):
        for number, part in enumerate(value):
            yield from _not_finite(part, f"{name}[{number}]")
    elif isinstance(value, float) and not math.isfinite(value):
        yield name


def _contradictions(figures: Mapping[str, Any]) -> Iterator[str]:
    """Areas that do not add up, and shares that are none."""
    for name in ("coverage", "coverage_stepover", "path_done"):
        if not -1e-9 <= (figures.get(name) or 0.0) <= 1.0 + 1e-9:
            yield f"{name} is {figures[name]}"
    if "left_out_area_m2" not in figures:
        return
    region, polished, left = (figures[f"{name}_area_m2"] for name in ("region", "polished", "left_out"))
    reasons = sum(figures["left_out"].values())
    if abs(polished + left - region) > 1e-3 * region or abs(reasons - left) > 1e-3 * region:
        yield f"areas: {polished:.6g} polished, {left:.6g} left out ({reasons:.6g}) of {region:.6g} m^2"
