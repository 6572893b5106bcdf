"""Ctrl-C between two chunks of steps, not in the middle of one: what was recorded stays whole (layer 8a)."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType


@dataclass
class Interrupt:
    """Whether the user has asked to stop."""

    seen: bool = False


@contextmanager
def interrupts_noted() -> Iterator[Interrupt]:
    """Note the first Ctrl-C instead of raising it; a second one raises as ever.

    Raised, it could land inside a callback from compiled code, where Python can only print and drop it. Outside the
    main thread, or where somebody else handles or ignores the signal, everything stays as it is.
    """
    interrupt = Interrupt()
    before = signal.getsignal(signal.SIGINT)
    ours = threading.current_thread() is threading.main_thread() and before is signal.default_int_handler

    def note(_number: int, _frame: FrameType | None) -> None:
        interrupt.seen = True
        signal.signal(signal.SIGINT, before)

    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield interrupt
    finally:
        if ours:
            signal.signal(signal.SIGINT, before)
