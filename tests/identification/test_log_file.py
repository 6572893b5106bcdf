"""Logs that would spoil an identification are refused, each by name and place."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from polish_sim.errors import InputError
from polish_sim.exchange.robot_log import columns_of, read_column_map, read_robot_recording
from polish_sim.identification import log_file
from polish_sim.identification.log_file import use_states
from polish_sim.motion.serial_chain import HINGE, SLIDE
from tests.identification.known import known_robot

NAMES = ["time_s", *(f"q{j}_rad" for j in range(1, 7)), *(f"torque{j}_nm" for j in range(1, 7))]
KNOWN = known_robot(1000)
TABLE = np.column_stack([np.arange(1000) / 100.0, KNOWN.states.q, KNOWN.torque])


def _write(folder: Path, table: np.ndarray, names: list[str] = NAMES) -> Path:
    file = folder / "log.csv"
    np.savetxt(file, table, delimiter=",", header=",".join(names), comments="")
    return file


def _read(file: Path, kinds: Sequence[int] = (HINGE,) * 6, period: float | None = None) -> log_file.RobotLog:
    """The log as `polish-sim identify` takes it."""
    gaps = {} if period is None else {"of_gap": None}
    return log_file.log_of(file, read_robot_recording(file, ("q_rad",), columns_of(kinds), **gaps), period)


#: What any reader of a log refuses is in tests/exchange/test_robot_log.py
SPOILT = {
    "ten a second": (np.s_[:, 0], TABLE[:, 0] * 10.0, r"samples are 0.1 s apart.* 50 samples a second"),
    "saturated": (np.s_[:, 8], np.clip(TABLE[:, 8], -20.0, 20.0), r"torque of joint 2 stands at 20 in \d+%"),
    "dead": (np.s_[:, 9], 0.0, r"torque of joint 3 is 0 in every sample"),
}


@pytest.mark.parametrize("how", SPOILT)
def test_a_spoilt_log_is_refused(how, tmp_path):
    where, values, said = SPOILT[how]
    table = TABLE.copy()
    table[where] = values
    with pytest.raises(InputError, match=said):
        _read(_write(tmp_path, table))


def test_a_period_that_does_not_fit_the_log_is_refused_and_the_shortest_has_a_series(tmp_path):
    file = _write(tmp_path, TABLE)
    for period, said in ((0.01, "too few in a period"), (0.4, "0.41 or more"), (1e5, "less than one")):
        with pytest.raises(InputError, match=f"--period {period:g}: .*{said}"):
            _read(file, period=period)
    assert np.isfinite(log_file.periodic_states(_read(file, period=0.42), 0.42).qdd).all()


def test_logs_of_slides_of_coarse_steps_and_of_quantities_without_joints_are_read(tmp_path):
    table = TABLE.copy()
    table[:, 7:] = np.round(table[:, 7:] / 2.0) * 2.0
    assert np.mean(table[:, 8] == table[:, 8].max()) > 0.01
    log = _read(_write(tmp_path, table))
    np.testing.assert_allclose(log.torque, table[:, 7:])
    np.testing.assert_allclose(log.q, KNOWN.states.q)
    names = ["time_s", "q1_rad", "q2_m", "torque1_nm", "force2_n"]
    file = _write(tmp_path, TABLE[:, [0, 1, 2, 7, 8]] * [1.0, 1.0, 9.0, 1.0, 1.0], names)
    assert np.abs(_read(file, (HINGE, SLIDE)).q[:, 1]).max() > 7.0
    with pytest.raises(InputError, match="no column q2_rad for q_rad"):
        _read(file, (HINGE, HINGE))
    file = tmp_path / "log.npz"
    np.savez(file, time_s=TABLE[:, 0], q_rad=np.degrees(TABLE[:, 1:3]), torque_nm=TABLE[:, 7:9])
    (tmp_path / "map.toml").write_text("[units]\nq_rad = 'deg'\n")
    degrees = read_column_map(tmp_path / "map.toml", 2)._replace(wanted=columns_of((HINGE, HINGE)).wanted)
    read = log_file.log_of(file, read_robot_recording(file, ("q_rad",), degrees))
    np.testing.assert_allclose(read.q, TABLE[:, 1:3])
    np.testing.assert_array_equal(read.torque, TABLE[:, 7:9])
    with pytest.raises(InputError, match=r"q2_m for q_rad\..*--map"):
        _read(file, (HINGE, SLIDE))


def test_missing_columns_short_logs_other_joints_and_angles_that_are_all_missing_are_refused(tmp_path):
    with pytest.raises(InputError, match="no column torque5_nm, torque6_nm"):
        _read(_write(tmp_path, TABLE[:, :-2], NAMES[:-2]))
    with pytest.raises(InputError, match="holds 100 samples"):
        _read(_write(tmp_path, TABLE[:100]))
    file = _write(tmp_path, TABLE)
    joints = [*"abcdef", "pad"]
    with pytest.raises(InputError, match=r"of pad\. .* --joints a,b,c,d,e,f"):
        log_file.check_joints(file, "", (HINGE,) * 6 + (SLIDE,), joints)
    with pytest.raises(InputError, match="no column q7_m"):
        _read(file, (HINGE,) * 6 + (SLIDE,))
    table = TABLE.copy()
    table[:, 1:7] = np.nan
    with pytest.raises(InputError, match="q_rad, column 1, is nan"):
        use_states(_write(tmp_path, table))


def test_accelerations_are_those_of_the_motion_by_splines_and_by_periods_and_hardly_spoilt_by_gaps(tmp_path):
    table = np.delete(TABLE, slice(300, 380), axis=0)
    log = _read(_write(tmp_path, table), period=10.0)
    states = log_file.periodic_states(log, 10.0)
    assert np.abs(states.qdd - KNOWN.motion(log.time).qdd).max() < 1e-6
    lost = np.s_[500:509]  # 0.1 s of a log of 100 Hz
    log = _read(_write(tmp_path, np.delete(TABLE, lost, axis=0)))
    assert np.diff(log.time).max() == pytest.approx(0.1)
    off = [
        log_file.spline_states(one).qdd - KNOWN.motion(one.time).qdd
        for one in (log, _read(_write(tmp_path, TABLE)))
    ]
    near, usual = (np.abs(one[450:550]).max() for one in off)
    assert near < 2.0 * usual
    states = log_file.spline_states(log_file.RobotLog(TABLE[:, 0], KNOWN.states.q, KNOWN.torque), knots=0.1)
    assert np.abs(states.qdd - KNOWN.states.qdd)[20:-20].max() < 0.02
