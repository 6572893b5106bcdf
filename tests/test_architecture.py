"""The house stands: imports go down the layers, packages are shipped, the command line loads light."""

import ast
import importlib
import os
import re
import runpy
import subprocess
import sys
import token
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MODULES_AT_LEAST = 50
BANNED = (
    r"so many|hangs? on|broken[- ]off|lets? go|whatever it takes|gives way|nobody was told|told apart|"
    r"cannot tell|never hear|is told|are told|taken for none|that is none|hears|tells|be told|untold|"
    r"told (?:to|from|those)|comes? of|came of|goes on|go on|gone on|went on|(?-i:Of (?:what|which))"
)
MOST_TOKENS = 476_835
"""Names, operators and literals of src and cli, without comments, docstrings and layout: a ceiling to be
lowered.

Tokens, not lines: packing a line saves none.
"""

MOST_WHOLE = 133
"""Parameters and fields that are a whole scenario instead of the sections used: a ceiling to be lowered."""


def test_import_contracts_hold_and_cover_every_module_and_an_import_against_them_is_noticed(tmp_path):
    tree = tmp_path  # with the package in one folder, as installed
    runpy.run_path(str(ROOT / ".ci" / "assemble.py"))["assemble"](tree)
    run = _lint_imports(tree)
    assert run.returncode == 0, run.stdout + run.stderr
    assert re.search(r"[2-9] kept, 0 broken", run.stdout)
    program = "import grimp; print(len(grimp.build_graph('polish_sim', cache_dir=None).modules))"
    run = _run(sys.executable, "-c", program, PYTHONPATH=str(tree))
    names = [name for *_, names in os.walk(tree, followlinks=True) for name in names if name.endswith(".py")]
    assert int(run.stdout) == len(names) >= MODULES_AT_LEAST
    planted = tree / "polish_sim" / "errors.py"
    planted.unlink()
    planted.write_text("import polish_sim.cli.main\n", encoding="utf-8")
    run = _lint_imports(tree)
    assert run.returncode == 1
    assert "polish_sim.errors -> polish_sim.cli.main" in run.stdout


def test_every_package_is_listed_a_public_name_is_of_one_file_and_few_functions_take_a_whole_scenario():
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    mapping = setuptools["package-dir"]
    found = {
        ".".join((package, *init.parent.relative_to(ROOT / folder).parts))
        for package, folder in mapping.items()
        for init in (ROOT / folder).rglob("__init__.py")
    }
    assert found == set(setuptools["packages"])
    places: dict[str, set[str]] = {}
    whole = 0
    for file in (*ROOT.glob("src/**/*.py"), *ROOT.glob("cli/**/*.py")):
        text = file.read_text(encoding="utf-8")
        whole += len(re.findall(r"\w: (?:Scenario|Checked)\b", text))
        for node in ast.parse(text).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, set()).add(str(file.relative_to(ROOT)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}
    assert whole <= MOST_WHOLE


def test_the_command_line_starts_and_reads_its_options_without_the_heavy_libraries():
    heavy = "mujoco, numba, scipy, trimesh, matplotlib"
    program = (
        "import sys, polish_sim.cli.main, polish_sim.cli.options as options\n"
        "options.with_options(options.Scenario('force'), {})\n"
        f"print(*(set('{heavy}'.split(', ')) & set(sys.modules)))"
    )
    run = _run(sys.executable, "-c", program)
    assert (run.returncode, run.stdout.strip()) == (0, "")


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="from 3.12 on parts of f-strings are tokens as well")
def test_the_house_keeps_its_size(capsys):
    rooms: dict[str, int] = {}
    for folder in ("src/polish_sim", "cli"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            parts = file.relative_to(ROOT / folder).parts
            room = "cli" if folder == "cli" else parts[0] if len(parts) > 1 else "polish_sim"
            rooms[room] = rooms.get(room, 0) + _tokens(file.read_text(encoding="utf-8"))
    with capsys.disabled():
        table = "".join(f"\n  {room:16}{size:7}" for room, size in rooms.items())
        print(f"\ntokens of src and cli: {sum(rooms.values())}{table}")
    assert sum(rooms.values()) <= MOST_TOKENS


def test_texts_use_none_of_the_banned_phrases():
    """They are riddles or read as translated; CONTRIBUTING.md says how to write."""
    files = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    for folder in ("src", "cli", "docs", "tests", "models", "examples", "benchmarks"):
        files += [file for ending in ("*.py", "*.md") for file in (ROOT / folder).rglob(ending)]
    phrases, found = re.compile(rf"\b({BANNED})\b", re.IGNORECASE), []
    for file in files:
        if file != Path(__file__).resolve() and "tutorials" not in file.parts:
            text = re.sub(r"[\s#:]+", " ", file.read_text(encoding="utf-8"))  # also across lines of a comment
            found += [(file, text[max(0, m.start() - 30) : m.end()]) for m in phrases.finditer(text)]
    assert not found


def _tokens(text):
    """Names, operators and literals outside docstrings, by the parser's own tokenizer: it is quick."""
    quiet, layout = set[int](), {token.NEWLINE, token.INDENT, token.DEDENT, token.ENDMARKER}
    for node in ast.walk(ast.parse(text)):
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        if documented and ast.get_docstring(node, clean=False):
            quiet.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    tokens = importlib.import_module("_tokenize").TokenizerIter(text)
    return sum(kind not in layout and line not in quiet for _, kind, line, *_ in tokens)


def _lint_imports(tree):
    return _run(str(Path(sys.executable).with_name("lint-imports")), "--no-cache", PYTHONPATH=str(tree))


def _run(*command, **more):
    return subprocess.run(
        command, cwd=ROOT, env=os.environ | more, capture_output=True, text=True, check=False
    )
