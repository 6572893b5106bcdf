"""`python -m benchmarks.smoothing_rules`: the smoothing rules on the trial of paper 4, on random paths, on
hard ones.

The paper reports 13.215 s for its rule against 13.169 s for the one it compares with, T2 sums of 2.355 s
against 2.370 s, and joint jerk inside its limit against above it. Its path, robot and joint limits are lost
(see `trial`).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.exact_stop import plan_exact_stop
from benchmarks.paper_trial import trial_arm
from benchmarks.random_paths import RandomPath
from benchmarks.smoothing_check import joint_shares, sample_times, tool_shares
from polish_sim.arrays import unit
from polish_sim.motion.rules.chain import Chain, build_chain
from polish_sim.motion.rules.deviation import measure_deviation
from polish_sim.motion.rules.limits import Arm, SmoothingLimits, six
from polish_sim.motion.rules.paper_rules import block_triples, filter_times
from polish_sim.motion.rules.schedule import RULES, SmoothMotion
from polish_sim.smoothing import AXIS_TOLERANCE, TOLERANCE
from polish_sim.smoothing.smooth import DOME, TOP, TRIAL_LIMITS, trial_path
from polish_sim.spatial import rotation_to_axis

Array = NDArray[np.float64]
ALL = {"exact stop": plan_exact_stop, **RULES}
PAPER = {
    "joint-jerk": partial(block_triples, jerk_share=0.5, signed=True),
    "joint-acceleration": block_triples,
}
BROKEN = 1.0 + 1e-6


class Shares(NamedTuple):
    """Largest speed, acceleration and jerk by limit, each (3,), and deviations by tolerance."""

    tip: Array
    axis: Array
    joints: Array
    contour: float
    vertex: float
    axis_deviation: float


def measure_shares(motion: SmoothMotion, raw: Chain, limits: SmoothingLimits, arm: Arm | None) -> Shares:
    """Sample a motion between all changes of jerk."""
    samples = motion.sample(sample_times(motion))
    tool, found = tool_shares(samples, limits), measure_deviation(motion, raw)
    return Shares(
        tool[:3],
        tool[3:],
        np.zeros(3) if arm is None else joint_shares(samples, RandomPath("given", raw, arm), limits),
        found.contour.value / TOLERANCE,
        found.vertex.value / TOLERANCE,
        found.axis.value / AXIS_TOLERANCE,
    )


def random_path(rng: np.random.Generator) -> Chain:
    """24 legs of 2-40 mm on the trial's dome, each turning by up to 120 deg and kept within 90 mm of its
    top."""
    points, heading = [np.zeros(2)], 0.0
    while len(points) < 25:
        heading += np.radians(rng.uniform(-120.0, 120.0))
        step = np.exp(rng.uniform(np.log(2.0), np.log(40.0))) * 1e-3
        new = points[-1] + step * np.array([np.cos(heading), np.sin(heading)])
        if np.linalg.norm(new) < 0.09:
            points.append(new)
    flat = np.array(points)
    on_dome = np.column_stack([flat, np.sqrt(DOME**2 - np.sum(flat**2, axis=1)) - DOME])
    into = -unit(on_dome + [0.0, 0.0, DOME])
    return build_chain(on_dome + TOP, rotation_to_axis(into, np.array([1.0, 0.0, 0.0])))


def print_trial(jerks: tuple[float, ...]) -> None:
    """One line a rule and joint jerk limit."""
    chain, arm = trial_path(), trial_arm()
    print(
        f"\n24 segments, {1e3 * chain.lengths.sum():.0f} mm, joint acceleration "
        f"{TRIAL_LIMITS.joint_acceleration[0]}"
    )
    print(
        f"{'joint jerk limit, rule':28s}{'cycle s':>9s}{'T2 sum':>8s}   joint v, a, j / limit   tip j  "
        "contour vertex"
    )
    for jerk in jerks:
        limits = replace(TRIAL_LIMITS, joint_jerk=six(jerk))
        for name, plan in ALL.items():
            motion = plan(chain, limits, TOLERANCE, AXIS_TOLERANCE, arm, None)
            shares = measure_shares(motion, chain, limits, arm)
            second = "-"
            if name in PAPER:
                second = f"{filter_times(chain, limits, arm, None, PAPER[name]).triples[:, 1].sum():.4f}"
            joints = " ".join(f"{share:7.3f}" for share in shares.joints)
            print(f"{jerk:6.0f} {name:21s}{motion.end:9.4f}{second:>8s}   {joints}", end="")
            print(f"{shares.tip[2]:8.3f}{shares.contour:9.4f}{shares.vertex:7.4f}", flush=True)


def judge_random(count: int, limits: SmoothingLimits) -> Iterator[tuple[dict[str, Shares], dict[str, float]]]:
    """Shares and cycle times of every rule on random paths."""
    arm = trial_arm()
    for number in range(count):
        chain = random_path(np.random.default_rng([4, number]))
        motions = {
            name: plan(chain, limits, TOLERANCE, AXIS_TOLERANCE, arm, None) for name, plan in ALL.items()
        }
        shares = {name: measure_shares(motion, chain, limits, arm) for name, motion in motions.items()}
        yield shares, {name: motion.end for name, motion in motions.items()}


def print_random(count: int, title: str, limits: SmoothingLimits) -> None:
    """How many of random paths break which limit, and by how much."""
    rows = list(judge_random(count, limits))
    print(f"\n{count} random paths of 24 segments, {title}: paths that break a limit (largest share)")
    columns = (
        "tip v",
        "tip a",
        "tip j",
        "axis v",
        "axis a",
        "axis j",
        "joint v",
        "joint a",
        "joint j",
        "vertex",
        "axis",
    )
    print(f"{'':20s}{'time s':>10s}" + "".join(f"{column:>12s}" for column in columns))
    for name in ALL:
        own = [shares[name] for shares, _ in rows]
        table = np.array([[*s.tip, *s.axis, *s.joints, s.vertex, s.axis_deviation] for s in own])
        cells = [
            f"{np.count_nonzero(table[:, i] > BROKEN)} ({table[:, i].max():.3f})" for i in range(len(columns))
        ]
        time = sum(times[name] for _, times in rows)
        print(f"{name:20s}{time:10.2f}" + "".join(f"{cell:>12s}" for cell in cells), flush=True)
    ratios = np.array([times["joint-jerk"] / times["joint-acceleration"] for _, times in rows])
    print(f"joint-jerk / joint-acceleration: {ratios.mean():.4f} ({ratios.min():.4f} to {ratios.max():.4f})")
    for name in RULES:
        slower = np.array([times[name] / times["exact stop"] for _, times in rows])
        print(
            f"{name}: {np.count_nonzero(slower > 1.0)} paths slower than exact stops, {slower.mean():.4f} of "
            "their time"
        )


def hard_paths() -> Iterator[tuple[str, Chain]]:
    """Many short segments, tool alone."""
    angle = np.linspace(0.0, np.pi / 2.0, 361)
    zigzag = np.arange(61)[:, None] * [1.0, 0.0, 0.0] + (np.arange(61) % 2)[:, None] * [0.0, 1.0, 0.0]
    tips = {
        "quarter circle R 50 in 0.218 mm": 0.05
        * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]),
        "60 x 0.05 mm zig-zag": 0.05e-3 * np.sqrt(0.5) * zigzag,
    }
    for name, points in tips.items():
        yield name, build_chain(points, np.tile(np.eye(3), (len(points), 1, 1)))


def print_corners() -> None:
    """Cycle times of one corner between two legs, tool alone."""
    names = ("exact stop", "spline")
    print(f"\n{'one corner, tool alone':33s}" + "".join(f"{name:>14s}" for name in names))
    for leg in (0.002, 0.005, 0.02):
        for turn in (15, 30, 45, 60, 75, 90, 110, 130, 150, 165, 178):
            out = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn)), 0.0])
            tips = leg * np.stack([np.array([-1.0, 0.0, 0.0]), np.zeros(3), out])
            chain = build_chain(tips, np.tile(np.eye(3), (3, 1, 1)))
            times = [
                ALL[name](chain, TRIAL_LIMITS, TOLERANCE, AXIS_TOLERANCE, None, None).end for name in names
            ]
            print(f"{1e3 * leg:4.0f} mm legs, {turn:3d} deg{'':14s}" + "".join(f"{t:14.4f}" for t in times))


def print_hard() -> None:
    """Cycle times and shares where segments are short."""
    print(
        f"\n{'many short segments, tool alone':55s}{'cycle s':>9s}   tip v, a, j / limit     contour vertex"
    )
    for title, chain in hard_paths():
        for name, plan in ALL.items():
            motion = plan(chain, TRIAL_LIMITS, TOLERANCE, AXIS_TOLERANCE, None, None)
            shares = measure_shares(motion, chain, TRIAL_LIMITS, None)
            tip = " ".join(f"{share:7.3f}" for share in shares.tip)
            print(f"{title:33s}{name:22s}{motion.end:9.4f}   {tip}{shares.contour:9.4f}{shares.vertex:7.4f}")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=180, help="random paths")
    given = parser.parse_args()
    print_trial((100.0, 80.0, 60.0, 40.0))
    print_corners()
    print_hard()
    print_random(
        given.count, "the trial's limits, joint jerk 60", replace(TRIAL_LIMITS, joint_jerk=six(60.0))
    )
    names = ("tip_speed", "tip_acceleration", "tip_jerk", "axis_speed", "axis_acceleration", "axis_jerk")
    fast = replace(
        TRIAL_LIMITS, joint_jerk=six(60.0), **{name: 3.0 * getattr(TRIAL_LIMITS, name) for name in names}
    )
    print_random(given.count // 3, "three times as fast, joint jerk 60", fast)


if __name__ == "__main__":
    main()
