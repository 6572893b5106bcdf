"""`polish-sim job`: setups x regions x passes from one file, planned, simulated, written; it resumes.

Its page has times, passes, what falls short in them, their notes, and each region's removal summed over its
passes.
"""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE, INTERRUPTED, SHORT, STOPPED
from polish_sim.cli.inspect import check_part
from polish_sim.cli.options import OUTPUT_OPTIONS, OWN, Given, Own, argument, build_scenario, takes
from polish_sim.cli.output_folder import RESULTS, occupied, refuse_taken, room_for, unused
from polish_sim.cli.plan import PartFile
from polish_sim.config import Scenario
from polish_sim.config.key import OUTPUT
from polish_sim.errors import InputError, PolishSimError, count_text
from polish_sim.page import Table, number_or_dash, save_page
from polish_sim.row_file import Metrics, put_file, write_json

if TYPE_CHECKING:
    from polish_sim.job.run_job import PassRow
    from polish_sim.page.page import Page

COPY = "job.toml"  #: Of the job's file, in its folder
LOCK = ".lock"
JobFile = Annotated[str, argument("JOB.toml", "A job's file.")]


#: What stands in a job's file for the options that planning names
KEYS = {
    "--units": "cell.part.unit",
    "--up": "up",
    "--part-pose": "pose",
    "--region": "regions",
    "--pad-diameter": "tool",
    "--stepover": "plan.stepover_m",
    "--contact-force": "process.contact_force_n",
    "--feed": "process.feed_m_s",
}


@contextmanager
def naming_keys() -> Iterator[None]:
    """Say behind the errors of the block which keys of a job stand for the options they name."""
    try:
        yield
    except PolishSimError as error:
        named = re.findall(r"--[a-z-]+", str(error))
        said = ", ".join(f"{key} for {option}" for option, key in KEYS.items() if option in named)
        raise type(error)(f"{error} In a job's file: {said}." if said else str(error)) from error


@takes(
    Own("--resume", OUTPUT, "", "Resume the job in --out where it was stopped or killed."),
    *("--check", *OUTPUT_OPTIONS),
)
@naming_keys()
def job(what: JobFile, given: Given) -> int:
    """Plan, simulate and write a job; `job init PART` writes a file to begin with, see `job init --help`."""
    from polish_sim.exchange import plan_facts
    from polish_sim.job.job_file import read_job
    from polish_sim.job.run_job import check_regions, job_figures, programs, run_job

    file = Path(what)
    asked = read_job(file)
    check_regions(asked)
    copy = file.read_bytes()
    folder = _folder(copy, given)
    # For the first pass, while those of another job are there.
    draft = folder / ".part-job"
    fresh = not folder.exists()
    if given["--resume"]:
        for plan in _passes(folder, "plan/path.json"):
            facts = plan_facts(plan, f"Delete '{plan.parents[1]}': --resume does that pass again.")
            again = "Do the job anew with --overwrite."
            check_part(plan, asked.passes[0].scenario.part.file, facts["part"], again)
        recorded = len(_passes(folder, "pieces/*/0*.npz"))
        console.note(
            f"note: resumed with {len(_passes(folder, 'run'))} of {len(asked.passes) * asked.head.parts} "
            f"passes done{f', and {recorded} s of the next one recorded' if recorded else ''}"
        )
    rows: list[PassRow] = []
    with occupied(folder, LOCK, "job"):
        try:
            with console.progress() as observer:
                if not (fresh or given["--resume"]):
                    shutil.rmtree(draft, ignore_errors=True)
                    draft.mkdir()
                    _replace(folder, draft, next(run_job(asked, draft, observer)).folder)
                put_file(folder, COPY, copy)
                rows.extend(run_job(asked, folder, observer))
        except KeyboardInterrupt:
            console.note(
                f"interrupted before the first new pass was there: what was in '{folder}' stays"
                if draft.exists()
                else "interrupted: what was recorded up to now is kept; "
                f"polish-sim job {shlex.quote(what)} --resume --out {shlex.quote(str(folder))} resumes it"
            )
            return INTERRUPTED
        except PolishSimError:
            if fresh and not rows:
                shutil.rmtree(folder)
            raise
        finally:
            shutil.rmtree(draft, ignore_errors=True)
            with suppress(PermissionError):  # on Windows, where it is open
                (folder / LOCK).unlink(missing_ok=True)
    figures = job_figures(asked, folder, rows)
    for number, text in programs(asked, folder):
        put_file(folder, f"setup_{number}.script", text)
    page = job_page(f"job {file.stem}: {asked.head.part}", figures)
    save_page(folder, page)
    write_json(folder / "job.json", figures)
    for text in page.notes:
        console.note(text if text.startswith(("bad: ", "protective stop: ")) else f"note: {text}")
    passes = [row[:SHOWN] for row in pass_rows(figures["passes"])]
    console.table(Table(page.title, PASS[:SHOWN], passes))
    console.say(
        f"robot {figures['cycle_time_s']:.1f} s (planned {figures['planned_cycle_time_s']:.1f}), operator "
        f"{figures['operator_s']:.0f} s, {page.about}"
    )
    console.say_folder(folder)
    if any(row.figures["protective_stop"] for row in rows):
        return STOPPED
    return SHORT if given["--check"] and any(row.figures["bad_figures"] for row in rows) else DONE


@takes(
    "--units",
    OWN["--out"]._replace(metavar="FILE.toml", text="File to write; default: the part's name, .toml."),
    OWN["--overwrite"]._replace(text="Replace the file."),
)
def init_job(part: PartFile, given: Given) -> int:
    """Write a job's file for a part, with comments, to begin with."""
    from polish_sim.job.job_file import begin_job

    file = given["--out"] or Path(f"{Path(part).stem}.toml")
    if file.exists() and not given["--overwrite"]:
        raise InputError(f"'{file}' exists. Choose another name with --out, or add --overwrite.")
    text = begin_job(build_scenario(Scenario(), {**given, "--part": part}).part, file)
    with room_for(file):
        put_file(file.parent, file.name, text)
    console.say(f"{file}: run it with polish-sim job {shlex.quote(str(file))}")
    return DONE


def _folder(copy: bytes, given: Given) -> Path:
    """The folder of a job's file, which may not be there yet.

    Raises:
        InputError: It exists, or holds another job.
    """
    out: Path | None = given["--out"]
    if given["--resume"]:
        if given["--overwrite"]:
            raise InputError("--resume keeps what is done, --overwrite does it anew: give one of them.")
        if out is None or not (out / COPY).is_file():
            held = f"'{out}' holds no {COPY}" if out else "there is no --out"
            raise InputError(f"{held}: name the folder of a job begun before, or leave --resume out.")
        if (out / COPY).read_bytes() != copy:
            raise InputError(
                f"'{out}' was begun with another job file: resume with '{out / COPY}', or do this one anew "
                "with --overwrite."
            )
        return out
    if out and (out / COPY).is_file() and not given["--overwrite"]:
        raise InputError(
            f"'{out}' holds a job already: resume it with --resume, or do it anew with --overwrite."
        )
    refuse_taken(given)
    return out or unused(RESULTS / "job")


def _replace(folder: Path, draft: Path, first: str) -> None:
    """Put the first pass of a job in the place of the passes of another one; other files stay.

    Killed halfway it leaves a folder that is no job's: the copy of the job's file goes first.
    """
    for name in (COPY, "job.json", "report.html", "setup_[0-9]*.script"):
        for file in folder.glob(name):
            file.unlink()
    for name in ("plan", "run", "pieces"):
        for old in _passes(folder, name):
            shutil.rmtree(old)
    (folder / first).mkdir(parents=True, exist_ok=True)
    for new in (draft / first).iterdir():
        new.rename(folder / first / new.name)
    shutil.rmtree(draft)


def _passes(folder: Path, name: str) -> list[Path]:
    """What the passes of a job have under a name."""
    one = f"setup_[0-9]*/region_[0-9]*/pass_[0-9]*/{name}"
    return [*folder.glob(one), *folder.glob(f"part_[0-9]*/{one}")]


PASS: Sequence[str] = (
    *("pass", "region, cm^2", "polished", "left out", "time, s", "removal std, %"),
    *("tool", "grit", "polished, cm^2/h", "planned, s", "contact, s"),
    *("abrasive path, m", "abrasive left, %", "stopped"),
)
SHOWN = 6  #: Of them on the screen
ONE = "Pictures and page of one: polish-sim report PASS/run. In 3D over time: polish-sim view PASS/run."


def pass_rows(passes: Sequence[Metrics]) -> list[list[str]]:
    """The passes of job.json as rows of `PASS`."""
    return [
        [
            p["folder"],
            f"{1e4 * p['region_area_m2']:.1f}",
            f"{1e4 * p['polished_area_m2']:.1f}",
            f"{1e4 * p['left_out_area_m2']:.1f}",
            f"{p['cycle_time_s']:.1f}",
            number_or_dash(p["removal_cv"], ".1f", 100.0),
            p["tool"],
            str(p["grit"] or "-"),
            "-" if p["protective_stop"] else f"{3.6e7 * p['polished_area_m2'] / p['cycle_time_s']:.0f}",
            f"{p['planned_cycle_time_s']:.1f}",
            f"{p['contact_time_s']:.1f}",
            f"{p['abrasive_path_m']:.0f}",
            f"{100.0 * p['abrasive_left']:.0f}",
            p["protective_stop"] or "",
        ]
        for p in passes
    ]


def job_page(title: str, figures: Metrics) -> Page:
    """The page of a job from what job.json says."""
    from polish_sim.page.page import Page

    f = figures
    stops = [
        f"protective stop: {p['folder']}: {p['protective_stop']}."
        for p in f["passes"]
        if p["protective_stop"]
    ]
    rate = f"{1e4 * f['polished_per_hour_m2']:.0f} cm^2 polished an hour of robot and operator"
    totals = [
        ["robot, planned", f"{f['planned_cycle_time_s']:.1f}"],
        ["robot, simulated", f"{f['cycle_time_s']:.1f}"],
        ["  in contact", f"{f['contact_time_s']:.1f}"],
        ["  air, landing, lifts", f"{f['air_time_s']:.1f}"],
        ["operator: clamping, turning, changing", f"{f['operator_s']:.1f}"],
        ["whole", f"{f['whole_s']:.1f}"],
    ]
    regions = [
        [
            r["region"],
            number_or_dash(r["exposure_mean_n_m"], ".4g"),
            number_or_dash(r["removal_cv"], ".1f", 100.0),
            number_or_dash(r["removal_cv_inside"], ".1f", 100.0),
        ]
        for r in f["regions"]
    ]
    sums = ["region, all passes", "pressure x way, N/m", "std / mean, %", "a pad's radius inside, %"]
    bad = [f"bad: {p['folder']}: {text}." for p in f["passes"] for text in p["bad_figures"]]
    notes = dict.fromkeys(text for p in f["passes"] for text in p["notes"])
    said = [f"{', '.join(p['folder'] for p in f['passes'] if text in p['notes'])}: {text}" for text in notes]
    return Page.of(
        title + ": with bad figures" * bool(bad),
        f"{'no rate, a pass was stopped' if stops else rate}, {count_text(f['parts'], 'part')}",
        [
            Table("Time", ["time", "s"], totals),
            Table("Passes", PASS, pass_rows(f["passes"]), caption=ONE),
            Table("Removal", sums, regions),
        ],
        [*stops, *bad, *said],
    )
