"""Answers: check them anew, and say why there is none."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np

from stancekit import (
    Answer,
    Certificate,
    Dataset,
    FileCheck,
    InvalidInput,
    Leap,
    LeapTries,
    Motion,
    Problem,
    RecheckReport,
    Report,
    Status,
)
from stancekit.planners.answer.motion import Evidence
from stancekit.planners.arguments import checked, settings_from
from stancekit.planners.files.arrays import checked as checked_number
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.verify import Explanation, explain as explain_proof
from stancekit.planners.verify.judge import TOLERANCE, judge
from stancekit.planners.verify.margins import stances_of
from stancekit.planners.verify.stance_margin import Margins, places, pushes, stances_from

from .checks import check_file, check_rows, check_unused

E = TypeVar("E", bound=Evidence)


@checked
def explain(subject: Answer[Any] | Certificate, *, tolerance: float | None = None) -> Explanation:
    """Why is there no posture, or no plan: how far each single parameter must change before the
    certificate fails.

    Parameters of a posture problem: friction, reach and largest normal force of each contact, COM
    radius, tilt limit, the cheapest growth first. Of a course, for its weakest leaf: the limits of
    E11, reach, COM radius and friction where the proof pulls most, the one that changes least
    relative to what it is first. Of a leap: friction under every toe, and reach of every limb.

    Arguments:
        subject: an answer of ``solve``, ``plan`` or ``walk`` that is not feasible; or a certificate,
            which knows its problem. Of what is undecided, the message is the answer's own, and there
            are no relaxations: nothing is proved.
        tolerance: largest moment residual that a proof leaves open, non-dimensional; the verifier's
            own where None.

    Returns:
        An ``Explanation``: ``message`` in one line, and ``relaxations``, what each parameter would
        have to become at least. A certificate that is not accepted explains nothing: no
        relaxations, and the message says why.

    Raises:
        InvalidInput: for an answer that is feasible, and a certificate that does not know its
            problem. A bad certificate is refused in the message.
    Source:
        Lagrangian bounds of E1-E11.

    Example:
        >>> import stancekit
        >>> outcome = stancekit.solve(stancekit.sample("wall-3", rng=8)[0])
        >>> stancekit.explain(outcome).relaxations[0].parameter
        'friction'
    """
    if isinstance(subject, Answer):
        certificate = _proof(subject)
        if certificate is None and subject.status is Status.UNDECIDED:
            return Explanation(relaxations=(), message=subject.message or subject.claim)
        if certificate is None:
            raise InvalidInput(
                f"explain: expected an answer that is infeasible or undecided, got one that is {subject.status}"
            )
    else:
        certificate = subject
    if isinstance(certificate.problem, Leap) and tolerance is not None:
        raise InvalidInput(
            "tolerance: expected none with a leap, whose proofs leave no residual open"
        )
    return explain_proof(certificate, tolerance=tolerance)


@overload
def verify(subject: E, *, tolerance: float = TOLERANCE, margins: bool = False) -> Report[E]: ...
@overload
def verify(
    subject: Answer[Any], *, tolerance: float = TOLERANCE, margins: bool = False
) -> Report[Any]: ...
@overload
def verify(subject: Dataset | LeapTries) -> RecheckReport: ...
@overload
def verify(
    subject: str | Path,
    *,
    tolerance: float = TOLERANCE,
    robot: str | Path | None = None,
    course: str | None = None,
    terrain: str | Path | None = None,
    explain: bool = False,
    margins: bool = False,
    **meaning: object,
) -> FileCheck | RecheckReport: ...
@checked
def verify(
    subject: Answer[Any] | Evidence | Dataset | LeapTries | str | Path,
    *,
    tolerance: float = TOLERANCE,
    robot: str | Path | None = None,
    course: str | None = None,
    terrain: str | Path | None = None,
    explain: bool = False,
    margins: bool = False,
    **meaning: object,
) -> Report[Any] | RecheckReport | FileCheck:
    """Check an answer anew, by code that knows the problem and nothing of how the answer was made,
    without a solver.

    Arguments:
        subject: what ``solve``, ``plan`` or ``walk`` returned; or what carries its question: a
            certificate, a plan of key frames, of one or of a leap, a gait trajectory, a data set,
            the file of a plan, a proof, a leap or a gait, the folder of a data set or the name of
            one that ships.
        tolerance: largest violation of a constraint by an accepted posture or plan,
            non-dimensional. Certificates and walks have limits of their own.
        robot: name or file of the robot that the plan or walk in a file must be for.
        course: course that the plan in a file must be for, as ``plan`` takes it; for the file of a
            motion, the course whose patches are the terrain.
        terrain: terrain for the file of a motion from elsewhere (.csv, .npz, JointTrajectory,
            MuJoCo's .xml): heights by name or file, or the file of a plan or a walk, whose ground
            it is; for a contact sequence (.csv, .npz) a ground by name or file.
        explain: of a proof's file, say what would have to give; of a contact sequence's, look for
            the nearest that holds.
        margins: measure what every stance of a plan bears beyond its weight, and say the least.
        meaning: fields of ``ImportOptions`` that say what the numbers of the terrain's file mean,
            as for ``terrain``.

    Returns:
        A report: ``accepted``, and what is violated, where and by how much; of a file a
        ``FileCheck`` with one.

    Raises:
        InvalidInput: for an option that has no use for what is judged. A bad answer is refused in
            the report, and not raised.
    Source:
        E1-E11; W2-W7, between the knots, too.

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.verify(stancekit.solve(problem).solution).accepted
        True
    """
    options = settings_from(
        ImportOptions,
        meaning,
        beside=("subject", "tolerance", "robot", "course", "terrain", "explain", "margins"),
    )
    if isinstance(subject, str | Path) and os.path.isfile(subject):
        of_file: Any = {"robot": robot, "course": course, "terrain": terrain, "why": explain}
        of_file |= {"margins": margins, "options": options}
        return check_file(subject, tolerance=tolerance, **of_file)
    check_unused("no file", robot=robot, course=course, terrain=terrain, explain=explain, **meaning)
    evidence = _evidence(subject) if isinstance(subject, Answer) else subject
    if isinstance(problem := getattr(evidence, "problem", None), Problem):
        problem.check_whole()
    if not isinstance(evidence, Evidence):
        return check_rows(evidence, tolerance=tolerance)
    return judge(evidence, tolerance=tolerance, margins=margins)


@checked
def margins(
    subject: Any,
    normals: Any = None,
    friction: Any = None,
    com_m: Any = None,
    *,
    low: Any = 0.0,
    high: Any = 10.0,
    wrench: Any = 0.0,
    push: bool = False,
    yields_m: float = 0.0,
    tolerance: float = 1e-4,
) -> Margins:
    """How far the centre of mass of N stances may move in every direction, or which push they bear,
    between a lower and an upper bound that hold whatever converged.

    A margin is negative where the stance does not hold: so far the centre of mass has to go, or such
    a push would have to help. Both bounds are −inf where it is proved that no forces balance; not
    known is said by their width.

    Arguments:
        subject: points that bear, shape (N, n, 3) [m], within 50 m of the centre of mass, a sole's
            corners each; or a plan, an answer with one, or a ``Problem``, whose posture or plan is
            found first: its stances.
        normals: of length 1, shape (N, n, 3).
        friction: Coulomb coefficients above 0, up to 10, shape (N, n) or one for all.
        com_m: centres of mass, shape (N, 3) [m].
        low, high: bounds of the normal forces in units of the weight, shape (N, n) or one for all.
        wrench: on the body beside its weight, force and moment about the centre of mass, in units of
            the weight and of the weight times metres, shape (N, 6).
        push: margins are of horizontal pushes at the centre of mass, in units of the weight; else of
            places of it [m].
        yields_m: how far the body gives way under a push as large as its weight [m].
        tolerance: bounds are sought this close to each other, 1e-5 to 1; typically 1e-2 to 1e-4.
            Ask for 1e-4 or less where gradients are used.

    Returns:
        ``Margins``: ``lower``, ``upper``, ``direction`` in which the stance ends first, ``forces``
        there, ``multiplier``; ``gradient()`` gives the slopes by contact points, normals, friction
        and centre of mass.

    Raises:
        InvalidInput: for an array of another shape, and for a row with numbers that are none,
            normals not of length 1, no friction, or no room for forces: the row is named.
    Source:
        Del Prete, Tonneau, Mansard 2016 (robust equilibrium), with exact cones.

    Example:
        >>> import numpy as np, stancekit
        >>> feet = np.array([[[0.2, 0.2, 0.0], [-0.2, 0.2, 0.0], [-0.2, -0.2, 0.0], [0.2, -0.2, 0.0]]])
        >>> found = stancekit.margins(feet, [0.0, 0.0, 1.0], 0.6, [0.05, 0.0, 0.4])
        >>> found.lower.round(2).tolist(), (found.direction.round(2) + 0.0).tolist()
        ([0.15], [[1.0, 0.0]])
    """
    if isinstance(subject, Problem):
        from stancekit.planners.search.two_stage import TwoStage  # slow to import

        subject = TwoStage().solve(subject)
    plan = _evidence(subject) if isinstance(subject, Answer) else subject
    stances = (
        stances_of(plan)
        if isinstance(plan, Motion) and plan.keyed
        else stances_from(plan, normals, friction, com_m, low, high, wrench)
    )
    found = stances.margins(
        pushes(stances.borne, checked_number(yields_m, "yields_m", least=0.0))
        if push
        else places(stances.borne),
        tolerance=checked_number(tolerance, "tolerance", least=1e-5, most=1.0),
        close=0.0,
    )
    return replace(
        found,
        forces=found.forces.reshape(
            found.forces.shape if isinstance(plan, Motion) else np.shape(plan)
        ),
    )


def _proof(answer: Answer[Any]) -> Certificate | None:
    """An answer's certificate, of the answer's problem where it knows none itself; None where there
    is none.
    """
    if answer.certificate is None or answer.certificate.problem is not None:
        return answer.certificate
    return (
        answer.certificate.of(answer.problem)
        if isinstance(answer.problem, Problem | Leap)
        else answer.certificate
    )


def _evidence(answer: Answer[Any]) -> Any:
    """Evidence that an answer rests on, as ``verify`` takes it: its solution, or the proof that
    there is none.
    """
    proof = _proof(answer)
    if proof is not None:
        return proof
    if answer.solution is None:
        raise InvalidInput(
            "verify: expected an answer with a solution or a proof, got one that is "
            f"{answer.status}"
        )
    return answer.solution
