"""The page of a sweep: parallel coordinates, response curves with bands, worst runs, Pareto front (rows ->
HTML)."""

from __future__ import annotations

import io
import math
import re
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from polish_sim.analysis.claim import Claim, value_text
from polish_sim.analysis.style import BLUE, GREY, ORANGE, new_figure, styled
from polish_sim.arrays import Array
from polish_sim.errors import ConfigError, InputError, count_text, number_text
from polish_sim.experiments.registry import claims_shown, once_more
from polish_sim.page import Table
from polish_sim.page.page import Page
from polish_sim.studies.study import Study, StudyRun
from polish_sim.studies.table import DONE, FAILED, LOST, STOPPED

RunValues = Mapping[str, Sequence[Any]]  #: Values of all runs, by name
WORST = 10  #: Runs that are shown with the command that repeats them
MOST_LINES = 1500  #: Of parallel coordinates
PREFERRED = (
    "force_rms_error_n",
    "settling_time_1n_s",
    "settling_time_3n_s",
    "tracking_error_rms_m",
    "cycle_time_s",
    "overshoot_n",
    "tracking_error_max_m",
    "force_max_deviation_n",
)
"""The figures a front is drawn of, the first two that differ between the runs."""
MOST_BINS = 40  #: More values of a setting than this are put together by twentieths of its range


def sweep_page(study: Study, columns: RunValues) -> Page:
    """The page of a sweep's rows; ``columns`` by name, of runs of this study and of others in its
    folder."""
    outcomes, axes = list(columns["outcome"]), [axis.key for axis in study.axes if axis.key in columns]
    claims = _differing(study, columns)
    goals = [claims[name] for name in PREFERRED if name in claims][:2] or list(claims.values())[:2]
    charts: dict[str, str] = {}
    tables = [figures_table(study, columns)]
    if axes and goals and outcomes:
        shown = [claim for claim in claims.values() if claim not in goals][: 5 - len(goals)]
        charts["All runs"] = _svg(plot_parallel(columns, axes, [*goals, *shown]))
        for claim in [*goals, *shown]:
            charts[f"{claim.label} [{claim.unit}], mean and 10 to 90% of the runs"] = _svg(
                plot_responses(columns, axes, claim)
            )
    if len(goals) == 2:
        front = pareto(columns, axes, goals)
        charts[f"Pareto front: {goals[0].label} and {goals[1].label}, means of the seeds"] = _svg(
            plot_front(front, goals)
        )
        rows = [
            [*map(_word, point), *map(value_text, goals, at.tolist())] for point, at, best in front if best
        ]
        headings = [*axes, *(f"{claim.label} [{claim.unit}]" for claim in goals)]
        tables.append(Table("Pareto front", headings, rows))
    ended = [[word, str(outcomes.count(word))] for word in (DONE, STOPPED, FAILED, LOST)]
    tables += [Table("Ended", ["", "runs"], ended), worst_runs(study, columns, goals)]
    about = f"{count_text(len(outcomes), 'run')} of {study.base.experiment}, {study.base.controller.label}"
    return Page.of(f"sweep: {', '.join(axes) or 'seeds'}", about, tables)._replace(charts=charts)


def figures_table(study: Study, columns: RunValues) -> Table:
    """The figures of the runs that came to their end."""
    rows = []
    for claim in claims_shown([study.base]):
        every = zip(columns.get(claim.figure, ()), columns["outcome"], strict=False)
        values = [float(v) for v, outcome in every if v is not None and outcome == DONE]
        if values:
            shown = (value_text(claim, of(values)) for of in (min, statistics.median, max))
            rows.append([claim.label, claim.unit, *shown])
    headings = ["figure", "unit", "least", "median", "largest"]
    return Table("runs that came to their end", headings, rows, left=2)


def _differing(study: Study, columns: RunValues) -> dict[str, Claim]:
    """The experiment's figures that are not the same in all runs."""
    claims = {claim.figure: claim for claim in claims_shown([study.base]) if claim.figure in columns}
    values = {name: np.array(columns[name], dtype=float) for name in claims}
    return {
        name: claims[name]
        for name, v in values.items()
        if np.isfinite(v).any() and np.nanmax(v) > np.nanmin(v)
    }


def worst_runs(study: Study, columns: RunValues, goals: Sequence[Claim]) -> Table:
    """Runs that failed or stopped, then those with the largest figure, each with the command that repeats
    it."""
    rank = {FAILED: 3.0, LOST: 3.0, STOPPED: 2.0}
    first = np.array(columns[goals[0].figure], dtype=float) if goals else np.zeros(len(columns["outcome"]))
    size = np.nan_to_num(first * (-1.0 if goals and goals[0].more_is_better else 1.0), nan=math.inf)
    order = sorted(range(len(size)), key=lambda k: (-rank.get(columns["outcome"][k], 0.0), -size[k]))
    head, rows = goals[0].label if goals else "figure", []
    for k in order[:WORST]:
        values = tuple(columns[axis.key][k] if axis.key in columns else None for axis in study.axes)
        try:
            scenario = study.scenario(StudyRun(values, columns["seed"][k]))
            command = once_more(scenario)
        except (ConfigError, InputError, ValueError):  # of another study in this folder
            command = "-"
        shown = value_text(goals[0], first[k]) if goals else "-"
        reason = str(columns["reason"][k] or "") if "reason" in columns else ""
        rows.append([columns["outcome"][k], shown, str(columns["seed"][k]), reason, command])
    return Table("Worst runs", ["ended", head, "seed", "reason", "once more, with a page of its own"], rows)


def pareto(
    columns: RunValues, axes: Sequence[str], goals: Sequence[Claim]
) -> list[tuple[tuple[Any, ...], Array, bool]]:
    """Every point's values, the mean of each goal over its seeds, and whether no other is as good in both.

    A point with a run that did not come to its end is left out.
    """
    points: dict[tuple[Any, ...], list[Array]] = {}
    for k, outcome in enumerate(columns["outcome"]):
        values = [columns[claim.figure][k] if outcome == DONE else None for claim in goals]
        key = tuple(columns[axis][k] for axis in axes)
        points.setdefault(key, []).append(np.array(values, dtype=float))
    means = {key: np.mean(rows, axis=0) for key, rows in points.items()}
    known = {key: at for key, at in means.items() if np.isfinite(at).all()}
    signs = np.array([-1.0 if claim.more_is_better else 1.0 for claim in goals])
    costs = np.array([at * signs for at in known.values()]).reshape(-1, len(goals))
    best = [not ((costs <= own).all(axis=1) & (costs < own).any(axis=1)).any() for own in costs]
    return sorted(zip(known, known.values(), best, strict=True), key=lambda point: float(point[1][0]))


# Charts, as SVG.


def _by_log(known: Array) -> bool:
    """Whether values are shown by their logarithm: where they span a decade evenly."""
    low, high = float(known.min()), float(known.max())
    return low > 0.0 and high / low >= 8.0 and bool(np.log(np.median(known) / low) > 0.3 * np.log(high / low))


def _word(value: Any) -> str:
    return number_text(value, 4) if isinstance(value, float) else str(value)


def _svg(figure: Figure) -> str:
    """A figure as it stands in a page, its texts as texts."""
    content = io.StringIO()
    with rc_context({"svg.fonttype": "none"}):
        figure.savefig(content, format="svg")
    drawn = content.getvalue()
    # Without a size of its own it is as wide as the page.
    return re.sub(r' (width|height)="[\d.]+pt"', "", drawn[drawn.index("<svg") :], count=2)


def _places(values: Sequence[Any], unit: float = 1.0) -> tuple[Array, list[tuple[float, str]]]:
    """Where values stand on an axis from 0 to 1, NaN where there is none, and its ticks."""
    if any(isinstance(v, bool) or not isinstance(v, (int, float)) for v in values if v is not None):
        words = sorted({_word(v) for v in values if v is not None})
        last = max(1, len(words) - 1)
        at = [math.nan if v is None else words.index(_word(v)) / last for v in values]
        return np.array(at), [(k / last, word) for k, word in enumerate(words)]
    numbers = np.array(values, dtype=float)
    found = np.unique(numbers[np.isfinite(numbers)])
    log = _by_log(found)
    bent, ends = (np.log(numbers), np.log(found[[0, -1]])) if log else (numbers, found[[0, -1]])
    ticks = found if len(found) <= 6 else (np.geomspace if log else np.linspace)(found[0], found[-1], 5)
    span = float(np.ptp(ends)) or 1.0
    shares = ((np.log(ticks) if log else ticks) - ends[0]) / span
    return (bent - ends[0]) / span, [
        (float(s), number_text(float(v * unit), 3)) for s, v in zip(shares, ticks, strict=True)
    ]


@styled
def plot_parallel(columns: RunValues, axes: Sequence[str], claims: Sequence[Claim]) -> Figure:
    """Every run as a line across settings and figures, coloured by the first figure."""
    columns_shown = [(axis, columns[axis], 1.0) for axis in axes]
    columns_shown += [(f"{c.label} [{c.unit}]", columns[c.figure], c.scale) for c in claims]
    figure = new_figure(11.0, 4.0)
    plot = figure.add_subplot()
    placed = [_places(values, unit) for _, values, unit in columns_shown]
    at = np.stack([places for places, _ in placed], axis=1)
    at = at[:: max(1, len(at) // MOST_LINES)]
    across = np.broadcast_to(np.arange(at.shape[1]), at.shape)
    lines = LineCollection(
        list(np.stack([across, at], axis=2)),
        array=at[:, len(axes)],
        cmap="viridis",
        lw=1.0,
        alpha=max(0.15, 1.0 - len(at) / 300),
    )
    plot.add_collection(lines)
    for place, (_, ticks) in enumerate(placed):
        plot.axvline(place, color=GREY, lw=1.0)
        for share, word in ticks:
            plot.annotate(
                word,
                (place, share),
                (-3, 0),
                textcoords="offset points",
                ha="right",
                va="center",
                fontsize=8.0,
                bbox={"fc": "white", "ec": "none", "pad": 1.0, "alpha": 0.8},
            )
    plot.set(xlim=(-0.3, at.shape[1] - 0.9), ylim=(-0.05, 1.05), yticks=[])
    plot.set_xticks(range(at.shape[1]), [name for name, _, _ in columns_shown], rotation=12, ha="right")
    plot.grid(visible=False)
    return figure


@styled
def plot_responses(columns: RunValues, axes: Sequence[str], claim: Claim) -> Figure:
    """A figure over each setting: the mean of all other settings and seeds, with a band from 10 to 90%."""
    values = claim.scale * np.array(columns[claim.figure], dtype=float)
    known = np.isfinite(values)
    figure = new_figure(11.0, 3.2)
    panels = figure.subplots(1, len(axes), sharey=True, squeeze=False)[0]
    for plot, axis in zip(panels, axes, strict=True):
        at, ticks = _places(columns[axis])
        at = at if len(np.unique(at)) <= MOST_BINS else np.round(20.0 * at) / 20.0
        places = np.unique(at[known])
        bins = [values[known & (at == place)] for place in places]
        low, high = (np.array([np.quantile(own, share) for own in bins]) for share in (0.1, 0.9))
        plot.fill_between(places, low, high, color=BLUE, alpha=0.2, lw=0)
        plot.plot(places, [own.mean() for own in bins], "o-", color=BLUE, ms=4)
        plot.set_xticks([share for share, _ in ticks], [word for _, word in ticks])
        plot.set(xlabel=axis)
    low, high = np.quantile(values[known], (0.02, 0.98))
    panels[0].set(
        ylabel=f"{claim.label} [{claim.unit}]", ylim=(low - 0.1 * (high - low), high + 0.1 * (high - low))
    )
    return figure


@styled
def plot_front(front: Sequence[tuple[tuple[Any, ...], Array, bool]], goals: Sequence[Claim]) -> Figure:
    """Points by two figures, those of the front joined by a line and named."""
    figure = new_figure(11.0, 4.0)
    plot = figure.add_subplot()
    scales = [claim.scale for claim in goals]
    for best, color in ((False, GREY), (True, ORANGE)):
        at = np.array([scales * point for _, point, own in front if own == best]).reshape(-1, 2)
        plot.plot(*at.T, "o-" if best else "o", color=color, ms=5)
    for values, point, best in front:
        if best:
            name = ", ".join(map(_word, values))
            plot.annotate(
                name,
                (scales[0] * point[0], scales[1] * point[1]),
                (5, 5),
                textcoords="offset points",
                fontsize=8.0,
            )
    plot.set(**{f"{x}label": f"{claim.label} [{claim.unit}]" for x, claim in zip("xy", goals, strict=True)})
    return figure
