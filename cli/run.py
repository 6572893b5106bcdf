"""`polish-sim run`: simulate an experiment, once or over many seeds, and show its figures beside the paper's."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE
from polish_sim.cli.output_folder import claimed
from polish_sim.cli.rendering import prepare_headless
from polish_sim.cli.scenario_options import build_scenario
from polish_sim.cli.sinks import open_sinks
from polish_sim.errors import InputError

Experiment = Annotated[str, typer.Argument(help="arc, force or surface.", show_default=False)]
Part = Annotated[
    str | None,
    typer.Option(
        "--part",
        metavar="PART",
        help="STL file, or the name of a shipped part; default freeform (surface), plate (force).",
    ),
]
PlanFile = Annotated[
    Path | None, typer.Option("--path", metavar="PLAN", help="Plan to run: a plan folder or its path.json.")
]
PartPose = Annotated[
    str | None,
    typer.Option("--part-pose", metavar="POSE", help="X,Y,Z,RX,RY,RZ of the part in the robot base (mm, deg)."),
]
Controller = Annotated[
    str | None,
    typer.Option(
        "--controller", metavar="NAME", help="hybrid-pi (default), hybrid-pi-position, position, or FILE.py:CLASS."
    ),
]
ContactForce = Annotated[
    float | None, typer.Option("--contact-force", metavar="N", help="Force to hold (N); default 20.")
]
Feed = Annotated[float | None, typer.Option("--feed", metavar="MM_S", help="Speed along the path (mm/s); default 10.")]
PadDiameter = Annotated[
    float | None, typer.Option("--pad-diameter", metavar="MM", help="Diameter of the pad (mm); default 50.")
]
SpindleSpeed = Annotated[
    float | None,
    typer.Option(
        "--spindle-rpm", metavar="RPM", help="Speed of the spindle, 0 = off (1/min); default 6000 in surface, else off."
    ),
]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", help="Seed of everything random; default 0.")]
Seeds = Annotated[
    int | None, typer.Option("--seeds", metavar="N", min=1, help="Run this many seeds, counting up from --seed.")
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Plan and check the reach, do not simulate.")]
Config = Annotated[
    Path | None, typer.Option("--config", metavar="FILE.toml", help="TOML file; see 'polish-sim config'.")
]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="KEY=VALUE of the config; may be repeated.")
]
Check = Annotated[bool, typer.Option("--check", help="Exit with 1 when a figure falls short of what is asked.")]
View = Annotated[bool, typer.Option("--view", help="Look on in the MuJoCo viewer.")]
Video = Annotated[bool, typer.Option("--video", help="Write a video of the run (mp4, or GIF without ffmpeg).")]
LogRate = Annotated[
    str | None, typer.Option("--log-rate", metavar="HZ|full", help="Rows of the log per second (Hz), or 'full'.")
]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Output folder; default results/<command>/<date-time>.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files in an existing output folder.")]
Units = Annotated[str | None, typer.Option("--units", metavar="UNIT", help="Unit of the STL: mm, cm, m or inch.")]
Up = Annotated[str | None, typer.Option("--up", metavar="SIDE", help="Side turned up: auto, x, y, z, -x, -y or -z.")]
Region = Annotated[
    str | None, typer.Option("--region", metavar="REGION", help="auto, top, all, point:.., box:.. or faces:FILE (mm).")
]
Stepover = Annotated[
    float | None,
    typer.Option("--stepover", metavar="MM", help="surface: distance between neighbouring turns (mm); default 8."),
]
Pattern = Annotated[str | None, typer.Option("--pattern", metavar="NAME", help="surface: spiral (default) or raster.")]


def run(
    experiment: Experiment,
    part: Part = None,
    path: PlanFile = None,
    part_pose: PartPose = None,
    controller: Controller = None,
    contact_force: ContactForce = None,
    feed: Feed = None,
    pad_diameter: PadDiameter = None,
    spindle_rpm: SpindleSpeed = None,
    seed: Seed = None,
    seeds: Seeds = None,
    dry_run: DryRun = False,
    config: Config = None,
    set_: Set = None,
    check: Check = False,
    view: View = False,
    video: Video = False,
    log_rate: LogRate = None,
    out: Out = None,
    overwrite: Overwrite = False,
    units: Units = None,
    up: Up = None,
    region: Region = None,
    stepover: Stepover = None,
    pattern: Pattern = None,
) -> int:
    """Simulate an experiment of the paper: arc, force or surface."""
    _refuse_idle_options(
        experiment,
        {
            "--part": part,
            "--part-pose": part_pose,
            "--units": units,
            "--up": up,
            "--region": region,
            "--contact-force": contact_force,
            "--pad-diameter": pad_diameter,
            "--spindle-rpm": spindle_rpm,
            "--stepover": stepover,
            "--pattern": pattern,
            "--feed": feed,
        },
    )
    if seeds is not None and (view or video):
        raise InputError("--view and --video show one run: leave --seeds out.")
    given = {
        "--part": part,
        "--part-pose": part_pose,
        "--controller": controller,
        "--contact-force": contact_force,
        "--feed": feed,
        "--pad-diameter": pad_diameter,
        "--spindle-rpm": spindle_rpm,
        "--seed": seed,
        "--log-rate": log_rate,
        "--units": units,
        "--up": up,
        "--region": region,
        "--stepover": stepover,
        "--pattern": pattern,
    }
    prepare_headless()
    # Lazy: the simulator takes a second to load, --help must not wait for it.
    from polish_sim.cli.given_plan import take_plan
    from polish_sim.cli.seeds import run_seeds
    from polish_sim.cli.simulation import check_reach, run_once
    from polish_sim.experiments import default_scenario

    scenario = build_scenario(default_scenario(experiment), given, config, set_ or [])
    plan = None
    source = path or (Path(scenario.plan.file) if scenario.plan.file else None)
    if source is not None:
        plan, scenario = take_plan(source, scenario, given)
    if dry_run:
        check_reach(scenario, plan)
        return DONE
    with claimed(out, f"run-{experiment}", overwrite) as folder:
        if seeds is None:
            outcome = run_once(scenario, plan, folder.draft, open_sinks(folder.draft, view, video))
        else:
            outcome = run_seeds(scenario, plan, range(scenario.seed, scenario.seed + seeds), folder.draft)
    outcome.show()
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(check)


# Options that would change nothing: refused rather than ignored.
_IDLE = {
    "arc": {
        "--part",
        "--part-pose",
        "--units",
        "--up",
        "--region",
        "--contact-force",
        "--pad-diameter",
        "--spindle-rpm",
        "--stepover",
        "--pattern",
    },
    "force": {"--stepover", "--pattern", "--feed"},
}


def _refuse_idle_options(experiment: str, given: dict[str, object]) -> None:
    idle = sorted(option for option in _IDLE.get(experiment, ()) if given[option] is not None)
    if idle:
        raise InputError(f"{', '.join(idle)} would change nothing in 'run {experiment}': leave it out.")
