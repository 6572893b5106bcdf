"""The picture of the cell, which is rendered without a display."""

from __future__ import annotations

import ctypes
import os
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from polish_sim.cli import console
from polish_sim.row_file import QUICK_PNG

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from polish_sim.analysis.run_record import RunRecord

    Image = NDArray[np.uint8]

CELL_PICTURE = "cell.png"


class PictureSize(NamedTuple):
    """Size of a picture and of its shadows' map [pixels]; without a graphics card that is most of a film's
    time."""

    width: int
    height: int
    shadow: int


LIBRARIES = {"egl": "libEGL.so.1", "osmesa": "libOSMesa.so.8"}  #: By the values of MUJOCO_GL
STOP_COLOR = "#E00020"
CELL = PictureSize(1080, 960, 2048)  #: As drawn
FINER = 1.5  #: Times drawn larger than kept: smooth edges in half the time of several samples per pixel
PAD_WIDTH = 840  #: As drawn, of the picture of the pad on the part, from near
LOOK_AT = (0.0, -0.32, 0.28)
DISTANCE, PAIR_DISTANCE = 1.36, 1.82  #: From the cell, of one or two robots, over its extent
AZIMUTH, ELEVATION = 125.0, -22.0
PAIR_AZIMUTH, PAIR_ELEVATION = 70.0, -18.0  #: Of two robots, seen from the side
NEAR = 0.4  #: Distance from the pad in the picture of pad and part


def prepare_headless() -> None:
    """Ask MuJoCo for rendering without a window, where it can; has to happen before it is imported.

    MuJoCo cannot be imported at all when it is asked for a library that does not load: it is asked for none
    then.
    """
    if sys.platform != "linux":
        return
    asked = os.environ.get("MUJOCO_GL", "").lower()
    if not asked and not os.environ.get("DISPLAY") and _loads("egl"):
        os.environ["MUJOCO_GL"] = "egl"
    elif asked in LIBRARIES and not _loads(asked):
        console.note(
            f"MUJOCO_GL={asked} is not installed ({LIBRARIES[asked]} does not load): nothing is rendered."
        )
        os.environ["MUJOCO_GL"] = "disable"


def _loads(name: str) -> bool:
    try:
        ctypes.CDLL(LIBRARIES[name])
    except OSError:
        return False
    return True


class Picture:
    """Renders a model's moments: the whole cell, or the pad on the part from near."""

    def __init__(self, model: Any, size: PictureSize) -> None:
        """Open a renderer; what a missing OpenGL raises depends on the platform."""
        import mujoco

        model.vis.global_.offwidth = size.width
        model.vis.global_.offheight = size.height
        model.vis.quality.offsamples = 0
        model.vis.quality.shadowsize = size.shadow
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a missing display is reported by who catches the error
            # Room for ten thousand geoms, as by default, takes 15 ms to make, the larger letters 7 ms.
            font = mujoco.mjtFontScale.mjFONTSCALE_50
            self._renderer = mujoco.Renderer(model, size.height, size.width, 1000, font)
        # Without a window the floor shows no reflection; it would be drawn all the same.
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._camera = mujoco.MjvCamera()
        self._model = model
        self._pair = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "master_base") >= 0

    def render(self, data: Any, pad: NDArray[np.float64], near: bool = False) -> Image:
        """Render one moment with the pad there (3,) [m], from ``near`` or the whole cell: (height, width,
        3)."""
        import numpy as np

        camera = self._camera
        pair = self._pair
        camera.lookat[:] = pad if near else self._model.stat.center if pair else LOOK_AT
        camera.distance = NEAR if near else (PAIR_DISTANCE if pair else DISTANCE) * self._model.stat.extent
        camera.azimuth, camera.elevation = (PAIR_AZIMUTH, PAIR_ELEVATION) if pair else (AZIMUTH, ELEVATION)
        self._renderer.update_scene(data, camera)
        return np.array(self._renderer.render(), dtype=np.uint8)

    def close(self) -> None:
        """Give the renderer's memory back."""
        self._renderer.close()


def save_cell_picture(file: Path, record: RunRecord, model: Any) -> bool:
    """Render the cell and the pad from near, in the middle of a run or at its stop; whether there is OpenGL
    for it."""
    import mujoco
    import numpy as np
    from PIL import Image as Pillow

    from polish_sim.analysis.run_record import stop_mark
    from polish_sim.experiments.run_page import clock, joint_columns

    stop = stop_mark(record.metrics)
    data = mujoco.MjData(model)
    row = min(
        int(np.searchsorted(clock(record.log), stop.time)) if stop else len(record.log) // 2,
        len(record.log) - 1,
    )
    data.qpos[:] = joint_columns(record, model)[row]
    mujoco.mj_forward(model, data)
    pad = record.log["tcp_position_m"][row]
    try:
        picture = Picture(model, CELL)
    except Exception as error:
        console.note(f"no OpenGL on this machine ({type(error).__name__}: {error}): no {file.name}.")
        return False
    cut = (CELL.width - PAD_WIDTH) // 2
    images = [picture.render(data, pad), picture.render(data, pad, near=True)[:, cut : cut + PAD_WIDTH]]
    picture.close()
    drawn = Pillow.fromarray(np.hstack(images))
    whole = drawn.resize((int(drawn.width / FINER), int(drawn.height / FINER)))
    if stop:
        from PIL import ImageDraw  # slow to import

        ImageDraw.Draw(whole).text((10, 8), stop.text, fill=STOP_COLOR, font_size=18)
    whole.save(file, **QUICK_PNG)
    return True
