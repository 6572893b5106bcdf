"""What README, examples and the public names promise."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
import typer

import polish_sim
from polish_sim.cli.main import commands
from tests.identification.known import design_once

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
RUN_BLOCKS = runpy.run_path(str(ROOT / "docs" / "run_blocks.py"))
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *RUN_BLOCKS["MIRRORED"]]

# Command lines, in the blocks and in the sentences of pages, without `polish-sim` and comments.
COMMAND = "polish-sim ((?:plan|run|report|config|list|demo|[a-z]+ )"
COMMAND += r"(?! ?(?:EXPERIMENT|\.\.\.))[^`#\n|]*)"
TEXTS = [file.read_text(encoding="utf-8").replace("\\\n", " ") for file in (ROOT / "README.md", *PAGES)]
TYPED = {line for text in TEXTS for line in re.findall(COMMAND, text)}
PYTHON = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


def test_blocks_of_pages_are_of_a_kind_that_runs_or_cannot_and_shortened_only_where_they_take_long():
    for page in PAGES:
        assert {block.kind for block in RUN_BLOCKS["blocks"](page)} <= set(RUN_BLOCKS["KINDS"]), page.name
    shortened, many = RUN_BLOCKS["shortened"], ["run", "surface", "--seeds", "20", "--check"]
    assert shortened(["run", "force", "--out", "a"]) == ["run", "force", "--out", "a"]
    assert shortened(many) == ["run", "surface", "--seeds", "1", *RUN_BLOCKS["FEED"]]
    assert shortened(["score", "--case", "a", "--case", "b"]) == ["score", "--case", "a", "--seeds", "1"]
    assert shortened(["score", "--reach"]) == ["score", "--reach", "--case", "reach-step", "--seeds", "1"]


def test_a_table_ends_with_an_empty_line_or_the_text_behind_it_would_be_a_row():
    assert not [row for text in TEXTS for row in re.findall(r"^\|.*\n[^|\n].*", text, flags=re.MULTILINE)]


def test_every_command_line_names_existing_commands_and_options():
    assert len(TYPED) > 100
    for line in sorted(TYPED):
        name, *words = line.split()
        command = typer.main.get_command(commands).get_command(None, name)
        if hasattr(command, "get_command"):  # a group: the next word names the command
            command = command.get_command(None, words[0])
        options = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= options | {"--help"}, line


@pytest.mark.parametrize("program", PYTHON)
def test_the_python_example_runs(program, capsys):
    exec(compile(program, "README.md", "exec"), {})
    assert float(capsys.readouterr().out) > 0.0


def test_every_file_that_is_linked_every_target_and_how_each_picture_is_made_is_there():
    links = re.findall(r"\]\((?!http)([^)#]+)\)", README)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert {"demo", "test", "check", "bench", "docs", "clean"} <= set(targets)
    told = (ROOT / "results" / "README.md").read_text(encoding="utf-8").partition("## gallery/")[2]
    pictures = {path.name for path in (ROOT / "results" / "gallery").iterdir()}
    first_column = "".join(re.findall(r"^\|([^|]*)\|", told, flags=re.MULTILINE))
    assert set(re.findall(r"`([a-z_]+\.(?:png|gif))`", first_column)) == pictures


FOLDER = ROOT / "examples"
PRINTS = {
    "01_load_part": r"wedge: 8 facets, up \[0\. 0\. 1\.\]",
    "02_fit_surface": r"normal error: 0\.00\d\d deg at most",
    "03_select_region": r"auto, 10 mm off the edges +\d+\.\d cm2, 3 borders",
    "04_plan_spiral": r"coverage_stepover +(1|0\.99\d*)\n",
    "05_compare_patterns": r"spiral .*\ncontour .*\nfermat .*\nraster ",
    "06_inspect_path": r"stepover_mean_m +0\.0060",
    "07_export": r"APT read back: [45]\.\de-10 m off",
    "08_run_surface": r"contact force: 1[45]\.\d\d N on average, 15 N asked for",
    "09_own_controller": r"Damper +within 3 N after 0\.[23]\d s, overshoot 0\.\d\d N\nhybrid-pi ",
    "10_two_robots": r"tool on the part: 0\.0\d\d mm rms\n",
    "11_identify": r"error / range: 0\.\d+ %, by the drawing 2\.\d+ %\n"
    r"classical .* 2\d\.\d N.*\ninertia .* 1\d\.\d N",
    "12_smooth": r"spline +2\.0\d+ s, off the path by (20\.0|19\.\d) um",
    "13_environment": r"observation of 34 numbers, exact force .* N\nreward \d+\.\d; (stopped: |its time)",
    "14_admittance": r"x 1: Admittance within 3 N after 0\.1\d s, overshoot 0\.\d N\n",
    "15_impedance": r"position +\+2\.\d\d N off.*\nimpedance +\+0\.4\d N off.*\nhybrid-pi +[+-]0\.0",
}


@pytest.mark.parametrize("name", PRINTS)
def test_the_example_runs_and_prints_what_it_promises(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    design_once(monkeypatch, iterations=5)  # a third of what the example gives its search
    runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    plt.close("all")
    assert re.search(PRINTS[name], capsys.readouterr().out)


def test_every_example_is_run_listed_and_named_in_order():
    names = sorted(file.stem for file in FOLDER.glob("[0-9]*.py"))
    assert names == sorted(PRINTS)
    readme = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| \[(\w+)\.py\]", readme, re.MULTILINE) == names
    assert [int(name[:2]) for name in names] == list(range(1, len(names) + 1))


def test_every_public_name_resolves_an_unknown_one_says_what_there_is_and_no_simulator_is_loaded():
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8").partition("Your own controller")[0]
    names = re.findall(r":: (?!polish_sim)(\w+)", page)
    assert len(names) > 25
    assert set(names) <= set(dir(polish_sim))
    assert None not in [getattr(polish_sim, name) for name in names]
    with pytest.raises(AttributeError, match="run_surface"):
        _ = polish_sim.run_everything
    program = "import sys, polish_sim; print('mujoco' in sys.modules or 'numba' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"
