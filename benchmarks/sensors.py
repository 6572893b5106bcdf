"""Wrist sensors by name: what they read at rest, and what force control makes of them.

python -m benchmarks.sensors              # at rest
python -m benchmarks.sensors force        # `run force`: sensors, laws and arms, SEEDS seeds each
python -m benchmarks.sensors told         # the same, `hybrid-adaptive` set to filter, delay and noise
python -m benchmarks.sensors surface      # `run surface` on `freeform`, FED_S seconds, one seed
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.table import Row, print_rows, words
from polish_sim.cell.wrist_sensor import (
    WristSensor,
    build_sample_line,
    build_sensor,
    read_at_rest,
    sample_sensor,
)
from polish_sim.config import SensorConfig
from polish_sim.config.cell import SENSOR_MODELS
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.planning import plan_part
from polish_sim.scenario_file import override
from tests.cell.cells import Array

SEEDS, FED_S, RUNS = 6, 20, 20
HANGING = np.array([[0.0, 0.0, -19.6, 0.0, 0.0, 0.0]])  #: A tool of 2 kg, looking down [N, N m]
PUBLISHED = {
    "external": ("-", "-", "-"),
    "ur5e-built-in": ("+-3.5 N", "4.1 N", "500"),
    "axia80": ("< 0.25 N a jump", "-", "976"),
    "hex-125hz": ("0.15 N", "-", "125"),
}
"""Noise, drift within five minutes, new values a second."""


_BELIEF = "controller.adaptive"
TOLD: dict[str, list[str]] = {
    "external": [],
    "ur5e-built-in": [f"{_BELIEF}.sensor_bandwidth_hz=250", f"{_BELIEF}.usual_noise_n=1.17"],
    "axia80": [f"{_BELIEF}.sensor_bandwidth_hz=400"],
    "hex-125hz": [f"{_BELIEF}.sensor_bandwidth_hz=15", f"{_BELIEF}.sensor_latency_s=0.008"],
}
"""What `hybrid-adaptive` is to believe of each sensor; no filter: half its rate or thereabouts."""


def at_rest() -> Iterator[Row]:
    """Noise, drift and rate of each sensor with a tool hanging still."""
    for name in SENSOR_MODELS:
        config = override(default_scenario("force"), [f"sensor.model={name}"]).sensor
        noise, drift, rate = PUBLISHED[name]
        read = _read(config, np.zeros(round(20.0 * config.rate_hz)), 1.0 / config.rate_hz, 0)
        yield Row(f"{name}: noise as read, Fz, rms", f"{_noise(read[:, 2]):.3f} N", noise)
        yield Row("  Tz, rms", f"{1e3 * _noise(read[:, 5]):.1f} mN m", "-")
        drifts = np.array([np.abs(_drift(config, seed)[:3]).max() for seed in range(RUNS)])
        shown = f"{np.median(drifts):.2f}, {drifts.max():.2f} N"
        yield Row(f"  drift in 300 s, worst axis, {RUNS} seeds: median, most", shown, drift)
        delays = 1e3 * np.array([_delay(config, begin) for begin in np.arange(1.0, 1.0 + 1.0 / 125.0, 1e-3)])
        yield Row("  63% of a step of force read after", f"{delays.min():.0f} to {delays.max():.0f} ms", "-")
        yield Row("  new values a second", f"{_new_values(config, 5.0):.0f}", rate)


def _read(config: SensorConfig, travel: Array, average: float, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    sensor: WristSensor = build_sensor(config, rng)
    loads = np.repeat(HANGING, len(travel), axis=0)
    return read_at_rest(sensor, loads, travel, 0.0, average, rng)


def _noise(read: Array) -> float:
    """Standard deviation around a parabola: drift is no noise."""
    time = np.linspace(-1.0, 1.0, len(read))
    return float(np.std(read - np.polyval(np.polyfit(time, read, 2), time)))


def _drift(config: SensorConfig, seed: int) -> Array:
    """From the first half second to that after five minutes, shape (6,)."""
    first, later = _read(config, np.array([0.0, 299.5]), 0.5, seed)
    return later - first


def _new_values(config: SensorConfig, seconds: float) -> float:
    """How often the reading changes in a second, looked at every millisecond."""
    rng, changes, before = np.random.default_rng(0), 0, np.zeros(6)
    sensor = build_sensor(config, rng)
    line = build_sample_line(sensor)
    for k in range(round(1000.0 * seconds)):
        sample_sensor(sensor, line, 1e-3 * k, HANGING[0], rng.standard_normal(12))
        changes += bool(np.any(sensor.reading != before))
        before = sensor.reading.copy()
    return changes / seconds


def _delay(config: SensorConfig, begin: float) -> float:
    """Time from a step of the force at a moment ``begin`` [s] until 63% of it are read [s]."""
    quiet = replace(config, force_noise_n=0.0, force_drift_n_s=0.0, warm_up_force_n=0.0, force_bias_n=0.0)
    sensor = build_sensor(quiet, np.random.default_rng(0))
    line, k = build_sample_line(sensor), 0
    while sensor.reading[2] < 6.3:
        # The engine hands on what it has computed a step before.
        load = np.array([0.0, 0.0, 10.0 * (1e-3 * (k - 1) >= begin - 1e-9), 0.0, 0.0, 0.0])
        sample_sensor(sensor, line, 1e-3 * k, load, np.zeros(12))
        k += 1
    return 1e-3 * (k - 1) - begin


def forces(experiment: str, seeds: int, *settings: str, told: bool = False) -> Iterator[Row]:
    """Figures of the force: range over the seeds, or the protective stop."""
    plan = None
    for arm in ("ideal", "ur5e"):
        for law in ("hybrid-pi", "hybrid-adaptive")[told:]:
            for name in SENSOR_MODELS:
                found = []
                for seed in range(seeds):
                    words = [
                        f"robot.arm={arm}",
                        f"controller.name={law}",
                        f"sensor.model={name}",
                        f"seed={seed}",
                    ]
                    words += TOLD[name] if told else []
                    scenario = override(default_scenario(experiment), [*words, *settings])
                    if experiment == "surface" and plan is None:
                        plan = plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad)
                    found.append(run_experiment(scenario, plan).figures)
                for figure, unit in FIGURES[experiment].items():
                    values = np.array([f[figure] if f[figure] is not None else np.nan for f in found], float)
                    shown = (
                        f"{values.min():.3g} to {values.max():.3g} {unit}"
                        if seeds > 1
                        else f"{values[0]:.3g} {unit}"
                    )
                    yield Row(f"{arm}, {law}, {name}: {figure}", shown, "-")
                stops = [f["protective_stop"].split(":")[0] for f in found if f["protective_stop"]]
                if stops:
                    yield Row(f"  stops in {len(stops)} of {seeds} runs", stops[0][:40], "-")


FIGURES = {
    "force": {
        "settling_time_3n_s": "s",
        "settling_time_1n_s": "s",
        "overshoot_n": "N",
        "steady_max_deviation_n": "N",
    },
    "surface": {"force_max_deviation_n": "N", "force_rms_error_n": "N", "tracking_error_max_m": "m"},
}


if __name__ == "__main__":
    match words(__doc__):
        case ["force"]:
            print_rows("Force by sensor", forces("force", SEEDS))
        case ["told"]:
            print_rows("Force by sensor, believed as it is", forces("force", SEEDS, told=True))
        case ["surface"]:
            print_rows("Surface by sensor", forces("surface", 1, f"process.max_feed_s={FED_S}"))
        case _:
            print_rows("Sensors at rest", at_rest(), ("simulated", "published"))
