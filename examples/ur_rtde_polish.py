"""Polish a planned path with a UR's own force mode, from Python through ur_rtde.

Nothing of polish-sim is imported: the program is for a robot, or for ``polish-sim serve``, which answers
like one. It goes above the part, zeroes the sensor, lands in force mode, follows the plan's poses with
``servoL`` while force mode presses along the tool, lifts, and writes what the robot measured.

    polish-sim plan freeform --stepover 25 --out PLAN
    polish-sim serve --part freeform --path PLAN/path.csv --out SERVED    # beside it, or a robot
    python examples/ur_rtde_polish.py PLAN/path.csv --seconds 60
"""

import argparse
import csv

import numpy as np
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface
from scipy.spatial.transform import Rotation

parser = argparse.ArgumentParser()
parser.add_argument("path", help="path.csv of polish-sim plan")
parser.add_argument("--host", default="127.0.0.1")
parser.add_argument(
    "--work", type=float, nargs=6, default=[0.0, -0.5, 0.08, 0.0, 0.0, 0.0], help="part in the base"
)
parser.add_argument("--force", type=float, default=20.0, help="[N]")
parser.add_argument("--feed", type=float, default=0.01, help="[m/s]")
parser.add_argument("--seconds", type=float, default=60.0, help="of the path, from its begin")
parser.add_argument("--log", default="polish.csv")
given = parser.parse_args()

# %%
# The path's points in the robot's base; tool z goes into the part, tool x stays as level as it can.
with open(given.path, encoding="utf-8") as file:
    rows = [row for row in csv.DictReader(file) if row["segment"] == "process"]
points = np.array(
    [[float(row[key]) for key in ("s_m", "x_m", "y_m", "z_m", "nx", "ny", "nz")] for row in rows]
)
R_base_work = Rotation.from_rotvec(given.work[3:])
s = points[:, 0] - points[0, 0]
positions = R_base_work.apply(points[:, 1:4]) + given.work[:3]
z = -R_base_work.apply(points[:, 4:7])
x = np.array([1.0, 0.0, 0.0]) - z * z[:, :1]
x /= np.linalg.norm(x, axis=1, keepdims=True)
turns = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=2)).as_rotvec()
# Half a turn has two rotation vectors; the one near the last point's lets numbers between two points be
# poses.
for k in range(1, len(turns)):
    angle = np.linalg.norm(turns[k])
    other = turns[k] * (1.0 - 2.0 * np.pi / angle)
    if np.linalg.norm(other - turns[k - 1]) < np.linalg.norm(turns[k] - turns[k - 1]):
        turns[k] = other


def pose_at(way: float, height: float = 0.0) -> np.ndarray:
    """The tool's pose after a way along the path [m], some height above the part [m]."""
    place, turn, axis = ([np.interp(way, s, column) for column in each.T] for each in (positions, turns, z))
    return np.concatenate([np.array(place) - height * np.array(axis), turn])


# %%
# Above the part the sensor is zeroed; force mode then carries the tool down at 5 mm/s.
CYCLE_S = 0.002
DOWN = [0, 0, 1, 0, 0, 0]
WRENCH = [0.0, 0.0, given.force, 0.0, 0.0, 0.0]
LIMITS = [0.01, 0.01, 0.005, 0.1, 0.1, 0.1]  # z is a speed [m/s], the others are ways off the path [m, rad]
control = RTDEControlInterface(given.host)
receive = RTDEReceiveInterface(given.host)
log = []


def note(way: float) -> float:
    """Log a row; returns the force along the tool [N]."""
    pose, force = np.array(receive.getActualTCPPose()), np.array(receive.getActualTCPForce())
    axis = Rotation.from_rotvec(pose[3:]).as_matrix()[:, 2]
    log.append([receive.getTimestamp(), way, *pose, *force, -force[:3] @ axis])
    return log[-1][-1]


try:
    control.moveJ_IK(pose_at(0.0, 0.03).tolist(), 0.2, 0.3)
    control.moveL(pose_at(0.0, 0.003).tolist(), 0.05, 0.3)
    control.zeroFtSensor()
    control.forceModeSetDamping(0.05)
    control.forceModeSetGainScaling(0.5)
    control.forceMode(receive.getActualTCPPose(), DOWN, WRENCH, 2, LIMITS)
    for _ in range(5000):
        begin = control.initPeriod()
        if note(0.0) > 0.9 * given.force:
            break
        control.waitPeriod(begin)
    else:
        raise SystemExit("no contact within 10 s: is the part where --work says?")

    # %%
    # The script takes one command in a cycle: nine of ten move the tool, the tenth turns force mode's frame
    # with it.
    for cycle in range(int(min(given.seconds, s[-1] / given.feed) / CYCLE_S)):
        begin = control.initPeriod()
        way = given.feed * cycle * CYCLE_S
        if cycle % 10:
            control.servoL(pose_at(way).tolist(), 0.0, 0.0, CYCLE_S, 0.1, 300)
        else:
            control.forceMode(receive.getActualTCPPose(), DOWN, WRENCH, 2, LIMITS)
        note(way)
        if control.isProgramRunning() is False:
            raise SystemExit(f"the robot stopped {1e3 * way:.0f} mm along the path")
        control.waitPeriod(begin)
    control.servoStop()
    control.forceModeStop()
    control.moveL(pose_at(way, 0.03).tolist(), 0.05, 0.3)
finally:
    control.stopScript()
    head = "time_s,way_m,x,y,z,rx,ry,rz,fx,fy,fz,tx,ty,tz,force_n"
    np.savetxt(given.log, np.array(log), delimiter=",", header=head, comments="")

force = np.array([row[-1] for row in log if row[1] > 0.005])
inside = 100.0 * np.mean(np.abs(force - given.force) < 4.0)
print(f"{len(force)} cycles along {way:.3f} m: mean {force.mean():.2f} N, rms error "
      f"{np.sqrt(np.mean((force - given.force) ** 2)):.2f} N, within 4 N {inside:.1f}%")  # fmt: skip
