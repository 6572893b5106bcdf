"""`polish-sim calibrate tcp` and `calibrate base` as a user calls them, and what calibrations of two robots
refuse."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.cli.boundary import execute
from polish_sim.cli.main import commands
from polish_sim.dual.calibration.bases import read_base_calibration
from polish_sim.dual.calibration.circle import fit_circle
from polish_sim.dual.calibration.tool import read_tool_calibration
from polish_sim.errors import InputError
from tests.cli.conftest import Tool, metrics_of

PAIR = 'cell "7" \\ left'
FILES = {"calibration.toml", "residuals.csv", "metrics.json"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders of calibrations, one of a tool and one of the bases."""
    folder = tmp_path_factory.mktemp("made")
    for name, pair in (("tcp", ()), ("base", ("--pair", PAIR))):
        words = ("calibrate", name, *pair, "--seed", "2", "--check", "--out", str(folder / name))
        assert execute(commands, list(words)) == 0
    return folder


@pytest.fixture(scope="module")
def files(made: Path) -> dict[str, list[list[str]]]:
    """Good files of measurements, to be spoilt."""
    texts = {folder.name: (folder / "residuals.csv").read_text(encoding="utf-8") for folder in made.iterdir()}
    return {name: [line.split(",") for line in text.splitlines()] for name, text in texts.items()}


def write(file: Path, rows: list[list[str]]) -> Path:
    file.write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")
    return file


def test_a_tool_frame_leaves_its_files_and_they_read_back(
    made: Path, polish_sim: Tool, tmp_path: Path
) -> None:
    one = made / "tcp"
    assert {path.name for path in one.iterdir()} == {*FILES, "tool.png"}
    figures = metrics_of(one)
    assert {"position_error_m", "position_crb_m", "residual_rms_m"} <= figures.keys()
    found = read_tool_calibration(one / "calibration.toml")
    np.testing.assert_allclose(found[:3, 3], figures["position_m"])
    written = tomllib.loads((one / "calibration.toml").read_text(encoding="utf-8"))
    assert written["position_covariance"][0][0] == pytest.approx(figures["position_m_std"][0] ** 2)
    assert polish_sim("calibrate", "tcp", "--data", one / "residuals.csv", "--out", "two").code == 0
    again = metrics_of(tmp_path / "two")
    np.testing.assert_allclose(again["position_m"], figures["position_m"], atol=1e-10)
    np.testing.assert_allclose(again["quaternion_wxyz"], figures["quaternion_wxyz"], atol=1e-9)


def test_bases_leave_their_files_and_they_read_back(made: Path, polish_sim: Tool, tmp_path: Path) -> None:
    one = made / "base"
    assert {path.name for path in one.iterdir()} == {*FILES, "bases.png"}
    figures = metrics_of(one)
    assert {"origin_error_m", "axis_error_rad"} <= figures.keys()
    found = read_base_calibration(one / "calibration.toml", PAIR)
    np.testing.assert_allclose(found.T_master_follower, figures["transform"], atol=1e-15)
    assert polish_sim("calibrate", "base", "--data", one / "residuals.csv", "--out", "two").code == 0
    np.testing.assert_allclose(metrics_of(tmp_path / "two")["transform"], figures["transform"], atol=1e-6)


def test_a_calibration_of_another_thing_is_refused(made: Path, polish_sim: Tool) -> None:
    with pytest.raises(InputError, match="not the calibration of two bases"):
        read_base_calibration(made / "tcp" / "calibration.toml", PAIR)
    with pytest.raises(InputError, match="not the calibration of a tool frame"):
        read_tool_calibration(made / "base" / "calibration.toml")
    tool = made / "tcp" / "calibration.toml"
    code, _, err = polish_sim("run", "force", "--calibration", tool, "--out", "run")
    assert code == 2
    assert "is not the calibration of a payload" in err


def changed(
    rows: list[list[str]], line: int, column: str, scale: float, shift: float = 0.0
) -> list[list[str]]:
    rows = [list(row) for row in rows]
    k = rows[0].index(column)
    rows[line][k] = str(scale * float(rows[line][k]) + shift)
    return rows


def renamed(rows: list[list[str]], **names: str) -> list[list[str]]:
    return [[names.get(name, name) for name in rows[0]], *rows[1:]]


def scaled(rows: list[list[str]], scale: float) -> list[list[str]]:
    """Every length in another unit than the header says."""
    for name in ("x_mm", "y_mm", "z_mm"):
        for line in range(1, len(rows)):
            rows = changed(rows, line, name, scale)
    return rows


def exchanged(row: list[str]) -> list[str]:
    """The arc of axis 2 taken for the other robot's."""
    return [{"master": "follower", "follower": "master"}[row[0]], *row[1:]] if row[1] == "2" else row


BAD: list[tuple[str, Callable[[list[list[str]]], list[list[str]]], str]] = [
    ("tcp", lambda r: renamed(r, x_mm="y_mm", y_mm="x_mm"), "columns are swapped"),
    ("tcp", lambda r: renamed(r, qx="qy", qy="qx"), "as qw, qy, qx, qz: columns are swapped"),
    ("tcp", lambda r: renamed(r, qw="qx", qx="qy", qy="qz", qz="qw"), "columns are swapped"),
    ("tcp", lambda r: renamed(r, x_mm="x_m"), "mixes units"),
    ("tcp", lambda r: renamed(r, z_mm="height"), "lacks the column z_mm"),
    ("tcp", lambda r: [*r[:4], *scaled(r, 1e-3)[4:5], *r[5:]], "line 5"),
    ("tcp", lambda r: changed(r, 2, "qw", 1.0, 0.5), "are not a unit quaternion"),
    ("tcp", lambda r: [row for row in r if row[1] != "in_xz"], "0 lines of the kind 'in_xz'"),
    (
        "tcp",
        lambda r: [r[0], *[[*x[:5], *r[k][5:9], *x[9:]] for k, x in enumerate(r[3:] + r[1:3], 1)]],
        "no tip fits",
    ),
    (
        "tcp",
        lambda r: [r[0], *[[*x[:6], *(str(-float(v)) for v in x[6:9]), *x[9:]] for x in r[1:]]],
        "turned round",
    ),
    (
        "tcp",
        lambda r: renamed(r, x_mm="x_m", y_mm="y_m", z_mm="z_m"),
        "Are these numbers in m, as the header",
    ),
    ("tcp", lambda r: [[";".join(row)] for row in r], "the columns are separated by semicolons"),
    ("base", lambda r: renamed(r, x_mm="x_m", y_mm="y_m", z_mm="z_m"), "Wrong unit, or joints not at zero?"),
    ("base", lambda r: [r[0], *(["follower", *x[1:]] for x in r[1:] if x[0] == "master")], "of the master"),
    ("base", lambda r: [exchanged(row) for row in r], "the master: axes 1 and 2 miss each other by"),
    ("base", lambda r: [row for row in r if row[0] != "follower"], "no measurement of the follower"),
    ("base", lambda r: [row for row in r if row[1] != "2"], "no arc of axis 2 of the master"),
]


@pytest.mark.parametrize(("name", "spoil", "said"), BAD)
def test_bad_files_are_one_message_and_nothing_is_written(
    name: str, spoil: Any, said: str, files: dict[str, list[list[str]]], polish_sim: Tool, tmp_path: Path
) -> None:
    write(tmp_path / "bad.csv", spoil(files[name]))
    code, out, err = polish_sim("calibrate", name, "--data", "bad.csv")
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert said in err.replace("\n", " ")
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("name", "line", "column", "said"), [("tcp", 6, "y_mm", 6), ("base", 4, "y_mm", "master, axis 1: 4")]
)
def test_a_measurement_off_by_two_millimetres_is_named(
    name: str, line: int, column: str, said: Any, files: Any, polish_sim: Tool, tmp_path: Path
) -> None:
    write(tmp_path / "off.csv", changed(files[name], line, column, 1.0, 2.0))
    code, _, err = polish_sim("calibrate", name, "--data", "off.csv", "--out", "two")
    assert code == 0
    assert f"{said} does not fit the others and was left out" in err
    assert metrics_of(tmp_path / "two")["outliers"] == [said]


def test_rotation_vectors_in_degrees_are_refused(files: Any, polish_sim: Tool, tmp_path: Path) -> None:
    header, *rows = files["tcp"]
    first = header.index("qw")
    q = np.array([[float(v) for v in row[first : first + 4]] for row in rows])
    vectors = Rotation.from_quat(q, scalar_first=True).as_rotvec()
    for scale, code in ((1.0, 0), (180.0 / np.pi, 2)):
        turns = (scale * vectors).astype(str).tolist()
        given = [[*row[:first], *turn] for row, turn in zip(rows, turns, strict=True)]
        write(tmp_path / "turns.csv", [[*header[:first], "rx_rad", "ry_rad", "rz_rad"], *given])
        call = polish_sim("calibrate", "tcp", "--data", "turns.csv", "--out", f"out{code}")
        assert call.code == code
    assert "Are they degrees?" in call.err


def test_an_arm_whose_axes_do_not_quite_meet_is_told(files: Any, polish_sim: Tool, tmp_path: Path) -> None:
    """The second arc of the master, 1 mm to the side of where its axes would meet."""
    found = calibrated(polish_sim, tmp_path, "as_is", files["base"])
    assert found["gap_m"] < 1e-4
    assert found["axes_meet"] is True
    axis = np.cross(*(fit_circle(arc_of(files["base"], k)).axis for k in ("1", "2")))
    axis /= np.linalg.norm(axis)
    moved = [
        [*row[:2], *(str(float(v) + d) for v, d in zip(row[2:5], axis, strict=True)), *row[5:]]
        if row[:2] == ["master", "2"]
        else row
        for row in files["base"]
    ]
    found = calibrated(polish_sim, tmp_path, "moved", moved, code=1)
    assert found["gap_m"] == pytest.approx(1e-3, abs=1e-4)
    assert found["axes_meet"] is False


def arc_of(rows: list[list[str]], axis: str) -> Any:
    return np.array([[float(v) for v in row[2:5]] for row in rows if row[:2] == ["master", axis]])


def calibrated(
    polish_sim: Tool, folder: Path, name: str, rows: list[list[str]], code: int = 0
) -> dict[str, Any]:
    """Figures of a calibration of bases from rows, with --check."""
    write(folder / f"{name}.csv", rows)
    call = polish_sim("calibrate", "base", "--data", f"{name}.csv", "--out", name, "--check")
    assert call.code == code
    assert ("the master miss each other" in call.err) == (code == 1)
    return metrics_of(folder / name)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("tcp", "--poses", "3"), "--poses 3 is outside 4 to 100000"),
        (("tcp", "--cone", "1"), "--cone 1 is outside 3 to 90 deg"),
        (("tcp", "--data", "gone.csv"), "cannot read the flange poses 'gone.csv'"),
        (("tcp", "--data", "gone.csv", "--cell-tool"), "--cell-tool would change nothing with --data"),
        (("tcp", "--arm", "ur10"), "unknown --arm 'ur10'. Did you mean 'ur10e'?"),
        (("tcp", "--data", "folder.csv"), "Is a directory"),
        (("tcp", "--data", "empty.csv"), "holds no"),
        (("tcp", "--data", "binary.csv"), "is not a text file"),
        (("base", "--points", "5"), "--points 5 is outside 6 to 100000"),
        (("arm", "--poses", "19"), "--poses 19 is outside 20 to"),
        (("arm", "--data", "gone.csv"), "cannot read the measurements 'gone.csv'"),
        (("arm", "--data", "gone.csv", "--seed", "1"), "--seed would change nothing with --data"),
        (("budget", "--draws", "29"), "--draws 29 is outside 30 to 100000"),
        (("budget", "--touch-noise", "nan"), "--touch-noise nan is outside 0 to 10 mm"),
        (("budget", "--tracker-noise", "0", "--touch-noise", "0"), "leaves no error to share out"),
    ],
)
def test_options_that_cannot_be_are_one_message(
    words: tuple[str, ...], said: str, polish_sim: Tool, tmp_path: Path
) -> None:
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "empty.csv").touch()
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)))
    code, out, err = polish_sim("calibrate", *words)
    assert (code, out) == (2, "")
    assert said in err.replace("\n", " ")
    assert not (tmp_path / "results").exists()
