"""`python -m benchmarks.smoothing_peers`: our profiles beside ruckig's and toppra's (pip install 'polish-sim[bench]').

ruckig plans one state to another in time-optimal, jerk-limited steps: the profile of a stop, and the run between two
corners, must take the same time. toppra finds the least time along a given geometry within speed and acceleration,
without jerk: along our rounded path it shows what is lost by jerk limits and by speeds chosen corner by corner.
Both run here, on this machine, without their network services.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from benchmarks.table import Row, print_rows
from polish_sim.motion.certified.connector import Ends, Peaks, connector_time, least_distance
from polish_sim.motion.rules.chain import build_chain
from polish_sim.motion.rules.fir import stop_times
from polish_sim.motion.rules.rule import RULES
from polish_sim.motion.rules.schedule import sample_schedule
from polish_sim.motion.segment_rates import sampled_joints
from polish_sim.smoothing.experiment import AXIS_TOLERANCE, TOLERANCE
from polish_sim.smoothing.trial import TRIAL_LIMITS, trial_arm, trial_path

Array = NDArray[np.float64]
DIRECTIONS = 60
"""Half of the faces of the polyhedron that stands for the ball of the tip's speed and acceleration, from outside."""
SAMPLE_S = 0.002


def against_ruckig(count: int = 5000) -> Iterator[Row]:
    """Random stops and random connectors, times relative to ruckig's."""
    rng = np.random.default_rng(0)
    stops, runs = [], []
    for length, v, a, j in 10.0 ** rng.uniform([-5, -2, -1, 0], [-1, 0, 1, 3], (count, 4)):
        limits = Peaks(v, a, j)
        stops.append(sum(stop_times(length, v, a, j)) / ruckig_time(Ends(0.0, 0.0, 0.0, 0.0), length, limits))
        ends = draw_ends(rng, limits)
        distance = least_distance(ends, limits) * (1.0 + 10.0 ** rng.uniform(-6.0, 2.0))
        runs.append(connector_time(ends, distance, limits) / ruckig_time(ends, distance, limits))
    for name, ratios in (("stop to stop", np.array(stops)), ("corner to corner", np.array(runs))):
        yield Row(f"{name}: time / ruckig's, least", f"{ratios.min() - 1.0:+.1e}", "-1e-8")
        yield Row(f"{name}: greatest", f"{ratios.max() - 1.0:+.1e}", "+1e-8")
        yield Row(f"{name}: more than 1e-6 slower", f"{np.count_nonzero(ratios > 1.0 + 1e-6)}", "0")


def draw_ends(rng: np.random.Generator, limits: Peaks) -> Ends:
    """Speeds and accelerations that stay within the limits once the acceleration has faded out."""
    speeds, accelerations = limits.speed * rng.random(2), limits.acceleration * rng.random(2)
    accelerations = np.minimum(accelerations, np.sqrt(1.999 * limits.jerk * (limits.speed - speeds)))
    accelerations = np.minimum(accelerations, np.sqrt(1.999 * limits.jerk * speeds))
    return Ends(float(speeds[0]), float(accelerations[0]), float(speeds[1]), float(accelerations[1]))


def ruckig_time(ends: Ends, distance: float, limits: Peaks) -> float:
    """Least time by ruckig [s]; its limits reach a little further than ours, as it refuses ends that are on them."""
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    given, found = InputParameter(1), Trajectory(1)
    given.current_position, given.target_position = [0.0], [distance]
    given.current_velocity, given.target_velocity = [ends.v0], [ends.v1]
    given.current_acceleration, given.target_acceleration = [ends.a0], [-ends.a1]
    given.max_velocity, given.max_acceleration, given.max_jerk = [limits.speed], [limits.acceleration], [limits.jerk]
    result = Ruckig(1).calculate(given, found)
    if result not in (Result.Working, Result.Finished):
        raise RuntimeError(f"ruckig: {result}")
    return float(found.duration)


def against_toppra(names: Iterable[str] = ("certified",)) -> Iterator[Row]:
    """The trial's path as each rule rounds it: cycle time beside toppra's along the same geometry."""
    chain, arm = build_chain(*trial_path()), trial_arm()
    for name in names:
        motion = RULES[name](chain, TRIAL_LIMITS, TOLERANCE, AXIS_TOLERANCE, arm, None)
        samples = sample_schedule(*motion, np.arange(0.0, motion[1].end, SAMPLE_S))
        q = sampled_joints(samples, arm).q
        best = toppra_time(samples.tips[:, 0], q)
        yield Row(f"{name}: cycle time", f"{motion[1].end:.4f} s", "-")
        yield Row("    toppra along it, no jerk limits", f"{best:.4f} s", "-")
        yield Row("    ratio", f"{motion[1].end / best:.4f}", "-")


def directions(count: int) -> Array:
    """Unit vectors spread over half a sphere, shape (count, 3)."""
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    return np.column_stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z])


def toppra_time(tips: Array, q: Array) -> float:
    """Least time along a path within the trial's speeds and accelerations of tip and joints [s].

    The tip's way along many directions joins the six joints: a polyhedron around the balls of speed and acceleration.
    """
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    steps = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    kept = np.concatenate([[True], steps > 1e-8])
    way = np.cumsum(np.concatenate([[0.0], steps]))[kept]
    rows = np.concatenate([tips @ directions(DIRECTIONS).T, q], axis=1)[kept]
    speeds = np.concatenate([np.full(DIRECTIONS, TRIAL_LIMITS.tip_speed), TRIAL_LIMITS.joint_speed])
    most = np.concatenate([np.full(DIRECTIONS, TRIAL_LIMITS.tip_acceleration), TRIAL_LIMITS.joint_acceleration])
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
