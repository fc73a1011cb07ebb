"""Posture problems: draw them, decide them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from stancekit.planners.answer.outcome import Outcome
from stancekit.planners.arguments import checked
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.problem import PostureProblem
from stancekit.planners.problem.posture import Sampler
from stancekit.planners.projection.project import Projection
from stancekit.planners.relaxation.envelope import EnvelopeSet
from stancekit.planners.search.answer import Planner
from stancekit.planners.search.methods import PlannerOptions, Solver, make_planner, through_verifier

MADE = "a planner that was made before"

MOST_PROBLEMS = 1_000_000
"""Problems drawn into memory at once."""


@checked
def sample(
    problems: str | Sampler,
    count: int = 1,
    *,
    robot: str | Path | None = None,
    terrain: str | Path | None = None,
    rng: np.random.Generator | int = 0,
) -> list[PostureProblem]:
    """Draw posture problems from a distribution of terrains.

    Arguments:
        problems: something with ``sample(rng)``, or the name of a distribution: "ground-k" and "wall-k" (k limbs on the
            ground or on two facing walls; paper E has "ground-3", "wall-3", "wall-5"), "terrain-k" (cut from
            ``terrain``), one that a package registered under the entry point ``stancekit.distributions``,
            "FILE.py:NAME", or a YAML file.
        count: how many, 1 or more.
        robot: whose limbs they are, a built-in name, a .urdf file, or a .yaml file that names one; with a name only.
        terrain: a mesh or a grid; with "terrain-k".
        rng: a generator, or a seed; equal seeds give equal problems.
    Returns:
        ``count`` independent problems.
    Raises:
        InvalidInput: for a name that there is not, or a count below 1 or above a million.
    Source:
        Paper E §IV-A, G(θ).
    Example:
        >>> import stancekit
        >>> first, second = stancekit.sample("wall-3", 2, rng=7)
        >>> first.legs
        ('RF', 'RR', 'LM')
    """
    checked_int(count, "count", least=1, most=MOST_PROBLEMS)
    from stancekit.envs.distributions.postures import distribution_of  # loads Gymnasium

    source = distribution_of(problems, robot=robot, terrain=terrain)
    if not isinstance(rng, np.random.Generator) and rng < 0:
        raise InvalidInput(f"rng: expected a generator or a seed of 0 or more, got {rng}")
    drawn = np.random.default_rng(rng)
    return [source.sample(drawn) for _ in range(count)]


@checked
def solve(
    problem: PostureProblem,
    method: str | Planner = "exact",
    *,
    envelopes: EnvelopeSet | None = None,
    projection: Projection | None = None,
    solver: Solver = "highs",
    intervals: int = 4,
    time_limit_s: float | None = None,
    engine: Literal["rows", "cvxpy"] = "rows",
) -> Outcome:
    """Can the robot hold this posture, and how?

    Arguments:
        problem: limbs on patches, see ``PostureProblem``.
        method: "exact" branches and bounds to a verdict with evidence; "p1" is the relaxation over ``envelopes``;
            "lift" one without envelopes; "two-stage" relaxation and projection; "nlp" IPOPT; "micp" a piecewise
            McCormick grid. Or a planner that was made before, which keeps its compiled models from problem to problem
            (what one from elsewhere says counts as far as the verifier accepts it), the name of one that a package
            registered under ``stancekit.planners``, or "FILE.py:NAME".
        envelopes: learned boxes, for p1, two-stage and micp.
        projection: stage P2 after p1, lift and two-stage: "fix-p", "fix-f", "fix-toes", "scp", "nlp" or
            "lift-fix-p".
        solver, intervals: of micp's grid, whose axes have so many pieces, a power of two.
        time_limit_s: for exact, nlp and micp; what is not decided by then is undecided; 30 where None [s].
        engine: "rows", written for speed, or "cvxpy", the same programs as the paper has them.
    Returns:
        An ``Outcome``: feasible with a posture, or infeasible with a certificate, each accepted by the verifier; else
        undecided. The status speaks of the problem itself, whatever relaxation was solved.
    Raises:
        InvalidInput: for an unknown method, an option that the method has no use for (a planner that was made before
            has use for none), envelopes that are missing or were learned for other problems, and a solver that is not
            installed.
    Source:
        Paper E §II (P, E1-E11), §III (P1, P2).
    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> outcome = stancekit.solve(problem)
        >>> outcome.status.value, outcome.posture.toes_m.shape
        ('feasible', (3, 3))
    """
    if envelopes is not None:
        envelopes.check_fits(problem)
    options = PlannerOptions(
        envelopes=envelopes, projection=projection, solver=solver, intervals=intervals, time_limit_s=time_limit_s
    )
    if isinstance(method, str):
        return make_planner(method, replace(options, programs=Programs(engine=engine))).solve(problem)
    options.check_used(MADE, ())
    if engine != "rows":
        raise InvalidInput(f"engine: expected none for {MADE}, which has no use for it, got {engine!r}")
    return through_verifier(method).solve(problem)
