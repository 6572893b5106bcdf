"""The robot program is run by our URScript machine: what it does to the tool is what the plan says."""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.config import PartConfig, PlanConfig, ProcessConfig
from polish_sim.exchange import ExportSetup
from polish_sim.exchange.strokes import feed_frames
from polish_sim.exchange.urscript import STANDOFF_M, urscript_text
from polish_sim.planning import plan_part
from polish_sim.planning.toolpath import LEAD_IN
from polish_sim.spatial import from_pose, inverse
from tests.planning.shapes import shipped_plan, to_polyline
from tests.ur.fake_robot import FakeRobot, Notes

pytest.importorskip("lark")
PART_POSE = (0.4, -0.3, 0.1, 0.1, -0.2, 0.7)
MIDDLE = np.array([0.0, 0.0, 0.035 - 0.1])  #: Middle of the sphere of 100 mm radius whose cap `sphere_100` is
SETUP = ExportSetup(part_pose=PART_POSE)
PRINTED_M = 2e-6
sphere, holes = partial(shipped_plan, "sphere_100"), partial(shipped_plan, "plate_two_holes")


class Motion(NamedTuple):
    T_base_tool: Array
    speed: float
    blend: float
    pressing: bool
    spindle: bool


class Pressing(NamedTuple):
    T_base_task: Array
    T_base_tool: Array
    selection: list[float]
    wrench: list[float]
    kind: int
    limits: list[float]


class Recorder(FakeRobot):
    """Its joints are its pose; it feels the force wanted some time after it began to press."""

    def __init__(self, contact_after_s):
        super().__init__()
        self.contact_after_s = contact_after_s
        self.motions = []
        self.pressings = []
        self.pressing_since_s = np.inf
        self.spindle = False

    def step(self):
        super().step()
        felt = self.time_s - self.pressing_since_s > self.contact_after_s
        self.tcp_force = np.array([0.0, 0.0, self.pressings[-1].wrench[2] if felt else 0.0, 0.0, 0.0, 0.0])

    def forward_kin(self, q, tcp):
        return q

    def inverse_kin(self, x, qnear, tcp):
        return x

    def movel(self, pose, a, v, r=0.0):
        self.actual_tcp_pose = pose
        self.motions.append(Motion(from_pose(pose), v, r, False, self.spindle))

    def movej(self, q, a, v):
        self.movel(q, a, v)

    def force_mode(self, task_frame, selection_vector, wrench, type, limits):
        if self.pressing_since_s == np.inf:
            self.pressing_since_s = self.time_s
            self.told.append(("force_mode",))
        self.motions[-1] = self.motions[-1]._replace(pressing=True)
        frames, axes = (from_pose(task_frame), from_pose(self.actual_tcp_pose)), selection_vector.tolist()
        self.pressings.append(Pressing(*frames, axes, wrench.tolist(), type, limits.tolist()))

    def end_force_mode(self):
        if self.pressing_since_s < np.inf:
            self.told.append(("end_force_mode",))
        self.pressing_since_s = np.inf

    def write(self, name, index, value):
        self.spindle = bool(value)
        self.told.append((f"spindle {self.spindle}",))


def run_program(text, contact_after_s=0.05):
    from polish_sim.ur.script import Machine  # they need lark
    from polish_sim.ur.script.translate import translate

    robot, notes = Recorder(contact_after_s), Notes()
    machine = Machine(translate(text), notes)
    for _ in range(100_000):
        machine.tick(robot)
        robot.step()
        if machine.popup_open:
            robot.told.append(("popup",))
            machine.close_popup()
        if not machine.running:
            break
    assert not machine.running
    assert "exception" not in [event[0] for event in notes.events], notes.events
    return robot


def executed(result, setup=SETUP):
    return run_program(urscript_text(result, setup))


@pytest.fixture(scope="module")
def ball():
    return executed(sphere())


@pytest.fixture(scope="module")
def plate():
    return executed(holes())


def in_work(T_base_tool):
    return np.asarray(inverse(from_pose(PART_POSE)) @ np.stack(T_base_tool))


def test_the_tool_is_declared_zeroed_pressed_lifted_and_switched_off_in_this_order(ball, plate):
    order = ["set_tcp", "set_payload", "spindle False", "zero_ftsensor", "spindle True", "force_mode"]
    places = [ball.names().index(event) for event in [*order, "end_force_mode"]]
    assert places == sorted(places), "the sensor is zeroed with the spindle still"
    for machine, lifts in ((ball, 1), (plate, holes().figures["retracts"])):
        events = machine.names()
        assert events.count("force_mode") == events.count("end_force_mode") == lifts
        assert [event for event in events if event != "stopj"][-2:] == ["end_force_mode", "spindle False"]
        assert all(motion.spindle for motion in machine.motions if motion.pressing)
        place = np.stack([motion.T_base_tool[:3, 3] for motion in machine.motions])
        blend = np.array([motion.blend for motion in machine.motions])
        assert (blend[:-1] + blend[1:] < np.linalg.norm(np.diff(place, axis=0), axis=1) + 1e-12).all()
        assert blend.max() > 0.0


def test_moves_in_contact_run_through_the_unpressed_path_in_force_mode_and_nothing_else_touches(ball, plate):
    path = sphere().path
    corners = in_work([motion.T_base_tool for motion in ball.motions if motion.pressing])[:, :3, 3]
    planned = path.positions_work[path.process | (path.segment == LEAD_IN)]
    assert np.linalg.norm(corners[:, None] - planned, axis=2).min(axis=1).max() < PRINTED_M
    assert (np.linalg.norm(corners - MIDDLE, axis=1) > 0.1 - 1e-5).all()
    assert to_polyline(path.positions_work[path.process], corners).max() < 5.2e-5
    # x keeps its direction over all turns of the spiral; along the feed it would go round once per turn.
    x_axes = np.stack([motion.T_base_tool[:3, 0] for motion in ball.motions])
    middle = x_axes.mean(axis=0)
    assert (x_axes @ middle / np.linalg.norm(middle)).min() > np.cos(np.radians(40.0))
    assert np.linalg.norm(feed_frames(sphere().path)[:, :, 0].mean(axis=0)) < 0.2
    for machine, result in ((ball, sphere()), (plate, holes())):
        free = in_work([motion.T_base_tool for motion in machine.motions if not motion.pressing])[:, :3, 3]
        assert np.linalg.norm(result.surface.closest(free).positions - free, axis=1).min() > 0.9e-3
    first_pressed = next(k for k, motion in enumerate(ball.motions) if motion.pressing)
    landing = in_work([motion.T_base_tool for motion in ball.motions[:first_pressed]])[:, :3, 3]
    height = np.linalg.norm(landing - MIDDLE, axis=1) - 0.1
    assert height.min() == pytest.approx(STANDOFF_M, abs=1e-5)
    moved = [p for p in ball.pressings if not np.array_equal(p.T_base_tool, ball.pressings[0].T_base_tool)]
    assert len(moved) > 200
    task = in_work([pressing.T_base_task for pressing in moved])
    inward = MIDDLE - task[:, :3, 3]
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    # 0.1 deg: what a fitted surface of 1.6 mm facets is allowed to be off the true sphere.
    angle = np.degrees(np.arcsin(np.linalg.norm(np.cross(task[:, :3, 2], inward), axis=1)))
    assert angle.max() < 0.1
    assert (np.sum(task[:, :3, 2] * inward, axis=1) > 0.0).all()
    for pressing in ball.pressings:
        assert (pressing.selection, pressing.kind) == ([0, 0, 1, 0, 0, 0], 2)
        assert pressing.wrench == [0, 0, 20.0, 0, 0, 0]
        assert pressing.limits[2] == 0.005  # [m/s], the landing speed
        assert max(pressing.limits[:2]) <= 0.01


def test_without_contact_the_program_switches_everything_off_and_without_a_measured_part_it_never_moves():
    machine, path = run_program(urscript_text(sphere(), SETUP), contact_after_s=np.inf), sphere().path
    ended = [event for event in machine.names() if event != "stopj"]
    assert ended[ended.index("end_force_mode") :] == ["end_force_mode", "spindle False", "popup"]
    first = np.flatnonzero(path.process)[0]
    pressed = in_work([motion.T_base_tool for motion in machine.motions if motion.pressing])[:, :3, 3]
    beside = np.cross(pressed - path.positions_work[first], path.axes_work[first])
    assert np.abs(beside).max() < PRINTED_M, "only the landing itself, straight down"
    robot = executed(sphere(), ExportSetup())
    assert robot.motions == []
    assert "popup" in robot.names()


def test_an_arc_is_followed_to_its_end_in_force_mode_so_that_the_tool_lands_on_the_move():
    result = plan_part(PartConfig(file="sphere_100"), PlanConfig(lead_in="arc"))
    machine = executed(result)
    first = np.flatnonzero(result.path.process)[0]
    places = in_work([motion.T_base_tool for motion in machine.motions])[:, :3, 3]
    pressing = np.flatnonzero([motion.pressing for motion in machine.motions])
    landed = int(np.linalg.norm(places - result.path.positions_work[first], axis=1).argmin())
    assert pressing[0] < landed
    feed = result.path.positions_work[first + 1] - result.path.positions_work[first]
    lead = places[landed] - places[landed - 1]
    assert lead @ feed > np.cos(np.radians(15.0)) * np.linalg.norm(lead) * np.linalg.norm(feed)
    height = (places[pressing[0] - 1] - places[landed]) @ result.path.axes_work[first]
    assert height == pytest.approx(STANDOFF_M, abs=PRINTED_M)


def test_speed_and_force_are_those_of_the_process_or_waypoint_and_without_leads_it_lands_from_above():
    slow = executed(sphere(), replace(SETUP, process=ProcessConfig(contact_force_n=12.0, feed_m_s=0.02)))
    assert {pressing.wrench[2] for pressing in slow.pressings} == {12.0}
    assert {motion.speed for motion in slow.motions if motion.blend > 0.0} == {0.02}
    count = len(sphere().path.s)
    force = np.where(np.arange(count) < count // 2, 10.0, 15.0)
    machine = executed(replace(sphere(), path=replace(sphere().path, force=force, feed=np.full(count, 0.03))))
    assert (machine.pressings[0].wrench[2], machine.pressings[-1].wrench[2]) == (10.0, 15.0)
    assert {motion.speed for motion in machine.motions if motion.blend > 0.0} == {0.03}
    machine = executed(replace(sphere(), path=sphere().path.rows(sphere().path.process)))
    ends = in_work([machine.motions[k].T_base_tool for k in (0, -1)])[:, :3, 3]
    assert np.linalg.norm(ends - MIDDLE, axis=1) - 0.1 == pytest.approx([0.03, 0.03], abs=1e-5)


def test_the_program_says_where_the_part_is_why_the_path_is_not_pressed_in_and_has_short_functions():
    text = urscript_text(holes(), SETUP)
    head = text[: text.index("def ")]
    assert "ON the surface" in head
    assert "Never run these poses pressed in" in head
    assert f"global T_base_work = p[{', '.join(f'{value:.6g}' for value in PART_POSE)}]" in text
    assert max(len(function.splitlines()) for function in text.split("\n  end")) <= 220
    assert max(map(len, text.splitlines())) < 160
