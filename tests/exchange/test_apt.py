"""APT/CLDATA in and out: what other systems write is read, what we write comes back, what cannot be read is
named."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.config import PartConfig, PlanConfig
from polish_sim.errors import InputError
from polish_sim.exchange import ExportSetup, read_path
from polish_sim.exchange.apt import apt_text
from polish_sim.exchange.strokes import rows_without_straight_air
from polish_sim.planning import plan_part
from polish_sim.planning.toolpath import APPROACH, PROCESS, RETRACT
from tests.planning.shapes import shipped_plan, with_wishes

CAM = """\
PARTNO HOUSING/REV 2, 40 $ HEAVY
$$ written by a CAM system
MACHIN/POST, 1
UNITS/MM
MULTAX/ON
CUTTER/ 50.0, 0, $
  0,0,0,0,30
SPINDL/6000.0000,RPM,CLW
FROM/0,0,100,0,0,1
RAPID
GOTO/ 0.0, 0.0, 50.0, 0.0, 0.0, 1.0
FEDRAT/ 600.0000,MMPM
goto/ 0.0, 0.0, 20.0   $$ axis as before
GOTO/ 10.0, 0.0, 20.0, $
      0.0, 0.6, 0.8
PPRINT/ANYTHING AT ALL $
FEDRAT/300
TLAXIS/0.6,0,0.8
GOTO / 20., 0, 2.0E+1
RAPID
GOTO/20,0,50
RAPID
GOTO/0,30,50
GOTO/0,30,20
GOTO/10,30,20
RAPID
GOTO/10,30,50
FINI
"""


def read(folder, text):
    """The path in an APT file of this text."""
    (folder / "path.apt").write_text(text)
    return read_path(folder / "path.apt")


def test_points_axes_feeds_and_strokes_of_a_cam_file_are_read(tmp_path):
    path = read(tmp_path, CAM)
    assert path.positions_work[:4] == pytest.approx(
        1e-3 * np.array([[0, 0, 50], [0, 0, 20], [10, 0, 20], [20, 0, 20]])
    )
    assert path.axes_work[:4] == pytest.approx(np.array([[0, 0, 1], [0, 0, 1], [0, 0.6, 0.8], [0.6, 0, 0.8]]))
    assert path.feed is not None
    assert path.feed[:4] == pytest.approx([0.01, 0.01, 0.01, 0.005])
    air, part = APPROACH, PROCESS
    assert path.segment.tolist() == [air, part, part, part, air, air, part, part, RETRACT]
    assert path.pass_index.tolist() == [0, 0, 0, 0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize(
    ("text", "metres", "m_s"),
    [
        ("UNITS/INCHES\nFEDRAT/60", 0.0254, 0.0254),
        ("UNITS/CM\nFEDRAT/60", 1e-2, 1e-2),
        ("FEDRAT/MMPM,600", 1e-3, 0.01),
        ("FEDRAT/10,IPM", 1e-3, 0.254 / 60.0),
        ("FEDRAT/600,PERMIN", 1e-3, 0.01),
    ],
)
def test_units_hold_for_lengths_and_feeds_and_a_feed_may_name_its_own(tmp_path, text, metres, m_s):
    path = read(tmp_path, f"{text}\nGOTO/1,2,3\nGOTO/4,2,3\n")
    assert path.positions_work[0] == pytest.approx(metres * np.array([1.0, 2.0, 3.0]))
    assert path.feed == pytest.approx([m_s, m_s])


@pytest.mark.parametrize("wishes", [False, True])
def test_our_own_file_comes_back_to_print_precision_and_moves_rapid_in_the_air_only(tmp_path, wishes):
    result = with_wishes(shipped_plan("plate_two_holes")) if wishes else shipped_plan("plate_two_holes")
    path = result.path.rows(rows_without_straight_air(result.path))
    text = apt_text(result, ExportSetup())
    assert text.splitlines().count("RAPID") == np.isin(path.segment, (APPROACH, RETRACT)).sum()
    back = read(tmp_path, text)
    assert np.abs(back.positions_work - path.positions_work).max() <= 0.5001e-9
    assert np.abs(back.axes_work - path.axes_work).max() < 2e-9
    assert (back.segment == path.segment).all()
    assert (back.pass_index == path.pass_index).all()
    assert back.feed is not None
    assert back.feed[path.process] == pytest.approx(path.feed[path.process] if wishes else 0.01, abs=1e-10)
    assert (back.force is None) != wishes
    if wishes:
        assert back.force[path.process] == pytest.approx(path.force[path.process], abs=1e-6)


def test_left_out_points_lie_in_the_air_on_the_straight_move_between_those_written():
    path = plan_part(PartConfig("sphere_50"), PlanConfig(lead_in="arc")).path
    kept = rows_without_straight_air(path)
    rows, lost = np.flatnonzero(kept), np.flatnonzero(~kept)
    assert len(lost) > 0.8 * np.count_nonzero(path.segment == APPROACH)
    assert not path.process[lost].any()
    after = np.searchsorted(rows, lost)
    start, end = path.positions_work[rows[after - 1]], path.positions_work[rows[after]]
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    away = path.positions_work[lost] - start
    assert np.linalg.norm(away - (away * along).sum(axis=1, keepdims=True) * along, axis=1).max() <= 1e-6
    assert (path.segment[rows[after]] == path.segment[lost]).all()


OTHERS = {
    "Siemens NX": """\
TOOL PATH/FINISH,TOOL,BALL_6
TLDATA/MILL,6.0000,3.0000,75.0000,0.0000,0.0000
MSYS/0.0000,0.0000,0.0000,1.0000000,0.0000000,0.0000000,0.0000000,1.0000000,0.0000000
$$ centerline data
PAINT/PATH
RAPID
GOTO/0.0000,0.0000,30.0000,0.0000000,0.0000000,1.0000000
FEDRAT/MMPM,250.0000
GOTO/0.0000,0.0000,0.0000
GOTO/10.0000,0.0000,0.0000
PAINT/NOMORE
END-OF-PATH
""",
    "Creo": """\
$$* Creo CL file
PARTNO / FINISH
$$-> CSYS / 1.0000000000, 0.0000000000, 0.0000000000, 0.0000000000, $
            0.0000000000, 1.0000000000, 0.0000000000, 0.0000000000, $
            0.0000000000, 0.0000000000, 1.0000000000, 0.0000000000
MULTAX / ON
UNITS / MM
LOADTL / 1
SPINDL / RPM, 6000.000000,  CLW
RAPID
GOTO / 0.0000000000, 0.0000000000, 30.0000000000, $
       0.0000000000, 0.0000000000, 1.0000000000
FEDRAT / 250.000000,  MMPM
GOTO / 0.0000000000, 0.0000000000, 0.0000000000
GOTO / 10.0000000000, 0.0000000000, 0.0000000000
SPINDL / OFF
END
FINI
""",
}


@pytest.mark.parametrize("system", OTHERS)
def test_the_habits_of_other_systems_are_understood(tmp_path, system):
    path = read(tmp_path, OTHERS[system])
    assert path.positions_work == pytest.approx(1e-3 * np.array([[0, 0, 30], [0, 0, 0], [10, 0, 0]]))
    assert path.segment.tolist() == [APPROACH, PROCESS, PROCESS]
    assert path.feed == pytest.approx([0.25 / 60.0] * 3)


TWO = "GOTO/0,0,0\nGOTO/1,0,0\n"
#: What all readers refuse alike, as a repeated point, is in test_plan_folder.py
BAD = {
    "arcs by definition": (TWO + "C1=CIRCLE/0,0,0,5\n", r"line 3: CIRCLE \(arcs\)"),
    "canned cycles": (TWO + "CYCLE/DRILL,5\n", "line 3: CYCLE"),
    "a turned frame": ("MSYS/0,0,0,0,1,0,-1,0,0\n" + TWO, "line 1: MSYS"),
    "G-code": ("G0 X0 Y0\nG1 X1\n", "line 1: unknown word 'G0 X0 Y0'"),
    "five values": ("GOTO/0,0,0\nGOTO/1,0,0,0,1\n", "line 2: GOTO has 5 values"),
    "a word for a number": ("GOTO/0,0,0\nGOTO/1,O,0\n", "line 2: GOTO: 'O' is not a number"),
    "not a number": ("GOTO/0,0,0\nGOTO/1,nan,0\n", "line 2: GOTO: 'NAN' is not a number"),
    "a zero axis": ("GOTO/0,0,0,0,0,1\nGOTO/1,0,0,0,0,0\n", "line 2, point 2: the tool axis .* has length 0"),
    "no points": ("UNITS/MM\n", "no GOTO"),
    "all in the air": ("RAPID\nGOTO/0,0,0\nRAPID\nGOTO/1,0,0\n", "every GOTO is RAPID"),
    "an unknown unit": ("UNITS/FURLONG\n" + TWO, "line 1: unknown unit 'FURLONG'"),
    "no feed": ("FEDRAT/FAST\n" + TWO, "line 1: FEDRAT/FAST is no feed"),
    "a feed backwards": ("FEDRAT/-5,MMPM\n" + TWO, "line 1: FEDRAT/-5,MMPM is no feed"),
    "a feed per turn": ("FEDRAT/0.1,MMPR\n" + TWO, "line 1: a feed per turn"),
    "half a statement": (TWO + "GOTO/2,$\n", "line 3: the statement is continued"),
    "multax": ("MULTAX/MAYBE\n" + TWO, "line 1: MULTAX"),
    "a spoilt note": ("$$ polish-sim: pass=first\n" + TWO, "before line 2: pass is noted as 'first'"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_read_is_named_with_its_line(tmp_path, case):
    text, message = BAD[case]
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, text)
    assert "path.apt" in str(caught.value)
