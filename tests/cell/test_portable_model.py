"""A written model compiles wherever its folder is moved."""

from __future__ import annotations

import shutil
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from polish_sim.identification.model_file import write_portable
from polish_sim.models import workpiece_path


def test_meshes_of_one_name_and_a_texture_travel_with_the_model(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    for folder, name in ((one, "plate"), (two, "saddle")):
        folder.mkdir()
        shutil.copyfile(workpiece_path(name), folder / "part.stl")
    Image.fromarray(np.zeros((4, 4, 3), dtype=np.uint8)).save(one / "skin.png")
    xml = (
        f'<mujoco><compiler meshdir="{one}" texturedir="{one}"/><asset><mesh file="part.stl" scale=".001 .001 .001"/>'
        f'<mesh name="other" file="{two / "part.stl"}" scale=".001 .001 .001"/><texture type="2d" file="skin.png"/>'
        '</asset><worldbody><geom type="mesh" mesh="part"/><geom type="mesh" mesh="other"/></worldbody></mujoco>'
    )
    before = mujoco.MjModel.from_xml_string(xml)
    written = tmp_path / "written"
    written.mkdir()
    write_portable(written / "model.xml", xml)
    shutil.rmtree(one)
    shutil.rmtree(two)
    after = mujoco.MjModel.from_xml_path(str(written.rename(tmp_path / "moved") / "model.xml"))
    np.testing.assert_array_equal(after.mesh_vertnum, before.mesh_vertnum)
    assert after.ntex == 1
