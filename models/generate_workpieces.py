"""Write the workpieces' STL files (binary, mm, z up): ``python -m polish_sim.models.generate_workpieces``."""

from __future__ import annotations

from pathlib import Path

import trimesh

from polish_sim.models.parts import parts

MILLIMETRES = 1e3


def write_workpieces(folder: Path) -> list[Path]:
    """Write one STL file per shipped workpiece.

    Args:
        folder: Existing folder to write to.

    Returns:
        The files written.
    """
    paths = []
    for name, part in parts().items():
        vertices, faces = part.build()
        path = folder / f"{name}.stl"
        trimesh.Trimesh(vertices * MILLIMETRES, faces, process=False).export(path)
        paths.append(path)
    return paths


if __name__ == "__main__":
    for written in write_workpieces(Path(__file__).resolve().parent / "workpieces"):
        print(written)
