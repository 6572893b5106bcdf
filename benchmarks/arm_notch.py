"""`python -m benchmarks.arm_notch`: gain margins of both laws over the arm's reach, with the notch of
``hybrid-adaptive`` and the filter of ``hybrid-pi`` as set and as the arm's vibration at the pose has them."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from benchmarks.loop_margins import force_loop, margins, response_of, swinging_arm
from polish_sim import default_scenario
from polish_sim.arrays import Array
from polish_sim.cell.linear_arm import arm_modes, joints_about
from polish_sim.cell.scene import tool_on_flange
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.errors import ReachError
from polish_sim.motion.kinematics import forward, inverse_near, smallest_singular_values
from polish_sim.scoring.loop_model import FORCE_POSE, one_mass, setup_of
from polish_sim.scoring.measured_law import measure_law

SWINGS = (0.0, 5e-5, 2e-4)  #: Amplitudes of the gears' twist to linearise at [rad]
REACH = np.array([[-0.3, 0.3], [-0.25, 0.3], [0.0, 0.3]])  #: Of the tool from where ``force`` works [m]
SHARES = (0.9, 1.0, 1.1, 1.2)  #: Of the frequency by `arm_modes`, to try


def main() -> None:
    """Draw poses and print what is left of the loop's gain at each."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.arm_notch", description=__doc__)
    parser.add_argument("--poses", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    scenario = default_scenario("surface")
    rng, limit = np.random.default_rng(options.seed), scenario.safety.singular_value_limit
    q = np.array(list(_poses(options.poses, rng, limit)))
    found: dict[str, list[float]] = {}
    modes = arm_modes(joints_about(scenario, q), setup_of(scenario, one_mass()).stiffness) / (2.0 * math.pi)
    for pose, mode in zip(q, modes, strict=True):
        for name, tried in _tries(scenario, float(mode)):
            found.setdefault(name, []).append(_gain_margin(tried, pose))
        print(f"{mode:.1f} Hz  " + "  ".join(f"{column[-1]:.2f}" for column in found.values()), flush=True)
    for name, column in found.items():
        print(f"{name}: gain margin {min(column):.2f} at worst, {np.median(column):.2f} median")


def _tries(scenario: Scenario, mode: float) -> Iterator[tuple[str, Scenario]]:
    controller, believed = scenario.controller, scenario.controller.adaptive.arm_mode_hz
    for name, hz in ((f"{believed:g} Hz", believed), *((f"{share:g} x", share * mode) for share in SHARES)):
        told = replace(
            controller, name="hybrid-adaptive", adaptive=replace(controller.adaptive, arm_mode_hz=hz)
        )
        yield f"hybrid-adaptive, notch at {name}", replace(scenario, controller=told)
    for name, share in (("as set", 1.0), ("by the pose", min(1.0, mode / believed))):
        told = replace(controller, name="hybrid-pi", force_filter_hz=share * controller.force_filter_hz)
        yield f"hybrid-pi, filter {name}", replace(scenario, controller=told)


def _poses(count: int, rng: np.random.Generator, limit: float) -> Iterator[Array]:
    """Joints (6,) [rad] with the tool down, where the arm reaches and is not near a singularity."""
    while count:
        T = forward(FORCE_POSE)
        T[:3, 3] += rng.uniform(*REACH.T)
        with suppress(ReachError):
            q = inverse_near(T, FORCE_POSE)
            if smallest_singular_values(q[None], tool_on_flange()[:3, 3])[0] > limit:
                count -= 1
                yield q


def _gain_margin(scenario: Scenario, q: Array) -> float:
    """The least over the amplitudes of the gears' twist."""
    rigid, dt = setup_of(scenario, one_mass()), scenario.simulation.timestep_s
    force = scenario.process.contact_force_n
    law = measure_law(build_controller(scenario.controller), rigid, force, rigid.stiffness)
    (about,) = joints_about(scenario, q[None])
    loops = (force_loop(setup_of(scenario, swinging_arm(about, swing)), law) for swing in SWINGS)
    return min(margins(response_of(loop, dt)).gain for loop in loops)


if __name__ == "__main__":
    main()
