"""The film of a run: the cell, the pad on the part from near, and the force, rendered from its log (record ->
MP4)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image as Pillow
from PIL import ImageDraw

from polish_sim.analysis.run_record import RunRecord, stop_mark
from polish_sim.analysis.style import GREEN, head, line_look, new_figure, shade_band, styled
from polish_sim.cli.pictures import STOP_COLOR, Picture, PictureSize
from polish_sim.errors import InputError, needed
from polish_sim.experiments.registry import experiment
from polish_sim.experiments.run_page import clock, joint_columns, run_motion, run_plots, shown_rows
from polish_sim.row_file import whole_file

if TYPE_CHECKING:
    from polish_sim.cell import Observer
    from polish_sim.cli.pictures import Image

FILM = "video.mp4"
FRAMES_PER_S = 16
LONGEST_S = 32.0  #: Of a film; longer runs are shown faster
CELL = PictureSize(800, 720, 1024)
PAD = PictureSize(480, 360, 1024)
CURVE_INCH, DPI = (4.8, 3.6), 100


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


def moving_plot(figure: Figure) -> Callable[[float], Image]:
    """Pictures of a plot, (height, width, 3), each with a line at a moment [s]."""
    canvas, axes = FigureCanvasAgg(figure), figure.axes[0]
    canvas.draw()  # type: ignore[no-untyped-call]
    whole = np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]
    box = axes.get_window_extent()
    rows = slice(round(figure.bbox.height - box.y1), round(figure.bbox.height - box.y0))

    def at(time: float) -> Image:
        image, column = whole.copy(), round(axes.transData.transform((time, 0.0))[0])
        image[rows, column : column + 2] //= 2
        return image

    return at


@styled
def plot_curve(record: RunRecord, model: Any) -> Figure:
    """Draw what a run is about over its time: its force and the band it is held in, or else the first of its
    curves."""
    time = clock(record.log)
    band = experiment(record.scenario.experiment).band_n
    kept = shown_rows(time, record.log["q_rad"])
    plot = run_plots(record, run_motion(record, model, kept), kept)[0]
    figure = new_figure(*CURVE_INCH)
    figure.set_dpi(DPI)
    axes = figure.add_subplot()
    looks = map(line_look, count())
    for line in plot.lines:
        asked = line.role == "asked"
        look = {"color": GREEN, "ls": "--"} if asked else next(looks)
        axes.plot(time[kept], line.values, label=line.label, lw=1.0, **look)
        if asked and band and not np.isnan(line.values).all():
            shade_band(axes, float(np.nanmedian(line.values)), band, f"± {band:g} N")
    axes.set(xlabel="time [s]", ylabel=f"[{plot.unit}]", xlim=(time[0], time[-1]))
    head(figure, plot.title, legend=(axes,))
    return figure


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
    pads = record.log["tcp_position_m"]
    length = float(time[-1] - time[0])
    speed = 2 ** math.ceil(math.log2(max(length / LONGEST_S, 1.0)))  # simulated seconds per second of film
    moments = time[0] + np.arange(0.0, length + speed / FRAMES_PER_S, speed / FRAMES_PER_S)
    data = mujoco.MjData(model)
    curve_at = moving_plot(plot_curve(record, model))
    stop = stop_mark(record.metrics)
    cell = Picture(model, CELL)
    pad = Picture(model, PAD)
    for number, moment in enumerate(moments, 1):
        row = min(int(np.searchsorted(time, moment)), len(time) - 1)
        data.qpos[:] = q[row]
        mujoco.mj_forward(model, data)
        right = np.vstack([pad.render(data, pads[row], near=True), curve_at(time[row])])
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
