"""A plan of key frames: what the planners of a course answer, in the world frame and SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..files.arrays import Array
from ..problem.course import Course
from .outcome import Certificate, Posture, Status

if TYPE_CHECKING:
    from ..robot.contact_robot import Sets
    from ..verify.report import Report


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """M key frames over a course of P footholds and S stances, for a robot with N limbs.

    Arguments:
        course: what it is a plan of.
        com_m: shape (M, 3) [m].
        rotation_rad: small body rotation Θ, shape (M, 3) [rad].
        toes_m: one a foothold, shape (P, 3) [m].
        choice: the candidate patch of every foothold, shape (P,).
        forces_n: forces on the robot in every stance, world frame, zero for limbs that do not carry in it, shape
            (S, N, 3) [N].
        points_m, point_forces_n: where feet are soles, whose centres are the toes: where the points of every foot
            put down are, shape (P, K, 3) [m], and the forces at them, which add up to forces_n, (S, N, K, 3) [N]; see
            ``Posture``.
        joints_rad: angles at every key frame, of all joints of the robot's legs in its model's order, shape (M, J)
            [rad, or m where a joint slides]; None where nobody worked them out.
        modes: z, the envelope that mode switching chose for each frame, shape (M,); None without mode switching.
        provenance: how the plan was made, for people.
    Source:
        Paper E §IV-B, E11.
    Example:
        >>> import stancekit
        >>> plan = stancekit.plan("walls", frames=3).plan
        >>> plan.toes_at(0).shape, plan.posture(0).forces_n.shape[1]
        ((6, 3), 3)
    """

    course: Course
    com_m: Array
    rotation_rad: Array
    toes_m: Array
    choice: NDArray[np.int_]
    forces_n: Array
    points_m: Array | None = None
    point_forces_n: Array | None = None
    joints_rad: Array | None = None
    modes: NDArray[np.int_] | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, kind in (
            ("com_m", np.float64), ("rotation_rad", np.float64), ("toes_m", np.float64), ("forces_n", np.float64),
            ("choice", np.int_), ("modes", np.int_), ("points_m", np.float64), ("point_forces_n", np.float64),
            ("joints_rad", np.float64),
        ):  # fmt: skip
            if getattr(self, name) is not None:
                array = np.array(getattr(self, name), dtype=kind)
                array.setflags(write=False)
                object.__setattr__(self, name, array)

    def toes_at(self, frame: int) -> Array:
        """Where the toes of all limbs stand at a key frame, shape (N, 3) [m]."""
        return np.asarray(self.toes_m[self.course.holds[frame]])

    def forces_at(self, frame: int) -> Array:
        """Forces of all limbs at a key frame, shape (N, 3) [N]: the mean of its stances' forces.

        That is an answer itself: at one body pose and with the same toes both balances, the cones and the bounds, which
        admit no force, are convex in the forces.
        """
        rows = [index for index, stance in enumerate(self.course.stances) if stance.frame == frame]
        return np.asarray(self.forces_n[rows].mean(axis=0))

    def posture(self, stance: int) -> Posture:
        """The posture of one stance, its limbs only."""
        of = self.course.stances[stance]
        limbs = list(of.limbs)
        soles: dict[str, Array] = {}
        if self.points_m is not None and self.point_forces_n is not None:
            feet = [self.course.robot.limbs[i].sole_m for i in limbs]
            most = max(1 if sole is None else len(sole) for sole in feet)
            if most > 1:  # else nobody who carries has a sole
                soles["points_m"] = self.points_m[self.course.holds[of.frame, limbs], :most]
                soles["point_forces_n"] = self.point_forces_n[stance][limbs, :most]
        return Posture(
            com_m=self.com_m[of.frame],
            rotation_rad=self.rotation_rad[of.frame],
            toes_m=self.toes_at(of.frame)[limbs],
            forces_n=self.forces_n[stance][limbs],
            **soles,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanOutcome:
    """What one planner says of one course.

    Arguments:
        status: of the course itself; of a robot with legs of its own, infeasible is proved over their outer sets.
        method: which planner.
        problem: the course that was answered, of which a certificate is a proof: over the outer sets of the legs where
            there are any. None in the outcome of a foreign planner that nobody has verified.
        plan: accepted by the verifier where ``status`` is feasible.
        objective: of the plan.
        bound: proved lower bound on the objective of any plan (inf where none exists, NaN where nothing is proved).
        certificate: of infeasibility.
        residual: largest violation of any constraint, non-dimensional.
        solves: convex problems solved.
        compile_s: time to write the model down [s].
        seconds: everything else [s], of which solver_seconds in the conic solver itself and verifier_seconds in the
            verifier.
        claim: what a method says that cannot prove it.
        message: why it is undecided.
        details: further numbers of the method.
        report: the verifier's report on all of the plan, joints, torque, bodies and motion too; None without a plan,
            and where contacts alone were asked for.
    Source:
        Paper E §IV-B.
    Example:
        >>> import stancekit
        >>> outcome = stancekit.plan("stairs", frames=3, reserve=False)
        >>> outcome.bound <= outcome.objective
        True
    """

    status: Status
    method: str
    problem: Course | None = None
    plan: Plan | None = None
    objective: float = float("nan")
    bound: float = float("nan")
    certificate: Certificate | None = None
    residual: float = float("nan")
    solves: int = 0
    compile_s: float = 0.0
    seconds: float = 0.0
    solver_seconds: float = 0.0
    verifier_seconds: float = 0.0
    claim: str = ""
    message: str = ""
    details: Mapping[str, float] = field(default_factory=dict)
    report: Report | None = None

    @property
    def sets(self) -> Sets | None:
        """The sets of the robot's legs that ``problem`` is over; None for a robot without legs, or with other sets."""
        if self.problem is None:
            return None
        from ..robot.contact_robot import sets_of

        return sets_of(self.problem.robot)
