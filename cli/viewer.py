"""`--view`: look on in MuJoCo's own viewer while the run goes."""

from __future__ import annotations

import time
import warnings
from types import TracebackType
from typing import Any, Final

from polish_sim.cli import console

_EVERY_S: Final = 1.0 / 50.0


class Viewer:
    """Opens the viewer at the first moment and keeps the run no faster than real time."""

    every_s = _EVERY_S

    def __init__(self) -> None:
        self._window: Any = None
        self._failed = False
        self._ahead_of: float | None = None

    def __enter__(self) -> Viewer:
        return self

    def take(self, model: Any, data: Any) -> None:
        """Show one moment; closing the window lets the run go on without it."""
        if self._failed:
            return
        if self._window is None:
            self._open(model, data)
            return
        if not self._window.is_running():
            return
        self._window.sync()
        self._wait(data.time)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._window is not None:
            self._window.close()

    def _open(self, model: Any, data: Any) -> None:
        if not _has_display():
            self._failed = True
            console.note("no viewer: this machine has no display. The run goes on; --video writes a film without one.")
            return
        import mujoco.viewer

        self._window = mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)

    def _wait(self, simulated: float) -> None:
        now = time.monotonic()
        if self._ahead_of is None:
            self._ahead_of = now - simulated
        time.sleep(max(0.0, self._ahead_of + simulated - now))


def _has_display() -> bool:
    """Whether a window can be opened; MuJoCo's viewer ends the whole process where it cannot."""
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return bool(glfw.init())
