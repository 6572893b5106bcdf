"""Everything the compiled loop works on, as one tuple of tuples and arrays."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import NamedTuple

import llvmlite.binding as llvm
import mujoco
import numpy as np
from numba import types
from numpy.typing import NDArray

from polish_sim.cell.carrier import Carrier
from polish_sim.cell.contact import Pad, RealPart, Spindle
from polish_sim.cell.guards import Guards
from polish_sim.cell.host_arm import HostArm
from polish_sim.cell.protective_stop import StopMotion
from polish_sim.cell.real_part import PartMotion
from polish_sim.cell.speedl import SpeedlModel, SpeedlState
from polish_sim.cell.stroke import Job, SequenceState
from polish_sim.cell.wrist_sensor import Payload, SensorModel, SensorState

Array = NDArray[np.float64]

CLOCK, REQUESTS, STOP, TOUCHED, TARES, ARRIVED = 0, 1, 2, 3, 4, 5
SPREAD, ENDED, STOP_TIME, BLOCKED, CONTACT_TIME, PAUSE, MUTE, POISON, PYTHON_ERROR = 6, 7, 8, 9, 10, 11, 12, 13, 14
STATUS_SIZE = 16

ARM_JOINTS = 7  # six of the arm with the tool and the head's slide


class EngineViews(NamedTuple):
    """Addresses and live views of the engine's model and data, taken once."""

    model: int
    data: int
    dt: float
    """Physics step [s]."""
    qpos: Array
    qvel: Array
    qacc: Array
    speeds_before: Array
    """Speeds of arm and head before the engine's last step, shape (7,)."""
    ctrl: Array
    xanchor: Array
    xaxis: Array
    xpos: Array
    xmat: Array
    xipos: Array
    cvel: Array
    cdof: Array
    cinert: Array
    subtree_com: Array
    site_xpos: Array
    site_xmat: Array
    xfrc_applied: Array
    cfrc_ext: Array
    qfrc_actuator: Array
    sensordata: Array
    tool_site: int
    pad_site: int
    sensor_site: int
    mount_body: int
    head_body: int
    root_body: int


class CellKernel(NamedTuple):
    """Everything the compiled loop works on."""

    engine: EngineViews
    pad: Pad
    part: RealPart
    motion: PartMotion
    carrier: Carrier
    host_arm: HostArm
    """The arm with the tool as the host computes it."""
    spindle: Spindle
    sensor: SensorModel
    sensor_state: SensorState
    payload: Payload
    speedl: SpeedlModel
    speedl_state: SpeedlState
    job: Job
    sequence: SequenceState
    guards: Guards
    stop: StopMotion
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
    jacobian: Array
    """Of the tool point at this instant, shape (6, 6)."""
    status: Array
    """What the loop and its callers tell each other, one number each, shape (STATUS_SIZE,):

    CLOCK steps taken, REQUESTS sent to the robot, STOP code of the protective stop and STOP_TIME [s], TOUCHED 1 after
    the exact first contact of the stroke and CONTACT_TIME of the run's first [s], TARES samples zeroed from and SPREAD
    their sum of squares, ARRIVED 1 when the job is done, ENDED 1 when the run is over, BLOCKED 1 while a joint
    is at its end, PAUSE 1 to return at first contact, PYTHON_ERROR 1 when a Python law raised. Of faults: MUTE 1 when
    the host no longer sends, POISON 1 when the controller answers nonsense.
    """


def engine_views(model: mujoco.MjModel, data: mujoco.MjData, arm: str = "") -> EngineViews:
    """Take addresses and live views once; they stay valid as long as model and data live.

    Args:
        model: The scene; the arm with the tool comes first in it.
        data: Its state.
        arm: What the names of that arm begin with.
    """
    head = model.body(f"{arm}head").id
    return EngineViews(
        model._address,
        data._address,
        float(model.opt.timestep),
        data.qpos,
        data.qvel,
        data.qacc,
        data.qvel[:ARM_JOINTS].copy(),
        data.ctrl,
        data.xanchor,
        data.xaxis,
        data.xpos,
        data.xmat,
        data.xipos,
        data.cvel,
        data.cdof,
        data.cinert,
        data.subtree_com,
        data.site_xpos,
        data.site_xmat,
        data.xfrc_applied,
        data.cfrc_ext,
        data.qfrc_actuator,
        data.sensordata,
        model.site(f"{arm}tool").id,
        model.site(f"{arm}pad").id,
        model.site(f"{arm}sensor").id,
        model.body(f"{arm}tool_mount").id,
        head,
        int(model.body_rootid[head]),
    )


# The engine's step functions, callable from compiled code.
#
# One step through the Python binding costs little, but the loop around it would cost more than the step. Compiled
# kernels therefore call ``mj_step1`` and ``mj_step2`` of the very library the binding has loaded, found by symbol name,
# which numba can cache.

_STEP = types.void(types.intp, types.intp)
mj_step = types.ExternalFunction("mj_step", _STEP)
mj_step1 = types.ExternalFunction("mj_step1", _STEP)
mj_step2 = types.ExternalFunction("mj_step2", _STEP)


@cache
def register_engine() -> None:
    """Make the engine's step functions known to the compiler; needed once per process before a kernel that steps.

    Raises:
        OSError: If the engine's library cannot be found beside the ``mujoco`` package.
    """
    folder = Path(mujoco.__file__).parent
    candidates = [*folder.glob("libmujoco*"), *folder.glob("mujoco.dll")]
    if not candidates:
        raise OSError(f"no MuJoCo library in {folder}; reinstall the mujoco package.")
    library = ctypes.CDLL(str(candidates[0]))
    for name in ("mj_step", "mj_step1", "mj_step2"):
        address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
        llvm.add_symbol(name, address)
