"""Files of touches and moves, in every form a user may have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.dual.calibration.tool import ToolMeasurements, fit_tool_frame, read_tool_measurements, tool_table
from polish_sim.dual.calibration.tool_checks import ToolTouches, plan_touch_orientations
from polish_sim.errors import InputError
from polish_sim.spatial import from_pose, transform

T_FLANGE_TOOL = from_pose([0.01, -0.02, 0.2, 0.1, -0.2, 0.3])
POINT = np.array([-0.4, 0.1, 0.3])
MOVES = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1.0], [-1, 0, 0]])


def flange_at(R: np.ndarray, tips: np.ndarray) -> np.ndarray:
    return transform(R, tips - R @ T_FLANGE_TOOL[:3, 3])


R_TOUCHES = plan_touch_orientations(8, 0.8)
R_MOVES = np.tile(R_TOUCHES[2], (5, 1, 1))
MEASURED = ToolMeasurements(
    ToolTouches(flange_at(R_TOUCHES, np.tile(POINT, (8, 1)))),
    flange_at(R_MOVES, POINT + MOVES @ (R_MOVES[0] @ T_FLANGE_TOOL[:3, :3]).T),
    MOVES,
)


def test_any_moves_by_known_amounts_read_back_and_give_the_axes(tmp_path: Path) -> None:
    file = tmp_path / "moves.csv"
    file.write_text(tool_table(MEASURED, fit_tool_frame(MEASURED)), encoding="utf-8")
    found = fit_tool_frame(read_tool_measurements(file))
    np.testing.assert_allclose(found.T_flange_tool, T_FLANGE_TOOL, atol=1e-8)


def test_metres_and_rotation_vectors_as_a_ur_shows_them(tmp_path: Path) -> None:
    rows = ["X_m, y_m, z_m, rx_rad, ry_rad, rz_rad"]
    for T in MEASURED.touches.T_base_flange:
        values = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_rotvec()]
        rows.append(", ".join(f"{value:.10f}" for value in values))
    file = tmp_path / "ur.csv"
    file.write_text("\n".join(rows), encoding="utf-8")
    found = fit_tool_frame(read_tool_measurements(file))
    np.testing.assert_allclose(found.tip.point, T_FLANGE_TOOL[:3, 3], atol=1e-8)
    assert found.orientation is None


def test_an_unknown_kind_names_its_line(tmp_path: Path) -> None:
    file = tmp_path / "kind.csv"
    text = tool_table(MEASURED, fit_tool_frame(MEASURED)).replace("3,touch", "3,poke", 1)
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="line 4: unknown kind 'poke'"):
        read_tool_measurements(file)
