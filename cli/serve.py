"""`polish-sim serve`: the cell behind the ports of a UR controller, for programmes that drive a real one."""

from __future__ import annotations

import gc
import ipaddress
import math
import multiprocessing.connection
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polish_sim.cli import console
from polish_sim.cli.boundary import BUG, DONE, exit_code
from polish_sim.cli.options import CONFIG_OPTIONS, OUTPUT_OPTIONS, Given, Own, build_scenario, takes
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.cli.run import checked_run, draw_run, plan_to_run
from polish_sim.cli.view import Address, live_address
from polish_sim.config.key import RUN
from polish_sim.errors import InputError, check_name, count_text, first_twice, leave_out
from polish_sim.experiments.registry import check_flange, experiment
from polish_sim.page import save_page
from polish_sim.row_file import put_file, write_json
from polish_sim.workers import end_with_starter

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from multiprocessing.process import BaseProcess

    from polish_sim.cell import Cell
    from polish_sim.cell.cell import CellRun
    from polish_sim.experiments.assembly import Workplace
    from polish_sim.experiments.result import RunResult
    from polish_sim.scoring import Task
    from polish_sim.ur.controller import RobotController

SPEEDS = ("1", "max")
POLYSCOPES = ("5.11", "5.23", "5.26")
CLIENT = "the client's programme"  #: What the figures call the controller
LOG = "controller.log"  #: What the controller noted
SCORE = "score.json"
READY = "def ready():\n  sync()\nend\n"  #: A programme to begin with
SWITCH_S = 5e-4  #: The clock waits so long for a thread that reads a programme, or draws [s]
LIVE_S = 0.04  #: Between two moments drawn of it: the clock shares a processor with what draws [s]
ROW = experiment("surface")
CELL = (
    "--part",
    "--real-part",
    "--part-pose",
    "--pad-diameter",
    "--contact-force",
    "--path",
    *CONFIG_OPTIONS,
)


@takes(
    *CELL,
    "--seed",
    Own("--score", RUN, "CASE", "Serve the cell of a case of 'score', and score what the client does in it."),
    Own("--air", RUN, "", "Without part, table and stand: for programmes written for an arm alone."),
    Own("--address", RUN, "ADDRESS", "Address to serve at; twice for two robots. Default 127.0.0.1.", list),
    Own(
        "--speed",
        RUN,
        "1|max",
        "1: real time; max: as fast as a client that answers every packet. Default 1.",
    ),
    Own("--polyscope", RUN, "5.11|5.23|5.26", "Version the controller says it is. Default 5.11."),
    Own("--for", RUN, "SECONDS", "End after this robot time; default: at Ctrl-C.", float, 0.01, 1e6),
    *("--live", "--live-port", "--live-host"),
    *OUTPUT_OPTIONS,
    defaults=ROW.defaults,
)
def serve(given: Given) -> int:
    """Serve a simulated UR with sensor, pad and part to programmes written for a real one; Ctrl-C ends it."""
    addresses = given["--address"] or ["127.0.0.1"]
    for name, known in (("--speed", SPEEDS), ("--polyscope", POLYSCOPES)):
        if given[name]:
            check_name(name, given[name], known)
    for address in addresses:
        try:
            near = ipaddress.IPv4Address(address).is_loopback
        except ValueError as error:
            raise InputError(
                f"--address {address} is no IP address. Give one of this machine, e.g. 127.0.0.2."
            ) from error
        if not near:
            console.note(
                f"warning: whoever reaches {address} can drive the robot: there is no authentication."
            )
    if first_twice(addresses):
        raise InputError("--address: each robot needs an address of its own, e.g. 127.0.0.1 and 127.0.0.2.")
    if given["--live-port"] and addresses[1:]:
        raise InputError("--live-port is for one robot: leave it out, each one's page finds a port.")
    live_address(given)
    _case(given)
    refuse_taken(given)
    from polish_sim.ur.server import PORTS, listening

    for address in addresses:
        for port in PORTS:  # before all is prepared
            listening(address, port).close()
    with claimed(given, "serve") as folder:
        folders = [folder.draft / address for address in addresses] if addresses[1:] else [folder.draft]
        code = _robot(given, addresses, folders)
    console.say_folder(folder.final)
    return code


def _robot(given: Given, addresses: Sequence[str], folders: Sequence[Path]) -> int:
    """Serve a robot at the first address, each of the others in a process of its own, and write what is left
    of them."""
    from polish_sim.cell.observer import results_kept

    code = DONE
    real_time = given["--speed"] != SPEEDS[1]
    beside = [
        multiprocessing.get_context("spawn").Process(target=_beside, args=(given, *own), name=own[0])
        for own in list(zip(addresses, folders, strict=True))[1:]
    ]
    with ExitStack() as started, results_kept():
        for process in beside:
            process.start()
            started.callback(process.kill)  # one that has ended stays as it is
        with ExitStack() as open_:
            with console.progress() as observer:
                job = _prepared(given, _case(given), observer)
                reader = open_.enter_context(_reader()) if real_time else None
                controller = _controller(job, given, reader, observer)
            if _serve(job, given, addresses[0], controller, real_time, beside):
                for process in beside:
                    process.terminate()
        folders[0].mkdir(exist_ok=True)
        put_file(folders[0], LOG, "".join(f"{line}\n" for line in controller.log))
        _write_run(job, controller, folders[0])
        for process in beside:
            process.join()
            if process.exitcode not in (DONE, -signal.SIGTERM):
                code = max(process.exitcode or DONE, DONE) or BUG
                console.note(
                    f"warning: the robot at {process.name} ended with {code}: its folder is not whole."
                )
    return code


def _beside(given: Given, address: str, folder: Path) -> None:
    """Another robot, in a process of its own."""
    end_with_starter()
    console.note(f"the robot at {address}:")
    sys.exit(exit_code(lambda: _robot(given, [address], [folder])))


# What is served.


@dataclass
class _Job:
    """A cell to serve, and how a run of it is measured."""

    scenario: Any
    place: Workplace
    measure: Callable[[Cell, CellRun], RunResult]
    notes: Any = ()
    task: Task | None = None  #: Of the score
    most_s: float = math.inf  #: What is scored is over after this long [s]
    wall_s: float = 0.0  #: Time served [s]


def _case(given: Given) -> Task | None:
    """The row of the score that is asked for, if one is."""
    if given["--score"] is None:
        return None
    if beside := [name for name in CELL if given[name] is not None]:
        raise InputError(leave_out(beside, "would change the case of --score"))
    from polish_sim.scoring import BATTERY, Entry, Task, choose_cases

    cases = choose_cases(BATTERY, [given["--score"]])
    if len(cases) > 1:
        raise InputError(f"--score {given['--score']}: one case at a time, e.g. {cases[0].name}.")
    return Task(cases[0], Entry(CLIENT, ROW.defaults.controller.name), given["--seed"] or 0)


def _prepared(given: Given, task: Task | None, observer: Any) -> _Job:
    from polish_sim.experiments.assembly import check
    from polish_sim.experiments.surface import measure_hold, measure_run, place_force, prepare_surface

    if task and not task.case.moving:
        scenario = check(task.scenario)
        place = place_force(scenario, observer)
        return _Job(
            scenario,
            place,
            lambda *ran: measure_hold(place, *ran),
            task=task,
            most_s=scenario.process.hold_s,
        )
    path, scenario = checked_run(task.scenario if task else build_scenario(ROW.defaults, given), given)
    check_flange(scenario, "serve")
    if scenario.robot.compensation != "none":
        raise InputError("robot.compensation is of a host inside: leave it out of 'serve'.")
    with observer.compiling.ahead(scenario):
        plan, scenario = plan_to_run(scenario, path, observer, None)  # not proven: the law is the client's
    assert plan  # ``surface`` plans one
    place = prepare_surface(scenario, plan, observer)
    most_s = (task and scenario.process.max_feed_s) or math.inf
    return _Job(
        scenario,
        place,
        lambda *ran: measure_run(plan, place, *ran),
        plan.notes,
        task,
        most_s,
    )


def _reader() -> Executor:
    """A process that reads programmes: the clock of the robot runs meanwhile."""
    from concurrent.futures import ProcessPoolExecutor

    from polish_sim.ur.script.translate import read, translate

    translate(READY)  # refuses here what it would refuse when a client waits
    context = multiprocessing.get_context("spawn")
    reader = ProcessPoolExecutor(1, context, end_with_starter)
    reader.submit(read, READY).result()  # started before a client waits
    return reader


def _controller(job: _Job, given: Given, reader: Executor | None, observer: Any) -> RobotController:
    from polish_sim.experiments.assembly import build_cell
    from polish_sim.ur.controller import RobotController
    from polish_sim.ur.physics import clear_away
    from polish_sim.ur.robot import SimulatedRobot

    observer.stage("prepare the cell")
    cell = build_cell(job.scenario, job.place)
    if given["--air"]:
        clear_away(cell)
    robot = SimulatedRobot(cell)
    robot.step()  # compiles what it needs before a client waits
    return RobotController(robot, given["--polyscope"] or POLYSCOPES[0], reader)


# Serving.


def _serve(
    job: _Job,
    given: Given,
    address: str,
    controller: RobotController,
    real_time: bool,
    beside: Sequence[BaseProcess],
) -> bool:
    """Serve until interrupted, one of the others has ended or the time is over; whether it was not the
    time."""
    from polish_sim.cell.observer import interrupts_noted
    from polish_sim.motion.kinematics import used_arm
    from polish_sim.ur.physics import TICK_S
    from polish_sim.ur.server import Server

    robot = controller.robot
    asked = threading.Event()
    server = Server(controller, address, real_time)
    signal.signal(signal.SIGTERM, lambda *_: asked.set())  # in the background Ctrl-C does not reach it
    started = time.perf_counter()
    most = (given["--for"] or math.inf) / TICK_S
    sys.setswitchinterval(SWITCH_S)
    gc.freeze()  # what is here stays: collecting looks at what comes later only

    def interrupted() -> bool:
        return interrupt.seen or asked.is_set() or not all(process.is_alive() for process in beside)

    try:
        with (
            before_others() if real_time else nullcontext(),
            _watched(live_address(given), robot.cell),
            interrupts_noted() as interrupt,
        ):
            console.say(
                f"serving a {used_arm().label} (PolyScope {'.'.join(map(str, controller.version[:2]))}) at "
                f"{address}; Ctrl-C ends it"
            )
            server.run(lambda: interrupted() or robot.ticks >= most)
    finally:
        server.close()
    job.wall_s = time.perf_counter() - started
    if (pace := server.pace).ticks:
        console.say(
            f"{address}, real time: of {count_text(pace.ticks, 'cycle')} "
            f"{100.0 * (1.0 - pace.late / pace.ticks):.3f}% within 2.5 ms of when they were due, the latest "
            f"{1e3 * pace.worst_s:.1f} ms late"
        )
    return interrupted()


@contextmanager
def before_others() -> Iterator[None]:
    """Where the system allows it, this thread runs before all that do not ask for the same."""
    if not hasattr(os, "sched_setscheduler"):  # Windows, macOS
        yield
        return
    usual = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(1))
    try:
        yield
    finally:
        os.sched_setscheduler(0, *usual)


@contextmanager
def _watched(live: Address | None, cell: Cell) -> Iterator[None]:
    """A page of the cell while it is served, drawn by a thread of its own."""
    if live is None:
        yield
        return
    from polish_sim.cell.observer import STOPPING
    from polish_sim.cli.live_view import LiveView

    ended = threading.Event()
    with LiveView(live, "serve", steered=False) as view:

        def draw() -> None:
            view.start(cell)
            while not ended.wait(LIVE_S):
                view.frame(cell.model, cell.data)

        thread = threading.Thread(target=draw)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            view.stage(STOPPING)
            thread.join()


# What is left of it.


def _write_run(job: _Job, controller: RobotController, folder: Path) -> None:
    """The usual log, figures and page of what was recorded, if anything was, and its row of the score."""
    from polish_sim.analysis.run_record import write_record
    from polish_sim.experiments.report import page_of
    from polish_sim.spatial import apply

    rig = controller.robot.rig
    path = job.place.path
    if not rig.recorded:
        console.note("nothing was recorded: no programme ran.")
        return
    points = apply(job.place.reach.T_base_work, path.in_contact.positions)
    run = rig.result(job.wall_s, points, path.s[path.process], job.most_s)
    if not run.trace.fed.any():
        console.note(
            "no contact at 80% of the set force: only log and page of the motion have something to show."
        )
    scenario = replace(job.scenario, controller=replace(job.scenario.controller, name=CLIENT))
    result = replace(job.measure(controller.robot.cell, run), scenario=scenario)
    record = result.record
    write_record(folder, record)
    draw_run(record, folder)
    save_page(folder, page_of(record, controller.robot.cell.model, job.notes))
    if job.task:
        _score(job.task, job.place, run, folder)


def _score(task: Task, place: Workplace, run: CellRun, folder: Path) -> None:
    from polish_sim.scoring import Score, measured, overview, summarize

    row = measured(task, place, run)
    write_json(folder / SCORE, {"rows": [row]})
    summaries = summarize(Score((task.case,), (task.entry,), range(1), (row,), 1))
    console.table(overview(summaries, False)._replace(title=f"{CLIENT} [s, N], seed {task.seed}"))
