"""The engine's step functions, callable from compiled code (layer 8a).

One step through the Python binding costs little, but the loop around it would cost more than the step. Compiled kernels
therefore call ``mj_step1`` and ``mj_step2`` of the very library the binding has loaded, found by symbol name, which
numba can cache.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import llvmlite.binding as llvm
import mujoco
from numba import types

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
