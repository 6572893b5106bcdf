"""Every plot draws, labels its axes, leaves matplotlib as it was; removal maps, plans, inspected paths."""

import math
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from polish_sim.analysis.metrics import measure_arc, measure_force, measure_removal, measure_surface
from polish_sim.analysis.path_plot import SLANTED, plot_plan
from polish_sim.analysis.removal_plot import write_removal_mesh
from polish_sim.analysis.run_record import RunRecord, read_record, write_record
from polish_sim.analysis.style import RED, axis_name, depth_picture, seen_in
from polish_sim.config import PartConfig, PlanConfig, Scenario
from polish_sim.errors import InputError
from polish_sim.experiments.report import draw_comparison, draw_plots, draw_seeds
from polish_sim.log import APPROACH_PHASE, RunLog, with_column
from polish_sim.planning import plan_part
from polish_sim.row_file import save_plots
from tests.analysis import synthetic
from tests.planning.shapes import shipped_plan

UNEVEN = np.concatenate([[0.0, 0.4], np.ones(16), [1.6, 2.0]])
"""Mean one; a twentieth of the area each of nothing, too little, and twice too much."""


def arc_record(trace=None):
    run = synthetic.arc_trace(feed_m_s=0.05) if trace is None else trace
    return RunRecord("arc", Scenario(experiment="arc"), measure_arc(run), synthetic.log_of(run), None)


def force_record(trace=None, seed=0):
    run = synthetic.force_trace() if trace is None else trace
    scenario = Scenario(experiment="force", seed=seed)
    return RunRecord("f", scenario, measure_force(run, 20.0), synthetic.log_of(run), None)


def surface_record(trace=None, controller="hybrid-pi"):
    path = synthetic.bumpy_path(bumps=3, length=0.3)
    run, scenario = synthetic.surface_trace(path) if trace is None else trace, Scenario()
    scenario = replace(scenario, controller=replace(scenario.controller, name=controller))
    return RunRecord("s", scenario, measure_surface(run, path, 20.0), synthetic.log_of(run), path)


def with_force(record, force_n):
    process = replace(record.scenario.process, contact_force_n=force_n)
    return replace(record, scenario=replace(record.scenario, process=process))


def head_of(figure):
    return "\n".join(text.get_text() for text in figure.texts)


def assert_labelled(figure):
    for axes in figure.axes:
        assert "[" in axes.get_ylabel()
        assert axes.get_xlabel() or not axes.xaxis.get_tick_params()["labelbottom"]


@pytest.mark.parametrize("make", [arc_record, force_record, surface_record])
def test_every_experiment_has_plots_with_labelled_axes_that_nothing_sticks_out_of(make, tmp_path):
    before = dict(matplotlib.rcParams)
    plots = draw_plots(make())
    for figure in [*plots.values(), *draw_seeds([make(), make()]).values()]:
        figure.draw_without_rendering()
        for axes in (axes for axes in figure.axes if axes.get_visible()):
            assert any(len(line.get_xdata()) for line in axes.lines) or axes.collections
        width, height = figure.bbox.size
        for piece in [*figure.legends, *figure.texts]:
            box = piece.get_window_extent()
            assert 0.0 <= box.x0 < box.x1 <= width
            assert 0.0 <= box.y0 < box.y1 <= height
    for figure in plots.values():
        assert_labelled(figure)
    save_plots(tmp_path, plots)
    assert {file.name for file in tmp_path.iterdir()} == set(plots)
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("phase", [0, 3], ids=["before contact", "in its first step"])
@pytest.mark.parametrize("make", [arc_record, force_record, surface_record])
def test_a_run_stopped_early_still_draws(make, phase):
    plots = draw_plots(make(synthetic.trace_of(np.full(400, phase, np.int8))))
    assert plots
    for figure in plots.values():
        figure.draw_without_rendering()
    shown = [text.get_text() for figure in plots.values() for axes in figure.axes for text in axes.texts]
    shown += [head_of(figure) for figure in plots.values()]
    assert not [text for text in shown if "nan" in text]
    if make is surface_record and phase == APPROACH_PHASE:
        assert set(plots) == {"force.png"}
        assert plots["force.png"].axes[0].get_xlabel() == "time since the start [s]"


def test_the_force_is_drawn_as_logged_with_its_peaks_numbered_and_up_to_a_stop_that_is_marked():
    record = surface_record()
    phase = np.where(np.arange(len(record.log)) // 500 == 6, APPROACH_PHASE, record.log["phase"])
    log = RunLog({**record.log.columns, "phase": phase})  # lifted for 2 s on the way: a gap
    figure = draw_plots(replace(record, log=log))["force.png"]
    drawn = next(line for line in figure.axes[0].lines if line.get_label() == "exact contact force")
    shown = drawn.get_ydata()
    np.testing.assert_array_equal(shown, np.where(log.fed, log["normal_force_n"], np.nan))
    assert [text.get_text() for text in figure.axes[0].texts] == [" 1", " 2", " 3"]
    fed = record.log.fed
    tenth = [float(record.log[name][fed][len(fed[fed]) // 10]) for name in ("time_s", "path_s_m")]
    for run, time, s, where in ((record, *tenth, tenth[1]), (force_record(), 3.0, 0.0, 1.0)):
        on = np.array(run.log["time_s"] <= time)
        log = RunLog({name: column[on] for name, column in run.log.columns.items()})
        at = {"name": "a limit", "time_s": time, "path_s_m": s, "tool_m": [0.0, 0.0, 0.0]}
        stopped = replace(run, log=log, metrics={**run.metrics, "protective_stop_at": at})
        figure = draw_plots(stopped)["force.png"]
        assert "a limit" in head_of(figure)
        for axes in figure.axes:
            assert axes.get_xlim()[1] - where < 0.1 * np.ptp(axes.get_xlim())
            marked = [line for line in axes.lines if line.get_color() == RED]
            assert marked[0].get_xdata()[0] == pytest.approx(where, abs=0.01)


def test_runs_and_seeds_beside_each_other_have_one_scale_the_band_of_their_own_force_and_the_worst_named():
    runs = [surface_record(), with_force(surface_record(controller="position"), 12.0)]
    figure = draw_comparison(runs)["force.png"]
    first, _, second, _ = figure.axes
    titles = " ".join(axes.get_title() + axes.get_title(loc="left") for axes in figure.axes)
    assert all(name in titles for name in ("hybrid-pi", "position"))
    for axes, force in ((first, 20.0), (second, 12.0)):
        band = axes.patches[0].get_extents().transformed(axes.transData.inverted())
        assert (band.y0, band.y1) == pytest.approx((force - 4.0, force + 4.0))
    assert np.ptp(first.get_ylim()) == pytest.approx(np.ptp(second.get_ylim()))
    for runs in ([arc_record(), arc_record()], [force_record(), with_force(force_record(), 10.0)]):
        (figure,) = draw_comparison(runs).values()
        assert len(figure.axes) == 1
        assert_labelled(figure)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"10 ± 3 N, the paper's band", "20 ± 3 N, the paper's band"} <= set(names)
    with pytest.raises(InputError, match="arc, force"):
        draw_comparison([arc_record(), force_record()])
    figure = draw_seeds([force_record(), force_record(synthetic.force_trace(tau=0.3), seed=1)])["seeds.png"]
    assert figure.axes[0].get_title(loc="left").endswith("asked <= 0.4: 1 of 2")
    records = [surface_record(), replace(surface_record(), scenario=replace(Scenario(), seed=7))]
    off = {"force_max_deviation_n": 7.0, "force_within_4n": 0.9}
    records[1] = replace(records[1], metrics={**records[1].metrics, **off})
    panels = {axes.get_title(loc="left"): axes for axes in draw_seeds(records)["seeds.png"].axes}
    assert panels["force error, max [N]"].texts[0].get_text() == "seed 7: 7"
    assert {axes.get_xlim()[1] for name, axes in panels.items() if "±4 N" in name} == {100.0}


def test_a_path_without_bends_says_so_and_noise_of_its_curvature_stays_small():
    record, noise = surface_record(), 0.01 * np.random.default_rng(0).standard_normal(2401)
    noisy = replace(record, path=replace(record.path, curvature=10.0 + noise))
    metrics = {**record.metrics, "curvature_peaks": 0, "force_error_at_peaks_n": np.nan}
    assert "no curvature peak" in head_of(draw_plots(replace(record, metrics=metrics))["force.png"])
    low, high = draw_plots(noisy)["force.png"].axes[1].get_ylim()
    assert low < 0.0 < 10.0 < high


def test_a_removal_map_is_counted_drawn_without_what_was_never_touched_and_kept_as_a_mesh(tmp_path):
    relative, absolute = (measure_removal(synthetic.removal_map(3e5 * UNEVEN, wear)) for wear in (0.0, 1e-13))
    known = {
        "under_polished_share": 0.10, "over_polished_share": 0.10, "unpolished_share": 0.05,
        "removal_cv": math.sqrt(float(np.mean((UNEVEN - 1.0) ** 2))), "exposure_mean_n_m": 3e5,
        "exposure_nm": 3e5 * 40 * 1e-4, "removal_max": 2.0,
    }  # fmt: skip
    for figures in (relative, absolute):
        assert {name: figures[name] for name in known} == pytest.approx(known)
    assert math.isnan(relative["removal_volume_m3"])
    assert math.isnan(relative["removal_mean_m"])
    sizes = [absolute[f"removal_{name}"] for name in ("mean_m", "max_m", "volume_m3")]
    assert sizes == pytest.approx([3e-8, 6e-8, 3e-8 * 40 * 1e-4])
    even, nothing = (measure_removal(synthetic.removal_map(np.full(20, size))) for size in (7.0, 0.0))
    assert (even["removal_p5"], even["removal_p95"]) == pytest.approx((1.0, 1.0))
    assert math.isnan(nothing["removal_cv"])
    assert math.isnan(nothing["over_polished_share"])
    assert nothing["unpolished_share"] == pytest.approx(1.0)
    removal = synthetic.removal_map(3e5 * UNEVEN, 1e-13)
    write_removal_mesh(tmp_path / "removal.ply", removal)
    mesh = trimesh.load(tmp_path / "removal.ply", process=False)
    np.testing.assert_allclose(mesh.vertices, 1e3 * removal.vertices, atol=1e-4)
    data = mesh.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(data["exposure_n_m"].ravel(), removal.exposure, rtol=1e-6)
    np.testing.assert_allclose(data["removal_m"].ravel(), 1e-13 * removal.exposure, rtol=1e-6)
    assert mesh.visual.vertex_colors.shape == (40, 4)


def test_a_saved_run_is_drawn_again_with_its_removal_alone_and_beside_others_if_there_is_any(tmp_path):
    path, removal = synthetic.bumpy_path(bumps=2, length=0.1), synthetic.removal_map(3e5 * UNEVEN)
    log = synthetic.log_of(synthetic.surface_trace(path))
    log = with_column(log, "exposure_nm", np.linspace(0.0, 1.0, len(log)))
    run = RunRecord("run", Scenario(), {"force_mean_n": 20.0, **measure_removal(removal)}, log, path, removal)
    write_record(tmp_path, run)
    back = read_record(tmp_path)
    assert measure_removal(back.removal) == pytest.approx(measure_removal(run.removal), rel=1e-6, nan_ok=True)
    np.testing.assert_array_equal(back.removal.triangles, run.removal.triangles)
    assert "removal.png" in draw_plots(back)
    assert "removal.png" in draw_comparison([back, back, run])
    with pytest.raises(ValueError, match="exposure_nm"):  # a column added to a log must fit it
        with_column(run.log, "exposure_nm", np.zeros(len(run.log) + 1))
    for removal in (None, synthetic.removal_map(np.zeros(20))):
        bare = replace(run, removal=removal)
        assert "removal.png" not in draw_plots(bare)
        assert "removal.png" not in draw_comparison([run, bare])
    removal = synthetic.removal_map(3e5 * UNEVEN, 1e-13)
    figure = draw_plots(replace(run, removal=removal, metrics=measure_removal(removal)))["removal.png"]
    for fact in ("µm", "under 0.5: 10.0%", "over 1.5: 10.0%", "untouched: 5.00%"):
        assert fact in figure.axes[0].get_title(loc="left")


def drawn_in(pieces):
    """Points of what is drawn [mm]."""
    return np.concatenate([line.vertices for piece in pieces for line in piece.get_paths()])


def test_a_path_from_above_lies_where_it_was_planned():
    result = shipped_plan("sphere_100")
    figure = plot_plan(result)
    flat = figure.axes[1]
    drawn = drawn_in(flat.collections[1:2])
    process = result.path.positions_work[result.path.process] * 1e3
    assert drawn.min(axis=0) == pytest.approx(process[:, :2].min(axis=0))
    assert drawn.max(axis=0) == pytest.approx(process[:, :2].max(axis=0))
    assert flat.get_xlabel() == "to the right (+x) [mm]"
    assert flat.get_ylabel() == "to the back (+y) [mm]"
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["approach, lead-in", "lead-out, retract"]


def test_no_side_the_part_hides_is_drawn_through_it_and_a_side_is_seen_along_its_face(tmp_path):
    trimesh.creation.box((60, 60, 60)).export(tmp_path / "box.stl")
    box = PartConfig(str(tmp_path / "box.stl"), up="z")
    result = plan_part(box, PlanConfig(region="all", stepover_m=0.03))
    slanted, flat, _ = plot_plan(result).axes
    # Of the top alone, which keeps off its rim; walls would lie at 30.
    assert np.abs(drawn_in(flat.collections[1:])).max() < 29.0
    # Of a box each side that is turned to the viewer, and no other.
    path = result.path
    facing = path.process & (path.axes_work @ SLANTED[2] > 0.1)
    wanted = (1e3 * path.positions_work[facing] @ SLANTED.T)[:, :2]
    drawn = drawn_in(slanted.collections[1:-1])
    assert cKDTree(wanted).query(drawn)[0].max() < 1e-6
    assert cKDTree(drawn).query(wanted)[0].max() < 1.0
    result = plan_part(box, PlanConfig(region="point:30,0,0", stepover_m=0.02))
    _, flat, _ = plot_plan(result).axes
    process = result.path.positions_work[result.path.process] * 1e3
    assert np.ptp(drawn_in(flat.collections[1:]), axis=0) == pytest.approx(np.ptp(process[:, [1, 2]], axis=0))
    assert flat.get_ylabel() == "up (+z) [mm]"


def test_of_a_sphere_the_half_that_faces_the_viewer_is_seen_and_long_thin_facets_hide_as_well():
    ball = trimesh.creation.icosphere(4)
    third = np.array([0.6, -0.48, 0.64])
    assert axis_name(third) == "0.6, -0.48, 0.64"
    first = np.cross([0.0, 1.0, 0.0], third)
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(third, first), third])
    picture = depth_picture(np.asarray(ball.triangles) @ frame.T)
    normals = np.random.default_rng(1).standard_normal((2000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    facing = normals @ third
    # What is lifted by 3% of the radius looks over the rim from 0.23 behind it.
    clear = np.abs(facing) > 0.25
    assert (seen_in(picture, normals @ frame.T, normals @ frame.T) == (facing > 0.0))[clear].all()
    low, high = np.array([0.0, 0.0, 0.0]), np.array([10.0, 0.02, 0.0])
    strip = np.array([[low, [10.0, 0.0, 0.0], high], [low, high, [0.0, 0.02, 0.0]]])
    picture = depth_picture(strip)
    along = np.column_stack([np.linspace(0.01, 9.99, 999), np.full(999, 0.01), np.full(999, -1.0)])
    assert not seen_in(picture, along, np.tile([0.0, 0.0, -1.0], (999, 1))).any()
