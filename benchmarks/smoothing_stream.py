"""How fast the rule ``certified`` takes way points in: rate, worst latencies, memory, with inverse kinematics.

Run with ``python -m benchmarks.smoothing_stream [--count 1000000]``.
"""

from __future__ import annotations

import argparse
import math
import resource
import time

import numpy as np

from polish_sim.motion.certified.smoother import Smoother
from polish_sim.motion.rules.limits import SmoothingLimits
from polish_sim.smoothing.trial import trial_arm, trial_path
from polish_sim.spatial import rotation_to_axis

TOLERANCE, AXIS_TOLERANCE = 2e-5, math.radians(0.02)
CHUNK = 2000


def wandering(rng: np.random.Generator, count: int, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Way points of segments of 0.2-5 mm with turns of 0-90 deg in a box of 100 mm, the tool's axis wandering too."""
    heading = np.cumsum(rng.uniform(-math.pi / 2, math.pi / 2, count))
    steps = np.column_stack([np.cos(heading), np.sin(heading), 0.1 * rng.normal(size=count)])
    steps *= 10 ** rng.uniform(-3.7, -2.3, count)[:, None]
    tips = start + 0.05 * np.sin(np.cumsum(steps, axis=0) / 0.05)
    tilt = 0.05 * np.sin(np.cumsum(rng.normal(size=(count, 2)) * 0.02, axis=0))
    axes = np.column_stack([tilt, -np.ones(count)])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return tips, rotation_to_axis(axes, np.array([1.0, 0.0, 0.0]))


def measure(count: int) -> dict[str, float]:
    """Feed many way points in chunks, then some one by one."""
    rng, arm, start = np.random.default_rng(1), trial_arm(), trial_path().tips[0]
    smoother = Smoother(SmoothingLimits(), TOLERANCE, AXIS_TOLERANCE, arm)
    smoother.feed(*wandering(rng, 300, start))
    spent, worked, memory = 0.0, 0.0, 0
    for done in range(0, count, CHUNK):
        tips, rotations = wandering(rng, CHUNK, start)
        begin, cpu = time.perf_counter(), time.process_time()
        smoother.feed(tips, rotations)
        spent, worked = spent + time.perf_counter() - begin, worked + time.process_time() - cpu
        if done == count // 10 // CHUNK * CHUNK:
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
    tips, rotations = wandering(rng, 5000, start)
    single = []
    for i in range(len(tips)):
        begin = time.perf_counter()
        smoother.feed(tips[i : i + 1], rotations[i : i + 1])
        single.append(time.perf_counter() - begin)
    return {
        "segments": count,
        "segments_per_s": count / spent,
        "segments_per_cpu_s": count / worked,
        "one_by_one_p99_9_ms": 1e3 * float(np.quantile(single, 0.999)),
        "memory_grown_kb": grown,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=1_000_000)
    for name, value in measure(parser.parse_args().count).items():
        print(f"{name:24s} {value:.4g}")
