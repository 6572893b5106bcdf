"""The wire of a simulated controller: its ports, its clients and its clock."""

from __future__ import annotations

import itertools
import os
import selectors
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from polish_sim.errors import InputError
from polish_sim.ur.controller import RobotController
from polish_sim.ur.physics import TICK_S
from polish_sim.ur.ports import (
    BYE,
    GREETING,
    LONGEST,
    STATE_HZ,
    answer,
    realtime_state,
    robot_state,
    version_message,
)
from polish_sim.ur.robot import IDLE, POWER_OFF, RUNNING
from polish_sim.ur.rtde import UNSENT, ProtocolError, RtdeSession
from polish_sim.ur.script.parse import LONGEST_PROGRAM

DASHBOARD, PRIMARY, SECONDARY, REALTIME, RTDE = 29999, 30001, 30002, 30003, 30004
CLIENTS = 64  #: Of one port
COARSE_S = 1e-3  #: Resolution of waiting on sockets
LATE_S = 0.25  #: So far behind the clock the server gives up catching up [s]
BEHIND_S = 0.0025  #: Cycles that begin later than this count as late [s]
EVERY = round(1.0 / (STATE_HZ * TICK_S))
CONFIGURED = 20  #: States between two with the configuration


COMMANDS: dict[str, Callable[[RobotController], object]] = {
    "power on": lambda c: c.power(IDLE),
    "power off": lambda c: c.power(POWER_OFF),
    "set robotmode run": lambda c: c.power(RUNNING),
    "set unlock protective stop": RobotController.unlock,
    "stop program": lambda c: c.stop("asked for"),
    "pause program": RobotController.pause,
    "resume program": RobotController.play,
    "close popup": RobotController.close_popup,
}
"""Commands to the controller on the ports of programmes, in small letters."""


class _Lines:
    """A client that sends lines, in pieces of any size."""

    longest = LONGEST

    def __init__(self, controller: RobotController, send: Callable[[bytes], None], client: str) -> None:
        self._controller, self._send, self._client = controller, send, client
        self._buffer = b""
        self._lines = list[str]()  #: Of a programme without its end yet
        self._size = 0
        send(self.greeting())

    def greeting(self) -> bytes:
        """What it is sent first."""
        return b""

    def feed(self, data: bytes) -> bool:
        """Take text; False where the client is to be dropped."""
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        on = all(self._take(line.decode("utf-8", "replace").rstrip("\r")) for line in lines)
        return on and len(self._buffer) + self._size <= self.longest

    def _take(self, line: str) -> bool:
        """Whether the client stays."""
        raise NotImplementedError

    def packages(self) -> Sequence[bytes]:
        """What it gets at this tick."""
        return ()

    def close(self) -> None:
        """It has gone."""


class _Dashboard(_Lines):
    def greeting(self) -> bytes:
        return GREETING.encode() + b"\n"

    def _take(self, line: str) -> bool:
        said = answer(self._controller, line.strip())
        self._send(said.encode() + b"\n")
        return said != BYE


class _Script(_Lines):
    """A port that takes programmes and commands.

    A programme starts with ``def`` or ``sec`` in the first column and ends with ``end`` there; a line outside
    is a command to the controller, or a programme of one line.
    """

    longest = LONGEST_PROGRAM
    _number = itertools.count(1)

    def close(self) -> None:
        """The client sends no more: a last line without an end counts."""
        self.feed(b"\n")

    def _take(self, line: str) -> bool:
        if self._lines or line.startswith(("def ", "sec ")):
            self._lines.append(line)
            self._size += len(line)
            if line.rstrip() == "end":
                source = "\n".join(self._lines) + "\n"
                self._lines = []
                self._size = 0
                self._controller.run(source, self._client)
        elif command := COMMANDS.get(line.strip().lower()):
            command(self._controller)
        elif line.strip() and not line.lstrip().startswith("#"):
            name = f"unnamed_program_{next(self._number)}"
            self._controller.run(f"def {name}():\n  {line.strip()}\nend\n", self._client)
        return True


class _Primary(_Script):
    with_messages = True  #: Those since the last tick
    _states = 0

    def greeting(self) -> bytes:
        return version_message(self._controller)

    def packages(self) -> Sequence[bytes]:
        """The state, ten times a second and when safety changes; the configuration at first and every few."""
        found = list(self._controller.messages) if self.with_messages else []
        now = self._controller.robot.ticks
        if now % EVERY == 0 or now == self._controller.changed_at or self._states == 0:
            found.append(robot_state(self._controller, self._states % CONFIGURED == 0))
            self._states += 1
        return found


class _Secondary(_Primary):
    with_messages = False


class _Realtime(_Script):
    def packages(self) -> Sequence[bytes]:
        """The state of every tick."""
        return (realtime_state(self._controller),)


PORTS: dict[int, Callable[[RobotController, Callable[[bytes], None], str], Any]] = {
    DASHBOARD: _Dashboard,
    PRIMARY: _Primary,
    SECONDARY: _Secondary,
    REALTIME: _Realtime,
    RTDE: RtdeSession,
}


@dataclass(eq=False)
class _Client:
    socket: socket.socket
    port: int
    session: Any = None
    unsent: bytearray = field(default_factory=bytearray)
    held: bytearray = field(default_factory=bytearray)  #: Until the line is no longer silent


@dataclass
class TickClock:
    """How well the clock was kept."""

    ticks: int = 0
    late: int = 0  #: By more than `BEHIND_S`
    worst_s: float = 0.0


def listening(address: str, port: int) -> socket.socket:
    """A socket that listens; an InputError where none can."""
    try:
        found = socket.create_server((address, port), backlog=CLIENTS)
    except OSError as error:
        raise InputError(
            f"port {port} of {address} cannot be used: {os.strerror(error.errno or 0)}. Another simulated or "
            "real controller may use it: stop that one, or take another --address (127.0.0.2)."
        ) from error
    found.setblocking(False)
    return found


class Server:
    """A controller at an address; ``offset`` is added to every port."""

    def __init__(
        self, controller: RobotController, address: str, real_time: bool = True, offset: int = 0
    ) -> None:
        self._controller = controller
        self._real_time = real_time
        self.pace = TickClock()
        self._selector = selectors.DefaultSelector()
        self._clients: list[_Client] = []
        try:
            for port in PORTS:
                self._selector.register(listening(address, port + offset), selectors.EVENT_READ, port)
        except InputError:
            self.close()
            raise

    def run(self, until: Callable[[], bool]) -> None:
        """Serve until ``until`` is true."""
        due = time.perf_counter() + TICK_S
        while not until():
            if not self._real_time:
                self._attend(0.0 if self._in_step() else 0.02)
                if self._in_step():
                    self._tick()
                continue
            # Waiting on sockets counts in whole milliseconds, upwards: the last one is slept.
            wait = due - time.perf_counter()
            if wait > COARSE_S:
                self._attend(wait - COARSE_S)
                continue
            time.sleep(max(wait, 0.0))
            self._attend(0.0)
            now = time.perf_counter()
            late = now - due
            pace = self.pace
            pace.ticks, pace.worst_s = pace.ticks + 1, max(pace.worst_s, late)
            pace.late += late > BEHIND_S
            self._tick()
            due += TICK_S
            if late > LATE_S:
                due = time.perf_counter() + TICK_S

    def _in_step(self) -> bool:
        """Whether every client that answers packages has answered, and every reader has read."""
        talking = [c for c in self._clients if isinstance(c.session, RtdeSession) and c.session.started]
        answered = all(c.session.answered or c.held or not c.session.inputs for c in talking)
        return bool(talking) and answered and not any(c.unsent for c in talking)

    def _tick(self) -> None:
        controller = self._controller
        controller.tick()
        for client in list(self._clients):
            # A slow reader misses states; what it misses of messages or data would be a gap: it is dropped.
            if client.unsent and client.port == REALTIME:
                continue
            for package in client.session.packages():
                client.held += package
            if client.held and not controller.link.silent:
                self._send(client, bytes(client.held))
                client.held.clear()
            if len(client.unsent) > UNSENT:
                self._drop(client)
        controller.messages.clear()

    def _attend(self, timeout: float) -> None:
        for key, events in self._selector.select(timeout):
            what = key.data
            if isinstance(what, int):
                self._accept(key.fileobj, what)  # type: ignore[arg-type]
                continue
            if events & selectors.EVENT_WRITE:
                self._flush(what)
            if events & selectors.EVENT_READ:
                self._read(what)

    def _accept(self, listening: socket.socket, port: int) -> None:
        try:
            connection, peer = listening.accept()
        except OSError:
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if sum(client.port == port for client in self._clients) >= CLIENTS:
            connection.close()
            return
        client = _Client(connection, port)
        self._clients.append(client)
        self._selector.register(connection, selectors.EVENT_READ, client)
        client.session = PORTS[port](self._controller, lambda data: self._send(client, data), peer[0])

    def _read(self, client: _Client) -> None:
        try:
            data = client.socket.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        try:
            keep = bool(data) and client.session.feed(data) is not False
        except ProtocolError as error:
            self._controller.note(f"port {client.port}: a client was dropped: {error}")
            keep = False
        if not keep:
            self._drop(client)

    def _send(self, client: _Client, data: bytes) -> None:
        """Send what goes at once, keep the rest."""
        if not client.unsent:
            try:
                sent = client.socket.send(data)
            except BlockingIOError:
                sent = 0
            except OSError:
                return  # reading will find it gone
            if sent == len(data):
                return
            data = data[sent:]
            self._selector.modify(client.socket, selectors.EVENT_READ | selectors.EVENT_WRITE, client)
        client.unsent += data

    def _flush(self, client: _Client) -> None:
        try:
            del client.unsent[: client.socket.send(client.unsent)]
        except BlockingIOError:
            return
        except OSError:
            client.unsent.clear()
        if not client.unsent:
            self._selector.modify(client.socket, selectors.EVENT_READ, client)

    def _drop(self, client: _Client) -> None:
        self._clients.remove(client)
        self._selector.unregister(client.socket)
        client.socket.close()
        client.session.close()
        client.session = None  # each holds the other

    def close(self) -> None:
        """Close every port and client."""
        for client in list(self._clients):
            self._drop(client)
        for key in self._selector.get_map().values():
            key.fileobj.close()  # type: ignore[union-attr]
        self._selector.close()
