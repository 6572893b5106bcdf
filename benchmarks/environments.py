"""What a step through Gymnasium costs beside the compiled loop, and many environments beside two processes."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Any

import gymnasium
import numpy as np

import polish_sim.envs  # noqa: F401  registers the environments
from benchmarks.table import Row
from polish_sim.config import ControllerConfig
from polish_sim.control import build_controller

ROUNDS, VECTOR_ROUNDS, EPISODES = 9, 60, 20
KIND = {"action": "force-and-feed"}


def measure() -> Iterator[Row]:
    """CPU time of steps, interleaved; time on the clock of the vector, the best of many short rounds."""
    for rate in (500, 125):
        env = gymnasium.make("PolishForce-v1", rate_hz=rate, **KIND)
        loop, step, reset = _single(env)
        yield Row(f"one environment at {rate} Hz: compiled loop", f"{loop:.1f} us", "")
        yield Row(f"one environment at {rate} Hz: env.step over the loop", f"{step / loop:.2f}", "2.0")
    yield Row("reset, the sensor's zeroing included", f"{reset:.1f} ms", "")
    for rate, steps in ((500, 150), (125, 40)):
        yield Row(f"16 at {rate} Hz: rate over two processes of 8", f"{_vector(rate, steps):.2f}", ">= 0.95")


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


def _many(count: int, workers: int, rate: int) -> Any:
    envs = gymnasium.make_vec("PolishForce-v1", count, workers=workers, rate_hz=rate, **KIND)
    envs.reset(seed=0)
    return envs


def _time(envs: Any, steps: int) -> float:
    action, begin = np.zeros(envs.action_space.shape, np.float32), time.perf_counter()
    for _ in range(steps):
        envs.step(action)
    return time.perf_counter() - begin


def _work(line: Connection, rate: int) -> None:
    envs = _many(8, 1, rate)
    _time(envs, 50)
    line.send(None)
    while steps := line.recv():
        line.send(_time(envs, steps))


def _vector(rate: int, steps: int) -> float:
    """Best time of two processes with eight environments each, at once, over the best one of sixteen on two threads.

    It means something only where nothing else runs.
    """
    spawn = multiprocessing.get_context("spawn")
    lines, workers = [], []
    for _ in range(2):
        here, there = spawn.Pipe()
        workers.append(spawn.Process(target=_work, args=(there, rate)))
        workers[-1].start()
        lines.append(here)
    envs = _many(16, 2, rate)
    _time(envs, 50)
    for line in lines:
        line.recv()
    own, theirs = [], []
    for _ in range(VECTOR_ROUNDS):
        own.append(_time(envs, steps))
        for line in lines:
            line.send(steps)
        theirs.append(max([line.recv() for line in lines]))
    for line, worker in zip(lines, workers, strict=True):
        line.send(0)
        worker.join()
    return min(theirs) / min(own)
