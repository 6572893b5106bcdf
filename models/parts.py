"""The shipped workpieces: which formula each top face has, and its solid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from polish_sim.errors import unknown_name
from polish_sim.models.punched import Hole, punched_grid, punched_solid
from polish_sim.models.shapes import Cylinder, FoldedDome, Incline, Quadric, Shape, SphereCap, TorusRim
from polish_sim.models.solids import Grid, Solid, disc_grid, extrude, lines_grid, rectangle_grid, revolve


class Part(Protocol):
    """A workpiece with a known top face."""

    @property
    def shape(self) -> Shape:
        """Formula of the top face."""

    def build(self) -> Solid:
        """Its closed mesh [m]."""


@dataclass(frozen=True)
class Block:
    """A blank with straight walls under a shaped top face."""

    shape: Shape
    """Formula of the top face."""
    grid: Grid
    """Where the top face is sampled."""

    def build(self) -> Solid:
        """See `Part`."""
        return extrude(self.shape, self.grid)


@dataclass(frozen=True)
class PunchedPlate:
    """A flat plate with round through holes."""

    shape: Quadric
    """Formula of the top face."""
    size_x: float
    """Length along x [m]."""
    size_y: float
    """Length along y [m]."""
    spacing: float
    """Wanted facet size [m]."""
    holes: tuple[Hole, ...]
    """The holes."""

    def build(self) -> Solid:
        """See `Part`."""
        return punched_solid(self.shape, punched_grid(self.size_x, self.size_y, self.spacing, self.holes))


@dataclass(frozen=True)
class WheelHub:
    """A wheel hub: a ring with a crowned rim on top, around a flat web with a bore."""

    shape: TorusRim
    """Formula of the rim."""
    inner_radius: float
    """Inner radius of the rim [m]."""
    outer_radius: float
    """Outer radius of the rim [m]."""
    spacing: float
    """Wanted facet size on the rim [m]."""

    def build(self) -> Solid:
        """See `Part`."""
        steps = round((self.outer_radius - self.inner_radius) / self.spacing)
        r = np.linspace(self.inner_radius, self.outer_radius, steps + 1)
        crown = np.column_stack([r, self.shape.profile(r)[0]])
        body = np.array([[100, 24], [93, 20], [93, 0], [67, 0], [67, 8], [15, 8], [15, 20], [60, 20]]) * 1e-3
        return revolve(np.vstack([crown, body]), round(2 * np.pi * self.shape.ring_radius / self.spacing))


def _unlike_plate() -> dict[str, Part]:
    """The plate as it might really be: with an edge across, or a ramp."""
    lines = np.linspace(-0.100, 0.100, 81)
    finer = np.sort(np.concatenate([lines[lines != 0.0], np.linspace(-0.001, 0.001, 17)]))
    edge = Incline(height=0.020, rise=0.001, slope=1.0, rounding=0.001)
    ramp = Incline(height=0.020, rise=0.0045, slope=float(np.tan(np.radians(8.0))), rounding=0.100)
    return {
        "plate_step": Block(edge, lines_grid(finer, lines)),
        "plate_ramp": Block(ramp, lines_grid(lines, lines)),
    }


def _blocks() -> dict[str, Part]:
    """The parts with straight walls."""
    return {
        "plate": Block(Quadric(height=0.020, kx=0.0, ky=0.0), rectangle_grid(0.200, 0.200, 0.0025)),
        "cylinder": Block(Cylinder(height=0.040, radius=0.150), rectangle_grid(0.160, 0.120, 0.002)),
        "saddle": Block(Quadric(height=0.035, kx=-5.0, ky=5.0), rectangle_grid(0.160, 0.160, 0.002)),
        "sphere_300": Block(SphereCap(height=0.035, radius=0.300), disc_grid(0.100, 0.002)),
        "sphere_100": Block(SphereCap(height=0.035, radius=0.100), disc_grid(0.056, 0.0016)),
        "sphere_50": Block(SphereCap(height=0.025, radius=0.050), disc_grid(0.028, 0.001)),
        "freeform": Block(
            FoldedDome(
                height=0.035,
                dome_radius=0.310,
                dome_flattening=0.070,
                fold_curvature=17.8,
                fold_half_width=0.015,
                fade_start=0.016,
                fade_end=0.054,
            ),
            disc_grid(0.100, 0.0018),
        ),
    }


def parts() -> dict[str, Part]:
    """All shipped workpieces by name."""
    rim = TorusRim(height=0.038, radius=0.060, ring_radius=0.080)
    holes = (
        Hole(x=-0.045, y=0.020, radius=0.025, room=0.030),
        Hole(x=0.050, y=-0.025, radius=0.015, room=0.020),
    )
    return {
        **_blocks(),
        **_unlike_plate(),
        "plate_two_holes": PunchedPlate(
            Quadric(height=0.020, kx=0.0, ky=0.0), size_x=0.200, size_y=0.160, spacing=0.0025, holes=holes
        ),
        "wheel_hub_rim": WheelHub(rim, inner_radius=0.060, outer_radius=0.100, spacing=0.002),
    }


def part(name: str) -> Part:
    """A shipped workpiece.

    Args:
        name: Its name, e.g. ``"freeform"``.

    Returns:
        The part, with the formula of its top face.

    Raises:
        InputError: There is no such part; the message lists the known ones.
    """
    known = parts()
    if name not in known:
        raise unknown_name("workpiece", name, known)
    return known[name]
