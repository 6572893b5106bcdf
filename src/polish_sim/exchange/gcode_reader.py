"""Paths as G-code: G0 and G1 with a tool axis as a vector or as rotary angles (blocks -> WayPoints).

X, Y, Z are the tool's tip in the part's frame (as with G43.4). The tool axis, from the part to the tool, is either
I, J, K, a vector of any length, or Rz(C) Ry(B) Rx(A) z with A, B, C in degrees; without any it is 0, 0, 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from polish_sim.errors import InputError
from polish_sim.exchange.checks import checked_length
from polish_sim.exchange.gcode_words import IGNORED, REFUSED, SILENT, Block, Word, blocks, refusal, unknown_word
from polish_sim.exchange.rapids import feeds_from_first, numbered_strokes, with_retract
from polish_sim.exchange.way_points import Unknown, WayPoints
from polish_sim.planning.toolpath import APPROACH, PROCESS, ToolPath

UNITS: Final[Mapping[str, float]] = {"G20": 0.0254, "G21": 1e-3, "G70": 0.0254, "G71": 1e-3}
LINES, ANGLES, VECTOR = "XYZ", "ABC", "IJK"
PER_MINUTE: Final = 1.0 / 60.0


NO_AXIS: Final = "'{file}' says no tool axis (I, J, K or A, B, C): it is taken to be z of the path's frame everywhere."
"""What such G-code is taken for: that of a machine with three axes."""


@dataclass
class _Machine:
    """What holds while the blocks are gone through."""

    file: Path
    unknown: Unknown
    unit: float = 1e-3
    relative: bool = False
    rapid: bool | None = None
    feed: float = math.nan
    at: dict[str, float] = field(default_factory=lambda: dict.fromkeys(LINES, math.nan) | dict.fromkeys(ANGLES, 0.0))
    vector: tuple[float, float, float] | None = None
    turned: bool = False
    rows: list[tuple[float, ...]] = field(default_factory=list)
    segments: list[int] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)

    def place(self, row: int) -> str:
        """Where a point stands."""
        return f"line {self.lines[row]}, point {row + 1}"

    def error(self, block: Block, word: Word, text: str) -> InputError:
        """An error that names its word's place."""
        return InputError(f"'{self.file}', line {block.line}, column {word.column}: {text}")


def read_gcode(file: Path, text: str, unknown: Unknown) -> WayPoints:
    """Read G-code: G0, G1, G20, G21, G90, G91, F, and the tool axis; mm and absolute unless it says otherwise.

    Raises:
        InputError: A word that moves the tool other than on straight lines, or no points; names line and column.
    """
    machine = _Machine(file, unknown)
    for block in blocks(file, text, unknown):
        _obey(machine, block)
    assumed = "" if machine.turned or machine.vector is not None else NO_AXIS.format(file=file)
    return WayPoints(_path(machine), file, machine.place, assumed)


def _obey(machine: _Machine, block: Block) -> None:
    """Modes first, whatever their place in the line, then the feed, then the move."""
    axes: dict[str, Word] = {}
    feed: Word | None = None
    dwells = False
    for word in block.words:
        if word.letter in "GM":
            dwells |= word.name == "G4"
            _set_mode(machine, block, word)
        elif word.letter in LINES + ANGLES + VECTOR:
            if word.letter in axes:
                raise machine.error(block, word, f"{word.letter} stands twice in the line.")
            axes[word.letter] = word
        elif word.letter == "F":
            feed = word
        elif word.letter not in SILENT and not (word.letter == "P" and _takes_p(block)):
            machine.unknown(unknown_word(machine.file, block.line, word))
    if feed is not None:
        _set_feed(machine, block, feed)
    if axes and not dwells:
        _move(machine, block, axes)


def _takes_p(block: Block) -> bool:
    return any(word.name in ("G4", "G64") for word in block.words)


def _set_mode(machine: _Machine, block: Block, word: Word) -> None:
    name = word.name
    if name in ("G0", "G1"):
        machine.rapid = name == "G0"
    elif name in UNITS:
        machine.unit = UNITS[name]
    elif name in ("G90", "G91"):
        machine.relative = name == "G91"
    elif name in REFUSED:
        raise refusal(machine.file, block.line, word)
    elif name not in IGNORED and name not in ("M2", "M30"):
        machine.unknown(unknown_word(machine.file, block.line, word))


def _set_feed(machine: _Machine, block: Block, word: Word) -> None:
    if word.value <= 0.0:
        raise machine.error(block, word, f"{word.name} is no feed. Wanted: a positive number per minute.")
    machine.feed = word.value * machine.unit * PER_MINUTE


def _move(machine: _Machine, block: Block, axes: Mapping[str, Word]) -> None:
    first = next(iter(axes.values()))
    if machine.rapid is None:
        raise machine.error(block, first, f"{first.name} stands before any G0 or G1: how to move is not said.")
    for letter, word in axes.items():
        if letter in VECTOR:
            continue
        scale = machine.unit if letter in LINES else 1.0
        start = machine.at[letter] if machine.relative else 0.0
        if math.isnan(start):
            raise machine.error(block, word, f"{word.name} is a step (G91) from an unknown place. Begin with G90.")
        machine.at[letter] = start + word.value * scale
    _turn(machine, block, axes)
    x, y, z = (machine.at[letter] for letter in LINES)
    # Where the machine stands at the start nobody knows: the path begins where all three coordinates are said.
    if not math.isnan(x + y + z):
        machine.rows.append((x, y, z, *_axis(machine), machine.feed))
        machine.segments.append(APPROACH if machine.rapid else PROCESS)
        machine.lines.append(block.line)


def _turn(machine: _Machine, block: Block, axes: Mapping[str, Word]) -> None:
    """Take up the tool axis of a line, if it says one."""
    vector = [axes[letter] for letter in VECTOR if letter in axes]
    angles = [axes[letter] for letter in ANGLES if letter in axes]
    machine.turned |= bool(angles)
    if machine.turned and (vector or machine.vector is not None):
        word = (vector or angles)[0]
        raise machine.error(block, word, "the tool axis is said both as I, J, K and as A, B, C: give it in one way.")
    if not vector:
        return
    if len(vector) < 3:
        raise machine.error(block, vector[0], "I, J and K stand together: they are the tool axis, not an arc's centre.")
    length = math.hypot(*(word.value for word in vector))
    if length == 0.0:
        raise machine.error(block, vector[0], "the tool axis I0 J0 K0 has no direction.")
    i, j, k = (word.value / length for word in vector)
    machine.vector = (i, j, k)


def _axis(machine: _Machine) -> tuple[float, float, float]:
    """Unit tool axis, from the part to the tool."""
    if machine.vector is not None:
        return machine.vector
    a, b, c = (math.radians(machine.at[letter]) for letter in ANGLES)
    x, y, z = math.cos(a) * math.sin(b), -math.sin(a), math.cos(a) * math.cos(b)
    return x * math.cos(c) - y * math.sin(c), x * math.sin(c) + y * math.cos(c), z


def _path(machine: _Machine) -> ToolPath:
    if not machine.rows:
        raise InputError(
            f"'{machine.file}' holds no points: no G0 or G1 after which X, Y and Z are all known. "
            "Give G-code as text, with a first line such as G0 X0 Y0 Z50."
        )
    table = np.array(machine.rows, dtype=np.float64)
    segment = np.array(machine.segments, dtype=np.int8)
    if not (segment == PROCESS).any():
        raise InputError(f"'{machine.file}': every move is G0, nothing is done at a feed. Give the path with G1.")
    axes = table[:, 3:6] / np.linalg.norm(table[:, 3:6], axis=1, keepdims=True)
    return ToolPath(
        table[:, :3].copy(),
        axes,
        checked_length(machine.file, table[:, :3], machine.place),
        numbered_strokes(segment),
        with_retract(segment),
        np.zeros(len(table)),
        None,
        feeds_from_first(table[:, 6]),
    )
