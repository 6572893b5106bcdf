"""The shipped controllers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from polish_sim.config import ControllerConfig
from polish_sim.control.hybrid import hybrid_pi, hybrid_pi_position, position
from polish_sim.control.signals import CompiledController
from polish_sim.lazy import FunctionOnUse

CONTROLLERS: Mapping[str, Callable[[ControllerConfig], CompiledController]] = MappingProxyType(
    {
        "hybrid-pi": hybrid_pi,
        "hybrid-adaptive": FunctionOnUse("polish_sim.control.adaptive.law", "hybrid_adaptive"),
        "hybrid-pi-position": hybrid_pi_position,
        "position": position,
        "admittance": FunctionOnUse("polish_sim.control.baselines", "admittance"),
        "impedance-position": FunctionOnUse("polish_sim.control.baselines", "impedance_position"),
        "force-mode": FunctionOnUse("polish_sim.control.baselines", "force_mode"),
    }
)
