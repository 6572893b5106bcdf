"""Twice the same client in lock-step with ``polish-sim serve --speed max``: the same bytes of log.

    python -m benchmarks.served_twice [--seconds 10]

The client answers every packet and a programme presses with force mode on the part. Prints the hash of both
logs and how much faster than real time it went; ends with 1 where the logs differ.
"""

from __future__ import annotations

import argparse
import hashlib
import socket
import struct
import tempfile
import time
from pathlib import Path

from benchmarks.serve_rate import FIELDS, PRESS, ask
from benchmarks.served import serving

RATE = 500.0


def log_of(seconds: float, address: str) -> tuple[str, float]:
    """Hash of the log, and wall time of the client [s]."""
    with tempfile.TemporaryDirectory() as folder:
        words = ("--score", "step-20", "--seed", "512", "--speed", "max", "--address", address)
        with serving(*words, "--out", f"{folder}/served"):
            with socket.create_connection((address, 30002)) as script:
                script.sendall(PRESS.encode())
                time.sleep(1.0)  # the clock stands until a client of RTDE starts
            with socket.create_connection((address, 30004)) as line:
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                ask(line, b"V", struct.pack(">H", 2))
                ask(line, b"O", struct.pack(">d", RATE) + FIELDS.encode())
                ask(line, b"I", b"input_int_register_0")
                ask(line, b"S", b"")
                begun = time.perf_counter()
                for number in range(round(RATE * seconds)):
                    size, _ = struct.unpack(">HB", line.recv(3, socket.MSG_WAITALL))
                    line.recv(size - 3, socket.MSG_WAITALL)
                    line.sendall(struct.pack(">HBBi", 8, ord("U"), 1, number))
                wall = time.perf_counter() - begun
                time.sleep(0.5)  # the last answer is still to be read
        return hashlib.sha256(Path(folder, "served/log.npz").read_bytes()).hexdigest(), wall


def main() -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--address", default="127.0.0.10")
    asked = parser.parse_args()
    found = [log_of(asked.seconds, asked.address) for _ in range(2)]
    for name, wall in found:
        print(f"{name[:16]}, {asked.seconds / wall:.1f} times as fast as real time")
    raise SystemExit(found[0][0] != found[1][0])


if __name__ == "__main__":
    main()
