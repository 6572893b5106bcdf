"""How a control law is handed to the compiled loop: its signature, its gains and its memory in one array (layer 7).

A law is compiled in the file it is written in: numba keeps a compiled function on disk only where it finds every
function it calls by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numba import types
from numpy.typing import NDArray

from polish_sim.control.signals import WHOLE_FEED, Measurement, Target

Array = NDArray[np.float64]

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
