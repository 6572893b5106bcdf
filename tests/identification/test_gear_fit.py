"""Plant gears, move the arm, find their stiffness from both sides' encoders and the motors' torques."""

import csv
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from polish_sim.cell.gears import elastic_torque, slip
from polish_sim.identification import GEARS, SCENARIO, IdentifySettings
from polish_sim.identification.elastic import SprungHead, filtered
from polish_sim.identification.gear_fit import _hysteresis, _spring
from polish_sim.identification.identify import run_identification
from polish_sim.identification.regressor import States
from polish_sim.scenario_file import override
from tests.cell.elastic import HOME, joints_at
from tests.cli.conftest import ran
from tests.identification.known import design_once

PLANTED = [
    "robot.arm=ur5e",
    "robot.real.stiffness_1_nm_rad=[24e3,26e3,22e3,4e3,4.4e3,4.7e3]",
    "robot.real.stiffness_2_nm_rad=[36e3,52e3,44e3,5.2e3,6.6e3,6.1e3]",
    "robot.real.stiffness_3_nm_rad=[60e3,64e3,52e3,8e3,7.4e3,7.1e3]",
    "robot.real.rotor_kg_m2=[1.2,2.1,1.5,0.25,0.17,0.2]",
]


class Planted(NamedTuple):
    """What the identification of the planted arm left."""

    folder: Path
    figures: dict[str, Any]
    rows: dict[str, dict[str, str]]  #: Of parameters.csv, by name

    def gears(self, column, names="Ka Kb Kc"):
        """A column of numbers of the gears, joint by joint, shape (6, names); NaN where there is none."""
        words = [[self.rows[f"{name}{j}"][column] for name in names.split()] for j in range(1, 7)]
        return np.array([[float(word) if word else math.nan for word in row] for row in words])


@pytest.fixture(scope="module", autouse=True)
def _one_motion():
    with pytest.MonkeyPatch.context() as patch:
        design_once(patch, iterations=5)
        yield


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planted") / "found"
    settings = [word for setting in PLANTED for word in ("--set", setting)]
    ran("identify", "--periods", 1, "--seed", 2, *settings, "--out", folder)
    figures = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    rows = csv.DictReader((folder / "parameters.csv").read_text(encoding="utf-8").splitlines())
    return Planted(folder, figures, {row["name"]: row for row in rows})


def test_planted_gears_are_recovered_predict_the_torques_and_are_named_in_the_files(planted):
    K, std, truth = (planted.gears(column) for column in ("value", "std", "true_value"))
    np.testing.assert_array_equal(truth[:, 0], [24e3, 26e3, 22e3, 4e3, 4.4e3, 4.7e3])
    off = np.abs(K - truth)
    # the motion winds up every gear but the last wrist's beyond its first knee
    assert np.isfinite(K[:5, :2]).all()
    assert np.isfinite(K[1]).all()
    assert np.isnan(K[5]).all()
    # Above the second knee few samples lie but of the second joint.
    assert max(np.nanmax((off / truth)[:, :2]), np.nanmax((off / truth)[1])) < 0.1
    assert np.nanmax((off / truth)[:3, :2]) < 0.04
    assert np.nanmax(off / std) < 4.0
    assert np.mean((off <= 1.96 * std)[np.isfinite(K)]) > 0.7
    # The rotors, which the rigid model finds only together with the links of the first two joints.
    rotors, true = (planted.gears(column, "Jr")[:5] for column in ("value", "true_value"))
    np.testing.assert_allclose(rotors, true, rtol=0.03)
    # Steps of the encoders that count as a way of the hysteresis make damping 10% smaller.
    D, true = (planted.gears(column, "D")[:5] for column in ("value", "true_value"))
    assert np.mean(D / true) == pytest.approx(1.0, abs=0.05)
    loads, std = (np.array(planted.figures[f"friction_by_load{end}"]) for end in ("", "_std"))
    off = loads - planted.gears("true_value", "ldr ldn")
    assert np.all(np.abs(off[:5]) < 0.03)
    assert np.sqrt(np.mean((off / std) ** 2)) < 3.0
    assert planted.rows["Ka6"]["identifiable"] == "no"
    row = planted.rows["Ka2"]
    assert (row["unit"], row["identifiable"]) == ("N m/rad", "gear")
    assert float(row["low_95"]) < float(row["value"]) < float(row["high_95"])
    assert {path.name for path in planted.folder.iterdir()} == {
        "identified.xml", "meshes", "parameters.csv", "metrics.json", "torques.png",
    }  # fmt: skip
    assert {claim.figure for claim in GEARS} <= planted.figures.keys()
    assert np.shape(planted.figures["gear_stiffness_nm_rad"]) == (6, 3)
    assert len(planted.figures["nrms_heldout"]) == 6
    figures = planted.figures
    assert figures["nrms_heldout_mean"] < 0.006
    assert figures["nrms_heldout_drawing_mean"] > 4.0 * figures["nrms_heldout_mean"]
    assert figures["physically_consistent"]
    assert float(np.mean(figures["nrms_rigid"])) < 0.01  # links are not taken for friction
    assert figures["error_over_crb"] < 2.0
    assert figures["interval_coverage"] > 0.88


def test_gears_without_error_cannot_tell_load_from_links_and_are_taken_for_alike_both_ways():
    robot = override(SCENARIO, ["robot.arm=ur5e", "robot.real.gear_error_rad=[0,0,0,0,0,0]"]).robot
    found = run_identification(IdentifySettings(periods=1, robot=robot, seed=1)).figures
    driving, driven = np.array(found["friction_by_load"])[:5].T
    real = robot.real
    # Their sum is seen whatever the links weigh.
    np.testing.assert_allclose(driving + driven, real.coulomb_driving + real.coulomb_driven, atol=0.02)
    assert found["nrms_heldout_mean"] < 0.006


def test_spring_and_hysteresis_are_those_of_the_simulated_gears():
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


def test_a_head_on_its_spring_follows_a_slow_arm_and_leaves_a_quick_one():
    head, dt = SprungHead(0.3, 20_000 / 3, 60.0, np.array([0.0, 0.0, 0.175])), 1e-3
    t = np.arange(4000) * dt
    torques = {}
    for hz in (0.5, 150.0):
        q = np.tile([0.3, -1.2, 1.0, -1.4, -1.5, 0.2], (len(t), 1))
        q[:, 1] += 1e-4 * np.sin(2.0 * np.pi * hz * t)
        states = States(q, filtered(q, dt, 400.0, 1), filtered(q, dt, 400.0, 2))
        torques[hz] = head.torques(states, dt, 400.0)[:, 1] / np.ptp(states.qdd[:, 1])
    assert np.ptp(torques[0.5]) < 1e-3 * np.ptp(torques[150.0])
    # Far above its resonance the head stands still but for its damper: what a rigid link would push is gone.
    w = 2.0 * np.pi * 150.0
    lag = np.angle(w**2 - head.stiffness / head.mass - 1j * w * head.damping / head.mass)
    assert np.corrcoef(torques[150.0], -states.qdd[:, 1])[0, 1] == pytest.approx(np.cos(lag), abs=2e-3)
