"""The modes of hand guiding as shares of what is compensated: data, one row a mode (layer 7)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from polish_sim.config import GuideConfig
from polish_sim.control.hand_guiding.law import GuidingGains
from polish_sim.errors import unknown_name


class Mode(NamedTuple):
    """What a mode compensates: 1 as the scenario says, 0 not at all."""

    text: str
    gravity: float = 0.0
    friction: float = 0.0
    inertia: float = 0.0
    assist: float = 0.0


MODES: Final[Mapping[str, Mode]] = MappingProxyType(
    {
        "none": Mode("nothing: the hand carries the arm"),
        "gravity": Mode("gravity", 1.0),
        "classical": Mode("gravity and friction (paper 3)", 1.0, 1.0),
        "inertia": Mode("and inertia (paper 3, improved)", 1.0, 1.0, 1.0),
        "assist": Mode("and start-up assist", 1.0, 1.0, 1.0, 1.0),
    }
)


def gains_of(mode: str, guide: GuideConfig, dt: float) -> GuidingGains:
    """The law's gains in a mode.

    Args:
        mode: A name in `MODES`.
        guide: Shares and filters.
        dt: Control period [s].

    Raises:
        InputError: There is no such mode; lists the known ones.
    """
    if mode not in MODES:
        raise unknown_name("mode", mode, MODES)
    m = MODES[mode]
    return GuidingGains(
        gravity=m.gravity,
        tare=guide.tare,
        coulomb=m.friction * guide.coulomb_share,
        viscous=m.friction * guide.viscous_share,
        inertia=m.inertia * guide.inertia_share,
        assist=m.assist * guide.assist_share,
        sign_speed=guide.sign_speed_rad_s,
        threshold=guide.assist_threshold,
        onset=1.0 / guide.assist_memory_s,
        felt=m.assist * guide.hand_felt,
        acceleration_blend=1.0 - math.exp(-2.0 * math.pi * guide.acceleration_filter_hz * dt),
        observer=2.0 * math.pi * guide.observer_hz,
        encoder=guide.encoder_rad,
    )
