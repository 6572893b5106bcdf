"""The same way in more time (Schedule -> Schedule)."""

from __future__ import annotations

import numpy as np

from polish_sim.motion.smoothing.schedule import Schedule


def stretched(schedule: Schedule, factor: float) -> Schedule:
    """Pass a schedule uniformly slower: speeds fall by the factor, accelerations by its square, jerks by its cube.

    Args:
        schedule: The schedule.
        factor: At least 1.

    Returns:
        The schedule that takes ``factor`` times as long.
    """
    powers = factor ** -np.arange(4.0)
    return schedule._replace(
        starts=schedule.starts * factor,
        durations=schedule.durations * factor,
        coefficients=schedule.coefficients * powers,
        end=schedule.end * factor,
    )
