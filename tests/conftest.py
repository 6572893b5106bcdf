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

# What compiles longest comes first. Files are handed out in turn: the loops, which have most of their parts
# in common, go to one process, so that each part is inferred once; the other compiles the planner meanwhile.
FIRST = (
    "cell/test_statics.py",
    "planning/test_plans.py",
    "dual/test_pair.py",
    "planning/test_tool_room.py",
    "envs/test_envs.py",
    "planning/test_inspection.py",
    "ur/test_wire.py",
)


def pytest_configure(config: pytest.Config) -> None:
    """Share what is made once where tests run; the process that hands them out needs none of it, nor numpy."""
    if not config.getoption("numprocesses", None):
        from tests.kept import share_commands, share_fields, share_parts, share_scenes

        share_fields()
        share_parts()
        share_commands()
        share_scenes()


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Folders are shared out to all processors; a file somebody names runs here, for a debugger."""
    whole = all(Path(argument).is_dir() for argument in config.args)
    return None if whole else 0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    def rank(item: pytest.Item) -> int:
        place = item.path.as_posix()
        return next((k for k, name in enumerate(FIRST) if place.endswith(name)), len(FIRST))

    items.sort(key=rank)


def pytest_collection_finish() -> None:
    gc.freeze()  # modules and tests stay: collecting looks at what tests make
