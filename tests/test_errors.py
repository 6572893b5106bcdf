"""What all messages have in common: places and lists of known names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from polish_sim.errors import (
    count_text,
    did_you_mean,
    leave_out,
    near_file,
    number_text,
    place_in_mm,
    unknown_name,
)


def test_a_place_is_written_in_millimetres_to_a_hundredth_as_options_take_it() -> None:
    assert place_in_mm(np.array([0.0125, -0.0, -0.0031416])) == "(12.5, 0, -3.14) mm"
    assert place_in_mm((12.3456789, -1e-9, 0.1)) == "(12345.68, 0, 100) mm"


def test_an_unknown_name_comes_with_the_known_ones_and_the_nearest_whatever_its_capitals() -> None:
    assert str(unknown_name("pattern", "spyral", ["spiral", "raster"])) == (
        "unknown pattern 'spyral'. Did you mean 'spiral'? Known: raster, spiral."
    )
    assert did_you_mean("Freeform", ["plate", "freeform"]) == " Did you mean 'freeform'?"
    assert did_you_mean("circle", ["arc", "force"]) == ""
    assert "Did you mean 'm'?" in str(unknown_name("unit", "Metre", ["m", "mm"], {"metre": "m"}))


def test_a_file_of_nearly_that_name_is_asked_back(tmp_path: Path) -> None:
    (tmp_path / "Part.STL").touch()
    assert near_file(tmp_path / "part.stl") == " Did you mean 'Part.STL'?"
    assert near_file(tmp_path / "gone" / "part.stl") == ""
    (tmp_path / "inf.stl").touch()
    assert near_file(tmp_path / "missing.stl") == ""  # only the ending is the same


def test_numbers_and_counts_are_written_as_people_do() -> None:
    assert [number_text(x) for x in (60000.0, 0.0002, 1e-12, 2**63 - 1, -8.0)] == [
        "60000", "0.0002", "1e-12", "9223372036854775807", "-8",
    ]  # fmt: skip
    assert number_text(10**400) == "100000... (401 digits)"
    assert (count_text(1, "seed"), count_text(2, "seed")) == ("1 seed", "2 seeds")
    assert leave_out(["--a"]) == "--a would change nothing: leave it out."
    assert leave_out(["--a", "--b"]) == "--a, --b would change nothing: leave them out."
