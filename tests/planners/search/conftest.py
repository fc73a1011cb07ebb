"""What the tests of searches share: posture problems as courses of one frame, also with patches to
choose from.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.problem import Problem
from stancekit.planners.problem.problem import Foothold
from stancekit.planners.robot.model import Limb, Robot
from stancekit.planners.terrain import Patch


@pytest.fixture(scope="session")
def as_course() -> Callable[..., Problem]:
    """``as_course(problem, candidates=1, seed=0, spread_m=2e-3)``: a posture problem as a course of
    one frame.

    With more candidates the first is the problem's patch, and the others are it moved at random by
    up to ``spread_m``.
    """
    return _as_course


def _as_course(
    problem: Problem, candidates: int = 1, seed: int = 0, spread_m: float = 2e-3
) -> Problem:
    rng, contacts = np.random.default_rng(seed), problem.contacts
    assert problem.force_scale_n == problem.weight_n  # a course's force scale is the weight
    assert all((c.force_min == contacts[0].force_min).all() for c in contacts)
    assert all((c.force_max == contacts[0].force_max).all() for c in contacts)
    limbs = tuple(Limb(name=c.leg, shoulder_m=c.shoulder_m, reach_m=c.reach_m) for c in contacts)

    def moved(patch: Patch, r: int) -> Patch:
        return (
            replace(patch, vertices_m=patch.vertices_m + rng.uniform(-spread_m, spread_m, 3))
            if r
            else patch
        )

    footholds = tuple(
        Foothold(
            limb=c.leg, frame=0, candidates=tuple(moved(c.patch, r) for r in range(candidates))
        )
        for c in contacts
    )
    return Problem(
        name="posture",
        robot=Robot(name="posture", mass_kg=problem.mass_kg, limbs=limbs),
        terrain=tuple(patch for put in footholds for patch in put.candidates),
        footholds=footholds,
        lifts=((),),
        com_nominal_m=problem.com_nominal_m,
        com_radius_m=problem.com_radius_m,
        goal_m=problem.com_nominal_m[0],
        tilt_limit_rad=problem.tilt_limit_rad,
        gravity_m_s2=problem.gravity_m_s2,
        length_scale_m=problem.length_scale_m,
        force_min=contacts[0].force_min,
        force_max=contacts[0].force_max,
    )
