"""Two robots at work: what both arms do, how well the tool keeps to its place on the part, and the force (layer 8c)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polish_sim.analysis.rows import fed, numbers
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, SERIES, head, new_figure, shade_band, styled

Array = NDArray[np.float64]

BAND_MM = 0.1
BAND_N = 1.5
WRIST_3 = 5
LEGEND_SHARE = 0.3
"""Of the errors' range, kept free for their legend."""


@styled
def plot_dual(record: RunRecord) -> Figure:
    """Draw a run over time: errors of the tool on the part, force if there is one, and the way of all joints.

    Args:
        record: A run of ``dual``.

    Returns:
        The figure.
    """
    pressing = record.scenario.dual.standoff_m == 0.0
    figure = new_figure(10.0, 7.4 if pressing else 6.2)
    panels = figure.subplots(4 if pressing else 3, 1, sharex=True)
    rows = _from_first_feed_to_last(record)
    time = numbers(record.log, "time_s")[rows]
    time = time - (time[0] if len(time) else 0.0)
    _draw_error(panels[0], time, _while_fed(record, "relative_error_m"))
    if pressing:
        _draw_force(panels[1], time, record)
    for axes, column, name in ((panels[-2], "master_q_rad", "master"), (panels[-1], "q_rad", "follower")):
        _draw_joints(axes, time, numbers(record.log, column)[rows], name)
    panels[-1].set_xlabel("time since the start of the feed [s]")
    panels[-1].legend([f"joint {k}" for k in range(1, 7)], ncols=6, loc="upper center", bbox_to_anchor=(0.5, -0.3))
    m = record.metrics
    facts = [
        f"tracking, worst axis {_mm(m, 'tracking_error_worst_m')} mm",
        f"tool on the part, rms {_mm(m, 'relative_error_rms_m')} mm, 95% below {_mm(m, 'relative_error_p95_m')} mm",
    ]
    if pressing:
        facts.append(f"force error, max {m.get('force_max_deviation_n') or float('nan'):.2f} N")
    head(figure, panels[0], "Two robots: the master moves the part, the follower works on it", facts)
    return figure


@styled
def plot_dual_runs(records: Sequence[RunRecord]) -> Figure:
    """Draw the tool's error on the part along the path, one line a run.

    Args:
        records: Runs of ``dual``.

    Returns:
        The figure.
    """
    figure = new_figure(9.0, 4.0)
    axes = figure.subplots()
    for index, record in enumerate(records):
        error = 1e3 * np.linalg.norm(_while_fed(record, "relative_error_m"), axis=1)
        label = f"{record.name}: rms {_mm(record.metrics, 'relative_error_rms_m')} mm"
        axes.plot(_while_fed(record, "path_s_m"), error, color=SERIES[index % len(SERIES)], label=label)
    axes.axhline(BAND_MM, color=GREEN, ls="--", lw=0.9)
    axes.set(xlabel="along the path [m]", ylabel="error [mm]", ylim=(0.0, None))
    axes.legend()
    head(figure, axes, "Tool on the part, as it is against as wanted", ())
    return figure


def _from_first_feed_to_last(record: RunRecord) -> slice:
    on = np.flatnonzero(fed(record.log))
    return slice(int(on[0]), int(on[-1]) + 1) if len(on) else slice(0, 0)


def _while_fed(record: RunRecord, name: str) -> Array:
    """A column from the first feed to the last; between two strokes no numbers, so that lines break there."""
    rows = _from_first_feed_to_last(record)
    values = numbers(record.log, name)[rows]
    values[~fed(record.log)[rows]] = np.nan
    return values


def _draw_error(axes: Axes, time: Array, error: Array) -> None:
    relative = 1e3 * error
    for k, color in enumerate((BLUE, ORANGE, GREY)):
        axes.plot(time, relative[:, k], color=color, lw=0.9, label=f"{'xyz'[k]} of the part")
    shade_band(axes, 0.0, BAND_MM, f"± {BAND_MM:g} mm")
    axes.set_ylabel("tool on the part [mm]")
    # Below the errors, wherever they run.
    low, high = axes.get_ylim()
    axes.set_ylim(low - LEGEND_SHARE * (high - low), high)
    axes.legend(ncols=4, loc="lower right")


def _draw_force(axes: Axes, time: Array, record: RunRecord) -> None:
    target = record.scenario.process.contact_force_n
    low, high = (_while_fed(record, f"normal_force_{end}_n") for end in ("min", "max"))
    axes.fill_between(time, low, high, color=BLUE, alpha=0.25, lw=0)
    axes.plot(time, _while_fed(record, "normal_force_n"), color=BLUE, lw=0.7, label="exact contact force")
    shade_band(axes, target, BAND_N, f"{target:g} ± {BAND_N:g} N")
    axes.set_ylabel("force [N]")
    axes.legend(ncols=2, loc="lower right")


def _draw_joints(axes: Axes, time: Array, q: Array, name: str) -> None:
    turned = np.degrees(q - q[:1])
    for k in range(6):
        # Wrist 3 often undoes what joint 1 does: dashed, so that both are seen.
        axes.plot(time, turned[:, k], color=SERIES[k % len(SERIES)], ls="--" if k == WRIST_3 else "-")
    axes.set_ylabel(f"{name}: joints\nfrom the start [deg]")


def _mm(metrics: Mapping[str, Any], name: str) -> str:
    value = metrics.get(name)
    return "-" if value is None else f"{1e3 * value:.3f}"
