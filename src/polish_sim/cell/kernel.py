"""Everything the compiled loop works on, as one tuple of tuples and arrays (layer 8a)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.contact import Pad, RealPart
from polish_sim.cell.guards import Guards
from polish_sim.cell.part_motion import PartMotion
from polish_sim.cell.sequence import Job, SequenceState
from polish_sim.cell.speedl import SpeedlModel, SpeedlState
from polish_sim.cell.spindle import Spindle
from polish_sim.cell.wrist_sensor import Payload, SensorModel, SensorState

Array = NDArray[np.float64]

CLOCK, REQUESTS, STOP, TOUCHED, TARES, ARRIVED = 0, 1, 2, 3, 4, 5
STATUS_SIZE = 16


class EngineViews(NamedTuple):
    """Addresses and live views of the engine's model and data, taken once."""

    model: int
    data: int
    dt: float
    """Physics step [s]."""
    qpos: Array
    qvel: Array
    ctrl: Array
    xanchor: Array
    xaxis: Array
    xpos: Array
    xmat: Array
    xipos: Array
    cvel: Array
    subtree_com: Array
    site_xpos: Array
    site_xmat: Array
    xfrc_applied: Array
    cfrc_ext: Array
    qfrc_actuator: Array
    sensordata: Array
    tool_site: int
    pad_site: int
    head_body: int
    root_body: int


class CellKernel(NamedTuple):
    """Everything the compiled loop works on."""

    engine: EngineViews
    pad: Pad
    part: RealPart
    motion: PartMotion
    spindle: Spindle
    sensor: SensorModel
    sensor_state: SensorState
    payload: Payload
    speedl: SpeedlModel
    speedl_state: SpeedlState
    job: Job
    sequence: SequenceState
    guards: Guards
    measurement: Array
    target: Array
    twist: Array
    """Twist the controller asked for last and the share of the planned feed it grants, shape (7,)."""
    context: Array
    """Gains and memory of a compiled law."""
    control_every: int
    wrench: Array
    """Exact wrench of the tool on the part, tool axes, tool point, shape (6,)."""
    scratch: Array
    """Work array, shape (5, 3)."""
    status: Array
    """Step count, requests sent, stop code, first contact seen, tare samples, done; shape (STATUS_SIZE,)."""
