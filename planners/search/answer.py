"""Base of every planner, and the one way from its claim to an answer: only through the verifier."""

from __future__ import annotations

import json
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, Self, TypeVar, get_args

import numpy as np

from ..answer.answer import Answer, Effort, Status
from ..answer.certificate import Certificate
from ..answer.motion import Motion
from ..answer.plan import Plan
from ..arguments import check_types
from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs, programs_of_this_thread
from ..equilibrium.scaled import Point, Scaled
from ..errors import InvalidInput, located
from ..files.arrays import Array, checked as checked_number
from ..files.documents import shown
from ..plugins import foreign
from ..problem import Problem
from ..problem.contact import wrench_of
from ..problem.standing_map import StandingMap
from ..projection.whole_body import WholeBodyLimits
from ..verify import check_plan

if TYPE_CHECKING:
    from ..relaxation.envelope import EnvelopeSet


@dataclass
class Clock:
    """Wall time, convex solves, and the limits of both.

    Arguments:
        begin: of the work, ``time.perf_counter()`` [s].
        time_limit_s: after which it ends [s].
        max_solves: likewise, a number of solves; with no limit of time, results are the same on a
            busy computer.
        compile_s: time spent on compiling models [s].
        solver_s: time in the solver itself [s].
        solves: so far.
    """

    begin: float
    time_limit_s: float = math.inf
    max_solves: float = math.inf
    compile_s: float = 0.0
    solver_s: float = 0.0
    solves: int = 0

    @classmethod
    def start(cls, time_limit_s: float = math.inf, max_solves: float | None = None) -> Clock:
        """Begin now; no limit of solves where None."""
        return cls(
            time.perf_counter(), time_limit_s, math.inf if max_solves is None else max_solves
        )

    def elapsed(self) -> float:
        """Seconds since the beginning, compiling included [s]."""
        return time.perf_counter() - self.begin

    def ended(self, share: float = 1.0) -> bool:
        """Tell whether this share of one of the limits is used up."""
        return self.elapsed() > share * self.time_limit_s or self.solves >= share * self.max_solves

    def left(self, share: float = 1.0) -> tuple[float, float]:
        """Time [s] and solves that are left of this share."""
        return max(share * self.time_limit_s - self.elapsed(), 0.0), max(
            share * self.max_solves - self.solves, 0.0
        )

    @property
    def limit(self) -> str:
        """The limit that was met, in words."""
        return f"{self.max_solves:g} solves" if self.solves >= self.max_solves else "its time limit"

    def count(self, solves: int, solver_s: float) -> None:
        """Note solves."""
        self.solves += solves
        self.solver_s += solver_s

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """Count the time spent inside as compiling."""
        begin = time.perf_counter()
        yield
        self.compile_s += time.perf_counter() - begin


Kind = Literal["postures", "courses"]
"""The two kinds of question that planners are asked."""
POSTURE_LIMIT_S, COURSE_LIMIT_S = 30.0, 60.0
"""Time limits of one posture problem and of one course where none is given [s]."""
_GIVEN = "with the reach that the problem gives the legs of {}, whatever else they reach"
"""Reason of an infeasible posture of a robot's file: problems are drawn over the inner sets of its
legs."""


class Planner(Protocol):
    """Anything that answers problems: posture problems, courses, or both.

    ``name`` is its name on the command line. One whose time can be limited from outside has
    ``with_limit``, see ``Method``.
    """

    @property
    def name(self) -> str:
        """Its name."""

    def solve(self, problem: Problem, /) -> Answer[Plan]:
        """Answer one problem.

        Raises InvalidInput where the planner is not made for it.
        """
        ...


def kind_of(problem: Problem) -> Kind:
    """Kind of question that a problem is."""
    return "postures" if problem.is_posture else "courses"


@dataclass(frozen=True, kw_only=True)
class Acceptance:
    """When a claim is accepted.

    Arguments:
        tolerance: largest violation of any constraint by a posture or a plan, non-dimensional.
        gap: moment residual that a certificate of a posture problem must prove, non-dimensional.
    """

    tolerance: float = 1e-6
    gap: float = 1e-4

    def answer(
        self,
        problem: Problem,
        *,
        method: str,
        clock: Clock,
        plan: Plan | None = None,
        certificate: Certificate | None = None,
        word: str = "",
        message: str = "",
        details: Mapping[str, float] | None = None,
        bound: float = float("nan"),
    ) -> Answer[Plan]:
        """Feasible if a planner's plan is verified, infeasible if its certificate is, else undecided.

        Arguments:
            plan, certificate: what the planner claims: a plan, or a proof that there is none.
            word: its verdict in its own word, e.g. a solver's "optimal".
            message: why it has neither, or what else is to be known.
            details: its figures, by name.
            bound: on the objective of any plan, proved.
        """
        status, report, begin = Status.UNDECIDED, None, clock.elapsed()
        if plan is not None:
            plan = plan if plan.problem is problem else replace(plan, problem=problem)
            report = check_plan(
                plan, tolerance=self.tolerance, between=False
            )  # convexity proves the way
            if report.accepted:
                status = Status.FEASIBLE
            else:
                kind = "witness" if problem.is_posture else "plan"
                message = message or f"{kind} refused: {report.message}"
        posed = problem.is_posture
        bound = 0.0 if posed else bound
        if certificate is not None and status is Status.UNDECIDED:
            certificate = certificate.of(problem)
            gap, of = self.gap if posed else 0.0, problem.robot.identity
            from ..verify import check_certificate  # of proofs alone

            proof = check_certificate(certificate, tolerance=gap, any_sets=True)
            bound = proof.figures["lower_bound"] if posed else bound
            if proof.accepted:
                status = Status.INFEASIBLE
                bound, message = (
                    (bound, _GIVEN.format(of) if of else "")
                    if posed
                    else (float("inf"), proof.message)
                )
            else:
                message = message or f"certificate refused: {proof.message}"
        solution, seconds = plan if status is Status.FEASIBLE else None, clock.elapsed()
        return Answer(
            status=status,
            method=method,
            problem=problem,
            solution=solution,
            certificate=certificate if status is Status.INFEASIBLE else None,
            report=report
            if posed or solution is None
            else None,  # a course's comes with its whole body
            objective=float("nan") if posed or solution is None else objective_of(solution),
            bound=bound,
            residual=float("nan") if report is None else report.worst,
            effort=Effort(
                solves=clock.solves,
                compile_s=clock.compile_s,
                seconds=seconds - clock.compile_s,
                solver_s=clock.solver_s,
                verifier_s=seconds - begin,
            ),
            claim=word,
            message=message,
            details=dict(details or {}),
        )


@dataclass(frozen=True, kw_only=True)
class Method(ABC):
    """Base of the methods: a value with its settings, which answers problems.

    Arguments:
        time_limit_s: limit per problem; None for 30 (posture) or 60 (course) [s].
        acceptance: when a claim counts.
        programs: compiled models to share; those of the thread where None.
        most_s: the caller's own limit per problem of either kind [s].
    """

    name: ClassVar[str]
    answers: ClassVar[Kind | None] = None
    """The only kind of question that it answers; None for both."""
    OF_COURSES: ClassVar[tuple[str, ...]] = ()
    """Settings that postures have no use for."""
    time_limit_s: float | None = None
    acceptance: Acceptance = Acceptance()
    programs: Programs | None = field(default=None, repr=False, compare=False)
    most_s: float = field(default=math.inf, repr=False)

    def __post_init__(self) -> None:
        check_types(self)
        if self.time_limit_s is not None and not self.time_limit_s >= 0.0:
            raise InvalidInput(
                f"time_limit_s: expected a number of at least 0, got {self.time_limit_s!r}"
            )

    @property
    def kept(self) -> Programs:
        """The compiled models that it shares."""
        return self.programs or programs_of_this_thread()

    @abstractmethod
    def solve(self, problem: Problem, /) -> Answer[Plan]:
        """Answer one problem.

        Raises InvalidInput for settings that its kind has no use for.
        """

    def check(self, kind: Kind) -> None:
        """Raise InvalidInput for a kind of question that it does not answer, and for a setting that
        the kind has no use for.
        """
        if self.answers not in (None, kind):
            raise InvalidInput(
                f"method: expected one for {kind}, got {self.name}, which answers {self.answers}"
            )
        for each in fields(self) if kind == "postures" else ():
            came = getattr(self, each.name)
            if each.name in self.OF_COURSES and came != each.default:
                raise InvalidInput(
                    f"{each.name}: expected no such argument with {self.name} for postures, which "
                    f"have no use for it, got {came}"
                )

    def limit_s(self, kind: Kind) -> float:
        """Time limit of one problem of a kind [s]."""
        usual_s = POSTURE_LIMIT_S if kind == "postures" else COURSE_LIMIT_S
        return min(usual_s if self.time_limit_s is None else self.time_limit_s, self.most_s)

    def with_limit(self, limit_s: float) -> Self:
        """The method that takes no longer than this [s], nor longer than its own limit."""
        most_s = max(min(limit_s, self.most_s), 0.0)
        own_s = None if self.time_limit_s is None else min(self.time_limit_s, most_s)
        return replace(self, most_s=most_s, time_limit_s=own_s)


def plan_of(
    problem: Problem,
    scaled: Scaled,
    choice: Index,
    point: Point,
    *,
    provenance: Mapping[str, Any] | None = None,
    modes: Index | None = None,
) -> Plan:
    """Give a point on one choice of candidates its units back.

    Arguments:
        scaled: as asked for, or chosen.
        choice: shape (P,), of a posture ``scaled.numbers``.
    """
    forces, soles = scaled.chosen(choice).forces_si(point)
    return Motion(
        problem=problem,
        com_m=scaled.places_m(point.com),
        rotation_rad=point.rotation,
        toes_m=scaled.places_m(point.toes),
        choice=choice,
        forces_n=forces,
        points_m=soles.get("points_m"),
        point_forces_n=soles.get("point_forces_n"),
        modes=modes,
        provenance=provenance or {},
    )


def objective_of(plan: Plan) -> float:
    """The objective of ``Weights`` at a plan, SI: recomputed, whatever a solver said."""
    course, weights = plan.problem, plan.problem.aim
    cost = weights.goal * float(np.sum((plan.com_m[-1] - course.goal_m) ** 2))
    cost += weights.com_path * float(np.sum((plan.com_m - course.com_nominal_m) ** 2))
    cost += weights.tilt * float(np.sum(plan.rotation_rad**2))
    cost += weights.com_step * float(np.sum(np.diff(plan.com_m, axis=0) ** 2))
    if course.standing_m is not None:
        away = plan.toes_m[course.holds] - plan.com_m[:, None] - course.standing_m
        cost += weights.stance * float(np.sum(away**2))
    steps = np.array([plan.toes_at(k) - plan.toes_at(k - 1) for k in range(1, course.frames)])
    return cost + weights.toe_step * float(np.sum(steps**2))


Taken = TypeVar("Taken", Motion[Any], Certificate)
_NUMBERS = {
    Certificate: ("tree", "multipliers"),
    Motion: (
        "com_m",
        "rotation_rad",
        "toes_m",
        "choice",
        "forces_n",
        "points_m",
        "point_forces_n",
        "modes",
    ),
}
"""Numbers that are taken over of each kind of evidence."""


class VerifiedPlanner:
    """A planner from elsewhere; its ``solve`` gives an ``Answer``, or a plan or a certificate
    alone.

    None, and an answer without evidence, is undecided, whatever it claims. A plan is taken for one
    of the problem that was asked for; bounds on its objective come without proof, and are left.

    Arguments:
        envelopes: that it was made with.
        remake: a function that makes the planner anew with another time limit [s]; None where there
            is no such function.
    """

    def __init__(
        self,
        planner: Any,
        name: str,
        acceptance: Acceptance,
        *,
        envelopes: EnvelopeSet | None = None,
        remake: Callable[[float], Any] | None = None,
    ) -> None:
        self.name, self._acceptance, self._where = name, acceptance, f"method {name}"
        self._planner = _solving(planner, self._where)
        self._envelopes, self._remake = envelopes, remake

    def with_limit(self, limit_s: float) -> VerifiedPlanner:
        """The planner made anew with this time limit [s]; itself where it has none."""
        if self._remake is None and not hasattr(self._planner, "with_limit"):
            return self
        with foreign(self._where):
            planner = (
                self._planner.with_limit(limit_s) if self._remake is None else self._remake(limit_s)
            )
        return VerifiedPlanner(
            planner,
            self.name,
            self._acceptance,
            envelopes=self._envelopes,
            remake=self._remake,
        )

    def solve(self, problem: Problem) -> Answer[Plan]:
        """Ask, and have the evidence verified.

        Raises InvalidInput for an answer of another kind, a planner that raises or answers another
        kind of question alone, and envelopes that were learned for other problems.
        """
        check_answers(self._planner, kind_of(problem), self._where)
        if self._envelopes is not None and problem.is_posture:
            self._envelopes.check_fits(problem)
        clock = Clock.start()
        claimed, solves = _asked(self._planner, problem, self._where)
        clock.count(solves, 0.0)
        return self._acceptance.answer(problem, method=self.name, clock=clock, **claimed)


def check_answers(planner: Any, kind: Kind, where: str) -> None:
    """Raise InvalidInput for a planner that says, by its attribute ``answers``, that it answers
    another kind of question alone.

    Arguments:
        where: what the message begins with.
    """
    answered = getattr(planner, "answers", None)
    if answered in get_args(Kind) and answered != kind:
        raise InvalidInput(
            f"{where}: expected a planner of {kind}, got one that answers {answered} alone"
        )


def _asked(planner: Any, problem: Problem, where: str) -> tuple[dict[str, Any], int]:
    """Claim of a planner, for ``Acceptance.answer``, and the number of solves that it reports.

    Raises InvalidInput.
    """
    with foreign(where):
        claim, rest, solves = planner.solve(deepcopy(problem)), dict[str, Any](), 0
        if claim is not None and not isinstance(claim, Answer | Motion | Certificate):
            raise InvalidInput(
                f"{where}: expected an Answer, a Motion, a Certificate or None, got {_a(claim)}"
            )
        evidence: Any
        certificate: Any
        evidence, certificate = (None, claim) if isinstance(claim, Certificate) else (claim, None)
        if isinstance(claim, Answer):
            evidence, certificate, solves = (
                claim.solution,
                claim.certificate,
                int(claim.effort.solves),
            )
            rest["word"] = _text(claim.claim, where) or Status(claim.status).value
            rest["message"] = _text(claim.message, where)
            rest["details"] = {
                _text(key, where): float(value) for key, value in claim.details.items()
            }
        rest["plan"] = _taken(Motion, evidence, where, problem=problem)
        rest["certificate"] = _taken(Certificate, certificate, where)
        return rest, solves


def _solving(planner: Any, where: str) -> Any:
    """A planner.

    Raises InvalidInput for what is none.
    """
    if not callable(getattr(planner, "solve", None)):
        raise InvalidInput(f"{where}: expected something with solve, got {_a(planner)}")
    return planner


def _taken(kind: type[Taken], found: Any, where: str, **given: Any) -> Taken | None:
    """The numbers of evidence, in an object of our own; None where there is none.

    Raises InvalidInput, ValueError.
    """
    if found is None:
        return None
    if not isinstance(found, kind):
        raise InvalidInput(f"{where}: expected a {kind.__name__} as evidence, got {_a(found)}")
    if isinstance(found, Motion):
        given["provenance"] = {
            "planner": where.partition(" ")[2],
            "said": json.loads(json.dumps(dict(found.provenance), allow_nan=False)),
        }
    with located(where):
        return kind(**{name: getattr(found, name) for name in _NUMBERS[kind]}, **given)


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise InvalidInput(f"{where}: expected text in its outcome, got {_a(value)}")
    return str(value)


def _a(found: object) -> str:
    return f"a {type(found).__name__}, {shown(found, 80)}"


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanSettings:
    """Settings of ``plan`` beside its method: what a plan has to keep and to bear.

    Arguments:
        body: limits of joints and bodies; a plan that breaks them is bent until it keeps them.
        push_n: horizontal push at the centre of mass, in any direction, that every stance has to
            bear [N]; a course of its own may ask for more. Without one a plan that bears 5 % of the
            weight is sought, then 2.5 %. "two-stage" alone, and
            *infeasible* is not said with it.
        wrench: force [N] at the centre of mass, or that and a moment about it [Nm], on the body in
            addition to its weight at every key frame, such as those of a payload, wind or a rope;
            in world axes, shape (3,) or (6,); added to what the course has. Plans carry it, and
            *infeasible* is proved with it.
        standing: with a start and a goal, a map of where the robot can stand, as ``map`` makes it,
            or its file: the way costs more where the robot, facing along x and as it stands, is not
            likely to, and most where it is proved not to.
        margins: measure what every stance of the plan bears beyond its weight, and say the least: a
            push, a shift of the centre of mass, less friction.
        prefer_margin: prefer postures with more margin: of plans that are accepted, the one whose
            stances bear the largest push of 40, 30, 20 and 10 % of the weight, while there is time.
            "two-stage" alone.
        leaps: with a start and a goal, whether a robot that was named may leap where key frames have
            no plan. Where it may, a proof that no balanced motion leads to the goal leaves the
            answer undecided; where it may not, the answer is infeasible.
        checkpoint: file NAME.json that keeps the finished pieces of a course of more than 40 key
            frames, which is planned in pieces: the same call goes on from there after an
            interruption. The file is removed once there is a plan.

    Raises:
        InvalidInput: for a push below 0, and a malformed wrench.
    Source:
        None: demands on a plan beside those of Lin et al.

    Example:
        >>> from stancekit import PlanSettings, WholeBodyLimits
        >>> PlanSettings(push_n=20.0, body=WholeBodyLimits(torque_nm=8.0)).push_n
        20.0
    """

    body: WholeBodyLimits = field(default_factory=WholeBodyLimits)
    push_n: float = 0.0
    wrench: Array | Sequence[float] | None = None
    standing: StandingMap | str | Path | None = None
    margins: bool = False
    prefer_margin: bool = False
    leaps: bool = True
    checkpoint: str | Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "push_n", checked_number(self.push_n, "push_n", least=0.0))
        if self.wrench is not None:
            object.__setattr__(self, "wrench", wrench_of(self.wrench))
        check_types(self)

    def check_of_leap(self) -> None:
        """Raise InvalidInput for a setting that a leap has no use for."""
        if self.push_n or self.prefer_margin:
            raise InvalidInput(
                "push_n, prefer_margin: expected none with a leap, whose stances are not pushed yet"
            )
        if self.wrench is not None:
            raise InvalidInput(
                "wrench: expected none with a leap, whose body bears nothing but its weight yet"
            )
        if self.body != WholeBodyLimits():
            raise InvalidInput(
                "body: expected none with a leap, whose limits are those of its robot's file"
            )
        for name in ("standing", "checkpoint"):
            if getattr(self, name) is not None:
                raise InvalidInput(f"{name}: expected none with a leap, got {getattr(self, name)}")
