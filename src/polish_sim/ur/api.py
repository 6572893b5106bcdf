"""What a URScript programme and the wire see of a robot: state, motions, force, kinematics, registers.

Everything is SI, in the base frame: a pose is (x, y, z, rx, ry, rz), metres and rotation vector, of the TCP.
"""

from __future__ import annotations

from typing import Literal, Protocol

from polish_sim.arrays import Array

Side = Literal["in", "out"]
Kind = Literal["int", "double", "bool"]


class Robot(Protocol):
    """A controller's robot. A motion only starts one; ``move_done`` says when the script goes on.

    The machine calls these within ``Machine.tick``, once per 2 ms step and before the physics of that step.
    """

    time_s: float
    actual_q: Array  #: [rad], shape (6,), as all joint arrays
    actual_qd: Array
    target_q: Array
    target_qd: Array
    target_qdd: Array
    actual_tcp_pose: Array
    target_tcp_pose: Array
    actual_tcp_speed: Array
    target_tcp_speed: Array
    tcp_force: Array  #: Force on the tool [N], torque about the TCP [N m]; base axes
    joint_torques: Array
    tcp_offset: Array
    payload_mass: float
    payload_cog: Array
    payload_inertia: Array
    speed_fraction: float  #: Of the speed slider, 0 to 1

    @property
    def free_torques(self) -> Array:
        """Torques of the joints beyond what carries and moves the arm [N m]."""
        ...

    def steady(self) -> bool:
        """Whether the arm stands still; never in force mode, freedrive or by torque."""
        ...

    def input_output(self, name: str, index: int, value: float | bool | None = None) -> float | bool:
        """Read, or set, an input or output: ``standard_digital_out`` and the like, named as in URScript."""
        ...

    def register(self, side: Side, kind: Kind, index: int) -> float | int | bool:
        """Read a general-purpose register of RTDE: 48 integers, 48 doubles, 128 bits each way."""
        ...

    def set_register(self, kind: Kind, index: int, value: float | bool) -> None:
        """Write an output register."""
        ...

    def movej(self, q: Array, a: float, v: float, t: float, r: float) -> None:
        """Move in joint space. ``t`` > 0 replaces speed and acceleration; ``r``: blend radius [m]."""
        ...

    def movel(self, pose: Array, a: float, v: float, t: float, r: float) -> None:
        """Move the TCP in a straight line."""
        ...

    def movec(self, via: Array, to: Array, a: float, v: float, r: float, mode: int) -> None:
        """Move the TCP on a circle. ``mode`` 0: orientation as given, 1: fixed to the arc."""
        ...

    def move_done(self) -> bool:
        """Whether the programme goes on: the move has ended, or the blend to the next may begin."""
        ...

    def servoj(self, q: Array, t: float, lookahead: float, gain: float) -> None:
        """Track joint positions; the machine waits ``t``."""
        ...

    def speedj(self, qd: Array, a: float) -> None:
        """Accelerate to joint speeds and hold them."""
        ...

    def speedl(self, xd: Array, a: float, a_rot: float | None) -> None:
        """Accelerate to a TCP twist and hold it; linear [m/s], then angular [rad/s]."""
        ...

    def stopj(self, a: float) -> None:
        """Decelerate the joints [rad/s^2]; ``move_done`` says when they stand."""
        ...

    def stopl(self, a: float, a_rot: float | None) -> None:
        """Decelerate the TCP on its line [m/s^2]."""
        ...

    def force_mode(self, frame: Array, selection: Array, wrench: Array, kind: int, limits: Array) -> None:
        """Comply along the selected axes of the task frame, type 1, 2 or 3."""
        ...

    def force_mode_set_damping(self, damping: float) -> None:
        """Damping 0 to 1 of force mode."""
        ...

    def force_mode_set_gain_scaling(self, scaling: float) -> None:
        """Gain 0 to 2 of force mode."""
        ...

    def end_force_mode(self) -> None:
        """Leave force mode, freedrive or teach mode."""
        ...

    def freedrive(self, axes: Array, frame: Array) -> None:
        """Let the arm be led along the free axes (1) of a frame."""
        ...

    def freedrive_status(self) -> int:
        """0: normal, 1: near a singularity, 2: too near."""
        ...

    def direct_torque(
        self, tau: Array, friction_comp: bool, viscous: Array | None, coulomb: Array | None
    ) -> None:
        """Joint torques without gravity for one step [N m]; friction scales, where given, replace the
        switch."""
        ...

    def zero_ftsensor(self) -> None:
        """Make the present wrench the zero."""
        ...

    def ft_input(self, enabled: bool, mass: float, offset: Array, cog: Array) -> None:
        """Take the wrench from RTDE's ``external_force_torque``."""
        ...

    def tool_contact(self, direction: Array) -> int:
        """Steps since the contact against a direction, of zeros from any, began; 0 without one."""
        ...

    def set_tcp(self, pose: Array) -> None:
        """Set the TCP, in the flange's frame."""
        ...

    def set_payload(self, mass: float, cog: Array | None, inertia: Array | None, transition_s: float) -> None:
        """Set the payload; None leaves a value as it is."""
        ...

    def set_gravity(self, direction: Array) -> None:
        """Set gravity [m/s^2], base axes."""
        ...

    def set_watchdog(self, variable: str, min_frequency: float, action: str) -> None:
        """Watch how often an RTDE input is written; ``action``: "ignore", "pause" or "stop"."""
        ...

    def protective_stop(self) -> None:
        """Stop the arm as a safety function would."""
        ...

    def power_down(self) -> None:
        """Switch the controller off."""
        ...

    def set_speed_fraction(self, fraction: float) -> None:
        """Move the speed slider."""
        ...

    def forward_kin(self, q: Array, tcp: Array) -> Array:
        """Pose of the TCP at joint angles."""
        ...

    def inverse_kin(self, pose: Array, near: Array, tcp: Array) -> Array | None:
        """Joint angles nearest to others, None where there is no solution."""
        ...

    def jacobian(self, q: Array, tcp: Array) -> Array:
        """Jacobian of the TCP, shape (6, 6), linear rows first."""
        ...

    def jacobian_dot(self, q: Array, qd: Array, tcp: Array) -> Array:
        """Time derivative of the Jacobian, shape (6, 6)."""
        ...

    def mass_matrix(self, q: Array, rotors: bool) -> Array:
        """Joint-space inertia [kg m^2], shape (6, 6)."""
        ...

    def coriolis(self, q: Array, qd: Array) -> Array:
        """Coriolis and centrifugal torques [N m]."""
        ...

    def within_safety_limits(self, target: Array, is_pose: bool) -> bool:
        """Whether a pose, or joint angles, can be reached within the safety limits."""
        ...

    def q_history(self, steps: int) -> Array:
        """Joint angles some steps ago."""
        ...


class Listener(Protocol):
    """Hears what a programme says: becomes messages on the primary interface."""

    def text(self, text: str) -> None:
        """Of ``textmsg``."""
        ...

    def popup(self, text: str, title: str, warning: bool, error: bool, blocking: bool) -> None:
        """A message for the pendant; a blocking one is closed from the dashboard
        (``Machine.close_popup``)."""
        ...

    def started(self, name: str) -> None:
        """A programme began."""
        ...

    def stopped(self, name: str) -> None:
        """A programme ended, by itself, by ``halt``, by a stop or by an error."""
        ...

    def runtime_exception(self, line: int, column: int, text: str) -> None:
        """A programme was refused, or failed while it ran."""
        ...
