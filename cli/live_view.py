"""A run while it goes: what fills its page in the browser, and MuJoCo's viewer."""

from __future__ import annotations

import math
import queue
import threading
import time
import warnings
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.kernel import FEED, FORCE
from polish_sim.cell.observer import STOPPING, Silent
from polish_sim.cell.stroke import cycle_time
from polish_sim.cli import console
from polish_sim.cli.live_page import PLOT_S, LivePage, Moment, block
from polish_sim.cli.view import Address
from polish_sim.experiments.run_page import part_body, scene_solids
from polish_sim.spatial import apply, inverse, matrices, transform

if TYPE_CHECKING:
    from polish_sim.cell import Stroke

ABOVE_M = 5e-4  #: Of the lines of a path, to be seen on the part [m]
SETTLED_S = 0.25  #: A slider counts when it has rested this long [s]
STAGES = (
    "zero the sensor",
    "travel",
    "approach",
    "seek contact",
    "touch down",
    "process",
    "retract",
    "done",
)


class LiveView(Silent, AbstractContextManager[Any]):
    """Shows a run in the browser, lets it wait, and hands on what somebody changes there."""

    frame_every_s = 0.012  #: A whole number of log rows at the usual rate

    def __init__(self, asked: Address, title: str, steered: bool = True) -> None:
        """``steered``: whether force and feed are ours to change."""
        self._asked = asked
        self._title = title
        self._steered = steered
        self._cell: Any = None
        self._stopping = False
        # set points under a hand: value and when it was moved
        self._wanted: dict[str, tuple[float, float]] = {}
        self._faults: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._rows: list[tuple[float, float, float]] = []  # time, force and set force
        self._next = 0.0  # when the next moment is due

    def __enter__(self) -> LiveView:
        self.page = LivePage(self._asked, self._title)
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        end = "The run is over" if error is None else "The run was interrupted"
        self.page.close(f"{end}. 'polish-sim view' with its folder shows it again.")

    def stage(self, text: str) -> None:
        """Say what is happening; in the handler of Ctrl-C, which may have come anywhere, the page is left
        alone."""
        self._stopping = text == STOPPING
        if not self._stopping:
            self.page.say(text)

    def start(self, cell: Any) -> None:
        """Offer what can be changed in the cell that is about to run."""
        self._cell, gui, process = cell, self.page.server.gui, cell.scenario.process
        self._total = cycle_time(cell.strokes)
        force = process.contact_force_n
        feed = 1e3 * process.feed_m_s
        if self._steered and cell.on_part and cell.scenario.controller.name != "position":
            top = max(force, min(2.0 * force, 0.8 * cell.scenario.safety.force_limit_n))
            self._slider(gui, "Force [N]", FORCE, (min(1.0, force), top, 0.5, force), 1.0)
        self.page.plot.scales = {"x": {"time": False}, "y": {"auto": False, "min": 0.0, "max": 2.0 * force}}
        if self._steered:
            self._slider(gui, "Feed [mm/s]", FEED, (0.05 * feed, feed, 0.05 * feed, feed), 1e-3)
        else:
            self._total = math.inf
        with gui.add_folder("Faults", expand_by_default=False):
            for name, fault in cell.fault_table.items():
                if cell.on_part or not fault.on_part:
                    button = gui.add_button(name, hint=fault.text, color="gray")
                    button.on_click(lambda _, name=name: self._faults.put(name))
        self._changed = gui.add_html("")

    def _slider(self, gui: Any, label: str, name: str, scale: tuple[float, ...], si: float) -> None:
        def moved(event: Any) -> None:
            self._wanted[name] = si * event.target.value, time.monotonic()

        gui.add_slider(label, *scale).on_update(moved)

    def frame(self, model: Any, data: Any) -> None:
        """Show one moment; wait as long as it lasts, or until somebody resumes the run."""
        page = self.page
        if not page.built:
            self._build(model, data)
        moment = self._moment(data)
        passed = max(0.0, moment.time - self._rows[-1][0]) if self._rows else 0.0
        self._rows = [
            *self._rows[-round(PLOT_S / self.frame_every_s) :],
            (moment.time, moment.force, moment.asked),
        ]
        self._next = max(self._next + passed / page.speed, time.monotonic() - 0.1)
        while True:
            self._attend()
            page.show(moment, np.array(self._rows))
            if self._stopping or not (page.paused or time.monotonic() < self._next):
                return
            if page.paused and page.steps:
                page.steps -= 1
                return
            time.sleep(0.01 if page.paused else min(0.01, max(0.0, self._next - time.monotonic())))

    def _attend(self) -> None:
        """Hand on what was changed in the page: a fault at once, a set point when its slider rests."""
        happened = [self._faults.get() for _ in range(self._faults.qsize())]
        for name, (value, at) in list(self._wanted.items()):
            if time.monotonic() - at >= SETTLED_S:
                del self._wanted[name]
                happened.append(f"{name}={value:.6g}")
        for what in happened:
            self._cell.let_happen(what)
        if happened:
            said = "<br>".join(map(str, self._cell.asked[-8:]))
            self._changed.content = block(f"<b>changed by hand</b>, kept in config.toml<br>{said}")

    def _build(self, model: Any, data: Any) -> None:
        part, cell = part_body(model), self._cell
        lines = np.empty((0, 2, 3))
        if cell is not None and cell.on_part:
            lines = np.concatenate([lines, *map(lines_over, cell.strokes)])
            if part >= 0:
                lines = apply(inverse(poses_of(data)[part]), lines)
        self.page.build(model.nbody - 1, scene_solids(model), part, lines)
        self.page.plot.visible = cell is not None and cell.on_part

    def _moment(self, data: Any) -> Moment:
        cell = self._cell
        poses = poses_of(data)
        none = math.nan
        if cell is None:
            return Moment(data.time, none, "", poses, data.site("tool").xpos, none, none, none)
        state = cell.state
        e = cell.kernel.engine
        part = self.page.part
        if part >= 0 and not cell.arm:
            poses[part, :3, 3] += cell.kernel.part.position - state.motion.rest
        force = float(state.wrench[2])
        stop = int(state.status.stop)
        sunk = e.qpos[6] + force / cell.scenario.pad.stiffness_n_m
        return Moment(
            time=float(state.status.steps) * e.dt,
            total=self._total,
            stage=f"protective stop: {cell.reasons[stop]}" if stop else STAGES[state.sequence.stage],
            poses=poses,
            pad=data.site_xpos[e.tool_site] - sunk * data.site_xmat[e.tool_site].reshape(3, 3)[:, 2],
            force=force,
            asked=float(state.target.force) if state.target.contact else none,
            speed=float(np.linalg.norm(state.measurement.twist[:3])),
            behind=sum(
                min(max(state.target.s - stroke.start_s, 0.0), stroke.process.length) / stroke.process.spacing
                for stroke in cell.strokes
            ),
        )


def poses_of(data: Any) -> Array:
    """Poses of a model's bodies in the world, shape (k, 4, 4)."""
    return transform(data.xmat[1:].reshape(-1, 3, 3), data.xpos[1:])


def lines_over(stroke: Stroke) -> Array:
    """Lines from point to point of a stroke just above the unpressed surface, base frame [m], (n, 2, 3)."""
    table = stroke.process
    depth = stroke.depth * stroke.force / stroke.force[0] + ABOVE_M
    points = table.positions - depth[:, None] * matrices(table.quaternions)[:, :, 2]
    return np.stack([points[:-1], points[1:]], axis=1)


# In MuJoCo's viewer.

CLOSING_S = 5.0  #: A window is waited for, at most [s]


class Viewer(Silent, AbstractContextManager[Any]):
    """Opens the viewer at the first moment and keeps the run no faster than real time.

    It shows a copy of the cell's data: opening the window computes the forces in it anew, and hands pull at
    the bodies.
    """

    frame_every_s = 1.0 / 50.0

    def __init__(self) -> None:
        self._window: Any = None
        self._shown: Any = None
        self._failed = False
        self._ahead_of: float | None = None

    def frame(self, model: Any, data: Any) -> None:
        """Show one moment; closing the window lets the run continue without it."""
        if self._failed:
            return
        if self._window is None:
            self._open(model, data)
            return
        if not self._window.is_running():
            return
        import mujoco

        with self._window.lock():
            mujoco.mj_copyData(self._shown, model, data)
        self._window.sync()
        now = time.monotonic()
        if self._ahead_of is None:
            self._ahead_of = now - data.time
        time.sleep(max(0.0, self._ahead_of + data.time - now))

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if self._window:
            self._window.close()
            for thread in self._threads:
                thread.join(CLOSING_S)  # what the window draws with is gone when the program ends

    def _open(self, model: Any, data: Any) -> None:
        if not _has_display():
            self._failed = True
            console.note("no viewer: this machine has no display. The run continues; --video writes a film.")
            return
        import mujoco.viewer

        before = set(threading.enumerate())
        self._shown = mujoco.MjData(model)
        mujoco.mj_copyData(self._shown, model, data)
        self._window = mujoco.viewer.launch_passive(
            model, self._shown, show_left_ui=False, show_right_ui=False
        )
        self._threads = set(threading.enumerate()) - before


def _has_display() -> bool:
    """Whether a window can be opened; MuJoCo's viewer ends the whole process where it cannot."""
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return bool(glfw.init())


FrameSink = LiveView | Viewer
"""Looks on at a run, and is open as long as it lasts."""
