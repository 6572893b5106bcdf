"""Runs, saved ones too, as pictures and pages for the browser, as their experiment has them (records ->
figures, Page)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from polish_sim.analysis.claim import figure_table
from polish_sim.analysis.run_record import (
    CONFIG,
    WITHOUT,
    Records,
    RunRecord,
    notes_of,
    read_records,
    stop_mark,
)
from polish_sim.analysis.style import say_stop
from polish_sim.arrays import Array
from polish_sim.cell.scene import lay_part, robot_with_tool
from polish_sim.errors import InputError, PolishSimError
from polish_sim.experiments.registry import claims_shown, experiment, load, path_words, setting_rows
from polish_sim.experiments.run_page import clock, run_motion, run_page, run_plots, shown_rows
from polish_sim.page import PAGE, Table
from polish_sim.page.page import Line, Motion, Other, Page, Plot, Wear, read_page
from polish_sim.planning.part_plan import load_mesh
from polish_sim.planning.toolpath import interpolate
from polish_sim.row_file import METRICS, check_forms


def saved_records(folders: Sequence[Path]) -> list[RunRecord]:
    """Read saved runs to look at them; errors as of `read_records`."""
    records = read_records(folders)
    for folder, record in zip(folders, records, strict=True):
        row = experiment(record.scenario.experiment)
        shown = {claim.figure: float for claim in row.claims(record.scenario)}
        if not shown.keys() & record.metrics:
            raise InputError(
                f"'{folder / METRICS}' holds no figure of '{row.name}'. Copy it from the run, or run it "
                "again."
            )
        check_forms(record.metrics, {**row.forms, **shown}, folder / METRICS, WITHOUT)
    return records


def draw_plots(record: RunRecord) -> dict[str, Figure]:
    """Draw the pictures of a run, by file name; a run without a row has none."""
    if not len(record.log):
        return {}
    plots = _drawn(experiment(record.scenario.experiment).plots(record), record)
    plots |= _removal([record]) if removed_something(record) else {}
    if stop := stop_mark(record.metrics):
        for figure in plots.values():
            say_stop(figure, stop.text)
    return plots


def draw_comparison(records: Records) -> dict[str, Figure]:
    """Draw the pictures that put several runs side by side, by file name.

    Raises:
        InputError: If the runs are of different experiments.
    """
    names = {record.scenario.experiment for record in records}
    if len(names) > 1:
        raise InputError(
            f"runs of different experiments ({', '.join(sorted(names))}) cannot be put side by side: "
            "give runs of one experiment."
        )
    records = [record for record in records if len(record.log)]
    if not records:
        return {}
    plots = _drawn(experiment(names.pop()).comparisons, records)
    return plots | _removal(records) if all(map(removed_something, records)) else plots


def draw_seeds(records: Records) -> dict[str, Figure]:
    """Draw the pictures of many seeds of one scenario, by file name."""
    from polish_sim.analysis.run_plots import plot_seeds

    scenario = records[0].scenario
    row = experiment(scenario.experiment)
    return {
        "seeds.png": plot_seeds(records, row.claims(scenario)),
        **_drawn(row.seeds_plots, records),
    }


def removed_something(record: RunRecord) -> bool:
    """Whether a run has a map of its removal, and removed anything."""
    return bool(record.removal and record.removal.mean > 0.0)


def _drawn(plots: Mapping[str, str], runs: Any) -> dict[str, Figure]:
    """The pictures that have something to show."""
    return {name: figure for name, plot in plots.items() if (figure := load(plot)(runs)) is not None}


def _removal(records: Records) -> dict[str, Figure]:
    return {"removal.png": load("polish_sim.analysis.removal_plot:plot_removal")(records, path_words)}


# Pages: one run again, several over each other, many seeds with bands.


#: Curves of one run each that are put over each other
ALIKE = ("exact force", "error", "speed", "distance")


def page_of(record: RunRecord, model: Any = None, notes: Sequence[str] = ()) -> Page | None:
    """The page of a run; ``model`` is MuJoCo's of its cell, None: it is set up again if it can be.

    A run without a row has none.
    """
    if model is None and remade(record):
        model = cell_model(record)
    return run_page(record, model, notes) if model and len(record.log) else None


def saved_page(sources: Sequence[Path], records: Records) -> Page | None:
    """The page of a saved run, its own if it is there, or of several of one experiment over each other; None
    if one has nothing to show."""
    pages = [
        read_page(source / PAGE) if (source / PAGE).exists() else page_of(record)
        for source, record in zip(sources, records, strict=True)
    ]
    known = [page for page in pages if page is not None]
    if len(known) < len(pages):
        return None
    return known[0] if len(known) == 1 else pages_over(records, known)


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
            axes = record.path.axes_work if record.path else None
            lay_part(spec, load_mesh(scenario.part), np.array(T_base_work), axes)
    return spec.compile()


def pages_over(records: Records, pages: Sequence[Page]) -> Page:
    """Several runs of one experiment over each other: the first one's cell, the curves and removal of all."""
    first, names = pages[0], [record.name for record in records]
    time = max((page.motion.time for page in pages), key=lambda rows: rows[-1])
    motions = [_resampled(page.motion, time) for page in pages]
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
        tables={"Figures": runs_table(records).lines},
        notes=notes_of(records),
        command="",
        name=names[0],
        others=others,
    )


def runs_table(records: Records) -> Table:
    """What runs of one experiment were asked and how they ended, and their figures, side by side."""
    columns = {record.name: record.metrics for record in records}
    claims = claims_shown([record.scenario for record in records])
    return figure_table(claims, columns, setting_rows(records), met=False)


def _resampled(motion: Motion, time: Array) -> Motion:
    """A motion at other moments (n,) [s]; past its end it stands still."""
    columns = {}
    for name, values in motion._asdict().items():
        rows = interpolate(time, motion.time, values.reshape(len(values), -1))
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


def seeds_page(records: Records, figures: Table, notes: Sequence[str]) -> Page | None:
    """Many seeds of one scenario with one robot: the first one's cell, bands from the least to the largest of
    all behind its curves, the ``figures`` of all."""
    if not all(map(remade, records)):
        return None
    first, model = records[0], cell_model(records[0])
    page = run_page(first, model)
    curves: dict[tuple[str, str], list[Array]] = {}
    for record in records:
        time = clock(record.log)
        kept = shown_rows(time, record.log["q_rad"])
        for plot in run_plots(record, run_motion(record, model, kept), kept):
            for line in (line for line in plot.lines if line.label in ALIKE):
                values = np.interp(page.motion.time, time[kept], line.values, right=np.nan)
                curves.setdefault((plot.title, line.label), []).append(values)

    def banded(plot: Plot, line: Line) -> Line:
        same = curves.get((plot.title, line.label))
        return line._replace(low=np.fmin.reduce(same), high=np.fmax.reduce(same)) if same else line

    plots = [plot._replace(lines=[banded(plot, line) for line in plot.lines]) for plot in page.plots]
    again = f"polish-sim run {first.scenario.experiment} --config {first.name}/{CONFIG}"
    return page._replace(
        title=f"{first.scenario.experiment}, {first.scenario.controller.label}, {len(records)} seeds",
        about="the cell and the curves are the first seed's; bands reach from the least to the largest of "
        "all",
        plots=plots,
        tables={**page.tables, figures.title: figures.lines},
        notes=[*notes, *filter(None, [figures.caption])],
        command=f"{again} --seeds {len(records)}",
    )
