"""STEP files: what is read is the solid, in the unit the file states; what cannot be read is one clear error."""

import importlib.util
import math
import sys

import numpy as np
import pytest
import trimesh

from polish_sim.errors import MeshError
from polish_sim.geometry import fit_surface, load_part, step_file
from tests.geometry.step import ball, block

installed = pytest.mark.skipif(
    importlib.util.find_spec("cascadio") is None, reason="STEP files are read with: pip install 'polish-sim[cad]'"
)
CUT_SHORT = block(100, 60, 20)[:-400]
ENDLESS = "import time; time.sleep(60)"
GREEDY = "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (2**28, 2**28)); bytearray(2**30)"


def write(folder, text, name="part.step"):
    file = folder / name
    file.write_text(text)
    return file


@installed
@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("inch", 0.0254)])
def test_a_block_has_its_size_area_and_volume_whatever_unit_it_is_written_in(tmp_path, unit, metres):
    sides = np.array([0.1, 0.06, 0.02])
    part = load_part(write(tmp_path, block(*(sides / metres), unit=unit)), up="z")
    solid = trimesh.Trimesh(part.vertices, part.faces, process=False)
    assert solid.is_watertight
    assert solid.bounds == pytest.approx(np.stack([np.zeros(3), sides]), abs=1e-8)
    assert solid.volume == pytest.approx(np.prod(sides), rel=1e-6)
    assert solid.area == pytest.approx(0.0184, rel=1e-6)


@installed
def test_the_surface_through_a_ball_s_facets_is_the_ball_within_a_micrometre(tmp_path):
    part = load_part(write(tmp_path, ball(50.0), "ball.stp"))
    surface = fit_surface(part)
    rng = np.random.default_rng(1)
    facets = rng.integers(0, len(surface.faces), 5000).astype(np.int32)
    points = surface.evaluate(facets, rng.dirichlet(np.ones(3), 5000)).positions
    assert np.linalg.norm(points, axis=1) == pytest.approx(0.05, abs=1e-6)
    assert surface.facet_areas.sum() == pytest.approx(4.0 * math.pi * 0.05**2, rel=1e-5)
    assert any("0.1 mm" in note for note in part.notes)


@installed
def test_the_stated_unit_counts_whatever_is_asked_for_and_none_is_advised(tmp_path):
    assert np.ptp(load_part(write(tmp_path, block(100, 60, 20)), unit="inch").vertices[:, 0]) == pytest.approx(0.1)
    with pytest.raises(MeshError, match=r"too small: 2 mm .* No known unit fits") as refused:
        load_part(write(tmp_path, block(2, 2, 2)))
    assert "--units" not in str(refused.value)


@installed
def test_a_file_without_a_face_is_refused(tmp_path):
    with pytest.raises(MeshError, match=r"no solid and no surface|cannot read"):
        load_part(write(tmp_path, block(100, 60, 20).replace("ADVANCED_FACE", "NO_SUCH_FACE")))


@pytest.mark.parametrize(
    ("text", "name", "says"),
    [(CUT_SHORT, "part.step", "cut short"), ("no STEP\n" * 20, "part.stp", "not a STEP file")],
)
def test_a_file_cut_short_or_of_another_kind_is_refused_without_the_reader(tmp_path, text, name, says):
    with pytest.raises(MeshError, match=says):
        load_part(write(tmp_path, text, name))


def test_without_the_reader_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cascadio", None)
    with pytest.raises(MeshError, match=r"pip install 'polish-sim\[cad\]'"):
        load_part(write(tmp_path, block(100, 60, 20)))


@pytest.mark.parametrize(("child", "says"), [(ENDLESS, "longer than 1 s"), (GREEDY, "cannot read")])
def test_a_reader_that_hangs_or_breaks_is_ended_with_one_error(tmp_path, monkeypatch, child, says):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: True)
    monkeypatch.setattr(step_file, "_CHILD", write(tmp_path, child, "child.py"))
    monkeypatch.setattr(step_file, "SECONDS", 1.0)
    with pytest.raises(MeshError, match=says):
        load_part(write(tmp_path, block(100, 60, 20)))
