"""The executors by the names that commands have for them: processes of this computer, or a Ray
cluster.
"""

from __future__ import annotations

import importlib.util
import itertools
import logging
import os
import pickle
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from multiprocessing.connection import Connection, Pipe
from typing import Any, Literal, Protocol, TypeVar

import cloudpickle
from joblib.externals.loky import get_reusable_executor

from stancekit.envs.data.ledger import software
from stancekit.planners.errors import InvalidInput, StancekitError, not_installed
from stancekit.planners.files.arrays import checked_int

Answer = TypeVar("Answer")
Task = Callable[[], Answer]
Kind = Literal["processes", "ray"]

_IDLE_S = 60
"""Worker processes end when idle for so long; and at once when the process that started them is
gone."""
DEATHS = 5
"""How many times in a row, without any answer between, workers may die before a run gives up; or a
task's worker."""
_POLL_S = 1.0
"""Period at which a worker looks whether the process that started it is still there."""
_ONE_THREAD = {
    f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "BLIS", "NUMBA", "NUMEXPR")
}
"""Environment of worker processes: there is one per processor."""

log = logging.getLogger(__name__)


class Executor(Protocol):
    """Runs independent, picklable tasks and gives each one's answer once, as they come.

    Tasks may run twice.

    Tasks are taken one after the other, when there is room for them: which come next may depend on
    the answers so far. None among them stands for no task until another answer has been taken; it
    may only come while a task runs.
    """

    @property
    def workers(self) -> int:
        """Tasks that run at a time, as far as is known now."""

    def __call__(self, tasks: Iterable[Task[Answer] | None]) -> Iterator[Answer]:
        """Run them; the first exception of a task is raised again here."""


def gather(
    run: Executor,
    tasks: Sequence[Task[Answer]],
    on_progress: Callable[[int, int], None] | None = None,
) -> list[Answer]:
    """All answers in the order of the tasks.

    ``told`` is called with the number done and the number in all.
    """
    answers: dict[int, Answer] = {}
    for number, answer in run([partial(_numbered, k, task) for k, task in enumerate(tasks)]):
        answers[number] = answer
        if on_progress is not None:
            on_progress(len(answers), len(tasks))
    return [answers[number] for number in range(len(tasks))]


@dataclass(frozen=True)
class _Processes:
    workers: int

    def __call__(self, tasks: Iterable[Task[Answer] | None]) -> Iterator[Answer]:
        few = isinstance(tasks, Sized) and len(tasks) < 2
        if self.workers == 1 or few:
            return (task() for task in due(iter(tasks), None))
        return _pooled(self.workers, iter(tasks))


def processes(workers: int) -> Executor:
    """Run tasks on this many processes (loky); on one, in this process.

    A dead worker's tasks run again.

    Raises InvalidInput.
    """
    return _Processes(checked_int(workers, "workers", least=1, most=10_000))


def due(tasks: Iterator[Task[Answer] | None], room: int | None) -> Iterator[Task[Answer]]:
    """Tasks that can run now, at most as many as there is room for; None is no limit."""
    for task in itertools.islice(tasks, room):
        if task is None:
            return
        yield task


def _numbered(number: int, task: Task[Answer]) -> tuple[int, Answer]:
    return number, task()


def _in_worker(parent: int, number: int, task: Task[Answer]) -> tuple[int, Answer]:
    _end_with(parent)
    return _numbered(number, task)


@cache
def _end_with(parent: int) -> None:
    """End this process when its parent is gone: its answers would not be read, and it would wait
    forever.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _pooled(workers: int, tasks: Iterator[Task[Answer] | None]) -> Iterator[Answer]:
    """Keep twice as many tasks in flight as there are workers. left: those that were taken and not
    answered.
    """
    left, numbers, deaths = dict[int, Task[Answer]](), itertools.count(), 0
    while True:
        pool = get_reusable_executor(max_workers=workers, timeout=_IDLE_S, env=_ONE_THREAD)
        fresh, flying = dict(left), set[Future[tuple[int, Answer]]]()
        try:
            while True:
                fresh |= {
                    next(numbers): task
                    for task in due(tasks, 2 * workers - len(flying) - len(fresh))
                }
                left |= fresh
                flying |= {
                    pool.submit(_in_worker, os.getpid(), number, task)
                    for number, task in fresh.items()
                }
                fresh = {}
                if not flying:
                    return
                done, flying = wait(flying, return_when=FIRST_COMPLETED)
                for future in done:
                    number, answer = future.result()
                    del left[number]
                    deaths = 0
                    yield answer
        except BrokenProcessPool as error:
            if "un-serialize" in str(error):
                message = (str(error.__cause__ or error).strip("\"' \n").splitlines() or [""])[-1]
                raise StancekitError(
                    f"a worker process cannot read its task: {message:.200}"
                ) from None
            deaths += 1
            if deaths >= DEATHS:
                raise StancekitError(
                    f"a worker process died {deaths} times in a row: is there enough memory?"
                ) from None
            log.warning("a worker process died; %d tasks are left and run again", len(left))
        except BaseException:  # an error of a task, Ctrl-C, or nobody wants more answers
            pool.shutdown(wait=False, kill_workers=True)
            raise


SILENCE_S = 8.0
"""A driver that says nothing for so long is no use any more; it says something every second."""
DRIVER = ("-m", "stancekit.learners.data.ray_driver")
"""Command that starts a driver."""
START_S, JOIN_S = 60.0, 60.0
"""Time that a driver may take to start, and to join a cluster that has let it in, or to start one
of its own."""


def _ray_cluster(address: str = "auto") -> Executor:
    """Run tasks on a Ray cluster, one processor each; Ray runs the tasks of a lost worker or node
    again.

    Arguments:
        address: host:port of the cluster's head; ``auto``, the cluster that this machine belongs
            to; ``local``, one of its own. The connection is made by the first run and kept. Every
            node needs this version of Stancekit and of what its answers depend on; no files are
            shared.

    Raises:
        InvalidInput: where the cluster is not there or not fit, here or while tasks run, and
            InvalidInput without Ray.
    """
    return _Cluster(address)


class _Cluster:
    """An executor that keeps its driver between runs."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._driver: _Driver | None = None

    @property
    def workers(self) -> int:
        """Processors of the cluster, which is joined for that."""
        return max(self._joined().processors, 1)

    def __call__(self, tasks: Iterable[Task[Answer] | None]) -> Iterator[Answer]:
        """Keep twice as many tasks in flight as there are processors."""
        if isinstance(tasks, Sized) and not tasks:
            return
        driver, source, flying = self._joined(), iter(tasks), 0
        try:
            while True:
                fresh = [
                    cloudpickle.dumps(task)
                    for task in due(source, max(2 * driver.processors + 2 - flying, 0))
                ]
                flying += len(fresh)
                if not flying:
                    return
                for kind, answer in driver.answers(fresh):
                    flying -= 1
                    if kind == "raised":
                        raise answer
                    yield answer
        except BaseException:  # what still flies is nobody's any more
            self._driver = None
            driver.close()
            raise

    def _joined(self) -> _Driver:
        if importlib.util.find_spec("ray") is None:
            raise not_installed("executor", "Ray", "'ray'", "ray")
        if self._driver is None:
            self._driver = _Driver(self._address)
        return self._driver


class _Driver:
    """A process that has joined a cluster. processors: of the cluster.

    Raises InvalidInput.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._pipe, there = Pipe()
        command = [sys.executable, *DRIVER, str(there.fileno()), address]
        self._process = subprocess.Popen(
            command,
            pass_fds=[there.fileno()],
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        there.close()
        self.close = weakref.finalize(
            self, _end, self._pipe, self._process, wait=address == "local"
        )
        self._pipe.send(software())
        for limit_s in (START_S, SILENCE_S, JOIN_S):
            self._heard(limit_s)
        self.processors = int(self._heard(SILENCE_S)[0])

    def answers(self, tasks: list[bytes]) -> list[tuple[str, Any]]:
        """Hand over these tasks, and take what has been answered since: ("answer" or "raised", its
        value).
        """
        with suppress(OSError):  # what it said last says why
            self._pipe.send(tasks)
        self.processors, answered = self._heard(SILENCE_S)
        return [pickle.loads(each) for each in answered]  # of our own workers

    def _heard(self, limit_s: float) -> Any:
        """The driver's next message.

        Raises InvalidInput.
        """
        try:
            message = (
                self._pipe.recv()
                if self._pipe.poll(limit_s)
                else ("gone", "does not answer any more")
            )
        except (EOFError, OSError):
            message = ("gone", "has lost the node that this process joined it by")
        if message[0] == "refused":
            raise InvalidInput(
                f"address: expected a Ray cluster at {self._address!r}: {message[1]}"
            )
        if message[0] == "gone":
            raise InvalidInput(
                f"the Ray cluster at {self._address!r} {message[1]}; what it had answered is kept"
            )
        return message[1:]


def _end(pipe: Connection, process: subprocess.Popen[bytes], *, wait: bool) -> None:
    """Let the driver go; one that has a cluster of its own takes it down first."""
    pipe.close()
    try:
        process.wait(timeout=10.0 if wait else 0.2)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def executor(kind: Kind = "processes", *, workers: int = 1, address: str | None = None) -> Executor:
    """The executor with a name.

    Arguments:
        kind: "processes" or "ray".
        workers: number of processes; of no use to a cluster.
        address: address of the cluster, "auto" where it is None.

    Raises:
        InvalidInput: for another name, and for an address that processes have no use for.
    """
    if kind == "processes":
        if address is not None:
            raise InvalidInput(
                f"address: expected none for processes, got {address!r}; use it with the executor "
                "ray"
            )
        return processes(workers)
    if kind == "ray":
        return _ray_cluster(address or "auto")
    raise InvalidInput(f"executor: expected processes or ray, got {kind!r}")
