"""The options of a path: the same on `plan` and on `run surface`, in panels, obeyed or refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from polish_sim.experiments.registry import PATH_OPTIONS
from tests.cli.conftest import Tool

SMALL = ("sphere_50", "--stepover", "20")
PANELS = ("Part and region:", "Path:", "Landing and tool axis:", "Tool and process:", "Config:", "Output:")


@pytest.mark.parametrize("command", [("plan",), ("run", "surface")])
def test_help_groups_every_option_of_a_path_in_panels(polish_sim: Tool, command: tuple[str, ...]) -> None:
    _, out, _ = polish_sim(*command, "--help")
    assert all(f"\n{panel}\n" in out for panel in PANELS)
    assert all(f"  {option} " in out for option in PATH_OPTIONS)
    assert out.index("Path:") < out.index("--stepover") < out.index("Landing and tool axis:") < out.index("--lead-in")


def test_every_option_of_a_path_reaches_the_plan(polish_sim: Tool) -> None:
    words = (
        "--order", "outward", "--direction", "climb", "--start", "0,0,25", "--lead-in", "arc", "--lead-angle", "5",
        "--tilt-angle", "-3", "--axis-smoothing", "15", "--axis-deviation", "2", "--feature-angle", "25",
        "--edge-margin", "3",
    )  # fmt: skip
    code, out, err = polish_sim("plan", *SMALL, *words, "--out", "plan")
    assert code == 0, err
    assert "through the air, leads included" in out
    plan = json.loads(Path("plan/path.json").read_text())["plan"]
    assert (plan["order"], plan["direction"], plan["lead_in"]) == ("outward", "climb", "arc")
    assert plan["start"] == pytest.approx([0.0, 0.0, 0.025])
    assert plan["axis_smoothing_m"] == pytest.approx(0.015)
    assert plan["edge_margin_m"] == pytest.approx(0.003)
    figures = json.loads(Path("plan/metrics.json").read_text())
    assert figures["air_length_m"] >= 0.06
    assert figures["axis_deviation_max_rad"] <= 0.034907


def test_run_takes_the_same_options_and_its_overlap(polish_sim: Tool) -> None:
    words = ("--overlap", "50", "--pad-diameter", "40", "--lead-in", "tangent", "--tilt-angle", "4", "--dry-run")
    code, _, err = polish_sim("run", "surface", "--part", "sphere_50", *words)
    assert code == 0, err


BAD = {
    "unknown order": (("--order", "sideways"), "unknown order 'sideways'. Known: inward, outward."),
    "unknown direction": (("--direction", "down"), "unknown direction 'down'. Known: climb, conventional."),
    "out of range in mm": (("--stepover", "-8"), "--stepover -8 is outside 0.2 to 1000 mm"),
    "out of range in deg": (("--lead-angle", "80"), "--lead-angle 80 is outside -40 to 40 deg"),
    "idle order": (("--pattern", "raster", "--order", "outward"), "--order would change nothing with the pattern"),
    "idle direction": (("--raster-direction", "1,0,0"), "--raster-direction would change nothing with the pattern"),
    "idle bound": (("--axis-deviation", "3"), "give --axis-smoothing MM as well"),
    "no point": (("--start", "here"), "--start 'here' is not X,Y,Z"),
}


@pytest.mark.parametrize("command", [("plan", "sphere_50"), ("run", "surface", "--part", "sphere_50", "--dry-run")])
@pytest.mark.parametrize("case", BAD)
def test_a_bad_option_is_one_message_on_both_commands(polish_sim: Tool, command: tuple[str, ...], case: str) -> None:
    words, said = BAD[case]
    code, _, err = polish_sim(*command, *words)
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert code == 2
    assert len(errors) == 1
    assert said in errors[0]
    assert list(Path().iterdir()) == []


def test_a_finished_path_is_not_planned_differently(polish_sim: Tool) -> None:
    assert polish_sim("plan", *SMALL, "--out", "plan")[0] == 0
    code, _, err = polish_sim("run", "surface", "--path", "plan", "--lead-in", "arc", "--overlap", "60", "--dry-run")
    assert code == 2
    assert "--path is a finished plan: leave --lead-in, --overlap out" in err
