"""G-code in: straight moves, units, tool axes as vectors or angles, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.errors import InputError
from polish_sim.exchange import read_path, read_way_points

HEAD = "G21 G90\nG0 X0 Y0 Z0\nG1 F600\n"


def read(tmp_path, text, **how):
    file = tmp_path / "path.nc"
    file.write_text(text)
    return read_way_points(file, **how)


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


def test_modal_words_steps_and_comments_are_understood(tmp_path):
    path = read(tmp_path, PROGRAM).path
    expected = [[0, 0, 50], [0, 0, 5], [0, 0, 0], [10, 5.5, 0], [11, 3.5, 0], [20, 0.5, 0]]
    assert 1e3 * path.positions_work == pytest.approx(np.array(expected))
    assert path.feed == pytest.approx([0.01] * 5 + [0.02])
    assert path.segment.tolist() == [0, 0, 2, 2, 2, 2]
    assert np.all(path.axes_work == [0.0, 0.0, 1.0])


def test_an_inch_is_25_4_millimetres(tmp_path):
    path = read(tmp_path, "G20\nG0 X0 Y0 Z0\nG1 X1 F60\n").path
    assert path.positions_work[1] == pytest.approx([0.0254, 0.0, 0.0])
    assert path.feed == pytest.approx([0.0254, 0.0254])


def test_the_path_begins_where_all_three_coordinates_are_known(tmp_path):
    points = 1e3 * read(tmp_path, "G0 X1 Y2\nG0 Z3\nG1 X4\n").path.positions_work
    assert points.tolist() == [[1, 2, 3], [4, 2, 3]]


def test_a_vector_of_any_length_is_the_tool_axis_until_the_next(tmp_path):
    axes = read(tmp_path, HEAD + "X1 I0 J3 K4\nX2\nI0 J0 K9\n").path.axes_work
    assert axes == pytest.approx(np.array([[0, 0, 1], [0, 0.6, 0.8], [0, 0.6, 0.8], [0, 0, 1]]))


@pytest.mark.parametrize(
    ("words", "axis"),
    [
        ("B90 C90", (0, 1, 0)), ("A90 B45", (0, -1, 0)), ("A30 C180", (0, 0.5, np.sqrt(0.75))),
    ],
)  # fmt: skip
def test_a_turns_about_x_then_b_about_y_then_c_about_z(tmp_path, words, axis):
    assert read(tmp_path, HEAD + words + "\n").path.axes_work[1] == pytest.approx(np.array(axis), abs=1e-15)


def test_turning_in_place_is_a_move_for_those_who_ask_for_way_points(tmp_path):
    found = read(tmp_path, HEAD + "X1\nB10\nB20\n")
    assert np.diff(found.path.s).tolist() == [0.001, 0.0, 0.0]
    assert found.place(3) == "line 6, point 4"
    with pytest.raises(InputError, match="points 2 and 3 are the same"):
        read_path(found.file)


BAD = {
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


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_read_is_named_with_line_and_column(tmp_path, case):
    text, message = BAD[case]
    with pytest.raises(InputError, match=message):
        read(tmp_path, text)


def test_unknown_words_can_be_left_out_but_never_a_motion(tmp_path):
    notes: list[str] = []
    found = read(tmp_path, HEAD + "X1 U12 G123\nX#1 Y2\n", unknown=lambda error: notes.append(str(error)))
    assert 1e3 * found.path.positions_work == pytest.approx(np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0]]))
    assert ["U12" in notes[0], "G123" in notes[1], "X#1" in notes[2], len(notes)] == [True, True, True, 3]
    with pytest.raises(InputError, match=r"an arc.*--lenient does not leave out what moves the tool"):
        read(tmp_path, HEAD + "G2 X1 R1\n", unknown=lambda error: None)


def test_a_dwell_is_unknown_and_its_time_no_coordinate(tmp_path):
    with pytest.raises(InputError, match="G4"):
        read(tmp_path, HEAD + "G4 P2\nX1\n")
    assert len(read(tmp_path, HEAD + "G4 X2\nX1\n", unknown=lambda error: None).path.s) == 2
