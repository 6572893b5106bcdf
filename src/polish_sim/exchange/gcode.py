"""Paths as G-code: G0 and G1 with a tool axis as a vector or as rotary angles (blocks -> WayPoints).

X, Y, Z are the tool's tip in the part's frame (as with G43.4). The tool axis, from the part to the tool, is
either I, J, K, a vector of any length, or Rz(C) Ry(B) Rx(A) z with A, B, C in degrees; without any it is 0,
0, 1.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from polish_sim.errors import InputError
from polish_sim.exchange.way_points import CamPoints, Unknown, WayPoints, refuse_unknown
from polish_sim.planning.toolpath import APPROACH, PROCESS

# The words of a G-code file: comments, letters and numbers taken apart (text -> blocks).

WORDS: Mapping[str, str] = {
    word: what
    for what, words in {
        "": "G8 G15 G17 G18 G19 G40 G43 G43.4 G43.5 G49 G50 G54 G61 G61.1 G64 G69 G80 G90.1 G91.1 G94 G96 "
        "G97 G98 G99 M0 M1 M2 M3 M4 M5 M6 M7 M8 M9 M19 M30 M48 M49",
        "an arc": "G2 G3",
        "a spline": "G5 G5.1 G5.2 G5.3 G6.2",
        "a move in the machine's own coordinates": "G28 G28.1 G30 G30.1 G53",
        "a moved frame": "G10 G16 G51 G52 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3 G68 G68.2 "
        "G92 G92.1 G92.2 G92.3",
        "a canned cycle": "G73 G76 G81 G82 G83 G84 G85 G86 G87 G88 G89",
        "a synchronised or probing move": "G33 G33.1 G38.2 G38.3 G38.4 G38.5",
        "cutter compensation": "G41 G41.1 G42 G42.1",
        "another way to count feeds or lengths": "G93 G95 G7",
        "a subprogram": "M97 M98 M99",
    }.items()
    for word in words.split()
}
"""Words that are not read: those that move the tool in ways straight lines between points do not say, and
how; the others do not move it."""
SILENT = frozenset("NOSTDH")  #: Letters whose number does not move the tool, whatever it is
ENDS = frozenset(("M2", "M30"))
KNOWN = "G0, G1, G20, G21, G90, G91, X, Y, Z, the tool axis as I, J, K or A, B, C, and F"

#: A blank, a comment, a letter and its number, or anything else
_WORD = re.compile(r"\s+|;.*|\([^()]*\)|([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+))(?![=\[#])|(.)")


class Word(NamedTuple):
    """A letter and its number."""

    letter: str
    value: float
    line: int
    column: int  #: Where it begins in its line, counted from 1

    @property
    def name(self) -> str:
        """As people write it: G1, not G01."""
        return f"{self.letter}{self.value:g}"


def blocks(file: Path, text: str, unknown: Unknown) -> Iterator[tuple[Word, ...]]:
    """Take a G-code text apart, line by line up to the end of the program; lines without a word are left out.

    ( ) and ; enclose comments, % lines are marks of the file; ``unknown`` is called with characters that
    begin no word. Raises InputError if a comment is not closed.
    """
    for number, raw in enumerate(text.splitlines(), start=1):
        if raw.lstrip().startswith("%"):
            continue
        words = tuple(_words(file, number, raw, unknown))
        if words:
            yield words
        if any(word.name in ENDS for word in words):
            return


def _words(file: Path, line: int, code: str, unknown: Unknown) -> Iterator[Word]:
    end = -1
    for found in _WORD.finditer(code):
        letter, number, stray = found.groups()
        if stray and stray in "()":
            raise InputError(
                f"'{file}', line {line}, column {found.start() + 1}: the comment's bracket '{stray}' has no "
                "partner."
            )
        if letter:
            yield Word(letter.upper(), float(number), line, found.start() + 1)
        # Of consecutive such characters the first is reported.
        if stray and found.start() != end:
            rest = code[found.start() :].split(maxsplit=1)[0]
            unknown(
                InputError(
                    f"'{file}', line {line}, column {found.start() + 1}: '{rest[:20]}' is no word of a "
                    "letter and a number. Parameters and expressions are not read: post-process the path to "
                    "plain numbers."
                )
            )
        end = found.end() if stray else -1


UNITS: Mapping[str, float] = {"G20": 0.0254, "G21": 1e-3, "G70": 0.0254, "G71": 1e-3}
LINES, ANGLES, VECTOR = "XYZ", "ABC", "IJK"
PER_MINUTE = 1.0 / 60.0


NO_AXIS = (
    "'{file}' says no tool axis (I, J, K or A, B, C): it is taken to be z of the path's frame everywhere."
)
"""What such G-code is taken for: that of a machine with three axes."""


@dataclass
class _Machine(CamPoints):
    """What holds while the blocks are gone through."""

    unknown: Unknown = refuse_unknown
    unit: float = 1e-3
    relative: bool = False
    rapid: bool | None = None
    feed: float = math.nan
    at: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(LINES, math.nan) | dict.fromkeys(ANGLES, 0.0)
    )
    vector: tuple[float, float, float] | None = None
    turned: bool = False

    def error(self, word: Word, text: str) -> InputError:
        """An error that names its word's place."""
        return InputError(f"'{self.file}', line {word.line}, column {word.column}: {text}")

    def take_unknown(self, word: Word) -> None:
        """Refuse or note an unknown word."""
        self.unknown(self.error(word, f"unknown word '{word.name}'. Read are {KNOWN}."))


def read_gcode(file: Path, text: str, unknown: Unknown) -> WayPoints:
    """Read G-code: G0, G1, G20, G21, G90, G91, F, and the tool axis; mm and absolute unless it says
    otherwise.

    Raises InputError, naming line and column, for a word that moves the tool other than on straight lines, or
    no points.
    """
    machine = _Machine(file, unknown=unknown)
    for block in blocks(file, text, unknown):
        _obey(machine, block)
    assumed = "" if machine.turned or machine.vector is not None else NO_AXIS.format(file=file)
    path = machine.path(
        "no G0 or G1 after which X, Y and Z are all known. "
        "Give G-code as text, with a first line such as G0 X0 Y0 Z50.",
        "move is G0, nothing is done at a feed. Give the path with G1.",
    )
    return WayPoints(path, file, machine.place, assumed)


def _obey(machine: _Machine, block: Sequence[Word]) -> None:
    """Modes first, whatever their place in the line, then the feed, then the move."""
    axes: dict[str, Word] = {}
    feed: Word | None = None
    dwells = False
    takes_p = any(word.name in ("G4", "G64") for word in block)
    for word in block:
        if word.letter in "GM":
            dwells |= word.name == "G4"
            _set_mode(machine, word)
        elif word.letter in LINES + ANGLES + VECTOR:
            if word.letter in axes:
                raise machine.error(word, f"{word.letter} stands twice in the line.")
            axes[word.letter] = word
        elif word.letter == "F":
            feed = word
        elif word.letter not in SILENT and not (word.letter == "P" and takes_p):
            machine.take_unknown(word)
    if feed is not None:
        _set_feed(machine, feed)
    if axes and not dwells:
        _move(machine, axes)


def _set_mode(machine: _Machine, word: Word) -> None:
    name = word.name
    if name in ("G0", "G1"):
        machine.rapid = name == "G0"
    elif name in UNITS:
        machine.unit = UNITS[name]
    elif name in ("G90", "G91"):
        machine.relative = name == "G91"
    elif WORDS.get(name):
        raise machine.error(
            word,
            f"{name} ({WORDS[name]}) is not read, and --lenient does not leave out what moves the tool. "
            "Post-process the path to G0 and G1 in one frame.",
        )
    elif name not in WORDS:
        machine.take_unknown(word)


def _set_feed(machine: _Machine, word: Word) -> None:
    if word.value <= 0.0:
        raise machine.error(word, f"{word.name} is no feed. Wanted: a positive number per minute.")
    machine.feed = word.value * machine.unit * PER_MINUTE


def _move(machine: _Machine, axes: Mapping[str, Word]) -> None:
    first = next(iter(axes.values()))
    if machine.rapid is None:
        raise machine.error(first, f"{first.name} stands before any G0 or G1: how to move is not said.")
    for letter, word in axes.items():
        if letter in VECTOR:
            continue
        scale = machine.unit if letter in LINES else 1.0
        start = machine.at[letter] if machine.relative else 0.0
        if math.isnan(start):
            raise machine.error(word, f"{word.name} is a step (G91) from an unknown place. Begin with G90.")
        machine.at[letter] = start + word.value * scale
    _turn(machine, axes)
    x, y, z = (machine.at[letter] for letter in LINES)
    # The machine's start position is unknown: the path begins where all three coordinates are given.
    if not math.isnan(x + y + z):
        segment = APPROACH if machine.rapid else PROCESS
        machine.add(first.line, segment, x, y, z, *_axis(machine), machine.feed, math.nan, math.nan)


def _turn(machine: _Machine, axes: Mapping[str, Word]) -> None:
    """Take up the tool axis of a line, if it says one."""
    vector = [axes[letter] for letter in VECTOR if letter in axes]
    angles = [axes[letter] for letter in ANGLES if letter in axes]
    machine.turned |= bool(angles)
    if machine.turned and (vector or machine.vector is not None):
        word = (vector or angles)[0]
        raise machine.error(word, "the tool axis is said both as I, J, K and as A, B, C: give it in one way.")
    if not vector:
        return
    if len(vector) < 3:
        raise machine.error(
            vector[0], "I, J and K stand together: they are the tool axis, not an arc's centre."
        )
    length = math.hypot(*(word.value for word in vector))
    if length == 0.0:
        raise machine.error(vector[0], "the tool axis I0 J0 K0 has no direction.")
    i, j, k = (word.value / length for word in vector)
    machine.vector = (i, j, k)


def _axis(machine: _Machine) -> tuple[float, float, float]:
    """Unit tool axis, from the part to the tool."""
    if machine.vector is not None:
        return machine.vector
    a, b, c = (math.radians(machine.at[letter]) for letter in ANGLES)
    x, y, z = math.cos(a) * math.sin(b), -math.sin(a), math.cos(a) * math.cos(b)
    return x * math.cos(c) - y * math.sin(c), x * math.sin(c) + y * math.cos(c), z
