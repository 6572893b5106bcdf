"""What the compiled loop works on: the engine's memory, the strokes' tables, one record of all that changes.

Force and feed are set anew in it while it runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.contact import Flange, Pad, RealPart, Spindle
from polish_sim.cell.engine import EngineViews
from polish_sim.cell.real_part import PartMotion
from polish_sim.cell.robot import RequestLine, Speedl, StopMotion
from polish_sim.cell.stroke import Sequence, Stroke
from polish_sim.cell.wrist_sensor import Payload, WristSensor
from polish_sim.config import ProcessConfig
from polish_sim.control.signals import Answer, Measurement, Target
from polish_sim.kernels import Bundle, Matrix6, Record, Vector3, Vector6


class Status(Record):
    """How the run stands: written by the loop, read by its callers."""

    steps: int  #: Taken so far
    requests: int  #: Sent to the robot
    stop: int  #: Code of the protective stop, 0 for none, see ``guards.REASONS``
    stop_time: float  #: [s]
    touched: bool  #: After the exact first contact of the stroke
    contact_time: float  #: Of the run's first contact [s], 0 before
    blocked: bool  #: A joint is at its end
    arrived: bool  #: The stroke is done
    ended: bool  #: The run is over
    pause_at_contact: bool  #: Return at the run's first contact
    wait_from: int  #: Step count after which `advance` returns before the next call of the law; 0 = never
    waiting: bool  #: Returned so: the next step begins with the law
    python_error: bool  #: A controller in Python raised an error
    mute: bool  #: A fault: the host no longer sends
    poisoned: bool  #: A fault: the controller's answer is not a number
    tares: int  #: Samples the sensor is zeroed from
    spread: float  #: Sum of squares of their normal force [N^2]


CODES = 25  #: Of protective stops, see ``guards``; the first one free for what a branch adds


class Guards(Record):
    """Limits, and what is remembered to check them."""

    force: float  #: [N]
    torque: float  #: [N m]
    contact_lost: float  #: [s]
    sensor_timeout: float  #: [s]
    jump: float  #: Of the force, at once [N]; infinite for none
    jump_share: float  #: Of such a jump that the reading against itself smoothed shows [-]
    singular_value: float  #: [-]
    offset: float  #: Of the surface from where it was planned [m]
    stroke: float  #: Of a flange from mid stroke, as a share of it [-]
    lost: float  #: Time without contact so far [s]
    smooth: Vector3  #: The reading's force, smoothed, sensor frame [N]
    swing: float  #: The most the force has jumped in this window of ``SEEN_S`` [N]
    swung: float  #: And in those before, ever less [N]
    window: float  #: When this one ends [s]
    holding: float  #: Time the force has been held [s]
    depth: float  #: The tool's depth at contact, from when the force is first held the depth then [m]
    was_held: bool  #: Whether the force has been held since contact
    missing: float  #: Share of the force wanted that is not there, smoothed [-]
    pressed: float  #: Depth of the pad's deepest point now [m]
    found: float  #: What was measured when a limit was exceeded, see ``MEASURED``
    shares: Annotated[Array, (CODES,)]
    """Largest share of its limit that was reached, by code [-]; limit over value where the limit is the least
    allowed value."""
    places: Annotated[Array, (CODES,)]  #: Arc length of the path there [m]


class CellState(Record):
    """Everything of the cell that changes during a run and has a fixed size."""

    status: Status
    motion: PartMotion
    spindle: Spindle
    flange: Flange
    sensor: WristSensor
    payload: Payload
    speedl: Speedl
    sequence: Sequence
    guards: Guards
    stop: StopMotion
    measurement: Measurement
    target: Target
    answer: Answer  #: Of the controller
    wrench: Vector6  #: Exact wrench of the tool on the part, tool axes, tool point
    jacobian: Matrix6  #: Of the tool point at this instant
    tool_on_part: Vector3  #: Tool point in the nominal work frame of a part that is carried [m]
    scratch: Annotated[Array, (5, 3)]  #: Work array


class Lesson(Bundle):
    """What an earlier run along the same path learned."""

    slope: Array  #: Change of the tool's depth per arc length, at equal steps of it, shape (n,) [-]
    spacing: float  #: Arc length between rows [m]
    lead: float  #: From a command to the tool's motion [s]
    runs: int  #: Runs before this one, each learned from the one before


class LawMemory(Bundle):
    """A control law and what it gets pointers to, as bytes."""

    call: Any  #: See ``LAW_SIGNATURE``; 0 before there is one

    context: NDArray[np.uint8]  #: Gains and memory
    course: NDArray[np.uint8]  #: What lies ahead on the path, for laws that prepare for it
    measurement: NDArray[np.uint8]
    target: NDArray[np.uint8]
    answer: NDArray[np.uint8]


class CrashPoints(Bundle):
    """Points on shaft, spindle, sensor, wrist and forearm that must stay out of part and fixture."""

    points: Array  #: In their bodies' frames [m], shape (k, 3)
    bodies: NDArray[np.int64]  #: Body of each point, shape (k,)
    pad: int  #: How many of them, the last ones, are on the pad's rim: it may touch the part


class CellKernel(Bundle):
    """Everything the compiled loop works on."""

    engine: EngineViews
    pad: Pad
    part: RealPart
    fixture: RealPart  #: What holds it; it stays where it stands
    stroke: Stroke
    crash_points: CrashPoints
    samples: Array  #: Of the wrist sensor, on their way to the host
    requests: RequestLine
    law: LawMemory
    lesson: Lesson
    control_every: int  #: Physics steps a control cycle
    state: CellState


FORCE, FEED = "force_n", "feed_m_s"
SET_POINTS: Mapping[str, str] = MappingProxyType(
    {FORCE: "force to hold along the tool axis [N]", FEED: "speed along the path [m/s]"}
)


class SetPoints:
    """What the host holds now, as shares of what was planned.

    A path that plans its own forces or feeds keeps their proportions. The feed can only be lowered: a motion
    is planned at the fastest its limits allow. Position and depth of the target stay as planned; the force
    loop takes up the rest.
    """

    def __init__(self, process: ProcessConfig) -> None:
        self._usual = {FORCE: process.contact_force_n, FEED: process.feed_m_s}
        self._shares = {FORCE: 1.0, FEED: 1.0}
        self._planned: Stroke

    def begin(self, stroke: Stroke) -> Stroke:
        """A stroke as it is to be run: tables of its own, scaled to the set points."""
        self._planned = stroke
        motion = stroke.motion
        own = stroke._replace(force=stroke.force.copy(), motion=motion._replace(rates=motion.rates.copy()))
        self._scale(own)
        return own

    def change(self, name: str, value: float, cell: CellKernel) -> None:
        """Set a set point [SI] from the next step on.

        At another force the springs are pressed in further or less: as after landing, the guard that watches
        where the surface is waits until the force is held before it knows the new depth.
        """
        before = cell.stroke.force[0]
        self._shares[name] = value / self._usual[name]
        self._scale(cell.stroke)
        guards = cell.state.guards
        change = cell.stroke.force[0] - before
        if change != 0.0 and self._planned.depth > 0.0:
            guards.depth += min(self._planned.depth / self._planned.force[0] * change, 0.0)
            guards.holding, guards.was_held = 0.0, False

    def _scale(self, stroke: Stroke) -> None:
        stroke.force[:] = self._planned.force * self._shares[FORCE]
        stroke.motion.rates[:] = self._planned.motion.rates * self._shares[FEED]
