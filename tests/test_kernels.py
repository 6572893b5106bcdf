"""Records of compiled state."""

from __future__ import annotations

from types import GenericAlias
from typing import Annotated

import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.kernels import Record


@pytest.mark.parametrize(
    "array", [Array, GenericAlias(np.ndarray, (np.float64,))], ids=["as here", "as numpy 2.5 writes it"]
)
def test_the_type_of_a_field_is_read_from_either_way_to_write_an_array(array: object) -> None:
    state = type("State", (Record,), {"__annotations__": {"p": Annotated[array, (3,)], "n": int}})
    assert state.dtype["p"] == np.dtype((np.float64, (3,)))
    assert state.dtype["n"] == np.int64
