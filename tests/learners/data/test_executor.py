"""Executors: the same answers wherever tasks run, each once, whatever dies meanwhile."""

import os
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from stancekit.envs.data.ledger import LabelPlan
from stancekit.learners.data import executor as module
from stancekit.learners.data.executor import ClusterGone, WorkersDied, executor, gather, processes
from stancekit.learners.data.labelling import label
from stancekit.planners.errors import InvalidInput
from tests.emulators.tasks import die, die_once, fail, square

PARENT = """
import os, sys, time
from functools import partial
from stancekit.learners.data.executor import processes
from tests_executor_tasks import nap

for pid in processes(2)([partial(nap, 0.0)] * 2 + [partial(nap, 600.0)] * 2):
    print(pid, flush=True)
"""
TASKS = """
import os, time

def nap(seconds):
    time.sleep(seconds)
    return os.getpid()
"""


def test_answers_come_in_the_order_of_the_tasks_and_are_counted() -> None:
    seen: list[tuple[int, int]] = []
    for workers in (1, 2):
        seen.clear()
        answers = gather(processes(workers), [partial(square, x) for x in range(20)], lambda k, n: seen.append((k, n)))
        assert answers == [x * x for x in range(20)]
        assert seen == [(k, 20) for k in range(1, 21)]
    assert gather(processes(2), []) == []


def test_answers_come_as_they_are_ready_not_all_at_the_end() -> None:
    began: list[int] = []

    def task(x: int) -> int:
        began.append(x)
        return x

    answers = processes(1)([partial(task, x) for x in range(3)])
    assert (next(answers), began) == (0, [0])


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_a_task_arrives_as_it_is(workers: int) -> None:
    with pytest.raises(InvalidInput, match=r"^x: expected another number than 3$"):
        gather(processes(workers), [partial(fail, x) for x in range(6)])


def test_the_tasks_of_a_killed_worker_run_again(tmp_path: Path) -> None:
    tasks = [partial(die_once, tmp_path / "died", x) for x in range(12)]
    assert gather(processes(2), tasks) == list(range(12))
    assert (tmp_path / "died").exists()


def test_workers_that_always_die_end_the_run() -> None:
    with pytest.raises(WorkersDied, match="died 5 times in a row"):
        gather(processes(2), [partial(die, x) for x in range(4)])


def test_workers_end_when_the_process_that_started_them_is_killed(tmp_path: Path) -> None:
    (tmp_path / "tests_executor_tasks.py").write_text(TASKS)
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    run = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True, env=environment)
    assert run.stdout is not None
    workers = {int(run.stdout.readline()) for _ in range(2)}
    run.kill()
    run.wait()
    deadline = time.monotonic() + 20.0
    while any(alive(pid) for pid in workers):
        assert time.monotonic() < deadline, "orphans live on"
        time.sleep(0.1)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"workers": 0}, "workers: expected 1 or more, got 0"),
        ({"address": "10.0.0.1:6379"}, "address: expected none for processes, got '10.0.0.1:6379'; use it with the "
                                       "executor ray"),
        ({"kind": "threads"}, "executor: expected processes or ray, got 'threads'"),
    ],
)  # fmt: skip
def test_bad_arguments_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInput) as error:
        executor(**arguments)  # type: ignore[arg-type]
    assert str(error.value) == message


def test_ray_that_is_not_installed_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InvalidInput, match=r"^executor: 'ray' needs Ray, got none: pip install 'stancekit\[ray\]'$"):
        gather(executor("ray"), [partial(square, 1)])


class FakeRay:
    """As much of a cluster as the watch looks at."""

    def __init__(self, head: str) -> None:
        self.gcs_address, self.processors = head, 2

    def get_runtime_context(self) -> "FakeRay":
        return self

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": float(self.processors)} if self.processors else {}


def test_a_cluster_that_goes_away_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    with socket.create_server(("127.0.0.1", 0)) as head:
        ray = FakeRay(f"127.0.0.1:{head.getsockname()[1]}")
        watch = module._Watch(ray, "there")
        ray.processors = 3
        now[0] = 2.0
        assert watch.processors() == 3
        ray.processors = 0
        now[0] = 4.0
        assert watch.processors() == 0
        now[0] = 30.0
        with pytest.raises(ClusterGone, match=r"^the Ray cluster at 'there' has no processor left"):
            watch.processors()
        ray.processors = 2
        now[0] = 32.0
        assert watch.processors() == 2
    now[0] = 34.0
    assert watch.processors() == 2
    now[0] = 60.0
    with pytest.raises(ClusterGone, match=r"^the Ray cluster at 'there' does not answer any more"):
        watch.processors()


def test_a_node_that_does_not_start_is_one_line() -> None:
    class Unstarted:
        """Ray, whose node times out; it raises a plain Exception of many lines then."""

        def is_initialized(self) -> bool:
            return False

        def init(self, **options: object) -> None:
            raise Exception("The current node timed out during startup. \nAnd more\nlines.")

    with pytest.raises(ClusterGone) as error:
        module._connect(Unstarted(), "local")
    assert str(error.value) == (
        "address: expected a Ray cluster at 'local': The current node timed out during startup."
    )


def test_a_cluster_that_is_not_there_is_one_line() -> None:
    pytest.importorskip("ray")
    with socket.create_server(("127.0.0.1", 0)) as closed:
        address = f"127.0.0.1:{closed.getsockname()[1]}"
    with pytest.raises(ClusterGone) as error:
        gather(executor("ray", address=address), [partial(square, 1)])
    assert str(error.value) == f"address: expected a Ray cluster at {address}, nothing answers there"
    with pytest.raises(ClusterGone, match=r"^address: expected a Ray cluster at 'moon': Invalid address format: moon$"):
        gather(executor("ray", address="moon"), [partial(square, 1)])


def test_a_ray_cluster_gives_the_same_answers(tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    run = executor("ray", address="local")
    try:
        tasks = [partial(die_once, tmp_path / "died", x) for x in range(8)]
        assert gather(run, tasks) == list(range(8))  # one worker was killed meanwhile
        assert gather(run, [partial(square, x) for x in range(30)]) == [x * x for x in range(30)]
        with pytest.raises(InvalidInput, match=r"^x: expected another number than 3$"):
            gather(run, [partial(fail, x) for x in range(6)])
        plan = LabelPlan(distribution="wall-3", feasible=3, infeasible=3, shard_size=3)
        label(plan, tmp_path / "cluster", run=run)
        label(plan, tmp_path / "here")
        shards = [f"shard-{k:05d}.parquet" for k in range(plan.shards)]
        assert all(Path(tmp_path, "cluster", s).read_bytes() == Path(tmp_path, "here", s).read_bytes() for s in shards)
    finally:
        ray.shutdown()
