"""Press with the paper's force law from outside the robot: a PI on the force along the tool, sent as tool
speeds.

Nothing of polish-sim is imported: the program is for a robot, or for ``polish-sim serve``. From where the
tool stands it goes down along its axis, lands, and holds the force; with a plan's ``path.csv`` it lands on
the first point and follows the path. Every 2 ms it reads pose and force and answers with ``speedL``: across
the tool axis position and orientation are held by equations 6 and 7, along it the speed is v = kp (Fd - F) +
ki integral (Fd - F) dt (eq. 5).

    polish-sim serve --score step-20          # or a robot, its tool 10 mm above the part
    python examples/ur_rtde_force_law.py --seconds 4
"""

import argparse
import csv

import numpy as np
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface
from scipy.spatial.transform import Rotation

parser = argparse.ArgumentParser()
parser.add_argument("path", nargs="?", help="path.csv of polish-sim plan; without it one point is held")
parser.add_argument("--host", default="127.0.0.1")
parser.add_argument(
    "--work", type=float, nargs=6, default=[0.0, -0.5, 0.08, 0.0, 0.0, 0.0], help="part in the base"
)
parser.add_argument("--force", type=float, default=20.0, help="[N]")
parser.add_argument("--feed", type=float, default=0.03, help="[m/s]")
parser.add_argument("--approach", type=float, default=0.005, help="[m/s]")
parser.add_argument("--seconds", type=float, default=4.0, help="of the hold, or of the path")
parser.add_argument("--log", default="force_law.csv")
given = parser.parse_args()

CYCLE_S = 0.002  # asked for; the law counts what it gets
LOOK_AHEAD_S, VELOCITY_P, TURN_I = 0.1, 0.2, 0.2  # eq. 6 and 7
FORCE_P, FORCE_I, FILTER_HZ, FASTEST = 0.004, 0.012, 5.0, 0.05  # eq. 5 [m/(s N)], [m/(s^2 N)]
CONTACT_N, TOUCH_DOWN_S = 2.0, 0.42  # what counts as contact; the feed begins so long after it, or later
SWINGS_S = 0.15  # the tool swings as it sets off, and readings from before the zero arrive: no contact
# stiffest part [N/m], deceleration [m/s^2], and lag
SPRINGS, BRAKES, DELAY_S = 4.0 * 5000.0, 0.8 * 0.25 * 1.2, 0.016
ACCELERATION = 1.2  # of speedL [m/s^2]

control = RTDEControlInterface(given.host)
receive = RTDEReceiveInterface(given.host)
start = np.array(receive.getActualTCPPose())

# %%
# What is followed: places and turns along the way, in the base; one point where there is no path.
if given.path is None:
    s, places, turns = np.array([0.0, 1.0]), np.array([start[:3]] * 2), np.array([start[3:]] * 2)
else:
    with open(given.path, encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["segment"] == "process"]
    points = np.array(
        [[float(row[key]) for key in ("s_m", "x_m", "y_m", "z_m", "nx", "ny", "nz")] for row in rows]
    )
    R_base_work = Rotation.from_rotvec(given.work[3:])
    s = points[:, 0] - points[0, 0]
    places, z = R_base_work.apply(points[:, 1:4]) + given.work[:3], -R_base_work.apply(points[:, 4:7])
    x = np.array([1.0, 0.0, 0.0]) - z * z[:, :1]
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    turns = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=2)).as_rotvec()
    for k in range(1, len(turns)):  # half a turn has two rotation vectors: the one near the last point's
        other = turns[k] * (1.0 - 2.0 * np.pi / np.linalg.norm(turns[k]))
        if np.linalg.norm(other - turns[k - 1]) < np.linalg.norm(turns[k] - turns[k - 1]):
            turns[k] = other


def wanted(way: float) -> np.ndarray:
    """The tool's pose after a way [m]."""
    return np.array([np.interp(way, s, column) for column in (*places.T, *turns.T)])


# %%
# The law: from pose, speed and force to a speed of the tool.
class Law:
    """Equations 5 to 7 with what they remember."""

    def __init__(self) -> None:
        self.turned, self.filtered, self.pressed, self.summed = np.zeros(3), None, 0.0, 0.0

    def answer(
        self, target: np.ndarray, feed: np.ndarray, pose: np.ndarray, speed: np.ndarray, dt: float
    ) -> np.ndarray:
        """Position and orientation: the planned speed, and the error taken back within the look-ahead."""
        off = (Rotation.from_rotvec(target[3:]) * Rotation.from_rotvec(pose[3:]).inv()).as_rotvec()
        asked = feed + np.concatenate([target[:3] - pose[:3], off]) / LOOK_AHEAD_S
        self.turned += (asked - speed)[3:] * dt
        return asked + VELOCITY_P * (asked - speed) + np.concatenate([np.zeros(3), TURN_I * self.turned])

    def press(self, force: float, speed: float, dt: float) -> float:
        """Speed along the tool [m/s]; so slow that the stiffest part would not be struck."""
        if self.filtered is None:
            self.filtered = force
        self.filtered += (1.0 - np.exp(-2.0 * np.pi * FILTER_HZ * dt)) * (force - self.filtered)
        error = given.force - self.filtered
        grown = self.summed + error * dt
        rate = FORCE_P * error + FORCE_I * grown
        room = (1.25 * given.force - force) / SPRINGS - max((DELAY_S + dt) * max(speed, self.pressed), 0.0)
        self.pressed = min(max(rate, -FASTEST), FASTEST, np.sqrt(2.0 * BRAKES * max(room, 0.0)))
        if rate == self.pressed or rate * error < 0.0:
            self.summed = grown
        return self.pressed


# %%
# Down, land, hold or follow, up.
law, log, way, rate, depth, landed, last, set_off = Law(), [], 0.0, 0.0, 0.0, None, None, 0.0
try:
    if given.path is not None:
        control.moveJ_IK((wanted(0.0) - np.array([*(0.03 * z[0]), 0, 0, 0])).tolist(), 0.2, 0.3)
        control.moveL((wanted(0.0) - np.array([*(0.01 * z[0]), 0, 0, 0])).tolist(), 0.05, 0.3)
        depth = -0.01
    control.zeroFtSensor()
    while True:
        begin = control.initPeriod()
        pose, speed = np.array(receive.getActualTCPPose()), np.array(receive.getActualTCPSpeed())
        axis = Rotation.from_rotvec(pose[3:]).as_matrix()[:, 2]
        now, force = receive.getTimestamp(), float(-np.array(receive.getActualTCPForce())[:3] @ axis)
        set_off = now if last is None else set_off
        dt, last = CYCLE_S if last is None else now - last, now
        if landed is None and now - set_off > SWINGS_S and force > CONTACT_N:
            landed = now
        feeding = (
            landed is not None and now - landed > TOUCH_DOWN_S and (rate > 0.0 or force > 0.9 * given.force)
        )
        if feeding and given.path is not None:
            rate = min(given.feed, rate + max(0.05, 2.0 * given.feed) * dt)
        ahead = wanted(way + rate * CYCLE_S)
        feed = (ahead - wanted(way)) / CYCLE_S
        way += rate * dt
        if landed is None:
            depth += given.approach * dt
            feed[:3] += given.approach * axis
        answer = law.answer(ahead + np.array([*(depth * axis), 0, 0, 0]), feed, pose, speed, dt)
        if landed is not None:
            along = law.press(force, float(speed[:3] @ axis), dt)
            answer[:3] += (along - answer[:3] @ axis) * axis
        control.speedL(answer.tolist(), ACCELERATION, CYCLE_S)
        log.append([now, way, *pose, force])
        if landed is not None and (now - landed > given.seconds + 1.0 or way >= s[-1]):
            break
        if landed is None and depth > 0.03:
            raise SystemExit("no contact: is the part where it should be?")
        if not control.isProgramRunning():
            raise SystemExit("the robot stopped")
        control.waitPeriod(begin)
    control.speedStop()
    control.moveL((pose - np.array([*(0.02 * axis), 0, 0, 0])).tolist(), 0.05, 0.3)
finally:
    control.stopScript()
    np.savetxt(
        given.log, np.array(log), delimiter=",", header="time_s,way_m,x,y,z,rx,ry,rz,force_n", comments=""
    )

held = np.array([row[-1] for row in log if landed is not None and row[0] > landed + 1.0])
print(
    f"{len(held)} cycles: mean {held.mean():.2f} N, rms error "
    f"{np.sqrt(np.mean((held - given.force) ** 2)):.2f} N"
)
