"""What a page shows, and how it becomes one HTML file (typed data -> text).

The data is one compressed block: numbers rounded to 16 bits over their range, as differences, byte by byte.
The page's own code is beside this file: ``page.html``, ``page.css``, ``scene.js``, ``plots.js`` and
``page.js``.
"""

from __future__ import annotations

import base64
import html
import json
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Ints
from polish_sim.errors import InputError
from polish_sim.page import Table
from polish_sim.row_file import plain

SCRIPTS = ("scene.js", "plots.js", "page.js")
LEVELS = 65534  #: Of a rounded number; one more stands for what is undefined


class PageBody(NamedTuple):
    """A rigid body; it moves with its parent, and about or along an axis of its own."""

    parent: int  #: Its number in the list, smaller than this body's; -1: the world
    rest: Sequence[Sequence[float]]  #: Its pose on the parent at rest, four rows of four
    axis: Sequence[float] = (0.0, 0.0, 1.0)  #: In the body's frame, unit
    anchor: Sequence[float] = (0.0, 0.0, 0.0)  #: A point on it [m]
    slide: bool = False
    joint: int = -1  #: Which column of ``Motion.joints`` moves it; -1: none


class Solid(NamedTuple):
    """Triangles that move with a body."""

    kind: str  #: What it is: cell, arm, part, fixture, or a mark on the part by its name
    body: int
    vertices: Array  #: In the body's frame [m], shape (n, 3)
    faces: Ints  #: Shape (m, 3)
    color: Sequence[float]  #: Red, green, blue, 0 to 1


class Line(NamedTuple):
    """One curve of a plot over the page's time."""

    label: str
    values: Array  #: Shape (n,); NaN: not drawn
    role: str = "main"  #: Its colour: main, asked, or 0 to 5 for one of many
    low: Array | None = None  #: Ends of a band behind it, shape (n,)
    high: Array | None = None


class Plot(NamedTuple):
    """Curves of one unit."""

    title: str
    unit: str
    lines: Sequence[Line]
    note: str = ""


class Motion(NamedTuple):
    """How everything moves, one row for each moment of the page."""

    time: Array  #: [s], shape (n,)
    joints: Array  #: Angles [rad] and slides [m], shape (n, k)
    pad: Array  #: Middle of the pad's face, world frame [m], shape (n, 3)
    force: Array  #: Pressing [N], shape (n,)
    asked: Array  #: Force asked for [N], shape (n,); NaN where none is
    speed: Array  #: Of the tool [m/s], shape (n,)
    error: Array  #: Of the tool across its axis [m], shape (n,)
    curvature: Array  #: Of the part along the path [1/m], shape (n,)


class Wear(NamedTuple):
    """What was taken off the part in the end; the page lets it grow."""

    vertices: Array  #: Frame of the part's body [m], shape (n, 3)
    faces: Ints  #: Shape (m, 3)
    value: Array  #: Removal at each vertex, shape (n,); empty: the page predicts it, over its mean
    name: str
    unit: str  #: Of the removal
    top: float  #: Where its colours end
    pad_radius: float  #: [m]
    spin: float  #: Of the pad [rad/s]


class Other(NamedTuple):
    """Another run laid over the page's, on the rows of its motion."""

    name: str
    motion: Motion
    value: Array  #: Its removal at the vertices of the page's, shape (n,); empty if there is none


STILL = Motion(np.empty(0), np.empty((0, 1)), np.empty((0, 3)), *[np.empty(0)] * 5)  #: Nothing moves


class Page(NamedTuple):
    """All that one page shows: of charts, tables and notes alone nothing moves."""

    title: str
    about: str  #: What it is, in a sentence
    tables: Mapping[str, Sequence[Sequence[str]]]  #: Rows by heading; the first row is the head
    notes: Sequence[str]
    charts: Mapping[str, str] = {}  #: Drawings that do not move, by heading: SVG in the page's own colours
    stop: str = ""  #: Why and when the run stopped itself; empty if it did not
    stop_time: float | None = None  #: [s]
    bodies: Sequence[PageBody] = ()
    solids: Sequence[Solid] = ()
    part_body: int = -1  #: The body that carries path and removal; -1: the world
    motion: Motion = STILL
    path: Array = STILL.pad  #: Frame of the part's body [m], shape (n, 3)
    contact: Array = STILL.time  #: 1 where the path is in contact, 0 in the air, shape (n,)
    wear: Wear | None = None
    plots: Sequence[Plot] = ()
    command: str = ""  #: Repeats the run
    made: str = ""  #: By which seed and versions
    view: str = "cell"  #: What is looked at first: cell, part or tool
    name: str = ""  #: What the run is called beside ``others``
    others: Sequence[Other] = ()

    @classmethod
    def of(cls, title: str, about: str, tables: Iterable[Table], notes: Sequence[str] = ()) -> Page:
        """A page of tables, those without a row left out, of notes and captions."""
        full = [table for table in tables if table.rows]
        captions = [table.caption for table in full if table.caption]
        return cls(title, about, {table.title: table.lines for table in full}, [*notes, *captions])


# Simple shapes, and a tool without an arm.

SIDES = 40  #: Of a cylinder


def prism(outline: Array, low: float, high: float) -> tuple[Array, Ints]:
    """Vertices and faces of a prism along z from ``low`` to ``high`` [m]; its outline (k, 2) runs
    counter-clockwise round the axis."""
    count = len(outline)
    k, middle, up = np.arange(count), np.full(count, count), count + 1
    ahead = (k + 1) % count
    ring = np.append(outline, [[0.0, 0.0]], axis=0)
    vertices = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (low, high)])
    sides = [(k, ahead, k + up), (ahead, ahead + up, k + up)]
    ends = [(ahead, k, middle), (k + up, ahead + up, middle + up)]
    faces = np.concatenate([np.stack(corners, axis=1) for corners in (*sides, *ends)])
    return vertices, faces.astype(np.int32)


def box(half: Array) -> tuple[Array, Ints]:
    """Vertices and faces of a box about the origin, by half its sides (3,) [m]."""
    return prism(half[:2] * [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]], -half[2], half[2])


def cylinder(radius: float, length: float, start: float) -> tuple[Array, Ints]:
    """Vertices and faces of a cylinder along z from ``start`` on [m]."""
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    return prism(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), start, start + length)


def free_tool(positions: Array, axes: Array) -> tuple[list[PageBody], Array]:
    """Bodies and joints (n, 5) that carry a tool through points (n, 3) [m] by its unit axes away from the
    part (n, 3).

    Three slides and two hinges behind each other; z of the last body points into the part. The tool does not
    spin.
    """
    tilt = np.arccos(np.clip(axes[:, 2], -1.0, 1.0))
    turn = np.unwrap(np.where(np.sin(tilt) > 1e-6, np.arctan2(axes[:, 1], axes[:, 0]), 0.0))
    rest = np.eye(4).tolist()
    along = [PageBody(k, rest, np.eye(3)[k].tolist(), slide=True, joint=k) for k in range(3)]
    hinges = [PageBody(3 + k, rest, np.eye(3)[2 - k].tolist(), joint=3 + k) for k in range(2)]
    over = PageBody(5, np.diag([1.0, -1.0, -1.0, 1.0]).tolist())
    return [*along, *hinges, over], np.column_stack([positions, turn, tilt])


class Fine(NamedTuple):
    """Values (n,) that 16 bits are too coarse for."""

    values: Array


def page_html(page: Page) -> str:
    """The page as one HTML file."""
    blocks: list[bytes] = []
    data = page._asdict() | {"motion": page.motion._asdict() | {"time": Fine(page.motion.time)}}
    head = json.dumps(_packed(data, blocks), separators=(",", ":"), allow_nan=False).encode()
    # The data is base64, and so is every name in it; only the title stands in the page as text.
    block = zlib.compress(len(head).to_bytes(4, "little") + head + b"".join(blocks), 6)
    files = resources.files("polish_sim.page")
    text = {
        name: files.joinpath(name).read_text(encoding="utf-8") for name in ("page.html", "page.css", *SCRIPTS)
    }
    parts = {
        "TITLE": html.escape(page.title),
        "STYLE": text["page.css"],
        "SCRIPT": "".join(text[name] for name in SCRIPTS),
        "DATA": base64.b64encode(block).decode("ascii"),
    }
    return re.sub("@(TITLE|STYLE|SCRIPT|DATA)@", lambda found: parts[found[1]], text["page.html"])


def _packed(value: Any, blocks: list[bytes]) -> Any:
    """A value as JSON, its arrays moved to ``blocks``."""
    if isinstance(value, Fine):
        return _array(np.asarray(value.values, dtype=float)[:, None], 4, blocks)
    if isinstance(value, np.ndarray):
        table = value[:, None] if value.ndim == 1 else value
        return _array(table, 4 if value.dtype.kind in "iu" else 2, blocks)
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(name): _packed(entry, blocks) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_packed(entry, blocks) for entry in value]
    return plain(value)


def _array(table: NDArray[Any], size: int, blocks: list[bytes]) -> dict[str, Any]:
    """Where an array (n, k) is in the blocks, and what turns its ``size`` bytes a number back into values."""
    low = np.zeros(table.shape[1])
    step = np.ones(table.shape[1])
    levels = table
    if table.dtype.kind not in "iu":
        known = np.isfinite(table)
        least = np.where(known, table, np.inf).min(axis=0, initial=np.inf)
        most = np.where(known, table, -np.inf).max(axis=0, initial=-np.inf)
        low = np.where(np.isfinite(least), least, 0.0)
        step = np.where(most > least, (most - low) / (LEVELS if size == 2 else 2**31), 1.0)
        levels = np.where(known, np.round((np.where(known, table, low) - low) / step), LEVELS + 1)
    differences = np.ascontiguousarray(np.diff(levels.astype("<i8"), axis=0, prepend=0).T)
    planes = differences.view(np.uint8).reshape(*differences.shape, 8)
    at = sum(map(len, blocks))
    blocks.append(np.ascontiguousarray(np.moveaxis(planes[:, :, :size], 2, 0)).tobytes())
    return {
        "$": at,
        "n": len(table),
        "k": table.shape[1],
        "size": size,
        "low": low.tolist(),
        "step": step.tolist(),
    }


# And back.


def read_page(file: Path) -> Page:
    """The page in a file that ``page_html`` wrote, its numbers as they were rounded.

    Raises:
        InputError: There is no such page in it.
    """
    try:
        found = re.search(r'id="data">([^<]*)<', file.read_text(encoding="utf-8"))
        block = zlib.decompress(base64.b64decode(found[1] if found else ""))
        start = 4 + int.from_bytes(block[:4], "little")
        data = json.loads(
            block[4:start], object_hook=lambda entry: _values(entry, block, start) if "$" in entry else entry
        )
        data["motion"] = Motion(**data["motion"])
        data["bodies"] = [PageBody(**body) for body in data["bodies"]]
        data["solids"] = [Solid(**solid) for solid in data["solids"]]
        data["wear"] = data["wear"] and Wear(**data["wear"])
        data["plots"] = [
            Plot(**{**plot, "lines": [Line(**line) for line in plot["lines"]]}) for plot in data["plots"]
        ]
        data["others"] = [Other(**{**other, "motion": Motion(**other["motion"])}) for other in data["others"]]
        return Page(**data)
    except (OSError, ValueError, KeyError, TypeError, zlib.error) as error:
        raise InputError(
            f"cannot read the page '{file}': {error}. Delete it to see the run without."
        ) from error


def _values(entry: Mapping[str, Any], block: bytes, start: int) -> NDArray[Any]:
    """An array as ``_array`` took it in, (n,) or (n, k)."""
    n = entry["n"]
    k = entry["k"]
    size = entry["size"]
    planes = (
        np.frombuffer(block, np.uint8, n * k * size, start + entry["$"]).reshape(size, k, n).astype(np.int64)
    )
    levels = np.cumsum(np.tensordot(256 ** np.arange(size), planes, axes=1), axis=1).T % 256**size
    low = np.array(entry["low"])
    step = np.array(entry["step"])
    if size == 4 and not low.any() and (step == 1.0).all():
        return levels.astype(np.int32)
    values = np.where((levels > LEVELS) & (size == 2), np.nan, low + step * levels)
    return values[:, 0] if k == 1 else values
