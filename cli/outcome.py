"""How a command ended: its figures beside the paper's and what is asked, and the exit code of the
contract."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polish_sim.analysis.claim import Claim, claim_row, shortfalls
from polish_sim.arms import FIRST, IDEAL
from polish_sim.cli import console
from polish_sim.cli.boundary import DONE, INTERRUPTED, SHORT, STOPPED
from polish_sim.config import Scenario

CONDITIONS = (
    *("sensor", "robot", "head", "pad", "simulation", "faults", "spindle"),
    *("part.real_file", "part.displacement_m", "part.rotation_rad", "part.form_error_m", "part.motion_m"),
    *("dual.master_delay_s", "dual.master_rate_hz", "dual.tracker_noise_m", "dual.touch_noise_m"),
    *("dual.arm_length_error_m", "dual.arm_angle_error_rad"),
)
"""Sections and keys whose default values hold for every figure that is asked."""
CHOSEN = (
    "pad.radius_m",
    "pad.choice",
    "simulation.log_rate_hz",
    "spindle.speed_rpm",
    "robot.arm",
    "robot.compensation",
)  #: Of these what the user chooses


@dataclass(frozen=True)
class Outcome:
    """One run or calibration, or several seeds of one: the figures that count."""

    claims: Sequence[Claim]  #: The figures to show and what is asked of them
    title: str
    #: Of figures to show, by heading; the last one is what is checked
    columns: Mapping[str, Mapping[str, Any]]
    stops: tuple[str, ...] = ()  #: Protective stops, each with its reason
    interrupted: bool = False
    #: How to draw the pictures that are missing because of an interrupt after all was measured
    undrawn: str = ""
    notes: tuple[str, ...] = ()  #: Lines to print above the table
    bad: tuple[str, ...] = ()  #: What is bad about it though it went to its end, in sentences
    conditions: tuple[str, ...] = ()
    """Conditions that differ from those the figures are asked for; nothing is called met or not met then."""

    def finish(self, folder: Path, check: bool | None) -> int:
        """Show the outcome and the folder; returns the exit code, falling short counts with ``check``."""
        with suppress(KeyboardInterrupt):  # all is written
            self.show()
        console.say_folder(folder)
        return self.exit_code(check)

    def show(self) -> None:
        """Print why the run ended early, if it did, and the table of figures."""
        if self.interrupted:
            console.note("interrupted: what was recorded up to now is kept.")
        if self.undrawn:
            console.note(
                "interrupted while drawing: the simulation, its log and figures are whole and kept, but "
                f"pictures are missing. {self.undrawn}"
            )
        for reason in self.stops:
            end = "" if reason.endswith("?") else "."
            console.note(f"error: protective stop: {reason}{end} The log is kept, stop included.")
        for text in self.notes:
            console.note(text)
        for text in self.bad:
            console.note(f"bad: {text}.")
        caption = ""
        if self.conditions:
            caption = (
                "'met' is left out: figures are asked for other conditions, here "
                f"{', '.join(self.conditions)}."
            )
        checked = None if self.conditions else self._checked
        show_figures(
            self.claims,
            self.title + (": with bad figures" if self.bad else ""),
            self.columns,
            checked,
            caption=caption,
        )

    def exit_code(self, check: bool | None) -> int:
        """The code to end with; falling short counts only when it was asked to ``check``."""
        if self.interrupted or self.undrawn:
            return INTERRUPTED
        if self.stops:
            return STOPPED
        return SHORT if check and (self.bad or shortfalls(self.claims, self._checked)) else DONE

    @property
    def _checked(self) -> Mapping[str, Any]:
        return list(self.columns.values())[-1]


def other_conditions(scenario: Scenario) -> tuple[str, ...]:
    """Sensor, springs, latency and other conditions of a run that are not its experiment's own, each as a
    text."""
    from polish_sim.analysis.run_record import changed_settings
    from polish_sim.experiments.registry import default_scenario
    from polish_sim.scenario_file import override

    arm = scenario.robot.arm
    own = override(default_scenario(scenario.experiment), [f"robot.arm={arm}"])
    make = () if arm in (IDEAL, FIRST) else (f"robot.arm = {arm} ({FIRST})",)
    return make + tuple(
        f"{name} = {value} ({usual})"
        for name, value, usual in changed_settings(scenario, own)
        if {name, name.partition(".")[0]} & set(CONDITIONS) and name not in CHOSEN
    )


def show_figures(
    claims: Sequence[Claim],
    title: str,
    columns: Mapping[str, Mapping[str, Any]],
    checked: Mapping[str, Any] | None = None,
    settings: Sequence[Sequence[str]] = (),
    caption: str = "",
) -> None:
    """Print figures by heading beside the paper's and what is asked of them.

    ``checked``: whose verdict stands at the end; ``settings``: rows above the figures: label, unit, a value
    for each column; ``caption``: a line below the table.
    """
    headings = ["figure", "unit", *columns, "paper", "asked"] + (["met"] if checked is not None else [])
    above = [[*row, *[""] * (len(headings) - len(row))] for row in settings]
    rows = [claim_row(claim, list(columns.values()), checked) for claim in claims]
    console.table(title, headings, above + rows, caption=caption)
