"""A robot's log as recorders write it reads the same from every format; a bad one is refused by its place."""

import tracemalloc
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from polish_sim.errors import InputError
from polish_sim.exchange.robot_log import read_column_map, read_robot_recording

Log = Mapping[str, NDArray[np.float64]]
CSV_NAMES = {
    "time_s": "timestamp", "q_rad": "actual_q_{i}", "qd_rad_s": "actual_qd_{i}",
    "current_a": "actual_current_{i}", "current_desired_a": "target_current_{i}",
    "torque_desired_nm": "target_moment_{i}", "wrench": "actual_TCP_force_{i}", "force_n": "force_n",
}  # fmt: skip
JOINTS = "elbow", "shoulder_lift", "shoulder_pan", "wrist_1", "wrist_2", "wrist_3"


def synthetic_log(seconds: float, rate: float = 500.0) -> dict[str, NDArray[np.float64]]:
    """Six joints on sines, its clock not at zero."""
    t = np.arange(round(seconds * rate)) / rate
    w = 2.0 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    q, qd = 0.8 * np.sin(t[:, None] * w) - 0.5, 0.8 * w * np.cos(t[:, None] * w)
    torque = 12.0 * qd + 3.0 * np.sign(qd)
    return {
        "time_s": 1234.5 + t, "q_rad": q, "qd_rad_s": qd, "current_a": torque / 10.0, "torque_nm": torque,
        "current_desired_a": torque / 11.0, "torque_desired_nm": 0.9 * torque, "wrench": 5.0 * q,
        "force_n": 20.0 + 5.0 * q[:, :1],
    }  # fmt: skip


def write_csv(file: Path, log: Log, separator: str = ",", names: Mapping[str, str] = CSV_NAMES) -> Path:
    """Columns as a recorder names them; {i} counts joints from 0, {j} from 1."""
    header, parts = list[str](), list[NDArray[np.float64]]()
    for name, pattern in names.items():
        values = log[name].reshape(len(log[name]), -1)
        parts.append(values)
        header += [pattern.replace("{i}", str(k)).replace("{j}", str(k + 1)) for k in range(values.shape[1])]
    head = separator.join(f'"{name}"' if " " in name and separator == " " else name for name in header)
    np.savetxt(file, np.hstack(parts), delimiter=separator, header=head, comments="", fmt="%.17g")
    return file


def write_npz(file: Path, log: Log) -> Path:
    np.savez(file, **log)  # type: ignore[arg-type]
    return file


def write_bag(folder: Path, log: Log, kind: str) -> Path:
    """A ROS 2 bag of joint states, in the driver's order of joints, and wrenches."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, wrench = store.types["sensor_msgs/msg/JointState"], store.types["geometry_msgs/msg/WrenchStamped"]
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    vector, pair = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Wrench"]
    order, plugin = [2, 1, 0, 3, 4, 5], StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        states = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        wrenches = writer.add_connection("/wrench", wrench.__msgtype__, typestore=store)
        for k, t in enumerate(log["time_s"]):
            stamp = round(1e9 * float(t))
            head = header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="")
            force = pair(force=vector(*log["wrench"][k, :3]), torque=vector(*log["wrench"][k, 3:]))
            felt = store.serialize_cdr(wrench(header=head, wrench=force), wrench.__msgtype__)
            writer.write(wrenches, stamp, felt)
            parts = {field: log[name][k, order] for field, name in
                     (("position", "q_rad"), ("velocity", "qd_rad_s"), ("effort", "torque_nm"))}  # fmt: skip
            message = state(header=head, name=[f"{joint}_joint" for joint in JOINTS], **parts)
            writer.write(states, stamp, store.serialize_cdr(message, state.__msgtype__))
    return folder


LOG = synthetic_log(4.0)


def check(read, *names, tolerance=1e-9):
    np.testing.assert_allclose(read.time, LOG["time_s"] - LOG["time_s"][0], atol=1e-6)
    for name in names:
        np.testing.assert_allclose(read.values[name], LOG[name], atol=tolerance)


def refuse(what, *asked, **how):
    with pytest.raises(InputError, match=what):
        read_robot_recording(*asked, **how)


@pytest.mark.parametrize("separator", [",", ";", " ", "\t"])
def test_csv_of_recorders_and_our_own_columns_of_identify(tmp_path, separator):
    file = write_csv(tmp_path / "log.csv", LOG, separator)
    read = read_robot_recording(file, ("q_rad", "current_a"))
    check(read, "q_rad", "qd_rad_s", "current_a", "torque_desired_nm")
    names = {"time_s": "time_s", "q_rad": "q{j}_rad", "torque_nm": "torque{j}_nm"}
    check(read_robot_recording(write_csv(file, LOG, separator, names)), "q_rad", "torque_nm")


@pytest.mark.parametrize("kind", ["mcap", "sqlite"])
def test_ros_bags(tmp_path, kind):
    pytest.importorskip("rosbags")
    read = read_robot_recording(write_bag(tmp_path / "bag", LOG, kind))
    check(read, "q_rad", "qd_rad_s", "torque_nm", "wrench")
    if kind == "mcap":
        file = next((tmp_path / "bag").glob("*.mcap"))
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        refuse(r"cut|middle", file)


def test_npz_with_runs_and_mapped_columns_and_units_are_read_and_wrong_maps_refused(tmp_path):
    file = write_npz(tmp_path / "log.npz", {f"b/{name}": values for name, values in LOG.items()})
    check(read_robot_recording(tmp_path, run="b"), "q_rad", "force_n")  # in a run folder
    refuse("--run", file)
    refuse("Known: b", file, run="c")
    names = {"time_s": "clock", "q_rad": "Joint {i} angle"}
    odd = LOG | {"time_s": 1e3 * LOG["time_s"], "q_rad": np.degrees(LOG["q_rad"])}
    file, mapping = write_csv(tmp_path / "log.csv", odd, ",", names), tmp_path / "map.toml"
    refuse("time_s", file)
    mapping.write_text(
        "[columns]\ntime_s = 'clock'\nq_rad = 'Joint {i} angle'\nforce_n = ['Joint 0 angle']\n"
        "[units]\ntime_s = 'ms'\nq_rad = 'deg'\n"
    )
    read = read_robot_recording(file, columns=read_column_map(mapping))
    check(read, "q_rad")
    np.testing.assert_allclose(read.values["force_n"], odd["q_rad"][:, :1], atol=1e-9)
    for text, what in (
        ("[columns]\nq_grad = 'a'\n", "q_rad"), ("[units]\nq_rad = 'turns'\n", "deg"),
        ("[columns]\nq_rad = ['a', 'b']\n", "6 columns"), ("columns = 3\n", "are sections"),
        ("[units]\nq_rad = ['deg']\n", "are sections"),
    ):  # fmt: skip
        mapping.write_text(text)
        with pytest.raises(InputError, match=what):
            read_column_map(mapping)


GAP = {name: np.delete(values, slice(500, 700), 0) for name, values in LOG.items()}
NAN = np.where(np.arange(2000)[:, None] == 7, np.nan, LOG["q_rad"])
BAD = {
    "gap": (GAP, "line 502: a gap of 0.402 s"),
    "back": ({"time_s": np.roll(LOG["time_s"], 3)}, "does not increase"),
    "nan": ({"q_rad": NAN}, "q_rad, column 1, is nan"),
    "degrees": ({"q_rad": np.degrees(LOG["q_rad"])}, "degrees"),
    "milliseconds": ({"time_s": 1e3 * LOG["time_s"]}, "ms"),
    "speed in degrees": ({"qd_rad_s": np.degrees(LOG["qd_rad_s"])}, "Units of time"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_log_is_refused_by_its_place(tmp_path, name):
    changed, what = BAD[name]
    refuse(what, write_csv(tmp_path / "log.csv", LOG | changed))


def test_wrong_numbers_are_named_by_line_and_what_is_missing_cut_or_no_log_is_refused(tmp_path):
    log = {name: values.copy() for name, values in LOG.items()}
    log["q_rad"][1507, 2] = np.nan
    text = write_csv(tmp_path / "log.csv", log).read_text().splitlines()
    (tmp_path / "log.csv").write_text("\n".join([text[0], "# a comment", "", *text[1:]]))
    refuse(r"line 1511, 0\.514 s into .*: q_rad, column 3, is nan", tmp_path / "log.csv", window=(2.5, 4.0))
    refuse(r"sample 1508, .*column 3", write_npz(tmp_path / "log.npz", log), window=(2.5, 4.0))
    text[600] = "# " + text[600]
    (tmp_path / "log.csv").write_text("\n".join(text[:700] + text[900:]))
    refuse(r"line 701: a gap", tmp_path / "log.csv")
    for share in (0.3, 0.9):
        for write, name in ((write_csv, f"{share}.csv"), (write_npz, f"{share}.npz")):
            whole = write(tmp_path / name, LOG).read_bytes()
            (tmp_path / name).write_bytes(whole[: int(share * len(whole)) + 3])
            refuse(r"cut|not a number", tmp_path / name, ("force_n",) if name.endswith("csv") else ())
    (tmp_path / "a.csv").write_text("1,2,3\n4,5,6\n")
    (tmp_path / "b.npz").write_bytes(b"no zip")
    for name, what in (("a.csv", "header"), ("b.npz", "npz"), ("c.csv", "there is no log")):
        refuse(what, tmp_path / name)
    few = write_csv(
        tmp_path / "few.csv", LOG, ",", {name: CSV_NAMES[name] for name in ("time_s", "qd_rad_s")}
    )
    refuse(r"no column of q_rad.*actual_qd_0.*--map", few, ("q_rad",))


def test_a_window_leaves_out_the_rest_and_a_gap_in_it_and_takes_its_own_memory(tmp_path):
    file, peaks = write_csv(tmp_path / "log.csv", GAP), []
    read = read_robot_recording(file, window=(1.5, 3.0))
    assert (read.time[-1], read.whole) == (pytest.approx(1.5), False)
    assert read.values["q_rad"][0] == pytest.approx(LOG["q_rad"][750], abs=1e-6)
    assert abs(len(read_robot_recording(file, window=(0.0, 0.9)).time) - 451) <= 1
    header, *lines = write_csv(file, LOG).read_text().splitlines()
    rests = [line.partition(",")[2] for line in lines]
    for times in (5, 10):
        rows = [f"{0.002 * k:.3f},{rest}\n" for k, rest in enumerate(rests * times)]
        file.write_text("".join([header, "\n", *rows]))
        tracemalloc.start()
        read = read_robot_recording(file, window=(4.0 * times - 2.0, 4.0 * times - 0.5))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert np.abs(LOG["q_rad"][998:1003] - read.values["q_rad"][0]).max(axis=1).min() < 1e-6
    assert peaks[1] == pytest.approx(peaks[0], rel=0.02)
