"""Pages for any browser: a cell in motion, plots and figures in one HTML file that needs no network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from polish_sim.row_file import whole_file

if TYPE_CHECKING:
    from polish_sim.page.page import Page

PAGE = "report.html"  #: Its name in a folder of results


def save_page(folder: Path, page: Page) -> None:
    """Write a page into a folder of results; it appears when it is whole."""
    from polish_sim.page.page import page_html  # numpy is slow to import

    with whole_file(folder / PAGE) as draft:
        draft.write_text(page_html(page), encoding="utf-8")
