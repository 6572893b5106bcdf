"""`polish-sim serve`: the cell behind the ports of a UR controller, for programmes that drive a real one."""

from __future__ import annotations

import ipaddress
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE
from polish_sim.cli.options import CONFIG_OPTIONS, OUTPUT_OPTIONS, Given, Own, build_scenario, takes
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.config.key import RUN
from polish_sim.errors import InputError, count_text, unknown_name
from polish_sim.experiments.registry import experiment

if TYPE_CHECKING:
    from polish_sim.ur.controller import Controller

SPEEDS: Final = ("1", "max")
POLYSCOPES: Final = ("5.11", "5.23")
CLIENT: Final = "the client's programme"  #: What the figures call the controller
LOG: Final = "controller.log"  #: What the controller noted
ROW: Final = experiment("surface")


@takes(
    *("--part", "--real-part", "--part-pose", "--pad-diameter", "--contact-force", "--path", "--seed"),
    Own("--address", RUN, "ADDRESS", "Address to serve at; twice for two robots. Default 127.0.0.1.", list),
    Own("--speed", RUN, "1|max", "1: real time; max: as fast as a client that answers every packet. Default 1."),
    Own("--polyscope", RUN, "5.11|5.23", "Version the controller says it is. Default 5.11."),
    Own("--port-offset", RUN, "N", "Added to every port, for clients that can be told.", int, 0, 30000),
    Own("--for", RUN, "SECONDS", "End after this robot time; default: at Ctrl-C.", float, 0.0, 1e6),
    *CONFIG_OPTIONS,
    *OUTPUT_OPTIONS,
    defaults=ROW.defaults,
)
def serve(given: Given) -> int:
    """Serve a simulated UR with sensor, pad and part to programmes written for a real one; Ctrl-C ends it."""
    addresses = given["--address"] or ["127.0.0.1"]
    speed, version = given["--speed"] or SPEEDS[0], given["--polyscope"] or POLYSCOPES[0]
    for name, word, known in (("--speed", speed, SPEEDS), ("--polyscope", version, POLYSCOPES)):
        if word not in known:
            raise unknown_name(name, word, known)
    for address in addresses:
        if not _is_address(address):
            raise InputError(f"--address {address} is no IP address. Give one of this machine, e.g. 127.0.0.2.")
        if not ipaddress.ip_address(address).is_loopback:
            console.note(f"warning: whoever reaches {address} can drive the robot: there is no authentication.")
    if len(set(addresses)) < len(addresses):
        raise InputError("--address: each robot needs an address of its own, e.g. 127.0.0.1 and 127.0.0.2.")
    refuse_taken(given["--out"], given["--overwrite"])
    scenario = build_scenario(ROW.defaults, given)
    with claimed(given["--out"], "serve", given["--overwrite"]) as folder:
        _serve(scenario, given, addresses, speed, version, folder.draft)
    console.say_folder(folder.final)
    return DONE


def _is_address(text: str) -> bool:
    try:
        return ipaddress.ip_address(text).version == 4
    except ValueError:
        return False


def _serve(scenario: Any, given: Given, addresses: list[str], speed: str, version: str, draft: Path) -> None:
    from polish_sim.cell.observer import interrupts_noted
    from polish_sim.cli.run import checked, plan_to_run
    from polish_sim.experiments.assembly import build_cell, build_part
    from polish_sim.experiments.surface import prepare_surface
    from polish_sim.motion.makes import used_arm
    from polish_sim.ur.controller import Controller
    from polish_sim.ur.robot import SimulatedRobot
    from polish_sim.ur.script import Machine
    from polish_sim.ur.script.translate import translate
    from polish_sim.ur.server import Server

    translate("def ready():\n  sync()\nend\n")  # refuses here what it would refuse when a client waits
    path, scenario = checked(scenario, given)
    with console.progress() as observer, observer.compiling.ahead(scenario):
        plan, scenario = plan_to_run(scenario, path, observer, None)  # not proven: the law is the client's
        task = prepare_surface(scenario, plan, observer)
        observer.stage("prepare the cell")
        part = build_part(scenario, task.place)
        controllers = {}
        for address in addresses:
            robot = SimulatedRobot(build_cell(scenario, task.place, part))
            robot.step()  # compiles what it needs before a client waits
            controllers[address] = Controller(robot, version, Machine)
    server = Server(controllers, speed == SPEEDS[0], given["--port-offset"] or 0)
    started, end = time.perf_counter(), given["--for"]
    console.say(f"serving a {used_arm().label} (PolyScope {version}) at {', '.join(addresses)}; Ctrl-C ends it")
    try:
        with interrupts_noted() as interrupt:
            server.run(lambda: interrupt.seen or (end is not None and robot.ticks * 0.002 >= end))
    finally:
        server.close()
    pace = server.pace
    if pace.ticks:
        console.say(
            f"real time: {100.0 * (1.0 - pace.late / pace.ticks):.2f}% of {count_text(pace.ticks, 'cycle')} began "
            f"within 0.5 ms of when they were due, the latest {1e3 * pace.worst_s:.1f} ms late"
        )
    for address, controller in controllers.items():
        own = draft if len(addresses) == 1 else draft / address
        own.mkdir(exist_ok=True)
        (own / LOG).write_text("".join(f"{line}\n" for line in controller.log), encoding="utf-8")
        _write_run(scenario, task, part, controller, own, time.perf_counter() - started)


def _write_run(scenario: Any, task: Any, part: Any, controller: Controller, folder: Path, wall_s: float) -> None:
    """The usual log, figures and page of what was recorded, if anything was."""
    from polish_sim.analysis.run_record import RunRecord, package_versions, write_record
    from polish_sim.cli.run import draw_run
    from polish_sim.experiments.report import write_page
    from polish_sim.experiments.surface import measure_run
    from polish_sim.spatial import apply

    rig = controller.robot.rig
    if not rig.recorded:
        console.note("nothing was recorded: no programme ran.")
        return
    path = task.plan.path
    points = apply(task.reach.T_base_work, path.positions_work[path.process])
    run = rig.result(wall_s, points, path.s[path.process])
    if not (run.trace.phase == 2).any():
        console.note("the pad never touched the part: only log and page of the motion have something to show.")
    scenario = replace(scenario, controller=replace(scenario.controller, name=CLIENT))
    result = measure_run(scenario, task, controller.robot.cell, part, run)
    figures = {**result.figures, "versions": package_versions()}
    record = RunRecord(scenario.experiment, scenario, figures, result.log, result.path, result.removal)
    write_record(folder, record)
    draw_run(record, folder)
    write_page(folder, record, controller.robot.cell.model, task.plan.notes)
