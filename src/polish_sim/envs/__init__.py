"""Gymnasium environments of the cell: ``PolishForce-v1`` and ``PolishSurface-v1``, registered by this import.

``gymnasium.make("polish_sim.envs:PolishForce-v1")`` imports it by itself. Needs the extra ``gym``.
"""

from __future__ import annotations

from polish_sim.errors import needed

gymnasium = needed("gymnasium", "polish_sim.envs needs Gymnasium", "gym")

TASKS = {"PolishForce-v1": "force", "PolishSurface-v1": "surface"}

for _name, _task in TASKS.items():
    gymnasium.register(
        _name,
        entry_point="polish_sim.envs.env:PolishEnv",
        kwargs={"task": _task},
    )
