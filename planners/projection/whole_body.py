"""From a plan of contacts to one of the whole body: joint angles, and no joint asked for more torque than it has.

Three things are tried, each where the one before leaves a torque above its limit:

* forces that spare the joints, with toes, body and joints held: stance by stance, exact (``restoration``);
* steps of the whole plan, body, toes, joints and forces at once (``whole_body_step``), each restored to an exact plan;
* both again with all of the friction, where the plan keeps a reserve of it.

What is found takes the plan's place only where the verifier accepts it and its largest torque, as a share of what the
joint has, is lower. Nothing is proved where it is not: that a torque stays too large says nothing of the course.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..answer.plan import Plan
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Scaled
from ..files.arrays import Array
from ..robot.kinematics import Kinematics, rotation_of
from ..robot.plan_joints import plan_angles
from ..verify import check_plan
from .restoration import Restoration, Restored
from .torque_limits import TorqueLimits
from .whole_body_step import WholeBody, WholeBodyStep

EASY = 0.8
"""Forces that ask for no more than this share of any joint's torque are left as they are."""
AIM, SPARE = 0.97, 0.02
"""Steps aim at this share of what is wanted, and leave this share of the friction, times the radius: what a step is
wrong by falls with its square."""
WIDER, NARROWER, NARROWEST, WIDEST = 1.4, 0.4, 0.02, 2.0
"""Of the trust region's radius: after a step that was one, after one that was none, and its bounds."""
GAIN = 1e-4
"""A step lowers the largest share by so much, or is none."""
PATIENCE, HEADWAY = 6, 0.02
"""So many steps together cover this part of what is left to what is wanted, or no more are tried."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WholeBodyPlan:
    """A plan with joint angles, and what it took. steps: of the whole plan. before, after: (share, Nm) of the torque
    that has the largest share of its limit, of the plan as it came and of this one."""

    plan: Plan
    steps: int
    before: tuple[float, float]
    after: tuple[float, float]

    @property
    def details(self) -> dict[str, float]:
        """The same by name."""
        (share, torque), (less, lower) = self.before, self.after
        return {
            "torque_steps": float(self.steps), "torque_nm_before": torque, "torque_nm": lower,
            "torque_share_before": share, "torque_share": less,
        }  # fmt: skip


def with_joints(plan: Plan, kinematics: Kinematics | None = None) -> Plan:
    """The same plan with the joint angles of every key frame, and with forces within torque limits where it finds some.

    Joints and torques may still be beyond what the robot has: that is the verifier's to say. Raises InvalidInput
    without pinocchio.
    """
    return whole_body(plan, TorqueLimits(steps=0), kinematics).plan


def whole_body(
    plan: Plan, limits: TorqueLimits = TorqueLimits(), kinematics: Kinematics | None = None
) -> WholeBodyPlan:
    """The plan with joint angles and with torques within the limits where such a plan is found; never a worse one.

    Raises InvalidInput without pinocchio, and for a robot whose legs are not known.
    """
    solver = kinematics or Kinematics(plan.course.robot, gravity_m_s2=plan.course.gravity_m_s2)
    limit_nm = limits.of(solver)
    angles = np.array([answer.angles for answer in plan_angles(plan, solver)])
    said = {} if limits.torque_nm is None else {"torque_nm": limits.torque_nm}  # what the verifier holds it to
    plan = replace(plan, joints_rad=angles, provenance={**plan.provenance, **said})
    before = largest(plan, solver, limit_nm)
    best, after, taken = plan, before, 0
    if before[0] > EASY:
        found, steps = _Stage(plan, solver, limits).run()
        if found is not None and check_plan(found).accepted:
            share = largest(found, solver, limit_nm)
            if share[0] < before[0]:
                best, after, taken = found, share, steps
    return WholeBodyPlan(plan=best, steps=taken, before=before, after=after)


def largest(plan: Plan, solver: Kinematics, limit_nm: Array) -> tuple[float, float]:
    """Of all torques of a plan with joints the one with the largest share of its limit: (share, Nm)."""
    assert plan.joints_rad is not None
    rows = zip(plan.course.stances, plan.forces_n, strict=True)
    torques = np.abs([
        solver.torques(plan.joints_rad[of.frame], rotation_of(plan.rotation_rad[of.frame]), forces)
        for of, forces in rows
    ])  # fmt: skip
    at = np.unravel_index(int(np.argmax(torques / limit_nm)), torques.shape)
    return float((torques / limit_nm)[at]), float(torques[at])


class _Stage:
    """One plan on its way."""

    def __init__(self, plan: Plan, solver: Kinematics, limits: TorqueLimits) -> None:
        self._plan, self._solver, self._limits, self._limit_nm = plan, solver, limits, limits.of(solver)
        self._bounds = solver.lowest_rad, solver.highest_rad
        self._scaled, self._programs = Scaled.of(plan.course).chosen(plan.choice), Programs()

    def run(self) -> tuple[Plan | None, int]:
        """The best plan that was met, None where not even the first was one, and how many steps it took."""
        kept, taken = float(self._plan.provenance.get("friction_share", 1.0)), 0
        best, wanted, angles = None, EASY, np.asarray(self._plan.joints_rad)
        for share in dict.fromkeys((kept, 1.0)):  # a reserve of friction goes only where torque needs it
            scaled = replace(self._scaled, friction=share * self._scaled.friction)
            restoration = Restoration(self._plan, scaled, self._solver, self._limit_nm, friction_share=share)
            start = (restoration.point(), angles) if best is None else (best[0].point, best[0].angles)
            state = restoration.restore(*start, wanted=wanted)
            if state is None:
                continue
            if state.share > 1.0:
                state, steps = self._stepped(scaled, restoration, state)
                taken += steps
            if best is None or state.share < best[0].share:
                best = state, share
            if state.share <= 1.0:
                break
            wanted = 1.0
        return (None if best is None else self._as_plan(*best)), taken

    def _stepped(self, scaled: Scaled, restoration: Restoration, state: Restored) -> tuple[Restored, int]:
        """After steps that each lower the largest share, until it is what is wanted, or none does; and how many."""
        radius, taken, before = 1.0, 0, list[float]()
        for _ in range(self._limits.steps):
            before.append(state.share - self._limits.share)
            stalled = len(before) > PATIENCE and before[-1] > (1.0 - HEADWAY) * before[-1 - PATIENCE]
            if before[-1] <= 0.0 or stalled or radius < NARROWEST:
                break
            other = self._step(scaled, restoration, state, radius)
            if other is not None and other.share < state.share - GAIN:
                state, radius, taken = other, min(WIDER * radius, WIDEST), taken + 1
            else:
                radius *= NARROWER
        return state, taken

    def _step(self, scaled: Scaled, restoration: Restoration, state: Restored, radius: float) -> Restored | None:
        """An exact plan after a step; None where there is none.

        Where the forces of the step cannot be mended alone, body and joints are found once more for its toes.
        """
        layout, leg_of = scaled.layout, tuple(self._solver.legs.tolist())
        inside = replace(scaled, friction=(1.0 - SPARE * min(radius, 1.0)) * scaled.friction)
        at = WholeBody(
            inside, state.point, solver=self._solver, angles=state.angles, limit_nm=self._limit_nm,
            wanted=AIM * self._limits.share, radius=radius,
        )  # fmt: skip
        found = self._programs.get(WholeBodyStep, layout, leg_of, False).solve(at)
        if found is None:
            return None
        other = restoration.restore(*found, wanted=self._limits.share)
        if other is None:
            point, angles = found
            at = replace(at, scaled=scaled, about=point, angles=np.clip(angles, *self._bounds))
            found = self._programs.get(WholeBodyStep, layout, leg_of, True).solve(at)
            other = None if found is None else restoration.restore(*found, wanted=self._limits.share)
        return other

    def _as_plan(self, state: Restored, friction_share: float) -> Plan:
        """With its units back."""
        point, length_m = state.point, self._scaled.length_m
        kept = {"friction_share": friction_share} if "friction_share" in self._plan.provenance else {}
        return replace(
            self._plan, com_m=point.com * length_m, rotation_rad=point.rotation, toes_m=point.toes * length_m,
            forces_n=self._scaled.forces_si(point)[0], joints_rad=state.angles,
            provenance={**self._plan.provenance, **kept},
        )  # fmt: skip
