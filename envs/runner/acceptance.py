"""What may be run: a plan that the verifier accepted, unchanged since, for the robot that the world has."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stancekit.planners.kinematics import joint_report
from stancekit.planners.outcome import InvalidInput
from stancekit.planners.plan import Plan
from stancekit.planners.plan_file import read_plan
from stancekit.planners.scene import Robot
from stancekit.planners.scene.urdf import joint_names
from stancekit.planners.verify import check_plan

from ..worlds.world import World


@dataclass(frozen=True, kw_only=True, eq=False)
class Accepted:
    """A plan that may be run. digest: the verifier's; source: where it comes from, for messages."""

    plan: Plan
    digest: str
    source: str

    @classmethod
    def from_file(cls, path: str | Path) -> Accepted:
        """Read a plan file. Raises InvalidInput for one that was edited since, that the verifier rejected, or that it
        rejects now: a digest shows that a file is whole, not that it is right."""
        plan, header = read_plan(path)
        verdict = header["verdict"]
        if not (header["verified"] and verdict["accepted"]):
            raise InvalidInput(f"{path}: expected a plan that the verifier accepted, this one it rejected")
        return cls.verified(plan, str(path), digest=verdict["digest"])

    @classmethod
    def verified(cls, plan: Plan, source: str, digest: str | None = None) -> Accepted:
        """Verify a plan now. Raises InvalidInput for one that is rejected."""
        report = check_plan(plan)
        if not report.accepted:
            raise InvalidInput(f"{source}: expected a plan that the verifier accepts, {report.message}")
        return cls(plan=plan, digest=digest or report.digest, source=source)

    def check_fits(self, world: World) -> None:
        """Raise InvalidInput unless the world has the plan's robot, and its joints can take every pose of the plan."""
        check_joints(self.source, self.plan.course.robot, world)
        report = joint_report(self.plan, world.servo)
        if not report.accepted:
            raise InvalidInput(f"{self.source}: expected joints that can do it, they cannot: {report.message}")


def check_joints(source: str, robot: Robot, world: World) -> None:
    """Raise InvalidInput unless the world has the robot's joints, in their order, and is for such a robot."""
    wanted, found = joint_names(robot), world.joints
    if tuple(found) != wanted:
        lack, more = sorted(set(wanted) - set(found)), sorted(set(found) - set(wanted))
        said = "; ".join(
            f"{word} {', '.join(names[:4])}{' …' if len(names) > 4 else ''}"
            for word, names in (("it lacks", lack), ("it has besides", more)) if names
        )  # fmt: skip
        raise InvalidInput(
            f"{source}: expected world {world.name} to have the robot's {len(wanted)} joints in their order"
            + (f": {said}" if said else ", it has them in another")
        )
    wrong = _differs(robot, world.robot)
    if wrong:
        raise InvalidInput(f"{source}: expected the world's robot, the plan is for another: {wrong}")


def _differs(plan: Robot, world: Robot) -> str:
    """The first number in which two robots differ; empty where there is none."""
    if not np.isclose(plan.mass_kg, world.mass_kg, rtol=1e-6):
        return f"{plan.mass_kg:g} kg and {world.mass_kg:g} kg"
    for mine, other in zip(plan.limbs, world.limbs, strict=True):
        if not np.isclose(mine.reach_m, other.reach_m, rtol=1e-6):
            return f"limb {mine.name} reaches {mine.reach_m:g} m and {other.reach_m:g} m"
        if not np.allclose(mine.shoulder_m, other.shoulder_m, atol=1e-6):
            return f"limb {mine.name} begins at {mine.shoulder_m.tolist()} and {other.shoulder_m.tolist()}"
    return ""
