"""Progress of one of several like pieces of work, told as progress of the whole (layer 9)."""

from __future__ import annotations

from typing import Any

from polish_sim.cell import Observer


class PartOf:
    """Passes on what happens in piece ``number`` of ``count``."""

    def __init__(self, observer: Observer, number: int, count: int) -> None:
        self.observer, self.number, self.count = observer, number, count
        self.frame_every_s = observer.frame_every_s

    def stage(self, text: str) -> None:
        """The whole is one stage."""

    def progress(self, done: float, total: float) -> None:
        """Share of the whole."""
        self.observer.progress(self.number + done / total, self.count)

    def frame(self, model: Any, data: Any) -> None:
        """Passed on."""
        self.observer.frame(model, data)
