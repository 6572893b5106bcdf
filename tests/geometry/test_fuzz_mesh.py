"""Broken mesh files, a seeded few of those `python -m benchmarks.fuzz` tries."""

import numpy as np
import trimesh

from benchmarks.fuzz import LARGEST, run_apart, try_files
from tests.geometry.shapes import memory_to_load


def test_broken_files_are_read_or_refused_without_traceback_hang_or_full_memory(tmp_path):
    outcome = try_files(first_seed=10_000, count=42, folder=tmp_path)
    assert not outcome.faults
    # Edges without length that repairs leave.
    assert not try_files(first_seed=50_003, count=1, folder=tmp_path).faults
    assert min(outcome.counts["read"], outcome.counts["refused"]) > 10


def test_the_worker_of_the_fuzz_holds_its_memory_limit():
    outcome = run_apart(first_seed=0, count=7)
    assert not outcome.faults
    assert sum(outcome.counts.values()) == 7
    assert outcome.peak < LARGEST


def test_a_large_file_with_many_wrong_facets_takes_no_more_memory_than_a_whole_one(tmp_path):
    """Facets too many and corners wrong: nearly every edge is a border, with thousands of others' vertices
    near it."""
    rng = np.random.default_rng(0)
    ball = trimesh.creation.icosphere(subdivisions=6, radius=40.0)
    faces, corners = np.array(ball.faces), len(ball.vertices)
    faces = np.concatenate([faces, rng.integers(corners, size=(len(faces) // 4, 3))])
    wrong = rng.random(len(faces)) < 0.28
    faces[wrong, 0] = rng.integers(corners, size=int(wrong.sum()))
    trimesh.Trimesh(ball.vertices, faces, process=False).export(tmp_path / "wrong.stl")
    assert memory_to_load(tmp_path / "wrong.stl") < 60
