"""What the tests of projections share: points off the bilinear surface to start from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.problem import PostureProblem
from stancekit.planners.relaxation.lift import solve_lift

Start = tuple[PostureProblem, Scaled, Point]


@pytest.fixture(scope="session")
def starts(programs: Programs, drawn, mixed) -> list[Start]:
    """(problem, scaled, a point of P̄) of scenes that P̄ admits; the point is off the bilinear surface.

    It lies half-way between two of the lift's, one of which has random toes, where these can be reached.
    """
    found, rng = list[Start](), np.random.default_rng(0)
    scenes = [drawn(name, seed) for name in ("wall-3", "ground-3") for seed in range(30)]
    for problem in [*scenes, *(mixed(seed, (3, 4, 5)) for seed in range(20))]:
        scaled = Scaled.of(problem)
        lifted = solve_lift(programs, scaled, least_moment=True)
        if np.isfinite(lifted.bound):
            one, part = lifted.rounded()[1], scaled
            for i, piece in enumerate(scaled.pieces):
                part = part.with_piece(i, rng.dirichlet(np.ones(len(piece)), 1) @ piece)
            aside = solve_lift(programs, part, least_moment=True)
            other = aside.rounded()[1] if np.isfinite(aside.bound) else one
            names = ("com", "rotation", "toes", "forces")
            middle = {name: 0.5 * (getattr(one, name) + getattr(other, name)) for name in names}
            found.append((problem, scaled, replace(one, **middle)))
    assert len(found) >= 40
    return found
