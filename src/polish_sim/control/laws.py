"""The shipped controllers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from polish_sim.config import ControllerConfig
from polish_sim.control.adaptive import hybrid_adaptive
from polish_sim.control.baselines import admittance, force_mode, impedance_position
from polish_sim.control.hybrid import gains_of, hybrid_pi, hybrid_pi_position, position
from polish_sim.control.signals import LAW_SIGNATURE, CompiledController, Controller

__all__ = ["CONTROLLERS", "LAW_SIGNATURE", "CompiledController", "Controller", "gains_of"]

CONTROLLERS: Mapping[str, Callable[[ControllerConfig], CompiledController]] = MappingProxyType(
    {
        "hybrid-pi": hybrid_pi,
        "hybrid-adaptive": hybrid_adaptive,
        "hybrid-pi-position": hybrid_pi_position,
        "position": position,
        "admittance": admittance,
        "impedance-position": impedance_position,
        "force-mode": force_mode,
    }
)
