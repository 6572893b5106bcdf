"""The film of a run: the cell, the pad on the part from near, and the force, rendered from its log (record ->
MP4)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image as Pillow
from PIL import ImageDraw

from polish_sim.analysis.metrics import column_of
from polish_sim.analysis.run_record import stop_mark
from polish_sim.analysis.style import BLUE, GREEN, head, line_look, new_figure, shade_band, styled
from polish_sim.cli.pictures import STOP_COLOR, Picture, PictureSize
from polish_sim.errors import InputError, needed
from polish_sim.experiments.registry import experiment
from polish_sim.experiments.run_page import clock, joint_columns, run_motion, run_plots, shown_rows
from polish_sim.row_file import whole_file

if TYPE_CHECKING:
    from polish_sim.analysis.run_record import RunRecord
    from polish_sim.cell import Observer
    from polish_sim.cli.pictures import Image

FILM = "video.mp4"
FRAMES_PER_S = 16
LONGEST_S = 32.0  #: Of a film; longer runs are shown faster
SPEEDS = (1, 2, 4, 8, 16, 32, 64, 128)  #: Simulated seconds per second of film
CELL = PictureSize(800, 720, 1024)
PAD = PictureSize(480, 360, 1024)
CURVE_INCH, DPI = (4.8, 3.6), 100
GROWS = "grows"  #: Mark of the lines of a plot that grow with time


def check_film() -> None:
    """Check that a film can be made, before the run.

    Raises:
        InputError: ffmpeg or OpenGL is missing.
    """
    needed("imageio_ffmpeg", "--video writes its film with ffmpeg", "video")
    try:
        import mujoco

        Picture(mujoco.MjModel.from_xml_string("<mujoco/>"), PAD).close()
    except Exception as error:  # what a missing OpenGL raises depends on the platform
        known = "set MUJOCO_GL to egl or osmesa, whichever is installed, or leave --video out"
        raise InputError(f"--video needs OpenGL ({type(error).__name__}: {error}): {known}.") from error


class GrowingPlot:
    """A plot whose lines grow with time: two pictures of it, with and without them, joined at the moment."""

    def __init__(self, figure: Figure) -> None:
        axes = figure.axes[0]
        self._whole = _pixels(figure)
        self._low, self._high = axes.get_xlim()
        box = axes.get_window_extent()
        self._left, self._right = box.x0, box.x1
        self._rows = slice(round(figure.bbox.height - box.y1), round(figure.bbox.height - box.y0))
        for artist in (*axes.lines, *axes.collections):
            artist.set_visible(artist.get_gid() != GROWS)
        self._empty = _pixels(figure)

    def at(self, time: float) -> Image:
        """The plot up to a moment [s], shape (height, width, 3)."""
        share = (time - self._low) / (self._high - self._low)
        column = round(self._left + share * (self._right - self._left))
        image = self._empty.copy()
        image[:, :column] = self._whole[:, :column]
        image[self._rows, column : column + 2] //= 2
        return image


@styled
def plot_curve(record: RunRecord, model: Any) -> Figure:
    """Draw what a run is about over its time: its force and the band it is held in, or else the first of its
    curves."""
    time = clock(record.log)
    band = experiment(record.scenario.experiment).band_n
    kept = shown_rows(time, column_of(record.log, "q_rad"))
    plot = run_plots(record, run_motion(record, model, kept), kept)[0]
    figure = new_figure(*CURVE_INCH)
    figure.set_dpi(DPI)
    axes = figure.add_subplot()
    for number, line in enumerate(plot.lines):
        values = np.asarray(line.values)
        if line.role == "asked":
            axes.plot(time[kept], values, color=GREEN, ls="--", lw=1.2, label=line.label)
            continue
        if line.low is not None and line.high is not None:
            axes.fill_between(time[kept], line.low, line.high, color=BLUE, alpha=0.3, lw=0, gid=GROWS)
        axes.plot(time[kept], values, label=line.label, gid=GROWS, lw=1.0, **line_look(max(number - 1, 0)))
    asked, force = (np.asarray(line.values) for line in (plot.lines[0], plot.lines[-1]))
    held = ~np.isnan(asked)
    if plot.lines[0].role == "asked" and band and held.any():
        shade_band(axes, float(np.median(asked[held])), band, f"± {band:g} N")
        low, high = np.quantile(force[held], (0.01, 0.99))
        low = min(asked[held].min() - 2.5 * band, low - 1.0) if low > band else -1.0
        axes.set_ylim(low, max(asked[held].max() + 2.5 * band, high + 1.0))
    axes.set(xlabel="time [s]", ylabel=f"[{plot.unit}]", xlim=(time[0], time[-1]))
    head(figure, plot.title, legend=(axes,))
    return figure


def _pixels(figure: Figure) -> Image:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]


def write_film(folder: Path, record: RunRecord, model: Any, observer: Observer) -> None:
    """Write the film of a run up to where it ended; the file appears when it is whole."""
    import imageio_ffmpeg

    size = CELL.width + PAD.width, CELL.height
    with whole_file(folder / FILM) as draft:
        writer = imageio_ffmpeg.write_frames(
            str(draft), size, fps=FRAMES_PER_S, macro_block_size=8, ffmpeg_log_level="quiet"
        )
        with closing(writer):
            writer.send(None)
            for done, total, image in _frames(record, model):
                writer.send(np.ascontiguousarray(image))
                observer.progress(done, total)


def _frames(record: RunRecord, model: Any) -> Iterator[tuple[int, int, Image]]:
    """Images of a run, each with its number and how many there are."""
    import mujoco

    time = clock(record.log)
    q = joint_columns(record, model)
    pads = column_of(record.log, "tcp_position_m")
    length = float(time[-1] - time[0])
    speed = next((speed for speed in SPEEDS if length <= LONGEST_S * speed), SPEEDS[-1])
    moments = time[0] + np.arange(0.0, length + speed / FRAMES_PER_S, speed / FRAMES_PER_S)
    data = mujoco.MjData(model)
    curve = GrowingPlot(plot_curve(record, model))
    stop = stop_mark(record.metrics)
    cell = Picture(model, CELL)
    pad = Picture(model, PAD)
    for number, moment in enumerate(moments, 1):
        row = min(int(np.searchsorted(time, moment)), len(time) - 1)
        data.qpos[:] = q[row]
        mujoco.mj_forward(model, data)
        right = np.vstack([pad.render(data, pads[row], near=True), curve.at(time[row])])
        stopped = stop.text if stop and time[row] >= stop.time else ""
        yield (
            number,
            len(moments),
            _titled(np.hstack([cell.render(data, pads[row]), right]), time[row], speed, stopped),
        )
    cell.close()
    pad.close()


def _titled(image: Image, time: float, speed: int, stopped: str) -> Image:
    """An image with its time, how fast it is shown, and why the run has stopped."""
    whole = Pillow.fromarray(image)
    draw = ImageDraw.Draw(whole)
    draw.text((14, 10), f"{time:6.1f} s   {speed} x", fill="black", font_size=24)
    if stopped:
        draw.text((14, 42), stopped, fill=STOP_COLOR, font_size=18)
    return np.array(whole, dtype=np.uint8)
