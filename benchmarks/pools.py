"""The data sets that ship: made, or made again and compared with those that are here, bit for bit.

    python benchmarks/pools.py --write     # into envs/pools
    python benchmarks/pools.py             # makes them, and says which bits differ

Each is what `stancekit label CLASS FOLDER --feasible 250 --infeasible 250 --seed 4100` makes of its
class, without the times that it took. Bits are the same with the versions that the header names, on
one kind of CPU.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from _bench import ROOT, Options, launch

from stancekit.envs.data.ledger import LabelPlan, pools
from stancekit.learners.data.labelling import label
from stancekit.planners.files.writing import write_bytes

CLASSES = ("ground-3", "wall-3", "wall-4", "wall-5")
ROWS, SEED = 250, 4100
FILES = ("header.json", "shard-00000.parquet")


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """What to do with them."""

    write: bool = False
    """Put them into envs/pools."""


def main(given: Arguments) -> None:
    """Make them; keep or compare."""
    differ = 0
    for name in CLASSES:
        with tempfile.TemporaryDirectory() as made:
            label(LabelPlan(distribution=name, feasible=ROWS, infeasible=ROWS, seed=SEED), made)
            contents = {file: (Path(made) / file).read_bytes() for file in FILES}
        pool = f"pool-{name}"
        if given.write:
            (ROOT / "envs" / "pools" / pool).mkdir(exist_ok=True)
            for file, content in contents.items():
                write_bytes(ROOT / "envs" / "pools" / pool / file, content)
        folder = pools().get(pool)
        same = folder is not None and all(
            (folder / file).read_bytes() == content for file, content in contents.items()
        )
        differ += not same
        given.say({"pool": pool, "bytes": sum(map(len, contents.values())), "the same": same})
    sys.exit(int(differ > 0))


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
