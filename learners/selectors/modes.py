"""Envelopes for mode switching (Lin et al. §IV-A, end): a box a terrain over [p, f], the forces in
world axes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.distributions.postures import distribution
from stancekit.envs.distributions.stance import LAW
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.boxes import Modes, world_points
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.search.exact import Exact

from .selector import quantile_box

_MODES = {"ground": "ground", "wall": "wall", "terrain": "ground"}
"""Name of a mode over the scenes of each law."""


def modes_of(datasets: Sequence[Dataset], *, share: float = 0.0) -> Modes:
    """A mode a data set, in their order: the quantile box around S of Algorithm E1, the forces in
    world axes.

    The modes are named after the terrains of the distributions, or after these where they do not
    say theirs.

    Arguments:
        share: of the points left out on each side of each dimension; with none a box is the
            exterior boundary of Algorithm E2.

    Raises:
        InvalidInput: for fewer than two data sets, for different limbs, and for one without
            feasible rows.
    """
    if len(datasets) < 2:
        raise InvalidInput(f"data sets: expected two or more, one a mode, got {len(datasets)}")
    samples = dict[str, tuple[Sequence[Problem], Sequence[Envelope]]]()
    for rows in datasets:
        name, legs, first = rows.problem_class, rows.header.legs, datasets[0].header.legs
        if legs != first:
            raise InvalidInput(
                f"data sets: expected all on {', '.join(first)}, got {name} on {', '.join(legs)}"
            )
        problems = list(rows.select(rows.feasible).problems())
        if not problems:
            raise InvalidInput(f"data sets: expected feasible rows of {name}, got none")
        law = LAW.fullmatch(rows.header.plan.distribution)
        terrain = _MODES[law[1]] if law else getattr(distribution(name), "terrain", name)
        if terrain in samples:
            raise InvalidInput(f"data sets: expected one a terrain, got two of {terrain}")
        samples[terrain] = (
            problems,
            [quantile_box(world_points(problems, rows.points), share=share)],
        )
    return Modes.around(samples)


def solved_postures(
    name: str, count: int, planner: Exact, rng: np.random.Generator
) -> tuple[list[Problem], Array]:
    """Feasible problems of a distribution as they come, and the point [p, f] of a witness each,
    shape (K, N, 6).
    """
    source = distribution(name)
    problems, points = list[Problem](), list[Array]()
    while len(points) < count:
        problem = source.sample(rng)
        posture = planner.solve(problem).solution
        if posture is not None:
            problems.append(problem)
            points.append(Scaled.of(problem).point(posture))
    return problems, np.array(points)
