"""Law ``stiffness``: dF/dz from the tool's own motion while it lands, stiff until proven soft (layer 7).

Least squares of force over travel, both as the sensor shows them, with a memory of 50 ms. What is used is the upper
end of the estimate, k + 2 sigma / sqrt(sum (z - mean)^2): wide at the first touch, when the travel says nothing yet,
and within a fraction of a millimetre at the slope itself. A spring taken for stiffer than it is makes the loop slow,
never unstable. Only motion the controller made itself counts (faster than 4 mm/s, while it lands): later, travel
follows the part and its slope against the force says nothing about springs.
"""

from __future__ import annotations

import math

from numba import njit

from polish_sim.control.adaptive.gains import AdaptiveGains
from polish_sim.control.adaptive.memory import (
    AIR_VARIANCE,
    CO_SPREAD,
    MEAN_FORCE,
    MEAN_PATH,
    SPREAD,
    WEIGHT,
    PressMemory,
)

_MEMORY = 0.05  # [s]
_EXCITED = 0.004  # slower motion teaches nothing [m/s]
_CONFIDENCE = 2.0  # standard deviations
_SOFTEST, _STIFFEST = 0.1, 10.0  # of the nominal stiffness


@njit(cache=True)
def restart_fit(memory: PressMemory, path: float, force: float) -> None:
    """Forget everything but where the tool touched: ``path`` [m], ``force`` [N], as sensed."""
    fit = memory.fit
    fit[WEIGHT], fit[MEAN_PATH], fit[MEAN_FORCE], fit[SPREAD], fit[CO_SPREAD] = 0.0, path, force, 0.0, 0.0


@njit(cache=True)
def refine_stiffness(
    g: AdaptiveGains, memory: PressMemory, nominal: float, path: float, force: float, pressing: float, dt: float
) -> float:
    """Take in one reading.

    Args:
        g: Gains.
        memory: The sums.
        nominal: Springs as drawn [N/m].
        path: Travel as sensed [m].
        force: Reading without the tool's own forces [N].
        pressing: Present speed into the part [m/s].
        dt: Control cycle [s].

    Returns:
        Upper end of what the stiffness may be [N/m], within 0.1 to 10 times the nominal one, and while the
        travel says nothing ``stiff_first`` times it.
    """
    fit = memory.fit
    if abs(pressing) > _EXCITED:
        kept = math.exp(-dt / _MEMORY)
        weight = kept * fit[WEIGHT] + 1.0
        share = (weight - 1.0) / weight
        dz, df = path - fit[MEAN_PATH], force - fit[MEAN_FORCE]
        fit[WEIGHT] = weight
        fit[MEAN_PATH] += dz / weight
        fit[MEAN_FORCE] += df / weight
        fit[SPREAD] = kept * (fit[SPREAD] + share * dz * dz)
        fit[CO_SPREAD] = kept * (fit[CO_SPREAD] + share * dz * df)
    spread = fit[SPREAD] + 1e-16
    # A low-passed reading is worth a quarter of a fresh one.
    sigma = 2.0 * max(math.sqrt(memory.air[AIR_VARIANCE]), 0.2)
    slope, doubt = fit[CO_SPREAD] / spread, _CONFIDENCE * sigma / math.sqrt(spread)
    upper = min(slope + doubt, max(g.stiff_first * nominal, slope))
    return min(max(upper, _SOFTEST * nominal), _STIFFEST * nominal)
