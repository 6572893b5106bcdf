"""Logs of a robot as recorders write them, with known values."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Log = Mapping[str, NDArray[np.float64]]
CSV_NAMES = {
    "time_s": "timestamp", "q_rad": "actual_q_{i}", "qd_rad_s": "actual_qd_{i}",
    "current_a": "actual_current_{i}", "current_desired_a": "target_current_{i}",
    "torque_desired_nm": "target_moment_{i}", "wrench": "actual_TCP_force_{i}", "force_n": "force_n",
}  # fmt: skip
JOINTS = (
    "elbow_joint", "shoulder_lift_joint", "shoulder_pan_joint", "wrist_1_joint", "wrist_2_joint",
    "wrist_3_joint",
)  # fmt: skip


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
            message = state(header=head, name=list(JOINTS), **parts)
            writer.write(states, stamp, store.serialize_cdr(message, state.__msgtype__))
    return folder
