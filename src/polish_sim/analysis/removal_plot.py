"""What a run took off the part, as a picture: a map; runs side by side."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from polish_sim.analysis.inspect_plot import BARE as BARE_COLOUR
from polish_sim.analysis.inspect_plot import write_ply
from polish_sim.analysis.metrics import OVER, UNDER, measure_removal
from polish_sim.analysis.path_plot import SMOOTH, cross_out, scale_flat, seen_triangles
from polish_sim.analysis.run_record import Records, RunRecord, stop_mark
from polish_sim.analysis.style import (
    head,
    new_figure,
    styled,
    views_of,
)
from polish_sim.config import Scenario
from polish_sim.errors import number_text
from polish_sim.log import RemovalMap

MICRO = 1e6
TOP = 2.0  #: Removal over its mean at which the colours end
BARE = "#3A0010"
"""Where nothing was removed."""
SCALE = Normalize(0.0, TOP)
RELATIVE = "removal / its mean (dark: none)"


def removal_colors() -> Colormap:
    """Blue for too little, red for too much, pale in between; one dark colour for nothing at all."""
    return colormaps["RdYlBu_r"].with_extremes(under=BARE)


@styled
def plot_removal(records: Records, path_words: Callable[[Scenario], str]) -> Figure:
    """Draw the removal of one or more runs over the part, seen from above or along its face, each over its
    own mean; ``path_words`` name the path of a run."""
    columns = min(len(records), 4)
    rows = math.ceil(len(records) / columns)
    figure = new_figure(5.4 * columns, 1.0 + 4.4 * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    scale = ScalarMappable(SCALE, removal_colors())
    for record, flat in zip(records, grid, strict=False):
        assert record.removal is not None
        _draw_map(flat, record, record.removal)
        run = f"{record.scenario.controller.label}, {path_words(record.scenario)}"
        run += f" ({record.name})" if len(records) > 1 else ""
        figure.colorbar(scale, ax=flat, shrink=0.75, pad=0.02, extend="both", label=RELATIVE)
        flat.set_title(f"{run}\n{_facts(record.removal)}")
    for flat in grid[len(records) :]:
        flat.set_visible(False)
    head(figure, "Removal", legend=list(grid))
    return figure


def _draw_map(flat: Axes, record: RunRecord, removal: RemovalMap) -> None:
    """The map from the front, under- and overpolished places outlined: both ends of the colours are dark."""
    stop = stop_mark(record.metrics)
    views = views_of(removal.normals, removal.up)
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
        LineCollection(list(views.places(removal.vertices[removal.border])), colors="black", lw=0.8)
    )
    if stop and record.path:
        cross_out(flat, views.places(stop.on_path(record.path)))
    flat.grid(False)
    scale_flat(flat, views)


def _facts(removal: RemovalMap) -> str:
    m = measure_removal(removal)
    if removal.absolute:
        amount = f"mean {MICRO * m['removal_mean_m']:.3g} µm, {1e9 * m['removal_volume_m3']:.3g} mm³"
    else:
        amount = f"pressure x way {number_text(m['exposure_mean_n_m'], 3)} N/m on average"
    return (
        f"{amount}\n"
        f"standard deviation {100.0 * m['removal_cv']:.1f}%, "
        f"untouched: {100.0 * m['unpolished_share']:.2f}%\n"
        f"under {UNDER:g}: {100.0 * m['under_polished_share']:.1f}%, "
        f"over {OVER:g}: {100.0 * m['over_polished_share']:.1f}%"
    )


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
    shades = removal_colors()(SCALE(removal.relative), bytes=True)[:, :3]
    colors = np.where(removal.exposure[:, None] > 0.0, shades, BARE_COLOUR)
    depth = removal.preston_1_pa * removal.exposure
    columns = {"exposure_n_m": removal.exposure, "relative": removal.relative, "removal_m": depth}
    mesh = (removal.vertices, removal.normals, removal.triangles)
    write_ply(file, COMMENT, mesh, colors, columns)
