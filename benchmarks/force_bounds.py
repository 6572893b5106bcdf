"""`python -m benchmarks.force_bounds`: what no controller could better, and what two controllers reach by the
model.

Both are of an arm with rigid gears.
"""

from __future__ import annotations

from dataclasses import replace

from benchmarks.force_theory import (
    SPAN_BY_SIGMA,
    drift_bound,
    form_rms,
    noise_rms,
    step_bound,
    tracking_bound,
)
from benchmarks.table import Row, print_rows
from polish_sim.cell.real_part import WAVELENGTHS
from polish_sim.config import Scenario
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.scoring.border import linear_law_of
from polish_sim.scoring.loop_model import setup_of

CONTROLLERS = ("hybrid-pi", "hybrid-adaptive")


def main() -> None:
    scenario = override(default_scenario("force"), ["robot.arm=ideal"])
    print_rows("Force step of 20 N from first contact: no controller is faster", _steps(scenario))
    print_rows(
        "Rms of the force error under feed, form error and noise; the bound: no controller is better",
        _feeds(scenario),
    )


def _steps(scenario: Scenario) -> list[Row]:
    rows = []
    for speed in (0.002, 0.005, 0.02):
        bound = step_bound(scenario, speed)
        what = f"approach at {1e3 * speed:g} mm/s: "
        rows += [
            Row(what + "contact detected in noise", "", f">= {1e3 * bound.detection:.0f} ms"),
            Row(what + "settled to 1 N", "", f">= {bound.settling:.3f} s"),
            Row(what + "touch that could be stopped", "", f">= {bound.peak:.1f} N"),
        ]
    return [*rows, Row("held at one point, drift against noise", "", f">= {drift_bound(scenario):.4f} N")]


def _feeds(scenario: Scenario) -> list[Row]:
    setup, height = setup_of(scenario), scenario.part.form_error_m / SPAN_BY_SIGMA
    laws = {name: linear_law_of(_with(scenario, name)) for name in CONTROLLERS}
    noises = {name: noise_rms(setup, law, scenario.sensor.force_noise_n) for name, law in laws.items()}
    rows = [
        Row(f"noise alone, {name}, by the model", f"{noise:.3f} N", ">= 0 N")
        for name, noise in noises.items()
    ]
    for feed in (0.01, 0.03, 0.06, 0.1):
        bound = f">= {tracking_bound(scenario, feed, WAVELENGTHS):.3f} N"
        for name, law in laws.items():
            form = form_rms(setup, law, height, feed, WAVELENGTHS)
            both = (form**2 + noises[name] ** 2) ** 0.5
            rows.append(
                Row(
                    f"{1e3 * feed:3g} mm/s, {name}, form error and noise by the model", f"{both:.3f} N", bound
                )
            )
    return rows


def _with(scenario: Scenario, name: str) -> Scenario:
    return replace(scenario, controller=replace(scenario.controller, name=name))


if __name__ == "__main__":
    main()
