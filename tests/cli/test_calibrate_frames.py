"""`calibrate tcp` and `calibrate base` as a user calls them; what calibrations of two robots refuse."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.dual.calibration.bases import read_base_calibration
from polish_sim.dual.calibration.circle import fit_circle
from polish_sim.dual.calibration.tool import read_tool_calibration
from polish_sim.errors import InputError
from tests.cli.conftest import assert_refused, done, metrics_of, ran, refused

Rows = list[list[str]]
PAIR = 'cell "7" \\ left'
FILES = {"calibration.toml", "residuals.csv", "metrics.json"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders of calibrations, one of a tool and one of the bases."""
    folder = tmp_path_factory.mktemp("made")
    for name, pair in (("tcp", ()), ("base", ("--pair", PAIR))):
        ran("calibrate", name, *pair, "--seed", 2, "--check", "--out", folder / name)
    return folder


@pytest.fixture(scope="module")
def files(made: Path) -> dict[str, Rows]:
    """Good files of measurements, to be spoilt."""
    texts = {folder.name: (folder / "residuals.csv").read_text(encoding="utf-8") for folder in made.iterdir()}
    return {name: [line.split(",") for line in text.splitlines()] for name, text in texts.items()}


def write(file: Path, rows: Rows) -> None:
    file.write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")


def test_a_tool_frame_and_bases_leave_their_files_which_are_taken_for_nothing_else(made, polish_sim):
    one = made / "tcp"
    assert {path.name for path in one.iterdir()} == {*FILES, "tool.png"}
    figures = metrics_of(one)
    assert {"position_error_m", "position_crb_m", "residual_rms_m"} <= figures.keys()
    found = read_tool_calibration(one / "calibration.toml")
    np.testing.assert_allclose(found[:3, 3], figures["position_m"])
    written = tomllib.loads((one / "calibration.toml").read_text(encoding="utf-8"))
    assert written["position_covariance"][0][0] == pytest.approx(figures["position_m_std"][0] ** 2)
    done(polish_sim("calibrate", "tcp", "--data", one / "residuals.csv", "--out", "tool"))
    again = metrics_of("tool")
    np.testing.assert_allclose(again["position_m"], figures["position_m"], atol=1e-10)
    np.testing.assert_allclose(again["quaternion_wxyz"], figures["quaternion_wxyz"], atol=1e-9)
    one = made / "base"
    assert {path.name for path in one.iterdir()} == {*FILES, "bases.png"}
    figures = metrics_of(one)
    assert {"origin_error_m", "axis_error_rad"} <= figures.keys()
    assert (figures["gap_m"] < 1e-4, figures["axes_meet"]) == (True, True)
    found = read_base_calibration(one / "calibration.toml", PAIR)
    np.testing.assert_allclose(found.T_master_follower, figures["transform"], atol=1e-15)
    done(polish_sim("calibrate", "base", "--data", one / "residuals.csv", "--out", "bases"))
    np.testing.assert_allclose(metrics_of("bases")["transform"], figures["transform"], atol=1e-6)
    with pytest.raises(InputError, match="not the calibration of two bases"):
        read_base_calibration(made / "tcp" / "calibration.toml", PAIR)
    with pytest.raises(InputError, match="not the calibration of a tool frame"):
        read_tool_calibration(made / "base" / "calibration.toml")
    tool = made / "tcp" / "calibration.toml"
    refused(polish_sim("run", "force", "--calibration", tool, "--out", "run"), "calibrate payload")


def changed(rows: Rows, line: int, columns: str, scale: float, shift: float = 0.0) -> Rows:
    """Numbers of one line in other units, or moved."""
    rows = [list(row) for row in rows]
    for k in map(rows[0].index, columns.split()):
        rows[line][k] = str(scale * float(rows[line][k]) + shift)
    return rows


def renamed(rows: Rows, **names: str) -> Rows:
    return [[names.get(name, name) for name in rows[0]], *rows[1:]]


def without(rows: Rows, *cells: str) -> Rows:
    return [row for row in rows if not set(cells) & set(row[:2])]


def shifted(rows: Rows) -> Rows:
    """Positions of the next line; the last two lines keep the order of the kinds."""
    moved = rows[3:] + rows[1:3]
    return [rows[0], *([*row[:5], *other[5:9], *row[9:]] for row, other in zip(moved, rows[1:], strict=True))]


def exchanged(rows: Rows) -> Rows:
    """The arcs of axis 2 each taken for the other robot's."""
    other = {"master": "follower", "follower": "master"}
    return [[other[row[0]], *row[1:]] if row[1] == "2" else row for row in rows]


METRES = {"x_mm": "x_m", "y_mm": "y_m", "z_mm": "z_m"}
BAD: list[tuple[str, Callable[[Rows], Rows], str]] = [
    ("tcp", lambda r: renamed(r, x_mm="y_mm", y_mm="x_mm"), "columns are swapped"),
    ("tcp", lambda r: renamed(r, qx="qy", qy="qx"), "as qw, qy, qx, qz: columns are swapped"),
    ("tcp", lambda r: renamed(r, x_mm="x_m"), "mixes units"),
    ("tcp", lambda r: renamed(r, z_mm="height"), "lacks the column z_mm"),
    ("tcp", lambda r: renamed(r, **METRES), "Are these numbers in m, as the header"),
    ("tcp", lambda r: changed(r, 4, "x_mm y_mm z_mm", 1e-3), "line 5"),
    ("tcp", lambda r: changed(r, 2, "qw", 1.0, 0.5), "are not a unit quaternion"),
    ("tcp", lambda r: without(r, "in_xz"), "0 lines of the kind 'in_xz'"),
    ("tcp", lambda r: [[cell.replace("touch", "poke") for cell in row] for row in r], "unknown kind 'poke'"),
    ("tcp", shifted, "no tip fits"),
    ("tcp", lambda r: [[";".join(row)] for row in r], "the columns are separated by semicolons"),
    ("base", lambda r: renamed(r, **METRES), "Wrong unit, or joints not at zero?"),
    ("base", exchanged, "the master: axes 1 and 2 miss"),
    ("base", lambda r: without(r, "follower"), "no measurement of the follower"),
    ("base", lambda r: without(r, "2"), "no arc of axis 2 of the master"),
]


@pytest.mark.parametrize(("name", "spoil", "said"), BAD)
def test_bad_files_are_one_message_and_nothing_is_written(name, spoil, said, files, polish_sim):
    write(Path("bad.csv"), spoil(files[name]))
    assert_refused(polish_sim("calibrate", name, "--data", "bad.csv"), said, "bad.csv")


def test_rotation_vectors_in_degrees_are_refused(files, polish_sim):
    header, *rows = files["tcp"]
    first = header.index("qw")
    q = np.array([row[first : first + 4] for row in rows], dtype=float)
    vectors = Rotation.from_quat(q, scalar_first=True).as_rotvec()
    for scale, code in ((1.0, 0), (180.0 / np.pi, 2)):
        turns = (scale * vectors).astype(str).tolist()
        given = [[*row[:first], *turn] for row, turn in zip(rows, turns, strict=True)]
        write(Path("turns.csv"), [[*header[:first], "rx_rad", "ry_rad", "rz_rad"], *given])
        call = polish_sim("calibrate", "tcp", "--data", "turns.csv", "--out", f"out{code}")
        assert call.code == code
    assert "Are they degrees?" in call.err


def test_an_arm_whose_axes_do_not_quite_meet_is_told(files, polish_sim):
    """The second arc of the master, 1 mm to the side of where its axes would meet."""
    rows, arcs = files["base"], [["master", "1"], ["master", "2"]]
    points = [np.array([row[2:5] for row in rows if row[:2] == arc], dtype=float) for arc in arcs]
    aside = np.cross(*(fit_circle(arc).axis for arc in points))
    moved = (points[1] + aside / np.linalg.norm(aside)).astype(str).tolist()
    rows = [[*row[:2], *moved.pop(0), *row[5:]] if row[:2] == arcs[1] else row for row in rows]
    write(Path("moved.csv"), rows)
    call = polish_sim("calibrate", "base", "--data", "moved.csv", "--out", "moved", "--check")
    assert call.code == 1
    assert "the master miss each other" in call.err
    assert metrics_of("moved")["gap_m"] == pytest.approx(1e-3, abs=1e-4)
    assert metrics_of("moved")["axes_meet"] is False


def test_a_measurement_off_by_two_millimetres_is_named(files, polish_sim):
    for name, line, said in (("tcp", 6, 6), ("base", 4, "master, axis 1: 4")):
        write(Path("off.csv"), changed(files[name], line, "y_mm", 1.0, 2.0))
        err = done(polish_sim("calibrate", name, "--data", "off.csv", "--out", name)).err
        assert f"{said} does not fit" in err
        assert metrics_of(name)["outliers"] == [said]
