"""The page of a sweep: parallel coordinates, response curves with bands, worst runs, Pareto front (rows -> HTML)."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from polish_sim.analysis.claim import Claim
from polish_sim.analysis.run_record import once_more
from polish_sim.arrays import Array
from polish_sim.errors import ConfigError, InputError, count_text, number_text
from polish_sim.experiments.registry import claims_shown, default_scenario
from polish_sim.page.page import page_html, tables_page
from polish_sim.studies.study import Run, Study
from polish_sim.studies.table import DONE, FAILED, LOST, STOPPED

WORST: Final = 10  #: Runs that are shown with the command that repeats them
MOST_LINES: Final = 1500  #: Of parallel coordinates
PREFERRED: Final = (
    *("force_rms_error_n", "settling_time_1n_s", "settling_time_3n_s", "tracking_error_rms_m"),
    *("cycle_time_s", "overshoot_n", "tracking_error_max_m", "force_max_deviation_n"),
)
"""The figures a front is drawn of, the first two that differ between the runs."""
WIDE, HIGH, LEFT, FOOT = 900, 300, 60, 34  #: Of a chart, its margin on the left and below


class Scale(NamedTuple):
    """An axis of a chart: a number's or a word's place on it, 0 to 1."""

    label: str
    ticks: Sequence[tuple[float, str]]
    share: Callable[[Any], float]


def sweep_page(study: Study, columns: Mapping[str, Sequence[Any]]) -> str:
    """The page of a sweep's rows as HTML; ``columns`` by name, of runs of this study and of others in its folder."""
    outcomes, axes = list(columns["outcome"]), [axis.key for axis in study.axes if axis.key in columns]
    claims = _differing(study, columns)
    goals = [claims[name] for name in PREFERRED if name in claims][:2] or list(claims.values())[:2]
    charts: dict[str, str] = {}
    tables: dict[str, Sequence[Sequence[str]]] = {}
    if axes and goals and outcomes:
        shown = [claim for claim in claims.values() if claim not in goals][: 5 - len(goals)]
        charts["All runs"] = parallel(columns, axes, [*goals, *shown])
        for claim in [*goals, *shown]:
            charts[f"{claim.label} [{claim.unit}], mean and 10 to 90% of the runs"] = responses(columns, axes, claim)
    if len(goals) == 2:
        front = pareto(columns, axes, goals)
        charts[f"Pareto front: {goals[0].label} and {goals[1].label}, means of the seeds"] = front_chart(front, goals)
        tables["Pareto front"] = [[*axes, *(f"{claim.label} [{claim.unit}]" for claim in goals)]] + [
            [*map(_word, point), *(number_text(value * claim.scale, 4) for value, claim in zip(at, goals, strict=True))]
            for point, at, best in front
            if best
        ]
    tables["Ended"] = [["", "runs"], *([word, str(outcomes.count(word))] for word in (DONE, STOPPED, FAILED, LOST))]
    tables["Worst runs"] = worst_runs(study, columns, goals)
    about = f"{count_text(len(outcomes), 'run')} of {study.base.experiment}, {study.base.controller.label}"
    return page_html(tables_page(f"sweep: {', '.join(axes) or 'seeds'}", about, tables, [], charts))


def _differing(study: Study, columns: Mapping[str, Sequence[Any]]) -> dict[str, Claim]:
    """The experiment's figures that are not the same in all runs."""
    claims = {claim.figure: claim for claim in claims_shown([study.base]) if claim.figure in columns}
    values = {name: _numbers(columns[name]) for name in claims}
    return {name: claims[name] for name, v in values.items() if np.isfinite(v).any() and np.nanmax(v) > np.nanmin(v)}


def _numbers(values: Sequence[Any]) -> Array:
    return np.array([math.nan if value is None else float(value) for value in values])


def worst_runs(study: Study, columns: Mapping[str, Sequence[Any]], goals: Sequence[Claim]) -> list[Sequence[str]]:
    """Runs that failed or stopped, then those with the largest figure, each with the command that repeats it."""
    rank = {FAILED: 3.0, LOST: 3.0, STOPPED: 2.0}
    first = _numbers(columns[goals[0].figure]) if goals else np.zeros(len(columns["outcome"]))
    size = np.nan_to_num(first * (-1.0 if goals and goals[0].more_is_better else 1.0), nan=math.inf)
    order = sorted(range(len(size)), key=lambda k: (-rank.get(columns["outcome"][k], 0.0), -size[k]))
    head = goals[0].label if goals else "figure"
    rows: list[Sequence[str]] = [["ended", head, "seed", "reason", "once more, with a page of its own"]]
    for k in order[:WORST]:
        values = tuple(columns[axis.key][k] if axis.key in columns else None for axis in study.axes)
        try:
            scenario = study.scenario(Run(values, columns["seed"][k]))
            command = once_more(scenario, default_scenario(scenario.experiment))
        except (ConfigError, InputError):  # of another study in this folder
            command = "-"
        shown = number_text(first[k] * goals[0].scale, 4) if goals and np.isfinite(first[k]) else "-"
        reason = str(columns["reason"][k] or "") if "reason" in columns else ""
        rows.append([columns["outcome"][k], shown, str(columns["seed"][k]), reason, command])
    return rows


def pareto(
    columns: Mapping[str, Sequence[Any]], axes: Sequence[str], goals: Sequence[Claim]
) -> list[tuple[tuple[Any, ...], Array, bool]]:
    """Every point's values, the mean of each goal over its seeds, and whether no other is as good in both.

    A point with a run that did not come to its end is left out.
    """
    points: dict[tuple[Any, ...], list[list[float]]] = {}
    for k, outcome in enumerate(columns["outcome"]):
        values = [columns[claim.figure][k] for claim in goals]
        good = outcome == DONE and all(value is not None for value in values)
        key = tuple(columns[axis][k] for axis in axes)
        points.setdefault(key, []).append([float(v) for v in values] if good else [math.nan] * len(goals))
    means = {key: np.mean(rows, axis=0) for key, rows in points.items()}
    known = {key: at for key, at in means.items() if np.isfinite(at).all()}
    signs = np.array([-1.0 if claim.more_is_better else 1.0 for claim in goals])
    costs = np.array([at * signs for at in known.values()]).reshape(-1, len(goals))
    best = [not ((costs <= own).all(axis=1) & (costs < own).any(axis=1)).any() for own in costs]
    return sorted(zip(known, known.values(), best, strict=True), key=lambda point: float(point[1][0]))


# Charts, as SVG.


def _scale(label: str, values: Sequence[Any], unit: float = 1.0) -> Scale:
    """The axis of some values: by number, by logarithm where they span a decade evenly, or word by word."""
    known = [value for value in values if value is not None]
    if not all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in known) or not known:
        words = sorted({_word(v) for v in known})
        last = max(1, len(words) - 1)
        return Scale(label, [(k / last, w) for k, w in enumerate(words)], lambda v: words.index(_word(v)) / last)
    found = np.unique(np.array(known, dtype=float))
    low, high = float(found[0]), float(found[-1])
    log = low > 0.0 and high / low >= 8.0 and np.log(np.median(found) / low) > 0.3 * np.log(high / low)

    def bend(v: float) -> float:
        return math.log(max(v, 1e-300)) if log else float(v)

    start, span = bend(low), (bend(high) - bend(low)) or 1.0
    steps = found if len(found) <= 6 else (np.geomspace if log else np.linspace)(low, high, 5)
    ticks = [((bend(v) - start) / span, number_text(float(v * unit), 3)) for v in steps]
    return Scale(label, ticks, lambda v: (bend(v) - start) / span)


def _word(value: Any) -> str:
    return number_text(value, 4) if isinstance(value, float) else str(value)


def _svg(content: Sequence[str]) -> str:
    return f'<svg viewBox="0 0 {WIDE} {HIGH}" role="img">{"".join(content)}</svg>'


def _text(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{html.escape(text)}</text>'


def _line(points: Sequence[tuple[float, float]], style: str) -> str:
    return f'<polyline points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}" fill="none" style="{style}"/>'


def _dot(x: float, y: float, color: str, words: str = "") -> str:
    title = f"<title>{html.escape(words)}</title>" if words else ""
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" style="fill:var({color})">{title}</circle>'


def parallel(columns: Mapping[str, Sequence[Any]], axes: Sequence[str], claims: Sequence[Claim]) -> str:
    """Every run as a line across settings and figures, coloured by the first figure."""
    scales = [_scale(axis, columns[axis]) for axis in axes]
    scales += [_scale(f"{c.label} [{c.unit}]", columns[c.figure], c.scale) for c in claims]
    names = [*axes, *(claim.figure for claim in claims)]
    gap = (WIDE - 2 * LEFT) / max(1, len(names) - 1)
    base, top = HIGH - FOOT, 24
    content: list[str] = []
    rows = range(0, len(columns[names[0]]), max(1, len(columns[names[0]]) // MOST_LINES))
    for k in rows:
        points = [
            (LEFT + gap * place, base - (base - top) * scale.share(columns[name][k]))
            for place, (name, scale) in enumerate(zip(names, scales, strict=True))
            if columns[name][k] is not None
        ]
        goal = columns[claims[0].figure][k]
        share = 1.0 if goal is None else scales[len(axes)].share(goal)
        color = f"color-mix(in oklab, var(--c1) {100.0 * share:.0f}%, var(--c0))"
        content.append(_line(points, f"stroke:{color};stroke-width:1;opacity:{max(0.15, 1.0 - len(rows) / 300):.2f}"))
    for place, scale in enumerate(scales):
        x = LEFT + gap * place
        content.append(_line([(x, top), (x, base)], "stroke:var(--ink)"))
        content += [_text(x - 4, base - (base - top) * at + 4, word, "end") for at, word in scale.ticks]
        side = "start" if place == 0 else "end" if place == len(scales) - 1 else "middle"
        content.append(_text(x, HIGH - 14 + 12 * (place % 2), scale.label, side))
    return _svg(content)


def responses(columns: Mapping[str, Sequence[Any]], axes: Sequence[str], claim: Claim) -> str:
    """A figure over each setting: the mean of all other settings and seeds, with a band from 10 to 90%."""
    values = _numbers(columns[claim.figure])
    known = values[np.isfinite(values)]
    upright = _scale("", [float(np.quantile(known, 0.02)), float(np.quantile(known, 0.98))], claim.scale)
    gap, base, top = (WIDE - LEFT) / len(axes), HIGH - FOOT, 10
    content = [_text(LEFT - 8, base - (base - top) * at + 4, word, "end") for at, word in upright.ticks]
    for number, axis in enumerate(axes):
        scale, left = _scale(axis, columns[axis]), LEFT + gap * number
        wide = gap - 30
        bins: dict[float, list[float]] = {}
        for at, value in zip(columns[axis], values, strict=True):
            if at is not None and math.isfinite(value):
                share = scale.share(at)
                bins.setdefault(share if len(set(columns[axis])) <= 40 else round(20 * share) / 20, []).append(value)
        places = sorted(bins)
        x = [left + wide * place for place in places]
        ends = [np.quantile(bins[place], (0.1, 0.9)) for place in places]
        y = [_height(upright, float(np.mean(bins[place])), base, top) for place in places]
        low, high = ([_height(upright, float(pair[k]), base, top) for pair in ends] for k in (0, 1))
        curve, upper, lower = (list(zip(x, heights, strict=True)) for heights in (y, high, low))
        band = " ".join(f"{a:.1f},{b:.1f}" for a, b in [*lower, *upper[::-1]])
        content.append(f'<polygon points="{band}" style="fill:var(--band)"/>')
        content.append(_line(curve, "stroke:var(--c0);stroke-width:2"))
        content += [_dot(a, b, "--c0") for a, b in curve]
        content.append(_line([(left, base), (left + wide, base)], "stroke:var(--rule)"))
        content += [_text(left + wide * at, base + 14, word) for at, word in scale.ticks]
        content.append(_text(left + 0.5 * wide, HIGH - 4, axis))
    return _svg(content)


def _height(scale: Scale, value: float, base: float, top: float) -> float:
    """Where a value stands, kept within the chart."""
    return base - (base - top) * min(1.02, max(-0.02, scale.share(value)))


def front_chart(front: Sequence[tuple[tuple[Any, ...], Array, bool]], goals: Sequence[Claim]) -> str:
    """Points by two figures, those of the front joined by a line."""
    if not front:
        return _svg([_text(WIDE / 2, HIGH / 2, "no point whose runs all came to their end")])
    across, up = (_scale(g.label, [float(at[k]) for _, at, _ in front], g.scale) for k, g in enumerate(goals))
    base, top, wide = HIGH - FOOT, 10, WIDE - LEFT - 20
    at = [(LEFT + wide * across.share(p[0]), base - (base - top) * up.share(p[1])) for _, p, _ in front]
    front_line = [xy for xy, (_, _, best) in zip(at, front, strict=True) if best]
    content = [_line(front_line, "stroke:var(--c1);stroke-width:2")]
    for (x, y), (values, _, best) in zip(at, front, strict=True):
        content.append(_dot(x, y, "--c1" if best else "--soft", ", ".join(map(_word, values))))
    content += [_text(LEFT + wide * t, base + 14, word) for t, word in across.ticks[::2]]
    content += [_text(LEFT - 8, base - (base - top) * t + 4, word, "end") for t, word in up.ticks[::2]]
    named = f"{goals[0].label} [{goals[0].unit}], upright: {goals[1].label} [{goals[1].unit}]"
    return _svg([*content, _text(LEFT + wide / 2, HIGH - 4, named)])
