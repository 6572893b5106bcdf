"""A comparison as files: figures, picture and page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from matplotlib.figure import Figure

from polish_sim.analysis.style import BLUE, ORANGE, head, new_figure, styled
from polish_sim.arrays import Array, midpoints
from polish_sim.compare.figures import SPEEDS, ForceStep
from polish_sim.compare.replay import JOINTS, JointComparison
from polish_sim.experiments.run_page import scene_bodies, scene_solids, shown_rows
from polish_sim.page.page import Line, Motion, Page, Plot, tables_page

FIGURES = "compare.json"
PICTURE = "compare.png"
_LABELS = {
    "nrms": ("torque, rms of the difference", "% of its range", 100.0),
    "ripple_cycles": ("ripple", "1/turn", 1.0),
    "ripple_nm": ("  amplitude", "N m", 1.0),
    "coulomb_nm": ("friction, Coulomb", "N m", 1.0),
    "viscous_nm_s_rad": ("  viscous", "N m s/rad", 1.0),
    "driving": ("  of the load, driving", "%", 100.0),
    "driven": ("  of the load, driven", "%", 100.0),
}


def joint_table(figures: dict[str, Any]) -> list[list[str]]:
    """A table of measured beside simulated by joint: label, unit, side, six values."""
    rows = []
    for name, (label, unit, scale) in _LABELS.items():
        for side, key in (("measured", name), ("simulated", f"simulated_{name}")):
            if key in figures:
                rows.append(
                    [label, unit, "" if name == "nrms" else side, *(_text(scale * v) for v in figures[key])]
                )
    if "friction_curve_error" in figures:
        rows.append(
            [
                "friction by speed, largest",
                "% off",
                "",
                *(_text(100.0 * v) for v in figures["friction_curve_error"]),
            ]
        )
    return rows


def step_rows(figures: dict[str, Any]) -> list[list[str]]:
    """A table of a force step: figure, measured, simulated."""
    names = [name for name in figures if f"simulated_{name}" in figures]
    rows = [[name, _text(figures[name]), _text(figures[f"simulated_{name}"])] for name in names]
    return [*rows, ["force_rms_n (curve on curve)", "", _text(figures["force_rms_n"])]]


def _text(value: float) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:.4g}"


@styled
def plot_joint_torques(found: JointComparison, title: str) -> Figure:
    """Torque over time and friction by speed of each joint, measured and simulated."""
    figure = new_figure(12.0, 14.0)
    grid = figure.subplots(6, 2, width_ratios=(2.2, 1.0))
    middle = midpoints(SPEEDS)
    for j in JOINTS:
        over_time, by_speed = grid[j]
        for values, friction, color, name in (
            (found.measured, found.curves[0], ORANGE, "measured"),
            (found.simulated, found.curves[1], BLUE, "simulated"),
        ):
            if len(values):
                over_time.plot(found.time, values[:, j], color=color, linewidth=0.7, label=name)
            by_speed.plot(middle, friction[j], "o-", color=color, markersize=3, linewidth=1.0)
        over_time.set_ylabel(f"joint {j + 1} [N m]")
        by_speed.set_ylim(bottom=0.0)
    grid[0, 0].set_title("torque")
    grid[0, 1].set_title("friction [N m]")
    grid[5, 0].set_xlabel("time [s]")
    grid[5, 1].set_xlabel("speed [rad/s]")
    head(figure, title, ["orange: measured, blue: simulated"], legend=(grid[0, 0],))
    return figure


@styled
def plot_steps(pairs: Sequence[tuple[str, ForceStep, ForceStep]], title: str) -> Figure:
    """Forces since first contact, measured and simulated, one panel a case."""
    wide = min(2, len(pairs))
    figure = new_figure(6.0 * wide, 1.2 + 2.2 * -(-len(pairs) // wide))
    grid = np.atleast_1d(figure.subplots(-(-len(pairs) // wide), wide, squeeze=False)).ravel()
    for axes, (name, measured, simulated) in zip(grid, pairs, strict=False):
        axes.plot(measured.time, measured.force, color=ORANGE, linewidth=0.7, label="measured")
        axes.plot(simulated.time, simulated.force, color=BLUE, linewidth=0.7, label="simulated")
        axes.axhline(measured.asked, color="#444444", linewidth=0.6, linestyle=":")
        axes.set(title=name, xlim=(-0.1, 3.0), ylim=(-10.0, 3.0 * measured.asked + 40.0), ylabel="force [N]")
    for axes in grid[len(pairs) :]:
        axes.set_visible(False)
    head(figure, title, ["seconds since first contact"], legend=(grid[0],))
    return figure


def joint_page(found: JointComparison, model: mujoco.MjModel, title: str) -> Page:
    """The replayed arm, drawn by a ``model``, in motion over its torques, measured and simulated."""
    kept = shown_rows(found.time, found.simulated_q)
    time = found.time[kept]
    still = np.full(len(kept), np.nan)
    joints = np.column_stack([found.simulated_q[kept], np.zeros((len(kept), model.nq - 6))])
    pad = np.zeros((len(kept), 3))
    plots = [
        Plot(f"joint {j + 1}, torque", "N m", _lines(found.measured, found.simulated, kept, j))
        for j in JOINTS
    ]
    plots += [
        Plot(f"joint {j + 1}, angle", "rad", _lines(found.measured_q, found.simulated_q, kept, j))
        for j in JOINTS
    ]
    head_row = ["figure", "unit", "side", *(f"joint {j + 1}" for j in JOINTS)]
    page = tables_page(
        title, "a robot's log beside its replay", {"By joint": [head_row, *joint_table(found.figures)]}, []
    )
    return page._replace(
        bodies=scene_bodies(model),
        solids=scene_solids(model),
        plots=plots,
        motion=Motion(time, joints, pad, still, still, still, still, still),
    )


def _lines(measured: Array, simulated: Array, kept: Any, j: int) -> list[Line]:
    lines = [Line("simulated", simulated[kept, j])]
    return [Line("measured", measured[kept, j], "asked"), *lines] if len(measured) else lines


def step_page(figures: dict[str, Any], title: str) -> Page:
    """A force step's figures as a page."""
    table = [["figure", "measured", "simulated"], *step_rows(figures)]
    return tables_page(title, "a robot's force beside a simulated run's", {"Force step": table}, [])
