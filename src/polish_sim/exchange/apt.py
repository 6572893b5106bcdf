"""Paths out of CAM systems: APT source and CLDATA text (GOTO points -> WayPoints).

The tool is on the part where it moves at a feed, in the air where it moves RAPID. What `apt_text` notes in
comments (segment, pass, force) is taken up, so that our own files come back whole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from polish_sim.arrays import Bools
from polish_sim.errors import InputError
from polish_sim.exchange.strokes import (
    ExportSetup,
    feeds_of,
    in_part_remarks,
    moves_in_part,
    rows_without_straight_air,
)
from polish_sim.exchange.way_points import CamPoints, Unknown, WayPoints
from polish_sim.planning import PlanResult
from polish_sim.planning.toolpath import APPROACH, PROCESS, RETRACT, SEGMENTS, ToolPath
from polish_sim.tables import number_in

# The statements of an APT/CLDATA file: comments, continuations and words taken apart (text -> statements).

FREE_TEXT = ("PARTNO", "PPRINT", "REMARK", "INSERT", "TPRINT", "DISPLY", "LETTER")  #: The rest is prose
WORDS: Mapping[str, str] = {
    word: what
    for what, words in {
        "": "MACHIN CUTTER TOOLNO LOADTL LOAD SELECT TOOL COOLNT SPINDL AUTOPS CUTCOM INTOL OUTTOL TOLER "
        "CLEARP CLRSRF MULTAX PPFUN SEQNO OPNAME STOP OPSTOP REWIND END FINI NOPOST CLPRNT DELAY DWELL "
        "OPSKIP AIR PAINT TLDATA HEAD MODE END-OF-PATH OUTPUT PPLOFF PPLON " + " ".join(FREE_TEXT),
        "arcs": "CIRCLE ARC MOVARC CYLNDR CIRCUL ARCSLP",
        "canned and relative motions": "CYCLE GOHOME RETRCT GODLTA",
        "splines": "NURBS SPLINE BSPLIN",
        "motions along surfaces": "INDIRV INDIRP TLON TLLFT TLRGT PSIS "
        "GO GOFWD GOBACK GOLFT GORGT GOUP GODOWN",
        "moved frames": "ORIGIN TRANS ROTATE ROTABL MSYS COPY MATRIX REFSYS",
        "programs": "MACRO CALL LOOPST LOOPND TERMAC POINT LINE PLANE PATERN",
    }.items()
    for word in words.split()
}
"""Words that are not read: those that move the tool in ways a list of points does not say, and how; the
others do not move it."""
KNOWN = ("GOTO", "FROM", "FEDRAT", "RAPID", "UNITS", "TLAXIS")


class Statement(NamedTuple):
    """One statement: its word in capitals, the text of its arguments, the line it begins in."""

    word: str
    arguments: tuple[str, ...]
    line: int
    comment: str  #: Text after $$ where the statement is a comment alone; word is empty then


def statements(file: Path, text: str) -> Iterator[Statement]:
    """Take an APT text apart; $$ begins a comment, a single $ continues a statement other than prose."""
    pending = ""
    begin = 0
    remarked = False
    for line, raw in enumerate(text.splitlines(), start=1):
        code, _, comment = raw.partition("$$")
        # Creo writes frames as remarks ("$$->") that continue over lines; they are remarks all the way.
        remarked, swallowed = raw.rstrip().endswith("$") and (remarked or comment.startswith("->")), remarked
        if swallowed:
            continue
        # Columns 73-80 of a punched card hold a label; CAM systems still print it after the $.
        head, dollar, _ = code.partition("$")
        begin = begin if pending else line
        pending += head.strip()
        if dollar and not _is_prose(pending):
            continue
        if pending:
            yield _statement(pending, begin)
        elif comment.strip():
            yield Statement("", (), line, comment.strip())
        pending = ""
    if pending:
        raise InputError(
            f"'{file}', line {begin}: the statement is continued ($) past the end. The file is cut short."
        )


def _statement(code: str, line: int) -> Statement:
    word, _, rest = code.partition("/")
    name = word.strip().upper()
    if _is_prose(code):
        return Statement(name.split(maxsplit=1)[0], (), line, "")
    arguments = tuple(part.strip().upper() for part in rest.split(",")) if rest.strip() else ()
    return Statement(name, arguments, line, "")


def _is_prose(code: str) -> bool:
    return code.upper().startswith(FREE_TEXT)


UNITS: Mapping[str, float] = {
    "MM": 1e-3,
    "CM": 1e-2,
    "M": 1.0,
    "INCH": 0.0254,
    "INCHES": 0.0254,
    "IN": 0.0254,
}
FEED_UNITS: Mapping[str, float] = {"MMPM": 1e-3 / 60.0, "IPM": 0.0254 / 60.0}
PER_MINUTE = ("PERMIN", "UPM")
PER_TURN = ("PERREV", "MMPR", "IPR")
OWN_FRAME = ((0, 0, 0, 1, 0, 0, 0, 1, 0), (0, 0, 0, 1, 0, 0, 0, 0, 1))
"""Origin, x and y axis, or x and z axis, of the part's own frame."""
NOTE = "polish-sim:"  #: Begins a comment that says segment, pass and force of the points to come


@dataclass
class _Machine(CamPoints):
    """What holds while the statements are gone through."""

    unit: float = 1e-3
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    feed: float = math.nan
    rapid: bool = False
    noted: dict[str, str] = field(default_factory=dict)

    def error(self, statement: Statement, text: str) -> InputError:
        """An error that names its statement's line."""
        return InputError(f"'{self.file}', line {statement.line}: {text}")


def read_apt(file: Path, text: str, unknown: Unknown) -> WayPoints:
    """Read APT source or CLDATA: UNITS, FROM, GOTO, FEDRAT, RAPID, TLAXIS; mm unless UNITS says
    otherwise.

    Raises InputError, naming the line, for a statement that is unknown, incomplete or moves other than by
    points.
    """
    machine = _Machine(file)
    for statement in statements(file, text):
        if not statement.word:
            _take_note(machine, statement)
            continue
        action = _ACTIONS.get(statement.word)
        if action is not None:
            action(machine, statement)
        elif WORDS.get(statement.word.split("=")[-1].strip()):
            raise _refusal(machine, statement)
        elif WORDS.get(statement.word.split(maxsplit=1)[0]) != "":
            said = f"unknown word '{statement.word[:40]}'. Read are {', '.join(KNOWN)}, points by GOTO."
            unknown(machine.error(statement, said))
    path = machine.path(
        "no GOTO in it. Give APT source or CLDATA as text.",
        "GOTO is RAPID, nothing is done at a feed. Give the path with FEDRAT.",
    )
    return WayPoints(path, file, machine.place)


def _refusal(machine: _Machine, statement: Statement) -> InputError:
    """Say why a statement that moves the tool cannot be read."""
    word = statement.word.split("=")[-1].strip()
    why = (
        f"{word} ({WORDS.get(word, 'a moved frame')}) is not read. Post-process the path to GOTO points "
        "in one frame."
    )
    return machine.error(statement, why)


def _goto(machine: _Machine, statement: Statement) -> None:
    numbers = _numbers(machine, statement, (3, 6))
    machine.axis = numbers[3:] or machine.axis
    noted = machine.noted.get("segment", "")
    segment = SEGMENTS.index(noted) if noted in SEGMENTS else (APPROACH if machine.rapid else PROCESS)
    force = _noted_number(machine, "force", statement)
    turn = _noted_number(machine, "pass", statement)
    position = tuple(machine.unit * value for value in numbers[:3])
    machine.add(statement.line, segment, *position, *machine.axis, machine.feed, force, turn)
    machine.rapid = False  # RAPID holds for one motion


def _from(machine: _Machine, statement: Statement) -> None:
    """The tool stands here; where it goes next is what counts, but a TLAXIS may come along."""
    machine.axis = _numbers(machine, statement, (3, 6))[3:] or machine.axis


def _rapid(machine: _Machine, statement: Statement) -> None:
    machine.rapid = True


def _feed_rate(machine: _Machine, statement: Statement) -> None:
    words = [word for word in statement.arguments if math.isnan(number_in(word))]
    values = [number_in(word) for word in statement.arguments if word not in words]
    if any(word in PER_TURN for word in words):
        said = f"a feed per turn ({words[0]}) means nothing to a polishing pad. Give it per minute."
        raise machine.error(statement, said)
    unknown = [word for word in words if word not in FEED_UNITS and word not in PER_MINUTE]
    if unknown or len(words) > 1 or len(values) != 1 or not math.isfinite(values[0]) or values[0] <= 0.0:
        said = f"FEDRAT/{','.join(statement.arguments)} is no feed. Wanted: a positive number per minute, "
        raise machine.error(statement, said + f"with {', '.join((*FEED_UNITS, *PER_MINUTE))} or nothing.")
    unit = FEED_UNITS[words[0]] if words and words[0] in FEED_UNITS else machine.unit / 60.0
    machine.feed = values[0] * unit


def _units(machine: _Machine, statement: Statement) -> None:
    name = statement.arguments[0] if len(statement.arguments) == 1 else ",".join(statement.arguments)
    if name not in UNITS:
        raise machine.error(statement, f"unknown unit '{name}'. Known: {', '.join(UNITS)}.")
    machine.unit = UNITS[name]


def _tool_axis(machine: _Machine, statement: Statement) -> None:
    machine.axis = _numbers(machine, statement, (3,))


def _frame(machine: _Machine, statement: Statement) -> None:
    """A frame of the machine's is taken only where it is that of the part."""
    numbers = [number_in(word) for word in statement.arguments]
    if numbers not in [list(frame[: len(numbers)]) for frame in OWN_FRAME] or len(numbers) not in (3, 9):
        raise _refusal(machine, statement)


_ACTIONS: Mapping[str, Callable[[_Machine, Statement], None]] = {
    "GOTO": _goto,
    "FROM": _from,
    "RAPID": _rapid,
    "FEDRAT": _feed_rate,
    "UNITS": _units,
    "TLAXIS": _tool_axis,
    "MSYS": _frame,
    "ORIGIN": _frame,
}


def _take_note(machine: _Machine, statement: Statement) -> None:
    """Take up what our own writer noted; other comments say nothing."""
    if statement.comment.startswith(NOTE):
        machine.noted = dict(
            part.split("=", 1) for part in statement.comment[len(NOTE) :].split() if "=" in part
        )


def _noted_number(machine: _Machine, name: str, statement: Statement) -> float:
    value = number_in(machine.noted.get(name, ""))
    if name in machine.noted and math.isnan(value):
        raise machine.error(statement, f"{name} is noted as '{machine.noted[name]}', not a number.")
    return value


def _numbers(machine: _Machine, statement: Statement, counts: Sequence[int]) -> tuple[float, ...]:
    if len(statement.arguments) not in counts:
        wanted = " or ".join(map(str, counts))
        said = (
            f"{statement.word} has {len(statement.arguments)} values, wanted {wanted}: x,y,z and the "
            "tool axis i,j,k."
        )
        raise machine.error(statement, said)
    for word in statement.arguments:
        if not math.isfinite(number_in(word)):
            raise machine.error(statement, f"{statement.word}: '{word}' is not a number. Correct the line.")
    return tuple(number_in(word) for word in statement.arguments)


# Paths for CAM systems and postprocessors: APT/CLDATA text (plan -> GOTO points).

MM = 1e3
APT_WRITER_PER_MINUTE = 60.0 * MM
IN_THE_AIR = (APPROACH, RETRACT)


def apt_text(result: PlanResult, setup: ExportSetup) -> str:
    """Write a path as APT: mm, tool axis from the part to the tool, RAPID in the air, FEDRAT in mm per
    minute.

    Positions are printed to 1e-6 mm, axes to 1e-9. Leads move at the approach speed; straight moves in the
    air are one GOTO. Segment, pass and force stand in comments, which other systems skip and our own reader
    takes up. ``setup``: feed and approach speed where the path has none of its own.
    """
    head = [
        f"PARTNO {result.mesh.name}",
        f"$$ tool path by polish-sim: {result.plan.pattern}, step-over {MM * result.plan.stepover_m:g} mm",
        "$$ points lie on the surface, not pressed in; a force-controlled tool presses",
        "UNITS/MM",
        "MULTAX/ON",
    ]
    kept = rows_without_straight_air(result.path)
    inside = moves_in_part(result, kept)
    return "\n".join([*head, *_motions(result.path.rows(kept), setup, inside), "FINI", ""])


def _motions(path: ToolPath, setup: ExportSetup, inside: Bools) -> Iterator[str]:
    feed = feeds_of(path, setup)
    noted = said = ""
    points = zip(MM * path.positions_work, path.axes_work, in_part_remarks(inside), strict=True)
    for row, (position, axis, remark) in enumerate(points):
        note = _note(path, row)
        if note != noted:
            noted = note
            yield note
        if remark:
            yield f"$$ {remark}"
        if path.segment[row] in IN_THE_AIR:
            yield "RAPID"
        rate = f"FEDRAT/{APT_WRITER_PER_MINUTE * feed[row]:.6f},MMPM"
        if rate != said:
            said = rate
            yield rate
        yield "GOTO/" + ",".join(
            [*(f"{value:.6f}" for value in position), *(f"{value:.9f}" for value in axis)]
        )


def _note(path: ToolPath, row: int) -> str:
    force = "" if path.force is None else f" force={path.force[row]:.6f}"
    return f"$$ {NOTE} segment={SEGMENTS[path.segment[row]]} pass={path.pass_index[row]}{force}"
