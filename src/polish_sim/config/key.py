"""How a key of the scenario is declared: its default, meaning and allowed range (layer 1)."""

from __future__ import annotations

import math
from dataclasses import field
from typing import Any


def key(default: Any, text: str, low: float = -math.inf, high: float = math.inf, length: int = 0) -> Any:
    """Declare a field with its meaning (unit in brackets) and allowed range, both ends included; a list's length."""
    return field(default=default, metadata={"text": text, "low": low, "high": high, "length": length})
