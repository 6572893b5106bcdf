"""Saved runs as pages for the browser: one again, several over each other, many seeds with bands (records ->
Page)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.analysis.claim import Claim, claim_row
from polish_sim.analysis.metrics import numbers
from polish_sim.analysis.run_record import RunRecord, notes_of
from polish_sim.arrays import Array
from polish_sim.cell.scene import lay_part, robot_with_tool, works_below
from polish_sim.errors import PolishSimError
from polish_sim.experiments.registry import claims_shown, experiment, setting_rows
from polish_sim.experiments.run_page import clock, named_rows, run_motion, run_page, run_plots, shown_rows
from polish_sim.page import PAGE
from polish_sim.page.page import Line, Motion, Other, Page, Plot, Wear, read_page
from polish_sim.planning.part_plan import load_mesh

#: Curves of one run each that are put over each other
ALIKE = ("exact force", "error", "speed", "distance")


def saved_page(folder: Path, record: RunRecord) -> Page | None:
    """The page of a saved run: its own, or made again as far as one robot goes; None if there is nothing to
    show."""
    if (folder / PAGE).exists():
        return read_page(folder / PAGE)
    return run_page(record, cell_model(record)) if remade(record) else None


def remade(record: RunRecord) -> bool:
    """Whether the cell of a run can be set up again from what it left."""
    return experiment(record.scenario.experiment).remade and len(record.log) > 0


def cell_model(record: RunRecord) -> Any:
    """The cell of a run with one robot, the part where it was planned; without the part if its file is
    gone."""
    scenario = record.scenario
    T_base_work = record.metrics.get("T_base_work")
    spec = robot_with_tool(scenario)
    if T_base_work is not None and experiment(scenario.experiment).on_part:
        with suppress(PolishSimError):
            mesh, below = load_mesh(scenario.part), False
            if record.path is not None:
                below = works_below(np.array(T_base_work), record.path.axes_work)
            lay_part(spec, mesh, np.array(T_base_work), below)
    return spec.compile()


def pages_over(records: Sequence[RunRecord], pages: Sequence[Page]) -> Page:
    """Several runs of one experiment over each other: the first one's cell, the curves and removal of all."""
    first, names = pages[0], [record.name for record in records]
    time = max((page.motion.time for page in pages), key=lambda rows: rows[-1])
    motions = [_resampled(page.motion, time) for page in pages]
    columns = [record.metrics for record in records]
    claims = claims_shown([record.scenario for record in records])
    stops = [f"{name}: {page.stop}" for name, page in zip(names, pages, strict=True) if page.stop]
    others = [
        Other(name, motion, _same_places(first.wear, page.wear))
        for name, page, motion in zip(names[1:], pages[1:], motions[1:], strict=True)
    ]
    return first._replace(
        title=f"{records[0].scenario.experiment}: {', '.join(names)}",
        about="runs over each other: the arm is the first one's, traces and curves are of all",
        stop="; ".join(stops),
        motion=motions[0],
        plots=[
            _over(plot, names, pages, time)
            for plot in first.plots
            if {line.label for line in plot.lines} & set(ALIKE)
        ],
        tables={
            "Asked": [["", *names], *named_rows(setting_rows(records))],
            "Figures": _figures(claims, names, columns),
        },
        notes=notes_of(records),
        command="",
        name=names[0],
        others=others,
    )


def _figures(
    claims: Iterable[Claim], names: Iterable[str], columns: Sequence[Mapping[str, Any]]
) -> list[list[str]]:
    """The table of figures of some runs, a column each."""
    return [
        ["figure", *names, "paper", "asked"],
        *named_rows(claim_row(claim, columns, None) for claim in claims),
    ]


def _resampled(motion: Motion, time: Array) -> Motion:
    """A motion at other moments (n,) [s]; past its end it stands still."""
    columns = {}
    for name, values in motion._asdict().items():
        table = np.asarray(values)[:, None] if np.ndim(values) == 1 else values
        rows = np.stack([np.interp(time, motion.time, column) for column in table.T], axis=1)
        columns[name] = rows[:, 0] if np.ndim(values) == 1 else rows
    return Motion(
        **{**columns, "time": time, "force": np.where(time > motion.time[-1], 0.0, columns["force"])}
    )


def _over(plot: Plot, names: Sequence[str], pages: Sequence[Page], time: Array) -> Plot:
    """The same curve of every run that has it."""
    lines = [line._replace(values=np.interp(time, pages[0].motion.time, line.values)) for line in plot.lines
             if line.role == "asked"]  # fmt: skip
    for number, (name, page) in enumerate(zip(names, pages, strict=True)):
        for line in [line for other in page.plots if other.title == plot.title for line in other.lines]:
            if line.label in ALIKE:
                values = np.interp(time, page.motion.time, line.values, right=np.nan)
                lines.append(Line(name, values, str(number % 6)))
    return plot._replace(lines=lines)


def _same_places(wear: Wear | None, other: Wear | None) -> Array:
    """The removal of another run at the vertices of the first one's."""
    if wear is None or other is None:
        return np.empty(0)
    return other.value[cKDTree(other.vertices).query(wear.vertices)[1]]


def seeds_page(records: Sequence[RunRecord], columns: Mapping[str, Mapping[str, Any]]) -> Page:
    """Many seeds of one scenario: the first one's cell, bands from the least to the largest of all behind its
    curves.

    ``columns`` are the figures to show, by heading.
    """
    first, model = records[0], cell_model(records[0])
    page = run_page(first, model)
    curves: dict[tuple[str, str], list[Array]] = {}
    for record in records:
        time = clock(record.log)
        kept = shown_rows(time, numbers(record.log, "q_rad"))
        for plot in run_plots(record, run_motion(record, model, kept), kept):
            for line in (line for line in plot.lines if line.label in ALIKE):
                values = np.interp(page.motion.time, time[kept], line.values, right=np.nan)
                curves.setdefault((plot.title, line.label), []).append(values)

    def banded(plot: Plot, line: Line) -> Line:
        same = curves.get((plot.title, line.label))
        return line._replace(low=np.fmin.reduce(same), high=np.fmax.reduce(same)) if same else line

    plots = [plot._replace(lines=[banded(plot, line) for line in plot.lines]) for plot in page.plots]
    figures = _figures(claims_shown([first.scenario]), columns, list(columns.values()))
    return page._replace(
        title=f"{first.scenario.experiment}, {first.scenario.controller.label}, {len(records)} seeds",
        about="the cell and the curves are the first seed's; bands reach from the least to the largest of "
        "all",
        plots=plots,
        tables={**page.tables, "Figures": figures},
    )
