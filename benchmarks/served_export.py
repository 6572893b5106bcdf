"""The URScript that ``plan --export urscript`` writes, run by the served robot, beside `run surface` of the
same plan.

    python -m benchmarks.served_export [--part NAME]... [--feed 20] [--stepover 20] [--set robot.arm=ideal]

Only the part's place is filled in, as a user does. No ports and no clock: the programme runs as fast as it
goes. A line for each: mean of the exact force, share within 4 N, rms and largest error in contact, time fed,
and what the programme said last. Then the distance of the tool across its path from that of `run surface` on
the same displaced part, as it is and with the planned axis held (`HELD`), and that of these two from each
other: the moment loop of `run surface` tilts the tool by up to 2 deg where the pad hangs over an edge, and
turns the joints to where their gears' errors are others; the programme holds the planned axis.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array
from polish_sim.exchange.strokes import ExportSetup
from polish_sim.exchange.urscript import urscript_text
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.experiments.assembly import build_cell, build_part
from polish_sim.experiments.surface import measure_run, prepare_surface
from polish_sim.log import Trace
from polish_sim.planning import plan_part
from polish_sim.scenario_file import override
from polish_sim.spatial import apply, to_pose
from polish_sim.ur.controller import RobotController
from polish_sim.ur.robot import PLAYING, SimulatedRobot

PARTS = ("plate", "freeform", "saddle")
MOST_S = 1200.0  #: Robot time a programme may take
END_M = 0.002  #: Left out around the ends of strokes
HELD = "controller.moment_tilt_limit_rad=0"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", action="append", default=[])
    parser.add_argument("--feed", type=float, default=20.0)
    parser.add_argument("--stepover", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=700)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    asked = parser.parse_args()
    for part in asked.part or PARTS:
        settings = [f"part.file={part}", f"process.feed_m_s={1e-3 * asked.feed}",
                    f"plan.stepover_m={1e-3 * asked.stepover}", "safety.proof=none"]  # fmt: skip
        scenario = override(default_scenario("surface"), [*settings, *asked.set, f"seed={asked.seed}"])
        plan = plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad)
        place = prepare_surface(scenario, plan)
        T_base_work = place.reach.T_base_work
        own = run_experiment(scenario, plan)
        held = run_experiment(override(scenario, [HELD]), plan)
        say(part, "run", own.figures)
        say(part, "held", held.figures)
        real = build_part(scenario, place)
        robot = SimulatedRobot(build_cell(scenario, place, real))
        controller = RobotController(robot, "5.11")
        setup = ExportSetup(scenario.process, scenario.spindle, part_pose=to_pose(T_base_work))
        text = urscript_text(plan, setup).replace("part_is_placed = False", "part_is_placed = True")
        controller.run(text.rstrip("\n") + "\n", "")
        begun = time.perf_counter()
        while robot.runtime == PLAYING and robot.ticks * 0.002 < MOST_S and controller.popups == 0:
            controller.tick()
        points, s = (
            apply(T_base_work, plan.path.positions_work[plan.path.process]),
            plan.path.s,
        )
        served = robot.rig.result(time.perf_counter() - begun, points, s[plan.path.process])
        figures = measure_run(plan, place, robot.cell, served).figures
        say(part, "served", figures)
        print("   ", "; ".join(controller.log), flush=True)
        axes = plan.path.axes_work[plan.path.process] @ place.reach.T_base_work[:3, :3].T
        for what, reference, other in (
            ("served beside run surface", own, served),
            ("served beside run surface, axis held", held, served),
            ("run surface, axis held, beside run surface", own, held),
        ):
            off = 1e3 * apart(reference.trace, other.trace, points, axes)
            print(
                f"    {what}: {off.max():.3f} mm at most, {np.sqrt(np.mean(off**2)):.3f} mm rms, "
                f"{100.0 * np.mean(off <= 0.2):.1f}% within 0.2 mm",
                flush=True,
            )


def apart(own: Trace, served: Trace, points: Array, axes: Array) -> Array:
    """Distances of the served tool's path from the other's, across it on the surface [m], shape (n,).

    Each place of the served path is compared with the piece between the two nearest of the other. How deep
    the tool presses is the force's matter: along the tool axis of the plan (``points`` and ``axes``, (m, 3),
    base frame) nothing is counted. Landings and ends of strokes, where one path is longer than the other, are
    left out: what lies within 2 mm of the other's ends.
    """
    reference = own.tcp_position_m[own.fed]
    jumps = np.flatnonzero(np.linalg.norm(np.diff(reference, axis=0), axis=1) > 1e-3)
    ends = reference[np.concatenate([[0], jumps, jumps + 1, [len(reference) - 1]])]
    at = served.tcp_position_m[served.fed]
    at = at[cKDTree(ends).query(at)[0] > END_M]
    near = cKDTree(reference).query(at)[1].clip(1, len(reference) - 2)
    side = np.cross(reference[near + 1] - reference[near - 1], axes[cKDTree(points).query(at)[1]])
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    return np.abs(np.sum((at - reference[near]) * side, axis=1))


def say(part: str, what: str, figures: dict[str, object]) -> None:
    """A line of the table."""
    names = (
        "force_mean_n",
        "force_within_4n",
        "force_rms_error_n",
        "force_max_deviation_n",
        "contact_lost_s",
        "path_done",
        "coverage",
        "feed_time_s",
    )
    print(f"{part:10s} {what:7s}", *(f"{name} {figures[name]:.4g}" for name in names), flush=True)


if __name__ == "__main__":
    main()
