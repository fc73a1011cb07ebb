"""Forgeries: faults in honest postures, plans, walks and proofs, as small as twice the tolerance,
put to the verifier.

    python benchmarks/forgeries.py --each 20 [--only walks] [--markdown] [--json]

A kind is forged ``--each`` times, at sizes from twice the verifier's tolerance to ten times it. A
row a kind: how many were forged, how many of them a judge that shares no code with the verifier
calls inexecutable, how many the verifier accepts, and the group that refused most. Exit code 1 if
anything is accepted.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np
from _bench import Options, launch

from tests.forgeries import families


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """How many forgeries of a kind, and of which family."""

    each: int = 20
    only: Literal["all", "walks", "plans", "links", "postures", "proofs"] = "all"


def main(asked: Asked) -> int:
    """Forge, judge, verify and print."""
    kinds, total = 0, Counter[str]()
    for family in families.families():
        if asked.only not in ("all", family.name):
            continue
        for name, forge in family.kinds.items():
            groups = Counter[str]()
            row = dict.fromkeys(("forged", "inexecutable", "accepted"), 0)
            for number, size in enumerate(np.geomspace(2.0, 10.0, asked.each)):
                seeds = [number, len(name), *([asked.seed] if asked.seed else [])]
                thing = forge(float(size), np.random.default_rng(seeds))
                accepted, group = family.verdict(thing)
                row["forged"] += 1
                row["inexecutable"] += bool(family.judge(thing))
                row["accepted"] += accepted
                groups[group] += 1
            head = {"family": family.name, "kind": name}
            asked.say({**head, **row, "refused by": groups.most_common(1)[0][0]})
            kinds += 1
            total.update(row)
    asked.say({"kinds": kinds, **total})
    return int(total["accepted"] > 0)


if __name__ == "__main__":
    launch(main, Asked, __doc__)
