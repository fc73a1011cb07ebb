"""Motions that may be run: plans, gaits, leaps and crossings that the verifier accepted, for the
robot that the world has.

They are judged once, when they come in: ``Accepted.from_file`` and ``Accepted.verified`` are the
border. Behind it frozen values pass by reference (docs/SECURITY.md says what that
trusts).
"""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Sequence
from ctypes.util import find_library
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

import numpy as np
from packaging.requirements import Requirement

from stancekit.planners.answer.motion import Motion
from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.codec import to_json
from stancekit.planners.formats.motion_file import read_motion
from stancekit.planners.robot import Robot
from stancekit.planners.robot.leg import ActuatorModel
from stancekit.planners.verify import Report
from stancekit.planners.verify.judge import judge
from stancekit.planners.verify.postures import joint_groups

if TYPE_CHECKING:
    from .safety.guard import SafeWorld

TOOLS = ("dev",)
"""Extras for working on the package, which no command needs."""


def about(
    *, measure: bool, progress: Callable[[int, int, str], None] = lambda done, total, stage: None
) -> dict[str, Any]:
    """Describe the installation and the machine, as a report of a bug needs them.

    Arguments:
        measure: whether to measure the speed, which takes some seconds.
        progress: called with the steps done, their number, and the name of the next.

    Returns:
        Plain values by name; solves_s [s] is None where nothing was measured.
    """
    record: dict[str, Any] = {
        "stancekit": version("stancekit"),
        "folder": str(Path(__file__).parent.parent),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "core": versions(None),
        "extras": {extra: versions(extra) for extra in extras()},
        "gl": gl(),
        "cores": cores(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0,
        "solves_s": None,
    }
    if measure:
        from stancekit.planners.equilibrium.yardstick import yardstick

        progress(0, 1, "1,000 cold solves")
        record["solves_s"] = yardstick()
        progress(1, 1, "done")
    return record


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def load() -> float:
    """Processes that wanted a processor in the last minute, for each that there is; NaN if unknown."""
    return os.getloadavg()[0] / cores() if hasattr(os, "getloadavg") else float("nan")


def extras() -> list[str]:
    """The extras that commands need, by the package's own metadata."""
    from importlib.metadata import metadata

    return [
        name for name in metadata("stancekit").get_all("Provides-Extra") or [] if name not in TOOLS
    ]


def versions(extra: str | None) -> dict[str, str | None]:
    """The version of every package of an extra, or of the core for None; None for one that is not
    installed.

    Packages that an extra has no use for on this platform are left out, and so are those of extras
    that it includes.
    """
    result: dict[str, str | None] = {}
    for text in requires("stancekit") or []:
        need = Requirement(text)
        mine = (
            need.marker is None
            if extra is None
            else need.marker is not None and "extra" in str(need.marker)
        )
        if not mine or need.name == "stancekit":
            continue
        if need.marker is not None and not need.marker.evaluate({"extra": extra or ""}):
            continue
        try:
            result[need.name] = version(need.name)
        except PackageNotFoundError:
            result[need.name] = None
    return result


def gl() -> str:
    """The library that MuJoCo's renderer draws films with here, empty where there is none."""
    chosen = os.environ.get("MUJOCO_GL", "")
    if chosen or sys.platform != "linux":
        return chosen or "of the system"
    return find_library("EGL") or find_library("OSMesa") or ""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointNeeds:
    """Torque requirements of J joints, shape (J,) each.

    Arguments:
        peak_nm, rms_nm: largest torque over the motion, and its root mean square [Nm].
        stall_nm, continuous_nm: stall and continuous torque of the actuators [Nm]. continuous_nm,
            and heat, the largest thermal load during the motion, are NaN if the continuous torque
            is not known.
    """

    joints: tuple[str, ...]
    peak_nm: Array
    rms_nm: Array
    stall_nm: Array
    continuous_nm: Array
    heat: Array

    @classmethod
    def of(
        cls,
        joints: Sequence[str],
        actuators: Sequence[ActuatorModel],
        torques_nm: Array,
        period_s: float,
    ) -> Self:
        """Torque requirements of joints over a motion.

        Arguments:
            torques_nm: torques of the joints, shape (T, J) [Nm].
            period_s: time between two rows of ``torques_nm`` [s].
        """
        stall = np.array([each.stall_nm for each in actuators])
        continuous = np.array(
            [np.nan if each.continuous_nm is None else each.continuous_nm for each in actuators]
        )
        constants = np.array(
            [np.nan if each.thermal_s is None else each.thermal_s for each in actuators]
        )
        return cls(
            joints=tuple(joints),
            peak_nm=np.abs(torques_nm).max(axis=0),
            rms_nm=np.sqrt(np.mean(torques_nm**2, axis=0)),
            stall_nm=stall,
            continuous_nm=continuous,
            heat=thermal_load((torques_nm / continuous) ** 2, constants, period_s),
        )

    @property
    def share_of_stall(self) -> Array:
        """Peak torque as a share of the stall torque."""
        return self.peak_nm / self.stall_nm

    @property
    def share_of_continuous(self) -> Array:
        """Mean torque, by its square, as a share of the continuous one; NaN where it is not
        known.
        """
        return self.rms_nm / self.continuous_nm

    def said(self, joint: int) -> str:
        """Needs of one joint, in words."""
        heat = (
            f", {self.heat[joint]:.2g} times the heat that it bears"
            if self.heat[joint] > 1.0
            else ""
        )
        return f"{self.peak_nm[joint]:.3g} Nm at most and {self.rms_nm[joint]:.3g} Nm (RMS){heat}"

    @property
    def line(self) -> str:
        """The joint that needs the largest share, for people."""
        peak = int(np.argmax(self.share_of_stall))
        result = f"{self.peak_nm[peak]:.3g} Nm at most, {self.share_of_stall[peak]:.0%} of {self.joints[peak]}'s stall"
        if np.isnan(self.heat).all():
            return (
                f"{result}; {self.rms_nm.max():.3g} Nm (RMS), what it bears for long is not known"
            )
        worst = int(np.nanargmax(self.heat))
        rms, share = f"{self.rms_nm[worst]:.3g} Nm (RMS)", f"{self.share_of_continuous[worst]:.0%}"
        return (
            f"{result}; {rms}, {share} of {self.joints[worst]}'s continuous torque, "
            f"{self.heat[worst]:.2f} of the heat "
            "that it bears"
        )

    def to_json(self) -> dict[str, Any]:
        """JSON-ready, by joint."""
        columns = {
            "peak_nm": self.peak_nm,
            "rms_nm": self.rms_nm,
            "of_stall": self.share_of_stall,
            "of_continuous": self.share_of_continuous,
            "heat": self.heat,
        }
        return {
            joint: {
                name: None if np.isnan(column[i]) else float(column[i])
                for name, column in columns.items()
            }
            for i, joint in enumerate(self.joints)
        }


def thermal_load(squares: Array, constants_s: Array, period_s: float) -> Array:
    """The largest load on the way from cold, shape (J,): of (τ / τ_c)², shape (T, J), so long
    apart.
    """
    decay = np.exp(-period_s / constants_s)
    load = worst = np.zeros(squares.shape[1])
    for row in squares:
        load = decay * load + (1.0 - decay) * row
        worst = np.maximum(worst, load)
    return np.where(np.isnan(constants_s), squares.mean(axis=0), worst)


S = TypeVar("S", bound=Motion[Any])


@dataclass(frozen=True, kw_only=True, eq=False)
class Accepted(Generic[S]):
    """A motion that may be run: a plan of a course, a gait, a leap or a crossing.

    Arguments:
        plan: the motion; of a gait its trajectory.
        digest: the verifier's.
        source: where it comes from, for messages.
    """

    plan: S
    digest: str
    source: str

    @classmethod
    def from_file(cls, path: str | Path) -> Accepted[Any]:
        """Read a file of any of these.

        Raises InvalidInput for one that was edited since, that the verifier rejected, or that it
        rejects now (a digest shows that a file is whole, not that it is right), for one without a
        motion, and for a robot whose joints are not known.
        """
        motion, content = read_motion(path)
        if not (content["verified"] and content["verdict"].get("accepted")):
            raise InvalidInput(
                f"{path}: expected a {motion.word} that the verifier accepted, this one it rejected"
            )
        return Accepted.verified(motion, str(path))

    @classmethod
    def verified(cls, plan: S, source: str) -> Accepted[S]:
        """Verify a motion now.

        Raises InvalidInput for one that is rejected, that no runner executes, or whose robot's
        joints are not known; a leap has to begin and end at rest, and to be judged with its legs.
        """
        report = report_on(plan, source)
        if hindrance := report.hindrance:
            raise InvalidInput(
                f"{source}: expected a {plan.word} that can be executed, this one cannot: {hindrance}"
            )
        return Accepted(plan=plan, digest=report.digest, source=source)

    @cached_property
    def robot(self) -> Robot:
        """The robot that moves."""
        return self.plan.legged

    @property
    def name(self) -> str:
        """Name of the course or the leap; of a gait that of its terrain."""
        return self.plan.name

    @property
    def gravity_m_s2(self) -> float:
        """Gravity that it counts on [m/s²]."""
        return self.plan.gravity_m_s2


def check_fits(accepted: Accepted[Plan], world: SafeWorld) -> None:
    """Raise InvalidInput unless the world has the plan's robot, and its joints can take every pose
    of the plan.
    """
    check_joints(accepted.source, accepted.robot, world, accepted.gravity_m_s2)
    _, *groups = joint_groups(accepted.plan, world.servo)
    if faults := [group.message for group in groups if group.verdict == "violated"]:
        raise InvalidInput(
            f"{accepted.source}: expected joints that can do it, they cannot: {'; '.join(faults)}"
        )


def judged(motion: Motion[Any]) -> Report[Any]:
    """The verifier on a motion; of a plan on joints and bodies, too, where it has
    angles or the robot has legs of its own.
    """
    return judge(motion, joints=motion.joints_rad is not None or motion.robot.own)


def report_on(motion: Motion[Any], source: str) -> Report[Any]:
    """The verifier's report on a motion that it accepts.

    Raises InvalidInput, with its message, for one that it rejects.
    """
    report = judged(motion)
    if not report.accepted:
        raise InvalidInput(
            f"{source}: expected a {motion.word} that the verifier accepts, {report.message}"
        )
    return report


def check_joints(source: str, robot: Robot, world: SafeWorld, gravity_m_s2: float) -> None:
    """Raise InvalidInput unless the world has the robot's joints, in their order, is for such a
    robot, and pulls as it is planned for, where it says how it pulls.
    """
    wanted, there = robot.joint_names, world.joints
    if tuple(there) != wanted:
        lack, more = sorted(set(wanted) - set(there)), sorted(set(there) - set(wanted))
        differences = "; ".join(
            f"{word} {', '.join(names[:4])}{' …' if len(names) > 4 else ''}"
            for word, names in (("it lacks", lack), ("it has besides", more))
            if names
        )
        raise InvalidInput(
            f"{source}: expected world {world.name} to have the robot's {len(wanted)} joints in "
            "their order" + (f": {differences}" if differences else ", it has them in another")
        )
    wrong = _differs(robot, world.robot)
    if wrong:
        raise InvalidInput(
            f"{source}: expected the world's robot, the plan is for another: {wrong}"
        )
    pulls = getattr(world, "gravity_m_s2", None)
    if pulls is not None and not np.isclose(pulls, gravity_m_s2, rtol=1e-6):
        raise InvalidInput(
            f"{source}: expected the world's gravity, {pulls:g} m/s², the plan is for another: "
            f"{gravity_m_s2:g} m/s²"
        )


def _differs(plan: Robot, world: Robot) -> str:
    """The first number in which two robots differ; empty where there is none."""
    if not np.isclose(plan.mass_kg, world.mass_kg, rtol=1e-6):
        return f"{plan.mass_kg:g} kg and {world.mass_kg:g} kg"
    models = [robot.digest for robot in (plan, world)]
    if models[0] != models[1]:
        return (
            "their legs are of different files"
            if all(models)
            else "only one of them has legs of its own"
        )
    for mine, other in zip(plan.limbs, world.limbs, strict=True):
        if not np.isclose(mine.reach_m, other.reach_m, rtol=1e-6):
            return f"limb {mine.name} reaches {mine.reach_m:g} m and {other.reach_m:g} m"
        if not np.allclose(mine.shoulder_m, other.shoulder_m, atol=1e-6):
            return f"limb {mine.name} begins at {mine.shoulder_m.tolist()} and {other.shoulder_m.tolist()}"
        sets = [to_json(limb.reach_rows) for limb in (mine, other)]
        if sets[0] != sets[1]:
            return f"limb {mine.name} has other half-spaces of reach"
    return ""
