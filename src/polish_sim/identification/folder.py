"""What an identification leaves in its folder: model, tables, figures, a plot of a held-out motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from polish_sim.analysis.style import BLUE, DASHES, GREY, ORANGE, head, new_figure, styled
from polish_sim.arrays import Array
from polish_sim.identification.estimate import INTERVAL_95
from polish_sim.identification.identify import Identification
from polish_sim.identification.model_file import RobotSource, identified_xml, write_portable
from polish_sim.identification.payload import BODY_NAMES, BODY_UNITS, Weighed
from polish_sim.identification.physical import ParameterRow, cell, parameter_rows, parameters_csv
from polish_sim.motion.serial_chain import body_of
from polish_sim.row_file import put_file, save_plots, write_metrics
from polish_sim.tables import csv_text

PAYLOAD_FILE = "payload.csv"
PAYLOAD_COLUMNS = ("name", "value", "unit", "std", "low_95", "high_95", "nearest_body", "true_value")


def write_folder(folder: Path, found: Identification, source: RobotSource = None) -> None:
    """Write all files of an identification; ``source`` is the robot's MJCF, the shipped robot's if None."""
    put_file(folder, "parameters.csv", parameters_csv(rows_of(found)))
    n = found.model.joints
    own = found.full[: 10 * n].reshape(n, 10) - found.drawing.carried
    terms = dict(zip(found.model.terms, found.full[10 * n :].reshape(-1, n), strict=True))
    if found.gears is not None:
        terms["load"] = found.gears.loads_known().T
    xml = identified_xml(found.model.chain.joints, own, terms, source)
    write_portable(folder / "identified.xml", xml)
    if found.weighed is not None:
        write_payload(folder, found.weighed)
    write_metrics(folder, found.figures)
    save_plots(folder, {"torques.png": plot_torques(found)})


def rows_of(found: Identification) -> list[ParameterRow]:
    """All numbers that were found, with their true values where these are known."""
    rows = parameter_rows(found.model, found.base, found.found, found.full, found.truth)
    return rows if found.gears is None else rows + found.gears.rows()


def write_payload(folder: Path, weighed: Weighed) -> None:
    """Write ``payload.csv``: mass, centre and inertia about it in the last link's frame, with intervals."""
    payload = weighed.payload
    values, std = payload.body()
    half = INTERVAL_95 * std
    columns = zip(
        values - half,
        values + half,
        body_of(payload.nearest_body(), payload.origin),
        weighed.true_body(),
        strict=True,
    )
    rows = [
        [name, cell(value), unit, cell(deviation, 4), *map(cell, others)]
        for name, unit, value, deviation, others in zip(
            BODY_NAMES, BODY_UNITS, values, std, columns, strict=True
        )
    ]
    put_file(folder, PAYLOAD_FILE, csv_text(PAYLOAD_COLUMNS, rows))


@styled
def plot_torques(found: Identification) -> Figure:
    """Torques held out, joint by joint: measured, the identified model's, the drawing's (paper's fig. 4)."""
    held = found.held_out
    n = held.measured.shape[1]
    figures = found.figures
    figure = new_figure(11.0, 1.1 + 2.2 * ((n + 1) // 2))
    grid = figure.subplots((n + 1) // 2, 2, sharex=True, squeeze=False).ravel()
    time = _broken(held.time, held.time)
    for joint, axes in enumerate(grid[:n]):
        for values, colour, dashes, width, label in (
            (held.measured, GREY, "-", 0.5, "measured"),
            (held.drawn, ORANGE, DASHES[1], 1.0, "drawing"),
            (held.found, BLUE, "-", 1.2, "identified"),
        ):
            axes.plot(
                time, _broken(values[:, joint], held.time), color=colour, ls=dashes, lw=width, label=label
            )
        axes.set_ylabel(f"joint {joint + 1} [N m]\nerror {100 * figures['nrms_heldout'][joint]:.3f}%")
    for axes in grid[-2:]:
        axes.set_xlabel("time [s]; gaps: a joint reverses")
    head(
        figure,
        "Torques of a motion that was not fitted",
        [
            f"error {100 * figures['nrms_heldout_mean']:.3f}% of the range (mean of the joints)",
            f"drawing {100 * figures['nrms_heldout_drawing_mean']:.1f}%",
            f"{figures['base_parameters']} parameters from {figures['samples']} samples",
        ],
        legend=(grid[0],),
    )
    return figure


def _broken(values: Array, time: Array) -> Array:
    """The values with an empty place wherever time jumps, so that no line is drawn across."""
    jumps = np.flatnonzero(np.diff(time) > 1.5 * np.median(np.diff(time))) + 1
    return np.insert(values.astype(float), jumps, np.nan)
