"""Plant gears, move the arm, find their stiffness from both sides' encoders and the motors' torques."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from polish_sim.cell.gears import elastic_torque, slip
from polish_sim.cli.identify import simulated
from polish_sim.identification.gear_fit import GearFit, _hysteresis, _spring
from polish_sim.identification.identify import Identification, run_identification
from polish_sim.identification.settings import SCENARIO, IdentifySettings
from polish_sim.scenario_file import override
from tests.cell.elastic import HOME, joints_at

PLANTED = [
    "robot.arm=ur5e",
    "robot.real.stiffness_1_nm_rad=[24e3,26e3,22e3,4e3,4.4e3,4.7e3]",
    "robot.real.stiffness_2_nm_rad=[36e3,52e3,44e3,5.2e3,6.6e3,6.1e3]",
    "robot.real.stiffness_3_nm_rad=[60e3,64e3,52e3,8e3,7.4e3,7.1e3]",
    "robot.real.rotor_kg_m2=[1.2,2.1,1.5,0.25,0.17,0.2]",
]


def settings(*more: str) -> IdentifySettings:
    return IdentifySettings(periods=2, iterations=15, robot=override(SCENARIO, [*PLANTED, *more]).robot, seed=2)


@pytest.fixture(scope="module")
def planted() -> Identification:
    return run_identification(settings())


def test_planted_slopes_are_recovered_within_a_few_percent_and_their_intervals(planted: Identification) -> None:
    assert planted.gears is not None
    values, std, truth = planted.gears
    K, off = values[:, -3:], np.abs(values - truth)[:, -3:]
    assert np.isfinite(K[:5, :2]).all()  # the motion winds up every gear but the last wrist's beyond its first knee
    assert np.isfinite(K[1]).all()
    told = np.isfinite(K)
    assert np.nanmax(off / truth[:, -3:]) < 0.1
    assert np.nanmax((off / truth[:, -3:])[:3, :2]) < 0.04
    assert np.nanmax(off / std[:, -3:]) < 4.0
    assert np.mean((off <= 1.96 * std[:, -3:])[told]) > 0.7
    # The rotors, which the rigid model finds only together with the links of the first two joints.
    np.testing.assert_allclose(values[:5, 0], truth[:5, 0], rtol=0.03)


def test_a_gear_that_is_hardly_wound_up_is_not_told(planted: Identification) -> None:
    assert planted.gears is not None
    assert np.isnan(planted.gears.values[5, -3:]).all()
    rows = {row.name: row for row in planted.gears.rows()}
    assert rows["Ka6"].identifiable == "no"
    assert rows["Ka2"].identifiable == "gear"
    assert rows["Ka2"].true_value == 26e3


def test_spring_and_hysteresis_are_those_of_the_simulated_gears() -> None:
    arm = joints_at(HOME).arm
    twists = np.linspace(-3e-3, 3e-3, 301)
    knees = (float(arm.knees[1, 0]), float(arm.knees[1, 1]))
    expected = [elastic_torque(arm, 1, twist) for twist in twists]
    np.testing.assert_allclose(_spring(twists, arm.stiffness[1], knees), expected, atol=1e-9)
    way = 1e-3 * np.sin(np.linspace(0.0, 9.0, 400)) * np.linspace(1.0, 0.2, 400)
    torque, found = 0.0, []
    for moved in np.diff(way, prepend=way[0]):
        torque = slip(torque, moved, 4.5, 1e-4)
        found.append(torque)
    np.testing.assert_allclose(4.5 * _hysteresis(way, 1e-4), found, atol=1e-9)


def test_table_and_figures_hold_the_gears(tmp_path: Path) -> None:
    outcome = simulated(IdentifySettings(periods=1, iterations=5, robot=settings().robot), tmp_path)
    assert {"gear_slopes_found", "gear_interval_coverage"} <= {claim.figure for claim in outcome.claims}
    metrics = json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))
    assert np.shape(metrics["gear_stiffness_nm_rad"]) == (6, 3)
    rows = list(csv.DictReader((tmp_path / "parameters.csv").read_text(encoding="utf-8").splitlines()))
    row = next(row for row in rows if row["name"] == "Ka2")
    assert (row["unit"], row["identifiable"]) == ("N m/rad", "gear")
    assert float(row["low_95"]) < float(row["value"]) < float(row["high_95"])


def test_nothing_found_has_no_error() -> None:
    nothing = GearFit(*(np.full((6, 15), math.nan) for _ in range(3)))
    figures = nothing.figures()
    assert figures["gear_slopes_found"] == 0
    assert math.isnan(figures["gear_stiffness_error_max"])
