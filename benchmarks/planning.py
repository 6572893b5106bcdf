"""Time and memory from a large STL to a path on disk, how they grow, and where the time goes."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from benchmarks.plan_timing import FACET_SIZES, STAGES, Timing, sampled_freeform, time_plan
from benchmarks.table import Row
from polish_sim.analysis.style import MARKS, head, line_look, new_figure, styled

PICTURE = Path(__file__).resolve().parents[1] / "results" / "gallery" / "planning_growth.png"
STEPOVERS = (0.016, 0.008, 0.004, 0.002)
_LIMITS = {100_000: "5 s", 1_000_000: "40 s"}


def measure() -> Iterator[Row]:
    """Plan ``freeform`` sampled ever more finely, and with ever smaller step-overs; draw both."""
    with tempfile.TemporaryDirectory() as folder:
        by_size = []
        for facets, size in FACET_SIZES.items():
            timing = time_plan(sampled_freeform(Path(folder), size), Path(folder))
            by_size.append(timing)
            yield Row(f"{timing.facets:,} triangles: time", f"{timing.wall:.1f} s", _LIMITS.get(facets, "-"))
            yield Row("    on one core alone (CPU time)", f"{timing.cpu:.1f} s", "-")
            yield Row("    peak memory of the process", f"{timing.memory / 1e9:.2f} GB", "3 GB")
            if facets == 100_000:
                yield from _profile(timing)
        part = sampled_freeform(Path(folder), FACET_SIZES[10_000])
        by_length = [time_plan(part, Path(folder), stepover) for stepover in STEPOVERS]
    for timing in by_length:
        yield Row(f"path of {timing.length:.2f} m: plan and measure", f"{_path_time(timing):.2f} s", "-")
    large = [timing for timing in by_size if timing.facets > 50_000]
    yield Row("growth with triangles, power of 100,000 and up", f"{_power(large, 'facets'):.2f}", "near 1")
    yield Row("growth with the path's length, power", f"{_length_power(by_length):.2f}", "near 1")
    plot_growth(by_size, by_length).savefig(PICTURE)


@styled
def plot_growth(by_size: list[Timing], by_length: list[Timing]) -> Figure:
    """Time against triangles, stacked by stage, and against the path's length, with lines of linear
    growth."""
    figure = new_figure(12.0, 5.0)
    left, right = figure.subplots(1, 2)
    facets = np.array([timing.facets for timing in by_size])
    for number, name in enumerate(STAGES):
        stage = [max(timing.stages[name], 1e-3) for timing in by_size]
        left.loglog(facets, stage, MARKS[number % len(MARKS)], ms=4, lw=1, label=name, **line_look(number))
    total = np.array([timing.cpu for timing in by_size])
    left.loglog(facets, total, "ko-", lw=2, label="all, with writing")
    left.loglog(facets, total[-1] * facets / facets[-1], "k:", label="linear growth")
    left.set(xlabel="triangles of the STL", ylabel="CPU time [s]", title="freeform, step-over 8 mm")
    length = np.array([timing.length for timing in by_length])
    time = np.array([_path_time(timing) for timing in by_length])
    right.loglog(length, time, "ko-", lw=2, label="plan and measure the path")
    right.loglog(length, time[-1] * length / length[-1], "k:", label="linear growth")
    for timing, seconds in zip(by_length, time, strict=True):
        right.annotate(
            f"{1e3 * timing.stepover:g} mm", (timing.length, seconds), (-34, 2), textcoords="offset points"
        )
    right.set_xticks([2.0, 4.0, 8.0, 16.0], ["2", "4", "8", "16"])
    right.xaxis.set_minor_locator(NullLocator())
    right.set_xlim(1.6, 20.0)
    right.set(
        xlabel="length of the path [m]", ylabel="CPU time [s]", title="10,000 triangles, step-over 16 to 2 mm"
    )
    head(figure, "What planning costs as parts and paths grow", legend=(left, right))
    return figure


def _profile(timing: Timing) -> Iterator[Row]:
    for name in STAGES:
        yield Row(f"    {name}", f"{timing.stages[name]:.2f} s", "-")


def _path_time(timing: Timing) -> float:
    return timing.stages["triangulate"] + timing.stages["plan"] + timing.stages["measure"]


def _power(timings: list[Timing], quantity: str) -> float:
    sizes = [getattr(timing, quantity) for timing in timings]
    return float(np.polyfit(np.log(sizes), np.log([timing.cpu for timing in timings]), 1)[0])


def _length_power(timings: list[Timing]) -> float:
    length, time = [timing.length for timing in timings], [_path_time(timing) for timing in timings]
    return float(np.polyfit(np.log(length), np.log(time), 1)[0])
