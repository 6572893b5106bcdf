"""What the README says can be typed can be typed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import typer

from polish_sim.cli.main import commands

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
TYPED = sorted(set(re.findall(r"polish-sim ((?:plan|run|report|config|list|demo|[a-z]+ )[^`#\n]*)", README)))
PYTHON = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.parametrize("line", TYPED)
def test_every_command_line_names_existing_commands_and_options(line: str) -> None:
    name, *words = line.split()
    command = typer.main.get_command(commands).commands[name]  # type: ignore[attr-defined]
    if hasattr(command, "get_command"):  # a group: the next word names the command
        command = command.get_command(None, words[0])
    options = {option for parameter in command.params for option in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= options | {"--help"}


def test_there_are_command_lines_to_check() -> None:
    assert len(TYPED) >= 8


@pytest.mark.parametrize("program", PYTHON)
def test_the_python_example_runs(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(program, "README.md", "exec"), {})
    assert float(capsys.readouterr().out) > 0.0


def test_every_linked_file_exists() -> None:
    links = re.findall(r"\]\((?!http)([^)#]+)\)", README)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_every_picture_of_the_gallery_says_how_it_is_made() -> None:
    told = (ROOT / "results" / "README.md").read_text(encoding="utf-8").partition("## gallery/")[2]
    pictures = {path.name for path in (ROOT / "results" / "gallery").iterdir()}
    first_column = "".join(re.findall(r"^\|([^|]*)\|", told, flags=re.MULTILINE))
    assert set(re.findall(r"`([a-z_]+\.(?:png|gif))`", first_column)) == pictures


@pytest.mark.parametrize("target", ["demo", "test", "check", "bench", "clean"])
def test_the_makefile_has_the_promised_targets(target: str) -> None:
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
