"""What is shown of results: tables, and pages for any browser: a cell in motion, plots and figures in one
HTML file that needs no network."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from polish_sim.row_file import put_file

if TYPE_CHECKING:
    from polish_sim.page.page import Page

PAGE = "report.html"  #: Its name in a folder of results
DEGREES = 180.0 / math.pi  #: Scale of an angle shown in degrees
SCALES = {
    **{"mm": 1e3, "mm/s": 1e3, "mN m": 1e3, "mrad": 1e3, "g": 1e3, "µm": 1e6, "cm^2": 1e4, "mm^2": 1e6},
    **{"%": 100.0, "deg": DEGREES, "deg/mm": 1e-3 * DEGREES},
}
"""Value in a unit / SI value; 1 for every other unit."""
ShownRows = Iterable[tuple[str, str, str, str]]  #: Label, unit, figures with spaces, format of each


def number_or_dash(value: float | None, form: str = ".3g", scale: float = 1.0) -> str:
    """A scaled number, or a dash where there is none: a path without neighbouring turns has no step-over."""
    return "-" if value is None or math.isnan(value) else f"{value * scale:{form}}"


def figure_rows(rows: ShownRows, *columns: Mapping[str, Any]) -> list[list[str]]:
    """Label, unit and values of some figures, a cell for each of ``columns``; rows nobody has are left
    out."""
    shown = []
    for label, unit, names, form in rows:
        scale = SCALES.get(unit, 1.0)
        cells = [
            " / ".join(number_or_dash(m[name], form, scale) for name in names.split() if name in m)
            for m in columns
        ]
        if any(cells):
            shown.append([label, unit, *cells])
    return shown


class Table(NamedTuple):
    """A table of results, the same for the screen, for Markdown and for a page."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: int = 1  #: Columns of words; the others are right-aligned
    caption: str = ""  #: A line about it

    @property
    def grid(self) -> Any:
        """For the screen: rich's table."""
        from rich import box
        from rich.table import Table as Grid

        grid = Grid(
            title=self.title, title_justify="left", box=box.SIMPLE_HEAD, title_style="bold", pad_edge=False
        )
        for index, heading in enumerate(self.headings):
            grid.add_column(heading, justify="left" if index < self.left else "right", no_wrap=True)
        for row in self.rows:
            grid.add_row(*row)
        return grid

    @property
    def markdown(self) -> str:
        """As a section of Markdown."""
        ruled = [self.headings, ["---", *("---:" for _ in self.headings[1:])], *self.rows]
        lines = "\n".join("| " + " | ".join(line) + " |" for line in ruled)
        return "\n\n".join(filter(None, [f"## {self.title}", self.caption, lines]))

    @property
    def lines(self) -> list[Sequence[str]]:
        """For a page: headings and rows."""
        return [self.headings, *self.rows]


def save_page(folder: Path, page: Page | None) -> None:
    """Write a page, if there is one, into a folder of results; it appears when it is whole."""
    if page is None:
        return
    from polish_sim.page.page import page_html  # numpy is slow to import

    put_file(folder, PAGE, page_html(page))
