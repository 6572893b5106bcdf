"""What a controller sees and answers: measurement and target in, tool twist out.

Both are one record each, so that a compiled law and a user's Python class read the same memory.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import carray, types
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Matrix3, Record, Vector3, Vector6, memory_of


class Measurement(Record):
    """What the host computer reads each control cycle; base frame unless said."""

    position: Vector3  #: Tool point from the encoders [m]
    rotation: Matrix3  #: R_base_tool
    twist: Vector6  #: Tool velocity from the encoders (linear [m/s]; angular [rad/s])
    wrench: Vector6
    """Wrench the tool exerts on the part, tool axes, about the tool point (force [N]; torque [N m]).
    As the wrist sensor gives it: compensated, filtered, late. Positive force z presses."""
    time: float  #: [s]
    cycle: float  #: Control cycle [s]


class Target(Record):
    """What is wanted at this instant; base frame."""

    position: Vector3  #: Tool point [m], already pressed in by D = F/k
    rotation: Matrix3  #: R_base_tool
    twist: Vector6  #: Planned tool velocity (linear [m/s]; angular [rad/s])
    force: float  #: Force to press with [N]
    moment: float  #: Moment wanted about tool y [N m]
    contact: bool  #: Whether the force is to be controlled; not in free space
    s: float  #: Place on the path [m]
    curvature: float  #: Normal curvature there along the path [1/m]
    speed: float  #: Of the place [m/s]


class Answer(Record):
    """What a controller answers."""

    twist: Vector6  #: Tool twist to command, base frame (linear [m/s]; angular [rad/s])
    feed: float  #: Share of the planned feed it grants, 0 to 1


MEASUREMENT, TARGET, ANSWER = Measurement.dtype, Target.dtype, Answer.dtype


# How a control law is handed to the compiled loop: a C function that takes pointers.
#
# A law is compiled in the file it is written in: numba keeps a compiled function on disk only where it finds
# every function it calls by name.

LAW_SIGNATURE = types.void(*[types.voidptr] * 5)
"""A compiled law takes pointers to its context, the course, measurement, target and the answer it writes."""


@njit(inline="always")
def records_at(context, kind, measurement, target, answer):  # type: ignore[no-untyped-def]
    """What a law reads and writes, behind the pointers it gets; ``kind``: the type of its context."""
    m, t = carray(measurement, 1, MEASUREMENT)[0], carray(target, 1, TARGET)[0]
    return carray(context, 1, kind)[0], m, t, carray(answer, 1, ANSWER)[0]


CALL = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)
"""The same for Python."""


class Controller(Protocol):
    """What a controller must offer; a user's own class needs these two methods and nothing else."""

    def reset(self, cycle_s: float) -> None:
        """Forget everything; ``step`` will be called every ``cycle_s`` seconds."""

    # A controller may also have ``prepare(course: Course) -> None``: called before the run with the path
    # ahead.

    def step(self, measurement: Measurement, target: Target) -> Array:
        """Return the tool twist to command, base frame (linear [m/s]; angular [rad/s]), shape (6,).

        A seventh number, 0 to 1, slows the feed: the place on the path moves at this share of the planned
        speed.
        """


class CompiledController:
    """A shipped controller: gains and memory in one record, its law compiled.

    The field ``memory`` of ``context`` is zero after a reset. ``course`` is what lies ahead on the path as
    the law has it, an array of records; None for a law that does not ask.
    """

    def __init__(self, context: Any, law: Any, course: Any = None) -> None:
        self.context, self.law = context, law
        self.course: Any = np.zeros(1) if course is None else course
        self._memory = [memory_of(record) for record in (context, Measurement(), Target(), Answer())]

    def reset(self, cycle_s: float) -> None:
        """Forget everything."""
        self.context.memory = np.zeros((), self.context.memory.dtype)

    def step(self, measurement: Measurement, target: Target) -> Array:
        """Return the tool twist to command and the share of the planned feed, shape (7,)."""
        context, *others = self._memory
        for own, given in zip(others, (measurement, target), strict=False):
            own[:] = memory_of(given)
        answer = others[-1].view(np.float64)
        answer[6] = 1.0
        CALL(self.law.address)(*(array.ctypes.data for array in (context, self.course, *others)))
        return answer.copy()


# What lies ahead on the path, as a controller may know it before the run.
#
# Everything here comes from the drawing: the nominal part, pad and springs as they should be. What the real
# part, the real springs and the sensor do differently, a controller has to find out.


class Course(NamedTuple):
    """Rows at equal steps of the plan's arc length; ``target.s`` divided by ``spacing`` is the row."""

    spacing: float  #: Arc length between rows [m]
    #: Depth along the tool axis, from the unpressed surface, that presses with the wanted force [m], (n,)
    depth: Array
    #: That depth beyond the planned target's [m], shape (n,); 0 where the pad lies flat on the part
    surplus: Array
    #: Change of the force with that depth, head spring and touching pad in series [N/m], shape (n,)
    stiffness: Array
    moment: Array
    """Moment of the pad's pressure on the part about tool x and y through the middle of the pad's face [N m],
    shape (n, 2). Friction acts in that face and has no part in it."""
    #: Change of that moment with a tilt of the tool at the same force [N m/rad], shape (n, 2)
    tilt_stiffness: Array
    curvature: Array  #: Normal curvature along the path [1/m], shape (n,)
    bending: Array  #: Curvature of the planned path in space [1/m], shape (n,)
    turning: Array  #: Planned rotation of the tool per arc length, base frame [rad/m], shape (n, 3)
    #: Speed of the planned motion along the path, slowed where its limits ask for it [m/s], shape (n,)
    feed: Array
    #: Row of the nearest place on an earlier turn, -1 without one nearby, shape (n,)
    neighbour: NDArray[np.int64]
    #: Frequency at which the loop would make the arm swing [rad/s], shape (n,); 0 where nobody knows it
    arm_mode: Array
