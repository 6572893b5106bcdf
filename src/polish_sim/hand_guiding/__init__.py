"""Branch ``hand_guiding`` (paper 3): an arm guided by hand, and paths taught with it; the row of its
experiment ``teach``, and what is asked of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from polish_sim.analysis.claim import PATH_DONE, Claim
from polish_sim.config import GuideConfig, Scenario, SpindleConfig
from polish_sim.experiments.registry import (
    PART_OPTIONS,
    REGION_OPTIONS,
    SEED_OPTIONS,
    WATCH_OPTIONS,
    Experiment,
    Setting,
)
from polish_sim.page import DEGREES

if TYPE_CHECKING:
    from polish_sim.analysis.run_record import RunRecord

_FORCE = (
    Claim("hand_force_peak_n", "hand force, peak", "N"),
    Claim("hand_force_rms_n", "  rms", "N"),
)
_LET_GO = (
    Claim("drift_rad", "hands off, drift", "deg", high=0.01 / DEGREES),
    Claim("lent_energy_j", "energy lent, most", "J"),
)

CLAIMS: Mapping[str, tuple[Claim, ...]] = {
    "trial": (
        Claim("none_peak_n", "hand force, nothing compensated, peak", "N", "> 100"),
        Claim("classical_peak_n", "  gravity and friction (classical)", "N", "< 30"),
        Claim("fast_peak_ratio_x", "fast move along x, inertia / classical, peak", "", "0.714", high=0.45),
        Claim("fast_rms_ratio_x", "  rms", "", high=0.30),
        Claim("fast_peak_ratio_y", "along y, peak", "", "0.714", high=0.45),
        Claim("fast_rms_ratio_y", "  rms", "", high=0.30),
        Claim("assist_fast_peak_ratio_x", "with start-up assist: along x, peak", ""),
        Claim("assist_fast_rms_ratio_x", "  rms", ""),
        Claim("assist_fast_peak_ratio_y", "  along y, peak", ""),
        Claim("assist_fast_rms_ratio_y", "  rms", ""),
        Claim("slow_peak_n", "  slow moves, peak", "N", high=10.0),
        *_LET_GO,
        PATH_DONE,
    ),
    "some": (_FORCE[0]._replace(label="hand force, last mode, peak"), _FORCE[1], *_LET_GO, PATH_DONE),
    "one": (*_FORCE, *_LET_GO, PATH_DONE),
    # An arm that does not carry itself is not released.
    "none": (*_FORCE, PATH_DONE),
    "path": (
        Claim("taught_deviation_max_m", "taught path off what was meant, max", "mm"),
        Claim("taught_deviation_rms_m", "  rms", "mm"),
        Claim("recorded_deviation_max_m", "recording off it, max", "mm"),
        Claim("recorded_deviation_rms_m", "  rms", "mm"),
        Claim("taught_missed_max_m", "what was meant off the taught path, max", "mm"),
        Claim("taught_axis_error_max_rad", "tool axis, max", "deg"),
        Claim("points_recorded", "points recorded", ""),
        Claim("points_taught", "points taught", ""),
        *_FORCE,
        PATH_DONE,
    ),
}
"""What is asked of each kind of run."""


def kind_of(guide: GuideConfig, follow: str) -> str:
    """Which figures a run has: the whole trial, some of its moves, one mode, an arm that sags, or a taught
    path."""
    if follow:
        return "path"
    if not (guide.mode or guide.direction or guide.duration_s):
        return "trial"
    if not guide.mode:
        return "some"
    return "none" if guide.mode == "none" else "one"


def _plots(record: RunRecord) -> Mapping[str, str]:
    m = record.metrics
    plots = {"hand_force.png": "polish_sim.hand_guiding.plots:plot_guiding"} if m.get("moves") else {}
    taught = record.scenario.drag.follow and record.path and m.get("T_base_work")
    return plots | ({"taught.png": "polish_sim.hand_guiding.plots:plot_taught"} if taught else {})


def _title(scenario: Scenario) -> str:
    if scenario.drag.follow:
        return f"teach, along {scenario.drag.follow} of {scenario.part.file}, seed {scenario.seed}"
    return f"teach, {scenario.guide.mode or 'every mode'}"


TEACH = Experiment(
    "teach",
    "a hand guides the arm, whose torques make it light (paper 3, fig. 6)",
    Scenario(experiment="teach", spindle=SpindleConfig(speed_rpm=0.0)),
    run="polish_sim.hand_guiding.drag:run_guiding",
    claims=lambda s: CLAIMS[kind_of(s.guide, s.drag.follow)],
    plots=_plots,
    forms={"moves": [str]},
    comparisons={"hand_force.png": "polish_sim.hand_guiding.plots:plot_guiding_runs"},
    settings=(
        Setting("along", "", lambda s: Path(s.drag.follow).name or "the trial's moves"),
        Setting("mode", "", lambda s: s.guide.mode or ("default" if s.drag.follow else "every")),
    ),
    options=(
        "--mode",
        "--direction",
        "--duration",
        "--follow",
        *PART_OPTIONS,
        *REGION_OPTIONS,
        "--pad-diameter",
        *SEED_OPTIONS,
        *WATCH_OPTIONS,
    ),
    only_with={("--follow",): (*PART_OPTIONS, *REGION_OPTIONS, "--pad-diameter")},
    not_with={"--follow": ("--direction", "--duration")},
    title=_title,
    controlled=False,
    on_part=False,
    remade=False,
    idle=("controller", "sensor", "payload", "spindle", "safety", "faults", "dual"),
)
