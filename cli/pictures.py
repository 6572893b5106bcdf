"""Frames of a run: the viewer, the video, the picture of the cell; all rendered without a display but the viewer."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import time
import warnings
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

from polish_sim.cli import console

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from polish_sim.analysis.run_record import StopMark

    Image = NDArray[np.uint8]

CELL_PICTURE: Final = "cell.png"


class FrameSink(AbstractContextManager[Any], Protocol):
    """Takes moments of a simulation; a context manager that lives as long as the run."""

    every_s: float  #: Simulated time between frames [s]

    def take(self, model: Any, data: Any) -> None:
        """Take one moment; model and data are not to be changed."""


class Quality(NamedTuple):
    """Size of a picture and what is spent on it; without a graphics card that is most of a film's time."""

    width: int
    height: int
    samples: int  #: Samples per pixel against jagged edges
    shadow: int  #: Resolution of the shadows


CAPTION: Final = 34  #: Height of a line below a picture [pixels]
CROSS: Final = 11.0  #: Half the size of the cross at a protective stop [pixels]
STOP_COLOR: Final = "#E00020"
STILL: Final = Quality(960, 720, 4, 2048)
FILM: Final = Quality(640, 480, 0, 1024)
LOOK_AT: Final = (0.0, -0.32, 0.28)
DISTANCE: Final = 1.65
AZIMUTH, ELEVATION = 125.0, -22.0
PAIR_DISTANCE: Final = 2.0
PAIR_AZIMUTH, PAIR_ELEVATION = 70.0, -18.0  #: Of two robots, seen from the side


def prepare_headless() -> None:
    """Ask MuJoCo for rendering without a window, where it can; has to happen before it is imported."""
    chosen = "MUJOCO_GL" in os.environ or bool(os.environ.get("DISPLAY"))
    if sys.platform == "linux" and not chosen and _egl_exists():
        os.environ["MUJOCO_GL"] = "egl"


def _egl_exists() -> bool:
    """Whether the library loads: MuJoCo cannot be imported at all when it is asked for one that does not."""
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    return True


class Picture:
    """Renders a model's moments from one camera."""

    def __init__(self, renderer: Any, camera: Any) -> None:
        self._renderer = renderer
        self._camera = camera

    @classmethod
    def opened(cls, model: Any, quality: Quality) -> Picture | None:
        """Open a renderer, or say in one message why there is none and return None."""
        import mujoco

        try:
            model.vis.global_.offwidth, model.vis.global_.offheight = quality.width, quality.height
            model.vis.quality.offsamples, model.vis.quality.shadowsize = quality.samples, quality.shadow
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # a missing display is reported once, below
                renderer = mujoco.Renderer(model, quality.height, quality.width)
        except Exception as error:  # what a missing OpenGL raises depends on the platform
            console.note(f"no OpenGL on this machine ({type(error).__name__}: {error}): no rendered picture or video.")
            return None
        camera = mujoco.MjvCamera()
        camera.lookat[:] = LOOK_AT
        camera.distance, camera.azimuth, camera.elevation = DISTANCE, AZIMUTH, ELEVATION
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "master_base") >= 0:
            camera.lookat[:] = model.stat.center
            camera.distance, camera.azimuth, camera.elevation = PAIR_DISTANCE, PAIR_AZIMUTH, PAIR_ELEVATION
        return cls(renderer, camera)

    def render(self, data: Any) -> Image:
        """Render one moment, shape (height, width, 3)."""
        import numpy as np

        self._renderer.update_scene(data, self._camera)
        return np.array(self._renderer.render(), dtype=np.uint8)

    def pixel_of(self, place: NDArray[np.float64]) -> tuple[float, float]:
        """Where a place (3,) [m] is in the image rendered last: column, row."""
        import numpy as np

        eyes = self._renderer.scene.camera
        away = place - np.mean([eye.pos for eye in eyes], axis=0)
        ahead, up = np.array(eyes[0].forward), np.array(eyes[0].up)
        # The frustum's half height at its near plane is the image's.
        scale = 0.5 * self._renderer.height * eyes[0].frustum_near / eyes[0].frustum_top / (away @ ahead)
        right = np.cross(ahead, up)
        column, row = 0.5 * self._renderer.width + scale * away @ right, 0.5 * self._renderer.height - scale * away @ up
        return float(column), float(row)

    def close(self) -> None:
        """Give the renderer's memory back."""
        self._renderer.close()


def save_image(file: Path, image: Image) -> None:
    """Write an image, shape (height, width, 3), as PNG."""
    from PIL import Image as Pillow

    Pillow.fromarray(image).save(file)


def crossed_out(image: Image, place: tuple[float, float], text: str) -> Image:
    """An image with a cross at a place, column and row, and a line of text below it."""
    import numpy as np
    from PIL import Image as Pillow
    from PIL import ImageDraw

    height, width, _ = image.shape
    whole = Pillow.new("RGB", (width, height + CAPTION), "white")
    whole.paste(Pillow.fromarray(image))
    draw, (x, y) = ImageDraw.Draw(whole), place
    for color, line in (("white", 9), (STOP_COLOR, 5)):
        for way in (-1.0, 1.0):
            draw.line((x - CROSS, y - way * CROSS, x + CROSS, y + way * CROSS), fill=color, width=line)
    draw.text((10, height + 8), text, fill=STOP_COLOR, font_size=16)
    return np.array(whole, dtype=np.uint8)


class Snapshot:
    """Remembers the joint positions on the way; renders the middle one, or a protective stop's, when the run ends."""

    every_s = 0.5

    def __init__(self, file: Path) -> None:
        self._file = file
        self.model: Any = None  #: Of the cell, once it runs
        self._positions: list[Any] = []
        self._times: list[float] = []
        self.stop: StopMark | None = None  #: Of the run, set before the picture is rendered

    def __enter__(self) -> Snapshot:
        return self

    def take(self, model: Any, data: Any) -> None:
        """Remember one moment."""
        self.model = model
        self._positions.append(data.qpos.copy())
        self._times.append(float(data.time))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        picture = Picture.opened(self.model, STILL) if self._positions and error is None else None
        if picture is None:
            return
        import mujoco

        data, stop = mujoco.MjData(self.model), self.stop
        moment = len(self._positions) // 2
        if stop:
            moment = min(range(len(self._times)), key=lambda k: abs(self._times[k] - stop.time))
        data.qpos[:] = self._positions[moment]
        mujoco.mj_forward(self.model, data)
        image = picture.render(data)
        save_image(self._file, crossed_out(image, picture.pixel_of(stop.tool), stop.text) if stop else image)
        picture.close()


FILM_FRAMES_PER_S: Final = 16
SPEED_UP: Final = 4.0  #: Simulated seconds per second of film
GIF_FRAMES: Final = 600  #: A GIF holds all its frames in memory; longer films are thinned to this many


class Video:
    """Renders a frame per interval and writes the film when the run ends."""

    every_s = SPEED_UP / FILM_FRAMES_PER_S

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._picture: Picture | None = None
        self._encoder: subprocess.Popen[bytes] | None = None
        self._frames: list[Image] = []
        self._next = 0.0
        self._failed = False

    def __enter__(self) -> Video:
        return self

    def take(self, model: Any, data: Any) -> None:
        """Render one moment, when it is due."""
        if self._failed or data.time < self._next - 1e-9:
            return
        self._next = data.time + self.every_s
        if self._picture is None:
            self._picture = Picture.opened(model, FILM)
            self._failed = self._picture is None
            if self._picture is None:
                return
        self._keep(self._picture.render(data))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._picture is not None:
            self._picture.close()
        if self._encoder is not None and self._encoder.stdin is not None:
            self._encoder.stdin.close()
            self._encoder.wait()
        elif self._frames:
            write_gif(self._folder / "video.gif", self._frames)

    def _keep(self, image: Image) -> None:
        if self._encoder is None and shutil.which("ffmpeg"):
            self._encoder = _start_ffmpeg(self._folder / "video.mp4", image.shape[1], image.shape[0])
        if self._encoder is not None and self._encoder.stdin is not None:
            self._encoder.stdin.write(image.tobytes())
        else:
            self._frames.append(image)


def write_gif(file: Path, frames: list[Image]) -> None:
    """Write a GIF that plays at ``SPEED_UP``; a long one loses frames, not speed."""
    from PIL import Image as Pillow

    keep = -(-len(frames) // GIF_FRAMES)
    images = [Pillow.fromarray(frame).quantize(256, Pillow.Quantize.FASTOCTREE) for frame in frames[::keep]]
    duration = round(1000.0 * keep / FILM_FRAMES_PER_S)
    images[0].save(file, save_all=True, append_images=images[1:], duration=duration, loop=0, optimize=True)


def _start_ffmpeg(file: Path, width: int, height: int) -> subprocess.Popen[bytes]:
    console.note("video: mp4 with ffmpeg")
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(FILM_FRAMES_PER_S), "-i", "-"]
    target = ["-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(file)]
    return subprocess.Popen(["ffmpeg", "-loglevel", "error", "-y", *source, *target], stdin=subprocess.PIPE)


class Viewer:
    """Opens the viewer at the first moment and keeps the run no faster than real time."""

    every_s = 1.0 / 50.0

    def __init__(self) -> None:
        self._window: Any = None
        self._failed = False
        self._ahead_of: float | None = None

    def __enter__(self) -> Viewer:
        return self

    def take(self, model: Any, data: Any) -> None:
        """Show one moment; closing the window lets the run go on without it."""
        if self._failed:
            return
        if self._window is None:
            self._open(model, data)
            return
        if not self._window.is_running():
            return
        self._window.sync()
        self._wait(data.time)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._window is not None:
            self._window.close()

    def _open(self, model: Any, data: Any) -> None:
        if not _has_display():
            self._failed = True
            console.note("no viewer: this machine has no display. The run goes on; --video writes a film without one.")
            return
        import mujoco.viewer

        self._window = mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)

    def _wait(self, simulated: float) -> None:
        now = time.monotonic()
        if self._ahead_of is None:
            self._ahead_of = now - simulated
        time.sleep(max(0.0, self._ahead_of + simulated - now))


def _has_display() -> bool:
    """Whether a window can be opened; MuJoCo's viewer ends the whole process where it cannot."""
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return bool(glfw.init())


def open_sinks(draft: Path, view: bool, video: bool) -> list[FrameSink]:
    """The sinks of one run; ``draft`` is where pictures and films go."""
    sinks: list[FrameSink] = [Snapshot(draft / CELL_PICTURE)]
    if view:
        sinks.append(Viewer())
    if video:
        sinks.append(Video(draft))
    return sinks
