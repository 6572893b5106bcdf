"""Help, versions and wrong words on the command line; options reach the scenario in SI."""

import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from polish_sim import __version__
from polish_sim.cli.catalogue import KINDS
from polish_sim.cli.main import COMMANDS
from polish_sim.cli.options import OWN, build_scenario, config_keys, named_options, refuse_idle_on_path, takes
from polish_sim.config import PlanConfig, Scenario
from polish_sim.dual.cell import PAIR_FAULTS
from polish_sim.errors import ConfigError, InputError, PolishSimError
from polish_sim.experiments import run_experiment
from polish_sim.experiments.registry import default_scenario, experiment, known_faults, refuse_idle_options
from polish_sim.scenario_file import leaves, merge, override
from tests.cli.conftest import assert_refused

SELDOM = "--set payload.average_s=0.01 --set simulation.log_rate_hz=2"
FLANGED = "--set head.flange.bandwidth_hz=20 --set controller.name=position"


def test_help_version_and_lists_are_on_stdout_and_say_what_there_is(polish_sim):
    for command in COMMANDS:
        code, out, err = polish_sim(command, "--help")
        assert (code, err) == (0, "")
        assert f"polish-sim {command}" in out
    words = " ".join(polish_sim("inspect", "--help").out.split())
    assert "default freeform" not in words
    assert "neighbouring turns (mm). --overlap" in words
    assert "(mm/s); auto = 10; default 10." in " ".join(polish_sim("run", "arc", "--help").out.split())
    assert "polish-sim job init [OPTIONS] PART" in polish_sim("job", "init", "--help").out
    code, out, err = polish_sim()
    assert (code, err) == (0, "")
    assert all(f"  {command}" in out for command in COMMANDS)
    assert polish_sim("--version") == (0, f"polish-sim {__version__}\n", "")
    code, out, _ = polish_sim("list")
    assert code == 0
    for name in ("freeform", "hybrid-pi", "position", "arc", "force", "surface", "spiral", "raster"):
        assert name in out
    lists = {kind: polish_sim("list", kind).out.splitlines() for kind in KINDS}
    told = {kind: dict(line.split(maxsplit=1) for line in lines) for kind, lines in lists.items()}
    assert all(text and not text.endswith(".") for texts in told.values() for text in texts.values())
    assert told["faults"].keys() == known_faults().keys() == PAIR_FAULTS.keys()
    assert "20 mm/s" in told["faults"]["part-high"]
    assert polish_sim("config", "calibrate-payload").out.startswith('experiment = "calibrate-payload"')


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("runn", "Known: calibrate, compare, config, demo"), ("run", "EXPERIMENT"),
        ("run forse", "mean 'force'? ... arc, dual, force, smooth, surface, teach"),
        ("list robots", "controllers, experiments, faults, parts, patterns, tools."),
        ("config circle", "arc, calibrate-payload, dual, force, limits, smooth, surface, teach"),
        ("run arc --fed 3", "--fed"), ("run arc --seeds 0", "--seeds"),
        ("run arc --seeds 2 --live --video", "--live, --video would change nothing with --seeds"),
        ("run force --live-port 9000", "--live-port would change nothing without --live"),
        ("view nowhere", "'run'"),
        ("run force --seeds 2 --set process.learn=x", "--set process.learn would change nothing with"),
        ("run arc --set part.file=plate", "--set part.file would change nothing in 'run arc'"),
        ("sweep arc --set part.file=plate", "--set part.file would change nothing in 'run arc'"),
        ("sweep arc --vary part.file=plate", "--vary part.file would change nothing in 'run arc'"),
        ("run arc --controller pid", "'pid' ... FILE.py:CLASS, force-mode"),
        ("run arc --controller gone.py:Mine", "'gone.py' does not exist"),
        ("run arc --stepover 8 --region top", "--region, --stepover ... 'run arc'"),
        ("run arc --fault part-high@3", "there is no part to press on"),
        ("run surface --real-part gone.stl", "'gone.stl' is no file"), ("run surface --path gone", "gone"),
        ("run surface --tool laser", "unknown tool 'laser'"),
        ("run surface --tool active-flange --controller hybrid-pi", "the controller 'hybrid-pi'"),
        ("run surface --tool active-flange --contact-force 150", "which 'active-flange' allows"),
        ("run surface --contact-force 45 --set safety.force_limit_n=50", "Raise it to 54 or more"),
        ("run surface --set sensor.rate_hz=5000", "faster than the physics"),
        ("run surface --order sideways", "'sideways' ... inward, outward."),
        ("run force --set sensor.noise=3", "'sensor.force_noise_n'? ... bandwidth_hz"),
        ("run force --set stepover=8", "Did you mean 'plan.stepover_m'?"),
        ("run force --fault gremlins@3", "sensor-frozen"), ("run force --fault part-high", "NAME@TIME"),
        ("run force --region box:1,2", "region 'box:1,2' is not box:"),
        ("run force --units feet", "unknown unit 'feet'"), ("run force --config gone.toml", "gone.toml"),
        ("run force --calibration gone.toml", "cannot read the calibration 'gone.toml'"),
        ("run force --out .", "the output folder '.' exists"),
        ("run force --set safety.tool_in_part=x", "Known: allow, refuse"),
        ("plan freeform --proof foo", "none, nominal, or the number"),
        ("run dual --region faces:gone.txt", "cannot read the file of ... 'gone.txt'"),
        (f"run dual {FLANGED}", "leave it out of 'dual'"), (f"run arc {FLANGED}", "leave it out of 'arc'"),
        ("run dual --master-path way.csv --master-turn 3", "--master-turn would ... with --master-path"),
        ("plan plate --master-turn 5", "--master-turn would ... without --dual"),
        ("run surface --standoff 5", "--standoff ... 'run surface'"),
        ("run surface --fault master-stop@1", "it is one of 'run dual'"),
        ("run teach --mode float", "assist, classical, gravity, inertia, none"),
        ("run teach --dry-run", "--dry-run ... 'run teach'"),
        ("run teach --follow rim --duration 1", "--duration would change nothing with --follow"),
        ("score --case step-11", "Did you mean 'step-10'? Known: "),
        ("score --against hybrid-pi", "compared with itself"),
        ("score --ablate", "--ablate ... 'hybrid-adaptive'"),
        ("score --ablate --against position", "--against would change nothing with --ablate"),
        ("score --worst 30 --on dask --list --check", "--list, --check would change nothing with --worst"),
        ("score --worst 30 --workers 2 --border", "--border ... --worst"),
        ("score --border --seeds 3 --workers 2 --ablate", "--seeds, --ablate would"),
        ("sweep ark", "Did you mean 'arc'?"),
        ("sweep arc --vary controller.own.gain=0.1", "is for an own controller"),
        ("sweep arc --vary controller.name=hybrid-pi,hybrid-p", "Did you mean 'hybrid-pi'?"),
        ("sweep arc --on locl", "unknown engine 'locl'"),
        ("sweep nowhere/study.toml", "cannot read the study"),
        ("identify --periods 0", "--periods 0 is outside 1 to 360"), ("identify --starts 0", "1 to 10000"),
        ("identify --periods 1000000", "is outside 1 to 360"), ("job init", "'PART' ... job init --help"),
        ("identify --period 5", "--period would change nothing without --data"),
        ("identify --data none.csv --period -1", "--period -1 is outside 0.001"),
        ("identify --data none.csv --task line.csv", "--task would change nothing with --data"),
        ("identify --data none.csv --seeds 3 --on dask", "--seeds, --on would change nothing with --data"),
        ("identify --workers 2", "--workers would change nothing without --seeds"),
        ("identify --model robot.xml", "--model ... without --data or --report"),
        ("identify --report --model none.xml", "cannot read the robot model 'none.xml'"),
        ("identify --report --data log.csv --seed 3", "--seed, --data would change nothing with"),
        ("identify --payload 9", "--payload 9 is outside 0 to 3"),
        ("identify --joints a", "--joints would change nothing without --model"),
        ("identify --arm ur5e --data log.npz --model a.xml", "--arm would change nothing with --model"),
        ("identify --arm ur10e", "--arm would change nothing without --data"),
        ("identify --arm ur11 --report", "unknown arm 'ur11'"),
        ("identify --payload-data b.csv", "--payload-data needs --data"),
        ("identify --run a --arm ur5e --report", "--run would change nothing without --data"),
        (f"serve {FLANGED}", "leave it out of 'serve'"),
        (f"plan plate {FLANGED} --export urscript", "leave it out of '--export urscript'"),
        ("plan freeforme", "Did you mean 'freeform'? Shipped: "),
        ("plan plate --pattern raster --order outward", "--order would change nothing with"),
        ("plan plate --dual --fixture gone.stl", "--fixture"),
        ("plan plate --up left", "unknown side for --up 'left'"), ("plan \udce4.stl", "not UTF-8. Rename"),
        ("plan plate --stepover 60", "the pad measures 50 mm"), ("plan plate --stepover 300", "300 mm"),
        ("plan plate --pattern star", "Did you mean 'raster'? Known: "),
        ("plan plate --lead-in jump", "Known: arc, normal, tangent"),
        ("plan plate --overlap 70 --stepover 8", "give one of them"),
        ("plan plate --even-removal --removal map.ply", "give one of them"),
        ("plan plate --dual --reach-map --proof none", "--reach-map, --proof ... with --dual"),
        ("plan gone.stl --out .", "the output folder '.' exists"),
        ("inspect gone.csv --part plate --out .", "the output folder '.' exists"),
        ("report gone --out .", "the output folder '.' exists"),
        ("report gone", "'gone' is not a run folder"),
        ("run surface --part gone.stl", "'gone.stl' is no file"),
        ("run surface --part plate --fixture gone.stl", "'gone.stl' is no file"),
        ("run surface --part plate --removal gone.ply", "'gone.ply' is no file"),
        ("sweep surface --vary part.file=plate,gone.stl", "'gone.stl' is no file"),
        *((f"{words} --seed 9223372036854775807 --seeds 2", "'seed' = 9223372036854775808 is outside 0 to")
          for words in ("run force", "sweep arc", "score", "calibrate payload", "identify")),
        ("calibrate", "arm, base, budget, payload, tcp."),
        ("calibrate tpc", "Known: arm, base, budget, payload, tcp."),
        ("calibrate payload --poses 3", "--poses 3 is outside 4 to 500"),
        ("calibrate tcp --arm ur10", "--arm 'ur10' ... 'ur10e'?"),
        ("calibrate tcp --data gone.csv", "cannot read the flange poses 'gone.csv'"),
        ("calibrate tcp --data gone.csv --cell-tool", "--cell-tool ... --data"),
        ("calibrate arm --poses 19", "--poses 19 is outside 20 to"),
        ("calibrate arm --data gone.csv", "cannot read the measurements 'gone.csv'"),
        ("calibrate budget --touch-noise nan", "--touch-noise nan is outside 0 to 10 mm"),
        ("calibrate budget --tracker-noise 0 --touch-noise 0", "leaves no error to share out"),
        ("calibrate payload --data gone.csv", "cannot read the readings 'gone.csv'"),
        ("calibrate payload --data gone.csv --poses 9", "--poses would change nothing with --data"),
    ],
)  # fmt: skip
def test_wrong_words_are_one_line_before_any_work(polish_sim, words, said):
    call = polish_sim(*words.split())
    assert_refused(call, said)
    assert call.err.count("\n") == 1  # no stage was begun


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("run force --config binary.csv", "'binary.csv' is not UTF-8 (at line 2)"),
        ("run force --set experiment=arc", "'force': leave the setting experiment=arc out"),
        ("plan plate --set guide.mode=assist", "--set guide.mode would change nothing in 'plan'"),
        ("run surface --region bottom", "bottom"), ("identify --data none.csv", "there is no log 'none.csv'"),
        ("run teach --duration 0.5", "joint_speed_limit_rad_s ... --duration 0.508 or longer"),
        ("run teach --follow gone.csv", "gone.csv"),
        ("run teach --set robot.real.encoder_rad=4.8e-5", "too coarse for --mode assist"),
        ("run teach --set guide.model_file=gone.xml", "cannot read the robot model 'gone.xml'"),
        ("run dual --master-path gone.csv", "cannot read the poses 'gone.csv'"),
        ("calibrate payload --set sensor.force_range_n=5", "is at the end of its range in pose 1"),
        (f"calibrate payload {SELDOM}", "0.01 s of readings in pose 1"),
        ("run force --config deep.toml", "'deep.toml' is not valid TOML: maximum recursion"),
        ("run force --set sensor.force_noise_n=" + 3000 * "[", "'sensor.force_noise_n' must be a number"),
        ("run force --config mine.toml", "force_noise_n' = -1.0 ... 0 to 20"),
        ("calibrate tcp --data .", "Is a directory"), ("plan /dev/null", "/dev/null: not a regular file"),
        ("inspect /dev/null --part plate", "'/dev/null': Not a regular file"),
        ("plan plate --region faces:/dev/null", "Not a regular file"),
        ("run force --config /dev/null", "Not a regular file"),
        ("calibrate tcp --data /dev/null", "Not a regular file"),
        ("run teach --set guide.model_file=/dev/null", "cannot read the robot model '/dev/null'"),
        ("compare /dev/null", "Not a regular file"), ("compare binary.csv", "is no text ... a CSV"),
        ("compare other", "no run folder and no ... ROS bag"), ("calibrate tcp --data empty.csv", "holds no"),
        ("calibrate tcp --data binary.csv", "is not a text file"), ("compare empty.csv", "holds no samples"),
        ("job init plate --out mine.toml/job.toml", "cannot write 'mine.toml/job.toml'"),
        ("job bad.toml", "In a job's file: up for --up."),
        ("sweep arc --out other", "holds something that is not a sweep"),
        ("score --out other", "is not a score"),
        ("sweep arc --vary nothing", "'--vary nothing' is not KEY=VALUES"),  # a folder that is no study
    ],
)  # fmt: skip
def test_what_only_the_work_shows_to_be_wrong_is_one_error_and_files_are_left_alone(polish_sim, words, said):
    Path("deep.toml").write_text("a = " + 5000 * "[" + 5000 * "]")
    Path("mine.toml").write_text("\ufeff[sensor]\nforce_noise_n = -1.0\n", encoding="utf-8")
    Path("empty.csv").touch()
    Path("binary.csv").write_bytes(bytes(range(256)))
    for folder in ("other", "arc"):
        Path(folder).mkdir()
    Path("other/notes.txt").touch()
    Path("bad.toml").write_text('[[setup]]\nup = "w"\n[[setup.pass]]\n')
    held = ("bad.toml", "deep.toml", "mine.toml", "empty.csv", "binary.csv", "other", "arc")
    assert_refused(polish_sim(*words.split()), said, *held)
    assert [path.name for path in Path("other").iterdir()] == ["notes.txt"]


KEYS = config_keys(Scenario())


def built(words, **more):
    """The scenario of options as a user writes them."""
    read = {**KEYS, **OWN}
    given = {name: read[name].read(str(value)) for name, value in words.items()}
    return build_scenario(Scenario(), given | more)


def test_options_land_in_their_keys_in_si():
    landed = [
        ("--part", "plate", "part.file", "plate"),
        ("--part-pose", "-100,-500,50,0,0,90", "part.pose", (-0.1, -0.5, 0.05, 0.0, 0.0, math.pi / 2)),
        ("--contact-force", 15.0, "process.contact_force_n", 15.0),
        ("--feed", 12.0, "process.feed_m_s", 0.012), ("--pad-diameter", 30.0, "pad.radius_m", 0.015),
        ("--spindle-rpm", 3000.0, "spindle.speed_rpm", 3000.0),
        ("--feature-angle", 20.0, "plan.feature_angle_rad", math.radians(20.0)),
        ("--hole-margin", 2.0, "plan.hole_margin_m", 0.002),
        ("--edge-margin", 3.0, "plan.edge_margin_m", 0.003),
        ("--axis-smoothing", 15.0, "plan.axis_smoothing_m", 0.015),
        ("--order", "outward", "plan.order", "outward"), ("--direction", "climb", "plan.direction", "climb"),
        ("--lead-in", "arc", "plan.lead_in", "arc"),
        ("--start", "10,-20,30", "plan.start", (0.01, -0.02, 0.03)),
        ("--raster-direction", "0,1,0", "plan.raster_direction", (0.0, 1.0, 0.0)),
        ("--seed", 4, "seed", 4), ("--log-rate", "full", "simulation.log_rate_hz", 0.0),
    ]  # fmt: skip
    values = dict(leaves(built({option: value for option, value, _, _ in landed})))
    assert [values[key] for _, _, key, _ in landed] == [pytest.approx(value) for *_, value in landed]


def test_set_beats_options_that_beat_the_file_and_a_zero_is_given_a_switch_that_is_off_not(tmp_path):
    assert build_scenario(Scenario(), {"--feed": None, "--part": None}) == Scenario()
    file = tmp_path / "mine.toml"
    file.write_text("[process]\nfeed_m_s = 0.002\ncontact_force_n = 5.0\n[pad]\npoints = 50\n")
    more = {"--config": file, "--set": ["process.contact_force_n=7.0", "pad.radius_m=0.02"]}
    scenario = built({"--feed": 3.0, "--contact-force": 6.0, "--overlap": 70.0}, **more)
    assert scenario.pad.points == 50
    assert scenario.process.feed_m_s == pytest.approx(0.003)
    assert scenario.process.contact_force_n == 7.0
    assert scenario.plan.stepover_m == pytest.approx(0.012)  # the overlap counts on the pad that --set says
    file.write_text('experiment = "arc"\n')
    with pytest.raises(ConfigError, match=r"'arc', not 'surface'"):
        built({}, **{"--config": file})

    @takes("--spindle-rpm", "--set", "--view")
    def command(given):
        return given

    given = command(option_0="0", option_1=False, option_2=None)
    assert given == {"--spindle-rpm": 0.0, "--set": None, "--view": None}


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--stepover", -8.0, r"--stepover -8 .* 0\.2 to 1000 mm"),
        ("--feed", math.nan, r"--feed nan is outside 0\.1 to 500 mm/s"),
        ("--pad-diameter", 500.0, "--pad-diameter 500 .* 2 to 400 mm"),
        ("--start", "1,2,inf", r"--start '1,2,inf' is not X,Y,Z"),
        ("--raster-direction", "0,0,0", "not all zero"),
        ("--part-pose", "1,2,3", "six numbers in mm and deg"), ("--overlap", 100.0, r"step-over of 0 mm"),
        ("--overlap", "nan", r"nan is outside 0 to 100\.$"), ("--overlap", 99.9, r"step-over of 0\.05 mm"),
        ("--log-rate", "fast", "--log-rate 'fast' is not a number .*full"),
        ("--stepover", "8mm", r"'8mm' is not a number \(mm\)\. Write 8\."),
        ("--feed", "20.5 mm/s", r"mm/s or auto\)\. Write 20\.5\."),
        ("--stepover", "8cm", r"not a number \(mm\)\.$"),
        ("--stepover", "0.008", r"--stepover 0\.008 .* 0\.008 m write 8\."),
        ("--seed", "1" * 400, r"--seed 1+\.\.\. \(400 digits\) .* 0 to"),
        ("--seed", "1.5", r"--seed '1\.5' is not a whole number"),
    ],
)  # fmt: skip
def test_a_bad_value_is_named_with_its_option(option, value, said):
    with pytest.raises(PolishSimError, match=said):
        built({option: value})


def test_a_number_out_of_range_is_answered_without_the_key_s_name_or_unit():
    scalars = [own for own in KEYS.values() if own.kind is float]
    assert scalars
    for own in scalars:
        with pytest.raises(ConfigError) as raised:
            built({own.name: 1e9})
        assert f" {own.unit.name}: " in str(raised.value)
        assert own.key.partition(".")[2] not in str(raised.value)
        assert "[" not in str(raised.value)


def test_of_the_options_of_a_path_those_pass_that_change_something_and_others_are_refused_as_they_were_said():
    def refuse(row, *options):
        refuse_idle_options(row, {option: option for option in options})

    refuse(experiment("surface"), "--stepover", "--overlap", "--order", "--lead-in", "--start")
    assert "--direction" not in named_options({"--set": ["guide.direction=x"]})
    without = "--stepover would change nothing without --even-removal or --removal"
    with pytest.raises(InputError, match=without):
        refuse(experiment("dual"), "--stepover")
    for asked in ("--even-removal", "--removal"):
        refuse(experiment("dual"), asked, "--stepover")
    with pytest.raises(InputError, match="give --axis-smoothing MM as well"):
        refuse_idle_on_path(PlanConfig(), {"--axis-deviation": 3.0})
    refuse_idle_on_path(PlanConfig(axis_smoothing_m=0.01), {"--axis-deviation": 3.0})
    for name, word in (
        ("arc", "plan.stepover_m"), ("arc", "part.motion_m"), ("force", "plan.stepover_m"),
        ("surface", "drag.follow"), ("smooth", "controller.force_p_m_sn"), ("dual", "hand.distance_m"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=f"--set {word} would change nothing in 'run {name}'"):
            refuse_idle_options(experiment(name), named_options({"--set": ["seed=1", f"{word}=1"]}))


@pytest.mark.parametrize(
    ("name", "short"),
    [
        ("arc", "process.max_feed_s=0.5"), ("force", "process.hold_s=1.0"),
        ("teach", "guide.duration_s=1.0 guide.mode=inertia guide.direction=x"),
    ],
)  # fmt: skip
def test_of_a_section_that_is_called_idle_no_number_changes_a_run(name, short):
    changed = usual = override(default_scenario(name), short.split())
    for section in experiment(name).idle:
        table = getattr(usual, section)
        numbers = {f.name: f for f in fields(table) if type(getattr(table, f.name)) is float}
        values = {key: 0.5 * (getattr(table, key) + f.metadata["high"]) for key, f in numbers.items()}
        changed = merge(changed, {section: values}, "")
    assert changed != usual
    first, second = (run_experiment(scenario).log.columns for scenario in (usual, changed))
    for column in first:
        np.testing.assert_array_equal(first[column], second[column], column)


def test_a_user_s_files_are_named_from_the_root(tmp_path, monkeypatch):
    (tmp_path / "mine.py").touch()
    (tmp_path / "mine.toml").touch()
    monkeypatch.chdir(tmp_path)
    limits = built({}, **{"--set": ["smoothing.limits_file=mine.toml"]}).smoothing.limits_file
    assert limits == str(tmp_path.resolve() / "mine.toml")
    controller = built({"--controller": "mine.py:Down"}).controller
    assert controller.name == f"{tmp_path.resolve() / 'mine.py'}:Down"
    assert controller.label == "mine.py:Down"
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert built({}, **{"--set": [f"controller.name={controller.name}"]}).controller == controller
