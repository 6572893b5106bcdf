"""Figures of a removal map, its files, and its pictures from what was saved."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from polish_sim.analysis.metrics import measure_removal
from polish_sim.analysis.removal_plot import write_removal_mesh
from polish_sim.analysis.run_record import RunRecord, read_record, write_record
from polish_sim.config import Scenario
from polish_sim.experiments.report import draw_comparison, draw_plots
from polish_sim.log import with_column
from tests.analysis.synthetic import bumpy_path, log_of, removal_map, surface_trace

UNEVEN = np.concatenate([[0.0, 0.4], np.ones(16), [1.6, 2.0]])
"""Mean one; a twentieth of the area each of nothing, too little, and twice too much."""


def test_shares_below_half_and_above_one_and_a_half_means_are_counted_and_depths_with_a_wear_coefficient():
    relative, absolute = (measure_removal(removal_map(3e5 * UNEVEN, wear)) for wear in (0.0, 1e-13))
    for figures in (relative, absolute):
        assert figures["under_polished_share"] == pytest.approx(0.10)
        assert figures["over_polished_share"] == pytest.approx(0.10)
        assert figures["unpolished_share"] == pytest.approx(0.05)
        assert figures["removal_max"] == pytest.approx(2.0)
        assert figures["removal_cv"] == pytest.approx(math.sqrt(float(np.mean((UNEVEN - 1.0) ** 2))))
        assert figures["exposure_mean_n_m"] == pytest.approx(3e5)
        assert figures["exposure_nm"] == pytest.approx(3e5 * 40 * 1e-4)
    assert math.isnan(relative["removal_volume_m3"])
    assert math.isnan(relative["removal_mean_m"])
    assert absolute["removal_mean_m"] == pytest.approx(3e-8)
    assert absolute["removal_max_m"] == pytest.approx(6e-8)
    assert absolute["removal_volume_m3"] == pytest.approx(3e-8 * 40 * 1e-4)
    even, nothing = (measure_removal(removal_map(np.full(20, size))) for size in (7.0, 0.0))
    assert (even["removal_p5"], even["removal_p95"]) == pytest.approx((1.0, 1.0))
    assert math.isnan(nothing["removal_cv"])
    assert math.isnan(nothing["over_polished_share"])
    assert nothing["unpolished_share"] == pytest.approx(1.0)


def test_what_was_never_touched_is_no_spike_in_the_picture_s_histogram():
    removal = removal_map(np.concatenate([np.zeros(500), np.linspace(1.0, 1.2, 500)]))
    log = log_of(surface_trace(bumpy_path()))
    record = RunRecord("cut", Scenario(), measure_removal(removal), log, None, removal)
    shares = draw_plots(record)["removal.png"].axes[1]
    # Half of the area lies within 0.4 of its mean: 12.5% of it per tenth on average.
    assert shares.get_ylim()[1] < 25.0
    assert "untouched 50.00% left out" in shares.get_xlabel()


def test_the_mesh_carries_the_exposure_in_millimetres_and_a_colour(tmp_path):
    removal = removal_map(3e5 * UNEVEN, 1e-13)
    write_removal_mesh(tmp_path / "removal.ply", removal)
    mesh = trimesh.load(tmp_path / "removal.ply", process=False)
    np.testing.assert_allclose(mesh.vertices, 1e3 * removal.vertices, atol=1e-4)
    data = mesh.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(data["exposure_n_m"].ravel(), removal.exposure, rtol=1e-6)
    np.testing.assert_allclose(data["removal_m"].ravel(), 1e-13 * removal.exposure, rtol=1e-6)
    assert mesh.visual.vertex_colors.shape == (40, 4)


@pytest.fixture
def run() -> RunRecord:
    path, removal = bumpy_path(bumps=2, length=0.1), removal_map(3e5 * UNEVEN)
    log = log_of(surface_trace(path))
    log = with_column(log, "exposure_nm", np.linspace(0.0, 1.0, len(log)))
    figures = {"force_mean_n": 20.0, **measure_removal(removal)}
    return RunRecord("run", Scenario(), figures, log, path, removal)


def test_a_saved_run_is_drawn_again_alone_and_beside_others(run, tmp_path):
    write_record(tmp_path, run)
    back = read_record(tmp_path)
    assert measure_removal(back.removal) == pytest.approx(measure_removal(run.removal), rel=1e-6, nan_ok=True)
    np.testing.assert_array_equal(back.removal.triangles, run.removal.triangles)
    assert "removal.png" in draw_plots(back)
    assert "removal.png" in draw_comparison([back, back, run])
    with pytest.raises(ValueError, match="exposure_nm"):  # a column added to a log must fit it
        with_column(run.log, "exposure_nm", np.zeros(len(run.log) + 1))


def test_a_run_without_removal_is_drawn_without_its_map_and_with_a_wear_coefficient_in_micrometres(run):
    for removal in (None, removal_map(np.zeros(20))):
        bare = replace(run, removal=removal)
        assert "removal.png" not in draw_plots(bare)
        assert "removal.png" not in draw_comparison([run, bare])
    removal = removal_map(3e5 * UNEVEN, 1e-13)
    figure = draw_plots(replace(run, removal=removal, metrics=measure_removal(removal)))["removal.png"]
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert any("µm" in label for label in labels), labels
