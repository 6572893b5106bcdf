"""`python -m benchmarks.smoothing_check --count 10000`: every rule on random paths; what breaks which limit,
how often.

Nothing of the planners' bounds is used. The motion is sampled between all changes of jerk, ends of each span
included; the joints' motion is computed at every sample and confirmed by the arm's table alone (`arm_jets`);
deviations are searched for along the trajectory. A limit counts as broken above 1 + 1e-6 of it, a tolerance
above 1 + 1e-9.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.arm_jets import tool_jet
from benchmarks.exact_stop import plan_exact_stop
from benchmarks.random_paths import RandomPath, draw_path
from polish_sim.errors import PolishSimError
from polish_sim.motion.rules.deviation import measure_deviation
from polish_sim.motion.rules.limits import SmoothingLimits, load_limits
from polish_sim.motion.rules.schedule import RULES, Rule, Samples, SmoothMotion, turning
from polish_sim.motion.segment_rates import sampled_joints

Array = NDArray[np.float64]

STOPS = "exact-stop"
PLANS: dict[str, Rule] = {STOPS: plan_exact_stop, **RULES}
TOLERANCE, AXIS_TOLERANCE = 0.02e-3, math.radians(0.02)
FIGURES = (
    "tip speed", "tip acceleration", "tip jerk", "axis speed", "axis acceleration", "axis jerk",
    "joint speed", "joint acceleration", "joint jerk", "tip tolerance", "axis tolerance",
)  # fmt: skip
SLACK = np.array([1e-6] * 9 + [1e-9] * 2)
PLACES = (1e-9, 0.15, 0.5, 0.85, 1.0 - 1e-9)
"""Of the samples in every span between changes of jerk [-]."""
WRONG_TABLE = 1e-6
"""Relative difference of the tool's derivatives by table and as sampled that stops the check."""


class Task(NamedTuple):
    """What a worker is asked."""

    numbers: range
    rules: tuple[str, ...]
    seed: int
    limits: SmoothingLimits


class Judged(NamedTuple):
    """How a rule did on one path."""

    rule: str
    kind: str
    number: int
    shares: Array
    """Largest share of each of `FIGURES`, shape (11,); NaN if refused."""
    end: float
    """Cycle time [s]."""
    refused: str
    """Why the rule gave no motion; empty if it did."""
    segments: int
    took: float
    """Processor time of planning [s]."""


def sample_times(motion: SmoothMotion) -> Array:
    """Times in every span in which no piece begins or ends [s]."""
    edges = motion.edges
    spans = np.diff(edges)
    kept = spans > 1e-9
    return np.asarray((edges[:-1][kept, None] + spans[kept, None] * np.array(PLACES)).ravel())


def joint_shares(samples: Samples, path: RandomPath, limits: SmoothingLimits) -> Array:
    """Largest shares of joint speed, acceleration and jerk, shape (3,); the joints' motion confirmed by the
    table."""
    motion = sampled_joints(samples, path.arm)
    jet = tool_jet(np.stack(motion), path.arm.T_flange_tool)
    for order in range(4):
        for column, wanted in ((3, samples.tips[:, order]), (2, samples.axes[:, order])):
            found = jet[order][:, :3, column]
            if np.abs(found - wanted).max() > WRONG_TABLE * (1.0 + np.abs(wanted).max()):
                raise AssertionError(f"order {order}: the joints do not do what the tool does")
    return np.asarray((np.abs(motion[1:]) / limits.table[:, None, 2:]).max(axis=(1, 2)))


def tool_shares(samples: Samples, limits: SmoothingLimits) -> Array:
    """Largest shares of tip and axis speed, acceleration and jerk, shape (6,)."""
    tip = np.linalg.norm(samples.tips[:, 1:], axis=2).max(axis=0)
    axis = np.linalg.norm(turning(samples.axes), axis=2).max(axis=0)
    return np.asarray(np.concatenate([tip, axis]) / limits.table[:, :2].T.ravel())


def judge_motion(motion: SmoothMotion, path: RandomPath, limits: SmoothingLimits) -> Array:
    """Largest share of each of `FIGURES`, shape (11,)."""
    samples, deviation = motion.sample(sample_times(motion)), measure_deviation(motion, path.chain)
    strayed = [deviation.contour.value / TOLERANCE, deviation.axis.value / AXIS_TOLERANCE]
    return np.concatenate([tool_shares(samples, limits), joint_shares(samples, path, limits), strayed])


def judge_path(number: int, task: Task) -> list[Judged]:
    """Every rule on one random path."""
    path = draw_path(np.random.default_rng([task.seed, number]), number)
    rows = []
    for rule in task.rules:
        try:
            began = time.process_time()
            motion = PLANS[rule](path.chain, task.limits, TOLERANCE, AXIS_TOLERANCE, path.arm, None)
            took = time.process_time() - began
        except PolishSimError as error:
            rows.append(Judged(rule, path.kind, number, np.full(11, np.nan), math.nan, str(error), 0, 0.0))
            continue
        shares = judge_motion(motion, path, task.limits)
        if not (np.isfinite(shares).all() and np.isfinite(motion.end)):
            shares = np.full(11, np.inf)  # no motion at all breaks everything
        rows.append(Judged(rule, path.kind, number, shares, motion.end, "", len(path.chain.lengths), took))
    return rows


def _judge_many(task: Task) -> list[Judged]:
    return [row for number in task.numbers for row in judge_path(number, task)]


def judge(task: Task, workers: int) -> list[Judged]:
    """Every rule on many random paths, in processes if more than one worker."""
    tasks = [task._replace(numbers=task.numbers[i : i + 50]) for i in range(0, len(task.numbers), 50)]
    if workers == 1:
        return [row for part in tasks for row in _judge_many(part)]
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as crew:
        return [row for rows in crew.map(_judge_many, tasks) for row in rows]


def print_table(rows: Iterable[Judged], rules: tuple[str, ...]) -> bool:
    """Print counts and worst shares of every rule; return whether `spline` broke nothing."""
    rows = list(rows)
    by_rule = {rule: [row for row in rows if row.rule == rule] for rule in rules}
    print(f"{'paths that break it (largest share)':22s}" + "".join(f"{rule:>24s}" for rule in rules))
    shares = {
        rule: np.array([row.shares for row in own if not row.refused]).reshape(-1, 11)
        for rule, own in by_rule.items()
    }
    for i, name in enumerate(FIGURES):
        cells = [
            f"{int((s[:, i] > 1.0 + SLACK[i]).sum())} ({s[:, i].max(initial=0.0):.6f})"
            for s in shares.values()
        ]
        print(f"{name:35s}" + "".join(f"{cell:>24s}" for cell in cells))
    print(
        f"{'refused':35s}"
        + "".join(f"{sum(bool(row.refused) for row in own):>24d}" for own in by_rule.values())
    )
    both = [group for group in zip(*by_rule.values(), strict=True) if not any(row.refused for row in group)]
    total = [sum(group[i].end for group in both) for i in range(len(rules))]
    print(f"{f'time of {len(both)} paths done by all [s]':35s}" + "".join(f"{t:>24.2f}" for t in total))
    if STOPS in rules:
        _print_by_stops(by_rule, rules)
    speeds = [
        sum(row.segments for row in own) / max(sum(row.took for row in own), 1e-9) for own in by_rule.values()
    ]
    print(f"{'segments per second of processor time':35s}" + "".join(f"{speed:>24.0f}" for speed in speeds))
    good = bool((shares["spline"] <= 1.0 + SLACK).all()) if "spline" in shares else True
    for row in sorted(by_rule.get("spline", []), key=lambda r: -np.nanmax(np.append(r.shares, 0.0)))[:3]:
        if not row.refused:
            worst = int(np.argmax(row.shares))
            print(f"spline, path {row.number} ({row.kind}): {FIGURES[worst]} {row.shares[worst]:.9f}")
    for row in [row for row in by_rule.get("spline", []) if row.refused][:3]:
        print(f"spline refused path {row.number} ({row.kind}): {row.refused}")
    return good


def _print_by_stops(by_rule: dict[str, list[Judged]], rules: tuple[str, ...]) -> None:
    """Print mean and largest share of the time of exact stops."""
    ends = {rule: np.array([row.end for row in by_rule[rule]]) for rule in rules}
    shares = [ends[rule] / ends[STOPS] for rule in rules]
    cells = "".join(f"{f'{np.nanmean(each):.4f}, {np.nanmax(each):.4f}':>24s}" for each in shares)
    print(f"{'time by that of stops, mean, largest':35s}" + cells)


def main() -> None:
    """Run the check."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="paths")
    parser.add_argument("--first", type=int, default=0, help="number of the first path")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rules", nargs="+", default=sorted(PLANS), choices=sorted(PLANS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--limits", type=Path, help="TOML file of limits; the package's defaults if not given"
    )
    given = parser.parse_args()
    began = time.perf_counter()
    rules = tuple(given.rules)
    limits = SmoothingLimits() if given.limits is None else load_limits(given.limits)
    task = Task(range(given.first, given.first + given.count), rules, given.seed, limits)
    rows = judge(task, given.workers)
    good = print_table(rows, rules)
    print(f"{given.count} paths, seed {given.seed}, {time.perf_counter() - began:.0f} s")
    raise SystemExit(0 if good else 1)


if __name__ == "__main__":
    main()
