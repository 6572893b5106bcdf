"""Files that hold a robot's log, each as blocks of rows: CSV, npz with named columns, ROS bags."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import count, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import InputError, check_name, near_file, needed, regular
from polish_sim.log import read_arrays
from polish_sim.tables import number_in

BLOCK = 5000  #: Rows read at a time
SEPARATORS = (",", ";", "\t", "|", " ")
JOINT_NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_STATE, _WRENCH = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"


class Block(NamedTuple):
    """Some rows of a log."""

    rows: Array  #: One column for each name asked for, shape (n, k)
    places: Sequence[int]  #: Line or number of each row, counted from 1


def open_source(file: Path, run: str) -> LogSource:
    """A log by the ending of its name, or that of a run folder; ``run``: which of several in an npz.

    Raises:
        InputError: There is no such file, or it is of no known kind.
    """
    if not file.exists():
        raise InputError(f"there is no log '{file}'.{near_file(file)}")
    if (file / "log.npz").is_file():
        file /= "log.npz"
    if file.is_dir() or file.suffix in (".mcap", ".db3", ".bag"):
        return BagSource(file)
    if file.suffix == ".npz":
        return NpzSource(file, run)
    return CsvSource(file)


class CsvSource:
    """Text with a header line: commas, semicolons, tabs, bars or spaces between values."""

    row = "line"

    def __init__(self, file: Path) -> None:
        self.file = file
        _, first = next(self._lines(), (0, ""))
        self.separator = next((sign for sign in SEPARATORS if sign in first.strip()), ",")
        self.names = [name.strip().strip('"') for name in first.strip().split(self.separator)]
        if len(self.names) < 2 or not np.isnan([*map(number_in, self.names)]).any():
            wrong = "begins with no header" if first else "holds no samples"
            raise InputError(f"'{file}' {wrong}. Wanted: names of columns, then one sample a line.")

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Lines with their numbers, except blank ones and comments."""
        try:
            with regular(self.file).open(encoding="utf-8-sig", newline=None) as text:
                for number, line in enumerate(text, 1):
                    if line.strip() and not line.startswith("#"):
                        yield number, line
        except OSError as error:
            raise InputError(f"cannot read the log '{self.file}': {error.strerror}.") from error
        except UnicodeDecodeError as error:
            raise InputError(
                f"'{self.file}' is no text ({error.reason}). Give a CSV, an npz or a ROS bag."
            ) from error

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Rows of some columns; InputError where a line is no row of numbers."""
        columns = [self.names.index(name) for name in names]
        samples = islice(self._lines(), 1, None)
        while lines := list(islice(samples, BLOCK)):
            yield Block(self._numbers(lines, columns), [number for number, _ in lines])

    def _numbers(self, lines: list[tuple[int, str]], columns: list[int]) -> Array:
        try:
            text = [line for _, line in lines]
            return np.loadtxt(
                text, delimiter=self.separator, usecols=columns, ndmin=2, quotechar='"', comments=None
            )
        except ValueError:
            for number, line in lines:
                self._check_line(number, line, columns)
            raise

    def _check_line(self, number: int, line: str, columns: list[int]) -> None:
        values = line.strip().split(self.separator)
        if len(values) <= max(columns):
            cut = "" if line.endswith("\n") else "the file was cut while it was written; "
            raise InputError(
                f"'{self.file}', line {number}: {len(values)} values, the header names {len(self.names)}: "
                f"{cut}leave this line out."
            )
        for column in columns:
            if math.isnan(number_in(values[column].strip().strip('"'))):
                raise InputError(
                    f"'{self.file}', line {number}: {self.names[column]} is '{values[column]}', not a "
                    "number. Correct or leave out the line."
                )


class NpzSource:
    """Arrays by name, (n,) or (n, k), a column of which is NAME_0 and so on; ``run``: names before a slash.

    They were in memory when the file was written, and are again.
    """

    row = "sample"

    def __init__(self, file: Path, run: str = "") -> None:
        self.file = file
        arrays = read_arrays(file, "npz", "Was it cut? Copy it again.", dict, ("",))
        runs = sorted({name.rpartition("/")[0] for name in arrays} - {""})
        if run:
            check_name("--run", run, runs)
        if runs and not run and all("/" in name for name in arrays):
            raise InputError(
                f"'{file}' holds {len(runs)} runs: choose one with --run NAME, e.g. --run {runs[0]}."
            )
        self._columns: dict[str, Array] = {}
        for name, array in arrays.items():
            of, _, short = name.rpartition("/")
            if of == run and array.ndim == 1:
                self._columns[short] = array
            elif of == run and array.ndim == 2:
                self._columns |= {f"{short}_{k}": column for k, column in enumerate(array.T)}
        self.names = list(self._columns)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Rows of some columns; InputError where they are of different lengths."""
        columns = {name: self._columns[name] for name in names}
        if len({*map(len, columns.values())}) > 1:
            found = ", ".join(f"{name} {len(column)}" for name, column in columns.items())
            raise InputError(f"'{self.file}': columns are of different lengths: {found}.")
        rows = np.stack([*columns.values()], axis=1).astype(float)
        for start in range(0, len(rows), BLOCK):
            some = rows[start : start + BLOCK]
            yield Block(some, range(start + 1, start + len(some) + 1))


class BagSource:
    """A ROS 2 (MCAP, SQLite) or ROS 1 bag: joint states, and the last wrench before each where there is one.

    Joints are found by their usual names, whatever stands before or after.
    """

    row = "message"

    def __init__(self, file: Path) -> None:
        self.file = file
        wide = ["position", "velocity", "effort"]
        with self._reader() as reader:
            self.topics = {kind: name for name, topic in reader.topics.items() if (kind := topic.msgtype)}
        if _STATE not in self.topics:
            raise InputError(
                f"'{file}' holds no topic of {_STATE}. It has: {', '.join(sorted(self.topics))}."
            )
        wide += ["wrench"] if _WRENCH in self.topics else []
        self.names = ["timestamp", *(f"{name}_{j}" for name in wide for j in range(6))]

    def _reader(self) -> Any:
        bags, types = (
            needed(f"rosbags.{name}", "ROS bags need a reader", "ros") for name in ("highlevel", "typesys")
        )
        try:
            reader = bags.AnyReader([self.file], default_typestore=types.get_typestore(types.Stores.LATEST))
            reader.open()
        except Exception as error:
            raise InputError(
                f"'{self.file}' is no run folder and no whole ROS bag ({error}). Was the recording cut?"
            ) from error
        return closing(reader)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Rows of some columns."""
        columns = [self.names.index(name) for name in names]
        rows = self._rows()
        for first in count(1, BLOCK):
            if not (block := list(islice(rows, BLOCK))):
                return
            yield Block(np.array(block)[:, columns], range(first, first + len(block)))

    def _rows(self) -> Iterator[Array]:
        wrench = np.full(6, np.nan)
        wanted = {self.topics.get(_STATE), self.topics.get(_WRENCH)}
        with self._reader() as reader:
            connections = [c for c in reader.connections if c.topic in wanted]
            try:
                for connection, stamp, raw in reader.messages(connections=connections):
                    message = reader.deserialize(raw, connection.msgtype)
                    if connection.msgtype == _WRENCH:
                        force = message.wrench.force
                        torque = message.wrench.torque
                        wrench = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
                    elif wrench[0] == wrench[0] or _WRENCH not in self.topics:
                        yield self._row(message, stamp, wrench)
            except InputError:
                raise
            except Exception as error:
                raise InputError(f"'{self.file}' ends in the middle of a message ({error}).") from error

    def _row(self, message: Any, stamp: int, wrench: Array) -> Array:
        at = [next((k for k, name in enumerate(message.name) if joint in name), -1) for joint in JOINT_NAMES]
        if min(at) < 0:
            raise InputError(
                f"'{self.file}': joint states name {', '.join(message.name)}, not {', '.join(JOINT_NAMES)}."
            )
        header = message.header.stamp
        time = header.sec + 1e-9 * header.nanosec or 1e-9 * stamp
        none = np.full(6, np.nan)
        parts = [np.asarray(part)[at] if len(part) > max(at) else none
                 for part in (message.position, message.velocity, message.effort)]  # fmt: skip
        return np.concatenate([[time], *parts, *([wrench] if _WRENCH in self.topics else [])])


LogSource = CsvSource | NpzSource | BagSource
"""A log: ``names`` of its columns, what a ``row`` is called, ``blocks`` of rows of some columns."""
