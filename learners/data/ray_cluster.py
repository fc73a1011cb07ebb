"""Tasks on a Ray cluster. This process never joins it: a driver of its own does (``ray_driver``),
which may die.

Ray ends a driver whose node or head is gone, with a page of text or without a word. Here that is
one line.
"""

from __future__ import annotations

import importlib.util
import os
import pickle
import subprocess
import sys
import weakref
from collections.abc import Iterable, Iterator, Sized
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import Any

import cloudpickle

from stancekit.envs.data.ledger import software
from stancekit.planners.errors import InvalidInput, not_installed

from .executor import Answer, Executor, Task, due

SILENCE_S = 8.0
"""A driver that says nothing for so long is no use any more; it says something every second."""
DRIVER = ("-m", "stancekit.learners.data.ray_driver")
"""Command that starts a driver."""
START_S, JOIN_S = 60.0, 60.0
"""Time that a driver may take to start, and to join a cluster that has let it in, or to start one
of its own."""


def ray_cluster(address: str = "auto") -> Executor:
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
