"""What went wrong in a user's own code, with the line of it (layer 7)."""

from __future__ import annotations

import sys
import traceback
from pathlib import Path


def tell_error(error: BaseException, file: str | Path | None) -> str:
    """An exception in one line: its kind, its message, and where in the user's file it came from.

    Args:
        error: What was raised.
        file: The user's file; None if it is not known.

    Returns:
        E.g. ``ValueError: negative gain (mine.py, line 12)``; without a place if none of its lines took part.
    """
    text = f"{type(error).__name__}: {' '.join(str(error).split())}"
    if file is None:
        return text
    own = Path(file).resolve()
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename).resolve() == own]
    return f"{text} ({Path(file).name}, line {frames[-1].lineno})" if frames else text


def file_of(thing: object) -> str | None:
    """The file a thing's class was written in, if it came from one."""
    return getattr(sys.modules.get(type(thing).__module__), "__file__", None)
