"""Job and tool files broken in one place each, given to `polish-sim job`: each is refused with one error and
its line.

    python -m benchmarks.mutated_jobs [--count 200] [--seed 500]

Counts the files refused, those whose error names no line, those whose line is not the one broken (the key may
be said elsewhere too, or be missed only further on), and those that left a file behind. A file that is broken
and still a job is drawn again.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import random
import re
from pathlib import Path
from tempfile import TemporaryDirectory

from polish_sim.cli.boundary import execute
from polish_sim.cli.main import commands
from polish_sim.errors import PolishSimError
from polish_sim.job.job_file import read_job
from polish_sim.job.run_job import check_regions

JOB = """part = "plate"
tools = "tools.toml"
parts = 2
seed = 3
[cell]
robot.arm = "ur5e"
safety.proof = "none"

[[setup]]
name = "as it stands"
up = "z"
clamp_s = 60.0
regions = ["box:0,0,-10,60,60,100", "faces:faces.txt"]

[[setup.pass]]
tool = "mine"
grit = 120
plan.pattern = "raster"
plan.raster_direction = [1.0, 0.0, 0.0]
process.contact_force_n = 20.0
process.feed_m_s = 0.01

[[setup.pass.zone]]
region = "polygon:0,0,0;40,0,0;40,40,0"
force = 0.5
feed = 1.5

[[setup]]
up = "-z"
[[setup.pass]]
tool = "sander"
grit = 240
edge_force = 0.7
edge_m = 0.01
plan.stepover_m = 0.02
process.contact_force_n = 15.0
"""
TOOLS = """[mine]
kind = "spindle"
radius_m = 0.02
stiffness_n_m = 15000.0
speed_rpm = 5000.0

[sander]
kind = "orbital"
speed_rpm = 9000.0
orbit_m = 0.002
force_most_n = 40.0
wear_nm = 1000.0
"""
FILES = {"job.toml": JOB, "tools.toml": TOOLS, "faces.txt": "0\n1\n"}
VALUES = (
    "nan",
    "-1",
    "0",
    "1e99",
    "true",
    '"x"',
    '""',
    "[]",
    "[1, 2]",
    "{}",
    "9" * 400,
    "1.5",
    '"box:1,2"',
    '"faces:missing.txt"',
    '"point:9e9,0,0"',
    '"polygon:0,0,0"',
    '["box:1,2"]',
    '["under:x:0.5"]',
    '"missing.stl"',
    "=",
)

WRONG = ("-5", "7e7", '"laser"', "[[1]]")


def main() -> None:
    """Print the counts, and what was found wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=500)
    asked = parser.parse_args()
    rng = random.Random(asked.seed)
    refused = drawn = without = elsewhere = behind = 0
    while refused < asked.count:
        drawn += 1
        with TemporaryDirectory() as name:
            folder = Path(name)
            for file, text in FILES.items():
                (folder / file).write_text(text)
            broken, line, what = break_file(folder, rng)
            code, said = refusal(folder)
            if not code:
                continue
            refused += 1
            errors = [row for row in said.splitlines() if row.startswith("error: ")]
            found = re.search(rf"{broken}'?(?:, | .*\(at )line (\d+)", said)
            if code != 2 or len(errors) != 1 or "Traceback" in said or not re.search(r"line \d+", said):
                without += 1
                print(f"NO LINE: {what}: {said.strip()[:300]}", flush=True)
            elif found is None or int(found[1]) != line:
                elsewhere += 1
                print(f"{broken}, line {line}, {what}: {said.strip().replace(name, '')[:200]}", flush=True)
            left = {path.name for path in folder.iterdir()} - FILES.keys()
            behind += bool(left)
    print(
        f"{refused} of {drawn} refused; {without} without one error and its line, {elsewhere} with another "
        f"line, {behind} left something behind"
    )


def break_file(folder: Path, rng: random.Random) -> tuple[str, int, str]:
    """Break one line of the job's or the tools' file: its name, the line, and what was done."""
    file = rng.choice(["job.toml", "job.toml", "tools.toml"])
    lines = FILES[file].splitlines()
    at = rng.choice([number for number, line in enumerate(lines) if line.strip()])
    key, equals, value = lines[at].partition(" = ")
    way = rng.randrange(5)
    if way == 0 and equals:
        lines[at] = f"{key} = {rng.choice(VALUES)}"
    elif way == 1 and equals:
        spot = rng.randrange(len(key))
        lines[at] = f"{key[:spot]}{rng.choice('xqz')}{key[spot + 1 :]} = {value}"
    elif way == 2:
        spot = rng.randrange(len(lines[at]))
        lines[at] = (
            lines[at][:spot] + rng.choice(["[", '"', "=", "\x01", "é", "#", "]]"]) + lines[at][spot + 1 :]
        )
    elif way == 3:
        lines.insert(at, lines[at])
    else:
        lines[at] = f"{key} = {rng.choice(WRONG)}" if equals else lines[at][1:]
    (folder / file).write_text("\n".join(lines) + "\n")
    return file, at + 1, lines[at]


def refusal(folder: Path) -> tuple[int, str]:
    """Exit code and words of the command; 0 where the file is a job, which is then not run."""
    try:
        check_regions(read_job(folder / "job.toml"))
        return 0, ""
    except PolishSimError:
        pass
    words = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(words):
        code = execute(commands, ["job", str(folder / "job.toml"), "--out", str(folder / "out")])
    return code, words.getvalue()


if __name__ == "__main__":
    main()
