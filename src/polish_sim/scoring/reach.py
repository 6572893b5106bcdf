"""What is asked of the controller, as data, and the cases that measure it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

from polish_sim.row_file import Row
from polish_sim.scoring.battery import APPROACH_20, Case, Draw, latency_settings, spring_settings
from polish_sim.scoring.figures import spread

SPRINGS = (0.2, 0.5, 1.0, 2.0, 5.0)  #: Real springs by what the controller takes them for [-]
LATENCIES_MS = (2, 4, 8, 12, 20)  #: Total latencies [ms]


def _grid() -> tuple[Case, ...]:
    return tuple(
        Case(
            f"reach-springs-{springs:g}x-{latency}ms",
            f"20 N on a plate, springs {springs:g} x, {latency} ms in all, approach 20 mm/s",
            "force",
            (*spring_settings(springs), *latency_settings(latency), APPROACH_20),
        )
        for springs in SPRINGS
        for latency in LATENCIES_MS
    )


REACH_CASES = (
    Case("reach-step", "20 N on a flat plate, approach 20 mm/s, held 4 s", "force", (APPROACH_20,)),
    Case(
        "reach-freeform-10",
        "the main job as it is: freeform, 8 mm step-over, whole path at 10 mm/s",
        "surface",
    ),
    Case("reach-freeform-30", "the main job at 30 mm/s, whole path", "surface", ("process.feed_m_s=0.03",)),
    *_grid(),
    Case(
        "reach-random",
        "freeform, 16 mm step-over, whole path at 20 to 60 mm/s, landing at 5 to 20 mm/s, the part up to 3 "
        "mm and 2 deg off and bent by up to 0.5 mm",
        "surface",
        ("plan.stepover_m=0.016", "safety.offset_limit_m=0.01"),
        (
            Draw("process.feed_m_s", 0.02, 0.06),
            Draw("process.approach_speed_m_s", 0.005, 0.02),
            Draw("part.displacement_m", 0.0, 0.003),
            Draw("part.rotation_rad", 0.0, math.radians(2.0)),
            Draw("part.form_error_m", 0.0, 0.0005),
        ),
        repeats=10,
    ),
)
"""One case, or a grid of them, for each row asked."""


class Asked(NamedTuple):
    """A figure and what is asked of it at the worst seed."""

    label: str
    cases: str  #: Shell pattern of the cases it is asked in
    figure: str  #: Its name in a row; ``stable`` is asked to be true
    most: float  #: Largest value that passes; of ``stable`` no meaning
    unit: str
    published: str = "-"  #: What the paper reports, or the best published

    def applies(self, case: str) -> bool:
        """Whether a case is asked for this figure."""
        return fnmatchcase(case, self.cases)

    def worst(self, rows: Sequence[Row]) -> float | None:
        """The least good value of some rows; of ``stable`` the share that is; None if one is undefined."""
        found = spread([row[self.figure] for row in rows])
        return found.mean if self.figure == "stable" else found.worst

    def met_by(self, value: float | None) -> bool:
        """Whether a worst value passes."""
        if value is None:
            return False
        return value == 1.0 if self.figure == "stable" else value <= self.most


_STEP = (
    ("force step 20 N at 20 mm/s: settling to ±1 N", "settling_1n_s", 0.25, "s", "0.5 s to ±3 N"),
    ("force step 20 N at 20 mm/s: overshoot", "overshoot_n", 1.0, "N", "-"),
    ("steady: standard deviation", "std_n", 0.3, "N", "±3 N"),
    ("steady: max error", "max_error_n", 1.0, "N", "±3 N"),
    ("approach 20 mm/s: peak force", "peak_force_n", 30.0, "N", "-"),
)
_FREEFORM = (
    ("freeform 10 mm/s: max error", "max_error_n", 1.5, "N", "±4 N"),
    ("freeform 10 mm/s: RMS", "rms_error_n", 0.4, "N", "±1.5 N"),
    ("freeform 10 mm/s: at the peaks", "peaks_error_n", 1.5, "N", "-"),
)
_OF_GRID = (("stable", "stable", 1.0, ""), ("settling to ±1 N", "settling_1n_s", 0.6, "s"))
_SPRING_TEXT = "springs x 0.2-5, latency 2-20 ms: "

REACH = (
    *(Asked(label, "reach-step", figure, most, unit, known) for label, figure, most, unit, known in _STEP),
    *(
        Asked(label, "reach-freeform-10", figure, most, unit, known)
        for label, figure, most, unit, known in _FREEFORM
    ),
    Asked("freeform 30 mm/s: max error", "reach-freeform-30", "max_error_n", 3.0, "N"),
    *(
        Asked(_SPRING_TEXT + label, "reach-springs-*", figure, most, unit)
        for label, figure, most, unit in _OF_GRID
    ),
    Asked("200 random freeform runs: contact lost", "reach-random", "contact_lost_s", 0.0, "s"),
)
"""The rows asked; payload and faults have commands of their own, see docs/score.md."""

BATTERY_ASKED = (
    *(asked._replace(cases="approach-20") for asked in REACH if asked.cases == "reach-step"),
    *(asked._replace(cases="freeform-10") for asked in REACH if asked.cases == "reach-freeform-10"),
    Asked("freeform 30 mm/s: max error", "freeform-30", "max_error_n", 3.0, "N"),
    *(
        Asked(f"{kind}: {label}", f"{kind}-*", figure, most, unit)
        for kind in ("stiffness", "latency")
        for label, figure, most, unit in _OF_GRID
    ),
)  # fmt: skip
"""The same asked of the cases of the battery."""


class JudgedFigure(NamedTuple):
    """A figure that was asked, measured."""

    asked: Asked
    runs: int
    mean: float | None
    worst: float | None
    worst_case: str | None  #: Case and seed of the least good run
    met: bool


def judge(asked: Sequence[Asked], rows: Sequence[Row]) -> list[JudgedFigure]:
    """Compare rows of one controller with what is asked of them; what no row speaks of is left out."""
    verdicts = []
    for one in asked:
        fitting = [row for row in rows if one.applies(row["case"])]
        if fitting:
            mean, worst = spread([row[one.figure] for row in fitting]).mean, one.worst(fitting)
            least_good = max(fitting, key=lambda row: _badness(one, row))
            where = f"{least_good['case']}, seed {least_good['seed']}"
            verdicts.append(JudgedFigure(one, len(fitting), mean, worst, where, one.met_by(worst)))
    return verdicts


def _badness(asked: Asked, row: Mapping[str, Any]) -> float:
    value = row[asked.figure]
    if value is None:
        return math.inf
    return -float(value) if asked.figure == "stable" else float(value)
