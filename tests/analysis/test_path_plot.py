"""The picture of a plan: what it must show."""

from __future__ import annotations

import numpy as np
import pytest
from mpl_toolkits.mplot3d.axes3d import Axes3D

from polish_sim.analysis.path_plot import plot_plan
from polish_sim.config import PartConfig, PlanConfig
from polish_sim.planning import plan_part


@pytest.fixture(scope="module")
def result():
    return plan_part(PartConfig("sphere_100"), PlanConfig(stepover_m=0.012))


def test_the_picture_shows_the_plan_in_space_and_from_above(result):
    solid, flat, bar = plot_plan(result).axes
    assert isinstance(solid, Axes3D)
    assert flat.get_xlabel().endswith("[mm]")
    assert bar.get_ylabel() == "along the path [m]"


def test_from_above_the_path_lies_where_it_was_planned(result):
    flat = plot_plan(result).axes[1]
    drawn = np.concatenate([line.vertices for line in flat.collections[1].get_paths()])
    process = result.path.positions_work[result.path.process] * 1e3
    assert drawn.min(axis=0) == pytest.approx(process[:, :2].min(axis=0))
    assert drawn.max(axis=0) == pytest.approx(process[:, :2].max(axis=0))


def test_landing_and_leaving_are_named(result):
    figure = plot_plan(result)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["approach, lead-in", "lead-out, retract"]


def test_the_head_tells_the_figures(result):
    figure = plot_plan(result)
    assert "1 run" in figure.axes[1].get_title(loc="left")
    assert "sphere_100" in figure.get_suptitle()
