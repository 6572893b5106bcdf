"""`polish-sim report`: plots and tables again from saved runs, two or more side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.cli.option_types import Out, Overwrite
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.cli.sinks import CELL_PICTURE

Runs = Annotated[list[Path], typer.Argument(metavar="RUN", help="Run folders made by 'run'.", show_default=False)]


def report(runs: Runs, out: Out = None, overwrite: Overwrite = False) -> None:
    """Draw plots and tables again from saved runs; two or more are put side by side."""
    refuse_taken(out, overwrite)
    # Lazy: --help must not wait for matplotlib.
    from polish_sim.analysis.path_plot import plot_cell
    from polish_sim.analysis.removal_plot import REMOVAL_MESH, write_removal_mesh
    from polish_sim.analysis.run_record import notes_of, read_records, setting_rows, write_json
    from polish_sim.cli.outcome import show_figures
    from polish_sim.experiments.registry import claims_shown
    from polish_sim.experiments.report import draw_comparison, draw_plots, save_plots

    records = read_records(runs)
    experiment = records[0].scenario.experiment
    with claimed(out, f"report-{experiment}", overwrite) as folder:
        plots = draw_plots(records[0]) if len(records) == 1 else draw_comparison(records)
        if len(records) == 1 and len(records[0].log) and not (runs[0] / CELL_PICTURE).exists():
            plots[CELL_PICTURE] = plot_cell(records[0])
        save_plots(folder.draft, plots)
        if len(records) == 1 and records[0].removal is not None:
            write_removal_mesh(folder.draft / REMOVAL_MESH, records[0].removal)
        write_json(folder.draft / "metrics.json", {record.name: record.metrics for record in records})
    columns = {record.name: record.metrics for record in records}
    claims = claims_shown([record.scenario for record in records])
    title = f"{experiment}: {len(records)} run{'s' if len(records) > 1 else ''}"
    show_figures(claims, title, columns, settings=setting_rows(records))
    for text in notes_of(records):
        console.note(f"note: {text}")
    console.say(f"folder: {folder.final}")
