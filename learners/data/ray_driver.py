"""The process that joins a Ray cluster on behalf of ``ray_cluster``: tasks come by a pipe, answers
go back.

It says something every second, ends with the process that started it, and knows nothing of the
tasks but their bytes.
"""

from __future__ import annotations

import logging
import os
import re
import socket
import sys
import time
from collections.abc import Callable
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any

from .executors import DEATHS

_POLL_S = 1.0
"""Period at which the cluster is asked whether it is still there."""
_PATIENCE_S = 5.0
"""Time that a cluster may be out of reach, or without a processor, before it counts as gone."""


class Refused(Exception):
    """The cluster that was asked for is not there, or is no use."""


class Gone(Exception):
    """The cluster is not there any more."""


def main(pipe: Connection, address: str) -> None:
    """Join, and work until the other side goes away."""
    try:
        expected = pipe.recv()
        ray = joined(address, pipe)
        try:
            work(ray, pipe, expected)
        except Gone as error:  # said before the farewell, which takes 5 s where nobody hears it
            pipe.send(("gone", str(error)))
        finally:
            ray.shutdown()
    except (EOFError, OSError):
        return  # nobody is there any more
    except Refused as error:
        pipe.send(("refused", str(error)))


def joined(address: str, pipe: Connection) -> Any:
    """Ray, connected.

    The other side hears when the cluster is asked, and when it has let us in. Raises Refused.
    """
    head = None if address == "local" else _head_of(address)
    if head is not None and not answers(head):  # said before Ray is imported
        raise Refused(f"nothing answers at {head}")
    import ray

    raylet: Any = import_module("ray._raylet")  # its stubs lack the client

    options: dict[str, Any] = {
        "address": address,
        "logging_level": logging.CRITICAL,
        "log_to_driver": False,
    }
    if address == "local":
        options |= {
            "include_dashboard": False,
            "_node_ip_address": "127.0.0.2",
        }  # Ray replaces 127.0.0.1
    pipe.send(("asks",))
    try:
        if head is not None:
            raylet.GcsClient(
                address=head
            )  # says at once what ray.init says after a while: that the token is another
        pipe.send(("joins",))
        ray.init(**options)
    except Exception as error:  # of a node that does not start Ray raises a plain Exception
        raise Refused(reason(error)) from None
    return ray


def _head_of(address: str) -> str | None:
    """host:port that an address stands for; None where only Ray knows.

    Raises Refused.
    """
    if "://" in address or address == "auto":
        from ray._private.services import get_ray_address_from_environment

        try:
            address_seen = get_ray_address_from_environment(address, None)
        except ConnectionError:
            raise Refused(
                "none runs on this machine; start one with ray start --head, or name its head"
            ) from None
        return (
            None
            if address_seen is None or "://" in address_seen or address_seen == "auto"
            else address_seen
        )
    if not address.rpartition(":")[2].isdecimal():
        raise Refused("expected host:port, auto or local")
    return address


def reason(error: Exception) -> str:
    """One line for an error of joining."""
    text = str(error) or type(error).__name__
    versions = re.findall(r"Ray: (\S+)\s+Python: (\S+)", text)
    if len(versions) == 2:
        (there, python_there), (here, python_here) = versions
        return f"it runs Ray {there} on Python {python_there}, this machine Ray {here} on Python {python_here}"
    if re.search(r"token|unauthenticated", text, re.IGNORECASE):
        return "it does not take the token of this machine (RAY_AUTH_TOKEN, RAY_AUTH_TOKEN_PATH or ~/.ray/auth_token)"
    return text.strip().splitlines()[0]


def work(ray: Any, pipe: Connection, expected: dict[str, str]) -> None:
    """Run what comes by the pipe, one processor a task.

    Raises Gone, and EOFError once the pipe is closed.
    """
    remote = ray.remote(num_cpus=1, max_retries=DEATHS)(call(expected))
    pipe.send(("joined",))
    watch = Watch(ray)
    pipe.send(("works", watch.processors()))
    flying: list[Any] = []
    while True:
        flying += [remote.remote(task) for task in pipe.recv()]
        done, flying = ray.wait(flying, num_returns=1, timeout=_POLL_S) if flying else ([], [])
        try:
            answered = ray.get(done, timeout=_PATIENCE_S)
        except ray.exceptions.RayError as error:
            raise Gone(f"lost a task for good: {reason(error)}") from None
        unfit = next((answer for answer in answered if isinstance(answer, str)), None)
        if unfit is not None:
            raise Gone(unfit)
        pipe.send(("answered", watch.processors(seen=bool(done)), answered))


def call(expected: dict[str, str]) -> Callable[[bytes], bytes | str]:
    """Function that a worker runs on a task.

    It goes there whole, since a node need not have this package; it says so then.
    """
    checked: list[str] = []

    def run(task: bytes) -> bytes | str:
        import pickle
        import traceback
        from importlib.metadata import PackageNotFoundError, version

        if not checked:
            import socket

            for name, wanted in expected.items():
                node = f"has a node, {socket.gethostname()},"
                try:
                    got = version(name)
                except PackageNotFoundError:
                    return f"{node} without {name}: expected {wanted}, as here"
                if got != wanted:
                    return f"{node} with another {name}: expected {wanted}, as here, got {got}"
            checked.append("fit")
        import cloudpickle

        try:
            answer: bytes = cloudpickle.dumps(("answer", pickle.loads(task)()))
            return answer
        except Exception as error:  # it is raised where the answer is read
            error.add_note(traceback.format_exc())
            raised: bytes = cloudpickle.dumps(("raised", error))
            return raised

    return run


class Watch:
    """Looks after the head and the processors of a cluster.

    Ray itself says so only after a minute, or ends us.
    """

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self._head = ray.get_runtime_context().gcs_address
        self._seen_s = self._looked_s = time.monotonic()
        self._processors = int(ray.cluster_resources().get("CPU", 0))

    def processors(self, *, seen: bool = False) -> int:
        """Processors of the cluster.

        Arguments:
            seen: an answer came just now.

        Raises:
            Gone: after PATIENCE_S without any.
        """
        now = time.monotonic()
        if seen:
            self._seen_s = now
        if now - self._looked_s < _POLL_S:
            return self._processors
        self._looked_s, there = now, answers(self._head)
        if there:
            nodes = [
                node
                for node in self._ray.nodes()
                if node["Alive"] and node["Resources"].get("CPU", 0)
            ]
            self._processors = int(sum(node["Resources"]["CPU"] for node in nodes))
            if any(
                answers(f"{node['NodeManagerAddress']}:{node['NodeManagerPort']}") for node in nodes
            ):
                self._seen_s = now
        if now - self._seen_s > _PATIENCE_S:
            raise Gone("has no processor left" if there else "does not answer any more")
        return self._processors


def answers(address: str) -> bool:
    """Tell whether something listens at host:port."""
    host, _, port = address.rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=2.0):
            return True
    except (OSError, OverflowError):
        return False


if __name__ == "__main__":
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    main(Connection(int(sys.argv[1])), sys.argv[2])
