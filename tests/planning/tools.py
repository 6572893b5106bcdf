"""The tool as solids of the robot's model, to hold against a part: nothing of the planner is used."""

from functools import cache

import manifold3d
import mujoco
import numpy as np
import trimesh

from polish_sim.arrays import plane_axes
from polish_sim.models import robot_model_path
from tests.cell.cells import drawn_vertices

HEAD_SINKS_M = 20.0 / (20000.0 / 3.0)
"""What the head's spring yields at 20 N: all behind the pad is that much nearer to the part."""


def solid(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """A closed mesh as a solid [m]."""
    vertices, faces = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32)
    return manifold3d.Manifold(manifold3d.Mesh(vertices, faces))


@cache
def bodies_behind_pad() -> tuple[tuple[str, manifold3d.Manifold], ...]:
    """Convex hulls of shaft, spindle and sensor in the tool frame turned over, z from part to tool [m]."""
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tool = data.site("tool")
    R_tool_up = tool.xmat.reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
    found = []
    for name in ("head_shaft", "spindle_housing", "spindle_trim", "sensor_body", "link_6_shell"):
        geom = model.geom(name)
        if geom.type[0] == mujoco.mjtGeom.mjGEOM_MESH:
            in_base = drawn_vertices(model, data, geom.id)
        else:
            solid = trimesh.creation.cylinder(geom.size[0], 2.0 * geom.size[1], sections=48)
            in_base = solid.vertices @ data.geom_xmat[geom.id].reshape(3, 3).T + data.geom_xpos[geom.id]
        hull = manifold3d.Manifold.hull_points((in_base - tool.xpos) @ R_tool_up)
        found.append((name, hull.translate((0.0, 0.0, -HEAD_SINKS_M))))
    return tuple(found)


@cache
def room_behind_pad() -> manifold3d.Manifold:
    """Cylinders round the bodies behind the pad, few facets: if they are clear of a part, all bodies are."""
    cylinders, sides = [], 32
    for _, hull in bodies_behind_pad():
        x, y, z = hull.to_mesh().vert_properties[:, :3].T
        radius = float(np.hypot(x, y).max()) / np.cos(np.pi / sides)
        cylinder = manifold3d.Manifold.cylinder(float(np.ptp(z)), radius, circular_segments=sides)
        cylinders.append(cylinder.translate((0.0, 0.0, float(z.min()))))
    return manifold3d.Manifold.batch_boolean(cylinders, manifold3d.OpType.Add)


def volumes_in_part(path, part: trimesh.Trimesh, pad_radius, yields, apart=4e-3) -> dict[str, float]:
    """Largest volume each body of the tool shares with a part, a closed mesh in mm, along a path [mm^3]; the
    pad ``yields`` in contact [m], everywhere or at each point (n,); places looked at are ``apart`` [m]."""
    shape = solid(part.copy().apply_scale(1e-3))
    worst = dict.fromkeys(("pad", *(name for name, _ in bodies_behind_pad())), 0.0)
    yields = np.broadcast_to(yields, len(path.s))
    rows = np.unique(np.searchsorted(path.s, np.arange(0.0, path.s[-1], apart)))
    for row in rows:
        z = path.axes_work[row]
        place = np.column_stack([*plane_axes(z), z, path.positions_work[row]])
        low = float(yields[row]) if path.process[row] else 1e-3
        pad = manifold3d.Manifold.cylinder(0.022 - low, pad_radius, circular_segments=64)
        pad = pad.translate((0.0, 0.0, low))
        behind = not (room_behind_pad().transform(place) ^ shape).is_empty()
        for name, body in (("pad", pad), *(bodies_behind_pad() if behind else ())):
            shared = (body.transform(place) ^ shape).volume() * 1e9
            worst[name] = max(worst[name], shared)
    return worst


def reached_share(figures) -> float:
    """Share that is polished of what the tool reaches."""
    return figures["polished_area_m2"] / (figures["region_area_m2"] - figures["unreachable_area_m2"])
