"""The statements of an APT/CLDATA file: comments, continuations and words taken apart (text -> statements)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from polish_sim.errors import InputError

FREE_TEXT: Final = ("PARTNO", "PPRINT", "REMARK", "INSERT", "TPRINT", "DISPLY", "LETTER")
"""Words whose rest of the line is prose."""
IGNORED: Final = frozenset(
    (
        *FREE_TEXT,
        *("MACHIN", "CUTTER", "TOOLNO", "LOADTL", "LOAD", "SELECT", "TOOL", "COOLNT", "SPINDL", "AUTOPS", "CUTCOM"),
        *("INTOL", "OUTTOL", "TOLER", "CLEARP", "CLRSRF", "PPFUN", "SEQNO", "OPNAME", "STOP", "OPSTOP", "REWIND"),
        *("END", "FINI", "NOPOST", "CLPRNT", "DELAY", "DWELL", "OPSKIP", "AIR", "PAINT", "TLDATA", "HEAD", "MODE"),
        *("END-OF-PATH", "OUTPUT", "PPLOFF", "PPLON"),
    )
)
"""Words that do not move the tool."""
REFUSED: Final[dict[str, str]] = {
    **dict.fromkeys(("CIRCLE", "ARC", "MOVARC", "CYLNDR", "CIRCUL", "ARCSLP"), "arcs"),
    **dict.fromkeys(("CYCLE", "GOHOME", "RETRCT", "GODLTA"), "canned and relative motions"),
    **dict.fromkeys(("NURBS", "SPLINE", "BSPLIN"), "splines"),
    **dict.fromkeys(("INDIRV", "INDIRP", "TLON", "TLLFT", "TLRGT", "PSIS", "GO"), "motions along surfaces"),
    **dict.fromkeys(("GOFWD", "GOBACK", "GOLFT", "GORGT", "GOUP", "GODOWN"), "motions along surfaces"),
    **dict.fromkeys(("ORIGIN", "TRANS", "ROTATE", "ROTABL", "MSYS", "COPY", "MATRIX", "REFSYS"), "moved frames"),
    **dict.fromkeys(("MACRO", "CALL", "LOOPST", "LOOPND", "TERMAC", "POINT", "LINE", "PLANE", "PATERN"), "programs"),
}
"""Words that move the tool in ways a list of points does not say."""
KNOWN: Final = ("GOTO", "FROM", "FEDRAT", "RAPID", "UNITS", "MULTAX", "TLAXIS")


class Statement(NamedTuple):
    """One statement: its word in capitals, the text of its arguments, the line it begins in."""

    word: str
    arguments: tuple[str, ...]
    line: int
    comment: str
    """Text after $$ where the statement is a comment alone; word is empty then."""


def statements(file: Path, text: str) -> Iterator[Statement]:
    """Take an APT text apart; $$ begins a comment, a single $ continues a statement, but never prose.

    Raises:
        InputError: The last line asks to be continued.
    """
    pending, begin, remarked = "", 0, False
    for number, raw in enumerate(text.splitlines(), start=1):
        code, _, comment = raw.partition("$$")
        # Creo writes frames as remarks ("$$->") that go on over lines; they are remarks all the way.
        remarked, swallowed = raw.rstrip().endswith("$") and (remarked or comment.startswith("->")), remarked
        if swallowed:
            continue
        # Columns 73-80 of a punched card hold a label; CAM systems still print it after the $.
        head, dollar, _ = code.partition("$")
        begin = begin if pending else number
        pending += head.strip()
        if dollar and not _is_prose(pending):
            continue
        if pending:
            yield _statement(pending, begin)
        elif comment.strip():
            yield Statement("", (), number, comment.strip())
        pending = ""
    if pending:
        raise InputError(f"'{file}', line {begin}: the statement is continued ($) past the end. The file is cut short.")


def _statement(code: str, line: int) -> Statement:
    word, _, rest = code.partition("/")
    name = word.strip().upper()
    if _is_prose(code):
        return Statement(name.split(maxsplit=1)[0], (), line, "")
    arguments = tuple(part.strip().upper() for part in rest.split(",")) if rest.strip() else ()
    return Statement(name, arguments, line, "")


def _is_prose(code: str) -> bool:
    return code.upper().startswith(FREE_TEXT)


def refusal(file: Path, statement: Statement) -> InputError:
    """Say why a statement that moves the tool cannot be read."""
    word = statement.word.split("=")[-1].strip()
    return InputError(
        f"'{file}', line {statement.line}: {word} ({REFUSED.get(word, 'a moved frame')}) is not read. "
        "Post-process the path to GOTO points in one frame."
    )


def unknown_word(file: Path, statement: Statement) -> InputError:
    """Say that nobody knows a word."""
    known = ", ".join(KNOWN)
    return InputError(
        f"'{file}', line {statement.line}: unknown word '{statement.word[:40]}'. Read are {known}, points by GOTO."
    )
