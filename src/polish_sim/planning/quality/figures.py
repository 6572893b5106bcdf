"""The figures of a path on a region, as the contract names them (path on a region -> metrics and maps)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import (
    Array,
    Figures,
    angles_between,
    chord_lengths,
    dots,
    into_plane,
    next_corners,
    norms,
    unit,
)
from polish_sim.config import PadConfig, ProcessConfig
from polish_sim.errors import place_in_mm
from polish_sim.geometry import PartMesh, Surface
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.fit import Fixture
from polish_sim.geometry.regions.patches import middle_points
from polish_sim.page import Table, figure_rows
from polish_sim.planning.curve import Curve
from polish_sim.planning.quality.areas import AreaAccount, AskedRegion, CutOut, account_for
from polish_sim.planning.quality.coverage import ExposureMap, distances_to_path, expose, strict_share
from polish_sim.planning.quality.crossings import find_crossings
from polish_sim.planning.quality.located import PathOnSurface, locate
from polish_sim.planning.quality.spacing import guess_stepover, measure_stepover, stepover_of
from polish_sim.planning.quality.tool_room import PadInPart, find_pad_in_part
from polish_sim.planning.toolpath import ToolPath, arc_length

# How suddenly a path turns: its sharpest corner in the surface, and the rate of its tool axis (path ->
# figures).

CORNER_M = 1e-3  #: A corner's angle is the one between the chords of this length before and after it [m]
#: The axis rate is the turn over this length of the path [m]: shorter shows the digits of a file
RATE_M = 1e-3


class Peak(NamedTuple):
    """A largest value and where it is."""

    value: float
    position: Array  #: [m], shape (3,)


def _sharpest_corner(runs: Sequence[Curve]) -> Peak:
    """Largest change of direction [rad] within the surface over 1 mm, and its place; 0 for paths shorter than
    2 mm."""
    best = Peak(0.0, runs[0].positions[0])
    for curve in runs:
        inside = (curve.knots >= CORNER_M) & (curve.knots <= curve.length - CORNER_M)
        if not inside.any():
            continue
        s, normals, here = curve.knots[inside], curve.normals[inside], curve.positions[inside]
        before, after = here - curve.points(s - CORNER_M), curve.points(s + CORNER_M) - here
        before, after = (into_plane(v, normals) for v in (before, after))
        turn = angles_between(before, after)
        k = turn.argmax()
        if turn[k] > best.value:
            best = Peak(turn[k], here[k])
    return best


def _fastest_turn(on: PathOnSurface) -> Peak:
    """Where the tool axis turns fastest along the path in contact, over a millimetre of it [rad/m]."""
    rates, places = [], []
    for rows in on.stretches:
        s = arc_length(on.positions[rows])
        span = min(RATE_M, s[-1])
        # From every waypoint ahead, and from the last places a whole span fits.
        first = np.append(s[s < s[-1] - span], s[-1] - span)
        axes = Curve(on.positions[rows], on.axes[rows], False)
        before, after = axes.at(first)[1], axes.at(first + span)[1]
        turn = angles_between(before, after)
        rates.append(turn / span)
        places.append(axes.points(first + 0.5 * span))
    rate, where = np.concatenate(rates), np.concatenate(places)
    k = rate.argmax()
    return Peak(rate[k], where[k])


# Everything that is measured of a path on a region, coverage, spacing and crossings included.


@dataclass(frozen=True, eq=False)
class Quality:
    """Everything measured of a path on a region."""

    figures: dict[str, Any]  #: The keys of metrics.json
    area: AreaAccount  #: Where every cm^2 of the region is
    exposure: ExposureMap  #: Time under the pad
    pad_in_part: PadInPart  #: Where the pad runs into the part
    crossings: Array  #: Places where the path crosses itself [m], shape (k, 3)
    runs: tuple[Curve, ...]  #: The path between lifts, with surface normals


def measure_quality(
    asked: AskedRegion,
    path: ToolPath,
    stepover: float,
    process: ProcessConfig,
    pad: PadConfig,
    part: Surface | None = None,
    fixture: Fixture | None = None,
    cuts: Sequence[CutOut] = (),
) -> Quality:
    """Measure a path on a region: figures by their names in the contract, SI, and maps.

    path_length_m is the length in contact. The step-over [m] is planned or expected; ``process`` counts where
    the path has no force or feed of its own; the tool may run into the whole ``part``, or the region if not
    given, and into its ``fixture``. ``cuts`` are what was cut out of the path: reasons in the account of the
    region's area.
    """
    ground = asked.ground
    on = locate(ground, path, process)
    spacing = measure_stepover(on.runs, stepover)
    beside = guess_stepover(path) is not None
    if not beside:
        spacing = stepover_of(np.empty(0), spacing.excluded)
    exposure = expose(ground, on, pad, asked.touched)
    distances = distances_to_path(ground.mesh, on.runs, stepover)
    area = account_for(asked, exposure.times > 0.0, pad, cuts, distances, stepover, beside)
    in_part = find_pad_in_part(on, part or ground.region.surface, pad, fixture)
    crossings = find_crossings(on.runs).places
    corner, rate = _sharpest_corner(on.runs), _fastest_turn(on)
    length = sum(run.length for run in on.runs)
    figures = {
        "path_length_m": length,
        **_path_times(path, process),
        "retracts": len(on.runs),
        "lifts": len(on.runs) - 1,
        "max_distance_to_surface_m": on.distances.max(),
        **{f"stepover_{name}": value for name, value in spacing._asdict().items() if name != "distances_m"},
        "overlap": 1.0 - spacing.mean_m / (2.0 * pad.radius_m),
        "coverage_stepover": strict_share(ground.mesh, ground.triangle_areas, on.runs, stepover),
        **exposure.figures,
        **in_part.figures,
        "sharpest_corner_rad": corner.value,
        "sharpest_corner_at_m": corner.position.tolist(),
        "corner_scale_m": CORNER_M,
        "max_axis_rate_rad_m": rate.value,
        "max_axis_rate_at_m": rate.position.tolist(),
        "max_axis_lean_rad": angles_between(on.axes, on.under.normals).max(),
        "self_crossings": len(crossings),
        "stepover_expected_m": stepover,
        "pad_diameter_m": 2.0 * pad.radius_m,
        "length_ratio": length * stepover / ground.region.area_m2,
        "bridged_holes": ground.holes,
        "unreachable_area_m2": asked.unreachable_m2,
        **area.figures,
    }
    return Quality(figures, area, exposure, in_part, crossings, on.runs)


def _path_times(path: ToolPath, process: ProcessConfig) -> dict[str, float]:
    """Time in contact, at the path's own feed or the process', and with the rest at the approach speed [s].

    And the way of the tool while it does not touch, leads included [m].
    """
    chords = chord_lengths(path.positions_work)
    pressing = path.process[1:] & path.process[:-1]
    feed = path.feeds(process.feed_m_s)
    slowness = np.where(pressing, 0.5 * (1.0 / feed[1:] + 1.0 / feed[:-1]), 1.0 / process.approach_speed_m_s)
    times = chords * slowness
    return {
        "time_in_contact_s": times[pressing].sum(),
        "cycle_time_s": times.sum(),
        "air_length_m": chords[~pressing].sum(),
    }


def fit_doubt(surface: Surface) -> float:
    """How far apart arcs from either end of a smooth edge put its middle, on all but a hundredth of the area
    at most [m]; arcs of a circle agree."""
    corners, normals = surface.control[:, :3], unit(surface.normal_control[:, :3])
    change = dots(normals + next_corners(normals), next_corners(corners) - corners)
    apart = 0.25 * np.where(surface.smooth, np.abs(change), 0.0).max(axis=1)
    order = np.argsort(apart)
    areas = np.cumsum(surface.facet_areas[order])
    return float(apart[order[np.searchsorted(areas, 0.99 * areas[-1])]])


def part_figures(mesh: PartMesh, surface: Surface, region: Surface) -> dict[str, Any]:
    """Facets of the part, how far its smooth surface stands off the middles of them, rms by area [m], how far
    that of the region may be off in itself [m], and its area [m^2]."""
    _, areas = facet_normals(mesh.vertices, mesh.faces)
    gap = norms(middle_points(surface).positions - mesh.vertices[mesh.faces].mean(axis=1))
    off = np.sqrt((areas * gap**2).sum() / areas.sum())
    return {
        "facets": len(mesh.faces),
        "fit_rms_m": off,
        "fit_unsure_m": fit_doubt(region),
        "part_area_m2": surface.facet_areas.sum(),
    }


# What of them is shown, of a plan and of a path that was inspected.

WHERE = (
    ("facets", "", "facets", ".0f"),
    ("region / part's surface", "cm^2", "region_area_m2 part_area_m2", ".1f"),
    ("  polished", "cm^2", "polished_area_m2", ".4g"),
)
HOW_WELL = (
    ("path length in contact", "m", "path_length_m", ".3f"),
    ("  / (area / step-over)", "", "length_ratio", ".3f"),
    ("  through the air, leads included", "m", "air_length_m", ".3f"),
    ("time in contact, at the feed", "s", "time_in_contact_s", ".1f"),
    ("time in contact, smoothed motion", "s", "motion_time_s", ".1f"),
    ("cycle time: with air, touch-down and lifts", "s", "cycle_time_s", ".1f"),
    ("way at the full feed, starts and stops included", "%", "feed_kept", ".1f"),
    ("least feed, starts and stops left out", "mm/s", "feed_least_m_s", ".2f"),
    ("  at, along the path with its leads", "m", "feed_least_at_m", ".3f"),
    ("motion beside the path, at most", "mm", "smoothed_off_max_m", ".3f"),
    ("  tool axis", "deg", "smoothed_axis_off_max_rad", ".3f"),
    ("pad / step-over asked or found", "mm", "pad_diameter_m stepover_expected_m", ".4g"),
    (
        "step-over, min / p5 / mean / p95 / max",
        "mm",
        "stepover_min_m stepover_p5_m stepover_mean_m stepover_p95_m stepover_max_m",
        ".2f",
    ),
    ("overlap of neighbouring turns, of the pad", "%", "overlap", ".1f"),
    ("region covered by the pad", "%", "coverage", ".1f"),
    ("  within 0.55 step-overs of the path", "%", "coverage_stepover", ".1f"),
    ("  polished place furthest from the path", "mm", "furthest_from_path_m", ".2f"),
    ("time under the pad, mean", "s", "exposure_mean_s", ".3g"),
    ("  its variation over the area", "cv", "exposure_cv", ".3f"),
    ("  area over twice the median", "mm^2", "over_polished_area_m2", ".4g"),
    ("crossings of the path with itself", "", "self_crossings", ".0f"),
    ("sharpest corner", "deg", "sharpest_corner_rad", ".1f"),
    ("largest turn of the tool axis", "deg/mm", "max_axis_rate_rad_m", ".2f"),
    ("tool in the part, at most", "mm", "pad_in_part_max_m", ".3g"),
    ("  over a length of the path", "m", "pad_in_part_length_m", ".3g"),
    ("retracts", "", "retracts", ".0f"),
    ("tool axis turned by smoothing, at most", "deg", "axis_deviation_max_rad", ".3g"),
    ("largest distance to surface", "mm", "max_distance_to_surface_m", ".3f"),
    ("planned in", "s", "plan_time_s", ".2f"),
)


def path_table(title: str, figures: Figures) -> Table:
    """The figures of a path, by their names in the contract, as a table."""
    lost = figures.get("left_out", {})
    out = [(f"  left out: {reason}", "cm^2", reason, ".3g") for reason in lost]
    rows = figure_rows([*WHERE, *out, *HOW_WELL], {**figures, **lost})
    if "smallest_singular_value" in figures:
        at = figures.get("T_base_work")
        stands = place_in_mm(row[3] for row in at[:3]) if at else "out of reach"
        rows.append(["part's origin, robot base", "", stands])
    return Table(title, ["figure", "unit", "value"], rows)
