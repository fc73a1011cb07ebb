"""How contacts of a leap are chosen: what is seen of a candidate, what scores it, and the settings of
the finder.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol, get_args

import numpy as np

from ..files.arrays import Array, check_numbers, checked, checked_choice, checked_int, cross

if TYPE_CHECKING:
    from .numbers import LeapNumbers

STOP = 0.05
"""A first step whose slack costs more than this is the last one: such contacts are hardly ever
solved."""
FRICTION_SHARE = 0.8
"""Share of the friction that plans use."""
OF_CANDIDATE = (
    "grip",
    "room_m",
    "friction",
    "normal_x",
    "normal_y",
    "normal_z",
    "middle_x_m",
    "middle_y_m",
    "middle_z_m",
    "size_m",
    "push_x",
    "push_y",
    "push_z",
    "moment_x_m",
    "moment_y_m",
    "moment_z_m",
    "fixed",
    "begins",
    "ends",
    "shoulder_x_m",
    "shoulder_y_m",
    "shoulder_z_m",
)
"""Features of one candidate. grip: friction left over at the nominal force, in units of it; room:
least of what is left of reach and height; middle: of the patch, from the mean centre of mass while
the limb stands; size: mean distance of the corners from it; push: nominal force in units of the
weight; moment: of that force about the mean centre of mass; fixed: 1 where the foothold has no
other candidate; begins, ends: share of the leap at which the limb starts and stops to stand there;
shoulder: of the limb in the body frame."""
OF_LEAP = (
    "goal_x_m",
    "goal_y_m",
    "goal_z_m",
    "velocity_x_m_s",
    "velocity_y_m_s",
    "velocity_z_m_s",
    "goal_radius_m",
    "duration_s",
    "flight_s",
    "tilt_rad",
)
"""Features of a leap and one timing. goal: from the start; velocity: at the goal; flight: time
without any foothold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapFeatures:
    """Features of a leap with one timing before any choice is tried.

    Arguments:
        candidates: shape (P, R, F), by foothold and candidate, the F of ``OF_CANDIDATE``, 0 where
            there is no candidate.
        mask: where there is one, shape (P, R).
        leap: shape (G,), the G of ``OF_LEAP``.
    """

    candidates: Array
    mask: Array
    leap: Array

    @classmethod
    def of(cls, numbers: LeapNumbers) -> LeapFeatures:
        """The features of a leap's numbers."""
        scaled, layout = numbers.scaled, numbers.layout
        foothold = layout.candidate_footholds
        frame, limb, standing = layout.standing
        stands = [np.flatnonzero(standing == j) for j in range(layout.footholds)]
        limbs = np.array([limb[limbs_of_stance[0]] for limbs_of_stance in stands])
        com = np.array(
            [numbers.nominal.com[frame[limbs_of_stance]].mean(axis=0) for limbs_of_stance in stands]
        )
        spans = (
            np.array([numbers.times[frame[limbs_of_stance][[0, -1]]] for limbs_of_stance in stands])
            / numbers.times[-1]
        )
        middles = np.array([piece.mean(axis=0) for piece in scaled.pieces])
        sizes = np.array(
            [
                float(np.linalg.norm(piece - middle, axis=1).mean())
                for piece, middle in zip(scaled.pieces, middles, strict=True)
            ]
        )
        grip, pushes = _grip(numbers)
        away = middles - com[foothold]
        options = np.bincount(foothold, minlength=layout.footholds)
        columns = [
            grip,
            _room(numbers, middles),
            scaled.friction,
            *scaled.frames[:, :, 0].T,
            *away.T,
            sizes,
            *pushes[foothold].T,
            *cross(away, pushes[foothold]).T,
            (options == 1.0)[foothold],
            *spans[foothold].T,
            *scaled.shoulders[limbs[foothold]].T,
        ]
        tables = [
            scaled.by_candidate(np.asarray(column, dtype=np.float64), 0.0) for column in columns
        ]
        leap = numbers.leap
        goal = leap.goal.com_m - leap.start.com_m
        flight = numbers.lasts.sum() - numbers.lasts[np.unique(numbers.stance_intervals)].sum()
        return cls(
            candidates=np.stack(tables, axis=-1),
            mask=scaled.by_candidate(np.ones(len(foothold)), 0.0),
            leap=np.array(
                [
                    *goal,
                    *leap.goal.velocity_m_s,
                    leap.goal_radius_m,
                    numbers.times[-1],
                    flight,
                    leap.limits.tilt_rad,
                ]
            ),
        )

    def padded(self, options: int) -> LeapFeatures:
        """Features with room for more candidates per foothold, which are masked."""
        more = [(0, 0), (0, options - self.mask.shape[1])]
        return LeapFeatures(
            candidates=np.pad(self.candidates, [*more, (0, 0)]),
            mask=np.pad(self.mask, more),
            leap=self.leap,
        )


def _grip(numbers: LeapNumbers) -> tuple[Array, Array]:
    """Friction left over at the nominal force of every candidate, in units of that force, shape
    (K,); and the mean nominal force of every foothold in units of the weight, shape (P, 3).
    """
    scaled, layout, nominal = numbers.scaled, numbers.layout, numbers.nominal
    contacts = layout.contacts[2]
    pushes = np.zeros((layout.footholds, 3))
    np.add.at(pushes, contacts, nominal.forces)
    along = (pushes / np.linalg.norm(pushes, axis=1, keepdims=True))[layout.candidate_footholds]
    pulls = np.matmul(along[:, None], scaled.frames)[:, 0]
    grip = FRICTION_SHARE * scaled.friction * pulls[:, 0] - np.hypot(pulls[:, 1], pulls[:, 2])
    return grip, pushes / np.bincount(contacts, minlength=layout.footholds)[:, None]


def _room(numbers: LeapNumbers, middles: Array) -> Array:
    """The least of what is left of reach and height where the limb stands, at a patch's middle,
    shape (K,) [m].
    """
    scaled, layout = numbers.scaled, numbers.layout
    frame, limb, foothold = layout.standing
    com = numbers.nominal.com[frame]
    room = np.full(len(middles), np.inf)
    height = numbers.leap.limits.height_m
    for j in range(layout.footholds):
        mine = np.flatnonzero(foothold == j)
        places = np.flatnonzero(layout.candidate_footholds == j)
        away = middles[places][:, None] - com[mine]
        left = scaled.reach[limb[mine]] - np.linalg.norm(
            away - scaled.shoulders[limb[mine]], axis=2
        )
        left = np.minimum(left, -height - away[:, :, 2])
        if layout.reach_rows:
            half = np.flatnonzero(layout.row_limbs == limb[mine[0]])
            inside = scaled.half_spaces.bounds[half] - away @ scaled.half_spaces.normals[half].T
            left = np.minimum(left, inside.min(axis=2))
        room[places] = left.min(axis=1)
    return room


class Scorer(Protocol):
    """Whatever gives every candidate a score before anything is tried: the hand rule, or a learned
    one.
    """

    def scores(self, numbers: LeapNumbers) -> Array:
        """The score of every candidate, the larger the better, shape (P, options); −inf where there
        is none.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Rule:
    """The four constants of the hand rule, chosen on training scenes by
    ``benchmarks/leap_rule.py``.

    Arguments:
        grip, room: weights of the friction that is left over and of the reach; grip_cap, room_cap
            [m]: more than this of either is worth nothing.
    """

    grip: float = 3.0
    grip_cap: float = 0.3
    room: float = 14.0
    room_cap: float = -0.06

    def __post_init__(self) -> None:
        check_numbers(self, least=("grip", "room"), finite=("grip_cap", "room_cap"))

    def scores(self, numbers: LeapNumbers) -> Array:
        """The score of every candidate, the larger the better, shape (P, options); −inf where there
        is none.
        """
        seen = LeapFeatures.of(numbers)
        grip, room = (
            seen.candidates[:, :, OF_CANDIDATE.index(name)] for name in ("grip", "room_m")
        )
        score = self.grip * np.minimum(grip, self.grip_cap) + self.room * np.minimum(
            room, self.room_cap
        )
        return np.where(seen.mask > 0.0, score, -np.inf)


Order = Literal["random", "rule", "noise", "farkas", "finder"]


@dataclass(frozen=True, kw_only=True)
class LeapFinder:
    """Finder of contact choices, and the order in which it tries them.

    Arguments:
        order: "finder", the rule with both kinds of cuts; "farkas", with the cuts that prove alone;
            "rule", its best sums first; "noise", the rule with noise and single changes of the best
            so far; "random".
        rule: what scores the candidates: the hand rule with its constants, or scores that ``fit``
            has learned.
        solves: convex problems at most in search of a plan; 25 find nearly all that is found.
        stop: cost of a first step above which a choice is given up; inf never gives up.
        price: price of a unit of predicted cost, in score; 10 to 100 do the same.
        share: share of the friction that plans use.
        proof: convex problems at most in search of a proof, after no plan was found; 0 for none.
        seed: seed of noise and random choices.

    Raises:
        InvalidInput: for another order, and numbers out of range.
    Source:
        Newton and Euler for one rigid body; docs/concepts/leaps.md.

    Example:
        >>> import stancekit
        >>> from stancekit.planners.problem.leap_classes import leap_from_keys
        >>> leap = leap_from_keys({"distribution": "leap-given", "seed": 0}, "drawn")
        >>> stancekit.plan(leap, stancekit.LeapFinder(order="rule")).method
        'rule'
    """

    order: Order = "finder"
    rule: Scorer = field(default_factory=Rule)
    solves: int = 100
    stop: float = STOP
    price: float = 30.0
    share: float = FRICTION_SHARE
    proof: int = 60
    seed: int = 0

    def __post_init__(self) -> None:
        checked_choice(self.order, "order", get_args(Order))
        check_numbers(self, above=("price",), least=("stop",) if self.stop != np.inf else ())
        checked(self.share, "share", above=0.0, most=1.0)
        checked_int(self.solves, "solves", least=1)
        checked_int(self.proof, "proof")
        checked_int(self.seed, "seed")
