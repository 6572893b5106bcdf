"""Tasks shared out to real processes, some of which are killed."""

import errno
import os
import signal
import subprocess
import sys
import time
from contextlib import closing, suppress
from pathlib import Path

import pytest

from polish_sim import workers as module
from polish_sim.errors import InputError, ProtectiveStop
from polish_sim.row_file import whole_folder
from polish_sim.workers import Result, WorkersError, local_copy, open_workers

CHILDREN = Path(f"/proc/self/task/{os.getpid()}/children")


def work_off(tasks, work, group_of, count):
    with open_workers(count=count) as workers:
        yield from workers.results(tasks, work, group_of)


def double(task):
    return 2 * task


def die_once(task):
    """Kill the own process the first time an odd number comes."""
    folder, number = task
    mark = Path(folder) / str(number)
    if number % 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die_at_1(task):
    if task == 1:
        os._exit(7)
    return task


def perish(_task):
    os.kill(os.getpid(), signal.SIGKILL)


def read_shipped(name):
    """Whether a file came as a copy, and what it says."""
    return local_copy(name) != name, Path(local_copy(name)).read_text()


def fail(task):
    raise ValueError(f"no {task}")


def test_every_task_is_done_once_and_one_process_keeps_to_a_group_while_it_lasts():
    for workers in (1, 2):
        results = list(work_off(range(7), double, lambda task: task % 2, workers))
        assert sorted((r.task, r.value) for r in results) == [(n, 2 * n) for n in range(7)]
        assert {r.trouble for r in results} == {None}
        assert workers > 1 or [r.task for r in results] == [0, 2, 4, 6, 1, 3, 5]


def test_a_task_of_a_killed_process_is_done_once_more_and_left_out_and_where_all_die_given_up(tmp_path):
    tasks = [(str(tmp_path), number) for number in range(3)]
    results = list(work_off(tasks, die_once, lambda task: task[1], 2))
    assert sorted(r.value for r in results if r.trouble is None) == [0, 1, 2]
    (death,) = [r for r in results if r.trouble is not None]
    assert death[1:] == (None, "a worker process was killed (signal 9)", True)
    results = list(work_off(range(3), die_at_1, lambda task: 0, 1))
    assert sorted(r.value for r in results if r.trouble is None) == [0, 2]
    deaths = [r[1:] for r in results if r.trouble is not None]
    assert deaths == [(None, "a worker process ended with code 7", again) for again in (True, False)]
    with pytest.raises(WorkersError, match=r"4 worker .*memory.*--workers 1"):
        list(work_off(range(9), perish, lambda task: task, 2))


def stop_at(place):
    raise OSError(errno.ENOSPC, "no room") if place == "disk" else ProtectiveStop(f"stopped at {place}")


@pytest.mark.parametrize("engine", ["here", "local"])
def test_a_task_that_ends_with_an_error_of_ours_keeps_its_text_and_exit_code_any_other_its_traceback(engine):
    with open_workers(engine, 1) as workers:
        with pytest.raises(ProtectiveStop, match=r"^stopped at x$") as caught:
            list(workers.results(["x"], stop_at, lambda task: 0))
        assert caught.value.exit_code == 3
        with pytest.raises(OSError, match="no room") as full:
            list(workers.results(["disk"], stop_at, lambda task: 0))
        assert full.value.errno == errno.ENOSPC
        other = ValueError if engine == "here" else RuntimeError
        with pytest.raises(other, match="no 5" if engine == "here" else r"(?s)Traceback.*ValueError: no 5"):
            list(workers.results([5], fail, lambda task: 0))


def test_a_cluster_without_workers_is_given_up_and_says_what_to_do(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(module, "GONE_S", 0.5)
    options = {"processes": False, "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(n_workers=0, **options) as cluster, distributed.Client(cluster) as client:
        empty = module._Cluster(client, {}, "a cluster")
        with pytest.raises(WorkersError, match=r"no worker .*a cluster.*Start one"):
            list(empty.results([1], double, lambda task: 0))
        cluster.scale(1)
        client.wait_for_workers(1)
        assert list(empty.results([1], double, lambda task: 0)) == [Result(1, 2, None)]


def test_a_folder_changes_when_its_new_content_is_whole_and_needs_a_place_that_all_see(tmp_path):
    folder = tmp_path / "seed"
    for text, fails in (("old", False), ("half", True)):
        with suppress(ZeroDivisionError), whole_folder(folder) as draft:
            (draft / "log").write_text(text)
            _ = 1 / (not fails)
    assert [file.read_text() for file in tmp_path.rglob("log")] == ["old"]
    elsewhere = tmp_path / "of another machine" / "seed"
    with pytest.raises(InputError, match=r"another machine.*share.*--out"), whole_folder(elsewhere):
        pass


@pytest.mark.skipif(not CHILDREN.exists(), reason="needs /proc")
def test_breaking_off_leaves_no_process_behind():
    with closing(work_off(range(100), double, lambda task: task, 2)) as results:
        next(iter(results))
        before = len(CHILDREN.read_text().split())
    assert len(CHILDREN.read_text().split()) < before


def test_a_cluster_of_dask_does_every_task_and_leaves_out_the_one_that_kills_twice(tmp_path):
    pytest.importorskip("distributed")
    mine = tmp_path / "mine.txt"
    mine.write_text("gain 3")
    tasks = [(str(tmp_path), number) for number in range(3)]
    with open_workers("dask", 2, [mine]) as workers:
        assert workers.count == 2
        assert "http://127.0.0.1:" in workers.where
        killed = list(workers.results(tasks, die_once, lambda task: task[1]))
        assert sorted(r.value for r in killed if r.trouble is None) == [0, 1, 2]
        left = {r.task: r[1:] for r in workers.results(range(3), die_at_1, lambda task: 0)}
        assert (left[0], left[2]) == ((0, None, False), (2, None, False))
        assert left[1] == (None, "worker processes died at a task", False)
        (read,) = workers.results([str(mine)], read_shipped, lambda task: 0)
        assert read.value == (True, "gain 3")
        with pytest.raises(RuntimeError, match=r"(?s)Traceback.*ValueError: no 5"):
            list(workers.results([5], fail, lambda task: 0))


PARENT = """
import os, pathlib, time
from polish_sim.workers import open_workers

def sleep(task):
    pathlib.Path("worker").write_text(str(os.getpid()))
    time.sleep(600)

if __name__ == "__main__":
    with open_workers("ENGINE", 1) as workers:
        list(workers.results([1], sleep, lambda task: 0))
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("engine", ["local", "dask"])
def test_workers_do_not_outlive_a_parent_that_is_killed(tmp_path, engine):
    if engine == "dask":
        pytest.importorskip("distributed")
    script, name = tmp_path / "parent.py", tmp_path / "worker"
    script.write_text(PARENT.replace("ENGINE", engine))
    with subprocess.Popen([sys.executable, str(script)], cwd=tmp_path) as parent:
        until(lambda: name.exists() and name.read_text() != "")
        parent.kill()
    until(lambda: not alive(int(name.read_text())))


def alive(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


def until(happened):
    end = time.monotonic() + 90.0
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.005)
