"""Says when kernels are being compiled: at the first start of each kind of run, and only then."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from numba.core import event

FIRST_START: Final = (
    "compiling kernels: once for each kind of run, a minute to three of one processor, longer where others use it"
)


class _Told(event.Listener):  # type: ignore[misc]
    """Hears of functions that are not in the cache."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say, self._said = say, False

    def on_start(self, _: Any) -> None:
        """Tell of the first."""
        if not self._said:
            self._say(FIRST_START)
        self._said = True

    def on_end(self, _: Any) -> None:
        """Ignore."""


@contextmanager
def compiling_told(say: Callable[[str], None]) -> Iterator[None]:
    """Say one line when the block compiles a kernel; nothing when all come from the cache."""
    with event.install_listener("numba:compile", _Told(say)):
        yield
