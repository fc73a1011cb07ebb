"""The formats in which motions leave, by name: what each needs, and what its files are called."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked
from stancekit.planners.files.writing import check_writable, replaced, write_bytes
from stancekit.planners.formats.motion_file import csv_of, joint_trajectory_bytes, npz_of
from stancekit.planners.motion.gait_motion import feet_motion
from stancekit.planners.motion.motion import LARGEST_RATE_HZ, Motion, table_of
from stancekit.planners.motion.plan_motion import PlanMotion
from stancekit.planners.robot.robot_file import joint_names

from ..motion.stream import joint_motion
from ..motion.time_parametrization import RATE_HZ
from .moved import Moved, Subject, scene_of


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format: how its files end, whether it is of joints, and who writes it to a path."""

    suffixes: tuple[str, ...]
    joints: bool
    write: Callable[[Moved, Path], None]


def _reference(moved: Moved, path: Path) -> None:
    from .reference import reference_bytes

    write_bytes(path, reference_bytes(moved))


def _mujoco(moved: Moved, path: Path) -> None:
    from .mjcf import mjcf_of

    write_bytes(path, mjcf_of(moved).encode())


def _foxglove(moved: Moved, path: Path) -> None:
    from .foxglove import layout_of, write_mcap

    layout = path.with_suffix(".layout.json")
    check_writable(layout)
    with replaced(path) as temporary:
        write_mcap(moved, temporary)
    write_bytes(layout, layout_of(moved).encode())


FORMATS: Mapping[str, Format] = {
    "csv": Format(
        suffixes=(".csv",),
        joints=False,
        write=lambda moved, path: write_bytes(path, csv_of(moved.table)),
    ),
    "npz": Format(
        suffixes=(".npz",),
        joints=False,
        write=lambda moved, path: write_bytes(path, npz_of(moved.table)),
    ),
    "jointtrajectory": Format(
        suffixes=(".json", ".yaml", ".yml"),
        joints=True,
        write=lambda moved, path: write_bytes(
            path, joint_trajectory_bytes(moved.table, path.suffix)
        ),
    ),
    "mujoco": Format(suffixes=(".xml",), joints=True, write=_mujoco),
    "reference": Format(suffixes=(".npz",), joints=True, write=_reference),
    "foxglove": Format(suffixes=(".mcap",), joints=False, write=_foxglove),
}
"""By the name that ``export --to`` takes."""


def moved_of(subject: Subject, to: str, rate_hz: float = RATE_HZ, source: str = "") -> Moved:
    """Sample the motion of a plan, a walk or a leap for a format.

    Arguments:
        subject: what moves.
        to: the format's name.
        rate_hz: rows per second.
        source: where it is from, for people.

    Raises:
        InvalidInput: for a format of joints where they are not known, or where ``run`` would refuse
            the motion.
    """
    checked(rate_hz, "rate_hz", above=0.0, most=LARGEST_RATE_HZ)
    without, motion = "", None
    try:
        motion = joint_motion(subject, rate_hz)
    except InvalidInput as error:
        without = str(error)
        if FORMATS[to].joints:
            raise InvalidInput(
                f"{to}: expected a motion with joints, got one without: {without}"
            ) from None
    sampled: Motion = feet_motion(subject) if motion is None else motion
    robot, limbs, terrain, gravity_m_s2 = scene_of(subject)
    joints = () if motion is None or robot is None else joint_names(robot)
    name = "" if robot is None else robot.name
    table = table_of(sampled, limbs, joints, rate_hz, robot=name, source=source)
    keys = (
        motion.motion.reached_s.tolist()
        if motion is not None and isinstance(motion.motion, PlanMotion)
        else ()
    )
    return Moved(
        table=table,
        robot=robot,
        terrain=terrain,
        gravity_m_s2=gravity_m_s2,
        keys_s=tuple(keys),
        without=without,
    )


def beside(source: Path, to: str) -> Path:
    """The file of a format beside another file: its name with an ending that neither it nor its
    samples have.
    """
    suffix = FORMATS[to].suffixes[0]
    word = "motion" if to == "npz" else to
    return source.with_suffix(f".{word}{suffix}" if suffix in (".npz", ".json") else suffix)
