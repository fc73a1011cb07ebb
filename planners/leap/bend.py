"""Leaps that legs can do: a plan is judged on the robot's own body, and what fails is bent before
it is refused.

A round measures joints along the leap, puts their speeds and torques as rows into the leap's convex
steps, linear about what was measured, with what legs that swing turn the body by, and solves again.
Where a timing does not get there, others are tried over the same contacts: longer stances, longer
or shorter flights. How legs are drawn up is chosen last.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..answer.answer import Answer, Status
from ..answer.plan import LEAP_BODY, LEAST_GATHER, MOST_GATHER, LeapPlan
from ..answer.report import Group, Report
from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs
from ..errors import InvalidInput
from ..files.arrays import Array, skew
from ..motion.joints import MovingBody
from ..motion.leap_motion import GATHER, LeapBody
from ..problem.leap import MOST_INTERVALS, Leap, Phase
from ..robot.walker import no_motors
from ..terrain.obstacles import Obstacles
from ..verify.leaps import JOINT_SPEED, JOINTS_M, TORQUE, LeapBodyMeasurements, check_leap
from .numbers import JointRows, LeapGiven, LeapNumbers, LeapPoint
from .scp import (
    FRICTION_SHARE,
    HEIGHT_RESERVE_M,
    HOLDS,
    LeapProgram,
    attempt,
    cost_of,
    nearby,
    plan_from,
    reserved,
)

SHARE, _LEAST_SHARE = 0.88, 0.5
"""Shares of joints' speeds and torques, that rows ask for; less in later rounds, but no less than
that."""
_MORE_THAN = 1.03
"""Rows ask for so much less than would make up for what was too much."""
_ROUNDS, _STEPS = 9, 8
"""Rounds at most, for one timing, and convex steps at most in each."""
_SCALES = {"joints": 0.01, "joint_speed": 1.0, "torque": 1.0}
"""What is as bad as one share of a joint, of groups that are beyond their limits; 0.1 of others."""
_STRETCHED = (
    (1.0, 1.0, 1.0),
    (1.0, 1.15, 1.0),
    (1.3, 1.0, 1.3),
    (1.3, 0.85, 1.3),
    (1.6, 1.0, 1.6),
    (1.3, 1.2, 1.3),
    (1.0, 0.8, 1.0),
)
"""Timings that are tried: stances before, flights, stances after, in units of the leap's own."""
_FINER, _NEARLY = (0.02, 0.01, 0.005), 1.03
"""Changes of how legs are drawn up where joints in the air have less than this of what they may."""
_BEND_M = 1e-4
"""Legs are bent by this to see what it changes [m]."""
_NEXT = 2
"""So many samples in the air beside a stance count as part of it."""
_AROUND = ((0.03, 0.0), (-0.03, 0.0), (0.0, 0.05), (0.0, -0.05))
"""Ways near the best of them."""
_EASY, _HARD, _WAYS = 0.9, 1.1, 3
"""Other ways are looked at where joints in the air have more than the first of what they may, and on
the ground less than the second; so many of the easiest are judged whole."""
_GATHERS = ((0.3, 0.8), (0.4, 0.9), (0.25, 0.95), (0.35, 0.7), (0.45, 1.0))
"""Ways of drawing legs up in flight that are tried."""
_MORE_M, _MOST_M = 0.003, 0.1
"""A reach that was too long is shortened by what it misses and this, and by no more in all [m]."""
_RESTARTS, _FAR_OFF_M, _MOST_SHORT_M = 3, 0.01, 0.2
"""A timing begins anew so often at most, where feet miss more than this, with a reach that is
shortened by no more than that [m]."""
_MOST_AIR_M = 0.03
"""What it misses in the air, just off a surface or just before one, counts for no more in a round
[m]."""
_SAID = 2
"""A plan says so often anew what legs turn its body by."""
NEAR_M = 0.06
"""Toes move no farther than this in a round."""
_UNLOADED_S, _UNLOADED = 0.025, 0.01
"""Toes rest on the ground so long before they lift, and press with this share of the largest force
at most: no control lets go of a force, or begins to draw up a leg, within an instant [s]."""
_FLIGHT_PARTS = 4
"""A flight says in so many parts what legs turn its body by."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _JudgedLeap:
    """A plan with what its contacts and its whole body do.

    Arguments:
        groups: of the whole body.
        report: on contacts and the whole body.
        shortened_m: by how much the reach of every limb was shortened for it, shape (N,).
        share: of joints' speeds and torques that its rows asked for.
    """

    plan: LeapPlan
    body: LeapBodyMeasurements
    groups: tuple[Group, ...]
    report: Report[LeapPlan]
    shortened_m: Array
    share: float = SHARE

    @property
    def next_share(self) -> float:
        """Share that the next rows ask for: less where it was kept and something between them was
        not.
        """
        over = [
            group.value / group.limit
            for group in self.groups
            if group.name in ("joint_speed", "torque") and group.verdict == "violated"
        ]
        less = min(_MORE_THAN * max(over), 1.15) if over else 1.0
        return max(self.share / less, _LEAST_SHARE)

    @property
    def short_m(self) -> Array:
        """Length that the reach of every limb lacks, with what was known before, shape (N,) [m]."""
        off, stands = self.body.off_toes(), self.body.postures.stands
        flying = np.minimum(np.where(stands, 0.0, off), _MOST_AIR_M)
        missed = np.where(stands, off, flying).max(axis=0)
        return np.asarray(
            np.minimum(
                self.shortened_m + np.where(missed > 1e-4, missed + _MORE_M, 0.0),
                np.maximum(_MOST_M, self.shortened_m),
            )
        )

    @property
    def accepted(self) -> bool:
        """No group of contacts or of the whole body is violated."""
        return self.report.accepted

    @property
    def score(self) -> float:
        """Distance from being accepted, in units of ``_SCALES``."""
        total = 0.0
        for group in self.report.groups:
            if group.verdict == "violated":
                total += (group.value - group.limit) / _SCALES.get(group.name, 0.1)
        return total


class LeapBender:
    """Bends one leap's plans.

    Raises InvalidInput for a robot without legs, or without limits of their joints.
    """

    def __init__(
        self,
        programs: Programs,
        *,
        share: float = FRICTION_SHARE,
        deadline: float = np.inf,
        obstacles: Obstacles | None = None,
    ) -> None:
        self._programs, self._share = programs, share
        self._deadline, self._obstacles = deadline, obstacles
        self._body: MovingBody | None = None
        self.rounds = 0

    def judge(
        self, plan: LeapPlan, shortened_m: Array | None = None, share: float = SHARE
    ) -> _JudgedLeap:
        """Joints of a plan, and its bodies where they can do it.

        Arguments:
            shortened_m, share: as of ``_JudgedLeap``.
        """
        model = plan.problem.robot.own_model()
        if self._body is None:
            if unlimited := no_motors(model):
                raise InvalidInput(f"robot {plan.problem.robot.name}: {unlimited}")
            self._body = MovingBody(model)
        measured = self._said(self._measured(plan))
        ways = [measured]
        air, ground = self._hard(measured), self._hard(measured, air=False)
        if air > _EASY and ground < _HARD:
            ways = [self._said(way) for way in self._gathered(measured)[:_WAYS]]
            measured = ways[0]
        found = self._whole(ways)
        if found is not None and len(ways) == 1 and _violated(found[1]) == {"bodies"}:
            others = [self._said(way) for way in self._gathered(measured)[:_WAYS]]
            found = self._whole([*others, measured])
        measured, groups = found or (measured, tuple(measured.groups(bodies=False)))
        plan = measured.leap_body.plan
        none = np.zeros(len(plan.problem.robot.limbs))
        report = check_leap(plan)
        contacts = tuple(group for group in report.groups if group.name not in LEAP_BODY)
        return _JudgedLeap(
            plan=plan,
            body=measured,
            groups=groups,
            report=replace(report, groups=(*contacts, *groups)),
            shortened_m=none if shortened_m is None else shortened_m,
            share=share,
        )

    def _whole(
        self, ways: Sequence[LeapBodyMeasurements]
    ) -> tuple[LeapBodyMeasurements, tuple[Group, ...]] | None:
        """The first of some ways of drawing up legs that is accepted at all samples and with its
        bodies, or else the last that comes near; None where none does.
        """
        found: tuple[LeapBodyMeasurements, tuple[Group, ...]] | None = None
        for way in ways:
            wrong = _violated(way.groups(bodies=False))
            if wrong - {"joint_speed", "torque"} or self._hard(way) > _NEARLY:
                continue
            measured = LeapBodyMeasurements(LeapBody(way.leap_body.plan, body=self._body))
            measured = self._finer(measured)
            found = measured, tuple(measured.groups(obstacles=self._obstacles))
            if not _violated(found[1]):
                break
        return found

    def _said(self, measured: LeapBodyMeasurements) -> LeapBodyMeasurements:
        """The plan that says what legs make of its turning, where nothing but speeds and torques is
        violated beside it.
        """
        for _ in range(_SAID):
            wrong = _violated(measured.groups(bodies=False))
            if "legs_turn" not in wrong or wrong - {"legs_turn", "joint_speed", "torque"}:
                break
            measured = self._measured(_as_turned(measured))
        return measured

    def _finer(self, measured: LeapBodyMeasurements) -> LeapBodyMeasurements:
        """A plan at all samples, with its way of drawing up legs a little changed where joints in
        the air have a little too much.
        """
        for step in _FINER:
            if not 1.0 < self._hard(measured) < _NEARLY or self._hard(measured, air=False) > 1.0:
                break
            plan = measured.leap_body.plan
            edge, fold = GATHER if plan.gather is None else plan.gather
            others = [
                LeapBodyMeasurements(
                    LeapBody(replace(plan, gather=np.array(each)), body=self._body)
                )
                for each in (
                    (edge + step, fold),
                    (edge - step, fold),
                    (edge, fold + step),
                    (edge, fold - step),
                )
                if np.all((each >= LEAST_GATHER) & (each <= MOST_GATHER))
            ]
            measured = min((measured, *others), key=self._hard)
        return measured

    def _gathered(self, measured: LeapBodyMeasurements) -> list[LeapBodyMeasurements]:
        """Ways of drawing up legs, the easiest on joints first: some, and those near the best."""
        known = dict[tuple[float, float], LeapBodyMeasurements]()
        plan = measured.leap_body.plan

        def hard(gather: tuple[float, float]) -> float:
            if gather not in known:
                known[gather] = self._measured(replace(plan, gather=np.array(gather)))
            return self._hard(known[gather])

        best = min(_GATHERS, key=hard)
        near = [(best[0] + a, best[1] + b) for a, b in _AROUND]
        for each in near:
            if 0.15 <= each[0] <= 0.45 and each[1] <= 1.0:
                hard(each)
        return [known[gather] for gather in sorted(known, key=hard)]

    def _measured(self, plan: LeapPlan) -> LeapBodyMeasurements:
        """A plan on the robot's own body, at half as many samples as it is judged at."""
        return LeapBodyMeasurements(LeapBody(plan, body=self._body, quick=True))

    def _hard(self, measured: LeapBodyMeasurements, *, air: bool = True) -> float:
        """Largest share of a limit that joints have in the air, or while some limb stands; a foot
        that is off its path counts a unit per centimetre.
        """
        flies = np.logical_not(measured.postures.stands.any(axis=1))
        rows = (flies if air else ~flies)[1:-1]
        off = measured.off_toes()[1:-1][rows].max(initial=0.0)
        fast = np.abs(measured.shares[0][rows]).max(initial=0.0) / JOINT_SPEED
        line = measured.line[rows].max(initial=0.0) / TORQUE
        return float(max(fast, line) + 100.0 * off * (off > JOINTS_M))

    def bent(self, plan: LeapPlan) -> tuple[_JudgedLeap, _JudgedLeap]:
        """The plan as it was judged, and the best that bending finds: the first that is accepted,
        or the one that lacks least.
        """
        first = best = self.judge(plan)
        if first.accepted:
            return first, self._eased(first)
        for k, (before, flight, after) in enumerate(_STRETCHED):
            if time.perf_counter() > self._deadline:
                break
            start = plan if k == 0 else self._retimed(plan, before, flight, after)
            if start is None:
                continue
            for judged in self._from(first if k == 0 else self.judge(start)):
                if judged.score < best.score:
                    best = judged
                if judged.accepted:
                    return first, self._eased(judged)
        return first, best

    def _eased(self, judged: _JudgedLeap) -> _JudgedLeap:
        """The leap whose toes are unloaded before they lift, and that says part by part what legs
        turn its body by; the one that there is where that is not accepted.
        """
        leap = unloaded(judged.plan.problem, judged.plan.timing)
        if leap is None or time.perf_counter() > self._deadline:
            return judged
        begun = self.judge(_over(judged.plan, leap))
        for eased in self._rounds(begun):
            if eased.accepted:
                said = self.judge(_as_turned(eased.body), eased.shortened_m, eased.share)
                return said if said.accepted else eased
        return judged

    def _from(self, begun: _JudgedLeap) -> Iterator[_JudgedLeap]:
        """Plans of one timing: in rounds from the one that was judged, and from where its feet miss
        less.
        """
        yield from self._rounds(begun)
        again = self._within_reach(begun)
        if again is not begun:
            yield from self._rounds(again)

    def _within_reach(self, judged: _JudgedLeap) -> _JudgedLeap:
        """The leap begun anew with its reach shortened by what feet missed, while that helps: rounds
        begin near what legs can do.
        """
        best = judged
        for _ in range(_RESTARTS):
            missed_m = judged.body.off_toes().max(axis=0)
            if missed_m.max() < _FAR_OFF_M or time.perf_counter() > self._deadline:
                break
            short_m = np.minimum(judged.shortened_m + missed_m + _MORE_M, _MOST_SHORT_M)
            plan = self._anew(judged.plan, short_m)
            if plan is None:
                break
            judged = self.judge(plan, short_m)
            best = judged if judged.score < best.score else best
        return best

    def _anew(self, plan: LeapPlan, shortened_m: Array | float = 0.0) -> LeapPlan | None:
        """A leap over the contacts of a plan, in its timing, from the nominal motion; None where no
        step solves it.
        """
        numbers = LeapNumbers.of(plan.problem, plan.timing)
        attempted = attempt(
            self._programs,
            numbers,
            plan.choice,
            share=self._share,
            stop=np.inf,
            shortened_m=shortened_m,
        )
        if attempted.point is None or attempted.cost > 1e2 * HOLDS:
            return None
        return _plan_of(numbers, plan.choice, attempted.point, plan)

    def _retimed(
        self, plan: LeapPlan, before: float, flight: float, after: float
    ) -> LeapPlan | None:
        """The leap over the same contacts in another timing; None where no step solves it, or the
        leap says how long it lasts.
        """
        leap = plan.problem
        if leap.duration_s is not None:
            return None
        stands = [bool(phase.limbs) for phase in leap.phases]
        air = stands.index(False) if False in stands else len(stands)
        stretch = [
            flight if not stand else before if q < air else after for q, stand in enumerate(stands)
        ]
        times_s = leap.timings_s[plan.timing]
        timing = tuple(round(s * t, 4) for s, t in zip(stretch, times_s, strict=True))
        return self._anew(replace(plan, problem=replace(leap, timings_s=(timing,)), timing=0))

    def _rounds(self, judged: _JudgedLeap) -> Iterator[_JudgedLeap]:
        """Plans of one timing, each judged, from one that was judged."""
        yield judged
        best = judged
        near = NEAR_M
        for _ in range(_ROUNDS):
            if time.perf_counter() > self._deadline or near < 0.1 * NEAR_M:
                return
            plan = self._stepped(best, near, judged.next_share)
            if plan is None:
                near *= 0.4
                continue
            self.rounds += 1
            judged = self.judge(plan, best.short_m, judged.next_share)
            yield judged
            if judged.accepted:
                return
            if judged.score < best.score:
                best = judged
            else:
                near *= 0.4

    def _stepped(self, judged: _JudgedLeap, near_m: float, share: float) -> LeapPlan | None:
        """One round: the plan of the convex steps with the joints' rows; None where its own rows do
        not hold.
        """
        plan = judged.plan
        leap = plan.problem
        numbers = legged_numbers(judged.body)
        scaled = reserved(numbers, plan.choice, self._share)
        scaled = replace(scaled, reach=scaled.reach - judged.short_m)
        program = self._programs.get(
            LeapProgram, scaled.layout, leap.still, _most(judged.body.kinematics.legs), 1.0
        )
        point = point_of(numbers, plan)
        data = LeapGiven(scaled, loaded_numbers=numbers, at=point, reserve_m=2.0 * HEIGHT_RESERVE_M)
        data = replace(data, joints=joint_rows(judged.body, data, share))
        radius = near_m
        for _ in range(_STEPS):
            answer = program.solve(nearby(data, point, radius))
            if answer.point is None:
                radius *= 0.5
                continue
            point, radius = answer.point, 0.5 * radius
            if cost_of(replace(data, joints=None), point) <= HOLDS:
                return _plan_of(numbers, plan.choice, point, plan)
        return None


def _violated(groups: Iterable[Group]) -> set[str]:
    """Names of groups that do not hold."""
    return {group.name for group in groups if group.verdict == "violated"}


def _as_turned(measured: LeapBodyMeasurements) -> LeapPlan:
    """The plan of a leap that was measured, which says that legs turn the body as they were
    measured to: c, v and L are what they were.
    """
    plan, turned = measured.leap_body.plan, measured.turned
    return replace(
        plan,
        rotation_rad=plan.rotation_rad + turned,
        legs_turn_rad=plan.turned_rad + np.diff(turned, axis=0),
    )


def unloaded(leap: Leap, timing: int) -> Leap | None:
    """A leap of one timing whose toes press with next to nothing just before all of them lift, at
    the expense of the flight; None where no flight is long enough, where some lift before others,
    and where its limits say themselves how toes lift.
    """
    parted = any(
        after.limbs and set(before.limbs) - set(after.limbs)
        for before, after in itertools.pairwise(leap.phases)
    )
    if parted or leap.limits.lift is not None:
        return None
    phases, seconds, begins = list[Phase](), list[float](), list[int]()
    for q, (phase, lasts) in enumerate(zip(leap.phases, leap.timings_s[timing], strict=True)):
        begins.append(len(phases))
        if phase.limbs or not (q and leap.phases[q - 1].limbs):
            phases.append(phase)
            seconds.append(lasts)
            continue
        if lasts < 4.0 * _UNLOADED_S:
            return None
        phases += [
            replace(leap.phases[q - 1], intervals=1),
            replace(phase, intervals=max(phase.intervals, _FLIGHT_PARTS)),
        ]
        seconds += [_UNLOADED_S, lasts - _UNLOADED_S]
        begins[-1] += 1
    if len(phases) == len(leap.phases) or sum(each.intervals for each in phases) > MOST_INTERVALS:
        return None
    return replace(
        leap,
        phases=tuple(phases),
        timings_s=(tuple(seconds),),
        footholds=tuple(replace(one, frame=begins[one.frame]) for one in leap.footholds),
        limits=replace(
            leap.limits, lift=min(_UNLOADED / max(leap.limits.force_share, 1.0), leap.limits.ramp)
        ),
    )


def _over(plan: LeapPlan, leap: Leap) -> LeapPlan:
    """A plan's forces over the finer intervals of another leap."""
    ends = leap.times_s(0)
    k = np.searchsorted(plan.ends_s, 0.5 * (ends[1:] + ends[:-1])) - 1
    method = str(plan.provenance.get("method", ""))
    numbers = LeapNumbers.of(leap, legs_turn=np.zeros((leap.intervals, 3)))
    return replace(
        plan_from(numbers, plan.choice, plan.toes_m, plan.forces_n[k], method), gather=plan.gather
    )


def legged_numbers(measured: LeapBodyMeasurements) -> LeapNumbers:
    """The numbers of a leap whose body turns as it was measured to turn: J⁻¹ of the whole robot in
    every interval, and the rest by legs that swing.
    """
    body = measured.leap_body
    plan = body.plan
    ends = np.concatenate(
        [np.searchsorted(body.times_s, plan.ends_s[:-1] - 1e-9), [len(body.times_s)]]
    )
    spins = np.array([body.spins[a:b].mean(axis=0) for a, b in itertools.pairwise(ends)])
    mean = LeapNumbers.of(plan.problem, plan.timing, spins=spins)
    turned = np.diff(measured.turned + plan.rotation_rad, axis=0)
    return replace(mean, legs_turn=turned - mean.turned(point_of(mean, plan))[1])


def _most(legs: Index) -> int:
    """Joints per leg, of the leg with most."""
    return int(np.bincount(legs).max())


def _plan_of(numbers: LeapNumbers, choice: Index, point: LeapPoint, like: LeapPlan) -> LeapPlan:
    leap = numbers.leap
    forces = np.zeros((numbers.intervals, len(leap.robot.limbs), 3))
    forces[numbers.contact_intervals, numbers.layout.contacts[1]] = point.forces * leap.weight_n
    method = str(like.provenance.get("method", ""))
    return replace(plan_from(numbers, choice, point.toes, forces, method), gather=like.gather)


def point_of(numbers: LeapNumbers, plan: LeapPlan) -> LeapPoint:
    """A plan as a point of the programs."""
    pushes = plan.forces_n[numbers.contact_intervals, numbers.layout.contacts[1]]
    pushes = pushes / plan.problem.weight_n
    com, velocity = numbers.ballistic(numbers.total(pushes))
    rotation = np.zeros_like(com)
    rotation[::2] = plan.rotation_rad
    rotation[1::2] = 0.5 * (plan.rotation_rad[1:] + plan.rotation_rad[:-1])
    return LeapPoint(
        com=com,
        rotation=rotation,
        velocity=velocity,
        momentum=plan.momentum_m2_s,
        toes=plan.toes_m,
        forces=pushes,
    )


def _halves(times_s: Array, ends_s: Array) -> list[list[tuple[int, int]]]:
    """First and last samples of the first and of the second half of every interval."""
    middle = 0.5 * (ends_s[1:] + ends_s[:-1])
    spans = [(ends_s[:-1], middle), (middle, ends_s[1:])]
    return [
        [
            (
                int(np.searchsorted(times_s, a - 1e-9)),
                int(np.searchsorted(times_s, b + 1e-9)) - 1,
            )
            for a, b in zip(*span, strict=True)
        ]
        for span in spans
    ]


def joint_rows(measured: LeapBodyMeasurements, given: LeapGiven, share: float = SHARE) -> JointRows:
    """Rows of the joints of legs that stand, about a leap that was measured, each at the sample at
    which its joint has least left; samples in the air next to a stance count as part of it.
    """
    numbers, body, solver = given.numbers, measured.leap_body, measured.kinematics
    plan, layout = body.plan, given.scaled.layout
    limbs, at = layout.contacts[1], numbers.contact_intervals
    count, most = len(at), _most(solver.legs)
    halves = _halves(body.times_s, plan.ends_s)
    ends = np.concatenate([at, at + 1])
    fast, strong = measured.shares
    worst = np.maximum(np.abs(fast) / JOINT_SPEED, measured.line)
    inner = len(body.times_s) - 2
    weight = plan.problem.weight_n
    shape = (2 * count, most)
    faster, spinning, stronger, speed_placed, torque_placed = (
        np.zeros((*shape, 3)) for _ in range(5)
    )
    footholds = np.tile(layout.contacts[2], 2)
    speed_rest, torque_rest = np.zeros(shape), np.zeros(shape)
    frames = np.concatenate([given.scaled.contact_frames] * 2)
    for b, (m, i) in enumerate(
        zip(np.tile(at, 2).tolist(), np.tile(limbs, 2).tolist(), strict=True)
    ):
        first, last = halves[b // count][m]
        stands = body.contact[:, i]
        if b < count and first > 1 and not stands[first - 1]:
            first -= _NEXT  # a leg that swings down to where it lands
        if b >= count and last < inner and not stands[last + 1]:
            last += _NEXT
        first, last = min(max(first, 1), inner), min(max(last, 1), inner)
        joints = np.flatnonzero(solver.legs == i)
        hardest = first + worst[first - 1 : last, joints].argmax(axis=0)
        node = ends[b]
        for n, (joint, k) in enumerate(zip(joints.tolist(), hardest.tolist(), strict=True)):
            angles, rotation = body.postures.angles[k], body.rotation[k]
            levers = (solver.levers(angles) @ rotation.T)[joints]
            turns = np.linalg.pinv(levers.T)  # q̇ = −(∂p/∂q)⁻¹ (v + ω × (p − c)), in world axes
            turn = turns[n]
            arms = skew(body.toes_m[k, i] - body.com_m[k])
            limit, most_nm = solver.velocity_rad_s[joint], solver.torque_nm[joint]
            faster[b, n] = -turn / limit
            spinning[b, n] = turn @ arms @ numbers.spin / limit
            force = frames[b].T @ plan.forces_n[m, i] / weight if stands[k] else np.zeros(3)
            if stands[k]:
                stronger[b, n] = -weight * levers[n] @ frames[b] / most_nm
            moves = body.velocity_m_s[k] - arms @ numbers.spin @ body.momentum_m2_s[k]
            for d in range(3):  # as the leg bends
                bent = angles.copy()
                bent[joints] += _BEND_M * turns[:, d]
                other = (solver.levers(bent) @ rotation.T)[joints]
                slower = np.linalg.pinv(other.T)[n] - turn
                speed_placed[b, n, d] = -slower @ moves / limit / _BEND_M
                push = frames[b] @ force * weight
                torque_placed[b, n, d] = -(other[n] - levers[n]) @ push / most_nm / _BEND_M
            away = plan.toes_m[footholds[b]] - plan.com_m[node]
            now = faster[b, n] @ plan.velocity_m_s[node] + spinning[b, n] @ plan.momentum_m2_s[node]
            speed_rest[b, n] = fast[k - 1, joint] - now - speed_placed[b, n] @ away
            still = stronger[b, n] @ force + torque_placed[b, n] @ away
            torque_rest[b, n] = strong[k - 1, joint] - still
    return JointRows(
        faster=faster,
        spinning=spinning,
        stronger=stronger,
        speed_placed=speed_placed,
        torque_placed=torque_placed,
        speed_rest=speed_rest,
        torque_rest=torque_rest,
        share=share,
    )


def judged_answer(
    answer: Answer[LeapPlan],
    programs: Programs,
    *,
    share: float = FRICTION_SHARE,
    deadline: float = np.inf,
    obstacles: Obstacles | None = None,
) -> Answer[LeapPlan]:
    """An answer whose plan is judged on the robot's own body, and bent where it fails; undecided
    where legs cannot do the best of them.

    Raises InvalidInput for a robot whose joints have no limits.

    Arguments:
        obstacles: what bodies keep out of; the surfaces that are taken unless others are given.
    """
    plan = answer.solution
    if plan is None or not plan.problem.robot.own:
        return answer
    bender = LeapBender(programs, share=share, deadline=deadline, obstacles=obstacles)
    first, best = bender.bent(plan)
    report = best.report
    details = dict(answer.details) | {"bending_rounds": float(bender.rounds)}
    for group in first.groups:
        details[f"{group.name}_before"] = group.value
    late = time.perf_counter() > deadline
    why = "the time ended before legs could do it" if late else "legs cannot do it"
    if not report.contacts:
        why = "contacts of the bent leap do not hold"
    status = Status.FEASIBLE if report.accepted else Status.UNDECIDED
    return replace(
        answer,
        status=status,
        solution=best.plan,
        problem=best.plan.problem,
        report=report,
        residual=report.worst,
        details=details,
        message="" if report.accepted else f"{why}: {failures(report)}",
    )


def failures(report: Report[LeapPlan]) -> str:
    """The groups that fail, with the limits that bind."""
    lines = []
    for group in report.groups:
        if group.verdict == "violated":
            unit = "" if group.unit == "1" else f" {group.unit}"
            when = ""
            if group.when is not None:
                timed = group.name in LEAP_BODY
                when = f" at {group.when:.2f} s" if timed else f", interval {group.when:g}"
            lines.append(
                f"{group.name} {group.value:.3g} of {group.limit:g}{unit} ({group.where}{when})"
            )
    return "; ".join(lines)
