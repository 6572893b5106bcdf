"""`--video`: a film of the run, rendered without a display; mp4 with ffmpeg on the path, otherwise a GIF."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.cli import console
from polish_sim.cli.rendering import FILM, Picture

Image = NDArray[np.uint8]

FRAMES_PER_S: Final = 16
SPEED_UP: Final = 4.0
"""Simulated seconds per second of film."""
GIF_FRAMES: Final = 600
"""A GIF holds all its frames in memory; longer films are thinned to this many."""


class Video:
    """Renders a frame per interval and writes the film when the run ends."""

    every_s = SPEED_UP / FRAMES_PER_S

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
    duration = round(1000.0 * keep / FRAMES_PER_S)
    images[0].save(file, save_all=True, append_images=images[1:], duration=duration, loop=0, optimize=True)


def _start_ffmpeg(file: Path, width: int, height: int) -> subprocess.Popen[bytes]:
    console.note("video: mp4 with ffmpeg")
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(FRAMES_PER_S), "-i", "-"]
    target = ["-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(file)]
    return subprocess.Popen(["ffmpeg", "-loglevel", "error", "-y", *source, *target], stdin=subprocess.PIPE)
