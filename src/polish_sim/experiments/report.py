"""The pictures of runs, as their experiment has them, drawn and saved; and where a part may stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from scipy.spatial import ConvexHull

from polish_sim.analysis.claim import Claim, shortfalls
from polish_sim.analysis.run_record import RunRecord, stop_mark
from polish_sim.analysis.style import ORANGE, add_line, head, new_figure, say_stop, styled
from polish_sim.arrays import Array
from polish_sim.cell.scene import TABLE
from polish_sim.errors import InputError
from polish_sim.experiments.reach_map import DISTANCES, HEIGHTS, TURNS, ReachMap
from polish_sim.experiments.registry import experiment, load, path_words
from polish_sim.geometry import PartMesh
from polish_sim.page import save_page
from polish_sim.spatial import apply

if TYPE_CHECKING:
    pass


def draw_plots(record: RunRecord) -> dict[str, Figure]:
    """Draw the pictures of a run, by file name; a run without a row has none."""
    if not len(record.log):
        return {}
    plots = _drawn(experiment(record.scenario.experiment).plots(record), record)
    plots |= _removal("plot_removal", record) if removed_something(record) else {}
    stop = stop_mark(record.metrics)
    if stop is not None:
        for figure in plots.values():
            say_stop(figure, stop.text)
    return plots


def draw_comparison(records: Sequence[RunRecord]) -> dict[str, Figure]:
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
    return plots | _removal("plot_removal_runs", records) if all(map(removed_something, records)) else plots


#: They choose the worst seed
WORST_BY = ("force_max_deviation_n", "tracking_error_max_m", "overshoot_n")


def draw_seeds(records: Sequence[RunRecord]) -> dict[str, Figure]:
    """Draw the pictures of many seeds of one scenario, by file name: their figures, all of them or the worst
    one."""
    from polish_sim.analysis.run_plots import plot_seeds

    scenario = records[0].scenario
    row = experiment(scenario.experiment)
    claims = row.claims(scenario)
    plots = {"seeds.png": plot_seeds(records, claims), **_drawn(row.seeds_plots, records)}
    if row.seeds_plots:
        return plots
    worst = max(records, key=lambda record: _badness(record, claims))
    for figure in list(draw_plots(worst).values())[:1]:
        add_line(figure, f"seed {worst.scenario.seed}, the worst of {len(records)}")
        plots["worst_seed.png"] = figure
    return plots


def _badness(record: RunRecord, claims: Sequence[Claim]) -> tuple[float, ...]:
    """How many figures fall short of what is asked, then the errors by size."""
    errors = [np.max(record.metrics.get(name) or 0.0) for name in WORST_BY]
    return len(shortfalls(claims, record.metrics)), *map(float, errors)


def write_page(folder: Path, record: RunRecord, model: Any, notes: Sequence[str] = ()) -> None:
    """Write a run as a page for the browser; ``model`` is MuJoCo's of its cell, None: it is set up again if
    it can be.

    A run without a row has no page.
    """
    from polish_sim.experiments.run_page import run_page

    if model is None:
        from polish_sim.experiments.compared_page import cell_model, remade

        model = cell_model(record) if remade(record) else None
    if model is not None and len(record.log):
        save_page(folder, run_page(record, model, notes))


def write_saved_page(folder: Path, sources: Sequence[Path], records: Sequence[RunRecord]) -> None:
    """Write the page of a saved run, or of several of one experiment over each other, if all have something
    to show."""
    from polish_sim.experiments.compared_page import pages_over, saved_page

    pages = [saved_page(source, record) for source, record in zip(sources, records, strict=True)]
    known = [page for page in pages if page is not None]
    if len(known) == len(pages):
        save_page(folder, known[0] if len(known) == 1 else pages_over(records, known))


def write_seeds_page(
    folder: Path, records: Sequence[RunRecord], columns: Mapping[str, Mapping[str, Any]]
) -> None:
    """Write the page of many seeds of one scenario with one robot; ``columns`` are figures by heading."""
    from polish_sim.experiments.compared_page import remade, seeds_page

    if all(map(remade, records)):
        save_page(folder, seeds_page(records, columns))


def removed_something(record: RunRecord) -> bool:
    """Whether a run has a map of its removal, and removed anything."""
    return record.removal is not None and record.removal.mean > 0.0


def _drawn(plots: Mapping[str, str], runs: Any) -> dict[str, Figure]:
    """The pictures that have something to show."""
    return {name: figure for name, plot in plots.items() if (figure := load(plot)(runs)) is not None}


def _removal(plot: str, runs: Any) -> dict[str, Figure]:
    return {"removal.png": load(f"polish_sim.analysis.removal_plot:{plot}")(runs, path_words)}


# The reach map: where the part may stand about the robot, and how it may be turned there.

MM = 1e3


@styled
def plot_reach_map(found: ReachMap, mesh: PartMesh, T_base_work: Array | None) -> Figure:
    """Draw how well the arm does a path by where the part stands; ``T_base_work`` (4, 4): the pose taken, if
    any."""
    by_turn = found.values.max(axis=3)
    if T_base_work is None:
        height = int(by_turn.max(axis=(1, 2)).argmax())
    else:
        stands = float(apply(T_base_work, mesh.vertices)[:, 2].min())
        height = int(np.abs(HEIGHTS - stands).argmin())
    figure = new_figure(12.0, 5.2)
    above, turns = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    shown: dict[str, Any] = {
        "vmin": 0.0,
        "vmax": float(by_turn.max()) or 1.0,
        "cmap": "viridis",
        "shading": "nearest",
    }
    best = np.where(by_turn[height] > 0.0, by_turn[height], np.nan)
    about = np.radians(np.arange(0.0, 361.0, 5.0))
    x, y = (MM * np.outer(DISTANCES, direction(about)) for direction in (np.sin, np.cos))
    around = np.repeat(np.max(np.nan_to_num(best), axis=1)[:, None], len(about), axis=1)
    above.pcolormesh(x, y, np.where(around > 0.0, around, np.nan), **{**shown, "shading": "gouraud"})
    corner, size = MM * (TABLE.middle - TABLE.half)[:2], 2.0 * MM * TABLE.half[:2]
    above.add_patch(Rectangle((corner[0], corner[1]), *size, fill=False, lw=1.5, label="table"))
    above.add_patch(Circle((0.0, 0.0), 75.0, color="0.4", label="robot"))
    drawn = turns.pcolormesh(np.degrees(TURNS), MM * DISTANCES, best, **shown)
    if T_base_work is not None:
        corners = MM * apply(T_base_work, mesh.vertices)[:, :2]
        above.fill(
            *corners[ConvexHull(corners, qhull_options="QJ").vertices].T,
            color=ORANGE,
            alpha=0.8,
            label="part",
        )
        turn = T_base_work[:3, :3] @ found.R_up.T
        middle = T_base_work[:3, 3] + turn @ found.middle
        angle = np.degrees(np.arctan2(turn[1, 0], turn[0, 0]) + np.arctan2(middle[0], -middle[1])) % 360.0
        turns.plot(angle, MM * np.hypot(*middle[:2]), "o", color=ORANGE, ms=9, mec="white", label="as placed")
    above.set(xlabel="x of the base [mm]", ylabel="y of the base [mm]", aspect="equal")
    above.set_title("middle of the path, best turn of the part", fontsize=9.0)
    turns.set(
        xlabel="turn of the part about the vertical [deg]",
        ylabel="middle of the path from the base axis [mm]",
    )
    turns.set_title("in front of the robot", fontsize=9.0)
    figure.colorbar(drawn, ax=turns, label="least manipulability along the path [m$^3$]")
    head(
        figure,
        f"Reach map of {mesh.name}, part {MM * HEIGHTS[height]:.0f} mm above the table",
        legend=(above, turns),
    )
    return figure
