"""Controller ``hybrid-adaptive``: named laws, each a small file, composed in ``law``."""

from polish_sim.control.adaptive.law import hybrid_adaptive

__all__ = ["hybrid_adaptive"]
