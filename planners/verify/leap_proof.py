"""Independent check of a certificate that no leap exists: a tree over toes' candidates, and bounds
at its leaves.

A leaf's multipliers give, for every motion that obeys the hard limits, a sum that is not above
zero:

    Σ r·(p − c − (I + [Θ]×) s) − |r| ρ          reach of a limb that stands, ρ widened by ½ |Θ|² |s|
  + Σ σ (a·(p − c) + Θ·(a × s) − b)             half-spaces of reach, b widened likewise
  + Σ η (p_z + height − c_z)                    height of the body
  + q·(c_end − goal) − |q| radius               where the body arrives
  + u·(v_end − v_goal)                          how fast
  + Σ ν·(F − e_z) + Σ μ·(Σ p × f − c × e_z)     equilibrium of the intervals at rest

with c and v written in the forces. Its least value over toes in their patches, forces in their
cones and |Θ_i| ≤ tilt splits into a constant and a number per candidate; above zero it refutes
every choice of the leaf. There is no place for rows that are no relaxations: speeds, powers,
lengths, and linearised moments cannot be weighed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from ..answer.certificate import Certificate
from ..answer.report import Report
from ..errors import InvalidInput
from ..files.arrays import Array, cross, lengths
from ..physics import GRAVITY_M_S2
from ..problem.leap import Leap
from .certificate import Refused, expect, leaves_of, proof_report
from .explanation import Explanation, Relaxation, halved
from .geometry import most_turned

_MOST_GRIP = 3.0
"""An explanation looks no further."""
_ONE_BODY = "a robot of one rigid body, got legs of its own, which shift its hips as they move"
GUARD = 1e-7
"""A leaf's bound has to be above this, for multipliers of at most 1: far more than rounding."""


def check_leap_certificate(certificate: Certificate) -> Report[Certificate]:
    """Replay a certificate's tree and bound every leaf; never raises for a bad certificate of a
    leap.
    """
    leap = certificate.refuted
    assert isinstance(leap, Leap)
    try:
        expect(not leap.robot.own, _ONE_BODY)
        leaves = _replayed(leap, certificate)
        timed = [_Bounds(leap, timing) for timing in range(len(leap.timings_s))]
        bounds = np.array([timed[timing].parts(row).least(of) for timing, of, row in leaves])
    except (InvalidInput, Refused) as error:
        return proof_report(certificate, GUARD, 0.0, 0, -1, f"rejected: {error}")
    weakest = int(bounds.argmin())
    bound = float(bounds[weakest])
    if bound > GUARD:
        message = f"refuted at all leaves ({len(bounds)})"
    else:
        message = f"rejected: leaf {weakest} of {len(bounds)} proves {bound:.3g}, expected above {GUARD:g}"
    return proof_report(certificate, GUARD, bound, len(bounds), weakest, message)


class Refuter:
    """Proofs that multipliers give about single choices of a leap's candidates, worked out anew
    without a solver.
    """

    def __init__(self, leap: Leap) -> None:
        self._leap = leap
        self._timing = cache(partial(_Bounds, leap))
        self._parts: dict[tuple[int, bytes], _Parts] = {}

    def bounds(self, timing: int, row: Array, choices: NDArray[np.int_]) -> Array:
        """The bound that a row of multipliers has for each choice of a timing; above ``GUARD`` it
        refutes the choice.

        Returns shape (K,); −inf where there is no such timing, no such candidate, or a number that
        is not finite, and of a robot with legs of its own, whose hips move as they do. Multipliers
        are taken in units of the largest.

        Arguments:
            choices: a candidate per foothold, shape (K, P).
        """
        nothing = np.full(len(choices), -np.inf)
        options = np.array([len(foothold.candidates) for foothold in self._leap.footholds])
        if self._leap.robot.own or timing not in range(len(self._leap.timings_s)):
            return nothing
        shaped = choices.ndim == 2 and choices.shape[1] == len(options)
        if not (np.isfinite(row).all() and shaped):
            return nothing
        try:
            parts = self._weighed(timing, row / max(float(np.abs(row).max(initial=0.0)), 1e-300))
        except Refused:
            return nothing
        there = ((choices >= 0) & (choices < options)).all(axis=1)
        value = cache(partial(parts.bounds.candidate, parts))
        for k in np.flatnonzero(there).tolist():
            nothing[k] = parts.constant + sum(
                value(j, r) for j, r in enumerate(choices[k].tolist())
            )
        return nothing

    def _weighed(self, timing: int, row: Array) -> _Parts:
        """Weights of a row of multipliers, worked out once."""
        key = (timing, row.tobytes())
        if key not in self._parts:
            self._parts[key] = self._timing(timing).parts(row)
        return self._parts[key]


def explain_leap(certificate: Certificate) -> Explanation:
    """Measure how far friction under each toe, or reach of each limb, must grow at least before a
    certificate fails.

    Returns these growths, the smallest relative one first, and the first of them in one line; a
    certificate that is not accepted explains nothing.
    """
    leap, report = certificate.refuted, check_leap_certificate(certificate)
    assert isinstance(leap, Leap)
    if not report.accepted:
        return Explanation(
            relaxations=(), message=f"not explained: the certificate is {report.message}"
        )
    timed = [_Bounds(leap, timing) for timing in range(len(leap.timings_s))]
    leaves = [(timed[timing].parts(row), of) for timing, of, row in _replayed(leap, certificate)]
    frictions = [
        Relaxation(
            parameter=f"friction under {foothold.limb} in phase {foothold.frame}",
            leg=foothold.limb,
            now=max(patch.friction for patch in foothold.candidates),
            needed=min(parts.grip_needed(opened, j) for parts, opened in leaves),
            unit="",
        )
        for j, foothold in enumerate(leap.footholds)
    ]
    reaches = [
        Relaxation(
            parameter=f"reach of {limb.name}",
            leg=limb.name,
            now=limb.reach_m,
            needed=limb.reach_m + min(parts.reach_needed(opened, i) for parts, opened in leaves),
            unit="m",
        )
        for i, limb in enumerate(leap.robot.limbs)
    ]
    helpful = [each for each in frictions if each.needed > each.now]
    relaxations = sorted([*helpful, *reaches], key=lambda one: one.relative)
    best = relaxations[0]
    if not math.isfinite(best.needed):
        message = "infeasible: no friction and no reach of a single toe would do"
    elif best.unit:
        message = f"infeasible: {best.leg} cannot reach far enough: {best.now:.3g} m, {best.needed:.3g} m needed"
    else:
        phase = best.parameter.rpartition(" ")[2]
        message = (
            f"infeasible: no candidate of {best.leg} in phase {phase} can push enough: μ "
            f"{best.now:.2f} at most, "
            f"{best.needed:.2f} needed"
        )
    return Explanation(relaxations=tuple(relaxations), message=message)


_Open = tuple[list[int], list[list[int]]]
"""Timings, and candidates by foothold, that are open."""


def _replayed(leap: Leap, certificate: Certificate) -> list[tuple[int, list[list[int]], Array]]:
    """(timing, open candidates by foothold, multipliers) of every leaf of a tree, in preorder."""
    tree, rows = certificate.tree, certificate.multipliers
    shaped = tree.shape[1:] == (5,) and len(tree) and rows.ndim == 2
    expect(shaped, "a tree of rows of five numbers, and a row of multipliers per leaf")
    finite = np.isfinite(tree).all() and np.isfinite(rows).all()
    expect(finite, "finite numbers, got other values")
    whole = [list(range(len(foothold.candidates))) for foothold in leap.footholds]

    def children(
        node: _Open, _: str, kind: float, first: float, second: float, *__: float
    ) -> list[_Open]:
        timings, opened = node
        if kind == 4.0 and first in timings and len(timings) > 1:
            others = [timing for timing in timings if timing != first]
            return [(others, opened), ([int(first)], opened)]
        if kind == 1.0 and first in range(len(opened)) and second in opened[int(first)]:
            j, r = int(first), int(second)
            on, off = [list(options) for options in opened], [list(options) for options in opened]
            on[j] = [r]
            off[j].remove(r)
            return [(timings, off), (timings, on)]
        raise Refused(
            f"expected a leaf, a timing or an open candidate, got node {[kind, first, second]}"
        )

    leaves = list(leaves_of(tree, (list(range(len(leap.timings_s))), whole), children))
    expect(all(len(timings) == 1 for timings, _ in leaves), "one timing at a leaf")
    many = f"{len(leaves)} rows of multipliers, one per leaf, got {len(rows)}"
    expect(len(leaves) == len(rows), many)
    return [(timings[0], opened, row) for (timings, opened), row in zip(leaves, rows, strict=True)]


@dataclass(frozen=True, eq=False)
class _Parts:
    """A leaf's sum: a constant, slopes on toes, slopes on forces and levers by interval, |r| by
    limb.
    """

    bounds: _Bounds
    constant: float
    toes: Array
    slopes: Array
    levers: Array
    pulls: Array

    def least(self, opened: list[list[int]], but: int = -1) -> float:
        """The least value of the sum over open candidates.

        Arguments:
            but: a foothold that is left out.
        """
        total = self.constant
        for j, option in enumerate(opened):
            if j != but:
                total += min((self.bounds.candidate(self, j, r) for r in option), default=math.inf)
        return total

    def grip_needed(self, opened: list[list[int]], j: int) -> float:
        """The least friction of foothold ``j`` at which the leaf fails, inf where none up to
        ``_MOST_GRIP`` does.
        """
        rest = self.least(opened, but=j)

        def holds(grip: float) -> bool:
            values = (self.bounds.candidate(self, j, r, grip) for r in opened[j])
            return rest + min(values, default=math.inf) > GUARD

        return math.inf if holds(_MOST_GRIP) else halved(holds, 0.0, _MOST_GRIP, 16)[1]

    def reach_needed(self, opened: list[list[int]], i: int) -> float:
        """Additional reach of a limb with which the leaf would fail [m]; inf where it weighs
        nothing.
        """
        return self.least(opened) / self.pulls[i] if self.pulls[i] > 0.0 else math.inf


class _Bounds:
    """The bounds of one timing of a leap, written from its own patches, limbs and limits.

    A limb stands at the ends and the middle of intervals, by time, then limb: seconds, limb and
    foothold of each are ``time``, ``limb`` and ``foot``.
    """

    def __init__(self, leap: Leap, timing: int) -> None:
        self.leap, self.ends, limbs = leap, leap.times_s(timing), leap.robot.limbs
        self.holds = leap.holds[leap.interval_phases]
        air = np.pad(self.holds < 0, ((1, 1), (0, 0)))
        self.most = leap.limits.most(air[:-2], air[2:])
        held = np.vstack([np.repeat(self.holds, 2, axis=0), np.full((1, len(limbs)), -1)])
        held[2::2] = np.where(held[2::2] < 0, self.holds, held[2::2])
        self.instant, self.limb = np.nonzero(held >= 0)
        self.foot = held[self.instant, self.limb]
        self.time = np.interp(0.5 * self.instant, np.arange(len(self.ends)), self.ends)
        self._spaces()
        self.rests = np.flatnonzero(leap.still) * (leap.intervals - 1)
        count, rests = len(self.limb), 3 * len(self.rests)
        self.sizes = (3 * count, len(self.row), count, 3, 3, rests, rests)

    def _spaces(self) -> None:
        """Shoulders and widened reach of limbs that stand; half-spaces of reach, widened, and the
        limb that stands of each.
        """
        limbs, tilt = self.leap.robot.limbs, self.leap.limits.tilt_rad
        bend, rows = 1.5 * tilt**2, list[int]()
        normals, bounds = [np.zeros((0, 3))], [np.zeros(0)]
        for at, limb in enumerate(limbs[number] for number in self.limb.tolist()):
            if (spaces := limb.reach_rows) is not None:
                rows += [at] * len(spaces.bounds_m)
                normals.append(spaces.normals)
                out = bend * lengths(limb.shoulder_m) + tilt * most_turned(limb.shoulder_m)
                room = tilt * most_turned(spaces.normals) * (limb.reach_m + out)
                bounds.append(spaces.bounds_m + room)
        self.row = np.array(rows, dtype=np.intp)
        self.normals, self.bounds = np.concatenate(normals), np.concatenate(bounds)
        self.shoulders = np.array([limb.shoulder_m for limb in limbs])[self.limb]
        reach_m = np.array([limb.reach_m for limb in limbs])[self.limb]
        self.reach = reach_m + bend * lengths(self.shoulders)

    def parts(self, row: Array) -> _Parts:
        """Weights of multipliers.

        Raises Refused for a row of another length.
        """
        expect(
            len(row) == sum(self.sizes), f"{sum(self.sizes)} multipliers per leaf, got {len(row)}"
        )
        reach, spaces, height, goal, end, rest, moment = np.split(row, np.cumsum(self.sizes)[:-1])
        reach, rest, moment = (part.reshape(-1, 3) for part in (reach, rest, moment))
        spaces, height = np.maximum(spaces, 0.0), np.maximum(height, 0.0)
        leap, limits, ends = self.leap, self.leap.limits, self.ends
        start, last, sizes = leap.start, float(ends[-1]), lengths(reach)
        pull, twist = reach.copy(), cross(reach, self.shoulders)
        weighed = spaces[:, None] * self.normals
        np.add.at(pull, self.row, weighed)
        np.add.at(twist, self.row, cross(weighed, self.shoulders[self.row]))
        pull[:, 2] += height
        twists, toes = np.zeros((2 * len(ends) - 1, 3)), np.zeros((len(leap.footholds), 3))
        np.add.at(twists, self.instant, twist)
        np.add.at(toes, self.foot, pull)
        # −μ·(c × e_z) = −(μ_x c_y − μ_y c_x)
        on_com = np.stack([moment[:, 1], -moment[:, 0], np.zeros(len(moment))], axis=1)
        slope = np.concatenate([-pull, goal[None], on_com])
        time = np.concatenate([self.time, [last], np.minimum(self.rests, 1) * last])[:, None]
        fall = np.array([0.0, 0.0, -GRAVITY_M_S2])
        place = start.com_m + time * start.velocity_m_s + 0.5 * time**2 * fall
        since = np.maximum(time - ends, 0.0) ** 2
        slopes = 0.5 * GRAVITY_M_S2 * (since[:, :-1] - since[:, 1:]).T @ slope
        slopes += GRAVITY_M_S2 * np.diff(ends)[:, None] * end
        levers = np.zeros_like(slopes)
        np.add.at(slopes, self.rests, rest)
        np.add.at(levers, self.rests, moment)
        constant = float(np.vecdot(slope, place).sum() + height.sum() * limits.height_m)
        constant -= float(np.vecdot(reach, self.shoulders).sum() + sizes @ self.reach)
        constant -= float(spaces @ self.bounds + limits.tilt_rad * np.abs(twists).sum())
        constant -= float(goal @ leap.goal.com_m + lengths(goal) * leap.goal_radius_m)
        constant += float(end @ (start.velocity_m_s + last * fall - leap.goal.velocity_m_s))
        constant -= float(rest[:, 2].sum())
        pulls = np.zeros(len(leap.robot.limbs))
        np.add.at(pulls, self.limb, sizes)
        return _Parts(self, constant, toes, slopes, levers, pulls)

    def candidate(self, parts: _Parts, j: int, r: int, grip: float | None = None) -> float:
        """The least of P·p + Σ (y + μ × p)·f over a candidate, at a corner of it.

        Arguments:
            grip: another friction.
        """
        foothold, patch = self.leap.footholds[j], self.leap.footholds[j].candidates[r]
        friction = patch.friction if grip is None else grip
        corners = patch.vertices_m if foothold.toe_m is None else foothold.toe_m[None]
        limb = self.leap.robot.limb_names.index(foothold.limb)
        k = np.flatnonzero(self.holds[:, limb] == j)
        slope = parts.slopes[k, None] + cross(parts.levers[k, None], corners)
        normal = slope @ patch.normal
        shear = lengths(slope - normal[..., None] * patch.normal)
        work = self.most[k, limb] @ np.minimum(normal - friction * shear, 0.0)
        return float((corners @ parts.toes[j] + work).min())
