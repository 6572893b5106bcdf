"""The force loop of the cell as a linear model, step by step as the cell computes it.

Along the tool axis, small motions about a state of contact::

    command -> latency -> joint servos -> arm x --head spring, damper--> head y --pad--> F
    F + mount's and head's inertia -> low-pass -> latency -> reading

The model is discrete at the control cycle and takes the cell's own order of computing (semi-implicit steps, forces
explicit, damping implicit), so that borders of stability come out of its eigenvalues exactly, delays included.
Friction of the joints is not linear; ``Arm.drag`` can stand for it at one amplitude.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.config import Scenario

Complex = NDArray[np.complex128]


class Arm(NamedTuple):
    """The arm along the tool axis, as one mass on its servos; the numbers are those of ``force``'s pose.

    Reduced from the compiled model's six joints (mass matrix, kp and kv of the servos): velocity and felt inertia
    agree with them within 5% from 1 to 150 Hz (1.5% rms); a chirp in the cell agrees with the six joints within 1%.
    """

    mass: float = 8.26  #: What the arm and the tool mount weigh along the tool axis [kg]
    omega: float = 213.0  #: Servos: sqrt(kp / inertia) [rad/s]
    damping: float = 0.976  #: Servos: damping ratio [-]
    mount_mass: float = 1.7  #: What hangs on the sensor before the head's spring [kg]
    drag: float = 0.0  #: Friction of the joints as a damper [N s/m]

    @property
    def stiffness(self) -> float:
        """Of the servos at the tool [N/m]."""
        return self.mass * self.omega**2

    @property
    def servo_damping(self) -> float:
        """Of the servos at the tool [N s/m]."""
        return 2.0 * self.damping * self.omega * self.mass


class Setup(NamedTuple):
    """What the loop consists of besides its control law."""

    arm: Arm
    head_stiffness: float  #: [N/m]
    head_damping: float  #: [N s/m]
    head_mass: float  #: [kg]
    pad_stiffness: float  #: [N/m]
    pad_damping: float  #: Hunt-Crossley a F of f = k d (1 + a d_dot) about the force F [N s/m]
    dt: float  #: Control cycle and physics step [s]
    command_steps: int  #: From the law to the servos
    sensor_steps: int  #: From the low-passed sample to the reading
    sensor_blend: float  #: Weight of a new sample in the sensor's low-pass [-]

    @property
    def stiffness(self) -> float:
        """Head and pad in series [N/m]."""
        return 1.0 / (1.0 / self.head_stiffness + 1.0 / self.pad_stiffness)


def setup_of(scenario: Scenario, arm: Arm | None = None) -> Setup:
    """The force loop of a scenario, the whole pad touching a plane; law and sensor at the physics' rate.

    ``arm``: in its pose, that of ``force`` if not given.
    """
    head, pad, sensor, dt = scenario.head, scenario.pad, scenario.sensor, scenario.simulation.timestep_s
    return Setup(
        arm or Arm(),
        head.stiffness_n_m * head.spring_scale,
        head.damping_n_s_m,
        head.mass_kg,
        pad.stiffness_n_m * head.spring_scale,
        pad.damping_s_m * scenario.process.contact_force_n,
        dt,
        round(scenario.robot.command_latency_s / dt),
        max(0, round(sensor.latency_s / dt) - 1),
        1.0 - math.exp(-2.0 * math.pi * sensor.bandwidth_hz * dt) if sensor.bandwidth_hz else 1.0,
    )


class Plant(NamedTuple):
    """s' = A s + B a with the command a acting in this step [m/s]; outputs before the step."""

    A: Array  #: Shape (7, 7)
    B: Array  #: Shape (7,)
    reading: Array  #: Row of the sensor's newest low-passed sample [N], shape (7,)
    velocity: Array  #: Row of the tool's velocity [m/s], shape (7,)
    position: Array  #: Row of the tool's place along its axis [m], shape (7,)
    force: Array  #: Row of the exact contact force [N], shape (7,)


def build_plant(setup: Setup) -> Plant:
    """The cell's step along the tool axis as matrices.

    States: arm x, head y [m], their velocities [m/s], commanded place [m], the engine's last force at the sensor [N]
    and its low-passed value [N].
    """
    arm, h = setup.arm, setup.dt
    k, c, kp, cp = setup.head_stiffness, setup.head_damping, setup.pad_stiffness, setup.pad_damping
    K, D = arm.stiffness, arm.servo_damping
    contact = np.array([0.0, kp, 0.0, cp, 0.0, 0.0, 0.0])
    # Forces on arm and head from the state; the command moves the servos' goal before they pull.
    pull = np.array([[-K - k, k, -D - arm.drag - c, c, K, 0.0, 0.0], [k, -k, c, -c, 0.0, 0.0, 0.0] - contact])
    pull_command = np.array([K * h + D, 0.0])
    mass = np.diag([arm.mass, setup.head_mass])
    implicit = mass + h * np.array([[D + arm.drag + c, -c], [-c, c]])
    step = h * np.linalg.inv(implicit)
    # Inertia felt by the sensor, of the motion the forces lead to.
    felt = np.array([arm.mount_mass, setup.head_mass]) @ step / h
    A, B = np.eye(7), np.zeros(7)
    A[2:4] += step @ pull
    B[2:4] = step @ pull_command
    A[0:2] += h * A[2:4]
    A[0, 0], A[1, 1] = 1.0 + h * A[2, 0], 1.0 + h * A[3, 1]
    B[0:2] = h * B[2:4]
    B[4] = h
    A[5] = contact + felt @ pull
    B[5] = felt @ pull_command
    A[6, 6], A[6, 5] = 1.0 - setup.sensor_blend, setup.sensor_blend
    unit = np.eye(7)
    return Plant(A, B, A[6].copy(), unit[2], unit[0], contact)


def plant_response(plant: Plant, row: Array, z: Complex) -> Complex:
    """Transfer from the acting command to an output at points z of the complex plane, shape (n,)."""
    systems = z[:, None, None] * np.eye(len(plant.B)) - plant.A
    states = np.linalg.solve(systems, np.broadcast_to(plant.B[:, None], (len(z), len(plant.B), 1)))
    return states[:, :, 0] @ row


# Control laws of the force loop as linear systems: by formula, or measured on the law itself.


class LinearLaw(Protocol):
    """Speed along the tool axis that a law answers to a small change of what it reads, at points z."""

    def by_force(self, z: Complex) -> Complex:
        """Of the force reading [m/(s N)]."""

    def by_motion(self, z: Complex) -> Complex:
        """Of the tool's velocity, its place moving with it [-]."""
