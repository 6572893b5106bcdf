"""The settings of the branches: hand guiding, and two robots."""

from __future__ import annotations

import math
from dataclasses import dataclass

from polish_sim.config.key import DEG_S, HAND, MM, MM_S, PAIR, SECOND, Option, key


@dataclass(frozen=True)
class GuideConfig:
    """The arm in torque mode, what its controller believes of it, its law of hand guiding and its limits."""

    mode: str = key(
        "",
        "none, gravity, classical, inertia or assist; empty = all, side by side, or assist along a path",
        option=Option("--mode", HAND, "NAME"),
    )
    direction: str = key(
        "",
        "direction of the hand's move in the base frame: x or y; empty = each",
        option=Option("--direction", HAND, "NAME"),
    )
    duration_s: float = key(
        0.0,
        "duration of the hand's move, 0 = 0.6 and 1, fast and slow [s]",
        0.0,
        60.0,
        option=Option("--duration", HAND, "S", SECOND),
    )
    coulomb_nm: tuple[float, ...] = key(
        (7.0, 7.0, 5.0, 1.5, 1.5, 1.5),
        "Coulomb friction of an ideal arm's joints, assumed [N m]",
        0.0,
        100.0,
        length=6,
    )
    viscous_nm_s_rad: tuple[float, ...] = key(
        (10.0, 10.0, 8.0, 2.0, 2.0, 2.0),
        "viscous friction of an ideal arm's joints, assumed [N m s/rad]",
        0.0,
        100.0,
        length=6,
    )
    creep_rad_s: tuple[float, ...] = key(
        (0.0017, 0.0021, 0.0044, 0.0083, 0.0086, 0.0117),
        "speed at which a joint creeps under its full Coulomb friction, believed half more than it is "
        "[rad/s]",
        1e-6,
        1.0,
        length=6,
    )
    encoder_rad: float = key(
        5e-7, "step of an ideal arm's joint encoders, 17 bits a turn before a gear of 100 [rad]", 0.0, 0.01
    )
    encoder_side: str = key(
        "link",
        "robot.arm = ur5e: encoders the law reads, link or motor; by the motors' inertia's compensation is "
        "unstable",
        words=("link", "motor"),
    )
    payload_kg: float = key(0.0, "mass at the tool point that is not configured [kg]", 0.0, 20.0)
    model_file: str = key(
        "", "MJCF the controller takes for the arm (identified.xml); empty = the arm as it is"
    )
    mass_scale: float = key(1.0, "believed masses, inertias and rotors by those of the model [-]", 0.1, 3.0)
    friction_scale: float = key(1.0, "believed friction by the true one [-]", 0.0, 3.0)
    tare: float = key(
        1.0, "share of the torque missing while the servos hold that is added later, 0 = none [-]", 0.0, 1.0
    )
    coulomb_share: float = key(0.95, "kc: share of the Coulomb friction compensated [-]", 0.0, 2.0)
    viscous_share: float = key(0.95, "kv: share of the viscous friction compensated [-]", 0.0, 2.0)
    sign_speed_rad_s: float = key(0.01, "vs of tanh(qd / vs) [rad/s]", 1e-4, 1.0)
    inertia_share: float = key(0.8, "alpha: share of the inertia compensated [-]", 0.0, 2.0)
    acceleration_filter_hz: float = key(40.0, "low-pass of the differenced speed [Hz]", 0.5, 400.0)
    observer_hz: float = key(8.0, "momentum observer of the start-up assist [Hz]", 0.1, 200.0)
    assist_share: float = key(
        0.9, "share of the Coulomb friction the assist takes at standstill [-]", 0.0, 1.0
    )
    assist_threshold: float = key(
        0.15, "push from which it takes all of that, by the joint's friction [-]", 0.01, 2.0
    )
    assist_memory_s: float = key(
        1.0, "a push that lasts this long without motion is no start [s]", 0.01, 60.0
    )
    hand_felt: float = key(
        0.04,
        "push from which the assist mode compensates at all, by the joint's friction, 0 = always [-]",
        0.0,
        2.0,
    )
    joint_speed_limit_rad_s: float = key(
        math.pi, "protective stop; compensation fades from 90% on [rad/s]", 0.05, 10.0
    )
    tool_speed_limit_m_s: float = key(
        1.5, "protective stop; compensation fades from 90% on [m/s]", 0.05, 10.0
    )
    energy_limit_j: float = key(
        40.0, "protective stop: energy lent beyond believed friction losses [J]", 0.1, 1e4
    )


@dataclass(frozen=True)
class HandConfig:
    """The simulated hand that guides the arm: a spring and a damper to where it wants the tool point."""

    distance_m: float = key(0.3, "length of its minimum-jerk move, centred on the home pose [m]", 0.001, 0.5)
    stiffness_n_m: float = key(4000.0, "its spring [N/m]", 10.0, 1e5)
    damping_n_s_m: float = key(200.0, "its damper, on the difference of the speeds [N s/m]", 0.0, 5000.0)
    turn_stiffness_nm_rad: float = key(
        0.0, "how stiffly it holds the tool's orientation; 0: not [N m/rad]", 0.0, 1000.0
    )
    turn_damping_nm_s_rad: float = key(0.0, "how it damps the tool's turning [N m s/rad]", 0.0, 100.0)
    before_s: float = key(0.3, "it holds the tool still before the move [s]", 0.01, 60.0)
    after_s: float = key(0.5, "and after it [s]", 0.01, 60.0)
    off_s: float = key(60.0, "the last move's arm is then left to itself, drift is measured [s]", 0.0, 600.0)


@dataclass(frozen=True)
class DragConfig:
    """A hand that drags the tool along a part in `run teach --follow`, and what is made of its recording."""

    follow: str = key(
        "",
        "rim: the border of the part's region, a pad's radius inside it; or a path's file; empty = paper "
        "3's moves",
        option=Option("--follow", HAND, "rim|PATH"),
    )
    speed_m_s: float = key(0.05, "speed of the hand along it [m/s]", 0.001, 0.5)
    wander_m: float = key(0.0005, "slow wander of the hand, per axis, rms [m]", 0.0, 0.01)
    wander_hz: float = key(0.5, "below this frequency [Hz]", 0.01, 5.0)
    tremor_m: float = key(0.0001, "tremor of the hand from 8 to 12 Hz, per axis, rms [m]", 0.0, 0.005)
    wobble_rad: float = key(0.03, "slow wobble of the tool in the hand, per axis, rms [rad]", 0.0, 0.3)
    turn_stiffness_nm_rad: float = key(
        30.0, "how stiffly the hand holds the tool's orientation [N m/rad]", 0.0, 1000.0
    )
    turn_damping_nm_s_rad: float = key(10.0, "and damps its turning [N m s/rad]", 0.0, 100.0)
    filter_hz: float = key(4.0, "the recording is low-passed, both ways, at this frequency [Hz]", 0.1, 100.0)
    fit_rms_m: float = key(
        5e-5, "rms distance of a spline fitted to it, of as few knots as that takes [m]", 1e-6, 0.001
    )
    spacing_m: float = key(0.002, "distance of the taught path's points [m]", 0.0002, 0.05)


@dataclass(frozen=True)
class DualConfig:
    """Two robots, for the experiment dual: the master holds the part and moves, the follower works on it."""

    follower_pose: tuple[float, ...] = key(
        (-1.1, 0.0, 0.0, 0.0, 0.0, 3.0),
        "where the follower's base really stands in the master's: x, y, z [m], rotation vector [rad]",
        length=6,
    )
    pair: str = key("simulated", "the two robots, as their calibration names them")
    bases_file: str = key(
        "", "calibration.toml of `calibrate base`; empty = calibrated before the run with a simulated tracker"
    )
    tool_file: str = key(
        "", "calibration.toml of `calibrate tcp`; empty = calibrated before the run with simulated touches"
    )
    arms_file: str = key(
        "", "calibration.toml of `calibrate arm`: both arms' tables and where the follower's base stands"
    )
    arm_length_error_m: float = key(
        0.0, "how far both arms are off their tables, d and a, standard deviation [m]", 0.0, 0.002
    )
    arm_angle_error_rad: float = key(
        0.0, "the same of joint offsets and alpha, standard deviation [rad]", 0.0, 0.004
    )
    arm_poses: int = key(
        0,
        "poses of each arm by which a simulated tracker finds its table before the run; 0 = taken as nominal",
        0,
        1000,
    )
    tracker_noise_m: float = key(3e-5, "noise of the simulated tracker per coordinate, rms [m]", 0.0, 0.01)
    touch_noise_m: float = key(5e-5, "noise of simulated touches per coordinate, rms [m]", 0.0, 0.01)
    part_on_gripper: tuple[float, ...] = key(
        (),
        "the part's own frame on the gripper's face, whose z axis looks away from the flange: x, y, z [m], "
        "rotation vector [rad]; auto = the lowest point of the part, seen along up, on the face, its middle "
        "on the axis",
        length=6,
    )
    clearance_m: float = key(
        0.03,
        "arms and tool keep from the other arm and its gripper, and from the held part's hull, beforehand "
        "[m]",
        0.0,
        0.2,
    )
    pad_clearance_m: float = key(
        0.005,
        "the pad keeps from the other arm and its gripper, its shaft from the part as well, beforehand [m]",
        0.0,
        0.015,
    )
    marks: int = key(3, "marks on what is worked on, touched to find the part on the master's flange", 3, 100)
    closing_touches: int = key(
        12,
        "touches of these marks with the tool that adjust bases, tool and part to each other; 0 = none",
        0,
        1000,
    )
    master_speed_m_s: float = key(
        0.005,
        "speed of the part while it is worked on [m/s]",
        0.0,
        0.25,
        option=Option("--master-speed", PAIR, "MM/S", MM_S),
    )
    master_direction: tuple[float, ...] = key(
        (0.0, 1.0, 0.0), "direction of that motion, base of the master", length=3
    )
    master_travel_m: float = key(
        0.3,
        "it goes to and fro along so much of that way, for as long as the part is worked on [m]",
        0.01,
        10.0,
    )
    master_turn_rad_s: float = key(
        0.0,
        "speed at which the part turns meanwhile, right-handed about the side that is worked on [rad/s]",
        -math.pi,
        math.pi,
        option=Option("--master-turn", PAIR, "DEG/S", DEG_S),
    )
    master_path: str = key(
        "",
        "CSV of poses of the part, or of the master's flange, over time instead of speed and turn; see "
        "docs/dual.md",
        option=Option("--master-path", PAIR, "FILE"),
    )
    master_delay_s: float = key(0.003, "how late the master's joint positions reach the host [s]", 0.0, 0.1)
    master_rate_hz: float = key(500.0, "how often they come, held in between [Hz]", 10.0, 1e5)
    command_lead_s: float = key(
        0.006,
        "how late the follower acts, as the host has it: so far ahead it foretells the part's speed [s]",
        0.0,
        0.1,
    )
    standoff_m: float = key(
        0.0,
        "the tool follows this far above the part and touches nothing, 0 = presses on it [m]",
        0.0,
        0.1,
        option=Option("--standoff", PAIR, "MM", MM),
    )
    density_kg_m3: float = key(2700.0, "density of the part in the gripper [kg/m^3]", 1.0, 25000.0)
