"""What a planner answers: a status, a witness or a certificate."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, plain_numbers
from ..problem.posture import PostureProblem

UNBOUNDED = 1e6
"""Stands in files for a lower bound of infinity: the problem has no answer even without its moment balance."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Posture:
    """One answer to a posture problem, in the world frame and SI units. Nothing is checked here: ``verify`` does it.

    Arguments:
        com_m: centre of mass c, shape (3,) [m].
        rotation_rad: small body rotation Θ, shape (3,) [rad].
        toes_m: a toe a contact, shape (N, 3) [m].
        forces_n: contact forces on the robot, shape (N, 3) [N].
        points_m, point_forces_n: where feet are soles, whose centres are the toes: where the points of every foot are,
            and the forces at them, which add up to forces_n, shape (N, K, 3) each [m], [N]. K is that of the foot of
            most points; one with fewer has its centre, and no force, in the places left.
    Source:
        Paper E §II.
    Example:
        >>> import numpy as np, stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> nothing = np.zeros((3, 3))
        >>> floating = stancekit.Posture(com_m=np.zeros(3), rotation_rad=np.zeros(3), toes_m=nothing, forces_n=nothing)
        >>> stancekit.verify(problem, floating).accepted
        False
    """

    com_m: Array
    rotation_rad: Array
    toes_m: Array
    forces_n: Array
    points_m: Array | None = None
    point_forces_n: Array | None = None

    def __post_init__(self) -> None:
        for name in self._names:
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def to_json(self) -> dict[str, Any]:
        """Return the posture as JSON-ready lists."""
        return {name: getattr(self, name).tolist() for name in self._names}

    @property
    def _names(self) -> tuple[str, ...]:
        """The arrays that there are."""
        soles = [name for name in ("points_m", "point_forces_n") if getattr(self, name) is not None]
        return ("com_m", "rotation_rad", "toes_m", "forces_n", *soles)


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """A proof that a posture problem has no answer or a course no plan: a tree that covers all that there is to choose
    (patches, toes and forces), and multipliers a leaf.

    A posture problem is a course of one frame with one stance, in which foothold i is contact i with one candidate.

    Arguments:
        tree: shape (K, 5), the nodes in preorder, a row each, (kind, i, j, first, second):

            - kind 0, a leaf: the other entries are 0;
            - kind 1, a choice: in the first child foothold ``i`` stands on its candidate ``j``, in the second it does
              not;
            - kind 2, a cut of candidate ``j`` of foothold ``i`` along the chord between two points of the border of the
              piece that is left of it, given as border coordinates ``first`` < ``second``: the coordinate e + s is the
              point v_e + s (v_{e+1} − v_e) of the piece's own vertices, 0 ≤ s < 1; the first child runs along the
              border from ``first`` to ``second``, the second child from ``second`` round to ``first``, each beginning
              with the point it runs from;
            - kind 3, a split of the force box of the ``i``-th limb that carries (the limbs of the stances, one stance
              after the other): component ``j`` (0, 1, 2 for f_n, f_y, f_z) at the value ``first``, in units of the
              force scale; the first child keeps the values up to it, the second those from it on.
        multipliers: shape (leaves, count), the leaves in preorder, with S stances, M frames and N limbs: ν_F (S, 3) of
            the balances of forces, ν_M (S, 3) of those of moments, r (M, N, 3) of reach, a (M − 1, 3) of the steps of
            the COM, t (M − 1, 3) of those of the rotation, g (M − 1) of progress, b (moves, 3) of the steps of toes,
            all for the non-dimensional problem; 6 + 3N for a posture. A leaf in which a foothold has no candidate left
            needs none. Any multipliers give a valid bound, so nothing here has to be trusted
            (``verify.check_certificate``).
    Source:
        Lagrangian bounds of paper E's P, branched where one bound does not do: docs/decisions/0003.
    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("wall-3", rng=8)[0]
        >>> certificate = stancekit.solve(problem).certificate
        >>> certificate.tree.shape[1], stancekit.verify(problem, certificate).accepted
        (5, True)
    """

    tree: Array
    multipliers: Array

    def __post_init__(self) -> None:
        for name in ("tree", "multipliers"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def to_json(self) -> dict[str, Any]:
        """Return the certificate as JSON-ready lists."""
        return {"tree": self.tree.tolist(), "multipliers": self.multipliers.tolist()}

    @classmethod
    def from_arrays(cls, tree: Array, multipliers: Array) -> Certificate:
        """A certificate of this or an older form. Raises InvalidInput for tables of other shapes.

        Older trees have four columns (of postures: (1, contact, component, value) splits a force box, (2, contact,
        first, second) cuts a patch) or two (of courses: (−1, −1) is a leaf, (foothold, candidate) a choice).
        """
        if tree.ndim != 2 or tree.shape[1] not in (2, 4, 5) or multipliers.ndim != 2:
            raise InvalidInput(
                f"certificate: expected a tree of shape (K, 5) and multipliers of shape (leaves, count), "
                f"got {tree.shape} and {multipliers.shape}"
            )
        rows, nothing = np.asarray(tree, dtype=np.float64), np.zeros(len(tree))
        if tree.shape[1] == 2:
            leaf = (rows == -1.0).all(axis=1)
            kept = np.where(leaf[:, None], 0.0, rows)
            rows = np.column_stack([np.where(leaf, 0.0, 1.0), kept, nothing, nothing])
        elif tree.shape[1] == 4:
            kind, contact, first, second = rows.T
            force = np.column_stack([np.full(len(rows), 3.0), contact, first, second, nothing])
            other = np.column_stack([np.where(kind == 3.0, np.nan, kind), contact, nothing, first, second])
            rows = np.where((kind == 1.0)[:, None], force, other)
        return cls(tree=rows, multipliers=multipliers)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Certificate:
        """Read what ``to_json`` wrote, now or in an older form. Raises InvalidInput."""
        if not isinstance(data, Mapping) or set(data) != {"tree", "multipliers"}:
            raise InvalidInput("certificate: expected an object with the keys tree and multipliers")
        try:
            tree, multipliers = plain_numbers(data["tree"]), plain_numbers(data["multipliers"])
        except (TypeError, ValueError, OverflowError):
            raise InvalidInput("certificate: expected two tables of numbers") from None
        return cls.from_arrays(tree, multipliers)


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What one planner says of one problem.

    Arguments:
        status: of the problem itself.
        method: which planner.
        problem: that was answered, of which a certificate is a proof; None in the outcomes of a batch, and of a foreign
            planner that nobody has verified.
        posture: that the verifier accepted, where feasible.
        certificate: that the verifier accepted, where infeasible.
        residual: largest violation of any constraint by ``posture``, non-dimensional; NaN without a posture.
        residual_nm: norm of the net moment on the robot at ``posture`` [Nm]; NaN without a posture.
        lower_bound: proved lower bound on the non-dimensional moment residual of the problem (0 when nothing is
            proved, inf when even the problem without its moment balance has no answer).
        solves: convex problems solved.
        seconds: wall clock [s].
        claim: what an external solver said, before it was checked.
        message: why it is undecided.
        details: further numbers of the method, e.g. the margin of a relaxation.
    Source:
        Paper E §II-§III; docs/decisions/0004.
    Example:
        >>> import stancekit
        >>> outcome = stancekit.solve(stancekit.sample("wall-3", rng=8)[0])
        >>> outcome.status is stancekit.Status.INFEASIBLE, outcome.posture, outcome.lower_bound > 0.0
        (True, None, True)
    """

    status: Status
    method: str
    problem: PostureProblem | None = None
    posture: Posture | None = None
    certificate: Certificate | None = None
    residual: float = float("nan")
    residual_nm: float = float("nan")
    lower_bound: float = 0.0
    solves: int = 0
    seconds: float = 0.0
    claim: str = ""
    message: str = ""
    details: Mapping[str, float] = field(default_factory=dict)

    def to_json(self, *, proof: bool = False) -> dict[str, Any]:
        """Return JSON-ready values, a line of a file of answers. proof: with the certificate."""
        numbers = {"residual_nm": self.residual_nm, "residual": self.residual}
        record: dict[str, Any] = {
            "status": self.status.value,
            "method": self.method,
            **_finite(numbers),
            "lower_bound": min(self.lower_bound, UNBOUNDED),
            "seconds": self.seconds,
            "solves": self.solves,
        }
        if self.posture is not None:
            record |= self.posture.to_json()
        further = {"claim": self.claim, "message": self.message, "details": _finite(self.details)}
        record |= {name: value for name, value in further.items() if value}
        if proof and self.certificate is not None:
            record["certificate"] = self.certificate.to_json()
        return record


def _finite(numbers: Mapping[str, float]) -> dict[str, float | None]:
    """The numbers, None where they are not finite: JSON has no other."""
    return {name: value if math.isfinite(value) else None for name, value in numbers.items()}
