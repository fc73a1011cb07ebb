"""Where independent tasks run: in processes of this machine, or on a Ray cluster. The answers do not depend on it."""

from __future__ import annotations

import logging
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import cache, partial
from typing import Any, Literal, Protocol, TypeVar

import joblib

from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import checked_int

Answer = TypeVar("Answer")
Task = Callable[[], Answer]
Kind = Literal["processes", "ray"]

IDLE_S = 60
"""Worker processes end when idle for so long; and at once when the process that started them is gone."""
DEATHS = 5
"""How many times in a row, without any answer between, workers may die before a run gives up; or a task's worker."""
POLL_S = 1.0
"""How often a cluster is asked whether it is still there."""
PATIENCE_S = 15.0
"""How long a cluster may be out of reach, or without a processor, before it counts as gone."""

log = logging.getLogger(__name__)


class Executor(Protocol):
    """Runs independent, picklable tasks and gives each one's answer once, as they come. Tasks may run twice."""

    def __call__(self, tasks: Sequence[Task[Answer]]) -> Iterator[Answer]:
        """Run them; the first exception of a task is raised again here."""
        ...


class ClusterGone(InvalidInput):
    """The cluster that was asked for is not there, or not any more."""


class WorkersDied(StancekitError):
    """Worker processes die again and again."""


def executor(kind: Kind = "processes", *, workers: int = 1, address: str | None = None) -> Executor:
    """The executor of this name. workers: of ``processes``; address: of a cluster. Raises InvalidInput."""
    if kind == "processes":
        if address is not None:
            raise InvalidInput(f"address: expected none for processes, got {address!r}; use it with the executor ray")
        return processes(workers)
    if kind == "ray":
        return ray_cluster(address or "auto")
    raise InvalidInput(f"executor: expected processes or ray, got {kind!r}")


def gather(
    run: Executor, tasks: Sequence[Task[Answer]], on_progress: Callable[[int, int], None] | None = None
) -> list[Answer]:
    """All answers in the order of the tasks. ``told`` is given how many are there, and how many there will be."""
    answers: dict[int, Answer] = {}
    for number, answer in run([partial(_numbered, k, task) for k, task in enumerate(tasks)]):
        answers[number] = answer
        if on_progress is not None:
            on_progress(len(answers), len(tasks))
    return [answers[number] for number in range(len(tasks))]


def processes(workers: int) -> Executor:
    """Run tasks on this many processes (loky); on one, in this process. A dead worker's tasks run again.

    Raises InvalidInput.
    """
    checked_int(workers, "workers", least=1)

    def run(tasks: Sequence[Task[Answer]]) -> Iterator[Answer]:
        if workers == 1 or len(tasks) < 2:
            return (task() for task in tasks)
        return _pooled(workers, tasks)

    return run


def ray_cluster(address: str = "auto") -> Executor:
    """Run tasks on a Ray cluster, one processor each; Ray runs the tasks of a lost worker or node again.

    address: host:port of the cluster's head; ``auto``, the cluster that this machine belongs to; ``local``, one of its
    own. The connection is made by the first run and kept. Every node needs this version of Stancekit installed; no
    files are shared. Raises ClusterGone where it is not there, here or while tasks run, and InvalidInput without Ray.
    """

    def run(tasks: Sequence[Task[Answer]]) -> Iterator[Answer]:
        ray = _ray()
        if tasks:
            _connect(ray, address)
            yield from _on_cluster(ray, tasks, address)

    return run


def _numbered(number: int, task: Task[Answer]) -> tuple[int, Answer]:
    return number, task()


def _in_worker(parent: int, number: int, task: Task[Answer]) -> tuple[int, Answer]:
    _end_with(parent)
    return _numbered(number, task)


@cache
def _end_with(parent: int) -> None:
    """End this process when its parent is gone: nobody would read its answers, and it would wait forever."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _pooled(workers: int, tasks: Sequence[Task[Answer]]) -> Iterator[Answer]:
    left, deaths = dict(enumerate(tasks)), 0
    while left:
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1, idle_worker_timeout=IDLE_S):
            pool = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
        jobs = [joblib.delayed(_in_worker)(os.getpid(), number, task) for number, task in left.items()]
        try:
            for number, answer in pool(jobs):
                del left[number]
                deaths = 0
                yield answer
        except BrokenProcessPool as error:
            if "un-serialize" in str(error):
                told = (str(error.__cause__ or error).strip("\"' \n").splitlines() or [""])[-1]
                raise WorkersDied(f"a worker process cannot read its task: {told:.200}") from None
            deaths += 1
            if deaths >= DEATHS:
                raise WorkersDied(f"a worker process died {deaths} times in a row: is there enough memory?") from None
            log.warning("a worker process died; %d tasks are left and run again", len(left))


def _ray() -> Any:
    """Ray, kept from printing on standard output, where the results belong, and from logging what its errors say."""
    os.environ.setdefault("RAY_DEDUP_LOGS_SKIP_REGEX", ".*")
    os.environ.setdefault("RAY_BACKEND_LOG_LEVEL", "fatal")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError:
        raise InvalidInput("executor: 'ray' needs Ray, got none: pip install 'stancekit[ray]'") from None
    return ray


def _connect(ray: Any, address: str) -> None:
    """Join the cluster, unless this process did before."""
    if ray.is_initialized():
        return
    if ":" in address and "//" not in address and not _answers(address):
        raise ClusterGone(f"address: expected a Ray cluster at {address}, nothing answers there")
    options: dict[str, Any] = {"address": address, "logging_level": logging.ERROR, "log_to_driver": False}
    if address == "local":
        options |= {"include_dashboard": False, "_node_ip_address": "127.0.0.2"}  # Ray replaces 127.0.0.1
    try:
        ray.init(**options)
    except Exception as error:  # of a node that does not start Ray raises a plain Exception
        line = (str(error) or type(error).__name__).splitlines()[0]
        raise ClusterGone(f"address: expected a Ray cluster at {address!r}: {line}") from None


def _on_cluster(ray: Any, tasks: Sequence[Task[Answer]], address: str) -> Iterator[Answer]:
    """Keep twice as many tasks in flight as there are processors; look after the cluster while waiting."""
    remote = ray.remote(num_cpus=1, max_retries=DEATHS)(_call)
    waiting = list(reversed(tasks))
    flying: list[Any] = []
    watch = _Watch(ray, address)
    try:
        while waiting or flying:
            room = 2 * watch.processors() + 2 - len(flying)
            flying += [remote.remote(waiting.pop()) for _ in range(min(room, len(waiting)))]
            done, flying = ray.wait(flying, num_returns=1, timeout=POLL_S)
            for reference in done:
                yield ray.get(reference)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None
    except ray.exceptions.RayError as error:
        line = str(error).strip().splitlines()[0]
        raise ClusterGone(f"the Ray cluster at {address!r} lost a task for good: {line}") from None


def _call(task: Task[Answer]) -> Answer:
    return task()


class _Watch:
    """Looks after the head and the processors of a cluster. Ray itself ends the whole process a minute after its head
    is gone, without an exception; this notices before.
    """

    def __init__(self, ray: Any, address: str) -> None:
        self._ray, self._address = ray, address
        self._head = ray.get_runtime_context().gcs_address
        self._seen_s = self._looked_s = time.monotonic()
        self._processors = int(ray.cluster_resources().get("CPU", 0))

    def processors(self) -> int:
        """Processors of the cluster. Raises ClusterGone after PATIENCE_S without a head or any processor."""
        now = time.monotonic()
        if now - self._looked_s < POLL_S:
            return self._processors
        there = _answers(self._head)
        if there:
            self._processors = int(self._ray.cluster_resources().get("CPU", 0))
        if there and self._processors:
            self._seen_s = now
        self._looked_s = now
        if now - self._seen_s > PATIENCE_S:
            what = "has no processor left" if there else "does not answer any more"
            raise ClusterGone(f"the Ray cluster at {self._address!r} {what}; what it had answered is kept")
        return self._processors


def _answers(address: str) -> bool:
    """Whether something listens at host:port. Raises ClusterGone for another form of address."""
    host, _, port = address.rpartition(":")
    if not port.isdecimal():
        raise ClusterGone(f"address: expected host:port, auto or local, got {address!r}")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=3.0):
            return True
    except (OSError, OverflowError):
        return False
