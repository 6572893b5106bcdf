"""``hybrid-adaptive`` as the cell and Python call it (layer 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import ControllerConfig
from polish_sim.control.adaptive.ahead import forget, no_ahead, pack_ahead
from polish_sim.control.adaptive.feed import followable_share
from polish_sim.control.adaptive.gains import adaptive_gains
from polish_sim.control.adaptive.law import AHEAD_AT, HYBRID_AT, hybrid_adaptive_law, step_hybrid_adaptive
from polish_sim.control.adaptive.path_gains import abilities, path_gains
from polish_sim.control.compiled import CompiledController
from polish_sim.control.course import Course
from polish_sim.control.hybrid_laws import gains_of

Array = NDArray[np.float64]


class AdaptiveController(CompiledController):
    """The composed laws, and what lies ahead behind their memory.

    Args:
        config: Gains and the laws that are on.

    Raises:
        ConfigError: If it names a law that does not exist.
    """

    def __init__(self, config: ControllerConfig) -> None:
        laws = config.adaptive
        gains = np.concatenate([[0.0], gains_of(config), adaptive_gains(laws), path_gains(laws)])
        super().__init__(gains, AHEAD_AT - HYBRID_AT, step_hybrid_adaptive, hybrid_adaptive_law)
        self._abilities = abilities(laws)
        self._lay_out(no_ahead())

    def prepare(self, course: Course) -> None:
        """Take in what lies ahead on the path."""
        self._lay_out(pack_ahead(course, followable_share(course, self._abilities)))

    def reset(self, cycle_s: float) -> None:
        """Forget everything but what lies ahead."""
        self.context[HYBRID_AT:AHEAD_AT] = 0.0
        forget(self.context[AHEAD_AT:])

    def _lay_out(self, ahead: Array) -> None:
        self.context = np.concatenate([self.context[:AHEAD_AT], ahead])
        self.context[0] = len(self.context)


def hybrid_adaptive(config: ControllerConfig) -> AdaptiveController:
    """The controller for a real polishing cell, of laws that `controller.adaptive.laws` can leave out one by one.

    Raises:
        ConfigError: If it names a law that does not exist.
    """
    return AdaptiveController(config)
