"""Gymnasium environments of the cell: ``PolishForce-v1`` and ``PolishSurface-v1``, registered by this import.

``gymnasium.make("polish_sim.envs:PolishForce-v1")`` imports it by itself. Needs the extra ``gym``.
"""

from __future__ import annotations

from polish_sim.errors import InputError

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise InputError("polish_sim.envs needs Gymnasium: pip install 'polish-sim[gym]'.") from error

TASKS = {"PolishForce-v1": "force", "PolishSurface-v1": "surface"}

for _name, _task in TASKS.items():
    gymnasium.register(
        _name,
        entry_point="polish_sim.envs.env:PolishEnv",
        kwargs={"task": _task},
    )
