"""Labelling at scale: throughput and memory of a long run, killed and resumed; and a Ray cluster that loses a node.

python benchmarks/scale_out.py                                   # both, small
python benchmarks/scale_out.py --rows 100000 --kill-at 50 --only memory
python benchmarks/scale_out.py --rows 4000 --only cluster        # two nodes on this machine's loopback device
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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from _bench import Options, launch

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
    only: Literal["memory", "cluster"] | None = None
    folder: Path | None = None
    """Where to work; a temporary folder where there is none."""


def main(arguments: Arguments) -> None:
    """Measure, print, and fail where anything was lost or came twice."""
    given = replace(arguments, shard_size=arguments.shard_size or max(arguments.rows // 100, 1))
    with tempfile.TemporaryDirectory() as spare:
        folder = given.folder or Path(spare)
        folder.mkdir(parents=True, exist_ok=True)
        if given.only != "cluster":
            long_run(given, folder / "long")
        if given.only != "memory":
            try:
                import ray  # noqa: F401
            except ImportError:
                print("cluster: Ray is not installed, left out")
                return
            cluster_run(given, folder)


def start(given: Arguments, folder: Path, *options: str) -> subprocess.Popen[str]:
    """Label natural rows by the command line, in a process of its own."""
    command = [sys.executable, "-m", "stancekit.cli.main", "label", given.problem, str(folder), "--natural", "--json"]
    command += ["--feasible", str(given.rows), "--infeasible", "0", "--shard-size", str(given.shard_size), *options]
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
    print(f"memory: killed with SIGKILL after {time.perf_counter() - begin:.0f} s, {len(before)} shards written")
    killed = time.perf_counter()
    second = start(given, folder, *workers)
    while second.poll() is None:
        sample(second.pid, begin, memory)
    seconds = time.perf_counter() - begin
    summary = answer(second)
    kept = all(path.stat().st_mtime_ns == then for path, then in before.items())
    resumed = (given.rows - len(before) * given.shard_size) / (time.perf_counter() - killed)
    check(folder, given.rows)
    print(f"memory: {given.rows} rows in {seconds:.0f} s with {given.workers} workers, start-ups and kill included; "
          f"{resumed:.0f} rows/s after the resume; {summary['cpu_s_per_1000']:.2f} CPU-s per 1000")  # fmt: skip
    print(f"memory: resumed without touching a shard: {kept}; labels {summary['rows']}")
    for who, samples in sorted(memory.items()):
        seen = np.array(samples)
        warm = seen[:, 0] > killed - begin + 10.0
        parts = np.array_split(seen[warm, 1] if warm.sum() > 8 else seen[:, 1], 4)
        print(f"memory: {who}: peak {seen[:, 1].max():.0f} MB; in the quarters of the resumed run "
              f"{', '.join(f'{part.mean():.0f}' for part in parts)} MB")  # fmt: skip


def cluster_run(given: Arguments, folder: Path) -> None:
    """Two nodes of one processor each and a head without any; one node is killed mid-run."""
    from ray.cluster_utils import Cluster

    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    begin = time.perf_counter()
    alone = start(given, folder / "serial", "--workers", "1")
    answer(alone)
    print(f"cluster: serial run {time.perf_counter() - begin:.0f} s")
    node = {"node_ip_address": LOOPBACK, "object_store_memory": 100_000_000}
    with tempfile.TemporaryDirectory(prefix="ray") as scratch:
        head = {**node, "num_cpus": 0, "include_dashboard": False, "temp_dir": scratch}
        cluster = Cluster(initialize_head=True, head_node_args=head)
        try:
            nodes = [cluster.add_node(num_cpus=1, **node) for _ in range(given.workers)]
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
            print(f"cluster: one node of {given.workers} killed with {there} shards of {planned} written")
            reader.join()
        finally:
            cluster.shutdown()
    assert said, "the run on the cluster failed"
    check(folder / "cluster", given.rows)
    serial, clustered = (digests(folder / name) for name in ("serial", "cluster"))
    assert serial == clustered, "shards differ"
    print(f"cluster: finished in {time.perf_counter() - begin:.0f} s; all {len(serial) - 1} shards and the header are "
          "byte for byte those of the serial run")  # fmt: skip


def sample(parent: int, begin: float, memory: dict[str, list[tuple[float, float]]]) -> None:
    """Resident memory of a process and of the largest of its children [MB], Linux."""
    sizes = []
    for path in Path("/proc").glob("[0-9]*/status"):
        try:
            fields = dict(line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
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
        places.update(zip(table.column("shard").to_pylist(), table.column("row").to_pylist(), strict=True))
    assert len(data) == len(places) == rows, f"expected {rows} rows, got {len(data)}"
    assert set(places.values()) == {1}, "rows came twice"
    print(f"{folder.name}: {rows} rows, none lost, none twice")


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file but the times."""
    files = [path for path in sorted(folder.iterdir()) if not path.name.startswith("timing-")]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
