"""The log's columns, types and file."""

import os
import zipfile

import numpy as np
import pytest

from polish_sim.errors import InputError
from polish_sim.log import COLUMNS, LOG_ROW, RunLog, from_rows, read_log, write_log

CONTRACT = {
    "time_s": 0, "q_rad": 6, "qd_rad_s": 6, "torque_nm": 6, "tcp_position_m": 3, "tcp_quaternion_wxyz": 4,
    "target_position_m": 3, "target_quaternion_wxyz": 4, "tcp_speed_m_s": 0, "command_twist": 6,
    "wrench_measured_tool": 6, "wrench_raw_sensor": 6, "wrench_true_tool": 6, "normal_force_n": 0,
    "normal_force_min_n": 0, "normal_force_max_n": 0, "pad_travel_m": 0, "path_s_m": 0, "pass_index": 0,
    "phase": 0, "host_depth_m": 0,
}  # fmt: skip


@pytest.fixture
def rows():
    """Three rows whose every number says where it stands."""
    numbers = np.arange(3.0)[:, None] * 1000.0 + np.arange(LOG_ROW.itemsize // 8)
    return (numbers % 100).view(LOG_ROW).ravel()  # small enough for int8


def test_every_number_of_a_row_lands_in_its_column_reads_back_the_same_and_cannot_be_changed(rows, tmp_path):
    assert dict(COLUMNS) == CONTRACT
    log = from_rows(rows)
    assert log.names == tuple(CONTRACT)
    double = {"time_s", "tcp_position_m", "target_position_m"}
    integer = {"pass_index": np.int32, "phase": np.int8}
    for name in CONTRACT:
        np.testing.assert_array_equal(log[name], rows[name])
        assert log.columns[name].dtype == integer.get(name, np.float64 if name in double else np.float32), (
            name
        )
    log, path = from_rows(rows), tmp_path / "log.npz"
    write_log(path, log)
    again = read_log(path)
    for name in log.names:
        assert again.columns[name].dtype == log.columns[name].dtype
        np.testing.assert_array_equal(again[name], log[name])
    assert [p.name for p in tmp_path.iterdir()] == ["log.npz"]
    with zipfile.ZipFile(path) as archive:
        assert all(entry.compress_type == zipfile.ZIP_DEFLATED for entry in archive.infolist())
    for held in (log, again):
        with pytest.raises(ValueError, match="read-only"):
            held["time_s"][0] = 1.0


def test_a_damaged_log_or_a_file_of_other_arrays_is_refused_by_name_and_objects_are_not_run(rows, tmp_path):
    path = tmp_path / "log.npz"
    write_log(path, from_rows(rows))
    whole, rng, messages = path.read_bytes(), np.random.default_rng(0), []
    for _ in range(400):
        at = int(rng.integers(len(whole)))
        path.write_bytes(whole[:at] + rng.bytes(2) + whole[at + 2 :])
        try:
            read_log(path)
        except InputError as error:
            messages.append(str(error))
    assert len(messages) > 200
    assert all("log.npz" in message for message in messages)
    path.unlink()
    with pytest.raises(InputError, match=r"log\.npz"):
        read_log(tmp_path / "log.npz")
    columns = dict(from_rows(rows).columns)
    del columns["phase"], columns["q_rad"]
    write_log(tmp_path / "log.npz", RunLog(columns))
    with pytest.raises(InputError, match="q_rad, phase"):
        read_log(tmp_path / "log.npz")
    (tmp_path / "log.npz").write_text("time_s")
    with pytest.raises(InputError, match=r"log\.npz': File is not a zip file"):
        read_log(tmp_path / "log.npz")
    np.savez(tmp_path / "log.npz", time_s=np.array([MakesFolder(tmp_path / "made")], dtype=object))
    with pytest.raises(InputError, match=r"log\.npz"):
        read_log(tmp_path / "log.npz")
    assert not (tmp_path / "made").exists()


class MakesFolder:
    """What makes a folder when it is read."""

    def __init__(self, folder):
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (str(self.folder),)
