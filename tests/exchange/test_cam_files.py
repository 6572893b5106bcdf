"""APT/CLDATA and G-code: others' files are read, ours come back, what cannot be read is named."""

from dataclasses import replace

import numpy as np
import pytest

from polish_sim.config import PartConfig, PlanConfig
from polish_sim.errors import InputError
from polish_sim.exchange import ExportSetup, read_path, read_way_points
from polish_sim.exchange.apt import apt_text
from polish_sim.exchange.strokes import rows_without_straight_air
from polish_sim.planning import plan_part
from polish_sim.planning.toolpath import APPROACH, PROCESS, RETRACT
from tests.planning.shapes import shipped_plan, with_wishes

#: With the habits of several systems
CAM = """\
TOOL PATH/FINISH,TOOL,BALL_6
TLDATA/MILL,6.0000,3.0000,75.0000,0.0000,0.0000
MSYS/0.0000,0.0000,0.0000,1.0000000,0.0000000,0.0000000,0.0000000,1.0000000,0.0000000
$$-> CSYS / 1.0000000000, 0.0000000000, 0.0000000000, 0.0000000000, $
            0.0000000000, 1.0000000000, 0.0000000000, 0.0000000000
LOADTL / 1
PAINT/PATH
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
PAINT/NOMORE
SPINDL / OFF
END-OF-PATH
END
FINI
"""


def read(folder, text, kind="apt", **how):
    (folder / f"path.{kind}").write_text(text)
    return read_way_points(folder / f"path.{kind}", **how)


def test_points_axes_feeds_and_strokes_of_a_cam_file_are_read(tmp_path):
    path = read(tmp_path, CAM).path
    positions = 1e-3 * np.array([[0, 0, 50], [0, 0, 20], [10, 0, 20], [20, 0, 20]])
    assert path.positions_work[:4] == pytest.approx(positions)
    assert path.axes_work[:4] == pytest.approx(np.array([[0, 0, 1], [0, 0, 1], [0, 0.6, 0.8], [0.6, 0, 0.8]]))
    assert path.feed[:4] == pytest.approx([0.01, 0.01, 0.01, 0.005])
    air, part = APPROACH, PROCESS
    assert path.segment.tolist() == [air, part, part, part, air, air, part, part, RETRACT]
    assert path.pass_index.tolist() == [0, 0, 0, 0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize(
    ("text", "metres", "m_s"),
    [
        ("UNITS/INCHES\nFEDRAT/60", 0.0254, 0.0254), ("UNITS/CM\nFEDRAT/60", 1e-2, 1e-2),
        ("FEDRAT/MMPM,600", 1e-3, 0.01), ("FEDRAT/10,IPM", 1e-3, 0.254 / 60.0),
        ("FEDRAT/600,PERMIN", 1e-3, 0.01),
    ],
)  # fmt: skip
def test_units_hold_for_lengths_and_feeds_and_a_feed_may_name_its_own(tmp_path, text, metres, m_s):
    path = read(tmp_path, f"{text}\nGOTO/1,2,3\nGOTO/4,2,3\n").path
    assert path.positions_work[0] == pytest.approx(metres * np.array([1.0, 2.0, 3.0]))
    assert path.feed == pytest.approx([m_s, m_s])
    assert read(tmp_path, "GOTO/1,2,3\nGOTO/4,2,3\n").path.feed is None


@pytest.mark.parametrize("wishes", [False, True])
def test_our_own_file_comes_back_to_print_precision_and_moves_rapid_in_the_air_only(tmp_path, wishes):
    result = shipped_plan("plate_two_holes")
    result = with_wishes(result) if wishes else result
    path = result.path.rows(rows_without_straight_air(result.path))
    text = apt_text(result, ExportSetup())
    assert text.splitlines().count("RAPID") == np.isin(path.segment, (APPROACH, RETRACT)).sum()
    back = read(tmp_path, text).path
    assert np.abs(back.positions_work - path.positions_work).max() <= 0.5001e-9
    assert np.abs(back.axes_work - path.axes_work).max() < 2e-9
    assert (back.segment == path.segment).all()
    assert (back.pass_index == path.pass_index).all()
    assert back.feed[path.process] == pytest.approx(path.feed[path.process] if wishes else 0.01, abs=1e-10)
    assert (back.force is None) != wishes
    if wishes:
        assert back.force[path.process] == pytest.approx(path.force[path.process], abs=1e-6)


def test_straight_moves_in_the_air_and_turns_in_place_are_written_as_their_ends(tmp_path):
    result = shipped_plan("plate_two_holes")
    positions, axes = result.path.positions_work.copy(), result.path.axes_work.copy()
    positions[4:7] = positions[4] + 1e-10 * np.arange(3)[:, None]
    axes[4:7] = [(np.sin(a), 0.0, np.cos(a)) for a in (0.1, 0.2, 0.3)]
    result = replace(result, path=replace(result.path, positions_work=positions, axes_work=axes))
    back = read(tmp_path, apt_text(result, ExportSetup())).path
    there = np.linalg.norm(back.positions_work - positions[4], axis=1) < 1e-8
    assert back.axes_work[there] == pytest.approx(axes[6:7], abs=1e-9)
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


HEAD = "G21 G90\nG0 X0 Y0 Z0\nG1 F600\n"
PROGRAM = """%
O0001 (roughing)
N10 G21 G90 G17 G40 G54 T1 M6 S3000 M3 ; all of this moves nothing
N20 G00 X0 Y0 Z50
Z5. (down (it does not nest)
N30 G01 Z0 F600
x10 y+5.5
G91 X1 Y-2
G90 X 20. Y.5 F1200
M30
this is behind the end
""".replace(" (it does not nest", "")


def read_gcode(folder, text):
    return read(folder, text, "nc").path


def test_modal_words_comments_and_units_are_understood_and_axes_as_vectors_or_as_turns(tmp_path):
    path = read_gcode(tmp_path, PROGRAM)
    expected = [[0, 0, 50], [0, 0, 5], [0, 0, 0], [10, 5.5, 0], [11, 3.5, 0], [20, 0.5, 0]]
    assert 1e3 * path.positions_work == pytest.approx(np.array(expected))
    assert path.feed == pytest.approx([0.01] * 5 + [0.02])
    assert path.segment.tolist() == [0, 0, 2, 2, 2, 2]
    assert np.all(path.axes_work == [0.0, 0.0, 1.0])
    path = read_gcode(tmp_path, "G20\nG0 X1 Y2\nG0 Z3\nG1 X4 F60\n")
    assert path.positions_work == pytest.approx(0.0254 * np.array([[1, 2, 3], [4, 2, 3]]))
    assert path.feed == pytest.approx([0.0254, 0.0254])
    axes = read_gcode(tmp_path, HEAD + "X1 I0 J3 K4\nX2\nI0 J0 K9\n").axes_work
    assert axes == pytest.approx(np.array([[0, 0, 1], [0, 0.6, 0.8], [0, 0.6, 0.8], [0, 0, 1]]))
    tilted = (0, 0.5, np.sqrt(0.75))
    turns = {"B90 C90": (0, 1, 0), "A90 C90": (1, 0, 0), "A90 B45": (0, -1, 0), "A30 C180": tilted}
    for words, axis in turns.items():
        found = read_gcode(tmp_path, f"{HEAD}{words}\n").axes_work[1]
        assert found == pytest.approx(np.array(axis), abs=1e-15)
    found = read(tmp_path, HEAD + "X1\nB10\nB20\n", "nc")
    assert np.diff(found.path.s).tolist() == [0.001, 0.0, 0.0]
    assert found.place(3) == "line 6, point 4"
    with pytest.raises(InputError, match="points 2 and 3 are the same"):
        read_path(found.file)


TWO = "GOTO/0,0,0\nGOTO/1,0,0\n"
#: What all readers refuse alike, as a repeated point, is in test_plan_folder.py
BAD_APT = {
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
    "a spoilt note": ("$$ polish-sim: pass=first\n" + TWO, "line 2: pass is noted as 'first'"),
}
BAD_GCODE = {
    "an arc": (HEAD + "G2 X10 Y0 I5 J0\n", r"line 4, column 1: G2 \(an arc\)"),
    "a moved frame": (HEAD + "G55\nX1\n", r"line 4, column 1: G55 \(a moved frame\)"),
    "an unknown letter": (HEAD + "X1 U12\n", r"line 4, column 4: unknown word 'U12'"),
    "an unknown code": (HEAD + "G123 X1\n", r"line 4, column 1: unknown word 'G123'"),
    "a parameter": (HEAD + "X#1\n", r"line 4, column 1: 'X#1' is no word"),
    "an open comment": (HEAD + "X1 (open\n", r"line 4, column 4: the comment's bracket"),
    "a letter twice": (HEAD + "X1 X2\n", r"line 4, column 4: X stands twice"),
    "no way to move": ("X1 Y2 Z3\n", r"line 1, column 1: X1 stands before any G0 or G1"),
    "a step from nowhere": ("G91 G1 X1\n", "from an unknown place"),
    "half a vector": (HEAD + "X1 I0 K1\n", "stand together"),
    "a zero vector": (HEAD + "X1 I0 J0 K0\n", "no direction"),
    "two ways": (HEAD + "A10\nX1 I0 J0 K1\n", "give it in one way"),
    "no feed": (HEAD + "X1 F0\n", r"line 4, column 4: F0 is no feed"),
    "nothing": ("M30\n", "holds no points"),
    "in the air only": ("G0 X0 Y0 Z0\nX5\n", "every move is G0"),
}
BAD = {"apt": BAD_APT, "nc": BAD_GCODE}


@pytest.mark.parametrize(("kind", "case"), [(kind, case) for kind in BAD for case in BAD[kind]])
def test_what_cannot_be_read_is_named_with_its_place(tmp_path, kind, case):
    text, message = BAD[kind][case]
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, text, kind)
    assert f"path.{kind}" in str(caught.value)


def test_unknown_words_can_be_left_out_but_never_a_motion(tmp_path):
    notes = []
    found = read(tmp_path, HEAD + "X1 U12 G123\nX#1 Y2\nG4 X9\n", "nc", unknown=notes.append)
    assert 1e3 * found.path.positions_work == pytest.approx(np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0]]))
    for word, note in zip(("U12", "G123", "X#1", "G4"), notes, strict=True):
        assert word in str(note)
    with pytest.raises(InputError, match=r"an arc.*--lenient"):
        read(tmp_path, HEAD + "G2 X1 R1\n", "nc", unknown=notes.append)
