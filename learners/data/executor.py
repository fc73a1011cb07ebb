"""Executors of independent tasks: in processes of this machine, or on a Ray cluster. The answers do
not depend on it.
"""

from __future__ import annotations

import itertools
import logging
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache, partial
from typing import Literal, Protocol, TypeVar

from joblib.externals.loky import get_reusable_executor

from stancekit.planners.errors import StancekitError
from stancekit.planners.files.arrays import checked_int

Answer = TypeVar("Answer")
Task = Callable[[], Answer]
Kind = Literal["processes", "ray"]

IDLE_S = 60
"""Worker processes end when idle for so long; and at once when the process that started them is
gone."""
DEATHS = 5
"""How many times in a row, without any answer between, workers may die before a run gives up; or a
task's worker."""
POLL_S = 1.0
"""Period at which a worker looks whether the process that started it is still there."""
ONE_THREAD = {
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
        ...

    def __call__(self, tasks: Iterable[Task[Answer] | None]) -> Iterator[Answer]:
        """Run them; the first exception of a task is raised again here."""
        ...


def gather(
    run: Executor,
    tasks: Sequence[Task[Answer]],
    on_progress: Callable[[int, int], None] | None = None,
) -> list[Answer]:
    """All answers in the order of the tasks.

    ``told`` is given how many are there, and how many there will be.
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
    return _Processes(checked_int(workers, "workers", least=1))


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
    """End this process when its parent is gone: nobody would read its answers, and it would wait
    forever.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _pooled(workers: int, tasks: Iterator[Task[Answer] | None]) -> Iterator[Answer]:
    """Keep twice as many tasks in flight as there are workers. left: those that were taken and not
    answered.
    """
    left, numbers, deaths = dict[int, Task[Answer]](), itertools.count(), 0
    while True:
        pool = get_reusable_executor(max_workers=workers, timeout=IDLE_S, env=ONE_THREAD)
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
