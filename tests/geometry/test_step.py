"""STEP files: the solid is read in the unit the file states; what cannot be read is one clear error."""

import importlib.util
import math
import sys

import numpy as np
import pytest
import trimesh

from polish_sim.errors import MeshError
from polish_sim.geometry import fit_surface, load_part, mesh_file

LENGTHS = {
    "mm": "LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.)",
    "inch": "CONVERSION_BASED_UNIT('INCH',#15)LENGTH_UNIT()NAMED_UNIT(#14)",
}
BALL = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('part','2020-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
#1=APPLICATION_CONTEXT('');
#2=PRODUCT_CONTEXT('',#1,'mechanical');
#3=PRODUCT('part','part','',(#2));
#4=PRODUCT_DEFINITION_FORMATION('','',#3);
#5=PRODUCT_DEFINITION_CONTEXT('part definition',#1,'design');
#6=PRODUCT_DEFINITION('design','',#4,#5);
#7=PRODUCT_DEFINITION_SHAPE('','',#6);
#8=SHAPE_DEFINITION_REPRESENTATION(#7,#9);
#9=ADVANCED_BREP_SHAPE_REPRESENTATION('',(#20),#10);
#10=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((#11,#12,#13))REPRESENTATION_CONTEXT('',''));
#11=({length});
#12=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#13=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#14=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);
#15=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#16);
#16=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#20=MANIFOLD_SOLID_BREP('',#21);
#21=CLOSED_SHELL('',(#22));
#22=ADVANCED_FACE('',(#23),#27,.T.);
#23=FACE_BOUND('',#24,.T.);
#24=VERTEX_LOOP('',#25);
#25=VERTEX_POINT('',#26);
#26=CARTESIAN_POINT('',(0.,0.,-{radius!r}));
#27=SPHERICAL_SURFACE('',#28,{radius!r});
#28=AXIS2_PLACEMENT_3D('',#29,#30,#31);
#29=CARTESIAN_POINT('',(0.,0.,0.));
#30=DIRECTION('',(0.,0.,1.));
#31=DIRECTION('',(1.,0.,0.));
ENDSEC;
END-ISO-10303-21;
"""


installed = pytest.mark.skipif(
    importlib.util.find_spec("cascadio") is None,
    reason="STEP files are read with: pip install 'polish-sim[cad]'",
)
ENDLESS = "import time; time.sleep(60)"
GREEDY = "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (2**28, 2**28)); bytearray(2**30)"


def ball(radius, unit="mm"):
    """A STEP file written by hand: a ball about the origin."""
    return BALL.format(length=LENGTHS[unit], radius=radius)


def write(folder, text, name="part.step"):
    file = folder / name
    file.write_text(text)
    return file


@installed
@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("inch", 0.0254)])
def test_a_ball_has_its_size_and_area_in_its_own_unit_whatever_is_asked_for(tmp_path, unit, metres):
    part = load_part(write(tmp_path, ball(0.05 / metres, unit), "ball.stp"), unit="inch")
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
        load_part(write(tmp_path, ball(1.0)))
    assert "--units" not in str(refused.value)
    with pytest.raises(MeshError, match=r"no solid and no surface|cannot read"):
        load_part(write(tmp_path, ball(50.0).replace("ADVANCED_FACE", "NO_SUCH_FACE")))


def test_a_file_cut_short_or_of_another_kind_is_refused_and_without_the_reader_any(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cascadio", None)
    for text, name, says in (
        (ball(50.0)[:-300], "part.step", "cut short"),
        ("no STEP\n" * 20, "part.stp", "not a STEP file"),
        (ball(50.0), "part.step", r"pip install 'polish-sim\[cad\]'"),
    ):
        with pytest.raises(MeshError, match=says):
            load_part(write(tmp_path, text, name))


@pytest.mark.parametrize(("child", "says"), [(ENDLESS, "longer than 1 s"), (GREEDY, "cannot read")])
def test_a_reader_that_hangs_or_breaks_is_ended_with_one_error(tmp_path, monkeypatch, child, says):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: True)
    monkeypatch.setattr(mesh_file, "getsource", lambda _: child)
    monkeypatch.setattr(mesh_file, "SECONDS", 1.0)
    with pytest.raises(MeshError, match=says):
        load_part(write(tmp_path, ball(50.0)))
