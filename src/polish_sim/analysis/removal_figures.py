"""The figures of a removal map: how much, how even, what is polished too little and too much (layer 8c)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.removal import RemovalMap

Array = NDArray[np.float64]

UNDER, OVER = 0.5, 1.5
"""Under- and over-polished is what lost less (more) than this many times the mean."""
RELATIVE: Final = ("removal_cv", "removal_p5", "removal_p95", "removal_max")


def measure_removal(removal: RemovalMap) -> dict[str, float]:
    """Measure a map over the region's area.

    Args:
        removal: The map.

    Returns:
        exposure_nm: pressure x sliding speed integrated over the region and time; exposure_mean_n_m: the
        same per area; removal_volume_m3, removal_mean_m, removal_max_m: undefined without a wear coefficient;
        removal_cv: standard deviation over mean; removal_p5, removal_p95, removal_max: over the mean, by area;
        under_polished_share, over_polished_share, unpolished_share: of the area, with less than 0.5 means, with more
        than 1.5, with nothing at all; removal_elsewhere: exposure that went to surfaces beside the region, over the
        region's; removal_unplaced: share of the force for which the pad touched no node; pressure_field_ratio: force
        of the pressure field as it was computed over the exact one.
    """
    shares = removal.areas / removal.areas.sum()
    total = float(removal.areas @ removal.exposure)
    depth = removal.preston_1_pa if removal.absolute else math.nan
    out = {
        "exposure_nm": total,
        "exposure_mean_n_m": removal.mean,
        "removal_volume_m3": depth * total,
        "removal_mean_m": depth * removal.mean,
        "removal_max_m": depth * float(removal.exposure.max()),
        **dict.fromkeys(RELATIVE, math.nan),
        "under_polished_share": float(shares[removal.exposure < UNDER * removal.mean].sum()),
        "over_polished_share": float(shares[removal.exposure > OVER * removal.mean].sum()),
        "unpolished_share": float(shares[removal.exposure <= 0.0].sum()),
        "removal_elsewhere": removal.elsewhere_nm / total if total > 0.0 else math.nan,
        "removal_unplaced": removal.unplaced_share,
        "pressure_field_ratio": removal.field_ratio,
    }
    return out | _spread(removal.relative, shares) if total > 0.0 else out


def _spread(relative: Array, shares: Array) -> dict[str, float]:
    order = np.argsort(relative)
    below = np.cumsum(shares[order]) - 0.5 * shares[order]
    low, high = np.interp([0.05, 0.95], below, relative[order])
    deviation = math.sqrt(float(shares @ (relative - 1.0) ** 2))
    return dict(zip(RELATIVE, (deviation, float(low), float(high), float(relative.max())), strict=True))
