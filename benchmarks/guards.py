"""False alarms of the guards over healthy runs, and how soon they notice faults.

    python -m benchmarks.guards healthy [--seeds 4] [--first 500] [--part NAME]...
    python -m benchmarks.guards faults [--seeds 2] [--first 500]

Healthy runs: parts x feeds x sensors x controllers x seeds from 500 on, the first ``FED_S`` of each path.
Faults: each of ``--fault`` in the approach and in contact, on a flat block, both controllers.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

from polish_sim.cell import FAULTS, Cell, Silent
from polish_sim.cell.guards import guard_shares
from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.scenario_file import override

DRIVERS = ("hybrid-pi", "hybrid-adaptive")
# step-overs [m]
PARTS = {"freeform": "0.016", "sphere_50": "0.012", "saddle": "0.016", "wheel_hub_rim": "0.016"}
FEEDS = (0.01, 0.02, 0.03, 0.04)  # [m/s]
SENSORS = ("external", "axia80")
FED_S = 8.0
MOMENTS = ("0.6", "contact+1")
"""In the approach, and with the force held."""


class Case(NamedTuple):
    """One run."""

    group: str  #: What it is counted with
    experiment: str
    settings: tuple[str, ...]
    seed: int


def healthy(seeds: Iterable[int], parts: Sequence[str]) -> Iterator[Case]:
    """Runs in which nothing is wrong."""
    for part, feed, sensor, driver in product(parts, FEEDS, SENSORS, DRIVERS):
        settings = (
            f"part.file={part}", f"plan.stepover_m={PARTS[part]}", f"process.feed_m_s={feed}",
            f"sensor.model={sensor}", f"controller.name={driver}", f"process.max_feed_s={FED_S}",
            "process.approach_speed_m_s=0.02", "safety.proof=none",
        )  # fmt: skip
        for seed in seeds:
            yield Case(f"{part} {1e3 * feed:.0f} mm/s {sensor} {driver}", "surface", settings, seed)


def faulty(seeds: Iterable[int]) -> Iterator[Case]:
    """Runs with one fault each."""
    for name, moment, driver in product(FAULTS, MOMENTS, DRIVERS):
        settings = (
            f"faults.events={name}@{moment}",
            f"controller.name={driver}",
            "process.hold_s=3",
            "process.approach_speed_m_s=0.01",
            *(["spindle.speed_rpm=6000"] if name == "spindle-stop" else []),
        )
        for seed in seeds:
            yield Case(f"{name} | {moment}", "force", settings, seed)


class Keeper(Silent):
    """Keeps the cell that ran."""

    def start(self, cell: Cell) -> None:
        """Keep it."""
        self.cell = cell


def run(case: Case, keeper: Keeper) -> RunResult:
    """Run one case."""
    scenario = override(default_scenario(case.experiment), list(case.settings))
    return run_experiment(replace(scenario, seed=case.seed), None, keeper)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line a run and the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.guards", description=__doc__)
    parser.add_argument("what", choices=("healthy", "faults"))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--part", action="append", choices=PARTS)
    given = parser.parse_args(arguments)
    seeds = range(given.first, given.first + given.seeds)
    cases = healthy(seeds, given.part or list(PARTS)) if given.what == "healthy" else faulty(seeds)
    alarms, shares, delays, count = {}, {}, {}, 0
    for case in cases:
        keeper = Keeper()
        figures, count = run(case, keeper).figures, count + 1
        stop = figures["protective_stop"]
        reason = "" if stop is None else figures["protective_stop_at"]["name"]
        for name, near in guard_shares(keeper.cell.state.guards).items():
            shares[name] = max(shares.get(name, (0.0, "")), (near.share, f"{case.group} seed {case.seed}"))
        if stop is not None:
            alarms[reason.split(",")[0]] = alarms.get(reason.split(",")[0], 0) + 1
        delays.setdefault(case.group, []).append(
            (figures["fault_to_stop_s"], reason, figures["peak_force_n"])
        )
        print(f"{case.group} seed {case.seed}: {reason or 'to the end'}", flush=True)
    if given.what == "healthy":
        _print_shares(count, alarms, shares)
    else:
        _print_delays(delays)
    return 0


def _print_shares(count: int, alarms: dict[str, int], shares: dict[str, Any]) -> None:
    print(f"\n{count} healthy runs, {sum(alarms.values())} stopped: {alarms or 'none'}\n")
    print("| guard | largest share of its limit | where |\n|---|---|---|")
    for name, (share, where) in shares.items():
        print(f"| {name} | {100.0 * share:.0f}% | {where} |")


def _print_delays(delays: dict[str, list[Any]]) -> None:
    print("\n| fault | when | stopped | fault to reason | largest force |\n|---|---|---|---|---|")
    for group, ends in delays.items():
        times = [time for time, _, _ in ends if time is not None]
        span = f"{min(times):.3f} to {max(times):.3f} s" if times else "-"
        print(
            f"| {group} | {len(times)} of {len(ends)} | {span} | {max(force for *_, force in ends):.1f} N |"
        )


if __name__ == "__main__":
    sys.exit(main())
