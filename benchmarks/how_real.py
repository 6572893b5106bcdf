"""Figures of the elastic arm that are also measured on robots, beside the ideal one.

    python -m benchmarks.how_real             # rows of the table in docs/how_real.md
    python -m benchmarks.how_real FILE.png    # its picture: the arc, magnified, and the spectrum of its error

Compliance and first resonance are those of the linear model, which the simulated arm keeps within 2% and 5%
(``tests/cell/test_real_arm.py``); the spread of a pose is simulated: 30 visits, each from another side. ISO
9283's repeatability comes from one side always; there hysteresis and friction do not show.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from benchmarks.table import Row, print_rows, words
from polish_sim.analysis.metrics import PAPER_ARC, steady_feed
from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, head, new_figure, styled
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.scenario_file import override
from tests.cell.cells import EVERY_STEP, TOUCH, Array, cell_for, free_stroke, ideal
from tests.cell.elastic import (
    HOME,
    NONE,
    REAL,
    SPRINGS_ONLY,
    STRETCHED,
    Joints,
    first_mode,
    joints_at,
    tangents,
)

VISITS, WAY_RAD, WAY_S, REST_S = 30, 0.15, 0.6, 0.4
FEEDS_M_S = (0.05, 0.1, 0.25)
STEP_M_S, BEGIN_S, SINE_HZ, LINK_S = 0.02, 0.3, 1.0, 300.0
FOLDED = np.array([1.1, -2.0, 2.3, -1.9, -1.57, 0.2])
GEAR_HZ = (0.1, 2.0)  #: Above what calibration leaves, up to the second harmonic of the gears' error
ARMS = {
    "ideal arm": [],
    "ur5e": [REAL],
    "ur5e, no transmission error": [REAL, f"robot.real.gear_error_rad={NONE}"],
}


def measure() -> Iterator[Row]:
    """Rows of the table in docs/how_real.md: ideal and real arm where both are, and what is published."""
    soft = [1e6 * np.linalg.eigvalsh(_compliance(joints_at(q, *SPRINGS_ONLY)))[-1] for q in _poses(12)]
    yield Row(
        "compliance at the tool, softest way, 12 poses", f"{min(soft):.0f} to {max(soft):.0f} um/N", "-"
    )
    for name, q in (("stretched", STRETCHED), ("home", HOME), ("folded", FOLDED)):
        value = first_mode(joints_at(q, *SPRINGS_ONLY))[0]
        yield Row(f"first resonance, {name}", f"{value.imag / (2.0 * math.pi):.1f} Hz", "-")
    for name, settings in (("motor", []), ("link", ["robot.real.servo_side=link"])):
        spread = f"{1e3 * _spread(*settings):.3f} mm"
        yield Row(f"spread of a pose from 30 sides, servo on the {name} side", spread, "-")
    yield from _arc_rows()
    yield from _motion_rows()
    yield from _link_rows()


def _poses(n: int) -> Array:
    """Poses within reach, shape (n, 6)."""
    low, high = [-3.0, -2.2, 0.3, -2.5, -2.4, -3.0], [3.0, -0.6, 2.2, -0.5, -0.7, 3.0]
    return np.random.default_rng(3).uniform(low, high, (n, 6))


def _compliance(joints: Joints) -> Array:
    """Of the tool point, gears and servos in series [m/N], shape (3, 3)."""
    J = joints.jacobian()
    return np.asarray(J @ np.diag(1.0 / tangents(joints) + 1.0 / joints.arm.kp) @ J.T)


def _spread(*settings: str) -> float:
    """Mean distance from the mean place and three times its standard deviation, as RP of ISO 9283 [m]."""
    joints, rng = joints_at(HOME, *settings), np.random.default_rng(0)
    ctrl, dt, places = joints.data.ctrl, joints.dt, []
    for _ in range(VISITS):
        away = rng.uniform(-WAY_RAD, WAY_RAD, 6)
        for outwards in (True, False):
            for t in np.arange(0.0, WAY_S, dt):
                share, rate = _smooth(t / WAY_S)
                ctrl[0:12:2] = HOME + away * (share if outwards else 1.0 - share)
                ctrl[1:12:2] = away * (rate if outwards else -rate) / WAY_S
                joints.go(dt)
        ctrl[0:12:2], ctrl[1:12:2] = HOME, 0.0
        places.append(joints.go(REST_S)["tool"][-1, :3])
    off = np.linalg.norm(np.array(places) - np.mean(places, axis=0), axis=1)
    return float(off.mean() + 3.0 * off.std(ddof=1))


def _smooth(share: float) -> tuple[float, float]:
    """A way from rest to rest over the unit of time, and its speed."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2), 30.0 * share**2 * (1.0 - share) ** 2


class Arc(NamedTuple):
    """The circle of paper 1 as it was run at constant feed."""

    angle: Array  #: Around the circle [rad], shape (n,)
    off: Array  #: Across it: away from its middle, along its axis [m], shape (n, 2)
    gears: Array  #: Frequency of each gear's error, mean over the time [Hz], shape (6,)
    dt: float  #: [s]

    def spectrum(self) -> tuple[Array, Array]:
        """Frequencies [Hz] and amplitudes [m] of the error."""
        window = np.hanning(len(self.off))[:, None]
        lines = np.abs(np.fft.rfft(window * (self.off - self.off.mean(axis=0)), axis=0))
        return np.fft.rfftfreq(len(window), self.dt), np.linalg.norm(lines, axis=1) * 2.0 / window.sum()

    def rms_between(self, low: float, high: float) -> float:
        """Of the error between two frequencies [m]."""
        lines = np.fft.rfft(self.off, axis=0) / len(self.off)
        frequency = np.fft.rfftfreq(len(self.off), self.dt)
        return float(np.sqrt(2.0 * np.sum(np.abs(lines[(frequency >= low) & (frequency < high)]) ** 2)))


def run_circle(*settings: str) -> Arc:
    """Run ``arc`` and look at it across the circle."""
    result = run_experiment(override(default_scenario("arc"), ["robot.arm=ideal", *settings, EVERY_STEP]))
    trace, normal = result.trace, np.array(PAPER_ARC.normal)
    part = steady_feed(trace.fed, trace.time_s, trace.path_s_m)
    from_center = trace.tcp_position_m[part] - PAPER_ARC.center
    along = from_center @ normal
    in_plane = from_center - np.outer(along, normal)
    across = np.array([-normal[1], normal[0], 0.0])
    angle = np.unwrap(np.arctan2(in_plane @ np.cross(normal, across), in_plane @ across))
    off = np.column_stack([np.linalg.norm(in_plane, axis=1) - PAPER_ARC.radius, along])
    dt = float(trace.time_s[1] - trace.time_s[0])
    turned = np.abs(np.diff(result.log["q_rad"][part].astype(np.float64), axis=0)).sum(axis=0)
    waves = 2.0 * result.scenario.robot.real.gear_ratio
    return Arc(angle, off, waves * turned / (2.0 * np.pi * dt * len(off)), dt)


def _arc_rows() -> Iterator[Row]:
    for name, settings in ARMS.items():
        arc = run_circle(*settings)
        size = np.linalg.norm(arc.off, axis=1)
        if name == "ur5e":
            moving = arc.gears[arc.gears > 0.1]
            yield Row(
                "arc: gears' periods, mean of each joint", f"{moving.min():.2f} to {moving.max():.2f} Hz", "-"
            )
        rms = f"{1e3 * arc.rms_between(*GEAR_HZ):.4f} mm"
        yield Row(f"arc, {name}: rms {GEAR_HZ[0]} to {GEAR_HZ[1]:g} Hz", rms, "-")
        yield Row("  largest", f"{1e3 * size.max():.4f} mm", "0.3 mm")
    for feed in FEEDS_M_S:
        sizes = [
            np.linalg.norm(run_circle(*ARMS[arm], f"process.feed_m_s={feed}").off, axis=1)
            for arm in ("ideal arm", "ur5e")
        ]
        shown = ", ".join(f"{1e3 * size.max():.3f}" for size in sizes)
        yield Row(f"arc at {1e3 * feed:g} mm/s, ideal arm, ur5e: largest [mm]", shown, "-")


class Moves:
    """Answers a speed along base x by the time; notes when it is asked."""

    def __init__(self, speed: Callable[[float], float]) -> None:
        self.speed, self.asked = speed, [0.0]

    def reset(self, cycle_s: float) -> None:
        """Nothing to forget."""

    def step(self, measurement: Any, target: Any) -> Array:
        """Tool twist."""
        self.asked.append(float(measurement.time))
        return np.array([self.speed(self.asked[-1]), 0.0, 0.0, 0.0, 0.0, 0.0])


def moved(law: Moves, seconds: float, *settings: str) -> tuple[Array, Array]:
    """Times [s] and places of the tool point along base x [m] while a law drives the cell."""
    scenario = ideal("arc", "robot.arm=ideal", *settings)
    trace = cell_for(scenario, free_stroke(TOUCH, hold=seconds), controller=law).run().trace
    return trace.time_s, trace.tcp_position_m[:, 0]


def _motion_rows() -> Iterator[Row]:
    """A step of ``speedl`` and the lag of a slow sine, from the host's command to the tool's motion."""
    for name, settings in (
        ("ideal arm", []),
        ("ur5e", [REAL]),
        ("ur5e, link side", [REAL, "robot.real.servo_side=link"]),
    ):
        time, x = moved(Moves(lambda t: STEP_M_S if t >= BEGIN_S else 0.0), 1.5, *settings)
        speed = np.gradient(x, time) / STEP_M_S
        since = 1e3 * (time - BEGIN_S)
        reached = [since[np.argmax((since > 0.0) & (speed >= share))] for share in (0.1, 0.63)]
        settled = since[np.flatnonzero(np.abs(speed - 1.0) > 0.1)[-1] + 1]
        yield Row(
            f"speedl 20 mm/s, {name}: to 10%, to 63%", f"{reached[0]:.0f}, {reached[1]:.0f} ms", "none found"
        )
        yield Row(
            "  overshoot; within 10% after", f"{100 * (speed.max() - 1):.0f}%, {settled:.0f} ms", "none found"
        )
        time, x = moved(Moves(lambda t: STEP_M_S * math.sin(2.0 * math.pi * SINE_HZ * t)), 4.2, *settings)
        late = time >= 1.0
        turn = 2.0 * math.pi * SINE_HZ * time[late]
        # The place is that of -cos; a drift of it is no lag.
        base = np.column_stack([np.sin(turn), -np.cos(turn), np.ones_like(turn), turn])
        fit = np.linalg.lstsq(base, x[late], rcond=None)[0]
        lag = -math.atan2(fit[0], fit[1]) / (2.0 * math.pi * SINE_HZ)
        yield Row(
            f"lag behind the commands at {SINE_HZ:g} Hz, {name}", f"{abs(1e3 * lag):.1f} ms", "4 to 6 + servo"
        )


def _link_rows() -> Iterator[Row]:
    """Times between the host's cycles, at the 500 Hz of the robot's interface."""
    for name, settings in (("ideal arm", []), ("ur5e", [REAL])):
        law = Moves(lambda _t: 0.0)
        moved(law, LINK_S, "simulation.control_every=2", *settings)
        gaps = 1e3 * np.diff(law.asked[1:])
        shown = " ".join(f"{value:.2f}" for value in (*np.percentile(gaps, (95, 99)), gaps.max()))
        yield Row(f"link at 500 Hz, {name}: p95, p99, largest [ms]", shown, "2.03 2.07 5.6")
        yield Row(
            "  gaps above 2.5 ms a minute", f"{60.0 * np.count_nonzero(gaps > 2.5) / LINK_S:.1f}", "about 1"
        )


MAGNIFIED = 100.0
_MM = 1e3


@styled
def plot_arcs(arcs: dict[str, Arc]) -> Figure:
    """The circle with its error magnified, and the spectrum of the error."""
    figure = new_figure(11.0, 5.0)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    looks = dict(zip(arcs, ((ORANGE, "--", 1.6), (BLUE, "-", 1.2), (GREY, ":", 1.6)), strict=True))
    _plot_circles(left, arcs, looks)
    _plot_spectra(right, arcs, looks)
    head(
        figure,
        "What the gears of an arm do to a circle",
        ["radius 0.1 m, 10 mm/s, seed 0"],
        legend=(left, right),
    )
    return figure


def _plot_circles(axes: Axes, arcs: dict[str, Arc], looks: dict[str, Any]) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    radius = PAPER_ARC.radius * _MM
    axes.plot(
        radius * np.cos(turn),
        radius * np.sin(turn),
        color=GREEN,
        ls="--",
        linewidth=1.0,
        label="circle asked",
    )
    for name, arc in list(arcs.items())[:2]:
        away = radius + MAGNIFIED * _MM * arc.off[:, 0]
        color, style, width = looks[name]
        shown = slice(None, None, 20)
        axes.plot(
            (away * np.cos(arc.angle))[shown],
            (away * np.sin(arc.angle))[shown],
            color=color,
            linestyle=style,
            linewidth=width,
            label=name,
        )
    axes.set(
        title=f"error in the circle's plane, {MAGNIFIED:g} times", xlabel="across [mm]", ylabel="up [mm]"
    )
    axes.set_aspect("equal")


def _plot_spectra(axes: Axes, arcs: dict[str, Arc], looks: dict[str, Any]) -> None:
    gears = arcs["ur5e"].gears
    moving = gears[gears > 0.1]
    for k, frequency in enumerate(moving):
        axes.axvline(
            frequency,
            color="#222222",
            linewidth=0.9,
            label=None if k else "gears' periods, mean of each joint",
        )
    for name, arc in arcs.items():
        frequency, amplitude = arc.spectrum()
        color, style, width = looks[name]
        axes.loglog(
            frequency[1:], _MM * amplitude[1:], color=color, linestyle=style, linewidth=width, label=name
        )
    axes.set(title="spectrum of the distance from it", xlabel="frequency [Hz]", ylabel="amplitude [mm]")
    axes.set(xlim=(0.016, 4.0), ylim=(1e-6, 1.0))
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")


if __name__ == "__main__":
    if files := words(__doc__):
        plot_arcs({name: run_circle(*settings) for name, settings in ARMS.items()}).savefig(Path(files[0]))
    else:
        print_rows("The elastic arm", measure(), ("measured", "published"))
