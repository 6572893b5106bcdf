"""STEP files: the solid is read in the unit the file states; what cannot be read is one clear error."""

import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from polish_sim.errors import MeshError
from polish_sim.geometry import fit_surface, load_part, mesh_file
from tests.geometry.test_mesh_files import write

MILLIMETRE = "#11=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));"
INCH = "#11=(CONVERSION_BASED_UNIT('INCH',#15)LENGTH_UNIT()NAMED_UNIT(#14));"
BALL = (Path(__file__).parent / "ball.step").read_text()
"""Written by hand: a ball of 50 mm radius about the origin."""

installed = pytest.mark.skipif(importlib.util.find_spec("cascadio") is None, reason="needs polish-sim[cad]")
ENDLESS = "import time; time.sleep(60)"
GREEDY = "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (2**28, 2**28)); bytearray(2**30)"


@installed
@pytest.mark.parametrize(("unit", "radius"), [(MILLIMETRE, 50.0), (INCH, 50.0 / 25.4)], ids=["mm", "inch"])
def test_a_ball_has_its_size_and_area_in_its_own_unit_whatever_is_asked_for(tmp_path, unit, radius):
    text = BALL.replace(MILLIMETRE, unit).replace("50.0", repr(radius))
    part = load_part(write(tmp_path, "ball.stp", text), unit="inch")
    assert trimesh.Trimesh(part.vertices, part.faces, process=False).is_watertight
    surface, rng = fit_surface(part), np.random.default_rng(1)
    facets = rng.integers(0, len(surface.faces), 5000).astype(np.int32)
    points = surface.evaluate(facets, rng.dirichlet(np.ones(3), 5000)).positions
    assert np.linalg.norm(points, axis=1) == pytest.approx(0.05, abs=1e-6)
    assert surface.facet_areas.sum() == pytest.approx(4.0 * math.pi * 0.05**2, rel=1e-5)
    assert any("0.1 mm" in note for note in part.notes)


@installed
def test_a_part_too_small_is_refused_without_advice_on_units_and_a_file_without_a_face(tmp_path):
    with pytest.raises(MeshError, match=r"too small: 2 mm .* No known unit fits") as refused:
        load_part(write(tmp_path, "part.step", BALL.replace("50.0", "1.0")))
    assert "--units" not in str(refused.value)
    with pytest.raises(MeshError, match=r"no solid and no surface|cannot read"):
        load_part(write(tmp_path, "part.step", BALL.replace("ADVANCED_FACE", "NO_SUCH_FACE")))


def test_a_file_cut_short_or_of_another_kind_is_refused_and_without_the_reader_any(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cascadio", None)
    for text, name, says in (
        (BALL[:-300], "part.step", "cut short"),
        ("no STEP\n" * 20, "part.stp", "not a STEP file"),
        (BALL, "part.step", r"pip install 'polish-sim\[cad\]'"),
    ):
        with pytest.raises(MeshError, match=says):
            load_part(write(tmp_path, name, text))


@pytest.mark.parametrize(("child", "says"), [(ENDLESS, "longer than 1 s"), (GREEDY, "cannot read")])
def test_a_reader_that_hangs_or_breaks_is_ended_with_one_error(tmp_path, monkeypatch, child, says):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: True)
    monkeypatch.setattr(mesh_file, "getsource", lambda _: child)
    monkeypatch.setattr(mesh_file, "SECONDS", 1.0)
    with pytest.raises(MeshError, match=says):
        load_part(write(tmp_path, "part.step", BALL))
