"""`polish-sim calibrate arm`: two arms' own tables, for robots that are not as theirs say."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

from polish_sim.cli import console
from polish_sim.cli import option_types as o
from polish_sim.cli.calibrate_frames import LARGEST_NOISE_MM, Data, Pair, TrackerNoise, option, refuse_idle, within
from polish_sim.cli.output_folder import claimed

Poses = Annotated[int | None, option("--poses", "N", "Poses of each arm, 20 or more; default 60.")]
LengthError = Annotated[
    float | None,
    option(
        "--length-error", "MM", "How far the simulated arms' d and a are off, standard deviation (mm); default 0.5."
    ),
]
AngleError = Annotated[
    float | None,
    option("--angle-error", "DEG", "The same of joint offsets and alpha (deg); default 0.02."),
]
MOST_POSES = 10_000


def arm(
    data: Data = None,
    noise: TrackerNoise = None,
    poses: Poses = None,
    length_error: LengthError = None,
    angle_error: AngleError = None,
    pair: Pair = "simulated",
    seed: o.Seed = None,
    seeds: o.Seeds = None,
    check: o.Check = False,
    out: o.Out = None,
    overwrite: o.Overwrite = False,
) -> int:
    """Find how two arms are really built, their Denavit-Hartenberg tables, from poses a laser tracker saw."""
    given = {"--noise": noise, "--poses": poses, "--length-error": length_error, "--angle-error": angle_error}
    refuse_idle(data, given | {"--seed": seed, "--seeds": seeds})
    within("--noise", noise, 0.0, LARGEST_NOISE_MM, "mm")
    within("--poses", poses, 20, MOST_POSES, "")
    within("--length-error", length_error, 0.0, 2.0, "mm")
    within("--angle-error", angle_error, 0.0, 0.2, "deg")
    # Lazy: --help must not wait for the libraries.
    from polish_sim.cli import arm_calibration as work
    from polish_sim.dual.calibrate_bases import ArmTrial
    from polish_sim.dual.calibration.arm import Tolerance

    usual = ArmTrial()
    trial = replace(
        usual,
        tolerance=Tolerance(
            usual.tolerance.length if length_error is None else 1e-3 * length_error,
            usual.tolerance.angle if angle_error is None else math.radians(angle_error),
        ),
        noise=usual.noise if noise is None else 1e-3 * noise,
        poses=poses or usual.poses,
        seed=seed or 0,
    )
    with claimed(out, "calibrate-arm", overwrite) as folder:
        if data is not None:
            outcome = work.arm_from_data(data, pair, folder.draft)
        elif seeds is None:
            outcome = work.arm_once(trial, pair, folder.draft)
        else:
            outcome = work.arm_many(trial, range(trial.seed, trial.seed + seeds), folder.draft)
    outcome.show()
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(check)
