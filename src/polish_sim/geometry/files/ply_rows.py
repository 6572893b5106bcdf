"""Walk the rows of a PLY table, whose lists make them differ in length (bytes or numbers -> places of list items)."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def walk_bytes(raw, at, rows, count_sizes, item_sizes, signed, big_endian, listed):  # type: ignore[no-untyped-def]
    """Find the items of one list in every row of a binary table.

    Args:
        raw: The file's body, uint8 (n,).
        at: Where the table begins.
        rows: Number of rows.
        count_sizes: Bytes of each property's list length, 0 for a single value, shape (p,).
        item_sizes: Bytes of each property's items, shape (p,).
        signed: Properties whose list length has a sign, shape (p,).
        big_endian: Byte order.
        listed: The property whose items are wanted, or -1.

    Returns:
        Place of each row's first item, their number, both (rows,) or (0,), and the end of the table; end is -1
        where the file is too short or a length is negative.
    """
    kept = rows if listed >= 0 else 0
    starts, sizes = np.empty(kept, np.int64), np.empty(kept, np.int64)
    if not count_sizes.any():
        end = at + rows * item_sizes.sum()
        return starts, sizes, end if end <= len(raw) else -1
    for row in range(rows):
        for p in range(len(count_sizes)):
            count = np.int64(1)
            if count_sizes[p] > 0:
                if at + count_sizes[p] > len(raw):
                    return starts, sizes, -1
                count = np.int64(0)
                for k in range(count_sizes[p]):
                    byte = raw[at + k] if big_endian else raw[at + count_sizes[p] - 1 - k]
                    count = 256 * count + np.int64(byte)
                if signed[p] and count >= 1 << (8 * count_sizes[p] - 1):
                    return starts, sizes, -1
                at += count_sizes[p]
            if p == listed:
                starts[row], sizes[row] = at, count
            at += count * item_sizes[p]
            if at > len(raw):
                return starts, sizes, -1
    return starts, sizes, at


@njit(cache=True, error_model="numpy")
def walk_numbers(numbers, at, rows, is_list, listed):  # type: ignore[no-untyped-def]
    """As `walk_bytes` for a table written as numbers, float64 (n,)."""
    kept = rows if listed >= 0 else 0
    starts, sizes = np.empty(kept, np.int64), np.empty(kept, np.int64)
    if not is_list.any():
        end = at + rows * len(is_list)
        return starts, sizes, end if end <= len(numbers) else -1
    for row in range(rows):
        for p in range(len(is_list)):
            count = np.int64(1)
            if is_list[p]:
                if at >= len(numbers) or not 0.0 <= numbers[at] <= len(numbers):
                    return starts, sizes, -1
                count = np.int64(numbers[at])
                at += 1
            if p == listed:
                starts[row], sizes[row] = at, count
            at += count
            if at > len(numbers):
                return starts, sizes, -1
    return starts, sizes, at
