"""Calibrations of two robots as a user calls them: tool, bases, arms, error budget, and what they refuse."""

import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.cli.boundary import execute
from polish_sim.cli.main import commands
from polish_sim.dual import budget
from polish_sim.dual.calibration.arm import read_arm_calibration, read_tracked
from polish_sim.dual.calibration.bases import read_base_calibration
from polish_sim.dual.calibration.circle import fit_circle
from polish_sim.dual.calibration.tool import read_tool_calibration
from polish_sim.errors import InputError
from tests.cli.conftest import assert_refused, done, metrics_of, ran, refused

PAIR = 'cell "7" \\ left'
FILES = {"calibration.toml", "residuals.csv", "metrics.json"}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folders of calibrations, one of a tool and one of the bases."""
    folder = tmp_path_factory.mktemp("made")
    for name, pair in (("tcp", ()), ("base", ("--pair", PAIR))):
        ran("calibrate", name, *pair, "--seed", 2, "--check", "--out", folder / name)
    return folder


@pytest.fixture(scope="module")
def files(made):
    """Good files of measurements, to be spoilt."""
    texts = {folder.name: (folder / "residuals.csv").read_text(encoding="utf-8") for folder in made.iterdir()}
    return {name: [line.split(",") for line in text.splitlines()] for name, text in texts.items()}


def write(file, rows):
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
    with pytest.raises(InputError, match=r"not the calibration that is wanted.*made by 'calibrate base'"):
        read_base_calibration(made / "tcp" / "calibration.toml", PAIR)
    with pytest.raises(InputError, match=r"not the calibration that is wanted.*made by 'calibrate tcp'"):
        read_tool_calibration(made / "base" / "calibration.toml")
    tool = made / "tcp" / "calibration.toml"
    refused(polish_sim("run", "force", "--calibration", tool, "--out", "run"), "calibrate payload")


def changed(rows, line, columns, scale, shift=0.0):
    """Numbers of one line in other units, or moved."""
    rows = [list(row) for row in rows]
    for k in map(rows[0].index, columns.split()):
        rows[line][k] = str(scale * float(rows[line][k]) + shift)
    return rows


def renamed(rows, **names):
    return [[names.get(name, name) for name in rows[0]], *rows[1:]]


def without(rows, *cells):
    return [row for row in rows if not set(cells) & set(row[:2])]


def shifted(rows):
    """Positions of the next line; the last two lines keep the order of the kinds."""
    moved = rows[3:] + rows[1:3]
    return [rows[0], *([*row[:5], *other[5:9], *row[9:]] for row, other in zip(moved, rows[1:], strict=True))]


def exchanged(rows):
    """The arcs of axis 2 each taken for the other robot's."""
    other = {"master": "follower", "follower": "master"}
    return [[other[row[0]], *row[1:]] if row[1] == "2" else row for row in rows]


METRES = {"x_mm": "x_m", "y_mm": "y_m", "z_mm": "z_m"}
BAD = [
    ("tcp", lambda r: renamed(r, x_mm="y_mm", y_mm="x_mm"), "0 mm rms. Wanted"),
    ("tcp", lambda r: renamed(r, qx="qy", qy="qx"), "columns swapped"),
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
    refused(call, "the master miss each other", code=1)
    assert metrics_of("moved")["gap_m"] == pytest.approx(1e-3, abs=1e-4)
    assert metrics_of("moved")["axes_meet"] is False


def test_a_measurement_off_by_two_millimetres_is_named(files, polish_sim):
    for name, line, said in (("tcp", 6, 6), ("base", 4, "master, axis 1: 4")):
        write(Path("off.csv"), changed(files[name], line, "y_mm", 1.0, 2.0))
        err = done(polish_sim("calibrate", name, "--data", "off.csv", "--out", name)).err
        assert f"{said} does not fit" in err
        assert metrics_of(name)["outliers"] == [said]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The folder of one calibration of two arms, made once."""
    folder = tmp_path_factory.mktemp("arms") / "found"
    words = ["calibrate", "arm", "--seed", "2", "--pair", "cell 7", "--check", "--out", str(folder)]
    assert execute(commands, words) == 0  # with its picture
    return folder


def test_arms_are_found_again_from_their_residuals(found, polish_sim):
    figures = metrics_of(found)
    assert figures["relative_error_m"] <= 1.5e-4 < 5e-4 < figures["relative_error_nominal_m"]
    assert (found / "arms.png").stat().st_size > 10_000
    words = ("--data", found / "residuals.csv", "--pair", "cell 7", "--out", "again")
    done(polish_sim("calibrate", "arm", *words), "master: off its table by up to")
    files = (folder / "calibration.toml" for folder in (found, Path("again")))
    first, again = (read_arm_calibration(file, "cell 7") for file in files)
    np.testing.assert_allclose(again.T_master_follower, first.T_master_follower, atol=1e-4)
    for robot in ("master", "follower"):
        np.testing.assert_allclose(again.tables[robot], first.tables[robot], atol=1e-4)
    assert first.true_tables is not None
    assert again.true_tables is None


def test_a_run_takes_the_arms_as_they_were_found(found, polish_sim, tmp_path, monkeypatch):
    run = ("run", "dual", "--calibration", found / "calibration.toml")
    refused(polish_sim(*run, "--dry-run"), "another pair of robots: 'cell 7'")
    own, short = ("--set", "dual.pair=cell 7"), ("--set", "process.max_feed_s=0.3", "--standoff", "5")
    done(polish_sim(*run, *own, *short, "--out", "run"))
    monkeypatch.chdir(tmp_path / "run")
    assert "all within reach" in done(polish_sim("run", "dual", "--config", "config.toml", "--dry-run")).out
    wrong = tmp_path / "wrong.toml"
    wrong.write_text((found / "calibration.toml").read_text().replace("-0.42", "-0.62"))
    refused(polish_sim("run", "dual", "--calibration", wrong, *own, "--dry-run"), "another robot's")


@pytest.fixture
def tracked(found):
    """Lines of a file of poses: the header, then 20 of each arm."""
    lines = (found / "residuals.csv").read_text().splitlines()
    return [lines[0], *lines[1:21], *lines[61:81]]


def scaled(lines, angle, length):
    """The same joint angles and positions in other units."""
    scales = np.repeat([angle, length], [6, 3])
    rows = ((row[0], *(scales * np.array(row[1:10], float))) for row in (line.split(",") for line in lines))
    return [",".join(map(str, row)) for row in rows]


def test_degrees_and_metres_are_read_as_what_they_are(tmp_path, tracked):
    head = "robot," + ",".join(f"q{k}_deg" for k in range(1, 7)) + ",x_m,y_m,z_m"
    (tmp_path / "si.csv").write_text("\n".join([head, *scaled(tracked[1:], np.degrees(1.0), 1e-3)]))
    (tmp_path / "usual.csv").write_text("\n".join(tracked))
    usual, other = read_tracked(tmp_path / "usual.csv"), read_tracked(tmp_path / "si.csv")
    for robot in usual:
        np.testing.assert_allclose(other[robot].q, usual[robot].q, atol=1e-12)
        np.testing.assert_allclose(other[robot].seen, usual[robot].seen, atol=1e-12)


def test_what_cannot_be_arms_is_refused(polish_sim, tracked):
    degrees, far = scaled(tracked[1:], 57.3, 1.0), scaled(tracked[1:], 1.0, 1e-3)
    head = ",".join(tracked[0].split(",")[:10])
    for lines, said in (
        (tracked[:-1], "19 poses cannot determine an arm's table"),
        ([line for line in tracked if not line.startswith("follower")], "no measurement of the follower"),
        ([tracked[0].replace("q3_rad", "q3"), *tracked[1:]], "lacks the column q3_rad"),
        ([head, *degrees], "Are they in degrees?"),
        ([head, *far], "units"),
        ([tracked[0].replace("x_mm", "x_m"), *tracked[1:]], "mixes units"),
        ([tracked[0].replace("x_mm,y_mm", "y_mm,x_mm"), *tracked[1:]], "no arm near the maker's table fits"),
        ([tracked[0].replace("q2_rad,q3_rad", "q3_rad,q2_rad"), *tracked[1:]], "no arm near"),
    ):
        Path("poses.csv").write_text("\n".join(lines))
        assert_refused(polish_sim("calibrate", "arm", "--data", "poses.csv"), said, "poses.csv")


_predict = cache(budget.predict)


@pytest.fixture
def numbers(monkeypatch):
    """Numbers of the draws that were made, at first order: a calibration each would take most of the time, as
    would ten designs of them for the prediction. Real draws are compared in tests/dual."""
    made = []

    def drawn(trial, number):
        made.append(number)
        rng, found = np.random.default_rng(number), _predict(trial)
        unknowns = {name: rng.multivariate_normal(np.zeros(15), C) for name, C in found.shares.items()}
        unknowns[budget.TOGETHER] = np.sum(list(unknowns.values()), axis=0)
        return {name: found.slopes @ x for name, x in unknowns.items()}

    monkeypatch.setattr(budget, "DESIGNS", 1)
    monkeypatch.setattr(budget, "draw_errors", drawn)
    monkeypatch.setattr(budget, "predict", _predict)
    return made


def test_a_budget_draws_only_what_is_missing_and_with_worse_instruments_falls_short(polish_sim, numbers):
    words = ("calibrate", "budget", "--on", "here", "--check", "--out", "one")
    done(polish_sim(*words, "--draws", "30"), "30 draws")
    files = {"metrics.json", "budget.png", "rows.jsonl", "asked.json"}
    assert {path.name for path in Path("one").iterdir()} == files
    figures = metrics_of("one")
    sources = figures["sources"]
    assert set(sources) == {"bases", "tool", "part", "closing", "together"}
    alone = [sources[name]["predicted_rms_m"] for name in ("bases", "tool", "part", "closing")]
    assert sources["together"]["predicted_rms_m"] == pytest.approx(np.linalg.norm(alone))
    assert figures["relative_error_rms_m"] == sources["together"]["drawn_rms_m"]
    assert figures["settings"]["tracker_noise_m"] == 3e-5
    assert polish_sim(*words, "--draws", "30").code == 0
    assert metrics_of("one") == figures
    assert polish_sim(*words, "--draws", "32").code == 0
    assert numbers == list(range(32))
    assert "another calibrate-budget" in polish_sim(*words, "--draws", "32", "--seed", "1").err
    words = "calibrate budget --draws 30 --tracker-noise 0 --touch-noise 0.2 --marks 4 --closing 0"
    assert polish_sim(*words.split(), "--on", "here", "--check", "--out", "bad").code == 1
    figures = metrics_of("bad")
    assert figures["settings"]["marks"] == 4
    assert figures["settings"]["closing_touches"] == 0
    assert figures["sources"]["tool"]["predicted_rms_m"] == pytest.approx(2e-4 * np.sqrt(0.4), rel=1e-6)
    assert figures["sources"]["bases"]["predicted_rms_m"] == 0.0


@pytest.mark.parametrize(("after", "enough"), [(30, True), (3, False), (0, False)])
def test_interrupted_draws_are_kept_and_summed_up_if_enough(after, enough, polish_sim, monkeypatch, numbers):
    draw = budget.draw_errors

    def interrupted(trial, number):
        if number == after:
            raise KeyboardInterrupt
        return draw(trial, number)

    monkeypatch.setattr(budget, "draw_errors", interrupted)
    refused(polish_sim("calibrate", "budget", "--on", "here", "--out", "cut"), "interrupted", code=130)
    assert [path.name for path in Path().iterdir()] == ["cut"] * (after > 0)
    if after:
        assert Path("cut/rows.jsonl").read_bytes().count(b"\n") == after
    if enough:
        assert metrics_of("cut")["draws"] == after
