"""An inspected path as a picture: maps of the region from above, of time under the pad and of coverage."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from polish_sim.analysis.path_plot import SMOOTH, scale_flat, seen_triangles
from polish_sim.analysis.style import (
    GREY,
    ORANGE,
    PINK,
    Views,
    head,
    new_figure,
    styled,
    views_of,
)
from polish_sim.arrays import Array, Indices

if TYPE_CHECKING:
    from polish_sim.planning import Inspection

# An inspected region as a coloured mesh with the time under the pad at every vertex (Inspection ->
# coverage.ply).


BARE = (213, 94, 0)  #: Colour of places it never reaches

COMMENT = "lengths in mm; exposure_s: seconds under the pad; strict: within 0.55 step-overs of the path"


def write_coverage_mesh(file: Path, found: Inspection) -> None:
    """Write the region as binary PLY: x, y, z in mm, colour, and per vertex exposure_s and strict."""
    mesh = found.ground.mesh
    times = found.quality.exposure.times
    columns = {"exposure_s": times, "strict": found.strict}
    shares = np.clip(times / (np.percentile(times, 99.0) or 1.0), 0.0, 1.0)
    colors = np.where(times[:, None] > 0.0, colormaps["viridis"](shares, bytes=True)[:, :3], BARE)
    write_ply(file, COMMENT, (mesh.vertices, mesh.normals, mesh.triangles), colors, columns)


def write_ply(
    file: Path,
    comment: str,
    mesh: tuple[Array, Array, Indices],
    colors: NDArray[np.uint8],
    columns: Mapping[str, NDArray[Any]],
) -> None:
    """Write vertices [m], normals and triangles as binary PLY in mm, with colours (v, 3) and columns per
    vertex, in single precision."""
    import trimesh  # slow to import

    points, normals, corners = mesh
    body: Any = trimesh.Trimesh(
        1e3 * points,
        corners,
        vertex_normals=normals,
        vertex_colors=colors,
        vertex_attributes={name: values.astype(np.float32) for name, values in columns.items()},
        process=False,
    )
    content = body.export(file_type="ply", vertex_normal=True)
    file.write_bytes(content.replace(b"element", f"comment {comment}\nelement".encode("ascii"), 1))


MM = 1e3
DARK = "#3A0010"
"""Where the pad does not fit."""
LEVELS = {"never touched": ORANGE, "under the pad": "#F0D9A0", "and within 0.55 step-overs": "#CFE8DF"}
"""Coverage from none to strict, and its colours; what the pad does not touch at its force shows, however
near."""


@styled
def plot_maps(found: Inspection) -> Figure:
    """Draw time under the pad and coverage, seen from above.

    A region that looks down is seen from below, a side of the part along its face.
    """
    mesh = found.ground.mesh
    views = views_of(mesh.normals, found.region.up)
    seen = seen_triangles(mesh.vertices, mesh.normals, mesh.triangles, views)
    figure = new_figure(10.5, 4.6 if np.ptp(seen.x) >= 1.2 * np.ptp(seen.y) else 5.4)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    _draw_time(figure, panels[0], found, seen)
    _draw_cover(panels[1], found, seen, views)
    for axes in panels:
        axes.grid(False)
        scale_flat(axes, views)
    panels[1].set_ylabel("")
    head(figure, f"Path on {found.mesh.name}, seen {views.name}", legend=panels[1:])
    return figure


def _draw_time(figure: Figure, axes: Axes, found: Inspection, seen: Triangulation) -> None:
    m = found.figures
    times = found.quality.exposure.times
    top = max(np.percentile(times, 99.5), 1e-9)
    drawn = axes.tripcolor(seen, times, vmin=0.0, vmax=top, cmap="viridis", **SMOOTH)
    figure.colorbar(drawn, ax=axes, label="time under the pad [s]", shrink=0.85, pad=0.02, extend="max")
    over = 1e4 * m["over_polished_area_m2"]
    axes.set_title(f"Exposure: cv {m['exposure_cv']:.2f}, {over:.3g} cm² over 2 medians")


def _draw_cover(axes: Axes, found: Inspection, seen: Triangulation, views: Views) -> None:
    m = found.figures
    quality = found.quality
    level = np.where(quality.exposure.times > 0.0, np.where(found.strict, 2.0, 1.0), 0.0)
    colors = ListedColormap(list(LEVELS.values()))
    for name, color in LEVELS.items():
        axes.plot([], [], "s", color=color, label=name)
    axes.tripcolor(seen, level, vmin=-0.5, vmax=2.5, cmap=colors, **SMOOTH)
    for run in quality.runs:
        axes.add_collection(LineCollection([views.places(run.positions)], colors=[GREY], lw=0.5))
    if len(quality.crossings):
        axes.plot(*views.places(quality.crossings).T, "x", color=PINK, ms=6, mew=1.6, label="crossing")
    inside = quality.pad_in_part
    if len(inside.depths):
        at = views.places(inside.positions)
        label = f"pad up to {MM * inside.max_m:.3g} mm in the part"
        axes.plot(*at.T, "o", color=DARK, ms=3.0, label=label)
        x, y = at[inside.depths.argmax()]
        axes.add_patch(Circle((x, y), MM * inside.pad_radius, fill=False, ec=DARK, lw=1.2, clip_on=False))
    axes.set_title(
        f"Coverage: {100.0 * m['coverage_stepover']:.1f}% strict, {100.0 * m['coverage']:.1f}% by the pad",
    )
