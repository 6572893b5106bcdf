"""What a step through Gymnasium costs beside the compiled loop, and many environments in Gymnasium's
vectors."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np

import polish_sim.envs  # noqa: F401  registers the environments
from benchmarks.table import Row
from polish_sim.config import ControllerConfig
from polish_sim.control import build_controller

ROUNDS, VECTOR_ROUNDS, VECTOR_STEPS, SIDE_BY_SIDE = 9, 10, 40, 16
KIND = {"action": "force-and-feed"}


def measure() -> Iterator[Row]:
    """CPU time of steps, interleaved; time on the clock of the vectors."""
    for rate in (500, 125):
        env = gymnasium.make("PolishForce-v1", rate_hz=rate, **KIND)
        loop, step, reset = _single(env)
        yield Row(f"one environment at {rate} Hz: compiled loop", f"{loop:.1f} us", "")
        yield Row(f"one environment at {rate} Hz: env.step over the loop", f"{step / loop:.2f}", "2.0")
    yield Row("reset, the sensor's zeroing included", f"{reset:.1f} ms", "")
    for mode in ("sync", "async"):
        yield Row(
            f"{SIDE_BY_SIDE} at 125 Hz, gymnasium's {mode} vector: steps a second", f"{_vector(mode):.0f}", ""
        )


def _single(env: Any) -> tuple[float, float, float]:
    """Medians of the compiled loop's and of env.step's time for an action [us], and of a reset's [ms]."""
    action, own = np.zeros(env.action_space.shape, np.float32), env.unwrapped
    loop, step, reset = [], [], []
    for number in range(ROUNDS):
        begin = time.process_time()
        env.reset(seed=number)
        reset.append(time.process_time() - begin)
        begin, count, over = time.process_time(), 0, False
        while not over:
            _, _, terminated, truncated, _ = env.step(action)
            count, over = count + 1, terminated or truncated
        step.append((time.process_time() - begin) / count)
        episode, cell = own.episode, own.cell
        cell.begin_again(episode.scenario, episode.part, np.random.default_rng(episode.noise))
        cell.use_controller(build_controller(ControllerConfig()))
        begin = time.process_time()
        steps = cell.run().steps
        loop.append((time.process_time() - begin) / steps * own._every)
    return 1e6 * float(np.median(loop)), 1e6 * float(np.median(step)), 1e3 * float(np.median(reset))


def _vector(mode: str) -> float:
    """Steps a second of `SIDE_BY_SIDE` environments together, the best of some short rounds."""
    envs = gymnasium.make_vec("PolishForce-v1", SIDE_BY_SIDE, mode, rate_hz=125, **KIND)
    envs.reset(seed=0)
    action, took = np.zeros(envs.action_space.shape, np.float32), []
    for _ in range(VECTOR_ROUNDS):
        begin = time.perf_counter()
        for _ in range(VECTOR_STEPS):
            envs.step(action)
        took.append(time.perf_counter() - begin)
    envs.close()
    return SIDE_BY_SIDE * VECTOR_STEPS / min(took)
