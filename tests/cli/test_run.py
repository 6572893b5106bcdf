"""Runs as a user starts them, by hand as well: files, figures, exit codes, interrupts."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from polish_sim.analysis.run_record import changed_settings, other_conditions, read_record
from polish_sim.analysis.style import RED
from polish_sim.cli.options import build_scenario
from polish_sim.exchange import read_path
from polish_sim.experiments import default_scenario
from polish_sim.experiments.report import draw_plots
from polish_sim.log import COLUMNS, RETRACT_PHASE, read_log
from polish_sim.page import PAGE
from polish_sim.scenario_file import override
from polish_sim.toml_text import END, WHOLE
from tests.cli.conftest import UNPROVEN, done, interrupted, metrics_of, refused

FORCE = ["run", "force", "--set", "process.hold_s=1.5"]
ARC = ["run", "arc", "--feed", "100"]
DEAF = ["--set", "controller.force_p_m_sn=0.0001", "--set", "controller.force_i_m_s2n=0.0001"]


@pytest.mark.pictures
def test_a_run_leaves_the_contract_s_files_and_ends_with_its_folder(polish_sim, tmp_path):
    _, out, err = done(polish_sim(*FORCE), "settling to")
    (folder,) = (tmp_path / "results" / "run-force").iterdir()
    files = {file.name for file in folder.iterdir()}
    assert {"config.toml", "metrics.json", "log.npz", "force.png", "report.html"} <= files
    assert ("cell.png" in files) != ("no OpenGL" in err)
    shown = folder.relative_to(tmp_path)
    assert out.splitlines()[-2:] == [f"to look at in a browser: {shown / PAGE}", f"folder: {shown}"]
    page = (folder / PAGE).read_text(encoding="utf-8")
    assert page.count("</script>") == 2
    assert "://" not in page
    assert set(read_log(folder / "log.npz").names) == set(COLUMNS)
    figures = metrics_of(folder)
    assert figures["protective_stop"] is None
    assert {"seed", "simulated_s", "wall_s", "real_time_factor", "steps", "versions"} <= figures.keys()


def test_the_default_config_is_that_of_a_run_with_it(polish_sim):
    _, toml, _ = polish_sim("config", "force")
    Path("mine.toml").write_text(toml)
    done(polish_sim("run", "force", "--config", "mine.toml", "--out", "again"))
    assert Path("again/config.toml").read_text() == WHOLE + toml + END


def test_check_is_1_when_a_figure_falls_short_of_its_conditions(polish_sim):
    done(polish_sim(*FORCE, "--check", "--out", "good"))
    code, out, _ = polish_sim(*FORCE, *DEAF, "--check", "--out", "deaf")
    assert (code, " NO" in out) == (1, True)
    sluggish = ["--set", "robot.linear_acceleration_m_s2=0.05"]
    out = done(polish_sim(*ARC, *sluggish, "--out", "run"), "robot.linear_acceleration_m_s2 = 0.05 (1.2)").out
    assert " NO" not in out
    code, out, _ = polish_sim(*ARC, *sluggish, "--check", "--out", "checked")
    assert (code, " NO" in out) == (1, True)
    # Neither the pad of a plan nor what a named sensor stands for is one.
    scenario = default_scenario("surface")
    assert other_conditions(override(scenario, ["pad.choice=given", "pad.radius_m=0.02"]), scenario) == ()
    assert len(other_conditions(override(scenario, ["pad.stiffness_n_m=10000"]), scenario)) == 1
    usual = default_scenario("force")
    named = override(usual, ["sensor.model=axia80", "sensor.cross_talk=0", "robot.arm=ur10e"])
    others = "robot.arm = ur10e (ur5e)", "sensor.model = axia80 (external)", "sensor.cross_talk = 0 (0.01)"
    assert changed_settings(override(usual, ["plan.start=[0, 0, 0.1]"]), usual) == [
        ["plan.start", "0, 0, 0.1", "auto"]
    ]
    assert other_conditions(named, usual) == others
    noisy = build_scenario(default_scenario("force"), {"--noise": 0.5, "--set": ["sensor.model=axia80"]})
    assert (noisy.sensor.force_noise_n, noisy.sensor.force_range_n) == (0.5, 500.0)


def test_a_protective_stop_names_limit_time_place_and_force(polish_sim):
    code, _, err = polish_sim(*FORCE, "--set", "faults.events=sensor-jump@contact+0.5", "--out", "stopped")
    assert code == 3, err
    figures = metrics_of("stopped")
    said = str(figures["protective_stop"])
    found = re.fullmatch(
        r"wrist sensor reading jumped by more than safety.jump_limit_n = 15: [^;]*; measured [\d.]+ N "
        r"at ([\d.]+) s, "
        r"10 mm along the path, stroke 1 of 1, tool at \(([^)]*)\) mm of the part, "
        r"\(([^)]*)\) mm of the base, exact force ([\d.]+) N along the tool axis",
        said,
    )
    assert found is not None, said
    assert float(found[1]) == pytest.approx(figures["protective_stop_time_s"], abs=0.005)
    T_base_work = np.array(figures["T_base_work"])
    on_part, in_base = (np.array([float(x) for x in found[k].split(",")]) for k in (2, 3))
    np.testing.assert_allclose(T_base_work[:3, :3] @ on_part + 1e3 * T_base_work[:3, 3], in_base, atol=0.02)
    assert float(found[4]) == pytest.approx(20.0, abs=2.0)
    assert said in err
    picture = draw_plots(read_record(Path("stopped")))["force.png"]
    lines = [line.get_xdata() for line in picture.axes[0].lines if line.get_color() == RED]
    (at,) = [x[0] for x in lines if len(x) == 2]
    assert at == pytest.approx(0.5, abs=0.02)
    head = picture.texts[-1].get_text()
    assert f"protective stop at {figures['protective_stop_time_s']:.2f} s: wrist sensor" in head


def test_seeds_give_a_run_each_and_their_mean_and_worst(polish_sim):
    words = ("--seed", "5", "--seeds", "2", "--on", "here", "--check", "--out", "two")
    assert "worst seed" in done(polish_sim(*FORCE, *words)).out
    figures = metrics_of("two")
    times = [metrics_of(f"two/seed-000{seed}")["settling_time_3n_s"] for seed in (5, 6)]
    assert times[0] != times[1]
    assert figures["worst"]["settling_time_3n_s"] == max(times)
    assert figures["mean"]["settling_time_3n_s"] == pytest.approx(sum(times) / 2)
    whole = {file: file.read_bytes() for file in Path("two").glob("seed-*/log.npz")}
    config = Path("two/seed-0005/config.toml")
    for damaged in (whole.keys() - {Path("two/seed-0006/log.npz")}, {config}):
        for file in damaged:
            file.write_text(file.read_text().rpartition(" #")[0] + " # cut" if file == config else "")
        assert "seed-0006" not in done(polish_sim(*FORCE, *words), "done again: ", "seed-0005").err
        assert {file: file.read_bytes() for file in whole} == whole
        assert config.read_text().endswith("\n")
    Path("two/asked.json").write_text("")
    refused(polish_sim(*FORCE, *words), "asked.json", "--out")
    Path("two/seed-0005/metrics.json").unlink()
    refused(polish_sim("report", "two/seed-0005", "--out", "again"), "metrics.json")


@pytest.mark.pictures
def test_report_draws_saved_runs_again_and_side_by_side(polish_sim):
    for name, controller in (("a", "hybrid-pi"), ("b", "hybrid-pi-position")):
        assert polish_sim(*ARC, "--controller", controller, "--out", name)[0] == 0
    assert polish_sim("report", "a", "--out", "alone")[0] == 0
    out = done(polish_sim("report", "a", "b", "--out", "both")).out
    (row,) = [line.split() for line in out.splitlines() if line.strip().startswith("controller")]
    assert row == ["controller", "hybrid-pi", "hybrid-pi-position"]
    refused(polish_sim("report", "a", "b", "--out", "b", "--overwrite"), "'b'", "--out")
    assert metrics_of("b")["tracking_error_max_m"] > 0.0
    Path("b/removal.ply").touch()
    for words in ("run surface --part plate", "plan plate"):
        call = polish_sim(*words.split(), "--removal", "b/removal.ply", "--out", "./a/../b", "--overwrite")
        refused(call, "is read itself")
    for folder in ("alone", "both"):
        assert (Path(folder) / "arc.png").stat().st_size > 10_000
    figures = metrics_of("a")
    Path("a/metrics.json").write_text("{}")
    refused(polish_sim("report", "a", "--out", "none"), "'a/metrics.json' holds no figure of 'arc'")
    Path("a/metrics.json").write_text(json.dumps({"path_done": 1.0}))
    out = done(polish_sim("report", "a", "--out", "none")).out
    (row,) = [line.split() for line in out.splitlines() if line.strip().startswith("tracking error, max")]
    assert row[3:5] == ["mm", "-"]
    Path("a/metrics.json").write_text(json.dumps(figures | {"tracking_error_max_m": "small"}))
    refused(polish_sim("report", "a", "--out", "text"), "'tracking_error_max_m'", "'a/metrics.json'")


@pytest.mark.parametrize("words", [(), ("--seeds", "1", "--on", "here")])
def test_an_interrupt_while_drawing_lacks_pictures_alone(polish_sim, tmp_path, monkeypatch, words):
    with monkeypatch.context() as cut:
        for module in ("run", "many"):
            cut.setattr(f"polish_sim.cli.{module}.save_plots", interrupted)
        call = polish_sim(*ARC, *words, "--out", "cut")
    refused(call, "pictures are missing", "polish-sim report", code=130)
    assert "path done" in call.out
    figures = metrics_of(tmp_path / "cut")
    assert figures["pictures_missing"] is True
    assert (tmp_path / "cut" / "seed-0000" if words else tmp_path / "cut").joinpath("log.npz").exists()
    if not words:
        assert figures["interrupted"] is False
        assert polish_sim("report", "cut", "--out", "drawn")[0] == 0
        assert {"arc.png", "report.html"} <= {file.name for file in (tmp_path / "drawn").iterdir()}


def test_a_fault_stops_the_run_and_its_folder_does_the_same_again(polish_sim):
    faults = ("--fault", "sensor-dropout@contact+0.5", "--fault", "part-low@60")
    call = polish_sim(*FORCE, *faults, "--seed", "3", "--out", "a")
    refused(call, "wrist sensor reading missing", "part-low@60 did not happen", code=3)
    first = metrics_of("a")
    assert first["retracted"] is True
    assert first["stop_delay_s"] <= 0.02
    log = read_log(Path("a/log.npz"))
    assert log["phase"][-1] == RETRACT_PHASE
    assert log["normal_force_n"][-1] == 0.0
    assert polish_sim("run", "force", "--config", "a/config.toml", "--out", "b")[0] == 3
    assert Path("a/config.toml").read_text() == Path("b/config.toml").read_text()
    assert Path("a/log.npz").read_bytes() == Path("b/log.npz").read_bytes()


@pytest.mark.pictures
def test_one_mode_leaves_the_contract_s_files_and_figures(polish_sim):
    words = "--mode assist --direction x --duration 0.8 --set hand.off_s=2 --out out"
    done(polish_sim("run", "teach", *words.split()), "hand force")
    files = {file.name for file in Path("out").iterdir()}
    assert {"config.toml", "metrics.json", "log.npz", "hand_force.png"} <= files
    metrics = metrics_of("out")
    assert {"hand_force_peak_n", "hand_force_rms_n", "drift_rad"} <= set(metrics)
    assert metrics["moves"] == ["assist_x_0p8s"]
    log = np.load("out/log.npz")
    assert log["hand_force_n"].shape == (len(log["time_s"]), 3)
    done(polish_sim("report", "out", "out", "--out", "beside"))
    Path("out/metrics.json").write_text(json.dumps(metrics | {"moves": [1]}))
    refused(polish_sim("report", "out", "--out", "edited"), "'moves'", "'out/metrics.json'")


def test_a_taught_rim_is_polished_within_4_newton(polish_sim):
    out = done(polish_sim("run", "teach", "--part", "sphere_50", "--follow", "rim", "--out", "taught")).out
    assert "taught path off what was meant" in out
    assert {"taught.csv", "taught.png", "hand_force.png"} <= {file.name for file in Path("taught").iterdir()}
    assert read_path("taught/taught.csv").length_m == metrics_of("taught")["taught_length_m"]
    words = "--part sphere_50 --path taught/taught.csv --set process.max_feed_s=4 --out polished"
    assert polish_sim("run", "surface", *words.split(), *UNPROVEN)[0] == 0
    assert metrics_of("polished")["force_within_4n"] >= 0.995
