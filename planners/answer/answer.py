"""Answer of a planner to any kind of problem: a status, a solution or a certificate, and the
effort.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ..problem import Problem
from ..problem.leap import Leap
from ..problem.passage import Passage
from .certificate import Certificate
from .motion import Motion, doubts_of
from .report import Report, finite

if TYPE_CHECKING:
    from ..problem.walk import Walk
    from ..robot.reach_sets import Sets

S = TypeVar("S", bound=Motion[Any], covariant=True)
UNBOUNDED = 1e6
"""Stands in files for a lower bound of infinity: the problem has no answer even without its moment
balance."""


class Status(enum.StrEnum):
    """The three answers to "can the robot hold this posture?", and "is there a plan?".

    Source:
        docs/decisions/0004: a status speaks of the problem, whatever relaxation of it was solved.

    Example:
        >>> from stancekit import Status
        >>> [status.value for status in Status]
        ['feasible', 'infeasible', 'undecided']
    """

    FEASIBLE = "feasible"
    """A witness is attached and satisfies every constraint."""
    INFEASIBLE = "infeasible"
    """A certificate is attached that anyone can re-check."""
    UNDECIDED = "undecided"
    """Neither: a limit was met, a solver failed, or the method cannot prove what it claims."""


@dataclass(frozen=True, kw_only=True)
class Effort:
    """Cost of an answer.

    Arguments:
        solves: convex problems solved; of a walk, nonlinear ones.
        tries: choices of contacts that were tried, by planners that count them.
        seconds: wall clock, without compile_s; of a walk, processor time of its solves [s].
        compile_s: time to write programs down [s].
        solver_s, verifier_s: time in the solver itself and in the verifier, by planners that take
            them apart; else 0 [s].
    Source:
        None: counts and clocks.

    Example:
        >>> import stancekit
        >>> stancekit.solve(stancekit.sample("wall-3", rng=8)[0]).effort.solves
        1
    """

    solves: int = 0
    tries: int = 0
    seconds: float = 0.0
    compile_s: float = 0.0
    solver_s: float = 0.0
    verifier_s: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer(Generic[S]):
    """Answer of one planner to one problem: of a posture, a course, a walk or a leap.

    Arguments:
        status: status of the problem itself; of a robot with legs of its own, infeasible is proved
            over their outer sets.
        method: the planner's name.
        problem: the problem answered, whose proof a certificate is: of a course over the outer sets
            of the legs where there are any. None in the answers of a batch, and of a foreign
            planner that is not verified.
        solution: accepted by the verifier where ``status`` is feasible. Where the problem is
            undecided, the plan or walk that was found and that the verifier refused, or had no time
            for; None where there is none.
        certificate: accepted by the verifier where ``status`` is infeasible.
        report: the verifier's report on what was found, accepted or not; of a plan on all of it,
            joints, torque, bodies and motion too, and None where contacts alone were asked for.
            None in the answers of a batch.
        objective: objective of the solution; NaN where the problem has none.
        bound: proved lower bound on the objective of any solution; of a posture problem, on its
            non-dimensional moment residual (inf where none exists, NaN where nothing was asked of
            an objective).
        residual: largest violation of any constraint by what was found, non-dimensional; NaN
            without a solution.
        effort: what the answer has cost.
        claim: what a method says that cannot prove it, for example an external solver's own status.
        message: why the problem is undecided, or what a proof is over.
        more_doubts: what the reader of the ground's file mended or left out, one line each; without
            a problem, also what that of the robot's file did.
        details: further numbers of the method, for example the margin of a relaxation.
    Source:
        Lin et al. §II-§IV; docs/decisions/0004.

    Example:
        >>> import stancekit
        >>> answer = stancekit.solve(stancekit.sample("wall-3", rng=8)[0])
        >>> answer.status is stancekit.Status.INFEASIBLE, answer.solution, answer.bound > 0.0
        (True, None, True)
    """

    status: Status
    method: str
    problem: Problem | Walk | Leap | Passage | None = None
    solution: S | None = None
    certificate: Certificate | None = None
    report: Report[S] | None = None
    objective: float = math.nan
    bound: float = math.nan
    residual: float = math.nan
    effort: Effort = field(default_factory=Effort)
    claim: str = ""
    message: str = ""
    more_doubts: tuple[str, ...] = ()
    details: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        text = self.message or ("" if self.report is None else self.report.message)
        return f"Answer({self.status.value} by {self.method}{': ' if text else ''}{text})"

    @property
    def sets(self) -> Sets | None:
        """The sets of the robot's legs that a course is over; None for a robot without legs, or
        with other sets.
        """
        problem = self.problem
        return problem.sets if isinstance(problem, Problem) and not problem.is_posture else None

    @property
    def doubts(self) -> tuple[str, ...]:
        """What readers of the robot's and the ground's files guessed, mended or left out, one line
        each.
        """
        return (*doubts_of(self.problem or self.solution), *self.more_doubts)

    @property
    def residual_nm(self) -> float:
        """Norm of the net moment on the robot, at the worst stance of what was found [Nm]; NaN
        without a report.
        """
        return math.nan if self.report is None else self.report.figures.get("residual_nm", math.nan)

    def to_json(self, *, proof: bool = False) -> dict[str, Any]:
        """JSON-ready values of an answer to a posture problem, a line of a file.

        Arguments:
            proof: with the certificate.
        """
        record: dict[str, Any] = {
            "status": self.status.value,
            "method": self.method,
            **finite({"residual_nm": self.residual_nm, "residual": self.residual}),
            "lower_bound": 0.0 if math.isnan(self.bound) else min(self.bound, UNBOUNDED),
            "seconds": self.effort.compile_s + self.effort.seconds,
            "solves": self.effort.solves,
        }
        if self.solution is not None and not self.solution.problem.counts:
            record |= self.solution.to_json()
        further = {"claim": self.claim, "message": self.message, "details": finite(self.details)}
        further |= {"doubts": list(self.doubts)}
        record |= {name: value for name, value in further.items() if value}
        if proof and self.certificate is not None:
            record["certificate"] = self.certificate.to_json()
        return record
