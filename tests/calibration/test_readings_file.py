"""A real robot's poses and readings as CSV: three ways to write an orientation, one clear line for what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.calibration import fit_payload, fit_without_outliers, read_readings, residual_table
from polish_sim.calibration.payload_file import TIME, WRENCH
from polish_sim.calibration.tables import MATRIX, QUATERNION, ROTATION_VECTOR
from polish_sim.errors import InputError
from tests.calibration.test_payload import NOISE, POSES, THETA, Array, readings_in

TURNS = Rotation.from_matrix(POSES)
FORMS = {
    QUATERNION: TURNS.as_quat(scalar_first=True),
    ROTATION_VECTOR: TURNS.as_rotvec(),
    MATRIX: POSES.reshape(-1, 9),
}


def written(folder: Path, names: tuple[str, ...], values: Array) -> Path:
    file = folder / "readings.csv"
    rows = [",".join(names), *(",".join(f"{value:.12g}" for value in row) for row in values)]
    file.write_text("# of our robot\n\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return file


@pytest.mark.parametrize("form", FORMS)
def test_every_way_to_write_an_orientation_gives_the_same_tool(tmp_path: Path, form: tuple[str, ...]) -> None:
    first = readings_in(POSES)
    file = written(tmp_path, (*WRENCH, *form, TIME), np.column_stack([first.wrenches, FORMS[form], first.time]))
    np.testing.assert_allclose(fit_payload(read_readings(file)).theta, THETA, atol=1e-8)


def test_what_we_write_we_read(tmp_path: Path) -> None:
    first = readings_in(POSES, errors=NOISE * np.random.default_rng(0).standard_normal((12, 6)))
    found = fit_without_outliers(first)
    file = tmp_path / "residuals.csv"
    file.write_text(residual_table(first, found, np.zeros((12, 6))), encoding="utf-8")
    again = fit_without_outliers(read_readings(file))
    np.testing.assert_allclose(again.theta, found.theta, atol=1e-7)
    np.testing.assert_allclose(again.residuals, found.residuals, atol=1e-6)


def test_columns_of_no_interest_and_capitals_do_no_harm(tmp_path: Path) -> None:
    first = readings_in(POSES)
    names = ("Temperature", *(name.upper() for name in (*QUATERNION, *WRENCH)))
    file = written(tmp_path, names, np.column_stack([np.full(12, 21.0), FORMS[QUATERNION], first.wrenches]))
    np.testing.assert_allclose(read_readings(file).wrenches, first.wrenches, atol=1e-9)


HEADER = ",".join((*QUATERNION, *WRENCH))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "holds no readings"),
        (HEADER + "\n", "holds no readings"),
        ("qw,qx,qy,qz,fx_n,fy_n,fz_n,tx_nm,ty_nm\n1,0,0,0,1,2,3,4,5\n", "lacks the column tz_nm"),
        ("fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm\n1,2,3,4,5,6\n", "says nowhere how the sensor stood.*rx_rad"),
        (HEADER + "\n1,0,0,0,1,2,3,4,5,6\n1,0,0,0,1,2,nan,4,5,6\n", "line 3: fz_n is 'nan'"),
        (HEADER + "\n1,0,0,0,1,2,,4,5,6\n", "line 2: fz_n is ''"),
        (HEADER + "\n\n1,0,0,0,1,2,3 N,4,5,6\n", "line 3: fz_n is '3 N'"),
        (HEADER + "\n1,0,0,0,1,2,3,4,5\n", "line 2: 9 values, the header names 10"),
        (HEADER + "\n1,0,0,0,1,2,3,4,5,6\n0.9,0.1,0,0,1,2,3,4,5,6\n", "line 3: qw to qz are not a unit quaternion"),
        (HEADER + "\n0,0,0,0,1,2,3,4,5,6\n", "line 2: qw to qz are not a unit quaternion"),
        (",".join((*MATRIX, *WRENCH)) + "\n1,0,0,0,1,0,0,0,1.1,1,2,3,4,5,6\n", "line 2: r11 to r33.*orthonormal"),
        (",".join((*MATRIX, *WRENCH)) + "\n1,0,0,0,1,0,0,0,-1,1,2,3,4,5,6\n", "line 2: r11 to r33.*right-handed"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "readings.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        read_readings(file)


def test_a_picture_is_no_csv(tmp_path: Path) -> None:
    file = tmp_path / "readings.csv"
    file.write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file"):
        read_readings(file)
