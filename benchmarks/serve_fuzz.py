"""100,000 packets that nobody should send, on every port of `polish-sim serve`.

    python -m benchmarks.serve_fuzz [--packets 100000] [--seed 500]

Random bytes, packages of RTDE with random contents, sizes and halves, cut and changed programmes and
dashboard lines, many over one connection until the server drops it. Meanwhile the dashboard is asked for the
safety mode; its longest answer time is printed with the server's memory. Ends with 1 if the server is gone,
did not answer for 2 s, or grew by more than 50 MB after the first tenth.
"""

from __future__ import annotations

import argparse
import contextlib
import socket
import struct
import tempfile
import threading
import time

import numpy as np

from benchmarks.served import memory_mb, serving

PORTS = (29999, 30001, 30002, 30003, 30004)
HANG_S = 2.0
PROGRAM = b"""\
def f():
  global q = [0, 1.5, -2e-3]
  def g(a, b=[1, 2]):
    return a[0] % 3 xor False
  end
  thread t():
    while q[0] < 3 and True:
      q[0] = q[0] + 1
      sync()
    end
  end
  h = run t()
  if g([1]) == True:
    textmsg(str_cat("a", get_actual_tcp_pose()))
  end
  join h
end
"""
LINES = (
    b"robotmode\n",
    b"play\n",
    b"pause\n",
    b"stop\n",
    b"popup x\n",
    b"load a\n",
    b"power on\n",
    b"brake release\n",
    b"set robotmode run\n",
    b"quit\n",
    b"stop program\n",
    b"safetystatus\n",
)
NAMES = (
    "timestamp",
    "actual_q",
    "input_int_register_0",
    "no_such",
    "",
    "standard_digital_output",
    "speed_slider_mask",
    "input_bit_registers0_to_31",
    "external_force_torque",
    "output_double_register_47",
)


def packet(rng: np.random.Generator, port: int) -> bytes:
    """Something for a port."""
    kind = int(rng.integers(6))
    if kind == 0:
        return rng.bytes(int(rng.integers(1, 2000)))
    if port == 30004:
        body = rng.bytes(int(rng.integers(0, 60)))
        letter = int(rng.choice(list(b"VvOISPUMxX\0")))
        if kind == 1:
            letter, body = ord("V"), struct.pack(">H", int(rng.integers(0, 5)))
        if kind in (2, 3):
            names = ",".join(NAMES[int(rng.integers(len(NAMES)))] for _ in range(int(rng.integers(1, 30))))
            rate = struct.pack(">d", float(rng.choice([500.0, 0.0, -1.0, np.nan, np.inf, 125.0])))
            letter = int(rng.choice(list(b"OI")))
            body = (rate if letter == ord("O") else b"") + names.encode()
        if kind == 4:
            letter, body = int(rng.choice(list(b"SPU"))), bytes([int(rng.integers(4))]) + body
        size = 3 + len(body) + int(rng.choice([0, 0, 0, 0, 1, -2, 500]))
        return struct.pack(">HB", max(size, 0), letter) + body
    text = bytearray(PROGRAM if port != 29999 and kind < 4 else LINES[int(rng.integers(len(LINES)))])
    for _ in range(int(rng.integers(0, 4))):
        at, cut = int(rng.integers(len(text) + 1)), int(rng.choice([0, 1, 3, 40]))
        text[at : at + cut] = [
            b"",
            b"(",
            b"]",
            b"end",
            b"\n",
            b"\0",
            b"\xff",
            b'"',
            b"9" * 12,
            b"while",
            b"p[",
        ][int(rng.integers(11))]
    return bytes(text)


class Watch(threading.Thread):
    """Asks the dashboard again and again."""

    def __init__(self, address: str) -> None:
        super().__init__(daemon=True)
        self.address, self.longest, self.ended, self.count = address, 0.0, False, 0

    def run(self) -> None:
        """Ask until the end is set; each question over a connection of its own, as a new client would."""
        while not self.ended:
            begun = time.monotonic()
            with contextlib.suppress(OSError), socket.create_connection((self.address, 29999), 20.0) as line:
                line.sendall(b"safetymode\n")
                said = b""
                while b"Safetymode" not in said:
                    said += line.recv(4096)
            self.longest, self.count = max(self.longest, time.monotonic() - begun), self.count + 1
            time.sleep(0.05)


def main() -> None:
    """Print how it went."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--packets", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=500)
    parser.add_argument("--address", default="127.0.0.8")
    asked = parser.parse_args()
    rng, sent, memory = np.random.default_rng(asked.seed), 0, list[float]()
    with tempfile.TemporaryDirectory() as folder:
        words = ("--part", "plate", "--address", asked.address, "--out", f"{folder}/served")
        with serving(*words) as process:
            watch = Watch(asked.address)
            watch.start()
            while sent < asked.packets and process.poll() is None:
                port = int(rng.choice(PORTS))
                with (
                    contextlib.suppress(OSError),
                    socket.create_connection((asked.address, port), 5.0) as line,
                ):
                    line.settimeout(5.0)
                    for _ in range(int(rng.integers(1, 60))):
                        sent += 1
                        line.sendall(packet(rng, port))
                if sent // 10_000 >= len(memory):
                    memory.append(memory_mb(process.pid))
                    print(
                        f"{sent} packets: {memory[-1]:.0f} MB, longest answer {watch.longest:.2f} s",
                        flush=True,
                    )
            watch.ended = True
            watch.join(30.0)
            alive, end = process.poll() is None, memory_mb(process.pid)
    base = memory[min(1, len(memory) - 1)]
    print(
        f"{sent} packets, {watch.count} questions: alive {alive}, longest answer {watch.longest:.2f} s, "
        f"memory {base:.0f} -> {end:.0f} MB"
    )
    raise SystemExit(not (alive and watch.longest < HANG_S and end - base < 50.0))


if __name__ == "__main__":
    main()
