"""How well `polish-sim serve` keeps 500 Hz: packets a client gets, and the server's memory, over some
minutes.

    python -m benchmarks.serve_rate [--minutes 10] [--idle] [--robots 2] [--live]

A client of its own process subscribes at 500 Hz to what ur_rtde asks for by default and writes a register in
each cycle, at the priority the server asks for; a programme runs that presses with force mode on the part
(with ``--idle`` none does). With ``--robots 2`` each of two robots has such a client, with ``--live`` it is
drawn for a browser as well. A line each half minute: share of packets at most 2.5 ms after the one before,
the longest gap, the server's memory and its processor time in a cycle, and the load of the machine. Ends with
1 where less than 99% were in time or memory grew by more than 2% after the first minute.
"""

from __future__ import annotations

import argparse
import os
import socket
import struct
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from benchmarks.served import memory_mb, processor_s, serving
from polish_sim.cli.serve import before_others

FIELDS = (
    "timestamp,target_q,target_qd,target_qdd,target_current,target_moment,actual_q,actual_qd,actual_current,"
    "joint_control_output,actual_TCP_pose,actual_TCP_speed,actual_TCP_force,target_TCP_pose,target_TCP_speed,"
    "actual_digital_input_bits,joint_temperatures,actual_execution_time,robot_mode,joint_mode,safety_mode,"
    "actual_tool_accelerometer,speed_scaling,target_speed_fraction,actual_momentum,actual_main_voltage,"
    "actual_robot_voltage,actual_robot_current,actual_joint_voltage,actual_digital_output_bits,runtime_state,"
    "robot_status_bits,safety_status_bits,payload,payload_cog,payload_inertia,ft_raw_wrench"
)
PRESS = """\
def press():
  zero_ftsensor()
  force_mode_set_damping(0.05)
  thread pressing():
    while True:
      force_mode(get_actual_tcp_pose(), [0,0,1,0,0,0], [0,0,20,0,0,0], 2, [0.01,0.01,0.005,0.1,0.1,0.1])
      sync()
    end
  end
  run pressing()
  while True:
    x = read_input_integer_register(0)
    sync()
  end
end
"""
LATE_S = 0.0025
REPORT_S = 30.0
ADDRESSES = ("127.0.0.7", "127.0.0.8")


def ask(line: socket.socket, kind: bytes, body: bytes) -> None:
    """Send a package and wait for the answer of its kind."""
    line.sendall(struct.pack(">HB", 3 + len(body), kind[0]) + body)
    while True:
        size, found = struct.unpack(">HB", line.recv(3, socket.MSG_WAITALL))
        line.recv(size - 3, socket.MSG_WAITALL)
        if found == kind[0]:
            return


def main() -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--idle", action="store_true")
    parser.add_argument("--robots", type=int, choices=(1, 2), default=1)
    parser.add_argument("--live", action="store_true")
    asked = parser.parse_args()
    addresses = ADDRESSES[: asked.robots]
    with tempfile.TemporaryDirectory() as folder:
        cell = ("--score", "step-20") if asked.robots == 1 else ("--part", "plate")
        places = [word for address in addresses for word in ("--address", address)]
        live = ("--live", "--live-port", "8097") if asked.live else ()
        with (
            serving(*cell, *places, *live, "--out", f"{folder}/served") as process,
            ProcessPoolExecutor(len(addresses), get_context("spawn")) as clients,
        ):
            jobs = [
                clients.submit(measure, address, asked.idle, asked.minutes, process.pid)
                for address in addresses
            ]
            good = [job.result() for job in jobs]
    raise SystemExit(not all(good))


def measure(address: str, idle: bool, minutes: float, server: int) -> bool:
    """Whether it is as it should be at an address."""
    line = socket.create_connection((address, 30004))
    line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    ask(line, b"V", struct.pack(">H", 2))
    ask(line, b"O", struct.pack(">d", 500.0) + FIELDS.encode())
    ask(line, b"I", b"input_int_register_0")
    ask(line, b"S", b"")
    if not idle:
        with socket.create_connection((address, 30002)) as script:
            script.sendall(PRESS.encode())
            time.sleep(0.5)
    with before_others():
        return count(line, address, minutes, server)


def count(line: socket.socket, address: str, minutes: float, server: int) -> bool:
    """The packets of some minutes."""
    gaps, memory, begun, spent = list[float](), list[float](), time.perf_counter(), processor_s(server)
    before, said, number = begun, begun, 0
    while before - begun < 60.0 * minutes:
        size, _ = struct.unpack(">HB", line.recv(3, socket.MSG_WAITALL))
        line.recv(size - 3, socket.MSG_WAITALL)
        now, number = time.perf_counter(), number + 1
        gaps.append(now - before)
        before = now
        line.sendall(struct.pack(">HBBi", 8, ord("U"), 1, number % 2**31))
        if now - said >= REPORT_S:
            said = now
            memory.append(memory_mb(server))
            some = np.array(gaps[-round(REPORT_S / 0.002) :])
            each = (processor_s(server) - spent) / len(gaps)
            print(
                f"{address} {(now - begun) / 60.0:5.1f} min: {100.0 * np.mean(some <= LATE_S):.3f}% within "
                f"2.5 ms, longest {1e3 * some.max():.1f} ms, {memory[-1]:.0f} MB, processor "
                f"{1e3 * each:.2f} ms a cycle, load {os.getloadavg()[0]:.1f}",
                flush=True,
            )
    share = float(np.mean(np.array(gaps) <= LATE_S))
    grown = memory[-1] / memory[min(1, len(memory) - 1)] - 1.0 if memory else 0.0
    print(
        f"{address} {len(gaps)} packets, {len(gaps) / (before - begun):.1f} a second: {100.0 * share:.3f}% "
        f"within 2.5 ms, memory {100.0 * grown:+.1f}% after the first minute",
        flush=True,
    )
    return share >= 0.99 and grown < 0.02


if __name__ == "__main__":
    main()
