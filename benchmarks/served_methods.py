"""Every method of the unmodified ur_rtde wheel, called against `polish-sim serve`, each with a check of its
effect.

    pip install ur_rtde
    python -m benchmarks.served_methods [--address 127.0.0.6] [--polyscope 5.11]

Prints the methods that work, those that work with a difference (which it says), and those that fail; ends
with 1 where one fails, or where the wheel has a method nothing is said about.
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

PLAIN = "as on a robot"
WHAT = {
    "RTDEControlInterface": rtde_control.RTDEControlInterface,
    "RTDEReceiveInterface": rtde_receive.RTDEReceiveInterface,
    "RTDEIOInterface": rtde_io.RTDEIOInterface,
    "DashboardClient": dashboard_client.DashboardClient,
}


class Trial:
    """Calls and what became of them, by class and method."""

    def __init__(self, host: str) -> None:
        self.host, self.said = host, dict[tuple[str, str], str]()
        self.dashboard = dashboard_client.DashboardClient(host)
        self.dashboard.connect()
        self.control = rtde_control.RTDEControlInterface(host)
        self.receive = rtde_receive.RTDEReceiveInterface(host)
        self.io = rtde_io.RTDEIOInterface(host)

    def check(self, thing: Any, method: str, good: Callable[[], Any], differs: str = PLAIN) -> None:
        """``good`` calls the method and says whether what is to follow has followed."""
        name = type(thing).__name__, method
        assert hasattr(thing, method), name
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
    t.check(c, "forceModeSetDamping", lambda: c.forceModeSetDamping(0.05))
    t.check(c, "forceModeSetGainScaling", lambda: c.forceModeSetGainScaling(0.5))
    limits = [0.01, 0.01, 0.02, 0.1, 0.1, 0.1]
    law = "law of our controller force-mode: what is public of a robot's"
    t.check(
        c,
        "forceMode",
        lambda: (
            c.forceMode([0.0] * 6, [0, 0, 1, 0, 0, 0], [0, 0, -10.0, 0, 0, 0], 2, limits)
            and until(lambda: home[2] - r.getActualTCPPose()[2] > 0.01, 3.0)
        ),
        law,
    )
    t.check(c, "forceModeStop", lambda: c.forceModeStop() and until(c.isSteady, 2.0))
    c.moveL(home, 0.1, 0.5)
    t.check(c, "toolContact", lambda: c.toolContact([0, 0, -1.0, 0, 0, 0]) == 0)
    t.check(c, "startContactDetection", lambda: c.startContactDetection([0, 0, -1.0, 0, 0, 0]))
    t.check(c, "readContactDetection", lambda: c.readContactDetection() is False)
    t.check(c, "stopContactDetection", c.stopContactDetection)
    t.check(c, "moveUntilContact", lambda: c.moveUntilContact([0, 0, -0.02, 0, 0, 0]) and until(
        lambda: home[2] - r.getActualTCPPose()[2] > 0.03, 1.0))  # fmt: skip
    c.moveL(home, 0.05, 0.5)
    free = "nobody leads the arm"
    t.check(c, "teachMode", c.teachMode, free)
    t.check(c, "endTeachMode", lambda: c.endTeachMode() and until(c.isSteady, 2.0))
    t.check(c, "freedriveMode", lambda: c.freedriveMode(), free)
    t.check(c, "getFreedriveStatus", lambda: c.getFreedriveStatus() in (0, 1, 2))
    t.check(c, "endFreedriveMode", lambda: c.endFreedriveMode() and until(c.isSteady, 2.0))

    def torque() -> bool:
        q = r.getActualQ()
        good = twice(lambda: c.directTorque([0.0] * 6), 0.3)
        return good and near(r.getActualQ(), q, 0.02)

    t.check(c, "directTorque", torque, "friction is that of the simulated joints")
    c.moveJ(q0, 1.0, 2.0)
    t.check(c, "ftRtdeInputEnable", lambda: c.ftRtdeInputEnable(True))
    t.check(c, "setExternalForceTorque", lambda: c.setExternalForceTorque([0, 0, 7.0, 0, 0, 0]) and until(
        lambda: abs(r.getActualTCPForce()[2] - 7.0) < 0.1, 2.0))  # fmt: skip
    t.check(c, "enableExternalFtSensor", lambda: c.enableExternalFtSensor(False) and c.zeroFtSensor())


def tool(t: Trial) -> None:
    """TCP, payload, kinematics, dynamics."""
    c, r = t.control, t.receive
    q, offset = r.getActualQ(), c.getTCPOffset()
    t.check(c, "getTCPOffset", lambda: len(offset) == 6)
    # The wheel leaves an offset of nothing but zeros out of its packet: the robot keeps the one before.
    flange = c.getForwardKinematics(q, [0.0, 0.0, 1e-9, 0.0, 0.0, 0.0])
    c.getActualToolFlangePose()  # the wheel does not wait for the answer and reads the one before
    time.sleep(0.1)
    t.check(
        c,
        "getActualToolFlangePose",
        lambda: near(c.getActualToolFlangePose()[:3], flange[:3], 1e-3),
        "its first answer is that of the method called before",
    )
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
    t.check(c, "getForwardKinematics", lambda: near(c.getForwardKinematics(q, offset)[:3], pose[:3], 1e-3))
    t.check(c, "getInverseKinematics", lambda: near(c.getInverseKinematics(pose, q), q, 3e-3))
    t.check(c, "getInverseKinematicsHasSolution", lambda: c.getInverseKinematicsHasSolution(pose)
            and not c.getInverseKinematicsHasSolution([3.0, 0, 0, 0, 0, 0]))  # fmt: skip
    far = lambda at: np.array(c.getForwardKinematics(list(at), offset))[:3]  # noqa: E731
    steps = 1e-4 * np.eye(6)
    slope = np.column_stack([(far(q + h) - far(q - h)) / 2e-4 for h in steps])
    J = lambda at: np.array(c.getJacobian(list(at), offset)).reshape(6, 6)  # noqa: E731
    t.check(c, "getJacobian", lambda: near(J(q)[:3].ravel(), slope.ravel(), 1e-3))
    speeds = [0.1, -0.2, 0.3, 0.1, 0.2, -0.1]
    step = 1e-3 * np.array(speeds)
    t.check(c, "getJacobianTimeDerivative", lambda: near(
        c.getJacobianTimeDerivative(q, speeds, offset), ((J(q + step) - J(q - step)) / 2e-3).ravel(), 1e-2,
    ))  # fmt: skip

    def inertia_matrix() -> bool:
        M = np.array(c.getMassMatrix(q)).reshape(6, 6)
        return near(M.ravel(), M.T.ravel(), 1e-9) and np.linalg.eigvalsh(M)[0] > 0.0

    t.check(c, "getMassMatrix", inertia_matrix, "of the simulated arm with its tool")
    t.check(c, "getCoriolisAndCentrifugalTorques", lambda: near(
        c.getCoriolisAndCentrifugalTorques(q, [0.0] * 6), [0.0] * 6, 1e-9))  # fmt: skip
    t.check(c, "getJointTorques", lambda: len(c.getJointTorques()) == 6 and np.ptp(c.getJointTorques()) > 0.0)
    t.check(c, "getTargetJointAccelerations", lambda: near(c.getTargetJointAccelerations(), [0.0] * 6, 0.1))
    t.check(c, "getTargetWaypoint", lambda: len(c.getTargetWaypoint()) == 6)
    t.check(c, "getActualJointPositionsHistory", lambda: near(c.getActualJointPositionsHistory(5), q, 3e-3))
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
    t.check(c, "getStepTime", lambda: c.getStepTime() == 0.002)
    t.check(c, "getRobotStatus", lambda: c.getRobotStatus() == 3)
    t.check(r, "getRobotStatus", lambda: r.getRobotStatus() == 3)
    for thing in (c, r, io, t.dashboard):
        t.check(thing, "isConnected", thing.isConnected)
    t.check(c, "isProgramRunning", c.isProgramRunning)
    six = (
        "ActualQ",
        "ActualQd",
        "TargetQ",
        "TargetQd",
        "TargetQdd",
        "TargetMoment",
        "ActualTCPPose",
        "ActualTCPSpeed",
        "ActualTCPForce",
        "TargetTCPPose",
        "TargetTCPSpeed",
        "FtRawWrench",
        "PayloadInertia",
    )
    for name in six:
        t.check(r, f"get{name}", lambda name=name: len(getattr(r, f"get{name}")()) == 6)
    t.check(r, "getActualTCPPose", lambda: near(r.getActualTCPPose()[:3], r.getTargetTCPPose()[:3], 3e-3))
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
    t.check(r, "getPayload", lambda: r.getPayload() > 0.0)
    t.check(r, "getPayloadCog", lambda: len(r.getPayloadCog()) == 3)
    t.check(r, "getRobotMode", lambda: r.getRobotMode() == 7)
    t.check(r, "getRuntimeState", lambda: r.getRuntimeState() == 2)
    t.check(r, "getSafetyMode", lambda: r.getSafetyMode() == 1)
    t.check(r, "getSafetyStatusBits", lambda: r.getSafetyStatusBits() == 1)
    t.check(r, "isEmergencyStopped", lambda: not r.isEmergencyStopped(), "there is no such button")
    t.check(r, "isProtectiveStopped", lambda: not r.isProtectiveStopped())
    t.check(r, "getTimestamp", lambda: r.getTimestamp() > 42.0)
    t.check(r, "getOutputIntRegister", lambda: isinstance(r.getOutputIntRegister(2), int))
    t.check(r, "getOutputDoubleRegister", lambda: isinstance(r.getOutputDoubleRegister(2), float))
    t.check(
        io,
        "setSpeedSlider",
        lambda: io.setSpeedSlider(0.5) and until(lambda: r.getTargetSpeedFraction() == 0.5),
    )
    t.check(r, "getTargetSpeedFraction", lambda: r.getTargetSpeedFraction() == 0.5)
    t.check(r, "getSpeedScaling", lambda: r.getSpeedScaling() == 0.5)
    t.check(r, "getSpeedScalingCombined", lambda: 0.0 < r.getSpeedScalingCombined() <= 0.5)
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
        text = "def own():\n  write_output_integer_register(15, {})\n  sync()\nend\n"
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
    t.check(
        c, "triggerProtectiveStop", lambda: c.triggerProtectiveStop() and until(r.isProtectiveStopped, 2.0)
    )
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
    t.check(
        d,
        "setUserRole",
        lambda: d.setUserRole(dashboard_client.UserRole.PROGRAMMER) is None,
        "changes nothing",
    )
    t.check(d, "isProgramSaved", lambda: d.isProgramSaved() in (True, False))
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
            trial = Trial(asked.address)
            for some in (motions, tool, force, state, programme):
                some(trial)
                print(f"{some.__name__}: done", flush=True)
    failed = False
    for name, cls in WHAT.items():
        methods = {m for m, f in inspect.getmembers(cls, callable) if m[0] != "_" and not inspect.isclass(f)}
        said = {m: trial.said.get((name, m), "FAILS: not tried") for m in sorted(methods)}
        plain = [m for m, text in said.items() if text == PLAIN]
        print(f"\n{name}: {len(methods)} methods\n  {PLAIN} ({len(plain)}): {', '.join(plain)}")
        for m, text in said.items():
            if text != PLAIN:
                failed = failed or "FAILS" in text
                print(f"  {m}: {text}")
    raise SystemExit(failed)


if __name__ == "__main__":
    main()
