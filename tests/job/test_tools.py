"""The tool library: what a tool sets in the cell, what is refused, and what an orbit takes off."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from polish_sim.cell.dwell import exposure_rates
from polish_sim.errors import PolishSimError
from polish_sim.experiments.registry import default_scenario
from polish_sim.job.tools import ORBITAL, JobTool, read_tools
from polish_sim.scenario_file import merge
from tests.cell.test_removal import FORCE, STIFFNESS, R, level_nodes, pressed_at


def test_every_shipped_tool_is_a_scenario_an_orbit_takes_off_evenly_and_a_worn_abrasive_half():
    usual = default_scenario("surface")
    scenarios = {name: merge(usual, tool.settings(), "") for name, tool in read_tools().items()}
    assert all(scenarios[name].pad.radius_m == tool.radius_m for name, tool in read_tools().items())
    assert (scenarios["spindle-pad"].head, scenarios["spindle-pad"].spindle) == (usual.head, usual.spindle)
    # On a plane p = F / (pi R^2) everywhere, and |u + w t(phi)| over the orbit is w for a slow feed u.
    tool = JobTool(kind=ORBITAL, orbit_m=0.0025, speed_rpm=10000.0)
    slide, feed = tool.slide_m_s, 0.05
    round_ = quad(lambda phi: math.hypot(feed + slide * math.cos(phi), slide * math.sin(phi)), 0.0, math.tau)
    exact = round_[0] / math.tau
    nodes = level_nodes(0.001)
    pose = pressed_at(0.0)._replace(velocities=np.array([[feed, 0.0, 0.0]]), turning=np.zeros((1, 3)))
    found = exposure_rates(nodes, pose, R, STIFFNESS, slide).rates.toarray()[0]
    under = np.linalg.norm(nodes.positions[:, :2], axis=1) < 0.98 * R
    np.testing.assert_allclose(found[under], FORCE / (math.pi * R**2) * exact, rtol=0.02)
    tool = JobTool(wear_nm=1000.0)
    assert tool.left(0.0) == 1.0
    assert tool.left(1000.0) == pytest.approx(0.5)
    assert JobTool().left(1e9) == 1.0


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[a]\nradius_m = -1.0\n", "radius_m"), ("[a]\nkind = 'laser'\n", "laser"),
        ("[a]\nkind = 'orbital'\n", "orbit_m"), ("[a]\nspeed_rpm = 20000.0\n", "speed_rpm"),
        ("a = 3\n", "a"), ("[a\n", "TOML"),
    ],
)  # fmt: skip
def test_a_bad_tool_is_refused_by_name(tmp_path, text, named):
    file = tmp_path / "tools.toml"
    file.write_text(text)
    with pytest.raises(PolishSimError, match=named):
        read_tools(file)
