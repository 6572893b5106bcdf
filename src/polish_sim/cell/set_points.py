"""Force and feed set anew while a run goes: scaled on the stroke that is under way and on those that
follow."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from polish_sim.cell.kernel import CellKernel
from polish_sim.cell.stroke import Stroke
from polish_sim.config import ProcessConfig

FORCE, FEED = "force_n", "feed_m_s"
SET_POINTS: Mapping[str, str] = MappingProxyType(
    {FORCE: "force to hold along the tool axis [N]", FEED: "speed along the path [m/s]"}
)


class SetPoints:
    """What the host holds now, as shares of what was planned.

    A path that plans its own forces or feeds keeps their proportions. The feed can only be lowered: a motion
    is planned at the fastest its limits allow. Position and depth of the target stay as planned; the force
    loop takes up the rest.
    """

    def __init__(self, process: ProcessConfig) -> None:
        self._usual = {FORCE: process.contact_force_n, FEED: process.feed_m_s}
        self.now = dict(self._usual)
        self._planned: Stroke

    def begin(self, stroke: Stroke) -> Stroke:
        """A stroke as it is to be run: tables of its own, scaled to the set points."""
        self._planned = stroke
        motion = stroke.motion
        own = stroke._replace(force=stroke.force.copy(), motion=motion._replace(rates=motion.rates.copy()))
        self._scale(own)
        return own

    def change(self, name: str, value: float, cell: CellKernel) -> None:
        """Set a set point [SI] from the next step on.

        At another force the springs are pressed in further or less: as after landing, the guard that watches
        where the surface is waits until the force is held before it knows the new depth.
        """
        before = float(cell.stroke.force[0])
        self.now[name] = value
        self._scale(cell.stroke)
        guards = cell.state.guards
        change = float(cell.stroke.force[0]) - before
        if change != 0.0 and self._planned.depth > 0.0:
            guards.depth += min(self._planned.depth / float(self._planned.force[0]) * change, 0.0)
            guards.holding, guards.was_held = 0.0, False

    def _scale(self, stroke: Stroke) -> None:
        force, feed = (self.now[name] / self._usual[name] for name in (FORCE, FEED))
        stroke.force[:] = self._planned.force * force
        stroke.motion.rates[:] = self._planned.motion.rates * feed
