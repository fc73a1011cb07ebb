"""Margins of stances in processor time, beside the polytopes of hpp-centroidal-dynamics.

    python benchmarks/margins.py [--json]

CPU microseconds per stance, the least of five runs: support margins whose bounds are 1 mm apart, of
batches of 10,000 to 1 stances asked by ``stancekit.margins``, where its loops are compiled. Stances
are those of ``tests/planners/verify/test_stance_margin.py``, 500 of each number of contacts, which
repeat. Of hpp-centroidal-dynamics, where it can be imported, the polytope from which a margin
follows, with 4 and 16 edges a cone and one friction, over the first five stances; it bounds no
forces. More than 64 edges in all are left out: they take minutes.
"""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec
from time import process_time
from timeit import repeat
from typing import Any

import numpy as np
from _bench import Options, launch

import stancekit
from tests.planners.verify.test_stance_margin import stances


def main(given: Options) -> None:
    """A row for each number of contacts; the largest batch comes first and compiles the loops."""
    for n in (3, 4, 6, 8):
        drawn = {
            name: np.resize(of, (10_000, *of.shape[1:])) for name, of in stances(n, 500).items()
        }
        row: dict[str, Any] = {"contacts": n}
        for count, times in ((10_000, 1), (1000, 1), (64, 10), (1, 100)):
            asked = partial(stancekit.margins, **{name: of[:count] for name, of in drawn.items()})
            row[f"{count:,}"] = round(least_us(partial(asked, tolerance=1e-3), times) / count)
        for edges in (4, 16) if find_spec("hpp_centroidal_dynamics") else ():
            row[f"hpp, {edges} edges"] = (
                round(least_us(partial(polytopes, drawn, edges), 1) / 5) if n * edges <= 64 else "–"
            )
        given.say(row)


def least_us(call: Any, times: int) -> float:
    """Processor time of a call, the least of five runs."""
    return 1e6 * min(repeat(call, number=times, repeat=5, timer=process_time)) / times


def polytopes(drawn: dict[str, Any], edges: int) -> None:
    """Those of five stances by hpp-centroidal-dynamics."""
    import hpp_centroidal_dynamics as hpp  # which few have

    for i in range(5):
        of, arms = hpp.Equilibrium("", 1.0, edges), drawn["subject"][i] - drawn["com_m"][i]
        if of.setNewContacts(
            arms,
            drawn["normals"][i],
            float(drawn["friction"][i].min()),
            hpp.EquilibriumAlgorithm.EQUILIBRIUM_ALGORITHM_PP,
        ):
            of.getPolytopeInequalities()


if __name__ == "__main__":
    launch(main, Options, __doc__)
