"""Pictures of the cell without a display; a machine without OpenGL gets one message instead."""

from __future__ import annotations

import ctypes
import os
import sys
import warnings
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cli import console


class Quality(NamedTuple):
    """Size of a picture and what is spent on it; without a graphics card that is most of a film's time."""

    width: int
    height: int
    samples: int
    """Samples per pixel against jagged edges."""
    shadow: int
    """Resolution of the shadows."""


STILL: Final = Quality(960, 720, 4, 2048)
FILM: Final = Quality(640, 480, 0, 1024)
LOOK_AT: Final = (0.0, -0.32, 0.28)
DISTANCE: Final = 1.65
AZIMUTH, ELEVATION = 125.0, -22.0
PAIR_DISTANCE: Final = 2.0
PAIR_AZIMUTH, PAIR_ELEVATION = 70.0, -18.0
"""Of two robots, seen from the side."""


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
            model.vis.global_.offwidth = max(model.vis.global_.offwidth, quality.width)
            model.vis.global_.offheight = max(model.vis.global_.offheight, quality.height)
            model.vis.quality.offsamples, model.vis.quality.shadowsize = quality.samples, quality.shadow
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # a missing display is told once, below
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

    def render(self, data: Any) -> NDArray[np.uint8]:
        """Render one moment, shape (height, width, 3)."""
        self._renderer.update_scene(data, self._camera)
        return np.array(self._renderer.render(), dtype=np.uint8)

    def close(self) -> None:
        """Give the renderer's memory back."""
        self._renderer.close()


def save_image(file: Path, image: NDArray[np.uint8]) -> None:
    """Write an image, shape (height, width, 3), as PNG."""
    from PIL import Image

    Image.fromarray(image).save(file)
