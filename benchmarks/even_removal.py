"""Removal of `run surface` on displaced parts, at one feed and with ``--even-removal``: a table and a
picture.

    python -m benchmarks.even_removal [--part NAME]... [--seed 700]... [--force 40] [--as-drawn] [--out
    FOLDER]

At one feed: step-over 8 mm, 10 mm/s. Even: step-over 4 mm, 21 mm/s, so that the mean removal is alike. Both
on the arm ``ur5e``, without proof. A line for each part and seed: standard deviation over mean of the region,
the same a pad's radius inside the border, time and mean removal over those of the first run at one feed that
was not stopped. ``ring`` is a flat ring, 180 and 90 mm across. ``--as-drawn`` leaves the part where the plan
has it.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import trimesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from polish_sim.analysis.removal_plot import removal_colors
from polish_sim.experiments import default_scenario
from polish_sim.experiments.even_removal import axis_kept, plan_removal
from polish_sim.experiments.surface import run_surface
from polish_sim.scenario_file import override

PARTS = ("freeform", "saddle", "ring", "plate_two_holes")
SETTINGS = {
    "one feed": ["plan.stepover_m=0.008", "process.feed_m_s=0.01"],
    "even": ["plan.stepover_m=0.004", "process.feed_m_s=0.021", "plan.removal=even"],
}
AS_DRAWN = ["part.displacement_m=0", "part.rotation_rad=0", "part.form_error_m=0"]


def main() -> None:
    """Print the table and draw the first seed of each part."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", action="append", default=[])
    parser.add_argument("--seed", type=int, action="append", default=[])
    parser.add_argument("--force", type=float, default=40.0)
    parser.add_argument("--as-drawn", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("results/even_removal"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    for part in asked.part or PARTS:
        with TemporaryDirectory() as folder:
            common = [f"part.file={part_file(part, Path(folder))}", f"process.contact_force_n={asked.force}"]
            common += ["robot.arm=ur5e", "safety.proof=none", *(AS_DRAWN if asked.as_drawn else [])]
            compare(part, common, asked.seed or list(range(700, 705)), asked.out)


def part_file(part: str, folder: Path) -> str:
    """A shipped part's name, or the file of a ring made here."""
    if part != "ring":
        return part
    ring = trimesh.creation.annulus(r_min=0.045, r_max=0.09, height=0.02, sections=128)
    ring.apply_scale(1e3)
    ring.export(folder / "ring.stl")
    return str(folder / "ring.stl")


def compare(part: str, common: list[str], seeds: list[int], out: Path) -> None:
    """Run a part both ways with all seeds."""
    figure = Figure((11.0, 5.0), layout="constrained")
    before: tuple[float, float] | None = None
    for axes, (name, settings) in zip(figure.subplots(1, 2), SETTINGS.items(), strict=True):
        scenario = axis_kept(override(default_scenario("surface"), [*common, *settings]))
        plan = plan_removal(scenario)
        for seed in seeds:
            result = run_surface(replace(scenario, seed=seed), plan)
            m, mean = result.figures, result.removal.mean
            if before is None and m["path_done"] >= 1.0:
                before = m["cycle_time_s"], mean
            time_s, usual = before or (math.nan, math.nan)
            print(
                f"{part:16} {seed} {name:9} {100 * m['removal_cv']:5.1f}% inside "
                f"{100 * m['removal_cv_inside']:5.1f}%  {m['cycle_time_s']:6.1f} s "
                f"{m['cycle_time_s'] / time_s:.2f}  mean {mean / usual:.2f}  "
                f"{(m['protective_stop'] or '')[:60]}",
                flush=True,
            )
            if seed == seeds[0]:
                draw(axes, result.removal, f"{part}, {name}: {100 * m['removal_cv']:.1f}%")
    figure.savefig(out / f"{part}.png", dpi=100)


def draw(axes: Any, removal: Any, title: str) -> None:
    """The removal from above."""
    x, y = 1e3 * removal.vertices[:, :2].T
    seen = Triangulation(x, y, removal.triangles)
    colors = axes.tripcolor(
        seen, removal.relative, norm=Normalize(0.6, 1.4), cmap=removal_colors(), shading="gouraud"
    )
    axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.figure.colorbar(colors, ax=axes, label="removal / its mean")
    axes.set(xlim=(np.min(x) - 5, np.max(x) + 5))


if __name__ == "__main__":
    main()
