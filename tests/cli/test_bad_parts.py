"""Parts that cannot be polished: one message that says what, where and what to do, and nothing written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from polish_sim.models import workpiece_path
from tests.cli.conftest import Tool


def spoiled(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    def write(file: Path) -> None:
        file.write_bytes(change(workpiece_path("plate").read_bytes()))

    return write


def exported(mesh: trimesh.Trimesh) -> Callable[[Path], None]:
    return lambda file: file.write_bytes(mesh.export(file_type="stl"))


def with_nan(data: bytes) -> bytes:
    """The first facet's first vertex is not a number: 80 bytes header, 4 count, 12 normal."""
    return data[:96] + np.full(3, np.nan, "<f4").tobytes() + data[108:]


def box(*extents: float, shift: float = 0.0) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents).subdivide().subdivide()
    return mesh.apply_translation([shift, 0.0, 0.0])


def moebius_strip() -> trimesh.Trimesh:
    """A band of 30 mm width whose ends are joined with half a turn: it has no outside."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    across = np.stack([np.cos(0.5 * angle) * np.cos(angle), np.cos(0.5 * angle) * np.sin(angle), np.sin(0.5 * angle)])
    middle = 80.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    points = np.concatenate([middle - 15.0 * across, middle + 15.0 * across], axis=1).T
    low = np.arange(60)
    low_next, high_next = np.append(low[1:], 60), np.append(low[1:] + 60, 0)
    faces = np.concatenate([np.stack([low, low_next, low + 60], 1), np.stack([low_next, high_next, low + 60], 1)])
    return trimesh.Trimesh(points, faces, process=False)


BAD: dict[str, tuple[Callable[[Path], None], str]] = {
    "missing": (lambda file: None, "bad.stl"),
    "empty": (lambda file: file.write_bytes(b"") and None, "bad.stl"),
    "truncated": (spoiled(lambda data: data[: len(data) // 2]), "bad.stl"),
    "garbage": (lambda file: file.write_text("this is no mesh, but text\n" * 20) and None, "bad.stl"),
    "nan": (spoiled(with_nan), "bad.stl"),
    "flat": (exported(trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False)), "bad.stl"),
    "one_sided": (exported(moebius_strip()), "one-sided"),
    "metres": (exported(box(1.2, 1.2, 0.2)), "--units m"),
    "micrometres": (exported(box(150e3, 150e3, 20e3)), "unit"),
    "thin": (exported(box(150, 1.5, 1.5)), "pad"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_part_is_one_message_with_code_2_and_nothing_written(polish_sim: Tool, tmp_path: Path, name: str) -> None:
    write, said = BAD[name]
    write(tmp_path / "bad.stl")
    before = sorted(path.name for path in tmp_path.iterdir())
    code, out, err = polish_sim("run", "surface", "--part", "bad.stl")
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert (code, out) == (2, ""), err
    assert len(errors) == 1
    assert said in errors[0]
    assert "Traceback" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_part_out_of_reach_names_the_first_bad_point_and_what_to_do(polish_sim: Tool, tmp_path: Path) -> None:
    code, _, err = polish_sim("run", "surface", "--part", "sphere_50", "--part-pose", "0,-950,400,0,0,0")
    assert code == 2
    assert "mm of the part" in err
    assert "--part-pose" in err
    assert list(tmp_path.iterdir()) == []
