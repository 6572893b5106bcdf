"""Dwell and force along a path, so that what comes off is even or follows a map (PlanResult -> PlanResult).

Preston's law with the pad of ``cell.removal`` pressed on the part as drawn: the exposure of node i is e_i =
sum_k R_ik(F) ds_k / v_k, linear in the slowness 1 / v. Slowness is linear between knots along the path and
minimises half of sum_i a_i (e_i / g_i - 1)^2 and a share of the time, within the limits of the feed: a pad
that hangs over an edge takes long for little. The knots lie so far apart that no profile between those
limits asks for more than the tool's acceleration. The force, where it may vary, is found the same way at the
dwell found before, and by turns.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import minimize
from scipy.sparse import csr_array, diags_array
from scipy.spatial import cKDTree

from polish_sim.analysis.metrics import spreads
from polish_sim.arrays import Array, diagonal_of, evenly_to, joined, midpoints, unit
from polish_sim.cell import Touch
from polish_sim.cell.dwell import Dwelling, PadPoses, exposure_rates
from polish_sim.cell.removal import Nodes, PressedNodes, surroundings
from polish_sim.cell.stroke import TOUCH_DOWN_TIME
from polish_sim.config import Checked
from polish_sim.errors import InputError
from polish_sim.experiments.assembly import Memory, place_key
from polish_sim.experiments.registry import experiment
from polish_sim.experiments.stroke_motion import CELL_LIMITS
from polish_sim.geometry.polygon_files import read_vertex_column
from polish_sim.planning import PlanResult, plan_part
from polish_sim.planning.ground import Triangulation, triangulate
from polish_sim.planning.part_plan import UNSEEN, PlanObserver
from polish_sim.planning.toolpath import ToolPath, interpolate, stretches

EVEN = "even"
PLANNED = "removal planned"
TARGET_COLUMNS = ("target", "relative", "removal_m")
"""Properties a target's vertices may have; the first one there counts, over its mean."""
OVERRUN = 0.5  #: How far past the border a path goes unless the plan says so [pad radii]
POSES = 0.05  #: Places of the pad are so far apart [pad radii]
KNOTS = 0.32  #: Knots of dwell and force are at least so far apart [pad radii]
NODES = 0.25  #: Longest edge of the nodes' triangles [pad radii]
MOST_SUNK = 0.3
"""Share of the limit of the surface's place by which the pad may sink in deeper than on a plane; over an edge
the force is taken off for it."""
ROUNDS = 3  #: Of dwell and force by turns
#: Times as much as at the rim, where less can be done about it, a deviation counts a pad's radius inside
INSIDE = 4.0
LEAST_GOAL = 0.02  #: Share of the mean below which a target's deviations weigh no more
SMOOTH = 1e-4  #: Weight of changes from knot to knot beside the deviation's
#: Weight of the time, over that at one feed, beside half the mean square of the deviation
QUICK = 0.008


PLANS = Memory()


def planned(
    scenario: Checked, plan: PlanResult | None = None, observer: PlanObserver = UNSEEN
) -> tuple[Checked, PlanResult | None]:
    """The plan a run goes along, made unless it is given, and the scenario with the pad and the step-over it
    has chosen; None: the experiment plans no path, or its own. The last few plans are kept."""
    if not plan and experiment(scenario.experiment).is_planned(scenario.plan.removal):
        plan = PLANS.get(place_key(scenario), lambda: plan_removal(scenario, observer))
    if plan:
        asked = replace(scenario.plan, stepover_m=plan.plan.stepover_m)
        scenario = replace(scenario, pad=plan.tool.pad, plan=asked)
    return scenario, plan


def plan_removal(scenario: Checked, observer: PlanObserver = UNSEEN) -> PlanResult:
    """Plan a part's path; if the plan asks for an even removal, or a map of it, with its feed and force.

    Raises:
        PolishSimError: The part or the map cannot be used; says why and what to do.
    """
    asked, pad = scenario.plan, scenario.pad
    if asked.removal and asked.overrun_m == 0.0:
        asked = replace(asked, overrun_m=OVERRUN * pad.radius_m)
    plan = plan_part(scenario.part, asked, scenario.process, pad, observer)
    return even_out(scenario, plan, observer) if asked.removal else plan


def even_out(
    scenario: Checked, plan: PlanResult, observer: PlanObserver = UNSEEN, most: Array | None = None
) -> PlanResult:
    """Give a plan the feed and the force with which its removal comes nearest to what is asked for.

    With ``most``, the largest feed at each point of the path [m/s], (n,), the path keeps its force and only
    the dwell is found.

    Raises:
        InputError: The map cannot be read, or says nothing of the region.
    """
    observer.stage("even the removal")
    path, asked, again = plan.path, scenario.plan, most is not None
    problem = _Problem(scenario, plan, again)
    low, high = problem.limits(np.full(len(path.s), math.inf) if most is None else most)
    slowness = np.clip(1.0 / scenario.process.feed_m_s, low, high)
    change, before = 0.0 if again else asked.removal_force, problem.exposure(slowness)
    eased = problem.force / problem.usual
    for _ in range(ROUNDS if change > 0.0 else 1):
        slowness = problem.fit(problem.dwell_columns(), low, high, slowness, problem.quick)
        if change > 0.0:
            columns, same = problem.force_columns(slowness, eased), np.ones(len(eased))
            share = problem.fit(columns, (1.0 - change) * same, (1.0 + change) * same, same)
            problem.press(share * eased * problem.usual)
    feed = 1.0 / problem.at(path.s, np.clip(slowness, low, high))
    path = replace(path, feed=feed, force=path.force if again else problem.at(path.s, problem.force))
    (was, _), (now, within) = problem.deviations(before), problem.deviations(problem.exposure(slowness))
    spread = {"planned_removal_cv": now, "planned_removal_cv_inside": within}
    inside = f" ({100.0 * within:.1f}% a pad's radius inside the border)" * math.isfinite(within)
    note = (
        f"{PLANNED} {'even' if asked.removal == EVEN else 'to its map'}: {100.0 * now:.1f}% rms of the "
        f"mean beside it on the part as drawn{inside}, {100.0 * was:.1f}% at one feed; "
        f"feed {1e3 * feed[path.process].min():.3g} to {1e3 * feed[path.process].max():.3g} mm/s"
    )
    notes = (*(earlier for earlier in plan.notes if not earlier.startswith(PLANNED)), note)
    return replace(plan, path=path, figures={**plan.figures, **spread}, notes=notes)


class _Problem:
    """Rates, knots and the goal along one path."""

    def __init__(self, scenario: Checked, plan: PlanResult, again: bool = False) -> None:
        self.path, self.pad, process = plan.path, plan.tool.pad, scenario.process
        #: Least and largest feed of the plan [m/s]
        self.slowest, self.fastest = (share * process.feed_m_s for share in scenario.plan.removal_feed)
        self.nodes = drawn_nodes(plan)
        self.s, self.steps = _places(self.path, POSES * self.pad.radius_m)
        self.spacing = self._spacing()
        self.knot_s, self.knots = _hats(self.path, self.s, self.spacing)
        self.usual = process.contact_force_n
        self.poses = _poses(self.path, self.s, process.feed_m_s, scenario.spindle.speed_rpm * math.tau / 60.0)
        self.stiffness = self.pad.stiffness_n_m * scenario.head.spring_scale
        self.deepest = self.usual / self.stiffness + MOST_SUNK * scenario.safety.offset_limit_m
        self.areas = self.nodes.pressed.areas[: len(self.nodes.mesh.vertices)]
        self.weights = self.areas / self.areas.sum()
        mesh = self.nodes.mesh
        away, _ = cKDTree(mesh.vertices[mesh.border[:, 0]]).query(mesh.vertices)
        self.importance = np.where(away >= self.pad.radius_m, INSIDE, 1.0)
        self.force = np.full(len(self.knot_s), self.usual)  #: At the knots [N]
        if again:
            self._find_rates(self.path.force_at(self.s, self.usual))
        else:
            self._ease()
            self._ease()
            self.press(self.force)
        self.quick = QUICK * process.feed_m_s / self.steps.sum() * (self.steps @ self.knots)
        at_feed = self.rates @ self.steps / process.feed_m_s
        shape = _shape_of(scenario.plan.removal, self.nodes.mesh)
        touched = np.where(at_feed > 0.0, self.weights, 0.0)
        self.goal = shape * (touched @ at_feed) / (touched @ shape)

    def _spacing(self) -> float:
        """Between knots [m]: between the limits of the feed a = v^3 d(1/v)/ds stays below the tool's."""
        most = self.fastest
        steepest = most**3 * (1.0 / self.slowest - 1.0 / most) / CELL_LIMITS.tip_acceleration
        return max(KNOTS * self.pad.radius_m, steepest)

    def _ease(self) -> None:
        """Take force off where the pad hangs over an edge and sinks in."""
        depths = self._press_with(self.knots @ self.force).depths
        eased = self.poses.forces / np.maximum(depths / self.deepest, 1.0)
        self.force = _least_near(self.knot_s, 1.5 * self.spacing, self.s, eased)

    def limits(self, most: Array) -> tuple[Array, Array]:
        """Least and largest slowness at the knots [s/m], (m,), that keep within the plan's limits of the feed
        and below the ``most`` feed at the points of the path [m/s], (n,)."""
        near = _least_near(self.knot_s, self.spacing, self.path.s, most)
        low = 1.0 / np.minimum(near, self.fastest)
        return low, np.maximum(low, 1.0 / self.slowest)

    def press(self, force: Array) -> None:
        """Set the force at the knots [N] and find the rates under it."""
        self.force = force
        self._find_rates(self.knots @ force)

    def _press_with(self, forces: Array) -> Dwelling:
        """The pad under the forces at the steps [N], (k,)."""
        self.poses, pad = self.poses._replace(forces=forces), self.pad
        return exposure_rates(self.nodes.pressed, self.poses, pad.radius_m, self.stiffness, pad.slide_m_s)

    def _find_rates(self, forces: Array) -> None:
        """Rates under the forces at the steps [N], (k,)."""
        found = self._press_with(forces)
        self.depths = found.depths
        self.rates: csr_array = found.rates[:, : len(self.areas)].T.tocsr()
        first = np.flatnonzero(np.diff(self.s, prepend=-math.inf) > 2.0 * self.steps.max())
        self.landing = TOUCH_DOWN_TIME * np.asarray(self.rates[:, first].sum(axis=1)).ravel()

    def dwell_columns(self) -> csr_array:
        """Exposure by slowness at the knots [N/s], shape (nodes, knots)."""
        return (self.rates * self.steps) @ self.knots

    def force_columns(self, slowness: Array, eased: Array) -> csr_array:
        """Exposure by share of the ``eased`` force at the knots [N/m]; the pad's contact as it is, (nodes,
        knots)."""
        by_force = self.steps * (self.knots @ slowness) / self.poses.forces
        return (self.rates * by_force) @ (self.knots * (eased * self.usual))

    def exposure(self, slowness: Array) -> Array:
        """Exposure of the region's nodes [N/m]."""
        return self.rates @ (self.steps * (self.knots @ slowness)) + self.landing

    def at(self, s: Array, values: Array) -> Array:
        """Values at the knots, at other arc lengths of the path."""
        return np.interp(s, self.knot_s, values)

    def fit(
        self, columns: csr_array, low: Array, high: Array, start: Array, cost: Array | float = 0.0
    ) -> Array:
        """Values at the knots within their limits for which the exposure comes nearest to the goal, each at a
        ``cost``."""
        by = np.sqrt(self.weights * self.importance) / np.maximum(
            self.goal, LEAST_GOAL * (self.weights @ self.goal)
        )
        wanted = (self.goal - self.landing) * by
        scaled = (columns * by[:, None]).tocsr()
        usual, count = np.sqrt(low * high).min(), len(start)
        change = diags_array([-1.0 / usual, 1.0 / usual], offsets=[0, 1], shape=(count - 1, count))
        square = scaled.T @ scaled + SMOOTH / count * (change.T @ change)
        linear = scaled.T @ wanted - cost

        def distance(x: Array) -> tuple[float, Array]:
            slope = square @ (x * usual) - linear
            return 0.5 * usual * (x @ (slope - linear)), usual * slope

        bounds = np.stack([low, high], axis=1) / usual
        options = {"maxiter": 1000, "ftol": 1e-10, "maxcor": 30}
        found = minimize(distance, start / usual, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        return usual * found.x

    def deviations(self, exposure: Array) -> tuple[float, float]:
        """Deviation from the goal over its mean: of the whole region, and a pad's radius inside its
        border."""
        relative = exposure / np.maximum(self.goal, 1e-9 * self.goal.max())
        mesh = self.nodes.mesh
        return spreads(relative, self.areas, mesh.vertices, mesh.border, self.pad.radius_m)


def drawn_nodes(plan: PlanResult) -> Nodes:
    """Nodes as of `place_nodes`, on the part as drawn."""
    path, radius = plan.path, plan.tool.pad.radius_m
    mesh = triangulate(plan.region.surface, NODES * radius)
    touch = Touch(*path.in_contact, radius)
    beside = surroundings(plan.surface, plan.region, touch, NODES * radius)
    own = PressedNodes(mesh.vertices, mesh.normals, mesh.vertex_areas)
    return Nodes(mesh, PressedNodes(*joined([own, beside])))


def _places(path: ToolPath, apart: float) -> tuple[Array, Array]:
    """Middles of steps along the path in contact [m], and their lengths [m], both (k,)."""
    ends = _divided(path, apart)
    return np.concatenate([midpoints(e) for e in ends]), np.concatenate([np.diff(e) for e in ends])


def _least_near(knots: Array, apart: float, s: Array, values: Array) -> Array:
    """Least of the values at ascending places s (k,) within ``apart`` of each knot, (m,); where none is, the
    next one."""
    ends = np.searchsorted(s, np.column_stack([knots - apart, knots + apart]).ravel())
    return np.minimum.reduceat(np.append(values, math.inf), ends)[::2]


def _divided(path: ToolPath, apart: float) -> list[Array]:
    """Places along each stroke [m]."""
    return [evenly_to(path.s[last], apart, 1, path.s[first]) for first, last in stretches(path.process)]


def _hats(path: ToolPath, s: Array, apart: float) -> tuple[Array, csr_array]:
    """Knots along each stroke [m], (m,), and the hat function of each at places s (k,), shape (k, m)."""
    knots = np.concatenate(_divided(path, apart))
    return knots, BSpline.design_matrix(s, np.pad(knots, 1, "edge"), 1)


def _poses(path: ToolPath, s: Array, feed: float, spin: float) -> PadPoses:
    """The pad at places of a path, moving at a feed [m/s], the spindle at its speed [rad/s]."""
    tips, axes = (interpolate(s, path.s, column) for column in (path.positions_work, path.axes_work))
    axes = unit(axes)
    ahead = np.gradient(path.positions_work, path.s, axis=0)
    return PadPoses(tips, axes, feed * unit(interpolate(s, path.s, ahead)), -spin * axes, np.empty(len(s)))


def _shape_of(removal: str, mesh: Triangulation) -> Array:
    """What is to come off each vertex, but for a factor, shape (v,).

    Raises:
        InputError: The map cannot be read, has no such column, or wants nothing.
    """
    if removal == EVEN:
        return np.ones(len(mesh.vertices))
    places, values = read_vertex_column(Path(removal), TARGET_COLUMNS)
    if not (np.isfinite(values).all() and values.min() >= 0.0 and values.max() > 0.0):
        raise InputError(
            f"the map '{removal}' must say 0 or more at every vertex, and more than 0 somewhere."
        )
    apart, nearest = cKDTree(places).query(mesh.vertices)
    size = diagonal_of(mesh.vertices)
    if np.median(apart) > 0.1 * size:
        raise InputError(
            f"the map '{removal}' lies {1e3 * np.median(apart):.3g} mm beside the region. Is it in mm?"
        )
    return values[nearest]
