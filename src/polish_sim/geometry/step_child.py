"""Triangulate a STEP file in a process of its own: a CAD kernel may hang or crash on a broken file.

Arguments: the file, the file for the triangles, chord error [mm], angle [rad], most memory [bytes].
"""

import sys


def triangulate_step(source: str, target: str, chord_mm: float, angle_rad: float, memory: int) -> None:
    """Write the triangles of a STEP file [m], shape (m, 3, 3), as a npy file."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    except (ImportError, ValueError, OSError):
        pass  # Windows and macOS have no such limit; that of time stays
    import numpy as np
    import trimesh

    with open(source, "rb") as file:
        scene = trimesh.load_scene(file, file_type="step", tol_linear=chord_mm, tol_angular=angle_rad)
    np.save(
        target,
        np.asarray(scene.to_mesh().triangles if scene.geometry else np.empty((0, 3, 3)), dtype=np.float64),
    )


if __name__ == "__main__":
    triangulate_step(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]), int(sys.argv[5]))
