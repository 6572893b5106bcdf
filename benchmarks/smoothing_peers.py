"""`python -m benchmarks.smoothing_peers`: our profiles beside ruckig's and toppra's (pip install
'polish-sim[bench]').

ruckig plans one state to another in time-optimal, jerk-limited steps: the profile of a stop must take the
same time, and a straight line by `spline` hardly longer. toppra finds the least time along a given geometry
within speed and acceleration, without jerk: along our rounded path it shows what is lost by jerk limits and
by speeds chosen corner by corner.
Both run here, on this machine, without their network services.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from benchmarks.paper_trial import trial_arm
from benchmarks.table import Row, print_rows
from polish_sim.motion.rules.chain import build_chain
from polish_sim.motion.rules.fir import stop_times
from polish_sim.motion.rules.limits import SmoothingLimits
from polish_sim.motion.rules.schedule import RULES
from polish_sim.motion.segment_rates import sampled_joints
from polish_sim.motion.spline.motion import smooth_by_spline
from polish_sim.smoothing import AXIS_TOLERANCE, TOLERANCE
from polish_sim.smoothing.smooth import TRIAL_LIMITS, trial_path

Array = NDArray[np.float64]
DIRECTIONS = 60
"""Half of the faces of the polyhedron that stands for the ball of the tip's speed and acceleration, from
outside."""
SAMPLE_S = 0.002


def against_ruckig(count: int = 2000, lines: int = 100) -> Iterator[Row]:
    """Random stops, and straight lines by `spline`: times relative to ruckig's."""
    rng = np.random.default_rng(0)
    stops, runs = [], []
    for k, (length, v, a, j) in enumerate(10.0 ** rng.uniform([-5, -2, -1, 0], [-1, 0, 1, 3], (count, 4))):
        least = ruckig_time(length, v, a, j)
        stops.append(sum(stop_times(length, v, a, j)) / least)
        if k < lines:
            chain = build_chain(np.linspace([0.0, 0, 0], [length, 0, 0], 3), np.tile(np.eye(3), (3, 1, 1)))
            limits = SmoothingLimits(tip_speed=v, tip_acceleration=a, tip_jerk=j)
            runs.append(smooth_by_spline(chain, limits, TOLERANCE, AXIS_TOLERANCE, None).end / least)
    for name, ratios in (("stop to stop", np.array(stops)), ("straight lines by spline", np.array(runs))):
        yield Row(f"{name}: time / ruckig's, least", f"{ratios.min() - 1.0:+.1e}", "-1e-8")
        yield Row(f"{name}: mean, greatest", f"{ratios.mean() - 1.0:+.1e}, {ratios.max() - 1.0:+.1e}", "-")


def ruckig_time(distance: float, v: float, a: float, j: float) -> float:
    """Least time from rest to rest by ruckig [s]."""
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    given, found = InputParameter(1), Trajectory(1)
    given.current_position, given.target_position = [0.0], [distance]
    given.max_velocity, given.max_acceleration, given.max_jerk = [v], [a], [j]
    result = Ruckig(1).calculate(given, found)
    if result not in (Result.Working, Result.Finished):
        raise RuntimeError(f"ruckig: {result}")
    return float(found.duration)


def against_toppra(names: Iterable[str] = ("spline",)) -> Iterator[Row]:
    """The trial's path as each rule rounds it: cycle time beside toppra's along the same geometry."""
    chain, arm = trial_path(), trial_arm()
    for name in names:
        motion = RULES[name](chain, TRIAL_LIMITS, TOLERANCE, AXIS_TOLERANCE, arm, None)
        samples = motion.sample(np.arange(0.0, motion.end, SAMPLE_S))
        q = sampled_joints(samples, arm).q
        best = toppra_time(samples.tips[:, 0], q)
        yield Row(f"{name}: cycle time", f"{motion.end:.4f} s", "-")
        yield Row("    toppra along it, no jerk limits", f"{best:.4f} s", "-")
        yield Row("    ratio", f"{motion.end / best:.4f}", "-")


def directions(count: int) -> Array:
    """Unit vectors spread over half a sphere, shape (count, 3)."""
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    return np.column_stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z])


def toppra_time(tips: Array, q: Array) -> float:
    """Least time along a path within the trial's speeds and accelerations of tip and joints [s].

    The tip's way along many directions joins the six joints: a polyhedron around the balls of speed and
    acceleration.
    """
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    steps = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    kept = np.concatenate([[True], steps > 1e-8])
    way = np.cumsum(np.concatenate([[0.0], steps]))[kept]
    rows = np.concatenate([tips @ directions(DIRECTIONS).T, q], axis=1)[kept]
    speeds = np.concatenate([np.full(DIRECTIONS, TRIAL_LIMITS.tip_speed), TRIAL_LIMITS.joint_speed])
    most = np.concatenate(
        [np.full(DIRECTIONS, TRIAL_LIMITS.tip_acceleration), TRIAL_LIMITS.joint_acceleration]
    )
    limits = [
        constraint.JointVelocityConstraint(np.column_stack([-speeds, speeds])),
        constraint.JointAccelerationConstraint(np.column_stack([-most, most])),
    ]
    path = toppra.SplineInterpolator(way, rows)
    planner = algorithm.TOPPRA(limits, path, gridpoints=way, parametrizer="ParametrizeConstAccel")
    trajectory = planner.compute_trajectory(0.0, 0.0)
    return float(trajectory.duration) if trajectory is not None else float("nan")


def measure() -> Iterator[Row]:
    """What is installed of the two, in short."""
    for name, compare in (("ruckig", against_ruckig), ("toppra", against_toppra)):
        if find_spec(name) is None:
            yield Row(f"{name} is not installed: pip install -e '.[bench]'", "-", "-")
        else:
            yield from compare()


def main() -> None:
    """Print both tables."""
    print_rows("Random profiles beside ruckig's", against_ruckig())
    print_rows("The trial's path beside toppra's least time", against_toppra(RULES))


if __name__ == "__main__":
    main()
