"""The simulated controller: robot, programme, power and safety as dashboard and script ports command them;
and the line to its clients, on which at times nothing passes."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from polish_sim.arrays import Array
from polish_sim.motion import link_frames
from polish_sim.motion.kinematics import used_arm
from polish_sim.ur.physics import TICK_S
from polish_sim.ur.robot import (
    IDLE,
    NORMAL,
    PAUSED,
    PLAYING,
    PROTECTIVE,
    RUNNING,
    STOPPED,
    SimulatedRobot,
)
from polish_sim.ur.script import Machine, ScriptError
from polish_sim.ur.script.translate import Program, read

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

    from polish_sim.config import RobotConfig

STREAM = 0x4C494E4B  #: Of the random numbers


class Link:
    """What RTDE clients send arrives at the next tick.

    On an arm that is not ideal the line falls silent for ``robot.real.missed_s``, on average every
    ``missed_every_s``: what either side sends meanwhile arrives when that is over.
    """

    def __init__(self, robot: RobotConfig, seed: int) -> None:
        real = robot.real
        self._rng = np.random.default_rng([seed, STREAM])
        self._apart = real.missed_every_s / TICK_S if robot.elastic else 0.0
        self._length = math.ceil(real.missed_s / TICK_S)
        self._coming: deque[Callable[[], None]] = deque()
        self._gap = self._next(0)
        self.silent = False

    def _next(self, tick: int) -> float:
        return tick + 1 + int(self._rng.exponential(self._apart)) if self._apart else math.inf

    def take(self, act: Callable[[], None]) -> None:
        """Take what a client sent; ``act`` is called when it has arrived."""
        self._coming.append(act)

    def advance(self, tick: int) -> None:
        """Let a tick begin: what arrives in it acts."""
        if tick >= self._gap + self._length:
            self._gap = self._next(tick)
        self.silent = tick >= self._gap
        while self._coming and not self.silent:
            self._coming.popleft()()


ROBOT_MESSAGE = 20
TEXT, POPUP, VERSION, SAFETY_MODE, ERROR, KEY, RUNTIME_EXCEPTION = 0, 2, 3, 5, 6, 7, 10


def framed(kind: int, body: bytes) -> bytes:
    """A package of the primary port."""
    return struct.pack(">IB", 5 + len(body), kind) + body


def message(kind: int, time_s: float, body: bytes) -> bytes:
    """A robot message of a kind."""
    return framed(ROBOT_MESSAGE, struct.pack(">QbB", int(1e6 * time_s), -2, kind) + body)


VERSIONS = {"5.11": (5, 11, 8, 108249), "5.23": (5, 23, 0, 120000), "5.26": (5, 26, 0, 130000)}
"""PolyScope versions a controller may say it is: major, minor, bug fix, build."""
UNLOCK_TICKS = 2500  #: The dashboard unlocks a protective stop 5 s after it
#: Other ports, whose clients wait 5 s at most, 1 s after it; the robot's time is not public
WAIT_TICKS = 500
GONE_TICKS = 100  #: How long a programme runs on after its RTDE client has gone
PROTECTIVE_CODE, WARNING = 209, 2  #: Of the message that a protective stop was triggered
KEPT = 1000  #: Lines of the controller's log that are kept, and messages of a tick
UNREAD = 8  #: Programmes that may wait to be read


class RobotController:
    """What all ports of one robot share."""

    def __init__(self, robot: SimulatedRobot, version: str, reader: Executor | None = None) -> None:
        """``reader`` reads programmes beside the clock, in a process; without one time stands while they are
        read."""
        self.robot: SimulatedRobot = robot
        self.version = VERSIONS[version]
        self._reader = reader
        self.torque_constants: Array = np.array(used_arm().torque_constants)  #: [N m/A]
        scenario = robot.cell.scenario
        self.link = Link(scenario.robot, scenario.seed)
        self._unread: list[tuple[str, str]] = []  #: Sources and clients; the first is with the reader
        self._reading: tuple[Future[Any], tuple[str, str]] | None = None  #: One at a time, wanted or not
        self.claimed: dict[str, Any] = {}  #: RTDE inputs by the session that has them
        self.messages: deque[bytes] = deque(maxlen=KEPT)  #: For every client of the primary port
        self.machine: Machine | None = None
        self.secondary: list[Machine] = []
        self.program = ""
        self.popups = 0
        self.log: deque[str] = deque(maxlen=KEPT)
        self._stopped_at = -UNLOCK_TICKS
        self._unlocking = False
        self._safety = NORMAL
        self.changed_at = 0  #: Tick in which the safety mode changed last
        self._orphan: int | None = None

    # The tick.

    def tick(self) -> None:
        """Run programmes, then the robot, for 2 ms."""
        robot = self.robot
        self.link.advance(robot.ticks)
        if self._unread or self._reading:
            self._read_on()
        if self._orphan is not None and robot.ticks - self._orphan >= GONE_TICKS:
            self.stop("the RTDE client that had the programme's registers has gone")
        if robot.watchdog is not None and robot.runtime == PLAYING:
            variable, most, action = robot.watchdog
            if robot.ticks - robot.written[variable] > most:
                self.note(f"watchdog: {variable} was not written for {most * TICK_S:.3f} s")
                robot.watchdog = None
                if action == "stop":
                    self.stop("the watchdog")
                else:
                    self.pause()
        for machine in self.secondary:
            machine.tick(robot)
        self.secondary = [machine for machine in self.secondary if machine.running]
        if self.machine is not None and robot.runtime == PLAYING:
            self.machine.tick(robot)
            if self.machine is not None and not self.machine.running:
                self._ended()
        robot.step()
        if self._unlocking:
            self.unlock()
        if robot.safety == self._safety:
            return
        self._safety = robot.safety
        self.changed_at = robot.ticks
        self._tell(SAFETY_MODE, struct.pack(">8xB8x", robot.safety))
        if robot.safety == PROTECTIVE:
            self._stopped_at = robot.ticks
            self.note(f"protective stop: {robot.stop_reason}")
            self._tell(ERROR, struct.pack(">i4xi8x", PROTECTIVE_CODE, WARNING))
            if robot.runtime == PLAYING:
                robot.runtime = PAUSED

    def _tell(self, kind: int, body: bytes) -> None:
        self.messages.append(message(kind, self.robot.time_s, body))

    def note(self, text: str) -> None:
        """Keep a line of the controller's log."""
        self.log.append(f"{self.robot.time_s:.3f} {text}")

    # Programmes.

    def run(self, source: str, client: str) -> None:
        """Start a programme in the place of the one that runs; one of ``sec`` beside it. Nothing while
        unpowered."""
        if not _beside(source):
            self.stop("another programme starts")
        if self._reader is None:
            self._begin(read(source), client)
        elif len(self._unread) < UNREAD:
            self._unread.append((source, client))
        else:
            self.note(f"a programme was dropped: {UNREAD} wait to be read")

    def _read_on(self) -> None:
        """Begin what has been read, unless it was stopped meanwhile, and hand the next to the reader."""
        assert self._reader is not None
        if self._reading is not None:
            found, job = self._reading
            if not found.done():
                return
            self._reading = None
            if self._unread and self._unread[0] is job:
                self._begin(found.result(), self._unread.pop(0)[1])
        if self._unread:
            self._reading = self._reader.submit(read, self._unread[0][0]), self._unread[0]

    def _begin(self, found: Program | ScriptError, client: str) -> None:
        if self.robot.mode != RUNNING or self.robot.safety != NORMAL:
            self.note("a programme was not started: the robot is not running")
            return
        if isinstance(found, Exception):
            self.note(found.text)
            self.runtime_exception(found.line, found.column, found.wire)
            return
        machine = Machine(found, self, client)
        if found.secondary:
            self.secondary.append(machine)
        else:
            self.machine = machine
            self.robot.runtime = PLAYING
            self.robot.inputs_read.clear()
            self.robot.rig.recording = True

    def stop(self, why: str) -> None:
        """Stop the programme, if one runs or is being read."""
        self._unread = [waiting for waiting in self._unread if _beside(waiting[0])]
        if self.machine is not None:
            self.note(f"stopped: {why}")
            self.machine.stop()
            self._ended()

    def _ended(self) -> None:
        self.machine = None
        self.program = ""
        self._orphan = None
        self.robot.runtime = STOPPED
        self.robot.watchdog = None
        self.robot.let_go()

    def pause(self) -> None:
        """Hold the programme and the arm."""
        if self.robot.runtime == PLAYING:
            self.robot.runtime = PAUSED
            self.robot.let_go()

    def play(self) -> bool:
        """Resume a paused programme."""
        ready = self.robot.runtime == PAUSED and self.robot.safety == NORMAL and self.robot.mode == RUNNING
        if ready:
            self.robot.runtime = PLAYING
        return ready

    def client_gone(self, session: Any) -> None:
        """An RTDE client has gone: a programme that reads its registers is stopped unless it comes
        back."""
        if self.machine is not None and any(
            self.claimed.get(name) is session for name in self.robot.inputs_read
        ):
            self._orphan = self.robot.ticks

    def client_back(self) -> None:
        """Registers are claimed again."""
        self._orphan = None

    # Power and safety.

    @property
    def powered(self) -> bool:
        """Whether the arm has power."""
        return self.robot.mode >= IDLE

    def power(self, mode: int) -> None:
        """Power off, `IDLE`, or `RUNNING`: at once, from any; the programme stops below the last."""
        if mode == IDLE and self.robot.mode == RUNNING:
            return
        if mode != RUNNING:
            self.stop("power")
        self.robot.mode = mode

    def unlock(self, after: int = WAIT_TICKS) -> bool:
        """Leave a protective stop that is ``after`` ticks old: the dashboard must ask again, other ports
        wait."""
        soon = self.robot.ticks - self._stopped_at < after
        self._unlocking = soon and after == WAIT_TICKS
        if self.robot.safety == PROTECTIVE and not soon:
            self.robot.unlock()
        return self.robot.safety != PROTECTIVE

    def close_popup(self) -> None:
        """Close the pendant's message."""
        self.popups = 0
        if self.machine is not None:
            self.machine.close_popup()

    @property
    def joint_mode(self) -> int:
        """253 running, 255 idle, 239 without power."""
        return {RUNNING: 253, IDLE: 255}.get(self.robot.mode, 239)

    @property
    def status_bits(self) -> int:
        """Power, programme."""
        return self.powered | (self.robot.runtime == PLAYING) << 1

    @property
    def safety_bits(self) -> int:
        """Normal, protective stop, stopped due to safety."""
        return 1 if self.robot.safety == NORMAL else 1 << 2 | 1 << 10

    def elbow(self) -> list[float]:
        """Position [m] and velocity [m/s] of the elbow, base axes."""
        frames = link_frames(self.robot.actual_q)
        qd = self.robot.actual_qd
        p = frames[2, :3, 3]
        turns = np.cross(frames[:2, :3, 2], p - frames[:2, :3, 3])
        return [*p, *(turns * qd[:2, None]).sum(axis=0)]

    # What programmes say.

    def text(self, text: str) -> None:
        """Pass on what ``textmsg`` says."""
        self.note(text)
        self._tell(TEXT, text.encode())

    def popup(self, text: str, title: str, warning: bool, error: bool, blocking: bool) -> None:
        """Show a message on the pendant; the dashboard closes a blocking one (``Machine.close_popup``)."""
        self.popups += 1
        head = struct.pack(">Ix???B", self.popups, warning, error, blocking, len(title.encode()[:255]))
        self._tell(POPUP, head + title.encode()[:255] + text.encode())

    def started(self, name: str) -> None:
        """A programme began."""
        self.program = name
        self._key("PROGRAM_XXX_STARTED", name)

    def stopped(self, name: str) -> None:
        """A programme ended, by itself, by ``halt``, by a stop or by an error."""
        self._key("PROGRAM_XXX_STOPPED", name)

    def _key(self, title: str, name: str) -> None:
        self.note(f"{title} {name}")
        self._tell(KEY, struct.pack(">8xB", len(title)) + title.encode() + name.encode())

    def runtime_exception(self, line: int, column: int, text: str) -> None:
        """A programme was refused, or failed while it ran."""
        self.note(f"line {line}, column {column}: {text}")
        self._tell(RUNTIME_EXCEPTION, struct.pack(">ii", line, column) + text.encode())


def _beside(source: str) -> bool:
    return source.lstrip().startswith("sec ")
