"""The rows of the trunk's experiments (paper 1), and what a calibration of the payload starts from and is
asked."""

from __future__ import annotations

from polish_sim.analysis.claim import FOLLOW_BAND_N, HOLD_BAND_N, PATH_DONE, Claim
from polish_sim.config import PartConfig, RobotConfig, Scenario, SimulationConfig, SpindleConfig
from polish_sim.experiments.registry import (
    PART_OPTIONS,
    PATH_OPTIONS,
    TOOL_OPTIONS,
    TRIAL_OPTIONS,
    WATCH_OPTIONS,
    Experiment,
    always,
)


def arc_claims(scenario: Scenario) -> tuple[Claim, ...]:
    """What is asked of an arc; of an arm with gears as much as their transmission error leaves.

    Its slope, 202 / rad times 1.45e-4 rad in a large joint, makes up to 9% of the feed where the joints add
    up.
    """
    error, share = (3e-4, 0.09) if scenario.robot.elastic else (1e-4, 0.01)
    deviation = share * scenario.process.feed_m_s
    return (
        Claim("tracking_error_max_m", "tracking error, max", "mm", "< 0.3", high=error),
        Claim("tracking_error_rms_m", "tracking error, rms", "mm"),
        Claim("speed_mean_m_s", "speed, mean", "mm/s", "10", is_mean=True),
        Claim("speed_max_deviation_m_s", "speed deviation, max", "mm/s", "held", high=deviation),
        Claim("orientation_error_max_rad", "orientation error, max", "mrad"),
        PATH_DONE,
    )


FORCE_CLAIMS = (
    Claim("settling_time_3n_s", "settling to ±3 N", "s", "< 0.5", high=0.4),
    Claim("settling_time_1n_s", "settling to ±1 N", "s"),
    Claim("steady_within_3n", "in ±3 N after 0.5 s", "%", "most", low=1.0, more_is_better=True),
    Claim("overshoot_n", "overshoot", "N"),
    Claim("rise_time_s", "rise 10-90%", "s"),
    Claim("steady_std_n", "steady force, std", "N"),
    PATH_DONE,
)


def most_astray(robot: RobotConfig) -> float:
    """How far the tool may stray from its path on a part [m].

    That of an arm with gears strays by what the host does not see of them: as far as the accuracy of arms of
    its class on a path, 0.65 mm (Slamani 2012, IRB 1600).
    """
    return 6.5e-4 if robot.elastic else 3e-4


def surface_claims(scenario: Scenario) -> tuple[Claim, ...]:
    """What is asked of polishing a part, with an active flange or without."""
    stroke = Claim("flange_stroke_used", "stroke of the flange used", "%")
    return (
        Claim("force_within_4n", "force in ±4 N", "%", "100, six dips", low=0.995, more_is_better=True),
        Claim("force_within_1n", "force in ±1 N", "%", more_is_better=True),
        Claim("force_mean_n", "force, mean", "N", "20", is_mean=True),
        Claim("force_rms_error_n", "force error, rms", "N"),
        Claim("force_max_deviation_n", "force error, max", "N", "4"),
        Claim("force_error_at_peaks_n", "largest error at a peak, mean of the peaks", "N"),
        Claim("force_error_median_n", "force error, median", "N"),
        Claim("curvature_peaks", "curvature peaks", "", "6"),
        Claim("contact_lost_s", "contact lost", "s", "0"),
        Claim("tracking_error_max_m", "tangential error, max", "mm", high=most_astray(scenario.robot)),
        Claim("speed_mean_m_s", "speed, mean", "mm/s", "constant", is_mean=True),
        Claim("cycle_time_s", "cycle time", "s"),
        Claim("coverage", "region touched by the pad", "%", more_is_better=True),
        Claim("removal_cv", "removal, std / mean", "%"),
        Claim("removal_cv_inside", "  a pad's radius inside the border", "%"),
        Claim("under_polished_share", "removal below half its mean", "%"),
        Claim("over_polished_share", "removal above 1.5 x its mean", "%"),
        *([stroke] if scenario.head.flange.bandwidth_hz else []),
        PATH_DONE,
    )


ARC = Experiment(
    "arc",
    "the tool point on a circle in free space at constant feed (paper 1, fig. 12)",
    Scenario(experiment="arc", spindle=SpindleConfig(speed_rpm=0.0)),
    run="polish_sim.experiments.free_space:run_arc",
    prepare="polish_sim.experiments.free_space:prepare_arc",
    claims=arc_claims,
    plots=always({"arc.png": "polish_sim.analysis.run_plots:plot_arc"}),
    comparisons={"arc.png": "polish_sim.analysis.run_plots:plot_arc_runs"},
    options=("--feed", *TRIAL_OPTIONS, *WATCH_OPTIONS),
    on_part=False,
    idle=("part", "plan", *Experiment.idle),
    paper={"process.feed_m_s": 0.01},
)
FORCE = Experiment(
    "force",
    "a step of the contact force from first contact, at one point (paper 1, fig. 13)",
    Scenario(experiment="force", part=PartConfig(file="plate"), spindle=SpindleConfig(speed_rpm=0.0)),
    run="polish_sim.experiments.surface:run_force",
    prepare="polish_sim.experiments.surface:check_force_point",
    claims=always(FORCE_CLAIMS),
    plots=always({"force.png": "polish_sim.analysis.run_plots:plot_force"}),
    comparisons={"force.png": "polish_sim.analysis.run_plots:plot_force_runs"},
    seeds_plots={"force.png": "polish_sim.analysis.run_plots:plot_force_runs"},
    options=(
        *PART_OPTIONS,
        "--real-part",
        "--region",
        "--feature-angle",
        "--tool",
        *TOOL_OPTIONS,
        *TRIAL_OPTIONS,
        *WATCH_OPTIONS,
    ),
    holds=True,
    band_n=HOLD_BAND_N,
    paper={"part.file": "plate", "process.contact_force_n": 20.0},
)
SURFACE = Experiment(
    "surface",
    "polish a part along a planned path under force control (paper 1, fig. 14, 15)",
    Scenario(experiment="surface"),
    run="polish_sim.experiments.surface:run_surface",
    prepare="polish_sim.experiments.surface:prepare_surface",
    claims=surface_claims,
    notes="polish_sim.analysis.metrics:map_notes",
    plots=always({"force.png": "polish_sim.analysis.surface_plot:plot_surface_force"}),
    comparisons={"force.png": "polish_sim.analysis.surface_plot:plot_surface_runs"},
    options=(
        *PART_OPTIONS,
        "--fixture",
        "--real-part",
        *PATH_OPTIONS,
        "--path",
        "--allow-contact",
        "--tool",
        *TOOL_OPTIONS,
        "--feed",
        "--from",
        "--proof",
        "--learn",
        *TRIAL_OPTIONS,
        *WATCH_OPTIONS,
    ),
    along_plan=True,
    plans=True,
    band_n=FOLLOW_BAND_N,
    only_with={("--path",): ("--from",)},
    paper={
        "part.file": "freeform",
        "plan.file": "",
        "process.contact_force_n": 20.0,
        "process.feed_m_s": 0.01,
    },
)

PAYLOAD_SCENARIO = Scenario(
    experiment="calibrate-payload",
    spindle=SpindleConfig(speed_rpm=0.0),
    simulation=SimulationConfig(log_rate_hz=0.0),
)
"""What ``calibrate payload`` starts from: the host averages every reading, one per physics step."""
_FIT = (
    Claim("residual_rms_n", "residual of the fit, force, rms", "N"),
    Claim("residual_rms_nm", "residual of the fit, torque, rms", "mN m"),
    Claim("condition", "condition of the poses", ""),
)
PAYLOAD_CLAIMS = (
    Claim("mass_error_relative", "mass error", "%", high=0.01),
    Claim("center_error_m", "centre error", "mm", high=1e-3),
    Claim("residual_force_max_n", "force left, worst of 200 poses", "N", high=0.3),
    Claim("residual_force_tared_max_n", "  tared in one of them", "N", high=0.3),
    Claim("compensation_error_max_n", "  worst possible pose, no noise", "N", high=0.3),
    *_FIT,
    Claim("drift_600s_rms_n", "idle force in 600 s, tared once, rms", "N"),
    Claim("drift_600s_retared_rms_n", "  tared every 60 s, rms", "N"),
)
"""What is asked of a simulated calibration."""
PAYLOAD_DATA_CLAIMS = (
    Claim("mass_std_relative", "mass, std", "%", high=0.01),
    Claim("center_std_max_m", "centre, std of its worst axis", "mm", high=1e-3),
    *_FIT,
)
"""What is asked of one from a user's readings, whose truth is unknown: less."""
