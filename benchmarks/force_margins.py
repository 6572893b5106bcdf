"""`python -m benchmarks.force_margins [CONTROLLER ...]`: margins of the force loop by the model and in the
cell."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from benchmarks.loop_margins import analytic_margins
from benchmarks.table import words
from polish_sim.arrays import Array
from polish_sim.cell import Cell
from polish_sim.config import Scenario
from polish_sim.config.cell import ARM_PRESETS
from polish_sim.control import Controller, Measurement, Target, build_controller
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.scoring.border import Bench, Rest, build_bench, press_bench

CONTROLLERS = ("hybrid-pi", "hybrid-adaptive", "force-mode")
ACCURACY = 1.02  # to which a gain margin is sought
MOST_GAIN, MOST_DELAY_S = 64.0, 0.25


class LouderLaw:
    """A controller whose answer along the tool axis is multiplied while it presses: the loop's gain, at its
    input."""

    def __init__(self, controller: Controller, gain: float) -> None:
        self._controller, self._gain = controller, gain

    def __getattr__(self, name: str) -> Any:
        """Whatever else the controller has: it may prepare for what lies ahead."""
        return getattr(self._controller, name)

    def reset(self, cycle_s: float) -> None:
        """Forget everything."""
        self._controller.reset(cycle_s)

    def step(self, measurement: Measurement, target: Target) -> Array:
        """The controller's answer, louder along the tool axis."""
        answer = np.array(self._controller.step(measurement, target))
        if target.contact:
            z = measurement.rotation[:, 2]
            answer[:3] += (self._gain - 1.0) * (z @ answer[:3]) * z
        return answer


def press(bench: Bench, scenario: Scenario, gain: float = 1.0, friction: bool = True) -> Rest:
    """Whether the force settles with a ``gain`` on the controller's answer along the tool axis; without
    ``friction`` of the joints the loop is linear but for its limits."""

    def prepare(cell: Cell) -> None:
        if not friction:
            cell.model.dof_frictionloss[:] = 0.0
        if gain != 1.0:
            cell.use_controller(LouderLaw(build_controller(scenario.controller), gain))

    return press_bench(bench, scenario, prepare)


class SimulatedMargins(NamedTuple):
    """What the cell's loop really bears."""

    gain: float  #: [-]; infinite beyond ``MOST_GAIN``
    gain_frequency: float  #: Of the swing just beyond it [rad/s]
    delay: float  #: [s]; infinite beyond ``MOST_DELAY_S``
    delay_frequency: float  #: [rad/s]


def main() -> None:
    for arm in ARM_PRESETS:
        print(f"robot.arm = {arm}")
        margins_on(override(default_scenario("force"), [f"robot.arm={arm}"]))


def margins_on(scenario: Scenario) -> None:
    bench = build_bench(scenario)
    print(f"  {'':20s}{'':30s}{'gain':>8s}{'at':>11s}{'phase':>8s}{'delay':>9s}{'at':>11s}")
    for name in words(__doc__) or CONTROLLERS:
        named = replace(scenario, controller=replace(scenario.controller, name=name))
        model = analytic_margins(named)
        phase = f"{math.degrees(model.phase):.0f} deg"
        _row(name, "linear model", model.gain, model.phase_crossover, phase, model.delay, model.crossover)
        for friction in (True,) if scenario.robot.elastic else (False, True):
            what = "cell" if friction else "cell without joint friction"
            cell = simulated_margins(named, bench, friction)
            _row("", what, cell.gain, cell.gain_frequency, "", cell.delay, cell.delay_frequency)


def simulated_margins(scenario: Scenario, bench: Bench, friction: bool = False) -> SimulatedMargins:
    """Margins of a scenario ``force`` found in the cell: raise the loop's gain or delay until it no longer
    settles.

    ``friction``: Coulomb friction of the joints, which the linear model lacks; with it a loop also counts as
    unstable when it keeps up a small swing. On elastic gears, whose hysteresis leaves one of a tenth of a
    newton at any delay, a loop is unstable from the swing on that the score allows. Given, too, are the
    frequencies at which the loop swings just beyond the margins.
    """
    elastic = scenario.robot.elastic

    def holds(rest: Rest) -> bool:
        return rest.stable if elastic else rest.resting

    def louder(gain: float) -> Rest:
        return press(bench, scenario, gain, friction)

    def later(factor: float) -> Rest:
        delay = scenario.robot.command_latency_s + MOST_DELAY_S * math.log(factor) / math.log(MOST_GAIN)
        late = replace(scenario, robot=replace(scenario.robot, command_latency_s=delay))
        return press(bench, late, 1.0, friction)

    gain, gain_rest = _seek(louder, holds, ACCURACY)
    factor, delay_rest = _seek(later, holds, math.exp(0.001 * math.log(MOST_GAIN) / MOST_DELAY_S))
    delay = MOST_DELAY_S * math.log(factor) / math.log(MOST_GAIN) if math.isfinite(factor) else math.inf
    return SimulatedMargins(gain, gain_rest.frequency, delay, delay_rest.frequency)


def _seek(run: Callable[[float], Rest], holds: Callable[[Rest], bool], accuracy: float) -> tuple[float, Rest]:
    """Largest factor from 1 to ``MOST_GAIN`` at which a run holds, by bisection, and the rest just
    beyond."""
    low, high = 1.0, MOST_GAIN
    beyond = run(high)
    if holds(beyond):
        return math.inf, beyond
    while high / low > accuracy:
        middle = math.sqrt(low * high)
        rest = run(middle)
        if holds(rest):
            low = middle
        else:
            high, beyond = middle, rest
    return math.sqrt(low * high), beyond


def _row(name: str, what: str, gain: float, at: float, phase: str, delay: float, delay_at: float) -> None:
    print(
        f"  {name:20s}{what:30s}{gain:8.2f}{at:7.0f} 1/s{phase:>8s}{1e3 * delay:6.1f} ms{delay_at:7.0f} 1/s",
        flush=True,
    )


if __name__ == "__main__":
    main()
