"""An active flange: the head's spring with a loop that moves its preload until the force is as asked.

In the slide acts F = k x + P, with the travel x, the stiffness k of the air while its valve is still, and
the preload P:

    dP/dt = 2 pi f (asked - F),  asked = start force + risen (wanted - start force)

At rest the force is as asked at any travel; motion faster than the bandwidth f meets the air as a spring.
The flange measures x and F itself. It sees neither friction in its slide nor the error of its weight.
"""

from __future__ import annotations

import math

from polish_sim.cell.engine import HEAD, EngineViews
from polish_sim.cell.gears import slip
from polish_sim.cell.wrist_sensor import GRAVITY
from polish_sim.config import HeadConfig
from polish_sim.kernels import Record, kernel

SLIP_M = 2e-5  # way on which the slide's friction builds up, assumed [m]


class Flange(Record):
    """Its loop."""

    share: float  #: Of the force's error it takes off in a step [-]; 0: no flange
    stiffness: float  #: [N/m]
    stroke: float  #: [m]
    start: float  #: Force before contact [N]
    rise: float  #: Share of the ramp done in a step [-]
    most: float  #: Friction of the slide while it moves [N]
    weight: float  #: What is wrong with the compensated weight [N]
    preload: float  #: [N]
    travel: float  #: From the outer end, as measured [m]
    force: float  #: In the slide, as measured [N]
    friction: float  #: Against inward motion [N]
    risen: float  #: Share of the ramp that is done [-]


def build_flange(head: HeadConfig, dt: float) -> Flange:
    """A flange in the air, or none; ``dt``: physics step [s]."""
    flange = head.flange
    return Flange(
        share=1.0 - math.exp(-2.0 * math.pi * flange.bandwidth_hz * dt),
        stiffness=head.stiffness_n_m * head.spring_scale,
        stroke=head.travel_m,
        start=flange.start_force_n,
        rise=dt / max(flange.ramp_s, dt),
        most=flange.friction_n,
        weight=flange.weight_error * head.mass_kg * GRAVITY,
        preload=flange.start_force_n,
    )


@kernel
def hold_force(flange: Flange, e: EngineViews, wanted: float) -> None:
    """Measure, and set the preload that acts in this step; ``wanted`` [N] is what contact is asked to be."""
    moved = e.qpos[HEAD] - flange.travel
    flange.travel += moved
    flange.friction = slip(flange.friction, moved, flange.most, SLIP_M)
    flange.force = flange.stiffness * flange.travel + flange.preload
    flange.risen = min(flange.risen + flange.rise, 1.0) if flange.travel > 0.0 else 0.0
    asked = flange.start + flange.risen * (wanted - flange.start)
    flange.preload += flange.share * (asked - flange.force)
    # The engine carries the slide's weight; the part of it that is too much lifts the tool.
    push = flange.preload + flange.weight * e.site_xmat[e.tool_site, 8]
    e.qfrc_applied[HEAD] = -push - flange.friction
