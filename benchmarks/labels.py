"""What labels cost: CPU seconds for 1,000 natural samples, writing included, and whether they are
those of before.

    python benchmarks/labels.py                                  # this tree alone python
    benchmarks/labels.py --against ../before --pairs 15   # in turns with another checkout, and row
    by row

Every figure is one process that labels after a warm-up. A yardstick is what 100 cold solves of one
fixed cone program take in the same process: divide by it to compare machines and hours.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _bench import Options, launch, spread
from _checkouts import checkouts, of_checkout

CHILD = """
import json, sys, time
from pathlib import Path
from _yardstick import yardstick
from stancekit.envs.data.ledger import LabelPlan
from stancekit.learners.data.labelling import label

kind, rows, balanced, folder = json.loads(sys.argv[1])
many = dict(feasible=rows // 2, infeasible=rows - rows // 2) if balanced else dict(feasible=rows, infeasible=0)
label(LabelPlan(distribution=kind, feasible=60, infeasible=0, natural=True, seed=12345),
      Path(folder) / "warm")
first = yardstick(100)
begin = time.process_time()
plan = LabelPlan(distribution=kind, natural=not balanced, seed=0, shard_size=500, **many)
summary = label(plan, Path(folder) / "set")
cpu = time.process_time() - begin
second = yardstick(100)
print(json.dumps({"cpu": cpu, "yard": 0.5 * (first + second), "drawn": summary.drawn.total, "p99": summary.solve_ms_p99,
                  "counts": summary.to_json()["drawn"]}))
"""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """What is labelled."""

    against: Path | None = None
    """Another checkout, to be measured in turns."""
    pairs: int = 3
    rows: int = 1000
    balanced: bool = False
    """Half feasible, half infeasible, as for training."""
    kinds: tuple[str, ...] = ("wall-3", "wall-5", "ground-3")


def main(given: Arguments) -> None:
    """Measure and print."""
    trees = checkouts(given.against)
    for kind in given.kinds:
        runs: dict[str, list[dict[str, float]]] = {name: [] for name in trees}
        for pair in range(given.pairs):
            with tempfile.TemporaryDirectory() as folder:
                order = list(trees) if pair % 2 == 0 else list(trees)[::-1]
                for name in order:
                    runs[name].append(
                        child(
                            trees[name],
                            [kind, given.rows, given.balanced, f"{folder}/{name}"],
                        )
                    )
                if pair == 0 and len(trees) == 2:
                    compare(kind, Path(folder) / "before" / "set", Path(folder) / "after" / "set")
        cpu = {
            name: np.array([1e3 * run["cpu"] / run["drawn"] for run in found])
            for name, found in runs.items()
        }
        for name, found in runs.items():
            yard = np.array([run["yard"] for run in found])
            print(
                f"{kind} {name:6}: {spread(cpu[name])} CPU-s per 1,000 samples, {spread(cpu[name] / yard)} "
                f"yardsticks of {np.median(yard):.3f} s; {found[0]['counts']}",
                flush=True,
            )
        if len(trees) == 2:
            print(
                f"{kind} pairs : before / after {spread(cpu['before'] / cpu['after'])}", flush=True
            )


def child(tree: Path, task: list[object]) -> dict[str, float]:
    """Label in a process of its own, with the packages of this tree."""
    environment = of_checkout(tree)
    environment["PYTHONPATH"] += f"{os.pathsep}{Path(__file__).parent}"
    words = [sys.executable, "-c", CHILD, json.dumps(task)]
    run = subprocess.run(words, capture_output=True, text=True, env=environment, check=False)
    assert run.returncode == 0, run.stderr
    return dict(json.loads(run.stdout.splitlines()[-1]))


def compare(kind: str, before: Path, after: Path) -> None:
    """Row by row: problems, labels, and how far apart the numbers are that selectors learn from."""
    from stancekit.envs.data.dataset import Dataset

    old, new = Dataset.open(before), Dataset.open(after)
    same = labels = points = proofs = 0
    apart = 0.0
    for mine, theirs in zip(new.rows(), old.rows(), strict=True):
        same += mine.problem.to_json() == theirs.problem.to_json() and mine.sample == theirs.sample
        labels += mine.kind == theirs.kind
        trees = [
            None if row.certificate is None else row.certificate.tree for row in (mine, theirs)
        ]
        proofs += all(tree is not None for tree in trees) and np.array_equal(*trees)
        if mine.point is not None and theirs.point is not None:
            off = float(np.abs(mine.point - theirs.point).max())
            points += off < 1e-6
            apart = max(apart, off)
    of = sum(row.point is not None for row in new.rows())
    print(
        f"{kind} rows  : {len(new)}, equal problems {same}, equal labels {labels}, equal trees {proofs}; "
        f"points [p, f]: {points} of {of} within 1e-6, the farthest {apart:.2g} apart",
        flush=True,
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
