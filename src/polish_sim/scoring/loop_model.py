"""The force loop of the cell as a linear model, step by step as the cell computes it; its margins.

Along the tool axis, small motions about a state of contact::

    command -> latency -> joint servos -> (rotors -> gears ->) arm x --head spring, damper--> head y --pad-->
    F F + mount's and head's inertia -> low-pass -> latency -> reading

The model is discrete at the control cycle and takes the cell's own order of computing (semi-implicit steps,
forces explicit, damping implicit), so that borders of stability come out of its eigenvalues exactly, delays
included. Coulomb friction is not linear and left out; the hysteresis of gears is taken at one amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.linear_arm import JointsAbout, joints_about, motion_matrices
from polish_sim.config import Scenario
from polish_sim.control.loops import low_pass_share

Complex = NDArray[np.complex128]


class LoopArm(NamedTuple):
    """The arm along the tool axis: n coordinates whose springs and dampers pull a tool, and a drive that
    moves them."""

    mass: Array  #: Without the head [kg or kg m^2], shape (n, n)
    stiffness: Array  #: Of gears and servos, shape (n, n)
    damping: Array  #: Of gears and servos, shape (n, n)
    drive: Array  #: Pull of the servos by the commanded place of the tool [N/m or N], shape (n,)
    drive_damping: Array  #: By its commanded speed, shape (n,)
    tool: Array  #: Place of the tool along its axis by the coordinates, shape (n,)
    host: Array  #: The same as the host has it from its encoders, shape (n,)
    path: Array  #: Coordinates by the place of the tool when all of the arm moves, shape (n,)
    lag: float = 1.0  #: Share of the way to the command that the servos' set points go in a step [-]
    mount_mass: float = 1.7  #: Mass the sensor carries before the head's spring [kg]


def one_mass(mount_mass: float = 1.7) -> LoopArm:
    """The ideal arm as one mass on its servos; the numbers are those of ``force``'s pose.

    Reduced from the compiled model's six joints (mass matrix, kp and kv of the servos): velocity and felt
    inertia agree with them within 5% from 1 to 150 Hz (1.5% rms); a chirp in the cell agrees with the six
    joints within 1%. ``mount_mass``: see `LoopArm`.
    """
    mass = 8.26  # of arm and tool mount along the tool axis [kg]
    omega, damping = 213.0, 0.976  # of the servos: sqrt(kp / inertia) [rad/s], damping ratio [-]
    k, d, unit = mass * omega**2, 2.0 * damping * omega * mass, np.ones(1)
    return LoopArm(
        mass * np.eye(1), k * np.eye(1), d * np.eye(1), k * unit, d * unit, unit, unit, unit, 1.0, mount_mass
    )


FORCE_POSE: Final = np.array([1.3009, -1.5168, 1.9295, -1.9834, -1.5708, 2.8717])
"""Joints in the experiment ``force`` [rad], shape (6,)."""


def elastic_arm(about: JointsAbout) -> LoopArm:
    """The arm with gears and rotors about a pose, loaded by its weight and the contact force.

    Hysteresis is a spring, as it is where gears hardly swing. Coulomb friction of the motors and of the pad
    is left out; it damps. The host's loops across the tool axis are left out, too, and so is the slow
    correction of servos on the links' side.
    """
    arm, J, axis = about.arm, about.jacobian, about.axis
    tool, nothing = axis @ J[:3], np.zeros(6)
    way = np.linalg.solve(J, np.concatenate([axis, np.zeros(3)]))
    mass, stiffness, damping = motion_matrices(about)
    at_links, at_rotors = np.concatenate([tool, nothing]), np.concatenate([nothing, tool])
    pull, drag = np.concatenate([nothing, arm.kp * way]), np.concatenate([nothing, arm.kv * way])
    host, path = at_links if arm.on_link else at_rotors, np.concatenate([way, way])
    return LoopArm(mass, stiffness, damping, pull, drag, at_links, host, path, float(arm.lag))


class LoopSetup(NamedTuple):
    """What the loop consists of besides its control law."""

    arm: LoopArm
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


def setup_of(scenario: Scenario, arm: LoopArm | None = None) -> LoopSetup:
    """The force loop of a scenario, the whole pad touching a plane; law and sensor at the physics' rate.

    ``arm``: in its pose; that of ``force`` if not given, elastic joints swinging by next to nothing.
    """
    head = scenario.head
    pad = scenario.pad
    sensor = scenario.sensor
    dt = scenario.simulation.timestep_s
    if arm is None and scenario.robot.elastic:
        arm = elastic_arm(joints_about(scenario, FORCE_POSE[None])[0])
    still = LoopSetup(
        arm or one_mass(),
        head.stiffness_n_m * head.spring_scale,
        head.damping_n_s_m,
        head.mass_kg,
        pad.stiffness_n_m * head.spring_scale,
        pad.damping_s_m * scenario.process.contact_force_n,
        dt,
        0,
        0,
        low_pass_share(sensor.bandwidth_hz, dt) or 1.0,
    )
    return with_latency(still, Latency(sensor.latency_s, scenario.robot.command_latency_s))


class Plant(NamedTuple):
    """s' = A s + B a with the command a acting in this step [m/s]; outputs before the step. Each row of shape
    (m,)."""

    A: Array  #: Shape (m, m)
    B: Array  #: Shape (m,)
    reading: Array  #: Row of the sensor's newest low-passed sample [N]
    velocity: Array  #: Row of the tool's velocity as the host has it [m/s]
    position: Array  #: Row of the tool's place along its axis as the host has it [m]
    force: Array  #: Row of the exact contact force [N]
    head: Array  #: Row of the head's place [m]
    moved: Array  #: State when all of the arm stands a metre further along the tool axis


def build_plant(setup: LoopSetup) -> Plant:
    """The cell's step along the tool axis as matrices.

    States: coordinates of the arm and place of the head y [m], their velocities, commanded place [m], set
    points of the servos [m, m/s], the engine's last force at the sensor [N] and its low-passed value [N].
    """
    arm, h, n = setup.arm, setup.dt, len(setup.arm.mass)
    N, size = n + 1, 2 * n + 7
    place, set_point, set_speed, sensed, filtered = range(2 * N, size)
    K, D, mass = np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N))
    K[:n, :n], D[:n, :n], mass[:n, :n], mass[n, n] = arm.stiffness, arm.damping, arm.mass, setup.head_mass
    squeezed = np.append(arm.tool, -1.0)  # of the head's spring, by the coordinates
    K += setup.head_stiffness * np.outer(squeezed, squeezed)
    D += setup.head_damping * np.outer(squeezed, squeezed)
    step = h * np.linalg.inv(mass + h * D)
    # Rows over the states, and the command at the end.
    move = np.zeros((size, size + 1))
    contact = np.zeros(size + 1)
    goal = np.zeros(size + 1)
    rate = np.zeros(size + 1)
    contact[n], contact[N + n] = setup.pad_stiffness, setup.pad_damping
    # The command moves the servos' goal before they pull.
    goal[[set_point, place, size]] = 1.0 - arm.lag, arm.lag, arm.lag * h
    rate[[set_speed, size]] = 1.0 - arm.lag, arm.lag
    pull = np.outer(np.append(arm.drive, 0.0), goal) + np.outer(np.append(arm.drive_damping, 0.0), rate)
    pull[:, :N] -= K
    pull[:, N : 2 * N] -= D
    pull[n] -= contact
    move[N : 2 * N] = step @ pull
    move[N : 2 * N, N : 2 * N] += np.eye(N)
    move[:N] = h * move[N : 2 * N]
    move[:N, :N] += np.eye(N)
    move[place, [place, size]] = 1.0, h
    move[set_point], move[set_speed] = goal, rate
    # Inertia felt by the sensor, of the motion the forces lead to.
    move[sensed] = contact + np.append(arm.mount_mass * arm.tool, setup.head_mass) @ step @ pull / h
    move[filtered, [filtered, sensed]] = 1.0 - setup.sensor_blend, setup.sensor_blend
    velocity, position, head, moved = np.zeros((4, size))
    velocity[N : N + n], position[:n], head[n] = arm.host, arm.host, 1.0
    moved[:n], moved[[n, place, set_point]] = arm.path, 1.0
    return Plant(
        move[:, :size], move[:, size], move[filtered, :size], velocity, position, contact[:size], head, moved
    )


def plant_response(plant: Plant, row: Array, z: Complex) -> Complex:
    """Transfer from the acting command to an output at points z of the complex plane, shape (n,)."""
    systems = z[:, None, None] * np.eye(len(plant.B)) - plant.A
    states = np.linalg.solve(systems, np.broadcast_to(plant.B[:, None], (len(z), len(plant.B), 1)))
    return states[:, :, 0] @ row


# Control laws of the force loop as linear systems: by formula, or measured on the law itself.


class LinearLaw(Protocol):
    """Speed along the tool axis that a law answers to a small change of what it reads, at points z."""

    def by_force(self, z: Complex) -> Complex:
        """Response to the force reading [m/(s N)]."""

    def by_motion(self, z: Complex) -> Complex:
        """Response to the tool's velocity, its place moving with it [-]."""


# Whether a modelled force loop is stable, and up to which latency.


# Eigenvalues where the law has a state space, else Nyquist.

SLOWEST = 0.2  #: Modes that grow more slowly count as stable [1/s]


def contour(dt: float) -> Complex:
    """Upper half of the circle |z| = exp(SLOWEST dt), which keeps clear of the integrators at z = 1, shape
    (n,)."""
    omega = np.concatenate([[0.0], np.geomspace(1e-2, math.pi / dt, 1200)])
    return np.exp((SLOWEST + 1j * omega) * dt)


def turns_about_minus_one(response: Complex) -> int:
    """How often an open loop on ``contour`` and its mirror image goes clockwise around -1."""
    angle = np.unwrap(np.angle(1.0 + response))
    return -round(2.0 * (angle[-1] - angle[0]) / (2.0 * math.pi))


# Up to which latency a force loop is stable, by the linear model.

SHORTEST_SENSOR_MS = 1


class Latency(NamedTuple):
    """A total latency and how it is shared."""

    sensor: float  #: [s]
    command: float  #: [s]


def share_latency(total: float) -> Latency:
    """Share a latency [s] between sensor and command as the default cell does (8 = 2 + 6 ms), in whole
    milliseconds."""
    sensor_ms = max(round(250.0 * total), SHORTEST_SENSOR_MS)
    return Latency(sensor_ms / 1000.0, max(round(1000.0 * total) - sensor_ms, 0) / 1000.0)


def with_latency(setup: LoopSetup, latency: Latency) -> LoopSetup:
    """The same loop with other latencies."""
    return setup._replace(
        command_steps=round(latency.command / setup.dt),
        sensor_steps=max(0, round(latency.sensor / setup.dt) - 1),
    )


def with_springs(setup: LoopSetup, scale: float) -> LoopSetup:
    """The same loop with the springs of head and pad ``scale`` times as stiff."""
    return setup._replace(
        head_stiffness=scale * setup.head_stiffness, pad_stiffness=scale * setup.pad_stiffness
    )


def longest_latency(setup: LoopSetup, law: LinearLaw, totals: Sequence[float]) -> float:
    """The last of rising total latencies [s] before the first unstable one; 0 if none, infinite if all are
    stable."""
    z, plant = contour(setup.dt), build_plant(setup)
    force = law.by_force(z) * plant_response(plant, plant.reading, z)
    motion = law.by_motion(z) * plant_response(plant, plant.velocity, z)
    delay = np.log(z)
    longest = 0.0
    for total in totals:
        late = with_latency(setup, share_latency(total))
        loop = -(force * np.exp(-late.sensor_steps * delay) + motion) * np.exp(-late.command_steps * delay)
        if turns_about_minus_one(loop) > 0:
            return longest
        longest = total
    return math.inf
