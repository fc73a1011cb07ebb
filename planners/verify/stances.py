"""The numbers of any number of stances as arrays, and the sweep that measures every group of
constraints over all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..answer.report import GROUPS
from ..files.arrays import Array, cached_arrays, cross, lengths, locked
from ..problem import Contact, Problem
from .geometry import (
    beyond,
    contact_frames,
    counts_of,
    off_sole,
    patch_distances,
    reach_rows,
    relative_rows,
    row_counts,
    sole_points,
)

LARGEST_UNIT_M = 1.0
"""Violations are measured in the problem's scales, but in no more than this length and the robot's
weight: a file that claims huge scales buys no tolerance with them."""
BALANCES = ("force_balance", "moment_balance")
"""Groups that are judged by the Euclidean norm of what is left over."""
OF_CONTACTS = ("patch", "friction", "force_bounds", "reach")
"""Groups that have a row a contact; the others have one a stance."""
Index = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class Schedule:
    """Schedule of who stands where and who carries: M frames, N limbs, P footholds, S stances, and
    B limbs that carry in one.

    A posture is one frame with one stance in which every limb carries, each on a foothold of its
    own.
    """

    holds: Index  # (M, N), the foothold under each limb at each frame
    frame: Index  # (S,), of each stance, ascending; every frame has one
    stance: Index  # (B,), ascending
    limb: Index  # (B,)
    point: Index  # (B,), of its foot
    row_limb: Index = field(
        default_factory=lambda: np.zeros(0, dtype=np.intp)
    )  # (H,), of each half-space of reach
    apart: Index = field(
        default_factory=lambda: np.zeros((0, 2), dtype=np.intp)
    )  # (L, 2): ``relative_rows``
    linear: int = 0  # further rows of a step of the body
    least_toes: int = 0  # steps of toes with a least length, the last rows of ``apart``

    @cached_arrays
    def foothold(self) -> Index:
        """Foothold of every limb that carries, shape (B,)."""
        return np.asarray(self.holds[self.frame[self.stance], self.limb])

    @cached_arrays
    def moves(self) -> Index:
        """(foothold before, foothold after) of every toe that moves, in order of frame, then limb;
        shape (K, 2).
        """
        changed = self.holds[1:] != self.holds[:-1]
        return np.stack([self.holds[:-1][changed], self.holds[1:][changed]], axis=1)

    @cached_arrays
    def standing(self) -> Index:
        """All (frame, limb), flat, in order of the foothold there, shape (M·N,)."""
        return np.asarray(np.argsort(self.holds.ravel(), kind="stable"))

    @cached_arrays
    def first_standing(self) -> Index:
        """Index in ``standing`` at which each foothold begins, shape (P,)."""
        return np.asarray(
            np.searchsorted(np.sort(self.holds.ravel()), np.arange(self.holds.max() + 1))
        )

    @cached_arrays
    def by_foothold(self) -> Index:
        """The limbs that carry in a stance, in order of their foothold, shape (B,)."""
        return np.asarray(np.argsort(self.foothold, kind="stable"))

    @cached_arrays
    def borne(self) -> Index:
        """In how many stances something rests on each foothold, shape (P,)."""
        return np.bincount(self.foothold, minlength=int(self.holds.max()) + 1)

    @cached_arrays
    def first_borne(self) -> Index:
        """Index in ``by_foothold`` at which each foothold begins, shape (P,)."""
        return np.asarray(np.cumsum(self.borne) - self.borne)

    @cached_arrays
    def on_foothold(self) -> Array:
        """Ones where a limb that carries is on a foothold, shape (B, P)."""
        table = np.zeros((len(self.stance), len(self.borne)))
        table[np.arange(len(table)), self.foothold] = 1.0
        return table

    @staticmethod
    @lru_cache(maxsize=64)
    def of_posture(rows: tuple[int, ...], points: tuple[int, ...] = ()) -> Schedule:
        """Schedule of a posture.

        Arguments:
            rows: how many half-spaces of reach each contact has.
            points: of its foot, () for 1.
        """
        limbs = np.arange(len(rows))
        stance_contact, point = expanded(limbs, points)
        zeros = np.zeros(len(stance_contact), dtype=np.intp)
        row_limb = np.repeat(limbs, rows)
        limbs, zeros, stance_contact, point, row_limb = locked(
            (limbs, zeros, stance_contact, point, row_limb)
        )
        return Schedule(
            holds=limbs[None],
            frame=zeros[:1],
            stance=zeros,
            limb=stance_contact,
            point=point,
            row_limb=row_limb,
        )

    @staticmethod
    def of_course(course: Problem) -> Schedule:
        """Schedule of a course, who stands where from the footholds alone."""
        names = course.robot.limb_names
        holds = np.full((course.frames, len(names)), -1, dtype=np.intp)
        for p in sorted(range(len(course.footholds)), key=lambda p: course.footholds[p].frame):
            holds[course.footholds[p].frame :, names.index(course.footholds[p].limb)] = p
        limbs = [stance.limbs for stance in course.stances]
        limb, stance = (
            np.array([i for row in limbs for i in row]),
            np.repeat(np.arange(len(limbs)), [*map(len, limbs)]),
        )
        row, point = expanded(limb, counts_of(course.robot.limbs))
        toe_sides, turn_sides = course.side_rows
        changed = holds[1:] != holds[:-1]
        moves = np.stack([holds[:-1][changed], holds[1:][changed]], axis=1)
        return Schedule(
            holds=holds,
            frame=np.array([stance.frame for stance in course.stances]),
            stance=stance[row],
            limb=limb[row],
            point=point,
            row_limb=np.repeat(np.arange(len(names)), row_counts(course.robot.limbs)),
            apart=np.concatenate([relative_rows(course.robot, holds)[0], moves[: len(toe_sides)]]),
            linear=len(course.steps.linear_rows(1.0)) + (len(turn_sides) > 0),
            least_toes=len(toe_sides),
        )


def expanded(limb: Index, counts: tuple[int, ...]) -> tuple[Index, Index]:
    """A row for every point of the foot of each of some limbs: which of them, and which point.

    Arguments:
        counts: how many points each limb's foot has, () for one.
    """
    if not counts:
        return np.arange(len(limb)), np.zeros(len(limb), dtype=np.intp)
    each = np.array(counts)[limb]
    row = np.repeat(np.arange(len(limb)), each)
    return row, np.arange(len(row)) - (np.cumsum(each) - each)[row]


@dataclass(frozen=True, kw_only=True, eq=False)
class Stances:
    """S body poses with K contacts in all, those of one pose side by side, in the world frame and
    SI units.

    Arguments:
        owner: the pose of each contact, ascending, every pose has one or more.
        length_m, force_n: what violations are measured in.
        force_min_n, force_max_n: bounds in the contact frames R_WC.
        off_patch_m: how far each toe is from its patch, see ``geometry.patch_distances``.
    """

    owner: Index  # (K,)
    com_m: Array  # (S, 3)
    rotation_rad: Array  # (S, 3)
    com_nominal_m: Array  # (S, 3)
    com_radius_m: Array  # (S,)
    tilt_limit_rad: Array  # (S,)
    weight_n: Array  # (S,)
    length_m: Array  # (S,)
    force_n: Array  # (S,)
    toes_m: Array  # (K, 3)
    forces_n: Array  # (K, 3)
    frames: Array  # (K, 3, 3)
    friction: Array  # (K,)
    shoulders_m: Array  # (K, 3)
    reach_m: Array  # (K,)
    force_min_n: Array  # (K, 3)
    force_max_n: Array  # (K, 3)
    off_patch_m: Array  # (K,)
    offsets_m: Array | None = None  # (K, 3), from the toe to where the force acts, on a sole
    rows: tuple[Array, Array] | None = (
        None  # half-spaces of reach [m], see ``reach_rows``, or none at all
    )
    wrench: Array | None = (
        None  # (S, 6), force [N] and moment about the centre of mass [Nm] beside the weight
    )

    @staticmethod
    def of_postures(postures: Sequence[Plan]) -> Stances:
        """Plans of posture problems, each of the shapes that its problem asks for."""
        problems = [posture.problem for posture in postures]
        contacts = [contact for problem in problems for contact in problem.contacts]
        owner = np.repeat(np.arange(len(problems)), [len(problem.contacts) for problem in problems])
        radius, tilt, weight, length_m, scale = np.array(
            [
                (
                    p.com_radius_m[0],
                    p.tilt_limit_rad,
                    p.weight_n,
                    p.unit_m,
                    p.force_n,
                )
                for p in problems
            ]
        ).T
        numbers = np.array([(contact.patch.friction, contact.reach_m) for contact in contacts])
        axes = np.array(
            [(contact.patch.normal, contact.patch.shear_reference) for contact in contacts]
        )
        rest = np.array(
            [(contact.shoulder_m, contact.force_min, contact.force_max) for contact in contacts]
        )
        pose = np.array([(a.com_m, a.rotation_rad, a.problem.com_nominal_m) for a in postures])[
            :, :, 0
        ]
        toes = np.concatenate([posture.toes_m for posture in postures])
        bounds = rest[:, 1:] * scale[owner][:, None, None]
        whole = Stances(
            owner=owner,
            com_m=pose[:, 0],
            rotation_rad=pose[:, 1],
            com_nominal_m=pose[:, 2],
            com_radius_m=radius,
            tilt_limit_rad=tilt,
            weight_n=weight,
            length_m=np.minimum(length_m, LARGEST_UNIT_M),
            force_n=np.minimum(scale, weight),
            toes_m=toes,
            forces_n=np.concatenate([posture.forces_n[0] for posture in postures]),
            frames=contact_frames(axes[:, 0], axes[:, 1]),
            friction=numbers[:, 0],
            shoulders_m=rest[:, 0],
            reach_m=numbers[:, 1],
            force_min_n=bounds[:, 0],
            force_max_n=bounds[:, 1],
            off_patch_m=patch_distances([contact.region.vertices_m for contact in contacts], toes),
            rows=reach_rows(contacts),
            wrench=wrenches(problems),
        )
        counts = counts_of(tuple(contacts))
        return whole._on_soles(contacts, counts, postures) if counts else whole

    def _on_soles(
        self, contacts: Sequence[Contact], counts: tuple[int, ...], postures: Sequence[Plan]
    ) -> Stances:
        """Stances with a row for every point of every foot."""
        row = expanded(np.arange(len(contacts)), counts)[0]
        offsets, forces, off = [], [], []
        claims = [claim for posture in postures for claim in _claims(posture)]
        for contact, toe, whole, claim in zip(
            contacts, self.toes_m, self.forces_n, claims, strict=True
        ):
            points = sole_points(contact.sole_m, contact.patch, contact.yaw_rad)
            offsets.append(points)
            forces.append(whole[None] if claim is None else claim[1][: len(points)])
            places = toe + points if claim is None else claim[0]
            off.append(off_sole(contact.patch, contact.region, points, toe, places))
        return replace(
            self,
            owner=self.owner[row],
            toes_m=self.toes_m[row],
            forces_n=np.concatenate(forces),
            frames=self.frames[row],
            friction=self.friction[row],
            shoulders_m=self.shoulders_m[row],
            reach_m=self.reach_m[row],
            force_min_n=self.force_min_n[row],
            force_max_n=self.force_max_n[row],
            off_patch_m=np.array(off)[row],
            offsets_m=np.concatenate(offsets),
            rows=None if self.rows is None else (self.rows[0][row], self.rows[1][row]),
        )


def wrenches(problems: Sequence[Problem]) -> Array | None:
    """Wrenches on the bodies of posture problems beside their weight, shape (B, 6); None where none
    has anything.
    """
    if all(problem.wrench is None for problem in problems):
        return None
    return np.array(
        [np.zeros(6) if problem.wrench is None else problem.wrench[0] for problem in problems]
    )


def _claims(posture: Plan) -> list[tuple[Array, Array] | None]:
    """Claimed places of the points of every foot, and the forces at them; None of a posture on
    point feet.
    """
    if posture.points_m is None or posture.point_forces_n is None:
        return [None] * len(posture.toes_m)
    return list(zip(posture.points_m, posture.point_forces_n[0], strict=True))


def violations(at: Stances) -> dict[str, Array]:
    """Violation of every constraint [SI], in the order of ``GROUPS``; 0 or less where it is not.

    Shapes: patch, friction, reach (K,); force_bounds (K, 3); tilt (S, 3); com (S,); of the two
    balances what is left over, (S, 3).
    """
    owner, starts = at.owner, np.searchsorted(at.owner, np.arange(len(at.com_m)))
    arms = at.toes_m - at.com_m[owner]
    levers = arms if at.offsets_m is None else arms + at.offsets_m
    net = np.add.reduceat(at.forces_n, starts)
    net[:, 2] -= at.weight_n
    turn = np.add.reduceat(cross(levers, at.forces_n), starts)
    if at.wrench is not None:
        net, turn = net + at.wrench[:, :3], turn + at.wrench[:, 3:]
    f = (at.forces_n[:, None, :] @ at.frames)[:, 0]  # f_n, f_y, f_z            (3)
    to_toe = (
        arms - at.shoulders_m - cross(at.rotation_rad[owner], at.shoulders_m)
    )  # p_w − c − (I + [Θ]×) v  (11)
    return {
        "patch": at.off_patch_m,  # p_w = Σ λ v              (1)
        "force_balance": net,  # Σ f + m g + F = 0        (5)
        "moment_balance": turn,  # Σ (p_w − c) × f + M = 0  (6)
        "friction": lengths(f[:, 1:]) - at.friction * f[:, 0],  # ‖f_t‖ ≤ μ f_n           (10)
        "force_bounds": np.maximum(at.force_min_n - f, f - at.force_max_n),  # f_min ≤ f ≤ f_max
        "reach": beyond(
            lengths(to_toe) - at.reach_m, at.rotation_rad[owner], arms, at.rows
        ),  # ‖·‖ ≤ reach     (11)
        "tilt": np.abs(at.rotation_rad) - at.tilt_limit_rad[:, None],  # |Θ_i| ≤ tilt limit
        "com": lengths(at.com_m - at.com_nominal_m) - at.com_radius_m,  # ‖c − c_nominal‖ ≤ radius
    }


def worst_of(at: Stances, found: dict[str, Array] | None = None) -> Array:
    """The largest violation of every stance, non-dimensional, shape (S,); inf where the numbers
    overflow.

    Arguments:
        found: its ``violations``, where they are known already.
    """
    starts = np.searchsorted(at.owner, np.arange(len(at.com_m)))
    worst = np.zeros(len(at.com_m))
    with np.errstate(all="ignore"):
        units = units_of(at)
        for group, values in (found or violations(at)).items():
            if group in BALANCES:
                values = lengths(values)
            values = values if values.ndim == 1 else values.max(axis=1)
            if group in OF_CONTACTS:
                values = np.maximum.reduceat(values, starts)
            worst = np.maximum(worst, values / units[GROUPS[group]])
    return np.asarray(np.where(np.isfinite(worst), worst, np.inf))


def units_of(at: Stances) -> dict[str, Array]:
    """Units in which a violation is measured, shape (S,) each."""
    return {
        "m": at.length_m,
        "N": at.force_n,
        "Nm": at.force_n * at.length_m,
        "rad": np.ones(len(at.length_m)),
    }
