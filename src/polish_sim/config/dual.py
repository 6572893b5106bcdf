"""Section [dual] of the scenario (layer 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from polish_sim.config.key import key


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
        "",
        "calibration.toml of `calibrate base`; empty = calibrated before the run with a simulated tracker",
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
    arm_angle_error_rad: float = key(0.0, "the same of joint offsets and alpha, standard deviation [rad]", 0.0, 0.004)
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
        "the part's own frame on the gripper's face, whose z axis looks away from the flange: x, y, z [m], rotation "
        "vector [rad]; empty = the lowest point of the part, seen along up, on the face, its middle on the axis",
        length=6,
    )
    clearance_m: float = key(
        0.03, "arms and tool keep from the other arm and its gripper, and from the held part's hull, beforehand [m]",
        0.0, 0.2,
    )  # fmt: skip
    pad_clearance_m: float = key(
        0.005, "the pad keeps from the other arm and its gripper, its shaft from the part as well, beforehand [m]",
        0.0, 0.015,
    )  # fmt: skip
    marks: int = key(3, "marks on what is worked on, touched to find the part on the master's flange", 3, 100)
    closing_touches: int = key(
        12, "touches of these marks with the tool that adjust bases, tool and part to each other; 0 = none", 0, 1000
    )
    master_speed_m_s: float = key(0.005, "speed of the part while it is worked on [m/s]", 0.0, 0.25)
    master_direction: tuple[float, ...] = key(
        (0.0, 1.0, 0.0), "direction of that motion, at its start, base of the master", length=3
    )
    master_arc_radius_m: float = key(
        0.0, "it bends to the left (above 0) or right on this radius, seen from above, 0 = straight [m]", -100.0, 100.0
    )
    master_turn_rad_s: float = key(
        0.0, "speed at which the part turns about its own axis meanwhile, right-handed [rad/s]", -math.pi, math.pi
    )
    master_axis: tuple[float, ...] = key(
        (), "direction of that axis in the work frame; empty = the side that is worked on", length=3
    )
    master_center: tuple[float, ...] = key(
        (), "a point on that axis: x, y, z in the work frame [m]; empty = the middle of the path", length=3
    )
    master_path: str = key(
        "", "CSV of poses of the part, or of the master's flange, over time instead of all that; see docs/dual.md"
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
        0.0, "the tool follows this far above the part and touches nothing, 0 = presses on it [m]", 0.0, 0.1
    )
    density_kg_m3: float = key(2700.0, "density of the part in the gripper [kg/m^3]", 1.0, 25000.0)
