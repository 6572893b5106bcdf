"""Run every code block of the site's pages: ``python docs/run_blocks.py [PAGE...]``; ``make docs`` does.

Blocks marked ``bash`` and ``python`` run as they stand, page by page, in an empty folder of the page's own;
those of a page follow one another and share that folder. A line ``<!-- file: NAME -->`` above a block writes
it to a file instead. So that all of it takes minutes, ``polish-sim`` on these pages gets less to do by
`SHORT`: a shorter feed, fewer seeds. Blocks marked ``text`` are pictures, ``math`` equations; there is no
other kind.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
MIRRORED = [ROOT / "results" / "README.md", ROOT / "models" / "README.md", ROOT / "CHANGELOG.md"]
KINDS = ("bash", "python", "toml", "text", "math", "{toctree}", "{eval-rst}")
PAGE_SECONDS = 1800.0  #: When the blocks of a page are given up, on however busy a machine

FEED = ("--set", "process.max_feed_s=0.5")
SHORT: dict[str, tuple[str, ...]] = {
    "run surface": FEED,
    "run dual": FEED,
    "run teach": ("--set", "hand.off_s=0.5"),
    "identify": ("--periods", "1"),
    "score": ("--case", "approach-20"),
    "tune": ("--case", "approach-20", "--seeds", "1", "--held-out-seeds", "1"),
    "calibrate budget": ("--draws", "30"),
    "calibrate arm": ("--poses", "20"),
}
"""What a command gets in addition, unless it says so itself or one of `COMPLETE` is there."""
COMPLETE = ("--data", "--payload-data", "--list", "--report", "--help", "--dry-run", "--follow", "--mode")
FEWER = {"--seeds": "1", "--draws": "30", "--count": "2", "--trials": "2"}  #: Instead of what is said
SCORE_SEEDS = ("--seeds", "1")


class Block(NamedTuple):
    """A fenced block of a page."""

    page: Path
    line: int
    kind: str
    file: str  #: What it is written to; empty if it is run
    text: str


def blocks(page: Path) -> Iterator[Block]:
    """The fenced blocks of a page, in order."""
    lines = page.read_text(encoding="utf-8").splitlines()
    k = 0
    while k < len(lines):
        begin = re.fullmatch(r"(`{3,})(.*)", lines[k])
        if begin:
            end = lines.index(begin[1], k + 1)
            named = re.fullmatch(r"<!-- file: (\S+) -->", lines[k - 1]) if k else None
            yield Block(
                page, k + 1, begin[2], named[1] if named else "", "\n".join(lines[k + 1 : end]) + "\n"
            )
            k = end
        k += 1


def shortened(words: list[str]) -> list[str]:
    """A command with less to do; the same words where nothing had to be changed."""
    short = list(words)
    for k, word in enumerate(short[:-1]):
        if word in FEWER:
            short[k + 1] = FEWER[word]
    for name, less in SHORT.items():
        asked = words[: len(name.split())] == name.split()
        if asked and not set(words) & {*COMPLETE, less[0]} - {"--set"}:
            short += less
    if "--reach" in words and "--case" not in words:
        short[short.index("--case") + 1] = "reach-step"
    while words[0] == "score" and short.count("--case") > 1:
        last = len(short) - 1 - short[::-1].index("--case")
        del short[last : last + 2]
    if words[0] == "score" and not set(words) & {"--seeds", "--list"}:
        short += SCORE_SEEDS
    if short != words and "--check" in short:
        short.remove("--check")  # what is asked is asked of the whole
    return short


def stand_in(folder: Path) -> Path:
    """Write the ``polish-sim`` that the blocks find on the path: this file, which notes what it runs."""
    own = folder / "bin"
    own.mkdir()
    command = own / "polish-sim"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{DOCS / "run_blocks.py"}" --command "$@"\n')
    command.chmod(0o755)
    (own / "python").symlink_to(sys.executable)
    return own


def run_command(words: list[str]) -> int:
    """Run the real command, shorter, and note how long it took."""
    short = shortened(words)
    started = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", "from polish_sim.cli import start; start()", *short], check=False
    )
    with Path(os.environ["DOCS_COMMANDS"]).open("a", encoding="utf-8") as notes:
        notes.write(
            f"{time.monotonic() - started:.1f}\t{int(short != words)}\t{done.returncode}\t{' '.join(short)}\n"
        )
    return done.returncode


class Ran(NamedTuple):
    """What became of a page's blocks."""

    page: Path
    count: int
    commands: list[list[str]]
    seconds: float
    error: str


def run_page(page: Path, scratch: Path) -> Ran:
    """Run a page's blocks in a folder of their own; stops at the first that fails."""
    found = list(blocks(page))
    for block in found:
        if block.kind not in KINDS:
            return Ran(
                page, 0, [], 0.0, f"{page.name}:{block.line}: a block of kind '{block.kind}'; known: {KINDS}"
            )
    todo = [block for block in found if block.kind in ("bash", "python") or block.file]
    folder = scratch / f"{page.parent.name}-{page.stem}"
    folder.mkdir()
    notes = scratch / f"{folder.name}.commands"
    notes.touch()
    prepare(page, folder)
    environment = os.environ | {
        "PATH": f"{scratch / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "DOCS_COMMANDS": str(notes),
        "MPLBACKEND": "agg",
        "OPENBLAS_NUM_THREADS": "1",  # two pages run at a time
    }
    started, error = time.monotonic(), ""
    for block in todo:
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")
            continue
        call = ["bash", "-e"] if block.kind == "bash" else [sys.executable, "-"]
        left = PAGE_SECONDS - (time.monotonic() - started)
        try:
            done = subprocess.run(
                call,
                input=block.text,
                env=environment,
                cwd=folder,
                capture_output=True,
                text=True,
                timeout=left,
            )
            failed = (
                f"exit code {done.returncode}\n{done.stdout[-1500:]}{done.stderr[-3000:]}"
                if done.returncode
                else ""
            )
        except subprocess.TimeoutExpired:
            failed = f"the page takes more than {PAGE_SECONDS:g} s"
        if failed:
            error = f"{page.relative_to(ROOT)}:{block.line}: {failed}"
            break
    commands = [line.split("\t") for line in notes.read_text(encoding="utf-8").splitlines()]
    return Ran(page, len(todo), commands, time.monotonic() - started, error)


def prepare(page: Path, folder: Path) -> None:
    """Put there what a page calls the user's own: a part, logs of a robot."""
    shutil.copy(ROOT / "models" / "workpieces" / "freeform.stl", folder / "PART.stl")
    text = page.read_text(encoding="utf-8")
    if "mine.py:" in text:
        own = next(block for block in blocks(DOCS / "controllers.md") if block.file == "mine.py")
        (folder / own.file).write_text(own.text, encoding="utf-8")
    if "LOG.csv" in text:
        sys.path.insert(0, str(ROOT))
        from polish_sim.motion.serial_chain import link_parameters
        from tests.identification.known import SIGMA, known_robot, played, write_log

        known = known_robot()
        loaded = known.model.truth()
        center = [0.02, -0.01, 0.08] - known.model.chain.origins[-1]
        loaded[50:60] += link_parameters(1.5, center, [[0.0] * 3] * 3)
        write_log(folder / "LOG.csv", known.model, played(known.motion, 1), SIGMA)
        write_log(folder / "LOADED.csv", known.model, played(known.motion, 1), SIGMA, loaded, seed=1)


def main(names: list[str]) -> int:
    """Run the pages named, or all, two at a time; print a line for each; 1 if a block failed."""
    if names[:1] == ["--command"]:
        return run_command(names[1:])
    pages = [Path(name).resolve() for name in names] or [*sorted(DOCS.glob("*.md")), *MIRRORED]
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        scratch = Path(folder)
        stand_in(scratch)
        ran = []
        for one in pool.map(lambda page: run_page(page, scratch), pages):
            ran.append(one)
            if one.count or one.error:
                name = one.page.relative_to(ROOT)
                print(
                    f"{name}: {one.count} blocks, {len(one.commands)} commands, {one.seconds:.0f} s",
                    flush=True,
                )
            if os.environ.get("DOCS_TIMES"):
                print(*("    " + "  ".join(row) for row in one.commands), sep="\n", flush=True)
            if one.error:
                print(one.error, file=sys.stderr, flush=True)
    commands = [row for one in ran for row in one.commands]
    shorter, failed = sum(row[1] == "1" for row in commands), sum(bool(one.error) for one in ran)
    print(
        f"{sum(one.count for one in ran)} blocks with {len(commands)} commands ran, {shorter} of these "
        "shortened, ",
        end="",
    )
    used = os.times()
    cpu = used.children_user + used.children_system
    print(f"in {time.monotonic() - started:.0f} s, {cpu:.0f} s of processor time; {failed} pages failed")
    return int(any(one.error for one in ran))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
