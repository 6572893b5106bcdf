"""``hybrid-adaptive`` as the cell and Python call it (layer 7)."""

from __future__ import annotations

import numpy as np

from polish_sim.config import ControllerConfig
from polish_sim.control.adaptive.gains import adaptive_gains
from polish_sim.control.adaptive.law import CONTEXT_SIZE, HYBRID_AT, hybrid_adaptive_law, step_hybrid_adaptive
from polish_sim.control.compiled import CompiledController
from polish_sim.control.hybrid_laws import gains_of


def hybrid_adaptive(config: ControllerConfig) -> CompiledController:
    """The controller for a real polishing cell: laws composed, each ablatable by ``controller.adaptive.laws``.

    Raises:
        ConfigError: If it names a law that does not exist.
    """
    gains = np.concatenate([[CONTEXT_SIZE], gains_of(config), adaptive_gains(config.adaptive)])
    return CompiledController(gains, CONTEXT_SIZE - HYBRID_AT, step_hybrid_adaptive, hybrid_adaptive_law)
