"""The UR5e as the manufacturer publishes it and the tool as models/README.md describes it, built in Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

# a [m], d [m], alpha [rad] of each joint.
DH = [
    (0.0, 0.1625, np.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, np.pi / 2),
    (0.0, 0.0997, -np.pi / 2),
    (0.0, 0.0996, 0.0),
]
MASSES = [3.761, 8.058, 2.846, 1.37, 1.3, 0.365]
CENTRES = [
    (0.0, -0.02561, 0.00193),
    (0.2125, 0.0, 0.11336),
    (0.15, 0.0, 0.0265),
    (0.0, -0.0018, 0.01634),
    (0.0, 0.0018, 0.01634),
    (0.0, 0.0, -0.001159),
]
# ixx, iyy, izz, ixy, ixz, iyz at the centre of mass [kg m^2].
INERTIAS = [
    (0.00700210, 0.00648091, 0.00657286, 0.00000073, -0.00001053, 0.00049994),
    (0.01505885, 0.33388086, 0.33247207, -0.00005400, 0.00000563, -0.00000181),
    (0.00399632, 0.07879254, 0.07848510, -0.00001365, 0.00137272, -0.00000660),
    (0.00165491, 0.00135962, 0.00126279, -0.00000282, -0.00000438, 0.00010157),
    (0.00135617, 0.00127827, 0.00096614, -0.00000274, 0.00000444, -0.00005048),
    (0.00018694, 0.00018908, 0.00025756, 0.00000006, -0.00000017, -0.00000092),
]
TORQUE_LIMITS = [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]

# Solid cylinders along the tool axis: mass [kg], radius, first and second end, distance from the axis along x [m].
TOOL_MOUNT = [
    (0.30, 0.040, 0.000, 0.040, 0.0),
    (0.15, 0.040, 0.040, 0.052, 0.0),
    (1.15, 0.032, 0.052, 0.160, 0.0),
    (0.10, 0.012, 0.060, 0.090, 0.040),
]
HEAD = [(0.18, 0.010, 0.110, 0.196, 0.0), (0.12, 0.025, 0.196, 0.220, 0.0)]


def cylinders(parts):
    """Inertia of solid cylinders along z, about the flange."""
    total = pin.Inertia.Zero()
    for mass, radius, first, second, x in parts:
        centre = pin.SE3(np.eye(3), np.array([x, 0.0, (first + second) / 2]))
        total += centre.act(pin.Inertia.FromCylinder(mass, radius, second - first))
    return total


def link_inertia(i):
    """Inertia of link i in its DH frame."""
    xx, yy, zz, xy, xz, yz = INERTIAS[i]
    return pin.Inertia(MASSES[i], np.array(CENTRES[i]), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def build_model():
    """Pinocchio model of the arm with the spindle and the sliding head (7 joints, the last one the head's)."""
    model = pin.Model()
    parent, placement = 0, pin.SE3.Identity()
    for i, (a, d, alpha) in enumerate(DH):
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"joint_{i + 1}")
        placement = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0.0, d]))
        model.appendBodyToJoint(parent, link_inertia(i), placement)
    model.appendBodyToJoint(parent, cylinders(TOOL_MOUNT), placement)
    # The head slides against the tool axis: its joint frame is the flange turned half a turn about x.
    turned = placement * pin.SE3(pin.utils.rotate("x", np.pi), np.zeros(3))
    head = model.addJoint(parent, pin.JointModelPZ(), turned, "head")
    model.appendBodyToJoint(head, cylinders(HEAD), pin.SE3(pin.utils.rotate("x", np.pi), np.zeros(3)))
    return model
