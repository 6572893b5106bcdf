"""Every method of the unmodified ur_rtde wheel, called against `polish-sim serve`, each with a check of its
effect.

    pip install ur_rtde
    python -m benchmarks.served_methods [--address 127.0.0.6] [--polyscope 5.11]

Prints the methods that answer as documented, those with a difference (which it says), those that do not
answer, with the reason, and those that fail; ends with 1 where one fails, or where the wheel has a method
nothing is said about.
"""

from __future__ import annotations

import argparse
import inspect
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import dashboard_client
import numpy as np
import rtde_control
import rtde_io
import rtde_receive
from scipy.spatial.transform import Rotation

from benchmarks.served import serving
from polish_sim.motion import jacobian

PLAIN = "as documented"
NOT = "not: "  #: Begins the reason why a method does not answer
LATE = "the wheel does not wait for the answer and gives what the method before it left: call it twice"
CURRENT = "of the present joints, speeds and TCP: the wheel's script leaves its arguments out"
WHAT = {
    "RTDEControlInterface": rtde_control.RTDEControlInterface,
    "RTDEReceiveInterface": rtde_receive.RTDEReceiveInterface,
    "RTDEIOInterface": rtde_io.RTDEIOInterface,
    "DashboardClient": dashboard_client.DashboardClient,
}


class Trial:
    """Calls and what became of them, by class and method."""

    def __init__(self, host: str, version: str) -> None:
        self.host, self.said = host, dict[tuple[str, str], str]()
        self.version = _version(version)
        self.dashboard = dashboard_client.DashboardClient(host)
        self.dashboard.connect()
        self.control = rtde_control.RTDEControlInterface(host)
        self.receive = rtde_receive.RTDEReceiveInterface(host)
        self.io = rtde_io.RTDEIOInterface(host)

    def check(
        self, thing: Any, method: str, good: Callable[[], Any], differs: str = PLAIN, since: str = "5.0"
    ) -> None:
        """``good`` calls the method and says whether what is to follow has followed; it is not called where
        the wheel's script has the method ``since`` a later version of PolyScope."""
        name = type(thing).__name__, method
        assert hasattr(thing, method), name
        if self.version < _version(since):
            self.said[name] = f"{NOT}in the wheel's script from PolyScope {since} on"
            return
        try:
            fine, why = bool(good()), "its effect is missing"
        except Exception as error:
            fine, why = False, f"{type(error).__name__}: {error}"
        if not fine:
            differs = f"FAILS: {why}"
            print(*name, differs, flush=True)
        if fine and "FAILS" in self.said.get(name, ""):
            return
        self.said[name] = differs


def _version(text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(".")))


def again(call: Callable[[], Any]) -> Any:
    """The second answer of a method that does not wait for its own."""
    call()
    time.sleep(0.1)
    return call()


def near(a: Sequence[float], b: Sequence[float], most: float) -> bool:
    """Whether two vectors are no further apart."""
    return len(a) == len(b) and float(np.abs(np.asarray(a) - np.asarray(b)).max()) <= most


def until(done: Callable[[], bool], most_s: float = 8.0) -> bool:
    """Wait for something."""
    end = time.monotonic() + most_s
    while time.monotonic() < end:
        if done():
            return True
        time.sleep(0.01)
    return False


def moved(pose: Sequence[float], *way: float) -> list[float]:
    """A pose some way off in the base."""
    return [a + b for a, b in zip(pose, (*way, *[0.0] * (6 - len(way))), strict=True)]


def twice(call: Callable[[], Any], seconds: float, cycle: float = 0.002) -> bool:
    """Call in every cycle for some time."""
    good, end = True, time.monotonic() + seconds
    while time.monotonic() < end:
        good = bool(call()) and good
        time.sleep(cycle)
    return good


def motions(t: Trial) -> None:
    """Moves, speeds, servoing, paths."""
    c, r = t.control, t.receive
    home, q0 = moved(r.getActualTCPPose(), 0.0, 0.0, 0.06), []
    t.check(c, "moveL", lambda: c.moveL(home, 0.2, 0.8) and near(r.getActualTCPPose()[:3], home[:3], 2e-3))
    q0 = r.getActualQ()
    q1 = [*q0[:5], q0[5] + 0.2]
    there = moved(home, 0.05, 0.05)

    def at(pose: Sequence[float]) -> bool:
        return until(lambda: near(r.getActualTCPPose()[:3], pose[:3], 1.5e-3), 3.0)

    def back() -> None:
        c.moveJ(q0, 1.0, 2.0)

    t.check(c, "moveJ", lambda: c.moveJ(q1, 1.0, 2.0) and near(r.getActualQ(), q1, 3e-3))
    path = [[*q, 1.0, 2.0, blend] for q, blend in ((q0, 0.0), (q1, 0.0), (q0, 0.0))]
    t.check(c, "moveJ", lambda: c.moveJ(path) and near(r.getActualQ(), q0, 3e-3))
    t.check(c, "moveJ_IK", lambda: c.moveJ_IK(there, 1.0, 2.0) and at(there))
    lines = [
        [*pose, 0.1, 0.8, blend] for pose, blend in ((home, 0.0), (moved(home, 0.05), 0.01), (there, 0.0))
    ]
    t.check(c, "moveL", lambda: c.moveL(lines) and at(there))
    t.check(c, "moveL_FK", lambda: c.moveL_FK(q0, 0.2, 0.8) and at(home))
    way = rtde_control.Path()
    entry = rtde_control.PathEntry
    way.addEntry(entry(entry.MoveL, entry.PositionTcpPose, [*there, 0.1, 0.8, 0.0]))
    way.addEntry(entry(entry.MoveJ, entry.PositionJoints, [*q0, 1.0, 2.0, 0.0]))
    t.check(c, "movePath", lambda: c.movePath(way) and near(r.getActualQ(), q0, 3e-3))

    def asynchronous() -> bool:
        c.moveL(there, 0.05, 0.5, True)
        return until(lambda: c.getAsyncOperationProgressEx().isAsyncOperationRunning(), 2.0)

    t.check(c, "getAsyncOperationProgressEx", asynchronous)
    t.check(c, "getAsyncOperationProgress", lambda: c.getAsyncOperationProgress() >= 0)
    t.check(c, "stopL", lambda: c.stopL(2.0) is None and until(c.isSteady, 2.0) and not near(
        r.getActualTCPPose()[:3], there[:3], 2e-3))  # fmt: skip
    t.check(c, "isSteady", lambda: until(c.isSteady, 2.0))
    c.moveJ(q1, 0.3, 2.0, True)
    time.sleep(0.2)
    t.check(
        c,
        "stopJ",
        lambda: c.stopJ(4.0) is None and until(c.isSteady, 2.0) and not near(r.getActualQ(), q1, 0.01),
    )
    back()

    def servo_joints() -> bool:
        for k in range(250):
            begin = c.initPeriod()
            c.servoJ([*q0[:5], q0[5] + 0.1 * k / 250], 0.0, 0.0, 0.002, 0.1, 300)
            c.waitPeriod(begin)
        return until(lambda: near(r.getActualQ(), [*q0[:5], q0[5] + 0.1], 5e-3), 1.0)

    t.check(c, "servoJ", servo_joints, "the gain does nothing, the look-ahead is a filter's lag")
    t.check(c, "servoStop", lambda: c.servoStop() and until(c.isSteady, 2.0))
    back()

    def servo_line(call: Callable[[list[float]], Any]) -> bool:
        for k in range(250):
            begin = c.initPeriod()
            call(moved(home, 0.02 * min(k / 200, 1.0)))
            c.waitPeriod(begin)
        good = at(moved(home, 0.02))
        c.servoStop()
        back()
        return good

    t.check(c, "servoL", lambda: servo_line(lambda pose: c.servoL(pose, 0.0, 0.0, 0.002, 0.1, 300)),
            "the gain does nothing, the look-ahead is a filter's lag")  # fmt: skip

    def servo_circle() -> bool:
        good = c.servoC(there, 0.25, 1.2, 0.0) and at(there)
        c.servoStop()  # refused after 4 s, see below
        return c.servoStop() and good

    differs = (
        "corners are not rounded; the wheel's script takes nothing after it until its client has waited 4 s"
    )
    t.check(c, "servoC", servo_circle, differs)
    back()
    t.check(c, "speedJ", lambda: c.speedJ([0, 0, 0, 0, 0, 0.3], 2.0, 0.5) and until(
        lambda: near(r.getActualQd(), [0, 0, 0, 0, 0, 0.3], 0.03), 1.0))  # fmt: skip
    t.check(c, "speedStop", lambda: c.speedStop() and until(c.isSteady, 2.0))
    back()
    t.check(c, "speedL", lambda: c.speedL([0, 0, 0.02, 0, 0, 0], 0.5, 0.5) and until(
        lambda: near(r.getActualTCPSpeed()[:3], [0, 0, 0.02], 3e-3), 1.0))  # fmt: skip
    c.speedStop()
    t.check(c, "jogStart", lambda: c.jogStart([20.0, 0, 0, 0, 0, 0]) and until(
        lambda: r.getActualTCPSpeed()[0] > 0.005, 2.0))  # fmt: skip
    t.check(c, "jogStop", lambda: c.jogStop() and until(c.isSteady, 2.0))
    back()
    t.check(c, "initPeriod", lambda: c.initPeriod().total_seconds() > 0.0)

    def paced(thing: Any) -> bool:
        begin = time.monotonic()
        for _ in range(100):
            thing.waitPeriod(thing.initPeriod())
        return 0.18 < time.monotonic() - begin < 0.6

    t.check(c, "waitPeriod", lambda: paced(c))
    t.check(r, "initPeriod", lambda: r.initPeriod().total_seconds() > 0.0)
    t.check(r, "waitPeriod", lambda: paced(r))


def force(t: Trial) -> None:
    """Sensor, force mode, contact, free drive, torque."""
    c, r = t.control, t.receive
    home, q0 = r.getActualTCPPose(), r.getActualQ()
    t.check(c, "zeroFtSensor", lambda: c.zeroFtSensor() and until(
        lambda: np.linalg.norm(r.getActualTCPForce()[:3]) < 2.0, 1.0))  # fmt: skip
    limits = [0.01, 0.01, 0.02, 0.1, 0.1, 0.1]

    def sunk(seconds: float) -> float:
        """How far 10 N down carry the free arm [m]; in force mode a robot is never steady."""
        before = r.getActualTCPPose()[2]
        assert c.forceMode([0.0] * 6, [0, 0, 1, 0, 0, 0], [0, 0, -10.0, 0, 0, 0], 2, limits)
        time.sleep(seconds)
        assert not c.isSteady()
        return float(before - r.getActualTCPPose()[2])

    def least(call: Callable[[float], Any], none: float, usual: float) -> bool:
        """Full damping, or no gain, leaves the arm where it is."""
        good = call(none) and abs(sunk(0.5)) < 1.5e-3 and c.forceModeStop()
        return bool(call(usual) and good)

    t.check(c, "forceModeSetDamping", lambda: least(c.forceModeSetDamping, 1.0, 0.025))
    t.check(c, "forceModeSetGainScaling", lambda: least(c.forceModeSetGainScaling, 0.0, 0.5))
    law = "law of our controller force-mode: what is public of a robot's"
    t.check(c, "forceMode", lambda: 0.005 < sunk(1.0) < 0.0205, law)
    t.check(c, "forceModeStop", lambda: c.forceModeStop() and until(c.isSteady, 2.0))
    c.moveL(home, 0.1, 0.5)
    down = [0, 0, -1.0, 0, 0, 0]
    t.check(c, "toolContact", lambda: again(lambda: c.toolContact(down)) == 0, LATE)
    t.check(c, "moveUntilContact", lambda: c.moveUntilContact([0, 0, -0.02, 0, 0, 0]) and until(
        lambda: home[2] - r.getActualTCPPose()[2] > 0.03, 1.0))  # fmt: skip
    part = r.getActualTCPPose()[2]
    c.moveL(home, 0.05, 0.5)
    # Without contact it is False; in the wheel a direction whose sum is not above 0 counts as none, so that
    # the speed is taken, which is the same here.
    t.check(c, "startContactDetection", lambda: c.startContactDetection(down))
    t.check(c, "readContactDetection", lambda: c.readContactDetection() is False)
    t.check(c, "stopContactDetection", lambda: c.stopContactDetection() is False)
    c.startContactDetection(down)
    c.moveL(moved(home, 0.0, 0.0, part - home[2] - 0.005), 0.02, 0.5, True)
    time.sleep((home[2] - part) / 0.02 + 2.0)
    t.check(c, "startContactDetection", lambda: abs(r.getActualTCPPose()[2] - part) < 2e-3,
            "do not poll: the wheel's script loses a contact found in the cycle a call ends in")  # fmt: skip
    t.check(c, "readContactDetection", lambda: c.readContactDetection() is True)
    t.check(c, "stopContactDetection", lambda: c.stopContactDetection() is True)
    c.moveL(home, 0.05, 0.5)
    free = "nobody leads the arm"
    t.check(c, "teachMode", lambda: c.teachMode() and not c.isSteady(), free)
    t.check(c, "endTeachMode", lambda: c.endTeachMode() and until(c.isSteady, 2.0))
    t.check(c, "freedriveMode", lambda: c.freedriveMode() and not c.isSteady(), free)
    t.check(c, "getFreedriveStatus", lambda: c.getFreedriveStatus() == 0)
    t.check(c, "endFreedriveMode", lambda: c.endFreedriveMode() and until(c.isSteady, 2.0))

    def torque() -> bool:
        q = r.getActualQ()
        good = twice(lambda: c.directTorque([0.0] * 6), 0.3)
        return good and near(r.getActualQ(), q, 0.02)

    # Before 5.26 the wheel's script has an empty branch for it, and a loop that waits for nothing: a robot
    # stops such a programme.
    t.check(
        c,
        "directTorque",
        torque,
        "friction is that of the simulated joints; the wheel gives its scales as 0, whatever is asked for",
        "5.26",
    )
    c.moveJ(q0, 1.0, 2.0)

    def unfed() -> bool:
        return until(lambda: r.getRuntimeState() == 4, 2.0)

    def goes_on() -> bool:
        t.dashboard.play()
        return until(c.isProgramRunning, 2.0)

    t.check(
        c, "ftRtdeInputEnable", lambda: c.ftRtdeInputEnable(True) and unfed() and goes_on()
        and c.ftRtdeInputEnable(False) and c.zeroFtSensor(),
        "nothing feeds it, see setExternalForceTorque: the programme pauses after 0.1 s",
    )  # fmt: skip
    t.check(
        c, "enableExternalFtSensor", lambda: c.enableExternalFtSensor(True) and unfed() and goes_on()
        and c.enableExternalFtSensor(False),
        "as ftRtdeInputEnable",
    )  # fmt: skip
    t.check(
        c, "setExternalForceTorque", lambda: c.setExternalForceTorque([0, 0, 7.0, 0, 0, 0])
        and c.isConnected() and c.zeroFtSensor(),
        f"{NOT}the wheel sends 52 bytes in a recipe of 56, which is ignored; other clients can",
    )  # fmt: skip


def tool(t: Trial) -> None:
    """TCP, payload, kinematics, dynamics."""
    c, r = t.control, t.receive
    q, offset = r.getActualQ(), c.getTCPOffset()
    t.check(c, "getTCPOffset", lambda: len(offset) == 6)
    # The wheel leaves an offset of nothing but zeros out of its packet: the robot keeps the one before.
    flange = c.getForwardKinematics(q, [0.0, 0.0, 1e-9, 0.0, 0.0, 0.0])
    t.check(c, "getActualToolFlangePose", lambda: near(
        again(c.getActualToolFlangePose)[:3], flange[:3], 1e-3), LATE)  # fmt: skip
    t.check(c, "setTcp", lambda: c.setTcp([0.0] * 6) and until(
        lambda: near(r.getActualTCPPose()[:3], flange[:3], 1e-3), 1.0) and c.setTcp(offset))  # fmt: skip
    mass, cog = r.getPayload(), r.getPayloadCog()
    t.check(c, "setPayload", lambda: c.setPayload(mass + 0.1, cog) and until(
        lambda: abs(r.getPayload() - mass - 0.1) < 1e-6, 1.0), "it holds at once")  # fmt: skip
    inertia = [0.01, 0.02, 0.03, 0.0, 0.0, 0.0]
    t.check(c, "setTargetPayload", lambda: c.setTargetPayload(mass, cog, inertia) and until(
        lambda: near(r.getPayloadInertia(), inertia, 1e-9), 1.0), "it holds at once")  # fmt: skip
    t.check(c, "setGravity", lambda: c.setGravity([0.0, 0.0, 9.82]), "only for a robot that stands upright")
    pose = r.getActualTCPPose()
    t.check(c, "getForwardKinematics", lambda: near(c.getForwardKinematics(q, offset)[:3], pose[:3], 1e-3),
            "with an offset of zeros the wheel sends the joints alone: give 1e-9 m for 0")  # fmt: skip
    t.check(c, "getInverseKinematics", lambda: near(c.getInverseKinematics(pose, q), q, 3e-3))
    t.check(c, "getInverseKinematicsHasSolution", lambda: c.getInverseKinematicsHasSolution(pose)
            and not c.getInverseKinematicsHasSolution([3.0, 0, 0, 0, 0, 0]))  # fmt: skip
    far = lambda at: np.array(c.getForwardKinematics(list(at), offset))[:3]  # noqa: E731
    steps = 1e-4 * np.eye(6)
    slope = np.column_stack([(far(q + h) - far(q - h)) / 2e-4 for h in steps])
    six = lambda flat: np.array(flat).reshape(6, 6, order="F")  # noqa: E731 - columns, one after the other
    t.check(c, "getJacobian", lambda: near(
        six(c.getJacobian())[:3].ravel(), slope.ravel(), 1e-3), CURRENT, "5.23")  # fmt: skip

    def turning() -> bool:
        c.speedJ([0.3, 0.0, 0.0, 0.0, 0.0, 0.3], 2.0)
        time.sleep(0.4)
        there, qd, found = (np.array(v) for v in (
            r.getActualQ(), r.getActualQd(), c.getJacobianTimeDerivative()))  # fmt: skip
        c.speedStop()
        ahead, behind = (jacobian(there + h * qd, np.array(offset[:3])) for h in (1e-4, -1e-4))
        return near(six(found).ravel(), ((ahead - behind) / 2e-4).ravel(), 0.02) and np.ptp(found) > 0.1

    t.check(c, "getJacobianTimeDerivative", turning, CURRENT, "5.23")

    def inertia_matrix() -> bool:
        M = six(c.getMassMatrix())
        return near(M.ravel(), M.T.ravel(), 1e-9) and np.linalg.eigvalsh(M)[0] > 0.0

    # 1 of 2000 of these answers was the one before: the wheel waits for 2 ms, on a busy machine not enough.
    t.check(
        c,
        "getMassMatrix",
        lambda: inertia_matrix() or inertia_matrix(),
        f"with the tool and without rotors; {CURRENT}",
        "5.23",
    )
    c.moveJ(q, 1.0, 2.0)
    t.check(c, "getCoriolisAndCentrifugalTorques", lambda: near(
        c.getCoriolisAndCentrifugalTorques(), [0.0] * 6, 1e-2), CURRENT, "5.23")  # fmt: skip
    # At rest in the air no joint feels more than its friction, and none of the arm's weight.
    t.check(c, "getJointTorques", lambda: near(again(c.getJointTorques), [0.0] * 6, 6.0)
            and np.ptp(r.getTargetMoment()) > 20.0, LATE)  # fmt: skip
    t.check(c, "getTargetJointAccelerations", lambda: near(
        again(c.getTargetJointAccelerations), [0.0] * 6, 0.1), LATE, "5.23")  # fmt: skip
    t.check(c, "getTargetWaypoint", lambda: near(c.getTargetWaypoint()[:3], r.getTargetTCPPose()[:3], 1e-4))
    t.check(c, "getActualJointPositionsHistory", lambda: near(
        again(lambda: c.getActualJointPositionsHistory(5)), q, 3e-3), LATE)  # fmt: skip
    t.check(c, "isJointsWithinSafetyLimits", lambda: c.isJointsWithinSafetyLimits(q)
            and not c.isJointsWithinSafetyLimits([10.0] * 6))  # fmt: skip
    t.check(c, "isPoseWithinSafetyLimits", lambda: c.isPoseWithinSafetyLimits(pose)
            and not c.isPoseWithinSafetyLimits([3.0, 0, 0, 0, 0, 0]))  # fmt: skip
    a, b = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0.3, -0.2, 0.1, -0.4, 0.2, 0.3]
    R = Rotation.from_rotvec(a[3:])
    product = [*(np.array(a[:3]) + R.apply(b[:3])), *(R * Rotation.from_rotvec(b[3:])).as_rotvec()]
    t.check(c, "poseTrans", lambda: near(c.poseTrans(a, b), product, 1e-6))


def state(t: Trial) -> None:
    """What the robot says of itself."""
    c, r, io = t.control, t.receive, t.io
    t.check(c, "getStepTime", lambda: again(c.getStepTime) == 0.002, LATE)
    t.check(c, "getRobotStatus", lambda: c.getRobotStatus() == 3)
    t.check(r, "getRobotStatus", lambda: r.getRobotStatus() == 3)
    for thing in (c, r, io, t.dashboard):
        t.check(thing, "isConnected", thing.isConnected)
    t.check(c, "isProgramRunning", c.isProgramRunning)
    still = [0.0] * 6
    for name, value, most in (
        ("ActualQ", r.getTargetQ(), 3e-3),
        ("TargetQ", r.getActualQ(), 3e-3),
        ("ActualQd", still, 0.03),
        ("TargetQd", still, 1e-9),
        ("TargetQdd", still, 1e-6),
        ("ActualTCPSpeed", still, 0.02),
        ("TargetTCPSpeed", still, 1e-9),
        ("ActualTCPForce", still, 3.0),
        ("ActualTCPPose", r.getTargetTCPPose(), 3e-3),
        ("TargetTCPPose", c.getForwardKinematics(r.getTargetQ(), c.getTCPOffset()), 1e-6),
        ("PayloadInertia", [0.01, 0.02, 0.03, 0.0, 0.0, 0.0], 1e-9),  # set by `tool`
    ):
        t.check(r, f"get{name}", lambda name=name, value=value, most=most: near(
            getattr(r, f"get{name}")(), value, most))  # fmt: skip
    t.check(r, "getTargetMoment", lambda: 20.0 < abs(r.getTargetMoment()[1]) < 80.0)  # the arm's weight
    t.check(r, "getFtRawWrench", lambda: np.ptp(r.getFtRawWrench()) > 0.0)
    for name in ("ActualCurrent", "TargetCurrent", "JointControlOutput"):
        t.check(r, f"get{name}", lambda name=name: np.ptp(getattr(r, f"get{name}")()) > 0.0,
                "torque over a constant of each joint")  # fmt: skip
    for name, value in (("JointTemperatures", [30.0] * 6), ("ActualJointVoltage", [48.0] * 6),
                        ("ActualToolAccelerometer", [0.0, 0.0, 9.81])):  # fmt: skip
        t.check(r, f"get{name}", lambda name=name, value=value: near(getattr(r, f"get{name}")(), value, 1e-9),
                "rests: the cell has none")  # fmt: skip
    for name, value in (
        ("ActualExecutionTime", 1.0),
        ("ActualMomentum", 0.0),
        ("ActualMainVoltage", 48.0),
        ("ActualRobotVoltage", 48.0),
        ("ActualRobotCurrent", 0.5),
        ("StandardAnalogInput0", 0.0),
        ("StandardAnalogInput1", 0.0),
        ("ActualDigitalInputBits", 0),
    ):
        t.check(r, f"get{name}", lambda name=name, value=value: getattr(r, f"get{name}")() == value,
                "rests: the cell has none")  # fmt: skip
    t.check(r, "getDigitalInState", lambda: r.getDigitalInState(0) is False, "rests: the cell has none")
    t.check(r, "getJointMode", lambda: list(r.getJointMode()) == [253] * 6)
    t.check(r, "getPayload", lambda: 0.5 < r.getPayload() < 3.0)
    t.check(r, "getPayloadCog", lambda: 0.0 < r.getPayloadCog()[2] < 0.3)
    t.check(r, "getRobotMode", lambda: r.getRobotMode() == 7)
    t.check(r, "getRuntimeState", lambda: r.getRuntimeState() == 2)
    t.check(r, "getSafetyMode", lambda: r.getSafetyMode() == 1)
    t.check(r, "getSafetyStatusBits", lambda: r.getSafetyStatusBits() == 1)
    t.check(r, "isEmergencyStopped", lambda: not r.isEmergencyStopped(), "there is no such button")
    t.check(r, "isProtectiveStopped", lambda: not r.isProtectiveStopped())
    t.check(r, "getTimestamp", lambda: r.getTimestamp() > 42.0)
    t.check(r, "getOutputIntRegister", lambda: isinstance(r.getOutputIntRegister(14), int))
    t.check(r, "getOutputDoubleRegister", lambda: isinstance(r.getOutputDoubleRegister(14), float))
    t.check(
        io,
        "setSpeedSlider",
        lambda: io.setSpeedSlider(0.5) and until(lambda: r.getTargetSpeedFraction() == 0.5),
    )
    t.check(r, "getTargetSpeedFraction", lambda: r.getTargetSpeedFraction() == 0.5)
    # Of the limiter of the trajectory; how fast the robot goes is its product with the slider.
    t.check(r, "getSpeedScaling", lambda: r.getSpeedScaling() == 1.0)
    combined = lambda: until(lambda: r.getSpeedScalingCombined() == 0.5, 3.0)  # noqa: E731
    t.check(r, "getSpeedScalingCombined", combined)
    io.setSpeedSlider(1.0)
    for name, bit in (
        ("setStandardDigitalOut", 3),
        ("setConfigurableDigitalOut", 11),
        ("setToolDigitalOut", 17),
    ):
        pin = bit % 8
        t.check(io, name, lambda name=name, bit=bit, pin=pin: getattr(io, name)(pin, True) and until(
            lambda: r.getDigitalOutState(bit), 2.0))  # fmt: skip
    t.check(r, "getDigitalOutState", lambda: r.getDigitalOutState(3) and not r.getDigitalOutState(4))
    t.check(
        r, "getActualDigitalOutputBits", lambda: r.getActualDigitalOutputBits() == 1 << 3 | 1 << 11 | 1 << 17
    )
    t.check(io, "setAnalogOutputVoltage", lambda: io.setAnalogOutputVoltage(0, 0.75) and until(
        lambda: abs(r.getStandardAnalogOutput0() - 0.75) < 1e-6, 2.0))  # fmt: skip
    t.check(r, "getStandardAnalogOutput0", lambda: abs(r.getStandardAnalogOutput0() - 0.75) < 1e-6)
    t.check(io, "setAnalogOutputCurrent", lambda: io.setAnalogOutputCurrent(1, 0.25) and until(
        lambda: abs(r.getStandardAnalogOutput1() - 0.25) < 1e-6, 2.0))  # fmt: skip
    t.check(r, "getStandardAnalogOutput1", lambda: abs(r.getStandardAnalogOutput1() - 0.25) < 1e-6)

    def register(kind: str, call: Callable[[], bool], value: float, read: Callable[[], float]) -> bool:
        text = f"write_output_{kind}_register(14, read_input_{kind}_register(18))"
        return call() and c.sendCustomScriptFunction("mirror", text) and until(lambda: read() == value, 3.0)

    t.check(
        io,
        "setInputIntRegister",
        lambda: register(
            "integer", lambda: io.setInputIntRegister(18, 77), 77, lambda: r.getOutputIntRegister(14)
        ),
    )
    t.check(c, "sendCustomScriptFunction", lambda: r.getOutputIntRegister(14) == 77)
    t.check(
        io,
        "setInputDoubleRegister",
        lambda: register(
            "float", lambda: io.setInputDoubleRegister(18, 2.5), 2.5, lambda: r.getOutputDoubleRegister(14)
        ),
    )
    for name in ("reconnect", "disconnect"):
        t.check(io, name, lambda name=name: getattr(io, name)() in (True, None))


def programme(t: Trial) -> None:
    """Scripts, files, watchdog, stops, connections; the dashboard."""
    c, r, d = t.control, t.receive, t.dashboard
    with tempfile.TemporaryDirectory() as folder:
        file, data = Path(folder, "own.script"), Path(folder, "data.csv")
        # As the wheel's page says, a script ends with 2 in the register it waits for.
        text = "def own():\n  write_output_integer_register(15, {})\n"
        text += "  write_output_integer_register(0, 2)\nend\n"
        file.write_text(text.format(5))
        t.check(c, "sendCustomScript", lambda: c.sendCustomScript(text.format(4)) and until(
            lambda: r.getOutputIntRegister(15) == 4, 3.0))  # fmt: skip
        t.check(c, "sendCustomScriptFile", lambda: c.sendCustomScriptFile(str(file)) and until(
            lambda: r.getOutputIntRegister(15) == 5, 3.0))  # fmt: skip
        t.check(
            c,
            "reuploadScript",
            lambda: (c.isProgramRunning() or c.reuploadScript()) and until(c.isProgramRunning),
        )
        t.check(c, "setCustomScriptFile", lambda: c.setCustomScriptFile("") is None)
        t.check(r, "startFileRecording", lambda: r.startFileRecording(str(data)))
        time.sleep(0.5)
        t.check(
            r, "stopFileRecording", lambda: r.stopFileRecording() and len(data.read_text().splitlines()) > 50
        )
    t.check(c, "setWatchdog", lambda: c.setWatchdog(1.0))
    t.check(c, "kickWatchdog", c.kickWatchdog)
    time.sleep(3.0)
    t.check(c, "setWatchdog", lambda: not c.isProgramRunning())
    c.reuploadScript()
    until(c.isProgramRunning)
    # It answers False where the stop was faster than its answer.
    t.check(c, "triggerProtectiveStop", lambda: c.triggerProtectiveStop() in (True, False)
            and until(r.isProtectiveStopped, 2.0))  # fmt: skip
    t.check(d, "safetystatus", lambda: "PROTECTIVE_STOP" in d.safetystatus())
    time.sleep(5.5)
    t.check(d, "closeSafetyPopup", lambda: d.closeSafetyPopup() is None)
    t.check(d, "unlockProtectiveStop", lambda: d.unlockProtectiveStop() is None and until(
        lambda: not r.isProtectiveStopped(), 2.0))  # fmt: skip
    c.reuploadScript()
    t.check(d, "running", lambda: until(d.running, 3.0))
    t.check(d, "programState", lambda: "PLAYING" in d.programState())
    t.check(d, "pause", lambda: d.pause() is None and "PAUSED" in d.programState())
    t.check(d, "play", lambda: d.play() is None and "PLAYING" in d.programState())
    t.check(d, "stop", lambda: d.stop() is None and not d.running())
    t.check(d, "robotmode", lambda: "RUNNING" in d.robotmode())
    t.check(d, "safetymode", lambda: "NORMAL" in d.safetymode())
    t.check(d, "polyscopeVersion", lambda: d.polyscopeVersion().count(".") == 3)
    t.check(d, "getSerialNumber", lambda: d.getSerialNumber().isdigit())
    t.check(d, "getRobotModel", lambda: "UR5" in d.getRobotModel())
    t.check(d, "isInRemoteControl", d.isInRemoteControl, "always")
    t.check(d, "popup", lambda: d.popup("look") is None, "in the controller's log and on port 30001 only")
    t.check(d, "closePopup", lambda: d.closePopup() is None)
    t.check(d, "addToLog", lambda: d.addToLog("benchmark") is None)
    t.check(d, "setUserRole", lambda: not hasattr(dashboard_client, "UserRole"),
            f"{NOT}the wheel has no name for its argument in Python")  # fmt: skip
    t.check(d, "isProgramSaved", lambda: not d.isProgramSaved(), "no programme is ever loaded")
    t.check(
        d, "getLoadedProgram", lambda: "No program loaded" in d.getLoadedProgram(), "nothing can be loaded"
    )
    t.check(d, "restartSafety", lambda: d.restartSafety() is None, "changes nothing")

    def refused() -> bool:
        try:
            d.loadURP("a.urp")
        except RuntimeError as error:
            return "a.urp" in str(error)
        return False

    t.check(d, "loadURP", refused, "refused by name: a .urp is the pendant's")
    t.check(d, "send", lambda: d.send("robotmode\n") is None)
    t.check(d, "receive", lambda: "RUNNING" in d.receive())
    t.check(d, "powerOff", lambda: d.powerOff() is None and "POWER_OFF" in d.robotmode())
    t.check(d, "powerOn", lambda: d.powerOn() is None and "IDLE" in d.robotmode(), "at once")
    t.check(d, "brakeRelease", lambda: d.brakeRelease() is None and "RUNNING" in d.robotmode(), "at once")
    t.check(c, "disconnect", lambda: c.disconnect() is None and not c.isConnected())
    t.check(c, "reconnect", lambda: c.reconnect() and until(c.isProgramRunning))
    t.check(c, "stopScript", lambda: c.stopScript() is None and until(lambda: not d.running(), 2.0))
    t.check(r, "disconnect", lambda: r.disconnect() is None and not r.isConnected())
    t.check(r, "reconnect", lambda: r.reconnect() and r.isConnected())
    t.check(
        d,
        "shutdown",
        lambda: d.shutdown() is None and "POWER_OFF" in d.robotmode(),
        "power off, the ports stay",
    )
    t.check(d, "quit", lambda: d.quit() is None)
    t.check(d, "disconnect", lambda: d.disconnect() is None and not d.isConnected())
    t.check(d, "connect", lambda: d.connect() is None and d.isConnected())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--address", default="127.0.0.6")
    parser.add_argument("--polyscope", default="5.11")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        words = ("--part", "plate", "--address", asked.address, "--polyscope", asked.polyscope)
        with serving(*words, "--out", f"{folder}/served"):
            trial = Trial(asked.address, asked.polyscope)
            for some in (motions, tool, force, state, programme):
                some(trial)
                print(f"{some.__name__}: done", flush=True)
    failed = False
    for name, cls in WHAT.items():
        methods = {m for m, f in inspect.getmembers(cls, callable) if m[0] != "_" and not inspect.isclass(f)}
        said = {m: trial.said.get((name, m), "FAILS: not tried") for m in sorted(methods)}
        plain = [m for m, text in said.items() if text == PLAIN]
        other = {m: text for m, text in said.items() if text != PLAIN}
        refused, fails = (sum(text.startswith(word) for text in other.values()) for word in (NOT, "FAILS"))
        print(
            f"\n{name}: {len(methods)} methods, {len(plain)} {PLAIN}, {len(other) - refused - fails} with a "
            f"difference, {refused} not, {fails} fail\n  {PLAIN}: {', '.join(plain)}"
        )
        for m, text in other.items():
            print(f"  {m}: {text}")
        failed = failed or fails > 0
    raise SystemExit(failed)


if __name__ == "__main__":
    main()
