"""Keep linear algebra to one thread, and let Ctrl-C be Ctrl-C wherever the tests run."""

import gc
import os
import signal
from pathlib import Path

import pytest

# Before anything imports numpy: on matrices this small, threads of the linear algebra only wait for
# each other, fifty times as long as the work takes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell starts background jobs with SIGINT ignored; so would be what the tests start, to test Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup ignores it

# What compiles longest comes first. The loops and the laws have most of their parts in common: they go to one
# process, so that each part is inferred once; another compiles the planner meanwhile.
LOOPS = (
    "cell/test_statics.py", "cell/test_scene.py", "cell/test_sequence.py", "cell/test_real_arm.py",
    "cell/test_contact.py", "cell/test_wrist_sensor.py", "control/adaptive/test_adaptive_laws.py",
    "control/adaptive/test_path_laws.py", "dual/test_pair.py", "envs/test_envs.py",
    "hand_guiding/test_law.py", "cli/test_run.py", "identification/test_gear_fit.py",
)  # fmt: skip
FIRST = (
    *LOOPS, "planning/test_plans.py", "ur/test_wire.py", "planning/test_tool_room.py",
    "planning/test_inspection.py", "ur/test_robot.py", "test_readme.py", "test_workers.py",
)  # fmt: skip


def keep_parts() -> None:
    """Keep the machine code of parts of kernels that tests call; others compile them within kernels only."""
    from polish_sim import kernel_cache

    kernel_cache._Part = type("_KeptPart", (kernel_cache._Kept, kernel_cache._Part), {})


def pytest_configure(config: pytest.Config) -> None:
    """Share what is made once where tests run; the process that hands them out needs none of it."""
    if not config.getoption("numprocesses", None):
        keep_parts()
        from tests.kept import share_commands, share_fields, share_parts, share_scenes

        share_fields()
        share_parts()
        share_commands()
        share_scenes()


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Folders are shared out to all processors; a file somebody names runs here, for a debugger."""
    whole = all(Path(argument).is_dir() for argument in config.args)
    return None if whole else 0


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """A file goes to one process, and so do the loops together."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return "loops" if file.endswith(LOOPS) else file

    return Scheduling(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    def rank(item: pytest.Item) -> int:
        place = item.path.as_posix()
        return next((k for k, name in enumerate(FIRST) if place.endswith(name)), len(FIRST))

    items.sort(key=rank)


def pytest_collection_finish() -> None:
    gc.freeze()  # modules and tests stay: collecting looks at what tests make
    gc.set_threshold(20_000, 20, 20)  # and not whenever a few hundred objects more than before are there
