"""Help, versions and wrong words on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from polish_sim import __version__
from polish_sim.cell import FAULTS
from polish_sim.cli.catalogue import KINDS
from polish_sim.cli.main import commands
from tests.cli.conftest import Tool

COMMANDS = sorted(info.name for info in commands.registered_commands if info.name)


FLANGED = ("--set", "head.flange.bandwidth_hz=20", "--set", "controller.name=position")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_on_stdout(polish_sim: Tool, command: str) -> None:
    code, out, err = polish_sim(command, "--help")
    assert (code, err) == (0, "")
    assert f"polish-sim {command}" in out


def test_without_a_command_the_help_lists_them_all(polish_sim: Tool) -> None:
    code, out, err = polish_sim()
    assert (code, err) == (0, "")
    assert all(f"  {command}" in out for command in COMMANDS)


def test_the_version_is_the_package_s(polish_sim: Tool) -> None:
    assert polish_sim("--version") == (0, f"polish-sim {__version__}\n", "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["runn"], "Known: calibrate, compare, config, demo"),
        (["run", "forse"], "'forse'. Did you mean 'force'? Known: arc, dual, force, smooth, surface, teach"),
        (["list", "robots"], "Known: controllers, experiments, faults, parts, patterns, tools."),
        (["config", "circle"], "Known: arc, calibrate-payload, dual, force, limits, smooth, surface, teach"),
        (["run"], "EXPERIMENT"),
        (["run", "arc", "--fed", "3"], "--fed"),
        (["run", "arc", "--feed", "fast"], "--feed"),
        (["run", "arc", "--seeds", "0"], "--seeds"),
        (["run", "arc", "--seeds", "2", "--video"], "leave --seeds out"),
        (["run", "arc", "--controller", "pid"], "unknown controller 'pid'. Known: FILE.py:CLASS, force-mode"),
        (["run", "arc", "--controller", "gone.py:Mine"], "'gone.py' does not exist"),
        (["run", "surface", "--part", "gone.stl"], "gone.stl"),
        (
            ["plan", "freeforme"],
            "'freeforme' is neither a file nor a shipped part. Did you mean 'freeform'? Shipped: ",
        ),
        (["run", "surface", "--region", "bottom"], "bottom"),
        (["run", "surface", "--path", "gone"], "gone"),
        (["run", "surface", "--part-pose", "1,2"], "--part-pose"),
        (
            ["run", "force", "--set", "sensor.noise=3"],
            "Did you mean 'sensor.force_noise_n'? Known here: bandwidth_hz",
        ),
        (["run", "force", "--set", "stepover=8"], "unknown key 'stepover'. Did you mean 'plan.stepover_m'?"),
        (["run", "force", "--fault", "gremlins@3"], "sensor-frozen"),
        (["run", "force", "--fault", "part-high"], "NAME@TIME"),
        (["run", "surface", "--pattern", "spirall"], "unknown pattern 'spirall'. Did you mean 'spiral'?"),
        (["plan", "plate", "--units", "metre"], "unknown unit 'metre'. Did you mean 'm'?"),
        (
            ["run", "arc", "--stepover", "8", "--region", "top"],
            "--region, --stepover would change nothing in 'run arc'",
        ),
        (["run", "force", "--config", "gone.toml"], "gone.toml"),
        (["report", "gone"], "'gone' is not a run folder"),
        (["run", "force", "--calibration", "gone.toml"], "cannot read the calibration 'gone.toml'"),
        (["calibrate"], "Missing command. Known: arm, base, budget, payload, tcp."),
        (["calibrate", "tpc"], "Known: arm, base, budget, payload, tcp."),
        (["calibrate", "payload", "--poses", "3"], "--poses 3 is outside 4 to 500"),
        (["calibrate", "payload", "--noise", "-1"], "--noise -1 is outside 0 to 20 N"),
        (["calibrate", "payload", "--data", "gone.csv"], "cannot read the readings 'gone.csv'"),
        (
            ["calibrate", "payload", "--data", "gone.csv", "--poses", "9"],
            "--poses would change nothing with --data",
        ),
        (["calibrate", "payload", "--set", "sensor.force_range_n=5"], "is at the end of its range in pose 1"),
        (
            ["calibrate", "payload", "--set", "payload.average_s=0.01", "--set", "simulation.log_rate_hz=2"],
            "no row of the log is in the 0.01 s of readings in pose 1",
        ),
    ],
)
def test_wrong_words_are_one_message_with_code_2_and_nothing_written(
    polish_sim: Tool, tmp_path: Path, words: list[str], said: str
) -> None:
    code, out, err = polish_sim(*words)
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert (code, out) == (2, "")
    assert len(errors) == 1
    assert said in errors[0]
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["run", "surface", "--contact-force", "45", "--set", "safety.force_limit_n=50"],
            "Raise it to 54 or more",
        ),
        (
            ["run", "surface", "--set", "sensor.rate_hz=5000"],
            "sensor.rate_hz = 5000 is faster than the physics",
        ),
        (["run", "surface", "--tool", "laser"], "unknown tool 'laser'"),
        (
            ["run", "surface", "--tool", "active-flange", "--controller", "hybrid-pi"],
            "the controller 'hybrid-pi'",
        ),
        (
            ["run", "surface", "--tool", "active-flange", "--contact-force", "150"],
            "which 'active-flange' allows",
        ),
        (["run", "dual", *FLANGED], "leave it out of 'dual'"),
        (["serve", *FLANGED], "leave it out of 'serve'"),
        (["plan", "plate", *FLANGED, "--export", "urscript"], "leave it out of '--export urscript'"),
        (["run", "surface", "--real-part", "gone.stl"], "'gone.stl' is no file"),
        (["run", "force", "--region", "box:1,2"], "region 'box:1,2' is not box:"),
        (["run", "dual", "--region", "faces:gone.txt"], "gone.txt: cannot be read"),
        (["run", "force", "--units", "feet"], "unknown unit 'feet'"),
        (["run", "arc", "--fault", "part-high@3"], "there is no part to press on"),
        (["run", "surface", "--learn", "first", "--seeds", "2"], "leave --seeds out"),
        (["run", "surface", "--order", "sideways"], "unknown order 'sideways'. Known: inward, outward."),
        (["run", "surface", "--axis-deviation", "3"], "give --axis-smoothing MM as well"),
        (["run", "surface", "--stepover", "-8"], "--stepover -8 is outside 0.2 to 1000 mm"),
        (["plan", "plate", "--direction", "down"], "unknown direction 'down'. Known: climb, conventional."),
        (["plan", "plate", "--pattern", "raster", "--order", "outward"], "--order would change nothing with"),
        (["plan", "plate", "--lead-angle", "80"], "--lead-angle 80 is outside -40 to 40 deg"),
        (["plan", "plate", "--region", "point:1"], "region 'point:1' is not point:X,Y,Z"),
        (["plan", "plate", "--up", "left"], "unknown side for --up 'left'"),
        (["plan", "plate", "--stepover", "60"], "would leave stripes: the pad measures 50 mm"),
        (["run", "force", "--out", "."], "the output folder '.' exists"),
        (["plan", "gone.stl", "--out", "."], "the output folder '.' exists"),
        (["inspect", "gone.csv", "--part", "plate", "--out", "."], "the output folder '.' exists"),
        (["report", "gone", "--out", "."], "the output folder '.' exists"),
    ],
)
def test_what_is_wrong_whatever_the_part_is_told_before_any_work(
    polish_sim: Tool, words: list[str], said: str
) -> None:
    code, out, err = polish_sim(*words)
    assert (code, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1  # no stage was begun


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[sensor\n", "not valid TOML"),
        ("[sensor]\nforce_noise_n = -1.0\n", "outside 0 to 20"),
        ("\xff", "mine.toml"),
    ],
)
def test_a_bad_config_names_the_key_and_writes_nothing(
    polish_sim: Tool, tmp_path: Path, text: str, said: str
) -> None:
    (tmp_path / "mine.toml").write_text(text, encoding="latin-1")
    code, _, err = polish_sim("run", "force", "--config", "mine.toml")
    assert code == 2
    assert said in err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_list_names_what_ships_and_of_one_kind_says_what_each_is(polish_sim: Tool) -> None:
    code, out, _ = polish_sim("list")
    assert code == 0
    for name in ("freeform", "hybrid-pi", "position", "arc", "force", "surface", "spiral", "raster"):
        assert name in out
    told = {
        kind: dict(line.split(maxsplit=1) for line in polish_sim("list", kind).out.splitlines())
        for kind in KINDS
    }
    assert all(text and not text.endswith(".") for texts in told.values() for text in texts.values())
    assert told["faults"].keys() == FAULTS.keys()
    assert "20 mm/s" in told["faults"]["part-high"]


def test_the_config_of_a_calibration_can_be_printed_too(polish_sim: Tool) -> None:
    code, out, _ = polish_sim("config", "calibrate-payload")
    assert code == 0
    assert out.startswith('experiment = "calibrate-payload"')
