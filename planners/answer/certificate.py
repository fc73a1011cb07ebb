"""A proof that a problem has no answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array, plain_numbers
from ..problem import Problem
from ..problem.leap import Leap
from ..problem.passage import Passage
from ..robot.model import Robot
from ..terrain.patch import Patch
from .motion import Evidence, held, left_unchecked

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate(Evidence):
    """A proof that its problem has no answer: a tree that covers all that there is to choose
    (patches, toes and forces), and multipliers a leaf.

    A posture problem is a course of one frame with one stance, in which foothold i is contact i
    with one candidate.

    Arguments:
        tree: shape (K, 5), the nodes in preorder, a row each, (kind, i, j, first, second):

            - kind 0, a leaf: the other entries are 0;
            - kind 1, a choice: in the first child foothold ``i`` stands on its candidate ``j``, in the second it does
              not;
            - kind 2, a cut of candidate ``j`` of foothold ``i`` along the chord between two points of the border of the
              piece that is left of it, given as border coordinates ``first`` < ``second``: the
              coordinate e + s is the point v_e + s (v_{e+1} − v_e) of the piece's own vertices, 0 ≤
              s < 1; the first child runs along the border from ``first`` to ``second``, the second
              child from ``second`` round to ``first``, each beginning with the point it runs from;
            - kind 3, a split of the force box of the ``i``-th limb that carries (the limbs of the stances, one stance
              after the other): component ``j`` (0, 1, 2 for f_n, f_y, f_z) at the value ``first``,
              in units of the force scale; the first child keeps the values up to it, the second
              those from it on;
            - kind 4, the directions of the ``i``-th least step (``Problem.least_steps``), parted: a child for
              each of ``contact.parts`` of the side that the node has, the octants first.
        multipliers: shape (leaves, count), the leaves in preorder, with S stances, M frames and N
            limbs: ν_F (S, 3) of the balances of forces, ν_M (S, 3) of those of moments, r (M, N, 3)
            of reach, a (M − 1, 3) of the steps of the COM, t (M − 1, 3) of those of the rotation, g
            (M − 1) of progress, b (moves, 3) of the steps of toes, all for the non-dimensional
            problem; 6 + 3N for a posture. A leaf in which a foothold has no candidate left needs
            none. Any multipliers give a valid bound, so nothing here has to be trusted
            (``verify.check_certificate``).
        problem: the problem without an answer: a posture problem, a course, a leap, or a passage,
            whose tree and multipliers ``verify.flood`` tells of. None in a proof that was read
            without it; ``of`` puts that right.
    Source:
        Lagrangian bounds of Lin et al.'s P, branched where one bound does not do:
        docs/decisions/0003.

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("wall-3", rng=8)[0]
        >>> certificate = stancekit.solve(problem).certificate
        >>> certificate.tree.shape[1], certificate.problem is problem, stancekit.verify(certificate).accepted
        (5, True, True)
    """

    tree: Array
    multipliers: Array
    problem: Problem | Leap | Passage | None = None

    def __post_init__(self) -> None:
        held(self, np.float64, "tree", "multipliers")

    @property
    def sets(self) -> Sets | None:
        """The sets of its robot's legs that the proof is over: within inner sets it says nothing of
        the robot itself.

        None for a robot without legs of its own, or with other sets, and without a problem. Posture
        problems of a robot's file are over inner sets, as they are drawn.
        """
        if not isinstance(self.problem, Problem):
            return None
        if self.problem.is_posture:
            return "inner" if self.problem.robot.identity else None
        return self.problem.sets

    @property
    def robot(self) -> Robot | None:
        """The robot that it speaks of; None where it does not know its problem."""
        return None if self.problem is None else self.problem.robot

    def of(self, problem: Problem | Leap | Passage) -> Certificate:
        """Certificate with the same tree and multipliers as a proof of this problem, right or
        wrong.
        """
        certificate = copy(self)
        object.__setattr__(certificate, "problem", problem)
        return certificate

    @property
    def refuted(self) -> Problem | Leap | Passage:
        """The problem.

        Raises InvalidInput where the certificate does not know it.
        """
        if self.problem is None:
            raise InvalidInput(
                "certificate: expected one that knows its problem, as certificate.of(problem), got "
                "none"
            )
        return self.problem

    @property
    def question(self) -> dict[str, Any]:
        """The problem as JSON-ready values.

        Raises InvalidInput where the certificate does not know it.
        """
        return self.refuted.to_json()

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Tree and multipliers."""
        return {"tree": self.tree, "multipliers": self.multipliers}

    def to_json(self) -> dict[str, Any]:
        """Return the certificate as JSON-ready lists, without its problem."""
        return {"tree": self.tree.tolist(), "multipliers": self.multipliers.tolist()}

    @classmethod
    def from_arrays(cls, tree: Array, multipliers: Array) -> Certificate:
        """A certificate of a tree and its multipliers.

        Raises InvalidInput for tables of other shapes.
        """
        if tree.ndim != 2 or tree.shape[1] != 5 or multipliers.ndim != 2:
            raise InvalidInput(
                "certificate: expected a tree of shape (K, 5) and multipliers of shape (leaves, "
                "count), "
                f"got {tree.shape} and {multipliers.shape}"
            )
        return cls(tree=np.asarray(tree, dtype=np.float64), multipliers=multipliers)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Certificate:
        """Read what ``to_json`` wrote.

        Raises InvalidInput.
        """
        if not isinstance(data, Mapping) or set(data) != {"tree", "multipliers"}:
            raise InvalidInput(
                "certificate: expected an object with the keys tree and multipliers, got something else"
            )
        try:
            tree, multipliers = plain_numbers(data["tree"]), plain_numbers(data["multipliers"])
        except (TypeError, ValueError, OverflowError):
            raise InvalidInput(
                "certificate: expected two tables of numbers, got something else"
            ) from None
        return cls.from_arrays(tree, multipliers)


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """A way over a course that key frames alone do not cross: climbs by key frames, and leaps over
    the gaps between them, which are the parts of the ``Motion`` that answers it.

    Arguments:
        name: name of the course.
        course: the course of the first climb, which has all of the terrain.
        goal_m: place where the centre of mass is to end, shape (2,) [m], as near to it as the course
            asks at its own end.
        refusal: reason why key frames alone do not cross, in words.
        certificate: proof that no balanced motion leads from start to goal, with that passage as its
            problem; None where nothing is proved.
    Source:
        None: Lin et al. for the climbs, Newton and Euler for the leaps.

    Example:
        >>> import stancekit
        >>> crossing = stancekit.load("crossing.json")  # doctest: +SKIP
        >>> [part.word for part in crossing.parts]  # doctest: +SKIP
        ['plan', 'leap', 'plan']
    """

    FORMAT: ClassVar[str] = "stancekit/crossing/1"
    word: ClassVar[str] = "crossing"
    counts: ClassVar[str] = "s"
    name: str
    course: Problem
    goal_m: Array
    refusal: str = ""
    certificate: Certificate | None = None

    def __post_init__(self) -> None:
        held(self, np.float64, "goal_m")

    @property
    def robot(self) -> Robot:
        """The robot that crosses."""
        return self.course.robot

    @property
    def terrain(self) -> tuple[Patch, ...]:
        """Every surface that there is."""
        return self.course.terrain

    @property
    def gravity_m_s2(self) -> float:
        """Gravity that it counts on [m/s²]."""
        return self.course.gravity_m_s2

    def columns(self, rows: int = 0) -> dict[str, tuple[int, ...]]:
        """None: all arrays are those of the parts."""
        return {}

    def hindrance(self, unchecked: Sequence[str]) -> str:
        """The reason why no runner executes it: all of it has to be checked."""
        return left_unchecked(unchecked)

    def to_json(self) -> dict[str, Any]:
        """The way as JSON-ready values, in which its parts have a place."""
        proof = self.certificate
        return {
            "format": self.FORMAT,
            "name": self.name,
            "goal_m": self.goal_m.tolist(),
            "refusal": self.refusal,
            "parts": [],
            "certificate": None if proof is None else proof.content(),
        }
