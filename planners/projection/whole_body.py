"""From a plan of contacts to one of the whole body: joint angles, no joint asked for more torque
than it has, and no link through another one or the terrain, at key frames and on the way between
them.

Four things are tried, each where the one before leaves a torque above its limit, or bodies that
collide:

* forces that spare the joints, with toes, body and joints held: stance by stance, exact (``force_distribution``);
* for torques, contacts anew: P1 and P2 of the plan's own patches with torques as rows, linearised at its joints
  (``spared_contacts``);
* steps of the whole plan, body, toes, joints and forces at once (``whole_body_step``), each restored to an exact plan
  whose path is looked at anew (``centre``);
* all again with all of the friction, where the plan keeps a reserve of it.

What is found takes the plan's place only where the verifier accepts it, and it is better: neither
its largest torque, as a share of what the joint has, nor the deepest collision is worse, as far as
they are too much. Nothing is proved where it is not: that a torque stays too large says nothing of
the course.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from ..answer.plan import Plan
from ..answer.report import LATE
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from ..errors import InvalidInput, TimeEnded, check_time
from ..files.arrays import LARGEST, Array, checked, checked_int
from ..motion.joints import STRAY_M, path_torques, plan_angles
from ..robot.kinematics import Kinematics, rotation_of
from ..robot.model import Robot
from ..verify import Report, check_plan
from .centre import APART_M, CLEAR_PRICE, Nearness, PathClearance
from .force_distribution import EASY, Restoration, Restored, along
from .held import pressing, push_share, pushed
from .whole_body_step import (
    TORQUE_PRICE,
    SparedGiven,
    WholeBodyGiven,
    WholeBodyStep,
    keeps_to,
    spared_contacts,
)


@dataclass(frozen=True, kw_only=True)
class WholeBodyLimits:
    """Limits on a plan of the whole body.

    Arguments:
        torque_nm: no joint may take more, whatever it has itself [Nm]; None: what it has.
        share: of that, steps aim at it; a plan within its limits is left as it is.
        clearance_m: where links go through the terrain, or come too near to each other, steps aim
            at this distance [m].
        steps: most steps of the whole plan; 0: forces alone.
        deepest_m: a plan whose bodies lack more than that is left as it is [m].
        reaching: steps keep legs from the ends of their reach, too, and bodies apart where forces are
            mended; more plans hold, and each step takes longer.

    Raises:
        InvalidInput: for a torque that is not positive, a share outside of (0, 1], a negative
            number of steps or distance.
    Source:
        None: joint limits of the robot's file, and requested ones.

    Example:
        >>> from stancekit import WholeBodyLimits
        >>> WholeBodyLimits(torque_nm=8.0).share
        0.9
    """

    torque_nm: float | None = None
    share: float = 0.9
    clearance_m: float = 0.005
    steps: int = 20
    deepest_m: float = math.inf
    reaching: bool = False

    def __post_init__(self) -> None:
        if self.torque_nm is not None:
            checked(self.torque_nm, "torque_nm", above=0.0)
        checked(self.share, "torque_share", above=0.0, most=1.0)
        checked(self.clearance_m, "clearance_m", least=0.0)
        checked_int(self.steps, "steps", least=0)
        checked(min(self.deepest_m, LARGEST), "deepest_m", least=0.0)

    def concern(self, robot: Robot) -> bool:
        """Tell whether a plan for the robot has to have joints: its file has legs, or torques are
        asked for.
        """
        return robot.own or self.torque_nm is not None

    def of(self, solver: Kinematics) -> Array:
        """Torque limit of every joint, shape (J,) [Nm]; inf where nothing is known and nothing
        asked for.
        """
        return np.asarray(
            np.minimum(solver.torque_nm, np.inf if self.torque_nm is None else self.torque_nm)
        )


def largest(plan: Plan, solver: Kinematics, limit_nm: Array) -> tuple[float, float]:
    """Largest torque of a plan with joints, as a share of its limit, or in Nm where no joint has
    one: (share, Nm).
    """
    assert plan.joints_rad is not None
    moments = plan.moments_nm if solver.soles else None
    rows = enumerate(zip(plan.problem.stances, plan.forces_n, strict=True))
    torques = np.abs(
        [
            solver.torques(
                plan.joints_rad[of.frame],
                rotation_of(plan.rotation_rad[of.frame]),
                forces,
                None if moments is None else moments[s],
            )
            for s, (of, forces) in rows
        ]
    )
    shares = torques / limit_nm
    at = np.unravel_index(int(np.argmax(shares if shares.any() else torques)), torques.shape)
    return float(shares[at]), float(torques[at])


def _on_the_way(plan: Plan, solver: Kinematics, limit_nm: Array) -> float:
    """Along the plan's path, where the robot is as it is executed: a share of the limit."""
    return float((np.abs(path_torques(plan, solver)[1]) / limit_nm).max(initial=0.0))


_AIM, _SPARE = 0.97, 0.02
"""Steps aim at this share of what is wanted, and leave this share of the friction, and of the
weight above what feet are to press with, times the radius: what a step is wrong by falls with its
square."""
_WIDER, _NARROWER, _NARROWEST, _WIDEST = 1.4, 0.4, 0.02, 2.0
"""Factors of the trust region's radius: after a step that was one, after one that was none, and its
bounds."""
SPARED = 2
"""So often contacts are found anew with torques as rows, each time about the plan found before,
before steps of the whole plan."""
_GAIN = 3e-4
"""A step lowers the price of what is too much by so much, or is none."""
_ENOUGH = 0.5
"""Share of the distance that bodies should keep: steps end where all have as much."""
_PATIENCE, _HEADWAY = 6, 0.02
"""So many steps together cover this part of what is left to what is wanted, or no more are
tried."""
_TRIED, _LEFT = 3, 0.3
"""Every so many steps leave no more than this share of the price of a plan that is bent only if it is
near to holding, or no more are tried."""
_TIGHTER, _ROOM = 3, 0.95
"""So often less torque is allowed at key frames, where between them there is more than this share
of the limit."""
_ATTEMPTS_M = (np.inf, APART_M, APART_M / 3.0)
"""How far apart moments are that steps keep clear: none while nothing collides, and more where that
does not do."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _WholeBodyPlan:
    """A plan with joint angles as the verifier measures it, and what it took.

    Arguments:
        share, torque_nm: of the torque that has the largest share of its limit.
        depth_m, too_near_m: how deep a link is in something at most, and what is missing to bodies
            that are clear; nan and 0 where it cannot be looked at.
        report: the verifier's; None where it was not asked.
        steps: of the whole plan, and times that its contacts were found anew.
        before: the plan as it came; None where this is it.
        late: whether the time ended before all was tried.
    """

    plan: Plan
    share: float
    torque_nm: float
    depth_m: float = math.nan
    too_near_m: float = 0.0
    report: Report[Plan] | None = None
    steps: int = 0
    before: _WholeBodyPlan | None = None
    late: bool = False

    @property
    def excess(self) -> tuple[float, float]:
        """Excess of a share above 1, and of bodies that are too near."""
        return max(self.share - 1.0, 0.0), self.too_near_m

    def better(self, other: _WholeBodyPlan) -> bool:
        """Nothing is worse as far as it is too much, and something is better."""
        mine, theirs = self.excess, other.excess
        return (
            mine[0] <= theirs[0]
            and mine[1] <= theirs[1]
            and (mine != theirs or self.share < other.share)
        )

    @property
    def details(self) -> dict[str, float]:
        """Details by name."""
        before = self.before or self
        return {
            "torque_steps": float(self.steps),
            "torque_nm_before": before.torque_nm,
            "torque_nm": self.torque_nm,
            "torque_share_before": before.share,
            "torque_share": self.share,
            "depth_m_before": before.depth_m,
            "depth_m": self.depth_m,
        }


def with_joints(plan: Plan, kinematics: Kinematics | None = None) -> Plan:
    """Add to a plan the joint angles of every key frame, and forces within torque limits where
    there are some.

    Joints and torques may still be beyond what the robot has, and bodies may collide: that is the
    verifier's to say. Raises InvalidInput without pinocchio.
    """
    return whole_body(plan, WholeBodyLimits(steps=0), kinematics).plan


def whole_body(
    plan: Plan,
    limits: WholeBodyLimits = WholeBodyLimits(),
    kinematics: Kinematics | None = None,
    start_rad: Array | None = None,
    *,
    deadline: float = math.inf,
) -> _WholeBodyPlan:
    """The plan with joint angles, with torques within the limits and bodies apart where such a plan
    is found; never a worse one.

    Arguments:
        start_rad: of a robot that stands already at the first key frame, as for ``plan_angles``.
        deadline: when the plan has to be found and judged (``time.perf_counter()``), by how long a
            look along its path takes; the best that was met until then counts.

    Raises:
        InvalidInput: without pinocchio, and for a robot whose legs are not known, and TimeEnded
            where there was not even time for joint angles.
    """
    solver = kinematics or Kinematics(plan.problem.robot, gravity_m_s2=plan.problem.gravity_m_s2)
    angles, _, _ = plan_angles(plan, solver, start_rad, deadline=deadline)
    plan = replace(plan, joints_rad=angles)
    if solver.soles:  # whose steps have no rows for what keeps a sole flat
        share, torque_nm = largest(plan, solver, limits.of(solver))
        return _WholeBodyPlan(plan=plan, share=share, torque_nm=torque_nm)
    if plan.problem.robot.own and push_share(plan):  # its plans have to bear one
        return _bent(plan, limits, solver, deadline, braced=True)
    bent = _bent(plan, limits, solver, deadline)
    if bent.steps and push_share(bent.plan) < push_share(plan):
        other = _bent(plan, limits, solver, deadline, braced=True)
        if other.excess <= bent.excess and push_share(other.plan) > push_share(bent.plan):
            return replace(other, steps=bent.steps + other.steps)
    return bent


def _bent(
    plan: Plan,
    limits: WholeBodyLimits,
    solver: Kinematics,
    deadline: float,
    *,
    braced: bool = False,
) -> _WholeBodyPlan:
    """Bend a plan that has joint angles, for ``whole_body``.

    Arguments:
        braced: its stances go on bearing the pushes that they bear.
    """
    first = bent = _at_key_frames(plan, limits, solver, deadline, braced=braced)
    if limits.torque_nm is None or not limits.steps or not first.share <= 1.0:
        return bent
    share = most = _on_the_way(bent.plan, solver, limits.of(solver))
    aim = limits
    for _ in range(_TIGHTER):
        if most <= _ROOM or time.perf_counter() > deadline:
            break
        aim = replace(aim, torque_nm=_ROOM * aim.of(solver).max() / share)
        other = _at_key_frames(plan, aim, solver, deadline, braced=braced)
        share = _on_the_way(other.plan, solver, limits.of(solver))
        measured = replace(other, share=largest(other.plan, solver, limits.of(solver))[0])
        reserved = _friction(other.plan) <= _friction(
            bent.plan
        )  # of which torque is not to cost anything
        if (
            share < most
            and reserved
            and measured.excess[1] <= bent.excess[1]
            and measured.better(first.before or first)
        ):
            bent, most = replace(measured, before=first.before or first), share
    if bent.plan.provenance["torque_nm"] == limits.torque_nm:
        return bent
    provenance = {**bent.plan.provenance, "torque_nm": limits.torque_nm}
    return replace(bent, plan=replace(bent.plan, provenance=provenance), report=None)


def _friction(plan: Plan) -> float:
    """Share of its friction that a plan may use."""
    return float(plan.provenance.get("friction_share", 1.0))


def _at_key_frames(
    plan: Plan, limits: WholeBodyLimits, solver: Kinematics, deadline: float, *, braced: bool
) -> _WholeBodyPlan:
    """Bend a plan that has joint angles, for ``whole_body``, with torques checked at key frames
    only.
    """
    provenance = (
        {} if limits.torque_nm is None else {"torque_nm": limits.torque_nm}
    )  # what the verifier holds it to
    plan = replace(plan, provenance={**plan.provenance, **provenance})
    clearance = _clearance(plan, solver, deadline) if limits.steps else None

    def judged(one: Plan) -> _WholeBodyPlan:
        share, torque_nm = largest(one, solver, limits.of(solver))
        if clearance is None:
            return _WholeBodyPlan(plan=one, share=share, torque_nm=torque_nm)
        check_time(deadline)
        report = check_plan(one, joints=True, deadline=deadline)
        if report.late:
            raise TimeEnded(LATE)
        looks = report.group("bodies").figures, report.group("motion").figures
        depth_m, too_near_m = (
            max(float(of.get(name, 0.0)) for of in looks) for name in ("depth_m", "short_m")
        )
        return _WholeBodyPlan(
            plan=one,
            share=share,
            torque_nm=torque_nm,
            depth_m=depth_m,
            too_near_m=too_near_m,
            report=report,
        )

    began = time.perf_counter()
    try:
        best = before = judged(plan)
    except TimeEnded:
        nan = math.nan
        return _WholeBodyPlan(plan=plan, share=nan, torque_nm=nan, too_near_m=nan, late=True)
    look_s, late = time.perf_counter() - began, False
    for apart_m in _ATTEMPTS_M if before.excess[1] <= limits.deepest_m else ():
        if best.share <= (EASY if best is before else 1.0) and not best.excess[1]:
            break
        if time.perf_counter() + look_s > deadline:
            late = True
            break
        if np.isinf(apart_m) and best.excess[1]:
            continue
        looks = None if np.isinf(apart_m) else clearance
        stage = _Stage(best.plan, solver, limits, looks, apart_m, deadline - look_s, braced=braced)
        candidate, steps = stage.run(collides=best.excess[1] > 0.0)
        late = late or stage.late
        if stage.slow:
            break
        if candidate is None or (clearance is None and not check_plan(candidate).accepted):
            continue
        try:
            measured = judged(candidate)
        except TimeEnded:
            late = True
            break
        if measured.better(best) and (measured.report is None or measured.report.contacts):
            best = replace(measured, steps=best.steps + steps, before=before)
    return replace(best, late=late)


def _clearance(plan: Plan, solver: Kinematics, deadline: float) -> PathClearance | None:
    """None where coal is not installed, and where no limb carries between frames."""
    if plan.problem.uncarried:
        return None
    try:
        return PathClearance(plan, solver, deadline)
    except InvalidInput:
        return None


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    """An exact plan on the way, and what is near to each other in it.

    Arguments:
        price: of what is too much.
        too_near: something has less than half of the distance that it should keep.
    """

    at: Restored
    near: Nearness | None
    price: float
    too_near: bool = False


class _Stage:
    """One plan on its way.

    Arguments:
        apart_m: how far apart the moments are that it looks at.
        braced: stances go on bearing the pushes that they bear.
        deadline: no step is begun that would end after it (``time.perf_counter()``), by how long
            the one before took.
    """

    def __init__(
        self,
        plan: Plan,
        solver: Kinematics,
        limits: WholeBodyLimits,
        clearance: PathClearance | None,
        apart_m: float,
        deadline: float,
        *,
        braced: bool,
    ) -> None:
        self._deadline, self.late, self.slow = deadline, False, False
        self._plan, self._solver, self._limits, self._limit_nm = (
            plan,
            solver,
            limits,
            limits.of(solver),
        )
        self._clearance, self._apart_m = clearance, apart_m
        self._bounds = solver.lowest_rad, solver.highest_rad
        course = pressing(plan.problem, float(plan.provenance.get("press_share", 0.0)))
        if braced:
            course = pushed(course, push_share(plan))
        course = along(course, plan)
        self._scaled, self._programs = Scaled.of(course).chosen(plan.choice), Programs()

    def run(self, *, collides: bool) -> tuple[Plan | None, int]:
        """The best plan found, None if even the first was no plan, and the number of steps."""
        friction, steps_taken = float(self._plan.provenance.get("friction_share", 1.0)), 0
        best, wanted, angles = None, EASY, np.asarray(self._plan.joints_rad)
        for share in dict.fromkeys(
            (friction, 1.0)
        ):  # a reserve of friction goes only where torque needs it
            scaled = replace(self._scaled, friction=share * self._scaled.friction)
            restoration = Restoration(
                self._plan, scaled, self._solver, self._limit_nm, friction_share=share
            )
            start = (
                (restoration.point(), angles)
                if best is None
                else (best[0].at.point, best[0].at.angles)
            )
            restored = restoration.restore(*start, wanted=wanted)
            if restored is None:
                continue
            if restored.share > 1.0 or collides:
                try:
                    begun = self._state(restored, share)
                except TimeEnded:
                    self.late = True
                    break
                if restored.share > 1.0:
                    begun, steps = self._spared(scaled, restoration, begun)
                    steps_taken += steps
                state, steps = self._stepped(scaled, restoration, begun)
                steps_taken += steps
            else:
                state = _State(at=restored, near=None, price=0.0)
            if best is None or (state.price, state.at.share) < (best[0].price, best[0].at.share):
                best = state, share
            if state.at.share <= 1.0:
                break
            wanted = 1.0
        return (None if best is None else self._as_plan(best[0].at, best[1])), steps_taken

    def _state(self, found: Restored, friction_share: float) -> _State:
        """With what is near to each other along its path."""
        near, too_near, price = (
            None,
            False,
            TORQUE_PRICE * max(found.share - self._limits.share, 0.0),
        )
        if self._clearance is not None:
            plan = self._as_plan(found, friction_share)
            near = self._clearance.nearness(
                plan, self._limits.clearance_m, self._apart_m, reaching=self._limits.reaching
            )
            missing_m = near.missing(self._limits.clearance_m).sum() + near.astray_m
            price += CLEAR_PRICE * float(missing_m) / self._scaled.length_m
            too_near = near.astray_m > STRAY_M or bool(
                near.missing(_ENOUGH * self._limits.clearance_m).any()
            )
        return _State(at=found, near=near, price=price, too_near=too_near)

    def _spared(
        self, scaled: Scaled, restoration: Restoration, state: _State
    ) -> tuple[_State, int]:
        """After contacts were found anew with torques as rows of P1 and P2, as long as that makes
        less too much; and how often that was.
        """
        rounds = min(SPARED, self._limits.steps)  # 0: forces alone
        for count in range(rounds):
            if state.at.share <= self._limits.share:
                return state, count
            if time.perf_counter() > self._deadline:
                self.late = True
                return state, count
            at = SparedGiven(
                scaled,
                state.at.point,
                solver=self._solver,
                angles=state.at.angles,
                limit_nm=self._limit_nm,
                wanted=_AIM * self._limits.share,
            )
            spared = spared_contacts(self._programs, at)
            restored = None if spared is None else restoration.restore(*spared, wanted=EASY)
            if restored is None or not keeps_to(
                self._solver, scaled.layout, state.at.angles, restored.angles
            ):
                return state, count
            try:
                other = self._state(restored, restoration.friction_share)
            except TimeEnded:
                self.late = True
                return state, count
            if other.price >= state.price - _GAIN:
                return state, count
            state = other
        return state, rounds

    def _stepped(
        self, scaled: Scaled, restoration: Restoration, state: _State
    ) -> tuple[_State, int]:
        """After steps that each lower the price, until nothing is too much, or none does; and how
        many.
        """
        radius, steps_taken, before, began = 1.0, 0, list[float](), time.perf_counter()
        for _ in range(self._limits.steps):
            now = time.perf_counter()
            began, step_s = now, now - began
            if now + step_s > self._deadline:
                self.late = True
                break
            before.append(state.price)
            stalled = (
                len(before) > _PATIENCE and before[-1] > (1.0 - _HEADWAY) * before[-1 - _PATIENCE]
            )
            due = before[0] * _LEFT ** ((len(before) - 1) // _TRIED)
            self.slow = before[-1] > due and self._limits.deepest_m < np.inf  # others are tried
            enough = state.at.share <= self._limits.share and not state.too_near
            if enough or stalled or self.slow or radius < _NARROWEST:
                break
            restored = self._step(scaled, restoration, state, radius)
            if restored is not None and not keeps_to(
                self._solver, scaled.layout, state.at.angles, restored.angles
            ):
                restored = None
            try:
                other = (
                    None if restored is None else self._state(restored, restoration.friction_share)
                )
            except TimeEnded:
                self.late = True
                break
            if other is not None and other.price < state.price - _GAIN:
                state, radius, steps_taken = other, min(_WIDER * radius, _WIDEST), steps_taken + 1
            else:
                radius *= _NARROWER
        return state, steps_taken

    def _step(
        self, scaled: Scaled, restoration: Restoration, state: _State, radius: float
    ) -> Restored | None:
        """An exact plan after a step; None where there is none.

        Where the forces of the step cannot be mended alone, body and joints are found once more for
        its toes.
        """
        spare = _SPARE * min(radius, 1.0)
        firmer = np.where(scaled.force_min > 0.0, scaled.force_min + spare, scaled.force_min)
        inside = replace(scaled, friction=(1.0 - spare) * scaled.friction, force_min=firmer)
        at = WholeBodyGiven(
            inside,
            state.at.point,
            solver=self._solver,
            angles=state.at.angles,
            limit_nm=self._limit_nm,
            wanted=_AIM * self._limits.share,
            radius=radius,
            near=state.near,
            clearance_m=self._limits.clearance_m,
        )
        restored = self._solved(at, hold_toes=False)
        if restored is None:
            return None
        other = restoration.restore(*restored, wanted=self._limits.share)
        if other is None:
            point, angles = restored[0], np.clip(restored[1], *self._bounds)
            near = at.near if self._limits.reaching else None
            moved = near and near.moved(at, point, angles - at.angles)
            at = replace(at, scaled=scaled, about=point, angles=angles, near=moved)
            restored = self._solved(at, hold_toes=True)
            other = (
                None
                if restored is None
                else restoration.restore(*restored, wanted=self._limits.share)
            )
        return other

    def _solved(self, at: WholeBodyGiven, *, hold_toes: bool) -> tuple[Point, Array] | None:
        """One program; that of a problem whose bodies are near is for it alone."""
        layout, leg_of = at.scaled.layout, tuple(self._solver.legs.tolist())
        if at.near is not None and len(at.near.distance_m):
            return WholeBodyStep(layout, leg_of, hold_toes, at).solve(at)
        return self._programs.get(WholeBodyStep, layout, leg_of, hold_toes).solve(at)

    def _as_plan(self, state: Restored, friction_share: float) -> Plan:
        """With its units back."""
        point = state.point
        provenance = (
            {"friction_share": friction_share} if "friction_share" in self._plan.provenance else {}
        )
        return replace(
            self._plan,
            com_m=self._scaled.places_m(point.com),
            rotation_rad=point.rotation,
            toes_m=self._scaled.places_m(point.toes),
            forces_n=self._scaled.forces_si(point)[0],
            joints_rad=state.angles,
            provenance={**self._plan.provenance, **provenance},
        )
