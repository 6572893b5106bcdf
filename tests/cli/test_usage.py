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
FLANGED = "--set head.flange.bandwidth_hz=20 --set controller.name=position"


def test_help_and_version_are_on_stdout_and_without_a_command_all_are_listed(polish_sim: Tool) -> None:
    for command in COMMANDS:
        code, out, err = polish_sim(command, "--help")
        assert (code, err) == (0, "")
        assert f"polish-sim {command}" in out
    code, out, err = polish_sim()
    assert (code, err) == (0, "")
    assert all(f"  {command}" in out for command in COMMANDS)
    assert polish_sim("--version") == (0, f"polish-sim {__version__}\n", "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("runn", "Known: calibrate, compare, config, demo"),
        ("run", "EXPERIMENT"),
        ("run forse", "Did you mean 'force'? Known: arc, dual, force, smooth, surface, teach"),
        ("list robots", "Known: controllers, experiments, faults, parts, patterns, tools."),
        ("config circle", "Known: arc, calibrate-payload, dual, force, limits, smooth, surface, teach"),
        ("run arc --fed 3", "--fed"),
        ("run arc --feed fast", "--feed"),
        ("run arc --seeds 0", "--seeds"),
        ("run arc --seeds 2 --video", "leave --seeds out"),
        ("run arc --controller pid", "unknown controller 'pid'. Known: FILE.py:CLASS, force-mode"),
        ("run arc --controller gone.py:Mine", "'gone.py' does not exist"),
        ("run arc --stepover 8 --region top", "--region, --stepover would change nothing in 'run arc'"),
        ("run arc --fault part-high@3", "there is no part to press on"),
        ("run surface --real-part gone.stl", "'gone.stl' is no file"),
        ("run surface --path gone", "gone"),
        ("run surface --tool laser", "unknown tool 'laser'"),
        ("run surface --tool active-flange --controller hybrid-pi", "the controller 'hybrid-pi'"),
        ("run surface --tool active-flange --contact-force 150", "which 'active-flange' allows"),
        ("run surface --contact-force 45 --set safety.force_limit_n=50", "Raise it to 54 or more"),
        ("run surface --set sensor.rate_hz=5000", "faster than the physics"),
        ("run surface --order sideways", "unknown order 'sideways'. Known: inward, outward."),
        ("run force --set sensor.noise=3", "Did you mean 'sensor.force_noise_n'? Known here: bandwidth_hz"),
        ("run force --set stepover=8", "Did you mean 'plan.stepover_m'?"),
        ("run force --fault gremlins@3", "sensor-frozen"),
        ("run force --fault part-high", "NAME@TIME"),
        ("run force --region box:1,2", "region 'box:1,2' is not box:"),
        ("run force --units feet", "unknown unit 'feet'"),
        ("run force --config gone.toml", "gone.toml"),
        ("run force --calibration gone.toml", "cannot read the calibration 'gone.toml'"),
        ("run force --out .", "the output folder '.' exists"),
        ("run dual --region faces:gone.txt", "gone.txt: cannot be read"),
        (f"run dual {FLANGED}", "leave it out of 'dual'"),
        (f"serve {FLANGED}", "leave it out of 'serve'"),
        (f"plan plate {FLANGED} --export urscript", "leave it out of '--export urscript'"),
        ("plan freeforme", "Did you mean 'freeform'? Shipped: "),
        ("plan plate --pattern raster --order outward", "--order would change nothing with"),
        ("plan plate --up left", "unknown side for --up 'left'"),
        ("plan plate --stepover 60", "would leave stripes: the pad measures 50 mm"),
        ("plan gone.stl --out .", "the output folder '.' exists"),
        ("inspect gone.csv --part plate --out .", "the output folder '.' exists"),
        ("report gone --out .", "the output folder '.' exists"),
        ("report gone", "'gone' is not a run folder"),
        ("calibrate", "Missing command. Known: arm, base, budget, payload, tcp."),
        ("calibrate tpc", "Known: arm, base, budget, payload, tcp."),
        ("calibrate payload --poses 3", "--poses 3 is outside 4 to 500"),
        ("calibrate payload --data gone.csv", "cannot read the readings 'gone.csv'"),
        ("calibrate payload --data gone.csv --poses 9", "--poses would change nothing with --data"),
    ],
)
def test_wrong_words_are_one_line_with_code_2_before_any_work_and_nothing_is_written(
    polish_sim: Tool, tmp_path: Path, words: str, said: str
) -> None:
    code, out, err = polish_sim(*words.split())
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert said in err
    assert err.count("\n") == 1  # no stage was begun
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("run surface --part gone.stl", "gone.stl"),
        ("run surface --region bottom", "bottom"),
        ("calibrate payload --set sensor.force_range_n=5", "is at the end of its range in pose 1"),
        (
            "calibrate payload --set payload.average_s=0.01 --set simulation.log_rate_hz=2",
            "no row of the log is in the 0.01 s of readings in pose 1",
        ),
    ],
)
def test_what_only_the_work_shows_to_be_wrong_is_one_error_and_nothing_is_written(
    polish_sim: Tool, tmp_path: Path, words: str, said: str
) -> None:
    code, out, err = polish_sim(*words.split())
    assert (code, out) == (2, "")
    (error,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert said in error
    assert list(tmp_path.iterdir()) == []


def test_a_bad_config_names_the_key_and_writes_nothing(polish_sim: Tool, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("[sensor]\nforce_noise_n = -1.0\n")
    code, _, err = polish_sim("run", "force", "--config", "mine.toml")
    assert code == 2
    assert "force_noise_n" in err
    assert "outside 0 to 20" in err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_list_names_what_ships_of_one_kind_says_what_each_is_and_every_config_can_be_printed(
    polish_sim: Tool,
) -> None:
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
    assert polish_sim("config", "calibrate-payload").out.startswith('experiment = "calibrate-payload"')
