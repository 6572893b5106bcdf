"""MuJoCo for compiled kernels: live views of its arrays, its step functions, and the corrected wrist
reading."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import mujoco
from numba import types

from polish_sim.arrays import Array
from polish_sim.kernel_cache import add_symbol
from polish_sim.kernels import Bundle, add_to, cross, kernel, matvec, minus, plus, plus_cross, scaled

HEAD = 6  # the head's slide comes after the joints of the arm with the tool
ARM_JOINTS = HEAD + 1


class EngineViews(Bundle):
    """Addresses and live views of the engine's model and data, taken once."""

    model: int
    data: int
    dt: float  #: Physics step [s]
    qpos: Array
    qvel: Array
    qacc: Array
    speeds_before: Array  #: Speeds of arm and head before the engine's last step, shape (7,)
    ctrl: Array
    xanchor: Array
    xaxis: Array
    xpos: Array
    xmat: Array  #: Orientations of bodies, shape (bodies, 3, 3)
    xipos: Array
    cvel: Array
    cdof: Array
    cinert: Array
    subtree_com: Array
    site_xpos: Array
    site_xmat: Array  #: Shape (sites, 3, 3)
    xfrc_applied: Array
    cfrc_ext: Array
    qfrc_actuator: Array
    qfrc_applied: Array
    qfrc_gravcomp: Array
    dof_damping: Array  #: The model's, by which the next step is damped
    sensordata: Array
    tool_site: int
    pad_site: int
    sensor_site: int
    mount_body: int
    head_body: int
    root_body: int


def engine_views(model: mujoco.MjModel, data: mujoco.MjData, arm: str = "") -> EngineViews:
    """Take addresses and live views once; they stay valid as long as model and data live.

    ``arm`` is the prefix of the names of the arm with the tool, which comes first in the scene.
    """
    head = model.body(f"{arm}head").id
    own = {
        "model": model._address,
        "data": data._address,
        "dt": float(model.opt.timestep),
        "xmat": data.xmat.reshape(-1, 3, 3),
        "site_xmat": data.site_xmat.reshape(-1, 3, 3),
        "dof_damping": model.dof_damping,
        "speeds_before": data.qvel[:ARM_JOINTS].copy(),
        "tool_site": model.site(f"{arm}tool").id,
        "pad_site": model.site(f"{arm}pad").id,
        "sensor_site": model.site(f"{arm}sensor").id,
        "mount_body": model.body(f"{arm}tool_mount").id,
        "head_body": head,
        "root_body": int(model.body_rootid[head]),
    }
    return EngineViews(
        **own, **{name: getattr(data, name) for name in EngineViews.__annotations__ if name not in own}
    )


# The engine's step functions, callable from compiled code.
#
# One step through the Python binding costs little, but the loop around it would cost more than the step.
# Compiled kernels therefore call ``mj_step1`` and ``mj_step2`` of the very library the binding has loaded,
# found by symbol name, which numba can cache.

_STEP = types.void(types.intp, types.intp)
mj_step1 = types.ExternalFunction("mj_step1", _STEP)
mj_step2 = types.ExternalFunction("mj_step2", _STEP)


@cache
def register_engine() -> None:
    """Make the engine's step functions known to the compiler, once per process before a kernel that steps.

    MuJoCo's Python binding has every stage of every step timed for `MjData.timer`, an eighth of the step.
    From here on the process does without.

    Raises:
        OSError: If the engine's library cannot be found beside the ``mujoco`` package.
    """
    folder = Path(mujoco.__file__).parent
    candidates = [*folder.glob("libmujoco*"), *folder.glob("mujoco.dll")]
    if not candidates:
        raise OSError(f"no MuJoCo library in {folder}; reinstall the mujoco package.")
    library = ctypes.CDLL(str(candidates[0]))
    for name in ("mj_step1", "mj_step2"):
        address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
        add_symbol(name, address)
    ctypes.c_void_p.in_dll(library, "mjcb_time").value = None


@kernel
def links_touch(e: EngineViews, one: int, other: int) -> bool:
    """Whether the engine pushes on any body but two."""
    for body in range(1, e.cfrc_ext.shape[0]):
        f = e.cfrc_ext[body]
        if body != one and body != other and (f[3] != 0.0 or f[4] != 0.0 or f[5] != 0.0):
            return True
    return False


# The inertia the wrist sensor feels is that of the motion that really happens.
#
# The engine's sensors are computed from its explicit acceleration; its implicit integrator then moves the
# robot by another, smaller one, because the servos damp strongly. From the first the tool would feel 1.4
# times too heavy.


@kernel
def keep_speeds(e: EngineViews) -> None:
    """Remember the joint speeds before the engine moves on."""
    for j in range(e.speeds_before.shape[0]):
        e.speeds_before[j] = e.qvel[j]


@kernel
def correct_reading(e: EngineViews) -> None:
    """Add m (a - a_engine) of the masses below the sensor to its exact reading, after the engine's step.

    Spatial vectors are (angular; linear) about the tree's centre of mass, as the engine keeps them.
    """
    w = v = force = torque = 0.0, 0.0, 0.0
    last = e.speeds_before.shape[0] - 1
    for j in range(last + 1):
        surplus = (e.qvel[j] - e.speeds_before[j]) / e.dt - e.qacc[j]
        w = plus(w, scaled(surplus, e.cdof[j]))
        v = plus(v, scaled(surplus, e.cdof[j, 3:6]))
        if j < last - 1:
            continue
        # The last joint is the head's slide, the one before carries the housing.
        c = e.cinert[e.mount_body if j == last - 1 else e.head_body]
        inertia = (c[0], c[3], c[4]), (c[3], c[1], c[5]), (c[4], c[5], c[2])
        torque = plus(torque, plus_cross(matvec(inertia, w), c[6:9], v))
        force = plus(force, plus(cross(w, c[6:9]), scaled(c[9], v)))
    arm = minus(e.subtree_com[e.root_body], e.site_xpos[e.sensor_site])
    R_sensor_base = e.site_xmat[e.sensor_site].T
    add_to(e.sensordata, matvec(R_sensor_base, force))
    add_to(e.sensordata[3:6], matvec(R_sensor_base, plus_cross(torque, arm, force)))
