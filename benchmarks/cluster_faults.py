"""What a run on a Ray cluster says when the cluster fails: one line, within how many seconds, and
what is kept.

python benchmarks/cluster_faults.py --old-python OLD/bin/python --bare-python BARE/bin/python
--times 3

Every fault is made on a small cluster of its own on this machine's loopback device, with a token of
its own. A run that fails is started again on this machine alone, and its bytes are compared with
those of a run that met no fault. OLD: an environment with another version of Ray. BARE: one with
this version of Ray, and without Stancekit.
"""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from _bench import Options, launch

LOOPBACK = "127.0.0.2"  # Ray replaces 127.0.0.1 by the machine's address
STORE = "--object-store-memory=100000000"
LABEL = ("wall-3", "--feasible", "600", "--infeasible", "600", "--seed", "3", "--shard-size", "30")


@dataclass(frozen=True, kw_only=True)
class Faults(Options):
    """Which faults, how often, and where the other environments are."""

    times: int = 3
    only: tuple[str, ...] = ()
    """Names of faults; all where there are none."""
    old_python: Path | None = None
    """Python of an environment with another version of Ray; that fault is left out where there is
    none."""
    bare_python: Path | None = None
    """Python of an environment with Ray and without Stancekit; that fault is left out where there
    is none."""
    port: int = 26379
    """Port of the heads."""


class Cluster:
    """A head without processors, and nodes of one each."""

    def __init__(self, folder: Path, port: int, python: str = sys.executable) -> None:
        self.address, self._folder = f"{LOOPBACK}:{port}", folder
        self.nodes: list[subprocess.Popen[bytes]] = []
        self._started = 0
        token = folder / "token"
        token.write_bytes(os.urandom(24).hex().encode())
        self.environment = os.environ | {"RAY_USAGE_STATS_ENABLED": "0", "RAY_AUTH_MODE": "token"}
        self.environment["RAY_AUTH_TOKEN_PATH"] = str(token)
        self.head = self._start(
            python,
            "--head",
            f"--port={port}",
            "--num-cpus=0",
            "--include-dashboard=false",
            f"--temp-dir={folder / 'ray'}",
        )

    def node(self, python: str = sys.executable) -> None:
        """Another node of one processor."""
        self.nodes.append(self._start(python, f"--address={self.address}", "--num-cpus=1"))

    def _start(self, python: str, *options: str) -> subprocess.Popen[bytes]:
        script = "import sys; from ray.scripts.scripts import main; sys.exit(main())"
        command = [
            python,
            "-c",
            script,
            "start",
            f"--node-ip-address={LOOPBACK}",
            STORE,
            "--block",
            *options,
        ]
        with (self._folder / "log").open("ab") as log:
            started = subprocess.Popen(
                command, env=self.environment, stdout=log, stderr=log, start_new_session=True
            )
        self._started += 1
        wanted, limit = self._started, time.monotonic() + 120.0
        while len(self.processes("raylet/raylet")) < wanted:
            if time.monotonic() > limit or started.poll() is not None:
                raise SystemExit((self._folder / "log").read_text())
            time.sleep(0.2)
        time.sleep(2.0)
        return started

    def processes(self, name: str) -> list[int]:
        """Processes of this cluster by a part of their command, oldest first."""
        found = []
        for path in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                command, *options = (path / "cmdline").read_text(errors="replace").split("\0")
                if command.endswith(name) and any(
                    str(self._folder) in option or self.address in option for option in options
                ):
                    found.append(int(path.name))
        return sorted(found)

    def kill(self, *pids: int) -> None:
        """SIGKILL."""
        for pid in pids:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def end(self) -> None:
        """Take everything down that was started."""
        for started in (*self.nodes, self.head):
            with suppress(ProcessLookupError):
                os.killpg(started.pid, signal.SIGTERM)
        for started in (*self.nodes, self.head):
            with suppress(subprocess.TimeoutExpired):
                started.wait(timeout=20.0)
            with suppress(ProcessLookupError):
                os.killpg(started.pid, signal.SIGKILL)
        self.kill(*self.processes("gcs_server"), *self.processes("raylet/raylet"))


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What a run came to. seconds: from the fault, or from the start where it is there from the
    start.
    """

    code: int
    lines: list[str]
    seconds: float
    shards: int


def label(
    cluster: Cluster,
    folder: Path,
    address: str,
    strike: Callable[[subprocess.Popen[bytes]], None] | None,
    environment: dict[str, str] | None = None,
) -> Seen:
    """Label on a cluster; once two shards are there, strike."""
    command = [
        sys.executable,
        "-m",
        "stancekit.cli.main",
        "label",
        LABEL[0],
        str(folder),
        *LABEL[1:],
        "--executor",
        "ray",
        "--address",
        address,
        "--json",
    ]
    begin = time.monotonic()
    run = subprocess.Popen(
        command,
        env=environment or cluster.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    if strike is not None:
        while len(shards(folder)) < 2 and run.poll() is None:
            time.sleep(0.05)
        begin = time.monotonic()
        strike(run)
    _, err = run.communicate(timeout=300.0)
    lines = [
        line for line in err.decode().splitlines() if not line.startswith(f"label {LABEL[0]}: ")
    ]  # progress
    return Seen(
        code=run.returncode,
        lines=lines,
        seconds=time.monotonic() - begin,
        shards=len(shards(folder)),
    )


def shards(folder: Path) -> dict[str, str]:
    """Digest of every shard."""
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.glob("shard-*"))
    }


def another_version(given: Faults, cluster: Cluster, folder: Path) -> Seen:
    """The head runs another version of Ray."""
    return label(cluster, folder, cluster.address, None)


def no_package(given: Faults, cluster: Cluster, folder: Path) -> Seen:
    """A node has Ray, and not the package."""
    cluster.node(str(given.bare_python))
    return label(cluster, folder, cluster.address, None)


def wrong_token(given: Faults, cluster: Cluster, folder: Path) -> Seen:
    """This machine has another token."""
    other = folder.parent / "other-token"
    other.write_text("0" * 48)
    return label(
        cluster,
        folder,
        cluster.address,
        None,
        cluster.environment | {"RAY_AUTH_TOKEN_PATH": str(other)},
    )


def raylet_killed(given: Faults, cluster: Cluster, folder: Path) -> Seen:
    """All raylets of this machine are killed."""
    cluster.node()
    return label(
        cluster,
        folder,
        cluster.address,
        lambda _: cluster.kill(*cluster.processes("raylet/raylet")),
    )


def head_killed(given: Faults, cluster: Cluster, folder: Path) -> Seen:
    """The head's own process is killed; nodes live on."""
    cluster.node()
    return label(
        cluster, folder, cluster.address, lambda _: cluster.kill(*cluster.processes("gcs_server"))
    )


def dead_head(given: Faults, cluster: Cluster, folder: Path) -> Seen:
    """The cluster that this machine belonged to is dead before the run."""
    cluster.kill(*cluster.processes("gcs_server"))
    time.sleep(1.0)
    return label(
        cluster,
        folder,
        "auto",
        None,
        cluster.environment | {"RAY_TMPDIR": str(folder.parent / "ray")},
    )


def node_lost(given: Faults, cluster: Cluster, folder: Path) -> Seen:
    """One of two nodes is killed."""
    cluster.node()
    cluster.node()
    return label(
        cluster,
        folder,
        cluster.address,
        lambda _: cluster.kill(cluster.processes("raylet/raylet")[-1]),
    )


def interrupted(given: Faults, cluster: Cluster, folder: Path) -> Seen:
    """Ctrl-C in a terminal, which every process of the run gets."""
    cluster.node()
    return label(cluster, folder, cluster.address, lambda run: os.killpg(run.pid, signal.SIGINT))


FAULTS: dict[str, tuple[Callable[[Faults, Cluster, Path], Seen], int]] = {
    "another version": (another_version, 2),
    "no package": (no_package, 2),
    "wrong token": (wrong_token, 2),
    "raylet killed": (raylet_killed, 2),
    "head killed": (head_killed, 2),
    "dead head behind auto": (dead_head, 2),
    "node lost": (node_lost, 0),
    "Ctrl-C": (interrupted, 130),
}
"""Every fault, and the exit status that it should lead to."""


def main(given: Faults) -> None:
    """Make every fault, print what came of it, and fail where it was more than a line, or rows
    differ.
    """
    needs = {"another version": given.old_python, "no package": given.bare_python}
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="f") as spare:
        whole = Path(spare) / "whole"
        subprocess.run([*alone(whole)], check=True, capture_output=True)
        for name, (fault, code) in FAULTS.items():
            if (given.only and name not in given.only) or (name in needs and needs[name] is None):
                continue
            for k in range(given.times):
                work = Path(spare) / f"{list(FAULTS).index(name)}{k}"
                work.mkdir()
                head = str(given.old_python) if name == "another version" else sys.executable
                cluster = Cluster(work, given.port, head)
                try:
                    seen = fault(given, cluster, work / "set")
                finally:
                    cluster.end()
                subprocess.run([*alone(work / "set")], check=True, capture_output=True)
                same = shards(work / "set") == shards(whole)
                fine = seen.code == code and len(seen.lines) <= 1 and same
                wrong += not fine
                print(
                    f"{name}, {k + 1}: exit {seen.code}, {seen.seconds:.1f} s, {seen.shards} shards of "
                    f"{len(shards(whole))} kept, then the same bytes: {same}; {len(seen.lines)} line(s): "
                    f"{' | '.join(seen.lines)[:400]}",
                    flush=True,
                )
    if wrong:
        raise SystemExit(f"{wrong} runs did not end as they should")


def alone(folder: Path) -> list[str]:
    """The same run on one process of this machine."""
    return [
        sys.executable,
        "-m",
        "stancekit.cli.main",
        "label",
        LABEL[0],
        str(folder),
        *LABEL[1:],
        "--workers",
        "1",
    ]


if __name__ == "__main__":
    launch(main, Faults, __doc__)
