"""`polish-sim report`: page, plots and tables again from saved runs, two or more over each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from polish_sim.cli import console
from polish_sim.cli.options import OUTPUT_OPTIONS, Given, argument, takes
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.cli.pictures import CELL_PICTURE, save_cell_picture
from polish_sim.errors import count_text
from polish_sim.page import save_page
from polish_sim.row_file import save_plots, write_json

Runs = Annotated[list[Path], argument("RUN", "Run folders made by 'run'.")]


@takes(*OUTPUT_OPTIONS)
def report(runs: Runs, given: Given) -> None:
    """Draw plots and tables again from saved runs; two or more are put side by side."""
    refuse_taken(given, *runs)
    from polish_sim.analysis.run_record import notes_of
    from polish_sim.cli.run import draw_run
    from polish_sim.experiments.report import (
        cell_model,
        draw_comparison,
        remade,
        runs_table,
        saved_page,
        saved_records,
    )

    records = saved_records(runs)
    first = records[0]
    name = first.scenario.experiment
    with claimed(given, f"report-{name}") as folder:
        if len(records) == 1:
            draw_run(first, folder.draft)
            if remade(first) and not (runs[0] / CELL_PICTURE).exists():
                save_cell_picture(folder.draft / CELL_PICTURE, first, cell_model(first))
        else:
            save_plots(folder.draft, draw_comparison(records))
        save_page(folder.draft, saved_page(runs, records))
        write_json(folder.draft / "metrics.json", {record.name: record.metrics for record in records})
    console.table(runs_table(records)._replace(title=f"{name}: {count_text(len(records), 'run')}"))
    console.notes(notes_of(records))
    console.say_folder(folder.final)
