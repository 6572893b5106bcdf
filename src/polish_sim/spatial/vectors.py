"""Arrays of vectors (numpy only)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scale vectors (..., 3) to length one; zero stays zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def perpendicular(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """A unit vector square to each vector and to the coordinate axis it runs along least, shape (..., 3).

    It does not turn with the vectors: where a result must turn with the part, nothing may hang on the choice.
    """
    return unit(np.cross(vectors, np.eye(3)[np.abs(vectors).argmin(axis=-1)]))
