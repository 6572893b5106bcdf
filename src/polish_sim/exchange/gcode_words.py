"""The words of a G-code file: comments, letters and numbers taken apart (text -> blocks)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from polish_sim.errors import InputError
from polish_sim.exchange.way_points import Unknown

REFUSED: Final[dict[str, str]] = {
    **dict.fromkeys(("G2", "G3"), "an arc"),
    **dict.fromkeys(("G5", "G5.1", "G5.2", "G5.3", "G6.2"), "a spline"),
    **dict.fromkeys(("G28", "G28.1", "G30", "G30.1", "G53"), "a move in the machine's own coordinates"),
    **dict.fromkeys(("G10", "G52", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"), "a moved frame"),
    **dict.fromkeys(("G68", "G68.2", "G51", "G92", "G92.1", "G92.2", "G92.3", "G16"), "a moved frame"),
    **dict.fromkeys(("G73", "G76", "G81", "G82", "G83", "G84", "G85", "G86", "G87", "G88", "G89"), "a canned cycle"),
    **dict.fromkeys(("G33", "G33.1", "G38.2", "G38.3", "G38.4", "G38.5"), "a synchronised or probing move"),
    **dict.fromkeys(("G41", "G41.1", "G42", "G42.1"), "cutter compensation"),
    **dict.fromkeys(("G93", "G95", "G7"), "another way to count feeds or lengths"),
    **dict.fromkeys(("M97", "M98", "M99"), "a subprogram"),
}
"""Words that move the tool in ways straight lines between points do not say."""
IGNORED: Final = frozenset(
    (
        *("G8", "G15", "G17", "G18", "G19", "G40", "G43", "G43.4", "G43.5", "G49", "G50", "G54", "G61", "G61.1", "G64"),
        *("G69", "G80", "G90.1", "G91.1", "G94", "G96", "G97", "G98", "G99"),
        *("M0", "M1", "M3", "M4", "M5", "M6", "M7", "M8", "M9", "M19", "M48", "M49"),
    )
)
"""Words that do not move the tool."""
SILENT: Final = frozenset("NOSTDH")
"""Letters whose number does not move the tool, whatever it is."""
ENDS: Final = frozenset(("M2", "M30"))
KNOWN: Final = "G0, G1, G20, G21, G90, G91, X, Y, Z, the tool axis as I, J, K or A, B, C, and F"

_WORD: Final = re.compile(r"\s+|([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+))(?![=\[#])|(.)")
_COMMENT: Final = re.compile(r"\([^()]*\)")


class Word(NamedTuple):
    """A letter and its number."""

    letter: str
    value: float
    column: int
    """Where it begins in its line, counted from 1."""

    @property
    def name(self) -> str:
        """As people write it: G1, not G01."""
        return f"{self.letter}{self.value:g}"


class Block(NamedTuple):
    """The words of one line."""

    line: int
    words: tuple[Word, ...]


def blocks(file: Path, text: str, unknown: Unknown) -> Iterator[Block]:
    """Take a G-code text apart, up to the end of the program; lines without a word are left out.

    Args:
        file: Where the text is from.
        text: The program; ( ) and ; enclose comments, % lines are marks of the file.
        unknown: Told of characters that begin no word.

    Yields:
        The lines in order.

    Raises:
        InputError: A comment is not closed.
    """
    for number, raw in enumerate(text.splitlines(), start=1):
        code = raw.partition(";")[0]
        if code.lstrip().startswith("%"):
            continue
        if "(" in code or ")" in code:
            code = _without_comments(file, number, code)
        words = tuple(_words(file, number, code, unknown))
        if words:
            yield Block(number, words)
        if any(word.name in ENDS for word in words):
            return


def _without_comments(file: Path, line: int, code: str) -> str:
    """The line with blanks for its comments, so that columns stay."""
    clear = _COMMENT.sub(lambda found: " " * len(found[0]), code)
    loose = re.search(r"[()]", clear)
    if loose is not None:
        raise InputError(
            f"'{file}', line {line}, column {loose.start() + 1}: the comment's bracket '{loose[0]}' has no partner."
        )
    return clear


def _words(file: Path, line: int, code: str, unknown: Unknown) -> Iterator[Word]:
    end = -1
    for found in _WORD.finditer(code):
        letter, number, stray = found.groups()
        if letter:
            yield Word(letter.upper(), float(number), found.start() + 1)
        # Of a row of such characters the first is told.
        if stray and found.start() != end:
            rest = code[found.start() :].split(maxsplit=1)[0]
            unknown(
                InputError(
                    f"'{file}', line {line}, column {found.start() + 1}: '{rest[:20]}' is no word of a letter and a "
                    "number. Parameters and expressions are not read: post-process the path to plain numbers."
                )
            )
        end = found.end() if stray else -1


def refusal(file: Path, line: int, word: Word) -> InputError:
    """Say why a word that moves the tool cannot be read."""
    return InputError(
        f"'{file}', line {line}, column {word.column}: {word.name} ({REFUSED[word.name]}) is not read, and "
        "--lenient does not leave out what moves the tool. Post-process the path to G0 and G1 in one frame."
    )


def unknown_word(file: Path, line: int, word: Word) -> InputError:
    """Say that nobody knows a word."""
    return InputError(f"'{file}', line {line}, column {word.column}: unknown word '{word.name}'. Read are {KNOWN}.")
