"""The ROS pose list: loadable, a PoseArray with lists beside it, tool z into the part and x along the feed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.exchange import ExportSetup
from polish_sim.exchange.formats import yaml_text
from polish_sim.exchange.strokes import feed_frames, rows_without_straight_air, steady_frames
from polish_sim.planning.toolpath import SEGMENTS
from tests.exchange.yaml_subset import load
from tests.planning.shapes import shipped_plan

try:
    from yaml import safe_load
except ImportError:  # PyYAML is no dependency; where it is there, both readers must agree
    safe_load = load


def written():
    """The path as it is written."""
    path = shipped_plan("sphere_100").path
    return path.rows(rows_without_straight_air(path))


@pytest.fixture(scope="module")
def document():
    text = yaml_text(shipped_plan("sphere_100"), ExportSetup(frame_id="part_frame"))
    ours = load(text)
    assert safe_load(text) == ours
    return ours


def test_header_and_poses_are_a_pose_array(document):
    assert document["header"]["frame_id"] == "part_frame"
    assert document["header"]["stamp"] == {"sec": 0, "nanosec": 0}
    assert len(document["poses"]) == len(written().s)
    for pose in document["poses"]:
        assert list(pose) == ["position", "orientation"]
        assert list(pose["position"]) == ["x", "y", "z"]
        assert list(pose["orientation"]) == ["x", "y", "z", "w"]


def test_every_list_beside_the_poses_has_one_entry_per_pose(document):
    path = written()
    assert document["segment"] == [SEGMENTS[code] for code in path.segment]
    assert document["pass_index"] == path.pass_index.tolist()
    assert document["force_n"] == pytest.approx(np.where(path.process, 20.0, 0.0))
    assert np.array(document["feed_m_s"])[path.process] == pytest.approx(0.01)


def test_quaternions_turn_z_into_the_sphere_and_x_along_the_feed(document):
    path = written()
    quaternions = np.array([list(pose["orientation"].values()) for pose in document["poses"]])
    assert np.linalg.norm(quaternions, axis=1) == pytest.approx(1.0, abs=1e-8)
    frames = Rotation.from_quat(quaternions).as_matrix()
    place = np.array([list(pose["position"].values()) for pose in document["poses"]])[path.process]
    # Middle of the sphere of 100 mm radius; 0.1 deg is what the fitted normals may be off.
    inward = np.array([0.0, 0.0, -0.065]) - place
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    assert np.sum(frames[path.process][:, :, 2] * inward, axis=1).min() > np.cos(np.radians(0.1))
    feed = np.diff(place, axis=0)
    feed /= np.linalg.norm(feed, axis=1, keepdims=True)
    assert np.sum(frames[path.process][:-1, :, 0] * feed, axis=1).min() > 0.99


def test_names_with_quotes_and_control_characters_stay_one_string():
    result = shipped_plan("sphere_100")
    odd = replace(result, mesh=replace(result.mesh, name="it's\n: a #part\x07"))
    assert load(yaml_text(odd, ExportSetup()))["part"]["name"] == "it's : a #part "


@pytest.mark.parametrize("frames_of", [feed_frames, steady_frames])
@pytest.mark.parametrize("name", ["sphere_100", "plate_two_holes"])
def test_tool_frames_are_right_handed_with_z_into_the_part(frames_of, name):
    path = shipped_plan(name).path
    frames = frames_of(path)
    assert np.swapaxes(frames, 1, 2) @ frames == pytest.approx(np.tile(np.eye(3), (len(frames), 1, 1)), abs=1e-12)
    assert np.linalg.det(frames) == pytest.approx(1.0)
    assert frames[:, :, 2] == pytest.approx(-path.axes_work, abs=1e-12)


def test_straight_leads_keep_the_direction_the_path_begins_with():
    path = shipped_plan("sphere_100").path
    x_axes = feed_frames(path)[:, :, 0]
    first = int(path.process.argmax())
    assert x_axes[:first] == pytest.approx(np.tile(x_axes[first], (first, 1)), abs=1e-9)
