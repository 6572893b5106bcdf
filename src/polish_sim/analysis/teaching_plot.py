"""A path that was taught beside what the hand meant and what was recorded (layer 8c)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polish_sim.analysis.rows import fed, numbers
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, head, new_figure, styled
from polish_sim.analysis.teaching_figures import distance_to_line
from polish_sim.planning.toolpath import arc_length

Array = NDArray[np.float64]


@styled
def plot_taught(record: RunRecord) -> Figure:
    """Draw the taught path from above, and its distance from what was meant along it.

    Args:
        record: A run of ``teach`` along a path, with its taught path.

    Returns:
        The figure.
    """
    assert record.path is not None  # without one there is nothing to draw
    moving = fed(record.log)
    T_base_work = np.array(record.metrics["T_base_work"])
    R, origin = T_base_work[:3, :3], T_base_work[:3, 3]
    meant = (numbers(record.log, "target_position_m")[moving] - origin) @ R
    recorded = (numbers(record.log, "tcp_position_m")[moving] - origin) @ R
    taught = record.path.positions_work
    figure = new_figure(11.0, 4.8)
    above, along = figure.subplots(1, 2, width_ratios=(1.0, 1.2))
    above.plot(*(1e3 * recorded[:, :2].T), color=GREY, lw=0.7, label="recorded")
    above.plot(*(1e3 * meant[:, :2].T), color=GREEN, lw=1.0, ls="--", label="meant")
    above.plot(*(1e3 * taught[:, :2].T), color=BLUE, lw=1.3, label="taught")
    above.set(xlabel="x of the part [mm]", ylabel="y of the part [mm]", aspect="equal")
    above.legend(loc="center")
    for line, off, color, label in ((meant, recorded, GREY, "recorded"), (taught, taught, BLUE, "taught")):
        s = arc_length(line)
        along.plot(100.0 * s / s[-1], 1e3 * distance_to_line(off, meant), color=color, lw=1.0, label=label)
    along.axhline(1e3 * record.metrics["taught_deviation_rms_m"], color=ORANGE, lw=0.9, ls="--", label="taught, rms")
    along.set(xlabel="share of the way [%]", ylabel="distance from what was meant [mm]", ylim=(0.0, None))
    along.legend(loc="upper right", ncols=3)
    m = record.metrics
    facts = [
        f"{m['points_recorded']} points recorded, {m['knots']} knots, {m['points_taught']} points taught",
        f"off by at most {1e3 * m['taught_deviation_max_m']:.2f} mm",
    ]
    head(figure, above, f"Taught on {record.scenario.part.file}", facts)
    return figure
