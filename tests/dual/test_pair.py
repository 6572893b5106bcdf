"""Two robots in one cell: the part goes with the master's flange, the pad feels it."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.cell import SILENT, build_scene, no_part, tool_on_flange
from polish_sim.cell.gears import build_host_arm, elastic_torque, slip
from polish_sim.cell.guards import CONTROLLER_NAN
from polish_sim.cell.real_arm import built_table, resting_arm, slip_along
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.dual.carrier import FIRST_JOINT, FOLLOWER_ARM, MASTER_ARM, MasterRows, time_held, time_let_go
from polish_sim.dual.cell import MASTER_HALTED, MASTER_SILENT, PairCell
from polish_sim.dual.scene import GRIPPER_LENGTH, GRIPPER_MASS, Held, build_pair_scene, load_of
from polish_sim.errors import InputError, ReachError
from polish_sim.geometry import load_part
from polish_sim.models import workpiece_path
from polish_sim.motion import forward, link_frames
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.scenario_file import override
from polish_sim.spatial import apply, from_pose, inverse, transform
from tests.cell import cells
from tests.cell.elastic import REAL

T_FOLLOWER_MASTER = inverse(from_pose([-1.1, 0.0, 0.0, 0.0, 0.0, 3.0]))
Q_MASTER = np.array([0.19, -0.75, 1.86, -2.68, 1.57, 1.38])
ON_GRIPPER = transform(np.eye(3), np.array([0.0, 0.0, GRIPPER_LENGTH]))
TOOL = cells.tool_pose(0.0, -0.5, 0.3)


@cache
def hub():
    return load_part(workpiece_path("wheel_hub_rim"))


def scene(density=2700.0):
    return build_pair_scene(Scenario(), T_FOLLOWER_MASTER, Held(hub(), density, ON_GRIPPER))


def rows(share=1.0):
    """Joint rows of a slow motion of all joints, at a share of its speed, two seconds."""
    time = np.linspace(0.0, 2.0, 101)
    speed = share * np.array([0.05, -0.04, 0.06, 0.05, -0.07, 0.08])
    work = T_FOLLOWER_MASTER @ forward(Q_MASTER) @ ON_GRIPPER
    belief = from_pose([0.004, -0.003, 0.002, 0.01, -0.02, 0.03])
    return MasterRows(0.02, Q_MASTER + time[:, None] * speed, np.tile(speed, (101, 1)), work, belief)


def carried(**changes):
    """The follower stands still where its target is carried along by the master."""
    scenario, master = cells.ideal("arc", cells.EVERY_STEP), rows()._replace(**changes)
    return pair_cell(scenario, scene(), master, cells.free_stroke(TOOL, hold=1.2))


def test_both_robots_stand_as_their_own_table_says_and_the_master_carries_the_parts_mass():
    tables = NOMINAL + 1e-3 * np.random.default_rng(5).standard_normal((2, 4, 6))
    arms = {"follower": np.eye(4), "master": T_FOLLOWER_MASTER}
    held = Held(hub(), 2700.0, ON_GRIPPER)
    own = dict(zip(("master", "follower"), tables[::-1], strict=True))
    model = build_pair_scene(Scenario(), T_FOLLOWER_MASTER, held, own)
    data = mujoco.MjData(model)
    for q in np.random.default_rng(1).uniform(-3.0, 3.0, (5, 2, 6)):
        data.qpos[:6], data.qpos[FIRST_JOINT:] = q
        mujoco.mj_kinematics(model, data)
        for (arm, T_base), angles, table in zip(arms.items(), q, tables, strict=True):
            site, wanted = data.site(f"{arm}_flange"), T_base @ forward(angles[None], table)[0]
            np.testing.assert_allclose(site.xpos, wanted[:3, 3], atol=1e-9)
            np.testing.assert_allclose(site.xmat.reshape(3, 3), wanted[:3, :3], atol=1e-9)
        np.testing.assert_allclose(data.body("master_part").xpos, (wanted @ ON_GRIPPER)[:3, 3], atol=1e-9)
    model = scene()
    mass = load_of(hub(), 2700.0)[0]
    assert mass == pytest.approx(2.03, abs=0.01)
    assert model.body("master_part").mass[0] == pytest.approx(mass)
    assert model.body("master_gripper").mass[0] == pytest.approx(GRIPPER_MASS)
    with pytest.raises(ReachError, match=r"5\.87 kg"):
        scene(density=7800.0)
    # Inside out it would weigh -0.75 kg, which the gripper's own kilogram would hide.
    with pytest.raises(InputError, match=r"its faces look inwards"):
        load_of(replace(hub(), faces=hub().faces[:, ::-1]), 1000.0)


def test_part_and_target_follow_the_masters_flange_as_believed_and_their_speeds_are_the_derivatives():
    cell, master, seen = carried(), rows(), []
    carrier, T_start = cell.master.state, T_FOLLOWER_MASTER @ forward(Q_MASTER)

    def look(model, data):
        if data.time < 0.6 or len(seen) > 3:
            return
        # Poses are those of the last step's beginning: take them from the joints of that moment.
        T_flange = transform(data.site("master_flange").xmat.reshape(3, 3), data.site("master_flange").xpos)
        moved = T_flange @ inverse(T_start)
        T_work = moved @ master.T_base_work
        np.testing.assert_allclose(cell.kernel.part.position, T_work[:3, 3], atol=1e-9)
        believed = master.T_believed_true @ moved @ inverse(master.T_believed_true)
        np.testing.assert_allclose(carrier.R_moved, believed[:3, :3], atol=1e-9)
        np.testing.assert_allclose(carrier.p_moved, believed[:3, 3], atol=1e-9)
        np.testing.assert_allclose(cell.state.target.position, (believed @ TOOL)[:3, 3], atol=1e-9)
        on_part = apply(inverse(T_work), data.site("follower_tool").xpos)
        np.testing.assert_allclose(cell.state.tool_on_part, on_part, atol=1e-9)
        seen.append(data.time)

    run = cell.run(cells.EachStep(look))
    assert len(seen) > 3
    assert run.stop_reason is None
    velocity = np.gradient(run.trace.part_shift_m, run.trace.time_s, axis=0)[-200]
    assert np.linalg.norm(velocity) > 0.02
    assert run.log.columns["master_q_rad"].shape == (len(run.log), 6)
    assert np.abs(run.trace.target_error_m[-300:]).max() < 2e-4
    cell = carried()
    motion, target = cell.state.motion, cell.state.target
    places = (lambda: cell.kernel.part.position), (lambda: target.position)
    rates = (lambda: motion.velocity), (lambda: target.twist)
    _, (*places, speed, twist) = cells.watched(cell, *places, *rates)
    for place, wanted in zip(places, (speed, twist[:, :3]), strict=True):
        found = np.gradient(place[1100:], 0.001, axis=0)[5:-5]
        np.testing.assert_allclose(found, wanted[1105:-5], atol=2e-5)
        assert np.abs(found).max() > 0.01


@cache
def pressed(share, *changes, lift=0.0, look=None):
    """The pad pressed on a plane the master carries, without force control: as deep as for 20 N."""
    part = cells.part_under()
    T = transform(part.rotation, part.position)
    master = rows(share)._replace(T_base_work=T, T_believed_true=np.eye(4))
    scenario = cells.ideal("force", cells.EVERY_STEP, "controller.name=position", "pad.friction=0", *changes)
    cell = pair_cell(scenario, scene(), master, cells.pressing_stroke(hold=1.2, lift=lift), part)
    return cell.run(cells.EachStep(look) if look else SILENT)


def test_the_masters_joints_carry_what_is_pressed_on_the_part():
    """Statics: servos, bearings and weight leave J^T F of 20 N at the pad over at the master's joints."""
    left: list[Array] = []

    def look(model, data):
        # All forces on the joints but what is applied from outside, of the engine's last step.
        inner = data.qfrc_actuator + data.qfrc_passive + data.qfrc_constraint - data.qfrc_bias
        moving = np.zeros(model.nv)
        mujoco.mj_mulM(model, data, moving, data.qacc)
        left.append((moving - inner)[FIRST_JOINT:])

    pressed(0.0, look=look)
    # The pad presses with 20 N along the tool's z axis, at the point that was to be touched.
    T_master_follower = inverse(T_FOLLOWER_MASTER)
    force = T_master_follower[:3, :3] @ cells.TOUCH[:3, 2] * 20.0
    point = (T_master_follower @ cells.TOUCH)[:3, 3]
    frames = link_frames(Q_MASTER)[:6]
    torques = np.sum(frames[:, :3, 2] * np.cross(point - frames[:, :3, 3], force), axis=1)
    assert np.abs(torques).max() > 5.0
    np.testing.assert_allclose(np.mean(left[-100:], axis=0), torques, atol=0.02 * np.abs(torques).max())


@pytest.mark.parametrize(
    ("fault", "code", "delay"),
    [
        ("master-stop", MASTER_HALTED, 0.0),
        ("master-silent", MASTER_SILENT, 0.02),
        ("controller-nan", CONTROLLER_NAN, 0.0),
    ],
)
def test_whichever_arm_fails_both_stand_off_the_part(fault, code, delay):
    run = pressed(0.5, f"faults.events={fault}@contact+1", lift=0.01)
    assert run.stop_reason == PairCell.reasons[code]
    assert run.safety.fault_to_stop_s == pytest.approx(delay, abs=0.002)
    assert run.safety.retracted is True
    assert np.ptp(run.log["master_q_rad"].astype(float)[-100:], axis=0).max() < 1e-5
    assert run.trace.tcp_speed_m_s[-1] < 0.1 * run.trace.tcp_speed_m_s.max()
    assert run.trace.normal_force_n.max() < 30.0
    assert np.all(run.trace.normal_force_n[-50:] == 0.0)
    # The master brakes as firmly as the follower: from v it moves on by v x latency + v^2 / 2a.
    stopped, way = cells.stopped_at(run), run.trace.part_shift_m
    v = np.linalg.norm(np.gradient(way, 0.001, axis=0)[stopped - 20])
    assert v > 0.01
    assert np.linalg.norm(way[stopped + 60] - way[stopped]) < v * 0.004 + v**2 / 8.0


def test_the_masters_time_passes_as_foretold_and_the_host_foretells_a_master_that_gains_speed():
    cell = carried(spacing=0.007)
    _, (seen,) = cells.watched(cell, lambda: cell.master.state.clock)
    start = int(np.argmax(seen > 0.0))
    # It has 0.7 s of rows and brakes on half a ramp of them: released for 0.7 s, then held until it stands.
    since = 0.001 * np.arange(1, 1 + len(seen) - start)
    clock, _ = time_let_go(since)
    np.testing.assert_allclose(seen[start:][since < 0.69], clock[since < 0.69], atol=1e-3)
    held = time_let_go(np.array([0.7]))[0] + time_held(0.7, since[since > 0.71] - 0.7)[0]
    np.testing.assert_allclose(seen[start:][since > 0.71], held, atol=2e-3)
    assert seen[-1] == pytest.approx(0.7, abs=2e-3)
    # Against where the master really is, and its speed once a request acts, 8 ms later; ramps included.
    cell = carried(delay=0.003, period=0.002, lead=0.008)
    host = cell.master.state
    _, (told, coming, q, qd) = cells.watched(
        cell,
        lambda: host.q,
        lambda: host.qd,
        lambda: (cell.data.qpos - 0.001 * cell.data.qvel)[FIRST_JOINT:],  # at the last step's beginning
        lambda: cell.data.qvel[FIRST_JOINT:],
    )
    assert np.abs(told - q).max() < 5e-6
    # Late by 11 to 12 ms without acceleration; what is left is while the acceleration builds up.
    assert np.std(coming[:-8] - qd[8:]) < 0.4 * np.std(qd[12:] - qd[:-12])


def test_the_force_on_a_plane_that_moves_turns_and_slows_down_is_that_on_one_at_rest():
    still, moving = pressed(0.0), pressed(0.5)
    assert moving.stop_reason is None
    assert np.linalg.norm(moving.trace.part_shift_m[-1]) > 0.01
    rest, force = still.trace.normal_force_n[-300:], moving.trace.normal_force_n[-300:]
    assert rest.mean() == pytest.approx(20.0, abs=0.1)
    assert np.abs(force - rest.mean()).max() < 0.3
    usual, slow = pressed(0.5), pressed(0.5, "faults.events=master-slow@contact+0.5")
    assert slow.stop_reason is None
    ways = [np.linalg.norm(np.ptp(run.trace.part_shift_m[-300:], axis=0)) for run in (usual, slow)]
    assert ways[1] == pytest.approx(0.5 * ways[0], rel=0.05)
    assert np.abs(slow.trace.normal_force_n[-300:] - usual.trace.normal_force_n[-300:].mean()).max() < 0.3


def real_pair(*changes, share=0.0):
    """Both arms with gears, in a scene by the nominal table; the follower stands still."""
    exact = "robot.real.encoder_rad=0", "robot.real.missed_every_s=0"
    scenario = override(cells.ideal("arc", cells.EVERY_STEP), [REAL, *exact, *changes])
    return pair_cell(scenario, scene(), rows(share), cells.free_stroke(TOOL, hold=1.2))


def test_arms_with_gears_rest_where_encoders_and_statics_say_and_slip_within_their_lost_motion():
    cell = real_pair()
    starts = ((FOLLOWER_ARM, cells.joints_at(TOOL)), (MASTER_ARM, Q_MASTER))
    for place, q in starts:
        resting = resting_arm(cell.scenario.robot.real, cell.scenario.seed, cell.model, place)
        links = resting.links(q[None])
        np.testing.assert_allclose(cell.data.qpos[place.joints], links[0], atol=1e-9)
        np.testing.assert_allclose(resting.encoders(links)[0], q, atol=1e-9)
        assert np.abs(links[0] - q).max() > 5e-4
    before = cell.data.qpos.copy()
    cell.run()
    np.testing.assert_allclose(cell.real_arm.read, starts[0][1], atol=1e-6)
    np.testing.assert_allclose(cell.master_arm.read, Q_MASTER, atol=1e-6)
    np.testing.assert_allclose(cell.data.qpos, before, atol=1e-6)
    # Half of it either way; of a pose reached from both sides, on average, less.
    cell, rng, most = real_pair(), np.random.default_rng(2), 0.5 * 2.9e-4
    resting = resting_arm(cell.scenario.robot.real, cell.scenario.seed, cell.model, MASTER_ARM)
    q = Q_MASTER + rng.uniform(-0.3, 0.3, (300, 6))
    there = resting.links(q)
    arrived, anywhere = resting.arrive(q[:40], rng) - there[:40], resting.links(q, rng) - there
    for off in (arrived, anywhere):
        assert 0.5 * most < np.abs(off).max() <= 1.01 * most
    assert np.abs(anywhere.mean(axis=0)).max() < 0.1 * most
    # The last axis carries no weight, and little turns with it.
    rms = [np.sqrt(np.mean(off[:, :5] ** 2, axis=0)) for off in (arrived.mean(axis=0), anywhere)]
    assert np.all(rms[0] < 0.7 * rms[1])
    linked = resting._replace(real=replace(resting.real, servo_side="link"))
    np.testing.assert_array_equal(linked.encoders(linked.links(q, rng), rng), q)
    np.testing.assert_array_equal(linked.arrive(q, rng), q[None])


def test_hysteresis_along_a_way_is_that_of_the_twists_and_each_arm_of_a_seed_is_drawn_for_itself():
    """Planted: twists there and back, and what spring and hysteresis carry with them."""
    real, arm = real_pair().scenario.robot.real, real_pair().real_arm
    twists = 1e-3 * np.sin(np.linspace(0.0, 5.0, 400)) * np.linspace(0.2, 1.0, 400)
    torques, left = np.empty((400, 1, 6)), np.empty(6)
    for j in range(6):
        held = 0.0
        for k, twist in enumerate(twists):
            moved = twist - twists[k - 1] if k else 0.0
            held = slip.py_func(held, moved, arm.lost_torque[j], arm.rise) if k else 0.0
            torques[k, 0, j] = elastic_torque.py_func(arm, j, twist) + held
        left[j] = held
    found = slip_along(real, torques, np.zeros((1, 6)))[0]
    np.testing.assert_allclose(found, left, atol=0.02 * arm.lost_torque.min())
    cell = real_pair()
    real, seed = cell.scenario.robot.real, cell.scenario.seed
    alone = build_scene(cell.scenario)
    follower, master = (resting_arm(real, seed, cell.model, place) for place in (FOLLOWER_ARM, MASTER_ARM))
    np.testing.assert_array_equal(follower.errors, resting_arm(real, seed, alone).errors)
    assert np.abs(master.errors - follower.errors).max() > 5e-5
    tables = [built_table(real, seed, cell.model, Q_MASTER, place) for place in (FOLLOWER_ARM, MASTER_ARM)]
    np.testing.assert_allclose(tables[0], built_table(real, seed, alone, Q_MASTER), atol=1e-12)
    assert np.abs(tables[1] - tables[0]).max() > 1e-4


def test_gaps_in_the_masters_link_leave_the_host_where_it_foretells_it():
    """0.08 rad/s for up to 6 ms are 5e-4 rad without the host's carrying on."""
    cell = real_pair("robot.real.kinematics=exact", "robot.real.missed_every_s=0.05", share=1.0)
    run, (told, read) = cells.watched(cell, lambda: cell.master.state.q, lambda: cell.master_arm.read)
    assert run.stop_reason is None
    assert 0.0 < np.abs(told - read).max() < 1e-4


def pair_cell(scenario, model, master, stroke, part=None):
    """A pair at the start of the follower's stroke; the host believes in the nominal table."""
    T, host = master.T_base_work, build_host_arm(NOMINAL, np.eye(4), tool_on_flange())
    nothing = no_part()._replace(rotation=np.ascontiguousarray(T[:3, :3]), position=T[:3, 3].copy())
    return PairCell(
        master, host, scenario, model, part or nothing, [stroke], cells.joints_at(cells.start_of(stroke)),
        build_controller(scenario.controller), np.random.default_rng(0),
    )  # fmt: skip
