"""What a model is identified for is read from paths, plans, logs and joint motions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from polish_sim.cell import tool_on_flange
from polish_sim.errors import InputError
from polish_sim.identification.use_motion import use_states
from polish_sim.motion import forward
from tests.identification.logs import RATE, played, write_log
from tests.identification.motions import known_robot

KNOWN = known_robot(200)


def test_a_joint_motion_comes_back_with_its_speeds(tmp_path: Path) -> None:
    states = played(KNOWN.motion, 1)
    for use in (
        use_states(write_log(tmp_path / "log.csv", KNOWN.model, states)),
        use_states(_npz(tmp_path / "trajectory.npz", states.q)),
        use_states(tmp_path),
    ):
        # Sampled every 20 ms and joined by splines.
        assert np.abs(use.qd).max() == pytest.approx(np.abs(states.qd).max(), rel=0.02)
        assert np.abs(use.q[0] - states.q[0]).max() < 1e-3


def test_along_a_path_the_tool_goes_at_the_feed(tmp_path: Path) -> None:
    file = tmp_path / "line.csv"
    rows = [f"{x},0,0,0,0,1" for x in np.linspace(0.0, 100.0, 41)]
    file.write_text("\n".join(["x,y,z,i,j,k", *rows]), encoding="utf-8")
    use = use_states(file)
    step = 1e-4
    for k in (120, 250, 380):
        ends = [forward(use.q[k] + sign * step * use.qd[k]) @ tool_on_flange() for sign in (1.0, -1.0)]
        speed = np.linalg.norm(ends[0][:3, 3] - ends[1][:3, 3]) / (2.0 * step)
        assert speed == pytest.approx(0.01, rel=0.05)


def test_every_move_of_a_teaching_run_counts(tmp_path: Path) -> None:
    t = np.arange(500) / RATE
    first, second = np.zeros((500, 6)), np.ones((500, 6))
    first[:, 0], second[:, 1] = 0.5 * t, 1.0 - 0.25 * t
    time, case = np.concatenate([t, t]), np.repeat([0.0, 1.0], 500)
    np.savez(tmp_path / "log.npz", time_s=time, q_rad=np.concatenate([first, second]), case=case)
    use = use_states(tmp_path)
    moved = [use.rows(use.q[:, 3] < 0.5), use.rows(use.q[:, 3] > 0.5)]
    # Constant speeds, and none from the end of one move to the beginning of the next.
    for states, joint, speed in zip(moved, (0, 1), (0.5, -0.25), strict=True):
        assert len(states.q) > 90
        np.testing.assert_allclose(states.qd[:, joint], speed, atol=1e-6)
        assert np.abs(np.delete(states.qd, joint, axis=1)).max() < 1e-6


def test_what_is_no_motion_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(InputError, match="holds no joint motion"):
        use_states(tmp_path / "other.npz")
    np.savez(tmp_path / "wide.npz", time_s=np.arange(99.0), q_rad=np.zeros((99, 7)))
    with pytest.raises(InputError, match=r"wanted \(n, 6\)"):
        use_states(tmp_path / "wide.npz")
    with pytest.raises(InputError, match="two poses or more"):
        use_states(_npz(tmp_path / "short.npz", np.zeros((1, 6))))
    with pytest.raises(InputError, match="cannot read the path 'none'"):
        use_states(Path("none"))


def _npz(file: Path, q: np.ndarray) -> Path:
    np.savez(file, time_s=np.arange(len(q)) / RATE, q_rad=q)
    return file
