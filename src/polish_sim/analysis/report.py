"""Which figures belong to which experiment, drawn and saved."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from polish_sim.analysis.arc_plot import plot_arc, plot_arc_runs
from polish_sim.analysis.force_plot import plot_force, plot_force_runs
from polish_sim.analysis.removal_plot import plot_removal, plot_removal_runs
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.seeds_plot import plot_seeds
from polish_sim.analysis.surface_plot import plot_peaks, plot_surface_force, plot_surface_runs
from polish_sim.dual.plots import plot_dual, plot_dual_runs
from polish_sim.errors import InputError
from polish_sim.hand_guiding.plots import plot_guiding, plot_guiding_runs, plot_taught
from polish_sim.smoothing.tracking import plot_tracking, plot_tracking_bars, plot_tracking_runs

PLOTS: Final[Mapping[str, Mapping[str, Callable[[RunRecord], Figure]]]] = {
    "arc": {"arc.png": plot_arc},
    "force": {"force.png": plot_force},
    "surface": {"force.png": plot_surface_force, "peaks.png": plot_peaks},
    "smooth": {"tracking.png": plot_tracking, "tracking_by_joint.png": plot_tracking_bars},
    "teach": {"hand_force.png": plot_guiding},
    "dual": {"dual.png": plot_dual},
}
"""The figures of one run, by experiment and file name."""

COMPARISONS: Final[Mapping[str, Mapping[str, Callable[[Sequence[RunRecord]], Figure]]]] = {
    "arc": {"arc.png": plot_arc_runs},
    "force": {"force.png": plot_force_runs},
    "surface": {"force.png": plot_surface_runs},
    "smooth": {"tracking.png": plot_tracking_runs},
    "teach": {"hand_force.png": plot_guiding_runs},
    "dual": {"dual.png": plot_dual_runs},
}
"""The figures of several runs of one experiment."""


def draw_plots(record: RunRecord) -> dict[str, Figure]:
    """Draw the figures of a run, by file name; a run without a row has none."""
    if not len(record.log):
        return {}
    plots = {name: plot(record) for name, plot in PLOTS[record.scenario.experiment].items()}
    if record.scenario.drag.follow and record.path is not None:
        plots["taught.png"] = plot_taught(record)
    return plots | ({"removal.png": plot_removal(record)} if removed_something(record) else {})


def draw_comparison(records: Sequence[RunRecord]) -> dict[str, Figure]:
    """Draw the figures that put several runs side by side, by file name.

    Raises:
        InputError: If the runs are of different experiments.
    """
    experiments = {record.scenario.experiment for record in records}
    if len(experiments) > 1:
        raise InputError(
            f"runs of different experiments ({', '.join(sorted(experiments))}) cannot be put side by side: "
            "give runs of one experiment."
        )
    plots = {name: plot(records) for name, plot in COMPARISONS[experiments.pop()].items()}
    return plots | ({"removal.png": plot_removal_runs(records)} if all(map(removed_something, records)) else {})


def removed_something(record: RunRecord) -> bool:
    """Whether a run has a map of what it took off, and took off anything."""
    return record.removal is not None and record.removal.mean > 0.0


def draw_seeds(records: Sequence[RunRecord]) -> dict[str, Figure]:
    """Draw the figures of many seeds of one scenario, by file name."""
    seeds = {"seeds.png": plot_seeds(records)}
    if records[0].scenario.experiment == "force":
        return seeds | {"force.png": plot_force_runs(records)}
    return seeds


def save_plots(folder: Path, plots: Mapping[str, Figure]) -> None:
    """Save figures under their file names; each file appears when it is whole."""
    for name, figure in plots.items():
        draft = folder / f".part-{name}"
        try:
            figure.savefig(draft)
            draft.replace(folder / name)
        finally:
            draft.unlink(missing_ok=True)
