"""Executors: the same answers wherever tasks run, each once, whatever dies meanwhile."""

import importlib.util
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from stancekit.envs.data.ledger import LabelPlan, TryPlan
from stancekit.learners.data import executors, ray_driver
from stancekit.learners.data.executors import executor, gather, processes
from stancekit.learners.data.labelling import label
from stancekit.learners.data.leap_tries import label_leaps
from stancekit.planners.errors import InvalidInput, StancekitError
from tests.emulators.tasks import die, die_once, fail, square
from tests.refusals import refuses

PARENT = """
import os, sys, time
from functools import partial
from stancekit.learners.data.executors import processes
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
        answers = gather(
            processes(workers),
            [partial(square, x) for x in range(20)],
            lambda k, n: seen.append((k, n)),
        )
        assert answers == [x * x for x in range(20)]
        assert seen == [(k, 20) for k in range(1, 21)]
    assert gather(processes(2), []) == []


def test_answers_come_as_they_are_ready_not_all_at_the_end() -> None:
    began: list[int] = []

    def task(x: int) -> int:
        began.append(x)
        return x

    assert (next(processes(1)([partial(task, x) for x in range(3)])), began) == (0, [0])


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_a_task_arrives_as_it_is(workers: int) -> None:
    with refuses("x"):
        gather(processes(workers), [partial(fail, x) for x in range(6)])


def test_the_tasks_of_a_killed_worker_run_again(tmp_path: Path) -> None:
    tasks = [partial(die_once, tmp_path / "died", x) for x in range(12)]
    assert gather(processes(2), tasks) == list(range(12))
    assert (tmp_path / "died").exists()


def test_workers_that_always_die_end_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "DEATHS", 2)
    with refuses(kind=StancekitError):
        gather(processes(2), [partial(die, x) for x in range(4)])


def test_workers_end_when_the_process_that_started_them_is_killed(tmp_path: Path) -> None:
    (tmp_path / "tests_executor_tasks.py").write_text(TASKS)
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    run = subprocess.Popen(
        [sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert run.stdout is not None
    workers = {int(run.stdout.readline()) for _ in range(2)}
    run.kill()
    run.wait()
    looks = 0
    while any(alive(pid) for pid in workers):
        assert (looks := looks + 1) < 1000, "orphans live on"
        time.sleep(0.1)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"workers": 0}, "workers"),
        (
            {"address": "10.0.0.1:6379"},
            "address",
        ),
        ({"kind": "threads"}, "executor"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, object], message: str) -> None:
    with refuses(message):
        executor(**arguments)  # type: ignore[arg-type]


class FakeRay:
    """As much of a cluster as the watch looks at."""

    def __init__(self, head: str) -> None:
        self.gcs_address, self.count, self.raylet = head, 2, head

    def get_runtime_context(self) -> "FakeRay":
        return self

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": float(self.count)}

    def nodes(self) -> list[dict[str, Any]]:
        host, _, port = self.raylet.rpartition(":")
        place = {"NodeManagerAddress": host, "NodeManagerPort": int(port)}
        return (
            [{"Alive": True, "Resources": {"CPU": float(self.count)}, **place}]
            if self.count
            else []
        )


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The driver's time [s]."""
    now = [0.0]
    monkeypatch.setattr(ray_driver.time, "monotonic", lambda: now[0])
    return now


def test_a_cluster_that_goes_away_is_noticed(clock: list[float]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as head:
        ray = FakeRay(f"127.0.0.1:{head.getsockname()[1]}")
        watch = ray_driver.Watch(ray)
        ray.count = 3
        clock[0] = 2.0
        assert watch.processors() == 3
        ray.count = 0
        clock[0] = 4.0
        assert watch.processors() == 0
        clock[0] = 8.0
        with refuses(kind=ray_driver.Gone):
            watch.processors()
        ray.count = 2
        clock[0] = 10.0
        assert watch.processors() == 2
    clock[0] = 12.0
    assert watch.processors() == 2
    clock[0] = 16.0
    with refuses(kind=ray_driver.Gone):
        watch.processors()


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            "Version mismatch: The cluster was started with:\n    Ray: 2.55.1\n    Python: 3.11.7\n"
            "This process on node 127.0.0.2 was started with:\n    Ray: 2.60.0\n    Python: 3.12.1\n",
            "it runs Ray 2.55.1 on Python 3.11.7, this machine Ray 2.60.0 on Python 3.12.1",
        ),
        (
            "RPC error: InvalidAuthToken: Authentication token is missing or incorrect. Ensure\nthat",
            "it does not take the token of this machine (RAY_AUTH_TOKEN, RAY_AUTH_TOKEN_PATH or ~/.ray/auth_token)",
        ),
        ("\nSomething else.\nAnd more.", "Something else."),
        ("", "ValueError"),
    ],
)
def test_what_ray_says_becomes_one_line(text: str, line: str) -> None:
    assert ray_driver.reason(ValueError(text)) == line


def _driver_that(says: str) -> str:
    """A module in the place of the driver."""
    return f"""
import sys, time
from multiprocessing.connection import Connection
pipe = Connection(int(sys.argv[1]))
pipe.recv()
{says}
"""


@pytest.mark.parametrize(
    ("says", "line"),
    [
        (
            "",
            "the Ray cluster at '10.0.0.1:1' has lost the node that this process joined it by; what it had answered "
            "is kept",
        ),
        (
            "time.sleep(60)",
            "the Ray cluster at '10.0.0.1:1' does not answer any more; what it had answered is kept",
        ),
        (
            "pipe.send(('asks',)); pipe.send(('refused', 'no'))",
            "address: expected a Ray cluster at '10.0.0.1:1': no",
        ),
        (
            "for each in ('asks', 'joins', 'joined'): pipe.send((each,))\npipe.send(('works', 2)); pipe.recv()\n"
            "pipe.send(('gone', 'is closed'))",
            "the Ray cluster at '10.0.0.1:1' is closed; what it had answered is kept",
        ),
    ],
)
def test_a_driver_that_dies_hangs_or_gives_up_is_one_line(
    says: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "driver.py").write_text(_driver_that(says))
    monkeypatch.setattr(executors, "DRIVER", (str(tmp_path / "driver.py"),))
    for name in ("SILENCE_S", "START_S"):
        monkeypatch.setattr(executors, name, 0.5 if "sleep" in says else 60.0)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)
    with pytest.raises(InvalidInput) as error:
        gather(executor("ray", address="10.0.0.1:1"), [partial(square, 1)])
    assert str(error.value) == line


def test_a_cluster_that_is_not_there_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        address = f"127.0.0.1:{closed.getsockname()[1]}"
    with refuses("address"):
        gather(executor("ray", address=address), [partial(square, 1)])
    with refuses("address"):
        gather(executor("ray", address="moon"), [partial(square, 1)])


def test_a_ray_cluster_gives_the_same_answers(tmp_path: Path) -> None:
    run = executor("ray", address="local")
    tasks = [partial(die_once, tmp_path / "died", x) for x in range(8)]
    assert gather(run, tasks) == list(range(8))  # one worker was killed meanwhile
    assert gather(run, [partial(square, x) for x in range(30)]) == [x * x for x in range(30)]
    plan = LabelPlan(distribution="wall-3", feasible=30, infeasible=30, shard_size=50)
    label(plan, tmp_path / "cluster", run=run)
    label(plan, tmp_path / "here")
    shards = [f"shard-{k:05d}.parquet" for k in range(plan.shards)]
    assert all(
        Path(tmp_path, "cluster", s).read_bytes() == Path(tmp_path, "here", s).read_bytes()
        for s in shards
    )
    tries = TryPlan(
        distribution="leap-hard", scenes=2, tries={"random": 2, "rule": 1}, shard_size=3, seed=3
    )
    label_leaps(tries, tmp_path / "leaps", run=run)
    label_leaps(tries, tmp_path / "leaps here")
    kept = sorted(file.name for file in (tmp_path / "leaps here").glob("shard-*.parquet"))
    assert len(kept) == 2
    assert all(
        Path(tmp_path, "leaps", s).read_bytes() == Path(tmp_path, "leaps here", s).read_bytes()
        for s in kept
    )
    with refuses("x"):
        gather(run, [partial(fail, x) for x in range(6)])


def test_tasks_may_follow_from_the_answers_so_far() -> None:
    for workers in (1, 2):
        sums = list[int]()

        def tasks(sums: list[int] = sums) -> Iterator[Callable[[], int] | None]:
            for x in range(4):
                yield partial(square, x)
            while len(sums) < 4:
                yield None
            yield partial(square, sum(sums))

        for answer in processes(workers)(tasks()):
            sums.append(answer)
        assert sorted(sums[:4]) == [0, 1, 4, 9]
        assert sums[4:] == [14 * 14]
