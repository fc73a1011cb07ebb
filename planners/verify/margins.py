"""Margins of a stance beyond its own weight: a push, a body that is elsewhere, and less friction.

With toes and body held, the contacts of a stance balance a set of horizontal pushes at the centre
of mass, and they carry the weight from a set of places of it. Both sets are convex, shadows of the
forces within cones and bounds:

    Σ f = w e_z − F,  Σ (p − c − y F / w) × f = 0   pushes F = (F_x, F_y, 0) of a body that
                                                    gives way by y F / w
    Σ f = w e_z,      Σ (p − c − t) × f = 0         places c + t, t = (t_x, t_y, 0)

Of a course with a wrench on the body it is the loaded robot's: the weight is w e_z less the force,
the moment on the right −M, and the wrench goes where the centre of mass goes.

Their support functions are one small cone program per direction. The hull of the points that were
found lies inside of the set and its half-planes outside, so that the distance from the origin to
the border is known from both sides; what is reported is the lower one, which the contacts hold in
every direction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import clarabel
import numpy as np

from ..answer.plan import Plan
from ..answer.report import Group, Report
from ..files.arrays import Array
from ..files.codec import Columns
from ..problem.problem import Problem, Stance
from .geometry import contact_frames, cross

_CLOSE = 0.02
"""A distance is known well enough when its bounds are this close to each other, as a share."""
_DIRECTIONS = 32
"""Most directions that are tried for one distance."""
_SAME = 1e-5
"""Corners of a region this close to each other are one: what a solver leaves of a corner that it
finds twice."""
_TINY = 1e-9
"""A part of the weight, or a length [m], that is none."""
_FRICTION_STEPS = 5
"""Halvings of the interval in which the least share of the friction is sought."""
_OUTLINE = 24
"""Directions of a support region that is drawn."""


YIELDS = 0.12
"""Way that a body on its legs gives under a horizontal push as large as its weight, in units of a
leg's reach: its weight then bears nearer to the side that it tips over. Of pushes that a simulation
held the median is .14."""


@dataclass(frozen=True, kw_only=True)
class _StanceMargin:
    """Margins of one stance beyond its own weight, for any forces that its contacts may have.

    Arguments:
        frame: key frame of the stance.
        limbs: names of the limbs that carry.
        push_n: largest horizontal push at the centre of mass that is balanced in every direction
            [N].
        support_m: how far the centre of mass may move horizontally in every direction before the
            contacts no longer carry it [m].
        friction_left: share of the friction that could be missing, 0 to 1.
    """

    frame: int
    limbs: tuple[str, ...]
    push_n: float
    support_m: float
    friction_left: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Contacts:
    """The contacts of one stance.

    Arguments:
        arms_m: from the centre of mass to the points that bear, shape (n, 3) [m].
        frames: R_WC of each, shape (n, 3, 3).
        friction: of each, shape (n,).
        low, high: bounds of (f_n, f_y, f_z), in units of the weight, shape (n, 3).
        weight_n: of the robot [N].
        borne: sum and moment about the centre of mass of the contacts' forces, in units of the
            weight and metres, (6,).
        planned: the plan's forces (f_n, f_y, f_z), a sole's in equal parts, in units of the weight,
            shape (n, 3).
    """

    arms_m: Array
    frames: Array
    friction: Array
    low: Array
    high: Array
    weight_n: float
    borne: Array
    planned: Array

    @property
    def balance(self) -> Array:
        """The map from forces to their sum and their moment about the centre of mass, shape (6, 3
        n).
        """
        moments = cross(self.arms_m[:, None], self.frames.transpose(0, 2, 1)).transpose(0, 2, 1)
        return np.concatenate([np.hstack(list(self.frames)), np.hstack(list(moments))])


class _Program:
    """The cone program of n contacts: forces, and a shift in the plane, of which a direction is
    maximised.

    Variables are the shift (2,) and the forces in contact frames (n, 3), in units of the weight and
    of metres. One solver is kept and loaded anew.
    """

    def __init__(self, contacts: int) -> None:
        self._n, size = contacts, 2 + 3 * contacts
        forces = np.arange(3 * contacts)
        self._dense = np.zeros((6 + 9 * contacts, size))
        self._dense[6 + forces, 2 + forces] = 1.0
        self._dense[6 + 3 * contacts + forces, 2 + forces] = -1.0
        self._cone_rows = 6 + 6 * contacts + forces, 2 + forces
        filled = self._dense != 0.0
        filled[:6], filled[self._cone_rows] = True, True
        columns, rows = np.nonzero(filled.T)
        self._places = rows, columns
        starts = np.concatenate([[0], np.cumsum(filled.sum(axis=0))])
        matrix = Columns(np.ones(len(rows)), rows, starts, (len(filled), size))
        nothing = Columns(
            np.zeros(0), np.zeros(0, dtype=np.int_), np.zeros(size + 1, dtype=np.int_), (size, size)
        )
        cones: list[Any] = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(6 * contacts)]
        cones += [clarabel.SecondOrderConeT(3)] * contacts
        settings = clarabel.DefaultSettings()
        settings.verbose = settings.presolve_enable = settings.equilibrate_enable = False
        settings.iterative_refinement_enable = settings.chordal_decomposition_enable = False
        settings.max_threads = 1
        self._solver = clarabel.DefaultSolver(
            nothing, np.zeros(size), matrix, np.zeros(len(self._dense)), cones, settings
        )

    def support(
        self, at: _Contacts, shifts: Array, friction_share: float = 1.0
    ) -> Callable[[Array], Array | None]:
        """The function that finds the farthest shift in a direction, until the next call; None
        where no forces balance.

        Arguments:
            at: the contacts.
            shifts: what a unit of each shift adds to the balances, shape (6, 2).
            friction_share: of the friction that there is.
        """
        n, dense = self._n, self._dense
        dense[:6, :2], dense[:6, 2:] = shifts, at.balance
        slope = np.tile([0.0, -1.0, -1.0], n)
        slope[::3] = -friction_share * at.friction
        dense[self._cone_rows] = slope
        right = np.zeros(len(dense))
        right[:6], right[6 : 6 + 3 * n], right[6 + 3 * n : 6 + 6 * n] = (
            at.borne,
            at.high.ravel(),
            -at.low.ravel(),
        )
        self._solver.update(A=dense[self._places].tolist(), b=right.tolist())
        still = [0.0] * (3 * n)

        def farthest(direction: Array) -> Array | None:
            self._solver.update(q=[-float(direction[0]), -float(direction[1]), *still])
            answer: Any = self._solver.solve()
            return np.array(answer.x[:2]) if answer.status == clarabel.SolverStatus.Solved else None

        return farthest


PUSH = np.array([[1.0, 0.0], [0.0, 1.0], *np.zeros((4, 2))])
"""A push F adds F to the sum of the contacts' forces."""


def _shift(borne: Array) -> Array:
    """A centre of mass that is t elsewhere takes t × b of the moments, b the sum of the forces;
    shape (6, 2).
    """
    x, y, z = borne[:3]
    return np.array([*np.zeros((3, 2)), [0.0, -z], [z, 0.0], [-y, x]])


def stance_margins(
    plan: Plan, *, pushes_alone: bool = False, yields_m: float = 0.0
) -> tuple[_StanceMargin, ...]:
    """The margin of every stance of a plan, in the order of ``Problem.stances``.

    Arguments:
        pushes_alone: measure the pushes, and leave the rest at nan.
        yields_m: how far the body gives way under a push as large as its weight [m]; 0 for one that
            stays where it is.
    """
    programs: dict[int, _Program] = {}
    margins = []
    for index, stance in enumerate(plan.problem.stances):
        at = _contacts(plan, index)
        count = len(at.friction)
        program = programs[count] = programs.get(count) or _Program(count)
        push = _inner_distance(program.support(at, PUSH + yields_m * _shift(at.borne)))
        margins.append(
            _StanceMargin(
                frame=stance.frame,
                limbs=tuple(plan.problem.robot.limb_names[limb] for limb in stance.limbs),
                push_n=push * plan.problem.weight_n,
                support_m=math.nan
                if pushes_alone
                else _inner_distance(program.support(at, _shift(at.borne))),
                friction_left=math.nan if pushes_alone else _friction_left(program, at),
            )
        )
    return tuple(margins)


def support_region(plan: Plan, stance: Stance) -> Array:
    """Region of the centre of mass, in the plane, in which a stance carries it; corners in order.

    Returns shape (K, 2) [m], empty where the stance carries it nowhere.
    """
    at = _contacts(plan, plan.problem.stances.index(stance))
    farthest = _Program(len(at.friction)).support(at, _shift(at.borne))
    turns = np.linspace(0.0, 2.0 * math.pi, _OUTLINE, endpoint=False)
    corners = [farthest(np.array([math.cos(turn), math.sin(turn)])) for turn in turns]
    if any(corner is None for corner in corners):
        return np.zeros((0, 2))
    return np.asarray(plan.com_m[stance.frame, :2] + np.array(corners))


def verdict_yields_m(plan: Plan) -> float:
    """Distance that the verdict lets a plan's body give way under a push as large as its weight
    [m].
    """
    return YIELDS * float(np.mean([limb.reach_m for limb in plan.problem.robot.limbs]))


def least_margins(plan: Plan) -> dict[str, _StanceMargin]:
    """The margin of the stance that bears least, under each of "push_n", "support_m" and
    "friction_left"; the push is one that moves the body.

    They are the least of ``stance_margins``. Of the other stances no more is known than that each
    bears as much, which a few directions of a push say, and one program of the friction.
    """
    course, yields_m = plan.problem, verdict_yields_m(plan)
    every = [_contacts(plan, index) for index in range(len(course.stances))]
    places = [_shift(at.borne) for at in every]
    pushes = [PUSH + yields_m * place for place in places]
    sure = {"push_n": _sure_distances(every, pushes), "support_m": _sure_distances(every, places)}
    programs: dict[int, _Program] = {}
    least: dict[str, float] = dict.fromkeys(("push_n", "support_m", "friction_left"), math.inf)
    weakest: dict[str, Stance] = {}
    for index, at in enumerate(every):
        count = len(at.friction)
        program = programs[count] = programs.get(count) or _Program(count)
        distances = {
            name: _inner_distance(program.support(at, shifts[index]), enough=least[name])
            for name, shifts in (("push_n", pushes), ("support_m", places))
            if sure[name][index] < least[name]
        }
        distances["friction_left"] = _friction_left(program, at, enough=least["friction_left"])
        for name, value in distances.items():
            if value < least[name]:
                least[name], weakest[name] = value, course.stances[index]
    least["push_n"] *= course.weight_n
    return {
        name: _StanceMargin(
            frame=stance.frame,
            limbs=tuple(course.robot.limb_names[limb] for limb in stance.limbs),
            **{other: least[name] if other == name else math.nan for other in least},
        )
        for name, stance in weakest.items()
    }


def borne_share(plan: Plan, shares: Sequence[float], yields_m: float = 0.0) -> float:
    """The largest of some shares of the weight, the largest first, that a push may have which every
    stance of a plan bears; 0 for none.

    Arguments:
        yields_m: as of ``stance_margins``.
    """
    programs: dict[int, _Program] = {}
    every = [_contacts(plan, index) for index in range(len(plan.problem.stances))]
    shifts = [PUSH + yields_m * _shift(at.borne) for at in every]
    left = list(shares)
    for index in np.flatnonzero(_sure_distances(every, shifts) < max(left, default=0.0)):
        if not left:
            break
        count = len(every[index].friction)
        program = programs[count] = programs.get(count) or _Program(count)
        push = _inner_distance(program.support(every[index], shifts[index]), enough=left[0])
        left = [share for share in left if push >= share]
    return left[0] if left else 0.0


def with_margins(report: Report[Plan]) -> Report[Plan]:
    """The report with the group of margins, and with what they are in words."""
    group, plan = margin_group(report.answer), report.answer
    at, posture = group.figures, plan.problem.is_posture
    every, *frames = (
        ("it", "", "", "")
        if posture
        else ("every stance", *(f"frame {at[f'{name}_frame']}" for name in _LEAST))
    )
    push, support, friction = (f" ({frame})" if frame else "" for frame in frames)
    remark = (
        f"{every} bears a push of {at['push_n']:.3g} N, "
        f"{at['push_n'] / plan.problem.weight_n:.1%} of the weight{push}; the centre of mass is "
        f"{1e3 * at['support_m']:.0f} mm inside{support}; {1.0 - at['friction_left']:.0%} of the "
        f"friction would be enough{friction}"
    )
    return replace(report, groups=(*report.groups, group), remark=remark if report.accepted else "")


_LEAST = ("push", "support", "friction")
"""What margins are least of, in the names of their frames."""


def margin_group(plan: Plan) -> Group:
    """The verifier's word on margins: the least of each over all stances, and where it is.

    It is violated where the course asks for a push that some stance does not balance, the body
    where it is: that is what is planned. The push that is reported is one that moves the body.
    """
    least = least_margins(plan)
    figures: dict[str, Any] = {}
    for name, margin in least.items():
        figures |= {name: getattr(margin, name), f"{name.rpartition('_')[0]}_frame": margin.frame}
    weakest, wanted = least["push_n"], _asked_push(plan.problem)
    if wanted > 0.0:
        weakest = min(stance_margins(plan, pushes_alone=True), key=lambda margin: margin.push_n)
    short = max(0.0, wanted - weakest.push_n)
    message = ""
    if short > 0.0:
        limbs = " ".join(weakest.limbs)
        message = (
            f"{limbs} at frame {weakest.frame}: {weakest.push_n:.3g} N, expected {wanted:.3g} N"
        )
    return Group(
        "margin",
        value=short,
        unit="N",
        where=" ".join(weakest.limbs),
        when=float(weakest.frame),
        message=message,
        scale=plan.problem.weight_n,
        verdict="violated" if short > 0.0 else "holds",
        figures=figures,
    )


def _asked_push(course: Problem) -> float:
    """The push that every stance has to bear [N]."""
    return course.push_n


def _contacts(plan: Plan, index: int) -> _Contacts:
    """The contacts of a stance, by its number, on the patches that were chosen."""
    course, stance = plan.problem, plan.problem.stances[index]
    holds = course.holds[stance.frame]
    feet = [int(holds[limb]) for limb in stance.limbs]
    chosen = [course.patch(foot, plan.choice) for foot in feet]
    offsets = [course.offsets_m[foot][int(plan.choice[foot])] for foot in feet]
    counts = [len(offsets_of_foot) for offsets_of_foot in offsets]
    low, high = (course.force_n / course.weight_n * bounds[feet] for bounds in course.force_bounds)
    axes = np.array([(patch.normal, patch.shear_reference) for patch in chosen])
    points = np.concatenate(
        [
            plan.toes_m[foot] + offsets_of_foot
            for foot, offsets_of_foot in zip(feet, offsets, strict=True)
        ]
    )
    frames = np.repeat(contact_frames(axes[:, 0], axes[:, 1]), counts, axis=0)
    forces = plan.forces_n[index][list(stance.limbs)] / (
        course.weight_n * np.array(counts)[:, None]
    )
    return _Contacts(
        arms_m=points - plan.com_m[stance.frame],
        frames=frames,
        friction=np.repeat([patch.friction for patch in chosen], counts),
        low=np.repeat(low, counts, axis=0),
        high=np.repeat(high, counts, axis=0),
        weight_n=course.weight_n,
        borne=_borne(course, stance.frame),
        planned=(np.repeat(forces, counts, axis=0)[:, None] @ frames)[:, 0],
    )


def _borne(course: Problem, frame: int) -> Array:
    """``_Contacts.borne`` at a key frame."""
    weight = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    return weight if course.wrench is None else weight - course.wrench[frame] / course.weight_n


def _sure_distances(every: Sequence[_Contacts], shifts: Sequence[Array]) -> Array:
    """Distances that the origin surely has from the border of each stance's set of shifts, less the
    share that ``_inner_distance`` leaves open.

    The plan's forces f, made to balance, and those that balance a shift t by K t, the larger the
    normal force is: f − K t are within their bounds and cones for every t of that length. 0 where
    there are none, or these do not balance.

    Arguments:
        every: the contacts of each stance.
        shifts: what a unit of each shift adds to the balances, shape (6, 2) each.

    Returns shape (S,).
    """
    sure = np.zeros(len(every))
    counts = np.array([len(at.friction) for at in every], dtype=np.int_)
    for count in np.unique(counts):
        rows = np.flatnonzero(counts == count)
        same = [every[int(row)] for row in rows]
        balance, shift = (
            np.array([at.balance for at in same]),
            np.array([shifts[int(row)] for row in rows]),
        )
        planned, borne = np.array([at.planned for at in same]), np.array([at.borne for at in same])
        low, high = np.array([at.low for at in same]), np.array([at.high for at in same])
        friction = np.array([at.friction for at in same])
        scale = np.repeat(np.maximum(planned[:, :, 0], _TINY), 3, axis=1)[:, :, None]
        across = scale * balance.transpose(0, 2, 1)
        answer = across @ np.linalg.pinv(balance @ across, hermitian=True)
        flat = planned.reshape(len(rows), -1, 1)
        flat = flat + answer @ (borne[:, :, None] - balance @ flat)
        change = answer @ shift
        off = np.abs(balance @ change - shift).max(axis=(1, 2))
        off = np.maximum(off, np.abs(balance @ flat - borne[:, :, None]).max(axis=(1, 2)))
        force, change = flat.reshape(planned.shape), change.reshape(*planned.shape, 2)
        slope = np.maximum(np.linalg.norm(change, axis=3), _TINY)
        bounds = np.minimum((high - force) / slope, (force - low) / slope).min(axis=(1, 2))
        room = friction * force[:, :, 0] - np.linalg.norm(force[:, :, 1:], axis=2)
        used = np.linalg.norm(change[:, :, 1:], axis=(2, 3)) + friction * slope[:, :, 0]
        cones = (room / np.maximum(used, _TINY)).min(axis=1)
        sure[rows] = np.where(off < _TINY, np.minimum(bounds, cones), 0.0)
    return (1.0 - _CLOSE) * np.maximum(0.0, sure)


def _inner_distance(farthest: Callable[[Array], Array | None], enough: float = math.inf) -> float:
    """The distance from the origin to the border of a convex set that holds it, from below; 0 where
    it is empty.

    Arguments:
        farthest: the point of the set that is farthest in a direction.
        enough: a distance that need not be known any better; what is returned may then be as small
            as this.
    """
    directions: list[tuple[float, Array]] = []

    def look(turn: float) -> float:
        direction = np.array([math.cos(turn), math.sin(turn)])
        point = farthest(direction)
        if point is None:
            return 0.0
        directions.append((turn, point))
        return float(direction @ point)

    outer = math.inf
    for turn in (0.25 * math.pi, 0.75 * math.pi, 1.25 * math.pi, 1.75 * math.pi):
        outer = min(outer, look(turn))
    while outer > 0.0:
        inner, turn = _nearest_side(directions)
        if inner >= min(enough, (1.0 - _CLOSE) * outer) or len(directions) >= _DIRECTIONS:
            return max(0.0, inner)
        before = len(directions)
        outer = min(outer, look(turn))
        if len(directions) == before:
            break
    return 0.0


def _nearest_side(found: Sequence[tuple[float, Array]]) -> tuple[float, float]:
    """The distance of the nearest side of the hull of the points, and the direction that it faces
    [rad].
    """
    points = [(float(x), float(y)) for _, (x, y) in sorted(found, key=lambda each: each[0])]
    nearest, facing = math.inf, 0.0
    for (x, y), (then_x, then_y) in zip(points, [*points[1:], points[0]], strict=True):
        out_x, out_y = then_y - y, x - then_x
        length = math.hypot(out_x, out_y)
        if length > _SAME and (away := (out_x * x + out_y * y) / length) < nearest:
            nearest, facing = away, math.atan2(out_y, out_x) % math.tau
    return (nearest, facing) if math.isfinite(nearest) else (0.0, 0.0)


def _friction_left(program: _Program, at: _Contacts, enough: float = math.inf) -> float:
    """The largest share of the friction without which there are still forces, from below.

    Arguments:
        enough: a share that need not be known any better; where there are forces without it, it is
            what is returned.
    """
    held = np.zeros((6, 2))

    def stands(share: float) -> bool:
        return program.support(at, held, share)(np.zeros(2)) is not None

    if enough <= 1.0 and stands(1.0 - enough):
        return enough
    most, little = 1.0, 0.0
    for _ in range(_FRICTION_STEPS):
        middle = 0.5 * (most + little)
        if stands(middle):
            most = middle
        else:
            little = middle
    return 1.0 - most
