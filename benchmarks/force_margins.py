"""`python -m benchmarks.force_margins [CONTROLLER ...]`: margins of the force loop by the model and in the cell."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

from polish_sim.cell.real_arm import ARMS, is_real
from polish_sim.config import Scenario
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.scoring.border import analytic_margins, simulated_margins
from polish_sim.scoring.force_bench import build_bench

CONTROLLERS = ("hybrid-pi", "hybrid-adaptive", "force-mode")


def main() -> None:
    for arm in ARMS:
        print(f"robot.arm = {arm}")
        margins_on(override(default_scenario("force"), [f"robot.arm={arm}"]))


def margins_on(scenario: Scenario) -> None:
    bench = build_bench(scenario)
    print(f"  {'':20s}{'':30s}{'gain':>8s}{'at':>11s}{'phase':>8s}{'delay':>9s}{'at':>11s}")
    for name in sys.argv[1:] or CONTROLLERS:
        named = replace(scenario, controller=replace(scenario.controller, name=name))
        model = analytic_margins(named)
        phase = f"{math.degrees(model.phase):.0f} deg"
        _row(name, "linear model", model.gain, model.phase_crossover, phase, model.delay, model.crossover)
        for friction in (True,) if is_real(scenario) else (False, True):
            what = "cell" if friction else "cell without joint friction"
            cell = simulated_margins(named, bench, friction)
            _row("", what, cell.gain, cell.gain_frequency, "", cell.delay, cell.delay_frequency)


def _row(name: str, what: str, gain: float, at: float, phase: str, delay: float, delay_at: float) -> None:
    print(
        f"  {name:20s}{what:30s}{gain:8.2f}{at:7.0f} 1/s{phase:>8s}{1e3 * delay:6.1f} ms{delay_at:7.0f} 1/s", flush=True
    )


if __name__ == "__main__":
    main()
