"""Statics of the whole cell, a moving part, the active flange; the exact wrist wrench by Newton and Euler."""

import cmath
import math

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.cell.guards import NO_STOP, REASONS, STROKE
from polish_sim.cell.loop import advance
from polish_sim.cell.recorder import build_recorder
from polish_sim.cell.wrist_sensor import GRAVITY
from polish_sim.experiments import run_experiment
from polish_sim.log import TOUCH_PHASE
from polish_sim.models import robot_model_path
from tests.cell import cells
from tests.cell.cells import HEAD_STIFFNESS, PRESSED, foundation, working_depth

STIFFNESS = 5000.0  # of head and pad in series [N/m]
LEANING = cells.tool_pose(0.12, -0.45, 0.15, tilt=(0.3, -0.2, 0.5))
ROUND = [(f"sphere_{radius}", working_depth(1e-3 * radius), 0.02) for radius in (300, 50)]


@pytest.mark.parametrize(("part", "pad_depth", "off"), [("plate", 0.001, 0.005), *ROUND])
def test_position_control_presses_as_the_closed_form_says(part, pad_depth, off):
    """On a sphere the pad touches in part, and presses more softly: 17.4 N and 9.8 N."""
    settings = "controller.name=position", f"part.file={part}", cells.EVERY_STEP
    run, travel = run_experiment(cells.ideal("force", *settings)), PRESSED - pad_depth
    np.testing.assert_allclose(run.trace.normal_force_n[-1000:], HEAD_STIFFNESS * travel, rtol=off)
    assert float(run.log["pad_travel_m"][-1]) == pytest.approx(travel, rel=off)
    np.testing.assert_allclose(run.log["tcp_position_m"][-1], run.log["target_position_m"][-1], atol=2e-5)
    measured, true = (run.log[name][-200:] for name in ("wrench_measured_tool", "wrench_true_tool"))
    np.testing.assert_allclose(measured, true, atol=0.01)


def test_force_and_moment_are_those_of_the_pose_of_the_same_instant_also_on_a_leaning_plane():
    """Without damping and friction it is k d of the pad's own depth; a step later it would be 0.1 N off."""
    run = cells.on_plane("pad.damping_s_m=0", "pad.friction=0", hold=0.5, lift=0.01).run()
    tool, travel = run.log["tcp_position_m"], run.log["pad_travel_m"]
    frames = Rotation.from_quat(run.log["tcp_quaternion_wxyz"], scalar_first=True)
    pad_height = (tool - travel[:, None] * frames.apply([0.0, 0.0, 1.0]))[:, 2] - cells.TOUCH[2, 3]
    expected = 20000.0 * np.maximum(-pad_height, 0.0)
    assert np.abs(np.diff(expected)).max() > 0.05
    np.testing.assert_allclose(run.log["normal_force_n"], expected, atol=0.005)
    # Pushed aside by the plane, the pad's force has a lever about the tool point and the head's centre.
    leaning = cells.tool_pose(0.0, -0.5, 0.1, (0.05, -0.03, 0.0))
    part = cells.part_under(leaning)
    run = cells.on_plane("controller.name=position", "pad.friction=0", part=part, hold=2.0).run()
    tool, outward = run.log["tcp_position_m"][-1], -leaning[:3, 2]
    R = Rotation.from_quat(run.log["tcp_quaternion_wxyz"][-1], scalar_first=True).as_matrix()
    pad = tool - float(run.log["pad_travel_m"][-1]) * R[:, 2]
    truth = foundation(lambda p: ((leaning[:3, 3] - p) @ outward, np.tile(outward, (len(p), 1))), pad, R)
    moment_at_tool = truth.torque + np.cross(pad - tool, truth.force)
    on_part = -np.concatenate([R.T @ truth.force, R.T @ moment_at_tool])
    assert np.linalg.norm(on_part[:2]) > 0.8
    assert np.linalg.norm(on_part[3:]) > 0.1
    size = np.repeat([np.linalg.norm(on_part[:3]), np.linalg.norm(on_part[3:])], 3)
    for name in ("wrench_true_tool", "wrench_measured_tool"):
        assert np.abs((run.log[name][-1] - on_part) / size).max() < 0.01, name


@pytest.mark.parametrize(("controller", "hz"), [("position", 1.0), ("hybrid-pi", 0.5), ("hybrid-pi", 2.0)])
def test_the_force_on_a_moving_part_is_that_of_the_linear_loop(controller, hz):
    """The tool goes x = C (F0 - F - m x'') / s late, the spring gives F = k (x + d) for the part's travel d.

    C is the PI behind a filter of 10 Hz, k head and pad with their dampers, m what the sensor carries; the
    delay is that of command, sensor, the sensor's low-pass and the servos. Without a force loop F = k d.
    """
    s, travel, mass = 2j * math.pi * hz, 0.0005, 2.0
    motion = f"part.motion_m={travel}", f"part.motion_hz={hz}", "controller.force_filter_hz=10"
    run = cells.on_plane(f"controller.name={controller}", *motion, hold=4.0).run()
    # Its complex amplitude against sin(2 pi f t), over the last turns.
    steps = round((1 if hz < 1.0 else 2) / hz * 1000)
    time, force = run.trace.time_s[-steps:], run.trace.normal_force_n[-steps:]
    found = complex(2j * np.mean((force - force.mean()) * np.exp(-2j * np.pi * hz * time)))
    went = np.outer(travel * np.sin(2.0 * np.pi * hz * run.trace.time_s), [0.0, 0.0, 1.0])
    np.testing.assert_allclose(run.trace.part_shift_m, went, atol=1e-12)
    if controller == "position":
        assert abs(found) == pytest.approx(STIFFNESS * travel, rel=0.02)
        assert cmath.phase(found) == pytest.approx(0.0, abs=0.1)
        return
    delay = 0.006 + 0.002 + 1.0 / (2.0 * math.pi * 80.0) + 0.004
    controller = (0.004 + 0.012 / s) / (1.0 + s / (2.0 * math.pi * 10.0)) * cmath.exp(-s * delay)
    spring = 1.0 / (1.0 / (STIFFNESS * 4.0 / 3.0 + 60.0 * s) + 1.0 / (STIFFNESS * 4.0 + 3.0 * 20.0 * s))
    moved = -controller * spring * travel / (s + controller * (spring + mass * s**2))
    assert abs(found - spring * (moved + travel)) < 0.05 * abs(found)


def scene(T_base_touch, shape):
    """The robot with a colliding pad, over a plane or a ball touched at a tool pose: the engine's own contact
    in place of ours, pressed by the head's spring alone, as stiff."""
    hard = [-500000.0, -1000.0]  # of the engine's contact: stiffness and damping [N/m], [N s/m]
    spec = mujoco.MjSpec.from_file(str(robot_model_path()))
    spec.joint("head_slide").stiffness[0] = STIFFNESS
    pad = spec.geom("head_pad")
    pad.contype, pad.conaffinity, pad.solref = 2, 2, hard
    outward = Rotation.from_matrix(T_base_touch[:3, :3] @ np.diag([1.0, -1.0, -1.0]))
    kind, size, below = {
        "plane": (mujoco.mjtGeom.mjGEOM_PLANE, [0.2, 0.2, 0.01], 0.0),
        "sphere": (mujoco.mjtGeom.mjGEOM_SPHERE, [0.06, 0.0, 0.0], 0.06),
    }[shape]
    spec.worldbody.add_geom(
        name="part", type=kind, size=size, pos=cells.along_tool(T_base_touch, z=below)[:3, 3],
        quat=outward.as_quat(scalar_first=True), contype=2, conaffinity=2, solref=hard,
    )  # fmt: skip
    return spec.compile()


@pytest.mark.parametrize(("T_base_touch", "shape"), [(cells.TOUCH, "plane"), (LEANING, "sphere")])
def test_a_tool_moved_d_into_an_engine_primitive_presses_with_k_d(T_base_touch, shape):
    model, depth, steps = scene(T_base_touch, shape), 0.004, 3000
    above, below = cells.along_tool(T_base_touch, z=-0.005), cells.along_tool(T_base_touch, z=depth)
    stroke = cells.free_stroke(above, below, feed=0.01, hold=2.5)
    cell = cells.cell_for(cells.ideal("force", "controller.name=position"), stroke, model=model)
    advance(cell.kernel, cell.real_arm, build_recorder(steps, 4), np.zeros((steps, 12)), steps)
    mujoco.mj_forward(model, cell.data)
    assert cell.state.status.stop == NO_STOP
    on_part, part = np.zeros(3), model.geom("part").id
    for i, contact in enumerate(cell.data.contact):
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, cell.data, i, wrench)
        on_second = contact.frame.reshape(3, 3).T @ wrench[:3]
        on_part += on_second if contact.geom[1] == part else -on_second
    pushed = T_base_touch[:3, :3].T @ on_part
    assert pushed[2] == pytest.approx(STIFFNESS * depth, rel=0.02)
    assert np.linalg.norm(pushed[:2]) < 0.02 * pushed[2]
    np.testing.assert_allclose(cell.state.measurement.wrench[:3], pushed, atol=0.05)


class NewtonEuler:
    """Collects the difference between sensor and Newton-Euler at every instant.

    After a step the engine's poses and sensors still belong to the instant before it, so speeds are kept from
    one look to the next. Accelerations are what speeds changed by: the engine's precede its implicit step.
    """

    def __init__(self, cell):
        self.worst = []
        self._speeds = cell.data.qvel.copy()
        self.run = cell.run(cells.EachStep(self))

    def __call__(self, model, data):
        origin, R = data.site("sensor").xpos, data.site("sensor").xmat.reshape(3, 3)
        qd, qdd = self._speeds, (data.qvel - self._speeds) / model.opt.timestep
        force, torque = np.zeros(3), np.zeros(3)
        for name in ("tool_mount", "head"):
            body = model.body(name).id
            J, J_turn, J_dot, J_turn_dot = np.zeros((4, 3, model.nv))
            mujoco.mj_jacBodyCom(model, data, J, J_turn, body)
            mujoco.mj_jacDot(model, data, J_dot, J_turn_dot, data.xipos[body], body)
            linear, angular, turning = J @ qdd + J_dot @ qd, J_turn @ qdd + J_turn_dot @ qd, J_turn @ qd
            R_inertia = data.ximat[body].reshape(3, 3)
            inertia = R_inertia @ np.diag(model.body_inertia[body]) @ R_inertia.T
            pull = model.body_mass[body] * (linear - model.opt.gravity) - data.xfrc_applied[body, :3]
            force += pull
            torque += inertia @ angular + np.cross(turning, inertia @ turning) - data.xfrc_applied[body, 3:]
            torque += np.cross(data.xipos[body] - origin, pull)
        self.worst.append(np.abs(data.sensordata - np.concatenate([R.T @ force, R.T @ torque])))
        self._speeds = data.qvel.copy()


def test_the_sensor_reads_m_a_minus_g_at_every_instant_less_the_contact_when_it_presses_and_slides():
    first, last = (cells.tool_pose(x, -0.5, 0.2) for x in (0.0, 0.1))
    stroke = cells.free_stroke(first, cells.tool_pose(0.06, -0.45, 0.25, (0.3, -0.2, 0.4)), last, feed=0.2)
    free = NewtonEuler(cells.cell_for(cells.ideal("arc", cells.EVERY_STEP), stroke))
    assert free.run.trace.tcp_speed_m_s.max() > 0.15
    assert np.max(free.worst) < 1e-9
    on_ball = {"part": cells.part_under(field=cells.sphere(0.1)), "slide": 0.002, "hold": 0.2, "lift": 0.002}
    settings = "spindle.speed_rpm=6000", "sensor.force_noise_n=0.5"
    pressed = NewtonEuler(cells.on_plane(*settings, height=0.002, **on_ball))
    assert pressed.run.stop_reason is None
    assert pressed.run.trace.normal_force_n.max() > 10.0
    assert np.max(pressed.worst) < 1e-9


def test_the_tare_takes_the_bias_out_and_a_wrong_tool_mass_shows_by_how_far_the_tool_has_turned():
    pressed = cells.on_plane("sensor.force_bias_n=5", "sensor.torque_bias_nm=0.2", hold=1.5, lift=0.01).run()
    np.testing.assert_allclose(pressed.log["wrench_raw_sensor"][300, :3], [0.0, 0.0, -2.0 * 9.81], atol=0.01)
    measured = pressed.log["wrench_measured_tool"]
    assert np.abs(measured[:100, :3]).max() > 1.0
    assert np.abs(measured[700:1000] / [0.05, 0.05, 0.05, 0.02, 0.02, 0.02]).max() < 1.0
    process = pressed.log.fed
    true = pressed.log["normal_force_n"][process][-200:]
    np.testing.assert_allclose(true, 20.0, atol=0.1)
    np.testing.assert_allclose(measured[process][-200:, 2], true, atol=0.05)
    # The force loop holds 20 N of what it believes; the rest is the surplus mass by its share's change.
    lean, surplus = 0.6, 0.2 * 2.0 * 9.81
    start = cells.along_tool(cells.tool_pose(0.0, -0.5, 0.1, (lean, 0.0, 0.0)), z=-0.02)
    turning = cells.path_through(start, cells.TOUCH)
    run = cells.on_plane("sensor.payload_mass_error=0.2", hold=1.5, lead_in=turning).run()
    expected = 20.0 - surplus * (1.0 - np.cos(lean))
    assert run.trace.normal_force_n[-1] == pytest.approx(expected, abs=0.1)


STROKE_M = 0.034
FLANGE = [
    "controller.name=position", "head.stiffness_n_m=12000", "head.mass_kg=1.5", f"head.travel_m={STROKE_M}",
    "head.flange.bandwidth_hz=20", "head.flange.friction_n=0", "head.flange.weight_error=0", "pad.friction=0",
]  # fmt: skip


def held(depth, *changes, tilt=0.0):
    """A run that presses the tool, tilted about x, ``depth`` [m] in; and the exact force at its end [N]."""
    touch = cells.tool_pose(0.0, -0.5, 0.2, (tilt, 0.0, 0.0))
    pressed = cells.pressing_stroke(cells.along_tool(touch, z=depth - 0.004), hold=1.5)
    deeper = {"process": pressed.process, "motion": pressed.motion, "depth": depth}
    stroke = cells.pressing_stroke(touch, hold=1.5, **deeper)
    scenario = cells.ideal("force", cells.EVERY_STEP, *FLANGE, *changes)
    run = cells.cell_for(scenario, stroke, part=cells.part_under(touch)).run()
    return run, float(run.trace.normal_force_n[-100:].mean())


@pytest.mark.parametrize("share", [0.15, 0.85])
def test_at_rest_the_part_feels_the_set_force_at_any_stroke(share):
    run, at_rest = held(share * STROKE_M + 0.001)
    assert run.stop_reason is None
    assert run.trace.pad_travel_m[-1] == pytest.approx(share * STROKE_M, abs=2e-4)
    assert at_rest == pytest.approx(20.0, abs=0.02)


def test_at_rest_a_wrong_weight_is_missing_by_its_share_along_the_tool_and_the_slides_friction():
    """The tool points down, tilted by the angle: error x m g cos(angle) too much is lifted."""
    for angle in (0.0, 0.8):
        _, at_rest = held(0.018, "head.flange.weight_error=0.2", tilt=angle)
        assert at_rest - 20.0 == pytest.approx(-0.2 * 1.5 * GRAVITY * math.cos(angle), abs=0.03)
    _, at_rest = held(0.018, "head.flange.friction_n=3")
    assert abs(at_rest - 20.0) == pytest.approx(3.0, abs=0.01)


def test_the_force_rises_over_the_ramp_and_the_loop_lags_behind_it_and_fast_motion():
    """F = 2 + 18 t / T behind a first-order lag; the arm's own motion adds k v / (2 pi f), 0.7 N. Pressed in
    at v by the air it compresses: k v dt / (e^(2 pi f dt) - 1), in short steps k v / (2 pi f)."""
    soft = ["head.stiffness_n_m=2000", "head.damping_n_s_m=0"]
    run = held(0.018, "head.flange.ramp_s=0.4", "head.flange.start_force_n=2", *soft)[0].trace
    off_stop = run.time_s[np.argmax((run.pad_travel_m > 0.0) & (run.normal_force_n > 1.0))]
    for reached in (10.0, 18.0):
        expected = (reached - 2.0) / 18.0 * 0.4 + 1.0 / (2.0 * math.pi * 20.0)
        after = run.time_s[np.argmax(run.normal_force_n > reached)] - off_stop
        assert after == pytest.approx(expected, abs=0.03)
    gentle = held(0.018, "head.damping_n_s_m=0")[0].trace
    sinking = (gentle.phase == TOUCH_PHASE) & (gentle.pad_travel_m > 0.010) & (gentle.pad_travel_m < 0.014)
    speed = np.gradient(gentle.pad_travel_m, 0.001)[sinking].mean()
    lag = 12000.0 * speed * 0.001 / math.expm1(2.0 * math.pi * 20.0 * 0.001)
    assert gentle.normal_force_n[sinking].mean() - 20.0 == pytest.approx(lag, rel=0.02)


@pytest.mark.parametrize(("depth", "share"), [(0.0015, 0.02), (0.034, 0.97)])
def test_the_robot_stops_near_either_end_of_the_stroke(depth, share):
    run, _ = held(depth)
    assert str(run.stop_reason).startswith(REASONS[STROKE][:30])
    assert float(run.safety.protective_stop_measured.split("%")[0]) == pytest.approx(100 * share, abs=2.5)
