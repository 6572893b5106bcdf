"""Force controllers people know, to compare with: each differs from ``hybrid-pi`` along tool z only (layer 7)."""

from polish_sim.control.baselines.admittance import admittance
from polish_sim.control.baselines.force_mode import force_mode
from polish_sim.control.baselines.impedance_position import impedance_position

__all__ = ["admittance", "force_mode", "impedance_position"]
