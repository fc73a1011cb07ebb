"""What the tests of projections share: points off the bilinear surface to start from, and the plan
of a quadruped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from tests.planners.robot.small_urdfs import quadruped

DOG = """
name: flat
robot: dog.urdf
frames: 5
gait: [[LH], [LF], [RH], [RF]]
start_m: [0.0, 0.0]
goal_m: [0.2, 0.0, 0.45]
steps: {com_m: 0.12, toe_m: 0.4}
terrain: {kind: flat, friction: 0.7}
"""
Start = tuple[Problem, Scaled, Point]


@pytest.fixture(scope="session")
def starts(programs: Programs, drawn, mixed) -> list[Start]:
    """(problem, scaled, a point of P̄) of scenes that P̄ admits; the point is off the bilinear
    surface.

    It lies half-way between two of the lift's, one of which has random toes, where these can be
    reached.
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


@pytest.fixture(scope="session")
def dog_plan(tmp_path_factory: pytest.TempPathFactory) -> Motion:
    """A quadruped of a file of its own walks on level ground."""
    folder = tmp_path_factory.mktemp("course")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.yaml").write_text(DOG)
    outcome = plan_with_reserve(TwoStage(), read_course(folder / "flat.yaml"))
    assert outcome.solution is not None
    return outcome.solution
