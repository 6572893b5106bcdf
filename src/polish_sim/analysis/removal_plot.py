"""What a run took off the part, as a picture: a map and its distribution; runs side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from polish_sim.analysis.claim import figure_of
from polish_sim.analysis.inspect_plot import BARE as BARE_COLOUR
from polish_sim.analysis.inspect_plot import write_ply
from polish_sim.analysis.metrics import OVER, UNDER, measure_removal
from polish_sim.analysis.path_plot import SMOOTH, cross_out, scale_flat, seen_triangles
from polish_sim.analysis.run_record import Records, stop_mark
from polish_sim.analysis.style import (
    BLUE,
    GREY,
    ORANGE,
    SERIES,
    Views,
    head,
    line_look,
    new_figure,
    small_title,
    styled,
    views_of,
)
from polish_sim.arrays import Array, midpoints
from polish_sim.errors import number_text

if TYPE_CHECKING:
    from polish_sim.analysis.run_record import RunRecord
    from polish_sim.config import Scenario
    from polish_sim.log import RemovalMap

MM, MICRO = 1e3, 1e6
TOP = 2.0  #: Removal over its mean at which the colours end
BARE = "#3A0010"
"""Where nothing was removed."""
SCALE = Normalize(0.0, TOP)
BINS = 80
RELATIVE, PER_TENTH = "removal / its mean", "share of the area per 0.1 [%]"


def removal_colors() -> Colormap:
    """Blue for too little, red for too much, pale in between; one dark colour for nothing at all."""
    return colormaps["RdYlBu_r"].with_extremes(under=BARE)


@styled
def plot_removal(record: RunRecord, path_words: Callable[[Scenario], str]) -> Figure:
    """Draw a run's removal over the part, seen from above or along its face, and how the area is shared out;
    ``path_words`` name the path of a run."""
    removal = _of(record)
    views = views_of(removal.normals, removal.up)
    figure = new_figure(10.5, 5.0)
    flat, share = figure.subplots(1, 2)
    _draw_flat(flat, removal, views)
    stop = stop_mark(record.metrics)
    if stop and record.path is not None:
        cross_out(flat, (views.flat @ stop.on_path(record.path))[:2] * MM)
    _color_bar(figure, flat, removal)
    _draw_shares(share, removal)
    title = f"Removal, {record.scenario.controller.label}, {path_words(record.scenario)}"
    head(figure, title, [*_facts(record), f"seen {views.name}"], legend=(flat,))
    return figure


@styled
def plot_removal_runs(records: Records, path_words: Callable[[Scenario], str]) -> Figure:
    """Draw the removal of several runs from above, each over its own mean, and their distributions over each
    other; ``path_words`` as of ``plot_removal``."""
    columns = min(len(records), 4)
    rows = math.ceil(len(records) / columns)
    figure = new_figure(3.4 * columns + 4.4, 0.5 + 3.9 * rows)
    parts: Any = figure.subfigures(1, 2, width_ratios=(3.4 * columns + 0.6, 3.8))
    maps, side = parts
    grid = maps.subplots(rows, columns, squeeze=False).ravel()
    share = side.subplots()
    for index, (record, flat) in enumerate(zip(records, grid, strict=False)):
        removal = _of(record)
        color = SERIES[index % len(SERIES)]
        _draw_flat(flat, removal, views_of(removal.normals, removal.up))
        run = f"{record.scenario.controller.label}, {path_words(record.scenario)} ({record.name})"
        flat.set_title(f"{run}\n{_spread(removal)}", fontsize=9.0, color=color)
        edges, shares = _histogram(removal)
        share.plot(midpoints(edges), shares, **line_look(index))
        if index % columns:
            flat.set_ylabel("")
    for flat in grid[len(records) :]:
        flat.set_visible(False)
    bar = maps.colorbar(
        ScalarMappable(SCALE, removal_colors()), ax=list(grid), shrink=0.8, pad=0.02, extend="max"
    )
    bar.set_label(RELATIVE)
    _mark_bands(share)
    small_title(share, "colours as over the maps")
    share.set(xlabel=RELATIVE, ylabel=PER_TENTH, xlim=(0.0, TOP + 0.5), ylim=(0.0, None))
    head(figure, "Removal, side by side")
    return figure


def _of(record: RunRecord) -> RemovalMap:
    assert record.removal is not None
    return record.removal


def _draw_flat(flat: Axes, removal: RemovalMap, views: Views) -> None:
    """The map from the front, under- and overpolished places outlined: both ends of the colours are dark."""
    seen = seen_triangles(removal.vertices, removal.normals, removal.triangles, views)
    # What was not touched at all lies below the scale.
    shown = np.where(removal.exposure > 0.0, removal.relative, -1.0)
    flat.tripcolor(seen, shown, norm=SCALE, cmap=removal_colors(), **SMOOTH)
    for level, dashes in ((UNDER, ":"), (OVER, "-")):
        if removal.relative.min() < level < removal.relative.max():
            flat.tricontour(
                seen, removal.relative, levels=[level], colors="black", linewidths=0.7, linestyles=dashes
            )
            flat.plot([], [], color="black", lw=0.7, ls=dashes, label=f"{level:g} times the mean")
    flat.add_collection(
        LineCollection(
            list((removal.vertices[removal.border] @ views.flat.T * MM)[..., :2]), colors="black", lw=0.8
        )
    )
    flat.grid(False)
    scale_flat(flat, views)


def _color_bar(figure: Figure, axes: Axes, removal: RemovalMap) -> None:
    mappable = ScalarMappable(SCALE, removal_colors())
    bar = figure.colorbar(
        mappable, ax=axes, shrink=0.85, pad=0.02, extend="both" if _bare(removal) else "max"
    )
    if not removal.absolute:
        bar.set_label(f"{RELATIVE} (dark: none)" if _bare(removal) else RELATIVE)
        return
    depth = MICRO * removal.preston_1_pa * removal.mean
    bar.set_label("removal [µm] (dark: none)" if _bare(removal) else "removal [µm]")
    ticks = np.linspace(0.0, TOP, 9)
    bar.set_ticks(ticks.tolist(), labels=[f"{depth * tick:.3g}" for tick in ticks])


def _bare(removal: RemovalMap) -> bool:
    return bool((removal.exposure <= 0.0).any())


def _draw_shares(axes: Axes, removal: RemovalMap) -> None:
    m = measure_removal(removal)
    edges, shares = _histogram(removal)
    axes.stairs(shares, edges, fill=True, color=GREY, alpha=0.75)
    _mark_bands(axes)
    top = 1.25 * shares.max(initial=1e-9)
    for x, share, color, text in (
        (0.5 * UNDER, m["under_polished_share"], BLUE, f"under {UNDER:g}"),
        (OVER + 0.5 * (TOP - OVER), m["over_polished_share"], ORANGE, f"over {OVER:g}"),
    ):
        axes.text(
            x, 0.97 * top, f"{text}\n{100.0 * share:.1f}%", color=color, ha="center", va="top", fontsize=9.5
        )
    for name, side in (("p5", "right"), ("p95", "left")):
        axes.axvline(m[f"removal_{name}"], color=GREY, lw=1.0, ls=":")
        if UNDER <= m[f"removal_{name}"] <= TOP:  # elsewhere its name would lie beside the axes
            axes.text(
                m[f"removal_{name}"], 0.7 * top, f" {name} {m[f'removal_{name}']:.2f} ", ha=side, color=GREY
            )
    label = f"{RELATIVE}, the untouched {_untouched(m)} left out" if _bare(removal) else RELATIVE
    axes.set(xlabel=label, ylabel=PER_TENTH, xlim=(0.0, TOP + 0.25), ylim=(0.0, top))


def _mark_bands(axes: Axes) -> None:
    axes.axvspan(0.0, UNDER, color=BLUE, alpha=0.12, lw=0, zorder=0)
    axes.axvspan(OVER, 100.0, color=ORANGE, alpha=0.12, lw=0, zorder=0)
    axes.axvline(1.0, color=GREY, lw=1.0, ls="--")


def _histogram(removal: RemovalMap) -> tuple[Array, Array]:
    """Edges of classes of removal over its mean, and the share of the area in each per 0.1 [%].

    What was not touched at all would be one spike as high as the classes are narrow: it is in none of them.
    """
    edges = np.linspace(0.0, TOP + 0.5, BINS + 1)
    found, _ = np.histogram(
        removal.relative, edges, weights=np.where(removal.exposure > 0.0, removal.areas, 0.0)
    )
    return edges, 100.0 * found / removal.areas.sum() * 0.1 / (edges[1] - edges[0])


def _spread(removal: RemovalMap) -> str:
    m = measure_removal(removal)
    spread = (
        f"std {100.0 * m['removal_cv']:.0f}%, under {100.0 * m['under_polished_share']:.1f}%, "
        f"over {100.0 * m['over_polished_share']:.1f}%"
    )
    return f"{spread}\nuntouched {_untouched(m)}, not in the curve" if _bare(removal) else spread


def _facts(record: RunRecord) -> tuple[str, ...]:
    removal = _of(record)
    m = measure_removal(removal)
    if removal.absolute:
        amount = f"mean {MICRO * m['removal_mean_m']:.3g} µm, {1e9 * m['removal_volume_m3']:.3g} mm³"
    else:
        amount = f"pressure x way {number_text(m['exposure_mean_n_m'], 3)} N/m on average"
    untouched = f"untouched on the part as it is: {_untouched(m)} of the area"
    covered = figure_of(record.metrics, "coverage")
    if not math.isnan(covered):
        untouched += f" (beside the pad's disc on the drawing: {100.0 * (1.0 - covered):.2f}%)"
    return amount, f"standard deviation {100.0 * m['removal_cv']:.1f}% of the mean", untouched


def _untouched(m: Mapping[str, float]) -> str:
    return f"{100.0 * m['unpolished_share']:.2f}%"


# What a run took off the part as a coloured mesh with the exposure at every vertex (RemovalMap ->
# removal.ply).

REMOVAL_MESH = "removal.ply"
COMMENT = (
    "lengths in mm; exposure_n_m: pressure x sliding speed x time in N/m; relative: over its mean; "
    "removal_m: depth taken off, 0 without a wear coefficient"
)


def write_removal_mesh(file: Path, removal: RemovalMap) -> None:
    """Write the region as binary PLY: x, y, z in mm, colour, and per vertex exposure_n_m, relative and
    removal_m."""
    colors = removal_colors()(SCALE(removal.relative), bytes=True)[:, :3].copy()
    colors[removal.exposure <= 0.0] = BARE_COLOUR
    depth = removal.preston_1_pa * removal.exposure
    columns = {"exposure_n_m": removal.exposure, "relative": removal.relative, "removal_m": depth}
    mesh = (removal.vertices, removal.normals, removal.triangles)
    write_ply(file, COMMENT, mesh, colors, columns)
