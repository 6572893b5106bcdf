"""What all messages have in common: places, numbers and files of nearly the same name."""

import numpy as np

from polish_sim.errors import did_you_mean, near_file, number_text, place_in_mm


def test_places_numbers_and_names_that_are_nearly_right_are_written_as_people_do(tmp_path):
    assert place_in_mm(np.array([0.0125, -0.0, -0.0031416])) == "(12.5, 0, -3.14) mm"
    assert place_in_mm((12.3456789, -1e-9, 0.1)) == "(12345.68, 0, 100) mm"
    assert [number_text(x) for x in (60000.0, 0.0002, 1e-12, 2**63 - 1, -8.0)] == [
        "60000", "0.0002", "1e-12", "9223372036854775807", "-8",
    ]  # fmt: skip
    assert number_text(10**400) == "100000... (401 digits)"
    assert did_you_mean("Freeform", ["plate", "freeform"]) == " Did you mean 'freeform'?"
    assert did_you_mean("circle", ["arc", "force"]) == ""
    (tmp_path / "Part.STL").touch()
    assert near_file(tmp_path / "part.stl") == " Did you mean 'Part.STL'?"
    assert near_file(tmp_path / "gone" / "part.stl") == ""
    assert near_file(tmp_path / "Part.STL") == ""  # it is the file itself that cannot be read
    (tmp_path / "inf.stl").touch()
    assert near_file(tmp_path / "missing.stl") == ""  # only the ending is the same
