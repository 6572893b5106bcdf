"""`python -m benchmarks.faults --count 200`: random faults into random runs; what no fault may lead to.

Each run draws an experiment (a step of force, or a short feed on a curved part), a controller, a seed, a
fault and its time, is written to a folder as the command does it, and judged by what is read back from there.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.analysis.run_record import RunRecord, read_record, write_record
from polish_sim.cell import FAULTS
from polish_sim.control import CONTROLLERS
from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.scenario_file import override
from polish_sim.workers import open_workers

MOST_N = 60.0  # exact contact force
SOONEST_S, LATEST_S = 0.5, 5.0  # of the fault, from the start of the run
REASON_WITHIN_S = 0.020
DRIVERS = tuple(name for name in ("hybrid-pi", "hybrid-adaptive") if name in CONTROLLERS)
DRAWN = tuple(FAULTS)
RUNS = {
    "force": ("process.hold_s=3", "process.approach_speed_m_s=0.01"),
    "surface": (
        "part.file=sphere_100",
        "plan.stepover_m=0.02",
        "process.max_feed_s=3",
        "process.feed_m_s=0.03",
        "process.approach_speed_m_s=0.02",
    ),
}


class Injection(NamedTuple):
    """One random run."""

    number: int
    experiment: str
    controller: str
    fault: str
    time: float
    """[s]"""
    seed: int


class Judged(NamedTuple):
    """How it went."""

    injection: Injection
    peak_n: float
    reason: str | None
    fault_to_stop_s: float | None
    stop_delay_s: float | None
    wrong: tuple[str, ...]
    """What must not be; empty if all is well."""


def draw(count: int, seed: int = 0) -> list[Injection]:
    """Random injections, every fault about as often."""
    rng = np.random.default_rng(seed)
    names = [DRAWN[k % len(DRAWN)] for k in range(count)]
    return [
        Injection(
            number,
            str(rng.choice(list(RUNS))),
            str(rng.choice(DRIVERS)),
            str(name),
            float(np.round(rng.uniform(SOONEST_S, LATEST_S), 3)),
            int(rng.integers(2**31)),
        )
        for number, name in enumerate(rng.permutation(names))
    ]


def inject(injection: Injection) -> Judged:
    """Run one injection, write its folder, read it back and judge it."""
    scenario = override(
        default_scenario(injection.experiment),
        [*RUNS[injection.experiment], f"controller.name={injection.controller}",
         f"faults.events={injection.fault}@{injection.time}"],
    )  # fmt: skip
    scenario = replace(scenario, seed=injection.seed)
    result = run_experiment(scenario)
    with tempfile.TemporaryDirectory() as folder:
        write_record(
            Path(folder),
            RunRecord("run", result.scenario, result.figures, result.log, result.path, result.removal),
        )
        record = read_record(Path(folder))
    figures = record.metrics
    return Judged(
        injection, figures["peak_force_n"], figures["protective_stop"], figures["fault_to_stop_s"],
        figures["stop_delay_s"], tuple(_wrongs(result, record)),
    )  # fmt: skip


def _wrongs(result: RunResult, record: RunRecord) -> Iterator[str]:
    figures, log, trace = record.metrics, record.log, result.trace
    if not figures["peak_force_n"] < MOST_N:
        yield f"{figures['peak_force_n']:.1f} N"
    step = result.scenario.simulation.timestep_s
    if not np.allclose(trace.time_s, step * np.arange(len(trace.time_s)), atol=1e-9):
        yield "the trace has gaps"
    every = 1.0 / result.scenario.simulation.log_rate_hz
    if not np.allclose(np.diff(log["time_s"].astype(float)), every, atol=1e-9):
        yield "the log has gaps"
    if not 0.0 < figures["simulated_s"] - log["time_s"][-1] < every + 1e-9:
        yield "the log does not reach the end"
    if figures["protective_stop"] is None:
        if figures["path_done"] < 1.0 and injected_feed_ended(result):
            yield "not done, and no reason given"
        return
    if not figures["stop_delay_s"] <= REASON_WITHIN_S:
        yield f"brakes {1e3 * figures['stop_delay_s']:.0f} ms after the reason"
    if figures["retracted"] is not True:
        yield f"retracted by {1e3 * figures['retract_m']:.1f} mm only"
    if trace.normal_force_n[-1] != 0.0:
        yield "the tool is still on the part"


def injected_feed_ended(result: RunResult) -> bool:
    """Whether a run that was not stopped ended before its time."""
    fed = result.trace.time_s[result.trace.fed]
    wanted = result.scenario.process.max_feed_s or result.scenario.process.hold_s
    return not len(fed) or fed[-1] - fed[0] < wanted - 0.01


def main(arguments: Sequence[str] | None = None) -> int:
    """Inject, print a line for what went wrong, and a table by fault."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="random injections; default 200")
    parser.add_argument("--seed", type=int, default=0, help="of the draw; default 0")
    parser.add_argument("--workers", type=int, default=2, help="processes; default 2")
    given = parser.parse_args(arguments)
    begun, judged = time.perf_counter(), []
    with open_workers(count=given.workers) as workers:
        for one, judgement, trouble in workers.results(
            draw(given.count, given.seed), inject, lambda one: one.fault
        ):
            if judgement is None:
                print(f"WRONG {one}: {trouble}", flush=True)
                continue
            judged.append(judgement)
            if judged[-1].wrong:
                print(
                    f"WRONG {judged[-1].injection}: {'; '.join(judged[-1].wrong)} ({judged[-1].reason})",
                    flush=True,
                )
    _print_table(judged)
    wrong = sum(bool(one.wrong) for one in judged)
    print(f"{len(judged)} injections in {time.perf_counter() - begun:.0f} s: {wrong} wrong, "
          f"largest force {max(one.peak_n for one in judged):.1f} N")  # fmt: skip
    return 1 if wrong else 0


def _print_table(judged: Sequence[Judged]) -> None:
    print(f"{'fault':<16} {'runs':>4} {'stopped':>7} {'peak N':>7} {'fault to reason s':>18}  reasons")
    for name in FAULTS:
        mine = [one for one in judged if one.injection.fault == name]
        if not mine:
            continue
        delays = [one.fault_to_stop_s for one in mine if one.fault_to_stop_s is not None]
        span = f"{min(delays):.3f}-{max(delays):.3f}" if delays else "-"
        reasons = sorted({one.reason for one in mine if one.reason})
        stopped = sum(one.reason is not None for one in mine)
        print(f"{name:<16} {len(mine):>4} {stopped:>7} {max(o.peak_n for o in mine):>7.1f} {span:>18}  "
              f"{' | '.join(reasons)}")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
