"""Every pattern on every part: `python -m benchmarks.patterns [PART ...]` prints the table and draws the
sheet.

Without parts all shipped workpieces are planned at 8 mm; `--out` says where the sheet goes. `--plates N`
plans N random plates with one to four holes instead.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from benchmarks.random_outline import PlaneShape, draw_outline, place_discs, triangulate_shape
from polish_sim.analysis.style import head, new_figure, styled
from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.errors import PolishSimError
from polish_sim.models import workpiece_names
from polish_sim.planning import PATTERNS, PlanResult, plan_part

SHEET = Path(__file__).resolve().parent.parent / "results" / "gallery" / "patterns.png"
FIGURES = (
    "coverage_stepover",
    "self_crossings",
    "retracts",
    "stepover_p5_m",
    "stepover_p95_m",
    "length_ratio",
)
OUTLINES_WITH_HOLES = ("rectangle", "round", "L", "blob", "star", "rectangle")
PARTS_IN_A_ROW = 2
HEADER = (
    f"{'part':18s}{'pattern':9s}{'within 0.55':>12s}{'crossings':>10s}{'strokes':>8s}"
    f"{'p5':>7s}{'p95':>7s}{'length':>8s}{'s':>6s}"
)


class Cell(NamedTuple):
    """One pattern on one part."""

    part: str
    pattern: str
    plan: PlanResult | None
    """None where it was refused."""


def row(cell: Cell, stepover: float, seconds: float) -> str:
    """A line of the table; spacing and length as shares of what was asked."""
    assert cell.plan is not None
    covered, crossings, strokes, p5, p95, length = (cell.plan.figures[name] for name in FIGURES)
    return (
        f"{cell.part:18s}{cell.pattern:9s}{covered:12.4f}{crossings:10d}{strokes:8d}"
        f"{p5 / stepover:7.3f}{p95 / stepover:7.3f}{length:8.3f}{seconds:6.1f}"
    )


def plan_all(parts: Sequence[PartConfig], plan: PlanConfig, pad: PadConfig) -> list[Cell]:
    """Plan every part with every pattern and print each line as it comes."""
    cells = []
    print(HEADER)
    for part in parts:
        name = Path(part.file).stem
        for pattern in PATTERNS:
            wanted = PlanConfig(**(vars(plan) | {"pattern": pattern}))
            begin = time.perf_counter()
            try:
                cell = Cell(name, pattern, plan_part(part, wanted, pad=pad))
                print(row(cell, plan.stepover_m, time.perf_counter() - begin), flush=True)
            except PolishSimError as error:
                cell = Cell(name, pattern, None)
                print(f"{name:18s}{pattern:9s}  refused: {error}", flush=True)
            cells.append(cell)
    return cells


@styled
def sheet(cells: Sequence[Cell]) -> Figure:
    """Every path seen from above, two parts in a row."""
    columns = PARTS_IN_A_ROW * len(PATTERNS)
    rows = -(-len(cells) // columns)
    figure = new_figure(1.9 * columns, 0.5 + 2.3 * rows)
    head(figure, "Every pattern on every part", [
        "within 0.55 step-overs of the path, strokes, crossings", "dark to light along the path",
        "dot: contact begins, square: ends"])  # fmt: skip
    for place, cell in enumerate(cells):
        axes = figure.add_subplot(rows, columns, place + 1)
        axes.set_axis_off()
        if cell.plan is None:
            axes.set_title(f"{cell.pattern}: refused", fontsize=8)
            continue
        _draw(axes, cell.plan)
        figures = cell.plan.figures
        facts = (
            f"{100 * figures['coverage_stepover']:.1f}%, {figures['retracts']}, {figures['self_crossings']}"
        )
        axes.set_title(f"{cell.part}, {cell.pattern}\n{facts}", fontsize=8.0, fontweight="normal")
    return figure


def _draw(axes: Axes, plan: PlanResult) -> None:
    up = plan.region.up
    right = np.cross([0.0, 1.0, 0.0], up) if abs(up[1]) < 0.9 else np.cross([0.0, 0.0, -1.0], up)
    frame = np.stack([right / np.linalg.norm(right), np.cross(up, right) / np.linalg.norm(right)])
    for loop in plan.region.boundary_loops:
        axes.plot(*(frame @ loop.T) * 1e3, color="#999999", lw=0.8)
    points = plan.path.positions_work @ frame.T * 1e3
    pressed = plan.path.process[1:] & plan.path.process[:-1]
    chords = np.stack([points[:-1], points[1:]], axis=1)[pressed]
    axes.add_collection(LineCollection(list(chords), array=plan.path.s[1:][pressed], cmap="viridis", lw=0.9))
    ends = np.flatnonzero(np.diff(np.concatenate([[False], plan.path.process, [False]]).astype(int)))
    axes.plot(*points[ends[::2]].T, "o", color="#D55E00", ms=3)
    axes.plot(*points[ends[1::2] - 1].T, "s", color="#CC79A7", ms=3)
    axes.set_aspect("equal")


def draw_plates(count: int, folder: Path) -> list[str]:
    """Write plates 150 to 260 mm long with round holes, no two alike; the same every time."""
    files = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        outline, holes = draw_outline(OUTLINES_WITH_HOLES[seed % len(OUTLINES_WITH_HOLES)], rng)
        shape = PlaneShape(outline, holes, (), ())
        discs = place_discs(shape, int(rng.integers(1, 5)), 0.04, 0.14, 0.06, rng)
        mesh = triangulate_shape(shape._replace(holes=tuple(discs)), 0.05, 0.2, rng)
        points = np.column_stack([mesh.points, np.zeros(len(mesh.points))]) * rng.uniform(150.0, 260.0)
        files.append(str(folder / f"plate_{seed}_{len(discs)}.stl"))
        trimesh.Trimesh(points, mesh.triangles, process=False).export(files[-1])
    return files


def main() -> None:
    """Read the arguments, plan, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", help="mesh files; the shipped parts if none")
    parser.add_argument("--units", default="mm")
    parser.add_argument("--stepover", type=float, default=8.0, help="mm")
    parser.add_argument("--pad-diameter", type=float, default=50.0, help="mm")
    parser.add_argument("--out", type=Path, default=SHEET, help="the picture")
    parser.add_argument("--plates", type=int, default=0, help="how many random plates")
    asked = parser.parse_args()
    folder = tempfile.TemporaryDirectory()
    files = draw_plates(asked.plates, Path(folder.name)) or asked.parts or workpiece_names()
    parts = [PartConfig(file=file, unit=asked.units) for file in files]
    plan = PlanConfig(stepover_m=1e-3 * asked.stepover)
    cells = plan_all(parts, plan, PadConfig(radius_m=0.5e-3 * asked.pad_diameter))
    sheet(cells).savefig(asked.out, dpi=110)
    print(f"sheet: {asked.out}")


if __name__ == "__main__":
    main()
