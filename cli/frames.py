"""Who can look at the moving cell: the viewer and the video share this protocol."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any, Protocol


class FrameSink(AbstractContextManager[Any], Protocol):
    """Takes moments of a simulation; a context manager that lives as long as the run."""

    every_s: float
    """Simulated time between frames [s]."""

    def take(self, model: Any, data: Any) -> None:
        """Take one moment; model and data are not to be changed."""
