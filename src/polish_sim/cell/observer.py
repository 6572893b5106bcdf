"""Who may look on while a run goes: progress bars, viewers, video writers (layer 8a)."""

from __future__ import annotations

from typing import Any, Protocol


class Observer(Protocol):
    """What the library tells about long work; it never prints itself."""

    frame_every_s: float
    """Simulated time between calls of ``frame`` [s]."""

    def stage(self, text: str) -> None:
        """A new stage of the work begins, e.g. ``"simulate"``."""

    def progress(self, done: float, total: float) -> None:
        """How far the present stage is."""

    def frame(self, model: Any, data: Any) -> None:
        """The cell's model and data at this instant; not to be changed."""


class Silent:
    """Looks on and says nothing."""

    frame_every_s = 0.2

    def stage(self, text: str) -> None:
        """Ignore."""

    def progress(self, done: float, total: float) -> None:
        """Ignore."""

    def frame(self, model: Any, data: Any) -> None:
        """Ignore."""
