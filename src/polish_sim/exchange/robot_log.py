"""Logs of a robot, real or simulated, in one form: joints, currents, torques and forces over time, SI.

    read_robot_recording(file, need=("q_rad",)) -> RobotRecording

Recorders name their columns differently: `NAMES` knows those of ur_rtde, of the RTDE recorders and of ROS, a
mapping file names others. Files are read in blocks and no farther than the window asked for, so their size
does not matter.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import LARGEST, InputError, check_name
from polish_sim.exchange.log_sources import LogSource, open_source
from polish_sim.row_file import fits
from polish_sim.tables import refuse_first
from polish_sim.toml_text import read_toml

_SIX = (
    *("q_rad", "qd_rad_s", "q_desired_rad", "qd_desired_rad_s", "current_a", "current_desired_a"),
    *("torque_nm", "torque_desired_nm", "wrench"),
)
#: Quantities and how many columns each has; a wrench is (force; torque) the tool exerts [N], [N m]
WIDTHS: Mapping[str, int] = {**dict.fromkeys(_SIX, 6), "force_n": 1}
TIME = "time_s"
NAMES: Mapping[str, str] = {
    "timestamp": TIME,
    "time": TIME,
    "t": TIME,
    "actual_q": "q_rad",
    "actual_qd": "qd_rad_s",
    "q": "q_rad",
    "qd": "qd_rad_s",
    "position": "q_rad",
    "velocity": "qd_rad_s",
    "effort": "torque_nm",
    "target_q": "q_desired_rad",
    "target_qd": "qd_desired_rad_s",
    "actual_current": "current_a",
    "target_current": "current_desired_a",
    "target_moment": "torque_desired_nm",
    "actual_current_as_torque": "torque_nm",
    "actual_tcp_force": "wrench",
    "tcp_force": "wrench",
    "wrench_measured_tool": "wrench",
}  #: What recorders call them, in small letters
UNITS: Mapping[str, float] = {
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "rad": 1.0,
    "deg": math.pi / 180.0,
    "deg/s": math.pi / 180.0,
    "rad/s": 1.0,
    "A": 1.0,
    "mA": 1e-3,
    "N": 1.0,
    "Nm": 1.0,
    "kN": 1e3,
    "Nmm": 1e-3,
}
MOST_ROWS = 500_000  #: That are kept: 1000 s at 500 Hz
_FULL_TURN = 2.0 * math.pi
#: Steps longer than it and than `_GAP_STEPS` usual ones are gaps; splines hardly feel shorter ones [s]
GAP_S = 0.1
_GAP_STEPS = 10.0
CUT = "Give --to before it or cut the log there."
WHOLE = 0.0, math.inf  #: The window of all of a log [s]
_SLOWEST_S = 0.5
_INDEX = re.compile(r"^(?P<name>.*?)[_ ]?[\[(]?(?P<digit>\d)[\])]?(?P<unit>_[a-z_]+)?$")


class RobotRecording(NamedTuple):
    """Some time of a robot's log."""

    time: Array  #: From the first row kept [s], shape (n,)
    values: Mapping[str, Array]  #: By the names of `WIDTHS`, each of shape (n, width)
    whole: bool  #: False: the log continues after the last row

    def need(self, name: str, file: Path) -> Array:
        """A quantity; InputError if the log has none of it."""
        if name not in self.values:
            raise InputError(f"'{file}' holds no {name}. It has: {', '.join(self.values)}. {HOW_TO_MAP}")
        return self.values[name]

    def torques(self, constants: Sequence[float]) -> Array:
        """Torques of the joints (n, 6) [N m]: its own, or its currents by ``constants`` [N m/A], if any;
        (0, 6) if it has neither."""
        if "torque_nm" in self.values:
            return self.values["torque_nm"]
        if constants and "current_a" in self.values:
            return self.values["current_a"] * np.array(constants)
        return np.empty((0, 6))


HOW_TO_MAP = (
    "Name columns with --map FILE.toml: [columns] with e.g. q_rad = 'joint_{i}' (i from 0) or a list."
)
OF_CURRENTS = (
    "Of its currents the torques are known with --arm NAME, the make of a bare arm, in place of --model."
)


class ColumnMap(NamedTuple):
    """How a log names its columns: ours by theirs."""

    columns: Mapping[str, Sequence[str]]
    scale: Mapping[str, float]
    #: Quantities that are read and their columns, if they are known; else those by the names of `NAMES`
    wanted: Mapping[str, Sequence[str]] = dict.fromkeys(WIDTHS, ())


BY_NAME = ColumnMap({}, {})  #: Ours or a recorder's, see `NAMES`


def columns_of(slides: Sequence[int]) -> ColumnMap:
    """Our columns of positions and torques for joints that turn (0) or slide (1), shape (n,)."""
    q = [f"q{j}_m" if slide else f"q{j}_rad" for j, slide in enumerate(slides, 1)]
    torque = [f"force{j}_n" if slide else f"torque{j}_nm" for j, slide in enumerate(slides, 1)]
    return ColumnMap({}, {}, {"q_rad": q, "torque_nm": torque})


def read_column_map(file: Path, joints: int = 6) -> ColumnMap:
    """Read a mapping file: [columns] OURS = THEIRS and [units] OURS = UNIT, of a robot of some joints.

    Raises:
        InputError: A quantity or unit that is not known, or a number of columns that does not fit.
    """
    table = read_toml(file, "mapping", InputError)
    columns = table.get("columns", {})
    units = table.get("units", {})
    if not (fits(columns, {}) and fits(units, {...: str})):
        raise InputError(f"'{file}': [columns] and [units] are sections with lines OURS = 'THEIRS'.")
    known = ("columns", "units", TIME, *WIDTHS)
    for name in (*table, *columns, *units):
        check_name(f"key of '{file}'", name, known)
    widths = dict.fromkeys(("q_rad", "torque_nm"), joints)
    named = {name: _listed(file, name, theirs, {**WIDTHS, **widths}) for name, theirs in columns.items()}
    for name, unit in units.items():
        check_name(f"unit of {name} in '{file}'", unit, UNITS)
    return ColumnMap(named, {name: UNITS[unit] for name, unit in units.items()})


def _listed(file: Path, name: str, theirs: Any, widths: Mapping[str, int]) -> list[str]:
    width = widths.get(name, 1)
    if isinstance(theirs, str):
        spread = [theirs.replace("{i}", str(i)).replace("{j}", str(i + 1)) for i in range(width)]
        theirs = spread if len(set(spread)) == width else [theirs]
    if not isinstance(theirs, list) or len(theirs) != width:
        raise InputError(
            f"'{file}': {name} takes {width} column{'s' * (width > 1)}, as a list or with {{i}} in a name."
        )
    return [str(one) for one in theirs]


def read_robot_recording(
    file: Path,
    need: Sequence[str] = (),
    columns: ColumnMap = BY_NAME,
    run: str = "",
    window: tuple[float, float] = WHOLE,
    of_gap: str | None = CUT,
) -> RobotRecording:
    """Read what a log has of the known quantities between two times of ``window`` [s], from the log's first
    row.

    ``need``: quantities it must have; ``run``: which of several in an npz; ``of_gap``: what to do about a
    gap, which is refused; None where samples may lie anyhow.

    Raises:
        InputError: A file that cannot be read, lacks a column, was cut, or holds a gap, no number, time that
            does not increase or values that look like other units; names the place.
    """
    source = open_source(file, run)
    plan = _match(file, source, columns, need)
    factors = np.repeat([columns.scale.get(name, 1.0) for name in plan], [*map(len, plan.values())])
    kept, whole = _gather(file, source, plan, factors, window)
    time = kept[:, 0]
    *parts, places = np.split(kept, np.cumsum([*map(len, plan.values())]), axis=1)
    values = {name: part for name, part in zip(plan, parts, strict=True)
              if name in need or not np.isnan(part).all()}  # fmt: skip
    del values[TIME]
    _check_steps(file, source.row, places, time, of_gap)
    _check_numbers(f"'{file}', {source.row}", places, time, values)
    _check_units(file, time, values, plan)
    return RobotRecording(time - time[0], values, whole)


def _match(file: Path, source: LogSource, columns: ColumnMap, need: Sequence[str]) -> dict[str, list[str]]:
    """Columns of the log by our names, time first."""
    found: dict[str, dict[int, str]] = {}
    for theirs in source.names:
        base, index = _split(theirs)
        ours = NAMES.get(base, base)
        if ours == TIME or ours in WIDTHS:
            found.setdefault(ours, {}).setdefault(index, theirs)
    lower = {one.lower(): one for one in source.names}
    plan: dict[str, list[str]] = {}
    for name in (TIME, *columns.wanted):
        usual, by_name = columns.wanted.get(name, ()), found.get(name, {})
        asked = [lower.get(one.lower(), one) for one in columns.columns.get(name, usual)]
        lost = ", ".join(one for one in asked if one not in source.names)
        # Of a slide the name says that it is one.
        named = name not in columns.columns and not any(one.endswith(("_m", "_n")) for one in usual)
        if named and (lost or not asked) and len(by_name) == (len(usual) or WIDTHS.get(name, 1)):
            asked = [by_name[k] for k in sorted(by_name)]
        elif lost or (not asked and name in (TIME, *need)):
            of_currents = name == "torque_nm" and "current_a" in found
            raise InputError(
                f"'{file}' has no column {f'{lost} for' if lost else 'of'} {name}. It has: "
                f"{_some(source.names)}. {OF_CURRENTS if of_currents else HOW_TO_MAP}"
            )
        if asked:
            plan[name] = asked
    return plan


def _split(name: str) -> tuple[str, int]:
    """A column's name without the number of its joint, and that number: actual_q_0, q1_rad, actual_q[0]."""
    name = name.lower()
    match = None if name in NAMES or name == TIME or name in WIDTHS else _INDEX.match(name)
    return (name, 0) if match is None else (match["name"] + (match["unit"] or ""), int(match["digit"]))


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _gather(
    file: Path,
    source: LogSource,
    plan: Mapping[str, Sequence[str]],
    factors: Array,
    window: tuple[float, float],
) -> tuple[Array, bool]:
    """Rows of the window, each with its place in the file behind it, and whether the log ends with it."""
    kept = list[Array]()
    begin = math.nan
    last = 0.0  # since the first row
    count = 0
    whole = True
    for block in source.blocks([theirs for columns in plan.values() for theirs in columns]):
        rows = np.column_stack([block.rows * factors, block.places])
        begin = rows[0, 0] if math.isnan(begin) else begin
        since = rows[:, 0] - begin
        outside = (since >= 0.0) & (since < window[0]) | (since > window[1])
        kept.append(rows[~outside][: MOST_ROWS - count])
        count += len(kept[-1])
        last = float(since[-1])
        if last > window[1] or count == MOST_ROWS:
            whole = False
            break
    if count < 2:
        end = "on" if window[1] == math.inf else f"to {window[1]:g} s"
        have = "it has none" if math.isnan(begin) else f"it ends at {last:.4g} s"
        raise InputError(
            f"'{file}' holds fewer than two {source.row}s from {window[0]:g} s {end}: {have}. "
            "Record it again."
        )
    return np.concatenate(kept), whole


def _check_steps(file: Path, row: str, places: Array, time: Array, of_gap: str | None) -> None:
    """Refuse time that does not increase, and gaps."""
    steps = np.diff(time)

    def place(at: int) -> str:
        return f"{row} {places[at + 1, 0]:.0f}"

    refuse_first(
        ~(steps > 0.0), file, place,
        lambda at: f"{TIME} does not increase (it is {time[at + 1]:.9g}). Sort the rows.",
    )  # fmt: skip
    if of_gap is None:
        return
    usual = float(np.median(steps))
    if usual > _SLOWEST_S:
        raise InputError(
            f"'{file}': rows are {usual:.3g} s apart. Other units? --map with [units] {TIME} = 'ms' or 'ns'."
        )
    refuse_first(
        (steps > GAP_S) & (steps > _GAP_STEPS * usual), file, place,
        lambda at: f"a gap of {steps[at]:.3g} s, rows are {usual:.3g} s apart. {of_gap}",
    )  # fmt: skip


def _check_numbers(row: str, places: Array, time: Array, values: Mapping[str, Array]) -> None:
    for name, value in values.items():
        bad = np.argwhere(~(np.abs(value) <= LARGEST))
        if len(bad):
            at, column = bad[0]
            raise InputError(
                f"{row} {places[at, 0]:.0f}, {time[at] - time[0]:.6g} s into the window: {name}, column "
                f"{column + 1}, is {value[at, column]}. Correct or leave out the row."
            )


def _check_units(
    file: Path, time: Array, values: Mapping[str, Array], plan: Mapping[str, Sequence[str]]
) -> None:
    for name in sorted(values.keys() & {"q_rad", "q_desired_rad"}):
        # A slide's column is in metres, by its name.
        far = (np.abs(values[name]).max(axis=0) * [not one.endswith("_m") for one in plan[name]]).max()
        if far > 1.05 * _FULL_TURN:
            raise InputError(
                f"'{file}': {name} reaches {far:.4g}, more than a turn. Are these degrees? --map with "
                f"[units] {name} = 'deg'."
            )
    if {"q_rad", "qd_rad_s"} <= values.keys() and len(time) > 10:
        moved = np.abs(np.diff(values["q_rad"], axis=0)).sum()
        by_speed = (np.abs(values["qd_rad_s"][1:]) * np.diff(time)[:, None]).sum()
        if moved > 0.5 and not 0.5 < by_speed / moved < 2.0:
            raise InputError(
                f"'{file}': by qd_rad_s the joints turned {by_speed:.3g} rad, by q_rad {moved:.3g}. Units of "
                "time or speed differ: --map with [units]."
            )
