"""Distributions along an inspected path: what the picture must show."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.analysis.inspect_plot import plot_distributions
from polish_sim.config import PartConfig, PlanConfig
from polish_sim.planning import inspect_path, plan_part


@pytest.fixture(scope="module")
def found():
    part, plan = PartConfig("sphere_100"), PlanConfig(stepover_m=0.016)
    return inspect_path(plan_part(part, plan).path, part, plan)


def test_turns_of_the_tool_axis_are_in_the_unit_of_the_table(found):
    rate = plot_distributions(found).axes[2]
    assert rate.get_ylabel().endswith("[deg/mm]")
    # On a sphere of 100 mm the normal turns by 1 rad in 100 mm whichever way one goes.
    drawn = rate.lines[0].get_ydata()
    assert np.median(drawn) == pytest.approx(np.degrees(1.0) / 100.0, rel=0.02)
    assert drawn.max() == pytest.approx(np.degrees(found.figures["max_axis_rate_rad_m"]) * 1e-3)


def test_shares_end_at_all_of_it_and_legends_stand_below_the_panels(found):
    figure = plot_distributions(found)
    figure.draw_without_rendering()
    assert figure.axes[0].get_ylim() == (0.0, 100.0)
    for axes in figure.axes:
        assert axes.get_legend().get_window_extent().y1 < axes.get_window_extent().y0
