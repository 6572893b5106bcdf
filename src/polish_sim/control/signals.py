"""What a controller sees and answers: measurement and target in, tool twist out.

Both travel as one flat array each, so that a compiled law and a user's Python class read the same memory;
``measurement_of`` and ``target_of`` give the named views.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import types
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit

Array = NDArray[np.float64]

MEASUREMENT_SIZE = 26
TARGET_SIZE = 24
ANSWER_SIZE = 7
"""Tool twist (6,) and the share of the planned feed the controller grants, 0 to 1."""
WHOLE_FEED = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
"""The answer of a controller that asks for nothing: rest, and the feed as planned."""
WHOLE_FEED.setflags(write=False)


class Measurement(NamedTuple):
    """What the host computer reads each control cycle; base frame unless said."""

    position: Array
    """Tool point from the encoders [m], shape (3,)."""
    rotation: Array
    """R_base_tool, shape (3, 3)."""
    twist: Array
    """Tool velocity from the encoders (linear [m/s]; angular [rad/s]), shape (6,)."""
    wrench: Array
    """Wrench the tool exerts on the part, tool axes, about the tool point (force [N]; torque [N m]), shape (6,).
    As the wrist sensor gives it: compensated, filtered, late. Positive force z presses."""
    clock: Array
    """Time [s] and control cycle [s], shape (2,)."""


class Target(NamedTuple):
    """What is wanted at this instant; base frame."""

    position: Array
    """Tool point [m], shape (3,), already pressed in by D = F/k."""
    rotation: Array
    """R_base_tool, shape (3, 3)."""
    twist: Array
    """Planned tool velocity (linear [m/s]; angular [rad/s]), shape (6,)."""
    force: Array
    """Force to press with [N] and moment wanted about tool y [N m], shape (2,)."""
    contact: Array
    """1 while the force is to be controlled, 0 in free space, shape (1,)."""
    path: Array
    """Place on the path [m], normal curvature there along the path [1/m] and speed of the place [m/s], shape (3,)."""


@njit(cache=True)
def measurement_of(flat: Array) -> Measurement:
    """Named views of a flat measurement, shape (26,)."""
    return Measurement(flat[0:3], flat[3:12].reshape((3, 3)), flat[12:18], flat[18:24], flat[24:26])


@njit(cache=True)
def target_of(flat: Array) -> Target:
    """Named views of a flat target, shape (24,)."""
    return Target(flat[0:3], flat[3:12].reshape((3, 3)), flat[12:18], flat[18:20], flat[20:21], flat[21:24])


# How a control law is handed to the compiled loop: its signature, its gains and its memory in one array.
#
# A law is compiled in the file it is written in: numba keeps a compiled function on disk only where it finds every
# function it calls by name.

_POINTER = types.CPointer(types.float64)
LAW_SIGNATURE = types.void(_POINTER, _POINTER, _POINTER, _POINTER)
"""A compiled law takes pointers to context, measurement, target and the answer it writes (twist, feed share)."""


class Controller(Protocol):
    """What a controller must offer; a user's own class needs these two methods and nothing else."""

    def reset(self, cycle_s: float) -> None:
        """Forget everything; ``step`` will be called every ``cycle_s`` seconds."""

    # A controller may also have ``prepare(course: Course) -> None``: told before the run what lies ahead on the path.

    def step(self, measurement: Measurement, target: Target) -> Array:
        """Return the tool twist to command, base frame (linear [m/s]; angular [rad/s]), shape (6,).

        A seventh number, 0 to 1, slows the feed: the place on the path moves at this share of the planned speed.
        """


class CompiledController:
    """A shipped controller: its gains and memory in one array, its step compiled.

    Args:
        gains: What the law reads first, shape (n,).
        memory: Size of the memory behind the gains, zero after a reset.
        step: The compiled step, for calls from Python.
        law: Gives its entry for the loop, compiled at first use.
    """

    def __init__(self, gains: Array, memory: int, step: Callable[..., None], law: Callable[[], Any]) -> None:
        self.context = np.concatenate([gains, np.zeros(memory)])
        self._gains, self._step, self._law = len(gains), step, law

    def reset(self, cycle_s: float) -> None:
        """Forget everything."""
        self.context[self._gains :] = 0.0

    def step(self, measurement: Measurement, target: Target) -> Array:
        """Return the tool twist to command and the share of the planned feed, shape (7,)."""
        twist = WHOLE_FEED.copy()
        self._step(self.context, measurement, target, twist)
        return twist

    def compiled_law(self) -> Any:
        """First-class compiled function for the loop."""
        return self._law()


# What lies ahead on the path, as a controller may know it before the run.
#
# Everything here comes from the drawing: the nominal part, pad and springs as they should be. What the real part, the
# real springs and the sensor do differently, a controller has to find out.


class Course(NamedTuple):
    """Rows at equal steps of the plan's arc length; ``target.path[0]`` divided by ``spacing`` is the row."""

    spacing: float
    """Arc length between rows [m]."""
    depth: Array
    """Depth along the tool axis, from the unpressed surface, at which springs and pad press with the wanted force [m],
    shape (n,)."""
    surplus: Array
    """That depth beyond the planned target's [m], shape (n,); zero where the whole pad lies flat on the part."""
    stiffness: Array
    """Change of the force with that depth, head spring and touching part of the pad in series [N/m], shape (n,)."""
    moment: Array
    """Moment of the pad's pressure on the part about tool x and y through the middle of the pad's face [N m], shape
    (n, 2). Friction acts in that face and has no part in it."""
    tilt_stiffness: Array
    """Change of that moment with a tilt of the tool about its own axis at the same force [N m/rad], shape (n, 2)."""
    curvature: Array
    """Normal curvature along the path [1/m], shape (n,)."""
    bending: Array
    """Curvature of the planned path in space [1/m], shape (n,)."""
    turning: Array
    """Planned rotation of the tool per arc length, base frame [rad/m], shape (n, 3)."""
    feed: Array
    """Speed of the planned motion along the path, slowed where its limits ask for it [m/s], shape (n,)."""
    neighbour: NDArray[np.int64]
    """Row of the nearest place on an earlier turn, -1 where there is none within about a step-over, shape (n,)."""
