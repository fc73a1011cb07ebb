"""Labelling at scale: throughput and memory of a long run, killed and resumed; a Ray cluster that
loses a node; the time of nodes beside that of as many processes; and what each node of a cluster
got to do.

    python benchmarks/scale_out.py    # all, small
    python benchmarks/scale_out.py --rows 100000 --kill-at 50 --only memory
    # two nodes on this machine's loopback device
    python benchmarks/scale_out.py --rows 4000 --only cluster
    python benchmarks/scale_out.py --rows 4000 --only pairs --pairs 5
    python benchmarks/scale_out.py --rows 400 --only shares --workers 4
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from _bench import Options, launch, spread

from stancekit.learners.data.executors import Answer, Executor, Task

LOOPBACK = "127.0.0.2"  # Ray replaces 127.0.0.1 by the machine's address


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """How much, and where."""

    problem: str = "wall-3"
    rows: int = 4000
    """Natural rows to label."""
    shard_size: int = 0
    """Rows a shard; 0: a hundredth of the rows."""
    workers: int = 2
    """Processes, and Ray nodes of one processor each."""
    kill_at: float = 40.0
    """Per cent of the shards at which SIGKILL comes."""
    pairs: int = 3
    """Runs on processes and runs on nodes whose times are compared, in turn."""
    only: Literal["memory", "cluster", "pairs", "shares"] | None = None
    folder: Path | None = None
    """Where to work; a temporary folder where there is none."""


def main(arguments: Arguments) -> None:
    """Measure, print, and fail where anything was lost or came twice."""
    given = replace(arguments, shard_size=arguments.shard_size or max(arguments.rows // 100, 1))
    with tempfile.TemporaryDirectory() as spare:
        folder = given.folder or Path(spare)
        folder.mkdir(parents=True, exist_ok=True)
        if given.only in ("memory", None):
            long_run(given, folder / "long")
        if given.only != "memory":
            try:
                import ray  # noqa: F401
            except ImportError:
                print("cluster: Ray is not installed, left out")
                return
        if given.only in ("cluster", None):
            cluster_run(given, folder)
        if given.only in ("pairs", None):
            paired_runs(given, folder)
        if given.only in ("shares", None):
            shared_run(given, folder)


def start(given: Arguments, folder: Path, *options: str) -> subprocess.Popen[str]:
    """Label natural rows by the command line, in a process of its own."""
    command = [
        sys.executable,
        "-m",
        "stancekit.cli.main",
        "label",
        given.problem,
        str(folder),
        "--natural",
        "--json",
    ]
    command += [
        "--feasible",
        str(given.rows),
        "--infeasible",
        "0",
        "--shard-size",
        str(given.shard_size),
        *options,
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def long_run(given: Arguments, folder: Path) -> None:
    """Throughput, memory over time, kill -9 and resume."""
    workers = ("--workers", str(given.workers))
    memory: dict[str, list[tuple[float, float]]] = defaultdict(list)
    begin = time.perf_counter()
    first = start(given, folder, *workers)
    wanted = given.kill_at / 100.0 * given.rows / given.shard_size
    while first.poll() is None and shards(folder) < wanted:
        sample(first.pid, begin, memory)
    first.send_signal(signal.SIGKILL)
    first.wait()
    before = {path: path.stat().st_mtime_ns for path in folder.glob("shard-*.parquet")}
    print(
        f"memory: killed with SIGKILL after {time.perf_counter() - begin:.0f} s, {len(before)} shards written"
    )
    killed = time.perf_counter()
    second = start(given, folder, *workers)
    while second.poll() is None:
        sample(second.pid, begin, memory)
    seconds = time.perf_counter() - begin
    summary = answer(second)
    kept = all(path.stat().st_mtime_ns == then for path, then in before.items())
    resumed = (given.rows - len(before) * given.shard_size) / (time.perf_counter() - killed)
    check(folder, given.rows)
    print(
        f"memory: {given.rows} rows in {seconds:.0f} s with {given.workers} workers, start-ups and kill included; "
        f"{resumed:.0f} rows/s after the resume; {summary['cpu_s_per_1000']:.2f} CPU-s per 1000"
    )
    print(f"memory: resumed without touching a shard: {kept}; labels {summary['rows']}")
    for who, samples in sorted(memory.items()):
        seen = np.array(samples)
        warm = seen[:, 0] > killed - begin + 10.0
        parts = np.array_split(seen[warm, 1] if warm.sum() > 8 else seen[:, 1], 4)
        print(
            f"memory: {who}: peak {seen[:, 1].max():.0f} MB; in the quarters of the resumed run "
            f"{', '.join(f'{part.mean():.0f}' for part in parts)} MB"
        )


@contextmanager
def cluster_of(nodes: int) -> Iterator[tuple[Any, list[Any]]]:
    """A head without any processor, and nodes of one each, on this machine."""
    from ray.cluster_utils import Cluster

    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    node = {"node_ip_address": LOOPBACK, "object_store_memory": 100_000_000}
    with tempfile.TemporaryDirectory(prefix="ray") as scratch:
        head = {**node, "num_cpus": 0, "include_dashboard": False, "temp_dir": scratch}
        cluster = Cluster(initialize_head=True, head_node_args=head)
        try:
            yield cluster, [cluster.add_node(num_cpus=1, **node) for _ in range(nodes)]
        finally:
            cluster.shutdown()


def cluster_run(given: Arguments, folder: Path) -> None:
    """Two nodes of one processor each and a head without any; one node is killed mid-run."""
    begin = time.perf_counter()
    alone = start(given, folder / "serial", "--workers", "1")
    answer(alone)
    print(f"cluster: serial run {time.perf_counter() - begin:.0f} s")
    with cluster_of(given.workers) as (cluster, nodes):
        begin = time.perf_counter()
        run = start(given, folder / "cluster", "--executor", "ray", "--address", cluster.address)
        said: list[dict[str, object]] = []
        reader = threading.Thread(target=lambda: said.append(answer(run)))
        reader.start()
        wanted = given.kill_at / 100.0 * given.rows / given.shard_size
        while shards(folder / "cluster") < wanted and reader.is_alive():
            time.sleep(0.05)
        there = shards(folder / "cluster")
        cluster.remove_node(nodes[-1], allow_graceful=False)
        planned = -(-given.rows // given.shard_size)
        print(
            f"cluster: one node of {given.workers} killed with {there} shards of {planned} written"
        )
        reader.join()
    assert said, "the run on the cluster failed"
    check(folder / "cluster", given.rows)
    serial, clustered = (digests(folder / name) for name in ("serial", "cluster"))
    assert serial == clustered, "shards differ"
    print(
        f"cluster: finished in {time.perf_counter() - begin:.0f} s; all {len(serial) - 1} shards and the header are "
        "byte for byte those of the serial run"
    )


def paired_runs(given: Arguments, folder: Path) -> None:
    """The same rows on processes and on nodes of one processor, in turn, and the other way round
    every other time.
    """
    times: dict[str, list[list[float]]] = {"processes": [], "nodes": []}
    with cluster_of(given.workers) as (cluster, _):
        where = {
            "processes": ("--workers", str(given.workers)),
            "nodes": ("--executor", "ray", "--address", cluster.address),
        }
        for k in range(given.pairs):
            for name in sorted(where, reverse=k % 2 == 0):
                begin = time.time()
                answer(start(given, folder / f"{name}-{k}", *where[name]))
                end = time.time()
                written = sorted(
                    path.stat().st_mtime
                    for path in (folder / f"{name}-{k}").glob("shard-*.parquet")
                )
                times[name].append([end - begin, written[-1] - written[0]])
            assert digests(folder / f"processes-{k}") == digests(folder / f"nodes-{k}"), (
                "shards differ"
            )
            pair = "; ".join(
                f"{name} {each[-1][0]:.1f} s, {each[-1][1]:.1f} s" for name, each in times.items()
            )
            print(f"pairs: {k + 1}: {pair} from the first shard to the last", flush=True)
    nodes, processes = np.array(times["nodes"]), np.array(times["processes"])
    print(
        f"pairs: {given.rows} rows on {given.workers} nodes of one processor and on as many processes: the same "
        f"bytes {given.pairs} times of {given.pairs}"
    )
    for k, what in enumerate(
        ("all of a run, start and end too", "from the first shard to the last")
    ):
        print(
            f"pairs: {what}: nodes {spread(nodes[:, k])} s, processes {spread(processes[:, k])} s, "
            f"ratio {spread(nodes[:, k] / processes[:, k])}"
        )


def shared_run(given: Arguments, folder: Path) -> None:
    """How many tasks each node of a cluster got, and how long it worked; shards are of the default
    size.
    """
    from stancekit.envs.data.ledger import LabelPlan
    from stancekit.learners.data.executors import executor
    from stancekit.learners.data.labelling import label

    plan = LabelPlan(distribution=given.problem, feasible=given.rows, infeasible=0, natural=True)
    with cluster_of(given.workers) as (cluster, nodes):
        seen = Noted(executor("ray", address=cluster.address))
        begin = time.perf_counter()
        label(plan, folder / "shared", run=seen)
        seconds = time.perf_counter() - begin
    label(plan, folder / "unshared")
    assert digests(folder / "shared") == digests(folder / "unshared"), "shards differ"
    counts = [f"{len(each)} tasks, {sum(each):.1f} s" for each in seen.worked.values()]
    print(
        f"shares: {given.rows} rows in {plan.shards} shards of at most {plan.shard_size}, {seconds:.1f} s with Ray's "
        f"start; {len(counts)} of {len(nodes)} nodes worked: {'; '.join(counts)}; "
        "the same bytes as in one process"
    )


class Noted:
    """An executor on a Ray cluster, and for how long each node worked at each of its tasks [s]."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self.worked: dict[str, list[float]] = defaultdict(list)

    @property
    def workers(self) -> int:
        """Tasks that run at a time."""
        return self._executor.workers

    def __call__(self, tasks: Iterable[Task[Answer] | None]) -> Iterator[Answer]:
        """Run them."""
        for node, seconds, answer in self._executor(
            None if task is None else partial(located, task) for task in tasks
        ):
            self.worked[node].append(seconds)
            yield answer


def located(task: Task[Answer]) -> tuple[str, float, Answer]:
    """On which node a task ran, for how long, and its answer."""
    import ray

    begin = time.perf_counter()
    answer = task()
    return ray.get_runtime_context().get_node_id(), time.perf_counter() - begin, answer


def sample(parent: int, begin: float, memory: dict[str, list[tuple[float, float]]]) -> None:
    """Resident memory of a process and of the largest of its children [MB], Linux."""
    sizes = []
    for path in Path("/proc").glob("[0-9]*/status"):
        try:
            fields = dict(
                line.split(":", 1) for line in path.read_text().splitlines() if ":" in line
            )
        except OSError:
            continue
        size = float(fields.get("VmRSS", "0 kB").split()[0]) / 1e3
        if int(path.parent.name) == parent:
            memory["parent"].append((time.perf_counter() - begin, size))
        elif int(fields["PPid"]) == parent:
            sizes.append(size)
    if sizes:
        memory["largest worker"].append((time.perf_counter() - begin, max(sizes)))
    time.sleep(0.5)


def shards(folder: Path) -> int:
    """Shards that are there."""
    return sum(1 for _ in folder.glob("shard-*.parquet"))


def answer(run: subprocess.Popen[str]) -> dict[str, object]:
    """What a run printed; it must have ended well."""
    out, err = run.communicate()
    assert run.returncode == 0, err
    return json.loads(out.splitlines()[-1])


def check(folder: Path, rows: int) -> None:
    """Every planned row once."""
    from stancekit.envs.data.dataset import Dataset

    data = Dataset.open(folder)
    places: Counter[tuple[int, int]] = Counter()
    for shard in range(data.header.plan.shards):
        table = data.ledger.read(shard, ["shard", "row"])
        places.update(
            zip(table.column("shard").to_pylist(), table.column("row").to_pylist(), strict=True)
        )
    assert len(data) == len(places) == rows, f"expected {rows} rows, got {len(data)}"
    assert set(places.values()) == {1}, "rows came twice"
    print(f"{folder.name}: {rows} rows, none lost, none twice")


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file but the times."""
    files = [path for path in sorted(folder.iterdir()) if not path.name.startswith("timing-")]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
