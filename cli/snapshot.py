"""The picture of the cell in the middle of a run."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Final

from polish_sim.cli.rendering import STILL, Picture, save_image

_EVERY_S: Final = 0.5


class Snapshot:
    """Remembers the joint positions on the way and renders the middle one when the run ends.

    Args:
        file: Where the PNG goes.
    """

    every_s = _EVERY_S

    def __init__(self, file: Path) -> None:
        self._file = file
        self._model: Any = None
        self._positions: list[Any] = []

    def __enter__(self) -> Snapshot:
        return self

    def take(self, model: Any, data: Any) -> None:
        """Remember one moment."""
        self._model = model
        self._positions.append(data.qpos.copy())

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        picture = Picture.opened(self._model, STILL) if self._positions and error is None else None
        if picture is None:
            return
        import mujoco

        data = mujoco.MjData(self._model)
        data.qpos[:] = self._positions[len(self._positions) // 2]
        mujoco.mj_forward(self._model, data)
        save_image(self._file, picture.render(data))
        picture.close()
