"""Hand guiding: torques that make an arm light in the hand, and the watch over it; no MuJoCo (layer 7)."""

from polish_sim.control.hand_guiding.guard import GUARDS, GuidingLimits, fade_out, watch_guiding
from polish_sim.control.hand_guiding.law import (
    Belief,
    GuidingGains,
    GuidingMemory,
    build_memory,
    guide_by_hand,
    read_encoders,
)
from polish_sim.control.hand_guiding.modes import MODES, Mode, gains_of

__all__ = [
    "GUARDS",
    "MODES",
    "Belief",
    "GuidingGains",
    "GuidingLimits",
    "GuidingMemory",
    "Mode",
    "build_memory",
    "fade_out",
    "gains_of",
    "guide_by_hand",
    "read_encoders",
    "watch_guiding",
]
