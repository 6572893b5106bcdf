"""Landings with drawn springs, sensors, poses, latencies and forces: how the tail of a controller looks.

    python -m benchmarks.drawn_landings force|surface [--runs 200] [--first 19900] [--controller NAME]

`force` lands on a plate and holds 3 s, `surface` lands on one of three parts and feeds 3 s. Everything a user
may have otherwise than we do is drawn: springs a quarter to four times as stiff as believed, four sensors,
latencies, approach, feed, a force of 3 to 60 N, and in two of five runs where the part lies. A line for each
figure, with the settings of its worst run; for `hybrid-adaptive` also the stiffness it believes in over the
real one.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from polish_sim import default_scenario, override, run_experiment
from polish_sim.arrays import Array
from polish_sim.control.laws import build_controller
from polish_sim.errors import PolishSimError

PARTS = ("plate", "sphere_100", "freeform")
SPRINGS = (0.25, 0.5, 1.0, 1.0, 1.0, 1.0, 2.0, 4.0)
SENSORS = ("external", "external", "external", "axia80", "hex-125hz", "ur5e-built-in")
OWN = {
    "force": ["process.hold_s=3"],
    "surface": ["plan.clearance_m=0.01", "plan.stepover_m=0.02", "process.max_feed_s=3", "safety.proof=none"],
}


def drawn(u: Array, experiment: str) -> list[str]:
    """Settings at a point of the unit cube, shape (16,)."""
    settings = {
        "part.file": "plate" if experiment == "force" else PARTS[int(u[0] * len(PARTS))],
        "head.spring_scale": SPRINGS[int(u[1] * len(SPRINGS))],
        "sensor.model": SENSORS[int(u[2] * len(SENSORS))],
        "process.contact_force_n": round(3.0 * 20.0 ** u[3], 2),
        "part.displacement_m": 0.003 * u[4],
        "part.rotation_rad": math.radians(2.0) * u[5],
        "robot.command_latency_s": 0.002 + 0.008 * u[6],
        "process.approach_speed_m_s": 0.002 + 0.008 * u[7],
        "process.feed_m_s": 0.005 + 0.035 * u[8],
    }
    if u[9] < 0.4:
        place = (0.3 * u[10] - 0.15, -0.45 - 0.25 * u[11], 0.05 + 0.2 * u[12], 0, 0, 2.0 * math.pi * u[13])
        settings["part.pose"] = "[" + ",".join(f"{value:.4f}" for value in place) + "]"
    return [f"{key}={value}" for key, value in settings.items()] + OWN[experiment]


def landing(settings: list[str], experiment: str, controller: str, seed: int) -> dict[str, float]:
    """Figures of one run; empty where it could not be set up or stopped."""
    scenario = override(
        default_scenario(experiment), [*settings, f"seed={seed}", f"controller.name={controller}"]
    )
    law = build_controller(scenario.controller)
    try:
        run = run_experiment(scenario, controller=law)
    except PolishSimError:
        return {}
    if run.figures["protective_stop"]:
        return {}
    time, force, wanted = run.log["time_s"], run.log["normal_force_n"], scenario.process.contact_force_n
    touched = int(np.argmax(force > 0.5))
    time, force = time[touched:], force[touched:]
    out = (np.abs(force - wanted) > max(1.0, 0.1 * wanted)) & (time < time[0] + 3.0)
    if experiment == "force":
        figures = {"deviation from 0.5 s on, std [N]": run.figures["steady_std_n"]}
    else:
        figures = {"rms error [N]": run.figures["force_rms_error_n"]}
    figures |= {
        "overshoot [N]": float(force.max()) - wanted,
        "last outside +-1 N or 10% [s]": float(time[out.nonzero()[0][-1]] - time[0]) if out.any() else 0.0,
    }
    if controller == "hybrid-adaptive":
        believed = law.context.memory.press.force.stiffness
        figures["stiffness believed / real [-]"] = believed / (5000.0 * scenario.head.spring_scale)
    return figures


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", choices=sorted(OWN))
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--first", type=int, default=19900)
    parser.add_argument("--controller", default="hybrid-adaptive")
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.first)
    rows = []
    for number in range(asked.runs):
        settings = drawn(rng.random(16), asked.experiment)
        figures = landing(settings, asked.experiment, asked.controller, asked.first + number)
        if figures:
            rows.append((figures, f"seed {asked.first + number}: {' '.join(settings[:4])}"))
    print(f"{asked.experiment}, {asked.controller}: {len(rows)} of {asked.runs} runs to their end")
    for name in rows[0][0]:
        values = np.array([figures[name] for figures, _ in rows])
        shares = np.quantile(values, [0.0, 0.01, 0.5, 0.9, 0.95, 0.99, 1.0])
        print(f"{name:32s} mean {values.mean():6.3f}  least, 1, 50, 90, 95, 99%, most", shares.round(3))
        print(f"    most: {rows[int(values.argmax())][1]}")


if __name__ == "__main__":
    main()
