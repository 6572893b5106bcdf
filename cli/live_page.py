"""The page of a cell in the browser: scene, force, time and buttons, as `live_view` fills it.

Texts that may name a user's files go to the page as escaped HTML.
"""

from __future__ import annotations

import html
import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array, longest_side
from polish_sim.cli.view import Address, close_server, open_server, say_address
from polish_sim.spatial import apply, wxyz

SHOWN_HZ = 30.0  #: Moments sent to the page per second, at most
GAUGES_HZ = 10.0  #: As often numbers, plot and colours
PLOT_S = 12.0  #: Length of the plot [s]
PAUSE, RESUME, STEP = "pause", "resume", "step"
SPEEDS = {"¼ x": 0.25, "1 x": 1.0, "4 x": 4.0, "fastest": math.inf}
PART, TOOL, CELL = "part", "tool", "cell"
FROM = np.array([0.62, -0.66, 0.42])  #: Where the camera is, seen from what it looks at
FORCE_COLOR, ASKED_COLOR = "#0072b2", "#009e73"
PATH_M = 0.0012  #: Width of the lines of a path [m]
AHEAD, BEHIND = (0, 158, 115), (38, 70, 140)  #: Their colours
AROUND_M = 0.08  #: Of a path that is looked at [m]


class Moment(NamedTuple):
    """One instant of a cell."""

    time: float  #: [s]
    total: float  #: Of the whole run [s]
    stage: str
    poses: Array  #: Of the bodies in the world, shape (k, 4, 4)
    pad: Array  #: Middle of its face, world [m], shape (3,)
    force: float  #: [N]; NaN where none is known
    asked: float  #: [N]; NaN: none
    speed: float  #: Of the tool [m/s]
    behind: float = 0.0  #: Lines of the path that the tool has been along


class LivePage:
    """A page with a scene, its numbers and plot, and buttons for time and camera."""

    def __init__(self, asked: Address, title: str) -> None:
        self.server, self.address = open_server(asked)
        say_address(asked, self.address)
        self.paused = False
        self.speed = 1.0
        self.steps = 0
        self.built = False
        self.part = -1
        self.shown = 0  #: Moments sent
        self._title = title
        self._looks = dict[str, tuple[Array, float]]()
        self._shown_at = self._drawn_at = 0.0
        gui = self.server.gui
        self.text = gui.add_html("")
        times = gui.add_button_group("Time", (PAUSE, RESUME, STEP))
        speeds = gui.add_button_group("Speed", tuple(SPEEDS))
        looks = gui.add_button_group("Look at", (PART, TOOL, CELL))
        lines = [{}, *({"label": name, "stroke": color, "width": 2}
                       for name, color in (("force", FORCE_COLOR), ("asked", ASKED_COLOR)))]  # fmt: skip
        axes = ({"label": "s", "size": 30, "labelSize": 16}, {"label": "N", "size": 40, "labelSize": 16})
        none = (np.zeros(1), np.zeros(1), np.zeros(1))
        self.plot = gui.add_uplot(none, tuple(lines), scales={"x": {"time": False}}, axes=axes, height=170,
                                  legend={"show": False})  # fmt: skip
        times.on_click(self._press)
        speeds.on_click(lambda event: setattr(self, "speed", SPEEDS[event.target.value]))
        looks.on_click(lambda event: self._look(event.client, event.target.value))
        self.say("starting")

    def _press(self, event: Any) -> None:
        self.paused = event.target.value != RESUME
        self.steps += event.target.value == STEP

    def _look(self, client: Any, what: str) -> None:
        if what in self._looks and client is not None:
            at, far = self._looks[what]
            client.camera.look_at = at
            client.camera.position = at + far * FROM

    def say(self, what: str) -> None:
        """Show what is happening where there are no numbers yet, or any more."""
        self.text.content = block(f"<b>{html.escape(self._title)}</b><br>{html.escape(what)}")

    def build(self, bodies: int, solids: Sequence[Any], part: int, lines: Array) -> None:
        """Draw ``bodies`` and what is on them; the path's ``lines`` (n, 2, 3) [m] lie on body ``part``, -1:
        the world."""
        add = self.server.scene
        self.part = part
        self._solids = solids
        # Shadows and reflections take a browser without a graphics card down to a frame in several seconds.
        add.configure_default_lights(cast_shadow=False)
        add.configure_environment_map(hdri=None)
        add.add_light_ambient("/light", intensity=1.2)
        self._frames = [add.add_frame(f"/body{k}", show_axes=False) for k in range(bodies)]
        for number, solid in enumerate(solids):
            node = f"/body{solid.body}" if solid.body >= 0 else ""
            color = tuple(round(255 * share) for share in solid.color)
            add.add_mesh_simple(
                f"{node}/solid{number}", solid.vertices, solid.faces, color=color, flat_shading=True
            )
        if len(lines):
            node = f"/body{part}" if part >= 0 else ""
            self._lines = add.add_line_segments(f"{node}/path", lines, AHEAD, thickness=PATH_M)
        self._path = lines.reshape(-1, 3)
        self.built = True

    def show(self, moment: Moment, rows: Array) -> None:
        """Send a moment if it is time to, and now and then its numbers and the plot.

        ``rows`` are times, forces and set forces, shape (n, 3).
        """
        now = time.monotonic()
        if now - self._shown_at < 1.0 / SHOWN_HZ:
            return
        if not self.shown:
            self._enter(moment)
        self._shown_at, self.shown = now, self.shown + 1
        if len(self._path):
            middle = self._path.mean(axis=0)
            middle = middle if self.part < 0 else apply(moment.poses[self.part], middle)
            self._looks[PART] = middle, 1.7 * longest_side(self._path) + AROUND_M
        self._looks[TOOL] = moment.pad, 0.45
        with self.server.atomic():
            turns = wxyz(moment.poses[:, :3, :3])
            for frame, pose, turn in zip(self._frames, moment.poses, turns, strict=True):
                frame.position = pose[:3, 3]
                frame.wxyz = turn
        if now - self._drawn_at < 1.0 / GAUGES_HZ:
            return
        self._drawn_at = now
        self.text.content = block(numbers_text(self._title, moment, self.paused))
        if len(self._path):
            behind = np.arange(len(self._path))[:, None] < 2.0 * moment.behind
            self._lines.colors = np.where(behind, BEHIND, AHEAD).astype(np.uint8).reshape(-1, 2, 3)
        if len(rows) > 1:
            self.plot.data = tuple(np.nan_to_num(rows.T))

    def _enter(self, moment: Moment) -> None:
        """Lay the floor and turn every camera to the whole cell, now that it is known where its bodies
        are."""
        low = math.inf
        for solid in self._solids:
            points = solid.vertices if solid.body < 0 else apply(moment.poses[solid.body], solid.vertices)
            low = min(low, float(points[:, 2].min()))
        self.server.scene.add_grid(
            "/floor",
            3.0,
            3.0,
            cell_size=0.1,
            section_size=0.5,
            cell_color=(225, 229, 234),
            section_color=(205, 211, 218),
            position=(0.0, 0.0, low),
        )
        least, most = moment.poses[:, :3, 3].min(axis=0), moment.poses[:, :3, 3].max(axis=0)
        at, far = self._looks[CELL] = (
            0.5 * (least + most),
            1.2 * max(1.0, float(np.linalg.norm(most - least))),
        )
        start = self.server.initial_camera
        start.look_at = at
        start.position = at + far * FROM
        for client in self.server.get_clients().values():
            self._look(client, CELL)

    def close(self, last: str) -> None:
        """Say why, and close the page, its threads and its port."""
        self.say(last)
        self.server.flush()
        time.sleep(0.1)
        close_server(self.server)


def block(content: str) -> str:
    """HTML as the page shows it."""
    style = "font:13px/1.5 system-ui,sans-serif;padding:0 12px;font-variant-numeric:tabular-nums"
    return f"<div style='{style}'>{content}</div>"


def numbers_text(title: str, moment: Moment, paused: bool) -> str:
    """What the page says of a moment, as HTML; the force also as a bar, full at twice the set force."""
    said = f"<b>{html.escape(title)}</b><br>{moment.time:.2f} s"
    said += f" of {moment.total:.1f} s" if math.isfinite(moment.total) else ""
    said += f": {html.escape(moment.stage)}" if moment.stage else ""
    said += " <b>(paused)</b>" if paused else ""
    if not math.isfinite(moment.force):
        return said
    known = math.isfinite(moment.asked)
    wide = 50.0 * min(max(moment.force, 0.0) / (moment.asked if known else 20.0), 2.0)
    place = "position:absolute;left:50%;top:-2px;bottom:-2px;width:2px"
    mark = f"<div style='{place};background:{ASKED_COLOR}'></div>"
    bar = f"<div style='width:{wide:.1f}%;height:100%;background:{FORCE_COLOR};border-radius:4px'></div>"
    return (
        f"{said}<br>tool {1e3 * moment.speed:.1f} mm/s<br>"
        f"force <b>{moment.force:.1f} N</b>{f' of {moment.asked:g} N' if known else ''}"
        f"<div style='position:relative;height:12px;background:#8883;border-radius:4px;margin:3px 0'>"
        f"{bar}{mark if known else ''}</div>"
    )
