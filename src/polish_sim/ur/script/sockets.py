"""A programme's sockets: they go out to the computer that sent the programme, and to no other."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass, field
from struct import error, pack, unpack
from typing import Any

from polish_sim.ur.kinematics import TICK_S
from polish_sim.ur.script.values import List, number, to_text

CONNECT_S = 2.0
MOST_SOCKETS = 16
MOST_BYTES = 65_536  #: Kept unread of a socket
MOST_INTEGERS = 30

Waiting = Generator[None, None, Any]


@dataclass
class _Line:
    """A connection and what came and was not read yet."""

    socket: socket.socket
    received: bytearray = field(default_factory=bytearray)
    closed: bool = False

    def receive(self) -> None:
        while not self.closed and len(self.received) < MOST_BYTES:
            try:
                some = self.socket.recv(4096)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:
                some = b""
            self.closed = not some
            self.received += some


class Sockets:
    """The built-ins on sockets; ``client`` is the only address they reach."""

    def __init__(self) -> None:
        self.client = ""
        self.lines: dict[str, _Line] = {}

    def close_all(self) -> None:
        """Close what a programme left open."""
        for name in list(self.lines):
            self.socket_close(name)

    def socket_open(self, address: Any, port: Any, socket_name: Any = "socket_0") -> Waiting:
        """Connect; False if nobody listens, or the address is not the one the programme came from."""
        self.socket_close(socket_name)
        if address != self.client and not (address == "localhost" and self.client.startswith("127.")):
            raise ValueError(
                f"sockets reach the sender of the programme, {self.client or 'none'}, not {address}"
            )
        if len(self.lines) >= MOST_SOCKETS:
            raise ValueError(f"more than {MOST_SOCKETS} sockets")
        line = _Line(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
        line.socket.setblocking(False)
        line.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.lines[socket_name] = line
        with suppress(OSError, OverflowError):
            line.socket.connect_ex((self.client, int(number(port))))
            for _ in range(round(CONNECT_S / TICK_S)):
                if select.select([], [line.socket], [], 0.0)[1]:
                    break
                yield
            if line.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0 and line.socket.getpeername():
                return True
        self.socket_close(socket_name)
        return False

    def socket_close(self, socket_name: Any = "socket_0") -> None:
        """Close a connection."""
        line = self.lines.pop(socket_name, None)
        if line is not None:
            line.socket.close()

    def _send(self, data: bytes, name: Any) -> bool:
        line = self.lines.get(name)
        try:
            return line is not None and line.socket.send(data) == len(data)
        except OSError:
            return False

    def socket_send_int(self, value: Any, socket_name: Any = "socket_0") -> bool:
        """Send 32 bits in network order."""
        try:
            return self._send(pack(">i", int(number(value))), socket_name)
        except error:
            raise ValueError(f"{value} is no 32-bit integer") from None

    def socket_send_byte(self, value: Any, socket_name: Any = "socket_0") -> bool:
        """Send a byte."""
        return self._send(bytes([int(number(value)) & 255]), socket_name)

    def socket_send_string(self, text: Any, socket_name: Any = "socket_0") -> bool:
        """Send a value as text."""
        return self._send(to_text(text).encode(), socket_name)

    def socket_send_line(self, text: Any, socket_name: Any = "socket_0") -> bool:
        """Send a value as text and the end of the line."""
        return self._send(to_text(text).encode() + b"\n", socket_name)

    def _read(self, name: Any, timeout: Any, cut: Callable[[bytearray], int]) -> Waiting:
        """Wait for as many bytes as ``cut`` finds (0: not yet); None if time runs out or the line is dead."""
        line = self.lines.get(name)
        steps = round(min(number(timeout), 1e6) / TICK_S)
        waited = 0
        while line is not None:
            line.receive()
            size = cut(line.received)
            if size:
                data = bytes(line.received[:size])
                del line.received[:size]
                return data
            if line.closed or len(line.received) >= MOST_BYTES or (steps > 0 and waited >= steps):
                break
            waited += 1
            yield
        return None

    def socket_read_binary_integer(
        self, size: Any, socket_name: Any = "socket_0", timeout: Any = 2.0
    ) -> Waiting:
        """Read integers in network order: ``[how many, first, ...]``; -1 first if they did not come. 0: no
        time-out."""
        count = int(number(size))
        if not 0 < count <= MOST_INTEGERS:
            raise ValueError(f"1 to {MOST_INTEGERS} integers can be read, not {count}")
        data = yield from self._read(socket_name, timeout, lambda have: 4 * count * (len(have) >= 4 * count))
        values = unpack(f">{count}i", data) if data else (0,) * count
        return List((count if data else -1, *values))

    def socket_read_ascii_float(
        self, size: Any, socket_name: Any = "socket_0", timeout: Any = 2.0
    ) -> Waiting:
        """Read ``(1.0, 2.0)``: ``[how many, first, ...]``; 0 first if they did not come."""
        count = int(number(size))
        data = yield from self._read(socket_name, timeout, lambda have: have.find(b")") + 1)
        try:
            values = [float(text) for text in (data or b"").decode().strip(" \r\n()").split(",")]
        except ValueError:
            values = []
        good = len(values) == count
        return List((count, *values) if good else (0, *([0.0] * min(count, MOST_INTEGERS))))

    def socket_read_line(self, socket_name: Any = "socket_0", timeout: Any = 2.0) -> Waiting:
        """Read a line; an empty text if none came."""
        data = yield from self._read(socket_name, timeout, lambda have: have.find(b"\n") + 1)
        return (data or b"").decode("utf-8", "replace").rstrip("\r\n")[:4096]
