"""Forgeries: faults in honest postures, plans, walks and proofs, as small as twice the tolerance,
put to the verifier.

``python benchmarks/forgeries.py --each 20 [--only walks]``. A kind is forged ``--each`` times, at
sizes from twice the verifier's tolerance to ten times it. A row a kind: how many were forged, how
many of them a judge that shares no code with the verifier calls inexecutable, how many the verifier
accepts, and the group that refused most. Exit code 1 if anything is accepted.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from tests.forgeries import families


def main() -> int:
    """Forge, judge, verify and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--each", type=int, default=20)
    parser.add_argument("--only", default="", help="walks, plans, links, postures or proofs")
    arguments = parser.parse_args()
    kinds, forged, judged, accepted = 0, 0, 0, 0
    for family in families.families():
        if arguments.only not in ("", family.name):
            continue
        for name, forge in family.kinds.items():
            groups, row = Counter[str](), Counter[str]()
            for number, size in enumerate(np.geomspace(2.0, 10.0, arguments.each)):
                thing = forge(float(size), np.random.default_rng([number, len(name)]))
                said, group = family.verdict(thing)
                row["forged"] += 1
                row["inexecutable"] += bool(family.judge(thing))
                row["accepted"] += said
                groups[group] += 1
            print(
                json.dumps(
                    {
                        "family": family.name,
                        "kind": name,
                        **row,
                        "refused by": groups.most_common(1)[0][0],
                    }
                )
            )
            kinds, forged = kinds + 1, forged + row["forged"]
            judged, accepted = judged + row["inexecutable"], accepted + row["accepted"]
    print(
        json.dumps({"kinds": kinds, "forged": forged, "inexecutable": judged, "accepted": accepted})
    )
    return int(accepted > 0)


if __name__ == "__main__":
    raise SystemExit(main())
