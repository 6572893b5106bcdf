"""What every experiment returns."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from polish_sim.analysis.run_record import PATH, REMOVAL, RunRecord
from polish_sim.arrays import Array, Figures
from polish_sim.cell.observer import Observer
from polish_sim.errors import number_text, place_in_mm
from polish_sim.row_file import package_versions
from polish_sim.spatial import apply, inverse

if TYPE_CHECKING:
    from polish_sim.cell import Cell, CellRun
    from polish_sim.config import Scenario
    from polish_sim.log import RemovalMap, RunLog, Trace
    from polish_sim.planning.toolpath import ToolPath


@dataclass(frozen=True)
class RunResult:
    """A finished, stopped or interrupted run."""

    scenario: Scenario
    log: RunLog
    trace: Trace
    figures: Figures  #: The keys of metrics.json for this experiment
    path: ToolPath | None = None  #: The path that was run, work frame
    removal: RemovalMap | None = None  #: What it took off the part, of ``surface`` and of ``dual`` in contact
    files: Mapping[str, str] = field(default_factory=dict)  #: More text files of the run, by name

    @property
    def stop_reason(self) -> str | None:
        """Why the robot stopped itself, where and when, or None."""
        return self.figures["protective_stop"]  # type: ignore[no-any-return]

    @property
    def interrupted(self) -> bool:
        """Whether the user broke it off."""
        return self.figures["interrupted"]  # type: ignore[no-any-return]

    @property
    def record(self) -> RunRecord:
        """What it leaves on disk, versions and files not every run has with its figures."""
        files = [name for name, made in ((PATH, self.path), (REMOVAL, self.removal)) if made is not None]
        figures = {**self.figures, "versions": package_versions(), "files": files}
        return RunRecord(self.scenario.experiment, self.scenario, figures, self.log, self.path, self.removal)


def free_figures(seed: int, T_base_work: Array | None, steps: int, simulated: float, wall: float) -> Figures:
    """The figures every experiment reports, of a run that went to its end; times in s."""
    return {
        "path_done": 1.0,
        "protective_stop": None,
        "interrupted": False,
        "faults_missed": [],
        "T_base_work": None if T_base_work is None else T_base_work.tolist(),
        "simulated_s": simulated,
        "wall_s": wall,
        "real_time_factor": simulated / wall if wall else 0.0,
        "steps": steps,
        "seed": seed,
    }


def common_figures(cell: Cell, run: CellRun, path_done: float, T_base_work: Array | None) -> Figures:
    """Figures every experiment reports; ``path_done`` is the share of the path (or of the holding time), 0 to
    1.

    ``T_base_work`` (4, 4) is the nominal pose of the part, None without one. They are path_done,
    protective_stop, protective_stop_at, what ``SafetyRecord`` and ``PayloadErrors`` name, peak_force_n (of
    the whole run), interrupted, T_base_work, cycle_time_s (air moves, touch-down and lifts included),
    simulated_s, wall_s, real_time_factor, steps, seed; of an active flange flange_stroke_used, the share of
    its stroke used.
    """
    scenario = cell.scenario
    simulated = run.steps * run.dt
    travel = run.trace.pad_travel_m[run.trace.fed]
    stroke = {"flange_stroke_used": np.ptp(travel) / scenario.head.travel_m} if len(travel) else {}
    return {
        **free_figures(scenario.seed, T_base_work, run.steps, simulated, run.wall_s),
        **(stroke if scenario.head.flange.bandwidth_hz else {}),
        "path_done": path_done,
        **_stop(run, _with_values(run.stop_reason, scenario), T_base_work),
        **run.safety._asdict(),
        **run.payload._asdict(),
        "peak_force_n": run.trace.normal_force_n.max(),
        "interrupted": run.interrupted,
        "cycle_time_s": simulated,
    }


def _stop(run: CellRun, limits: str | None, T_base_work: Array | None) -> Figures:
    """Why the robot stopped itself, with the ``limits`` it kept, when, where and at what force; None if it
    did not.

    ``protective_stop_at`` holds the same for pictures: name, time_s, path_s_m, tool_m in the base frame and
    on the part, tool_on_part_m.
    """
    trace, at = run.trace, run.safety.protective_stop_time_s
    if limits is None or at is None or not len(trace.time_s):
        return {"protective_stop": limits, "protective_stop_at": None}
    row = min(int(np.searchsorted(trace.time_s, at)), len(trace.time_s) - 1)
    tip = trace.tcp_position_m[row]
    on_part, where = trace.tool_on_part_m[row], ""  # of a part that is carried
    if T_base_work is not None:
        on_part = on_part if on_part.any() else apply(inverse(T_base_work), tip)
        where = f"{place_in_mm(on_part)} of the part, "
    force = f"exact force {trace.normal_force_n[row] + 0.0:.1f} N along the tool axis"
    along = f"{1e3 * trace.path_s_m[row]:.0f} mm along the path, stroke {run.stroke}, " if run.stroke else ""
    measured = (
        f"measured {run.safety.protective_stop_measured}" if run.safety.protective_stop_measured else ""
    )
    when = f"at {at:.2f} s"
    name = re.split(r"[:(]", limits)[0].strip()
    return {
        "protective_stop": f"{limits}; {' '.join(filter(None, [measured, when]))}, {along}tool at "
        f"{where}{place_in_mm(tip)} of the base, {force}",
        "protective_stop_at": {
            "name": ", ".join(filter(None, [name, measured])),
            "time_s": at,
            "path_s_m": trace.path_s_m[row],
            "tool_m": tip.tolist(),
            "tool_on_part_m": on_part.tolist() if where else None,
        },
    }


def _with_values(text: str | None, scenario: Scenario) -> str | None:
    """A text with the values of the keys it names, where they are numbers."""

    def value_of(key: re.Match[str]) -> str:
        value = getattr(getattr(scenario, key[1], None), key[2], None)
        return f"{key[0]} = {number_text(value)}" if isinstance(value, (int, float)) else key[0]

    return text and re.sub(r"\b([a-z]+)\.([a-z]\w+)", value_of, text)


# Progress of one of several equal tasks, as progress of the whole.


class PartOf(Observer):
    """Passes on the frames and the progress of piece ``number`` of ``count``; the whole is one stage."""

    def __init__(self, observer: Observer, number: int, count: int) -> None:
        self.observer, self.number, self.count = observer, number, count
        self.frame_every_s = observer.frame_every_s

    def progress(self, done: float, total: float) -> None:
        """Share of the whole."""
        self.observer.progress(self.number + done / total, self.count)

    def frame(self, model: Any, data: Any) -> None:
        """Passed on."""
        self.observer.frame(model, data)
