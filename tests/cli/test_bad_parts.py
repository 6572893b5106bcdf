"""Parts that cannot be polished: one message that says what, where and what to do, and nothing written."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

from polish_sim.models import workpiece_path
from tests.cli.conftest import Tool

BAD: dict[str, tuple[bytes | None, str]] = {
    "missing": (None, "bad.stl"),
    "cut short": (workpiece_path("plate").read_bytes()[:5000], "cut short"),
    "in metres": (trimesh.creation.box((1.2, 1.2, 0.2)).export(file_type="stl"), "--units m"),
    "thin": (trimesh.creation.box((150, 1.5, 1.5)).subdivide().subdivide().export(file_type="stl"), "pad"),
}
"""What the file holds, and what is said; tests/geometry/test_mesh_files.py has all ways to be bad."""


@pytest.mark.parametrize("name", BAD)
def test_a_bad_part_is_one_message_with_code_2_and_nothing_written(
    polish_sim: Tool, tmp_path: Path, name: str
) -> None:
    content, said = BAD[name]
    if content is not None:
        (tmp_path / "bad.stl").write_bytes(content)
    before = sorted(path.name for path in tmp_path.iterdir())
    code, out, err = polish_sim("run", "surface", "--part", "bad.stl")
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert (code, out) == (2, ""), err
    assert len(errors) == 1
    assert said in errors[0]
    assert "Traceback" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_part_out_of_reach_names_the_first_bad_point_and_what_to_do(
    polish_sim: Tool, tmp_path: Path
) -> None:
    code, _, err = polish_sim("run", "surface", "--part", "sphere_50", "--part-pose", "0,-950,400,0,0,0")
    assert code == 2
    assert "mm of the part" in err
    assert "--part-pose" in err
    assert list(tmp_path.iterdir()) == []
