"""What the compiled loop works on: the engine's memory, the strokes' tables, one record of all that
changes."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.contact import Pad, RealPart, Spindle
from polish_sim.cell.engine import EngineViews
from polish_sim.cell.flange import Flange
from polish_sim.cell.guards import CrashPoints, Guards
from polish_sim.cell.real_part import PartMotion
from polish_sim.cell.robot import RequestLine, Speedl, StopMotion
from polish_sim.cell.stroke import Sequence, Stroke
from polish_sim.cell.wrist_sensor import Payload, WristSensor
from polish_sim.control.signals import Answer, Measurement, Target
from polish_sim.kernels import Matrix6, Record, Vector3, Vector6


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


class Lesson(NamedTuple):
    """What an earlier run along the same path learned."""

    slope: Array  #: Change of the tool's depth per arc length, at equal steps of it, shape (n,) [-]
    spacing: float  #: Arc length between rows [m]
    lead: float  #: From a command to the tool's motion [s]
    runs: int  #: Runs before this one, each learned from the one before


class LawMemory(NamedTuple):
    """What a control law gets pointers to, as bytes."""

    context: NDArray[np.uint8]  #: Gains and memory
    course: NDArray[np.uint8]  #: What lies ahead on the path, for laws that prepare for it
    measurement: NDArray[np.uint8]
    target: NDArray[np.uint8]
    answer: NDArray[np.uint8]


class CellKernel(NamedTuple):
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
