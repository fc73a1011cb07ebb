"""From a plan of contacts to one of the whole body: joint angles, and forces that ask of no joint more than it has.

With toes, body and joints held, forces that spare the joints are found stance by stance (``ForceDistribution``).
Balances, cones and bounds hold for them as for the plan's own, so that the plan stays one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..answer.plan import Plan
from ..files.arrays import Array
from ..robot.kinematics import Kinematics, rotation_of
from ..robot.plan_joints import plan_angles
from ..verify import check_plan
from .force_distribution import ForceDistribution, Loads

EASY = 0.8
"""Forces that ask for no more than this share of any joint's torque are left as they are."""


def with_joints(plan: Plan, kinematics: Kinematics | None = None) -> Plan:
    """The same plan with the joint angles of every key frame, and with forces within torque limits where it finds some.

    Joints and torques may still be beyond what the robot has: that is the verifier's to say. Raises InvalidInput
    without pinocchio.
    """
    solver = kinematics or Kinematics(plan.course.robot, gravity_m_s2=plan.course.gravity_m_s2)
    angles = np.array([answer.angles for answer in plan_angles(plan, solver)])
    plan = replace(plan, joints_rad=angles)
    spared = replace(plan, forces_n=_spared(plan, solver, angles))
    return spared if check_plan(spared).accepted else plan


def _spared(plan: Plan, solver: Kinematics, angles: Array) -> Array:
    """Forces of all stances, other ones where the plan's own ask much of a joint, shape (S, N, 3) [N]."""
    course, found = plan.course, np.array(plan.forces_n)
    kept = float(plan.provenance.get("friction_share", 1.0))
    distribution = ForceDistribution(len(course.robot.limbs), solver.legs.tolist())
    for row, of in enumerate(course.stances):
        weight, levers = solver.loads(angles[of.frame], rotation_of(plan.rotation_rad[of.frame]))
        loads = Loads(weight_nm=weight, levers_m=levers, limit_nm=solver.torque_nm)

        def share(forces: Array, loads: Loads = loads) -> float:
            torque = loads.weight_nm - (loads.levers_m * forces[solver.legs]).sum(axis=1)
            return float((np.abs(torque) / loads.limit_nm).max())

        asked = share(found[row])
        if asked <= EASY:
            continue
        patches = [course.patch(int(index), plan.choice) for index in course.holds[of.frame]]
        bears = np.isin(np.arange(len(patches)), of.limbs)
        arms = plan.toes_at(of.frame) - plan.com_m[of.frame]
        for reserve in dict.fromkeys((kept, 1.0)):  # a reserve of friction goes only where torque needs it
            other = distribution.forces(course, arms, patches, bears, loads=loads, reserves=(reserve,), least=0.0)
            if other is not None and share(other) < asked:
                found[row], asked = other, share(other)
            if asked <= 1.0:
                break
    return found
