"""What all messages have in common: places and lists of known names."""

from __future__ import annotations

import numpy as np

from polish_sim.errors import place_in_mm, unknown_name


def test_a_place_is_written_in_millimetres_to_a_hundredth_as_options_take_it() -> None:
    assert place_in_mm(np.array([0.0125, -0.0, -0.0031416])) == "(12.5, 0, -3.14) mm"
    assert place_in_mm((12.3456789, -1e-9, 0.1)) == "(12345.68, 0, 100) mm"


def test_an_unknown_name_comes_with_the_known_ones() -> None:
    assert str(unknown_name("pattern", "spyral", ["spiral", "raster"])) == (
        "unknown pattern 'spyral'. Known: raster, spiral."
    )
