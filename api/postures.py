"""Posture problems, decided."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stancekit import Answer, InvalidInput, Problem, Robot
from stancekit.planners.arguments import checked
from stancekit.planners.equilibrium.programs import programs_of_this_thread
from stancekit.planners.formats.question_file import (
    read_envelopes as read_envelopes,
    read_problems as read_problems,
)
from stancekit.planners.robot.robot_file import robot_of
from stancekit.planners.search.answer import Kind, Method, Planner, kind_of
from stancekit.planners.search.methods import PlannerOptions, make_planner, through_verifier


@checked
def robot(source: str | Path, *, srdf: str | Path | None = None) -> Robot:
    """Read a robot: its limbs, what each foot surely reaches, and its own legs, joint by joint, in
    ``model``.

    Arguments:
        source: a name ("hexapod", "go1", ...; ``stancekit robot`` lists them), a ``.urdf`` file, or
            a ``.yaml`` file that names one and corrects it.
        srdf: pairs of links that may touch, and a posture to stand in.

    Returns:
        The ``Robot``, for ``plan``, ``walk``, ``sample``, ``label``, ``terrain``. What was guessed
        about it is in ``model.guesses`` and ``model.doubts``; the default hexapod is its limbs alone.

    Raises:
        InvalidInput: for an unknown name, a file of another kind, and a leg whose foot reaches
            nothing.
    Source:
        None: a URDF as it comes, with what a person corrects.

    Example:
        >>> import stancekit
        >>> stancekit.robot("hexapod").limb_names
        ('LF', 'LM', 'LR', 'RF', 'RM', 'RR')
    """
    return robot_of(source, srdf=srdf)


@checked
def solve(
    problem: Problem,
    method: str | Method | Planner = "exact",
    *,
    time_limit_s: float | None = None,
) -> Answer[Any]:
    """Can the robot hold this posture, and how?

    Or: which contacts and forces does a course have?

    Arguments:
        problem: limbs on patches, see ``Problem.posture``; or a course, whose joints and bodies
            only ``plan`` looks at.
        method: a value with its settings: ``Exact()`` branches and bounds to a verdict with
            evidence; ``TwoStage(...)`` relaxes, over learned envelopes or by the lift, and
            projects; ``Nlp()`` is IPOPT; ``Micp(...)`` a piecewise McCormick grid. Or text:
            "exact", "two-stage", "nlp", "micp" with the settings as they come, "lift"
            without the projection, a name that a package registered under ``stancekit.planners``,
            or "FILE.py:NAME". Or a planner that was made before, which keeps its compiled models
            from problem to problem (what one from elsewhere says counts as far as the verifier
            accepts it).
        time_limit_s: time limit for exact, nlp and micp, and for all of a course; the answer is
            undecided if it ends first. 30 by default, 60 for a course [s].

    Returns:
        An ``Answer``: feasible with a posture, of a course with a plan, its ``solution``, or
        infeasible with a certificate, each accepted by the verifier; else undecided. The status
        speaks of the problem itself, whatever relaxation was solved.

    Raises:
        InvalidInput: for an unknown method, a setting or a limit that it has no use for, envelopes
            that are missing or were learned for other problems, and a solver that is not installed.
    Source:
        Lin et al. §II (P, E1-E11), §III (P1, P2).

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> outcome = stancekit.solve(problem, stancekit.TwoStage(projection="fix-p"))
        >>> outcome.status.value, outcome.solution.toes_m.shape
        ('feasible', (3, 3))
    """
    of = kind_of(problem)
    if isinstance(method, str | Method):
        return planner_of(method, of=of, time_limit_s=time_limit_s).solve(problem)
    if time_limit_s is not None:
        raise InvalidInput(
            f"time_limit_s: expected none for a planner, which has its own, got {time_limit_s!r}"
        )
    return through_verifier(method, of).solve(problem)


def planner_of(
    method: str | Method,
    *,
    of: Kind = "postures",
    time_limit_s: float | None = None,
    **settings: Any,
) -> Planner:
    """The planner of a method, to be asked many problems; arguments as for ``solve``.

    Arguments:
        of: the kind of problem.
        settings: settings by name, for a method given as text; envelopes may be the ``Path`` of a
            file.

    Raises:
        InvalidInput: likewise.
    """
    if isinstance(settings.get("envelopes"), Path):
        settings["envelopes"] = read_envelopes(settings["envelopes"])
    options = PlannerOptions(of=of, time_limit_s=time_limit_s, programs=programs_of_this_thread())
    return make_planner(method, options, **settings)
