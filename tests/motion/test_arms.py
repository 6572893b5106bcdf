"""One arm by its table: another make is another row, and a process can change between them."""

from collections.abc import Iterator
from dataclasses import asdict

import mujoco
import numpy as np
import pytest

from polish_sim.arms import ARMS, FIRST
from polish_sim.cell import Silent
from polish_sim.cell.scene import build_scene, tool_on_flange
from polish_sim.config import Checked, Scenario
from polish_sim.dual.task import prepare_dual
from polish_sim.errors import InputError
from polish_sim.experiments import PAYLOAD_SCENARIO, default_scenario, run_payload_calibration
from polish_sim.experiments.assembly import Workplace, check, strokes_for
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.free_space import prepare_arc
from polish_sim.experiments.surface import place_force, prepare_surface
from polish_sim.motion.kinematics import NOMINAL, forward, inverse_all, nearest_solution, use_arm, used_arm
from polish_sim.scenario_file import load_scenario, override, to_toml
from polish_sim.smoothing.smooth import prepare_smooth
from polish_sim.spatial import apply

RNG = np.random.default_rng(500)
REACH = {"ur5e": 0.8172, "ur10e": 1.18425}  # from the shoulder's axis to the wrist, all joints at zero [m]


@pytest.fixture(autouse=True)
def _back_to_the_first() -> Iterator[None]:
    yield
    use_arm(FIRST)


@pytest.mark.parametrize("name", ARMS)
def test_the_inverse_gives_back_what_forward_took_and_a_stretched_arm_reaches_what_its_maker_says(name):
    use_arm(name)
    assert forward(np.zeros(6))[0, 3] == pytest.approx(-REACH[name], abs=1e-12)
    q = RNG.uniform(-2.5, 2.5, (40, 6))
    for pose, angles in zip(np.ascontiguousarray(forward(q)), q, strict=True):
        found = inverse_all(pose, 0.0)
        found = found[~np.isnan(found[:, 0])]
        np.testing.assert_allclose(forward(found), np.tile(pose, (len(found), 1, 1)), atol=1e-9)
        np.testing.assert_allclose(nearest_solution(pose, angles, False), angles, atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_the_model_stands_where_the_table_says_with_its_links(name):
    model = build_scene(override(default_scenario("arc"), [f"robot.arm={name}"]), None, None)
    data = mujoco.MjData(model)
    assert used_arm() is ARMS[name]
    for q in RNG.uniform(-2.0, 2.0, (5, 6)):
        data.qpos[:6] = q
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.site("flange").xpos, forward(q)[:3, 3], atol=1e-9)
    assert model.actuator_forcerange[:, 1] == pytest.approx(ARMS[name].torque)
    for number, link in enumerate(ARMS[name].links, 1):
        body = model.body(f"link_{number}")
        assert body.mass[0] == pytest.approx(link.mass)
        np.testing.assert_allclose(body.ipos, link.center, atol=1e-12)
        assert sum(body.inertia) == pytest.approx(sum(link.inertia[:3]), rel=1e-6)


def test_a_make_brings_its_gears_leaves_what_is_set_by_name_and_an_unknown_one_is_refused(tmp_path):
    base = default_scenario("arc")
    other = override(base, ["robot.real.encoder_rad=1e-5", "robot.arm=ur10e", "robot.real.gear_ratio=77"])
    assert other.robot.real.coulomb_nm == ARMS["ur10e"].gears["coulomb_nm"]
    assert (other.robot.real.encoder_rad, other.robot.real.gear_ratio) == (1e-5, 77.0)
    (tmp_path / "config.toml").write_text(to_toml(other), encoding="utf-8")
    assert load_scenario(tmp_path / "config.toml", base) == other
    back = override(other, ["robot.arm=ur5e"])
    changed = {k for k, v in asdict(back.robot.real).items() if v != asdict(base.robot.real)[k]}
    assert changed == {"encoder_rad", "gear_ratio"}
    with pytest.raises(InputError, match=r"ideal, ur10e, ur5e"):
        override(Scenario(), ["robot.arm=ur20"])
    with pytest.raises(ValueError, match="read-only"):
        NOMINAL[1, 0] = 0.2


def checked(name: str, arm: str, *changes: str) -> Checked:
    return check(override(default_scenario(name), [f"robot.arm={arm}", *changes]))


def test_what_takes_a_checked_scenario_computes_with_its_arm_whatever_was_used_before():
    """Places and circles are kept: the second call of each finds what the first one worked out."""

    def on_surface(scenario: Checked) -> Workplace:
        return prepare_surface(*planned(scenario))

    for prepare, name in ((prepare_arc, "arc"), (place_force, "force"), (on_surface, "surface")):
        scenarios = [checked(name, arm, "plan.stepover_m=0.05") for arm in ("ur5e", "ur10e")]
        starts = []
        for scenario in (*scenarios, *scenarios):
            found = prepare(scenario)
            assert used_arm() is ARMS[scenario.robot.arm]
            tip = apply(found.reach.T_base_work, found.path.positions_work[:1])[0]
            tool = forward(found.reach.q_start) @ tool_on_flange()
            assert np.linalg.norm(tool[:3, 3] - tip) < 0.012  # lifted, or pressed in
            starts.append(found.reach.q_start)
        assert np.abs(starts[0] - starts[1]).max() > 0.1
        np.testing.assert_array_equal(starts[:2], starts[2:])


def test_strokes_and_smoothed_paths_are_of_their_scenarios_arm_and_two_robots_from_the_first_stage_on():
    pressed, smooth, dual = (checked(name, "ur10e") for name in ("force", "smooth", "dual"))
    place, arms = place_force(pressed), []

    class Watching(Silent):
        def stage(self, name: str) -> None:
            arms.append(used_arm())
            raise StopIteration

    for prepare in (lambda: strokes_for(pressed, place), lambda: prepare_smooth(smooth)):
        use_arm("ur5e")
        prepare()
        arms.append(used_arm())
    use_arm("ur5e")
    with pytest.raises(StopIteration):
        prepare_dual(dual, None, Watching())
    assert arms == 3 * [ARMS["ur10e"]]


def test_the_payload_of_another_make_is_found():
    found = run_payload_calibration(override(PAYLOAD_SCENARIO, ["robot.arm=ur10e", "payload.poses=6"]))
    assert found.figures["mass_error_relative"] < 0.01
