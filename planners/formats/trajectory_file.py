"""Files of trajectories, ``stancekit/gait/3``: JSON, the header with the verdict, and the samples
as an archive in it.

The digest covers every value of both, so a file changed by hand is refused.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from ..answer.report import Report
from ..answer.trajectory import SAMPLES, Trajectory, robot_from_json
from ..errors import InvalidInput
from ..files.arrays import read_only, unpacked
from ..files.codec import embedded, extracted
from ..files.documents import read_json, shown, validated
from ..files.writing import check_writable, first_difference, write_text
from ..robot.model_json import robot_numbers
from ..terrain.heightfield import HeightField
from ..verify.trajectories import check_trajectory

if TYPE_CHECKING:
    from ..robot.model import Robot

FORMAT = "stancekit/gait/3"
TERRAIN = ("terrain_x_m", "terrain_y_m", "terrain_heights_m")


@dataclass(frozen=True, kw_only=True, eq=False)
class _WalkRecord:
    """A trajectory as it stood in a file.

    Arguments:
        verified: the file says that the verifier accepted it, and what it said.
    """

    trajectory: Trajectory
    verified: bool
    verdict: Mapping[str, Any]


def write_trajectory(path: str | Path, trajectory: Trajectory, report: Report[Trajectory]) -> None:
    """Write NAME.json, whole or not at all; ``verified`` is the report's verdict.

    Raises InvalidInput for a name that does not end in .json, for a report of another trajectory,
    and where nothing can be written.
    """
    check_name(path)
    if report.answer.digest != trajectory.digest:
        raise InvalidInput("report: expected the verdict on this trajectory, got one on another")
    header = {
        "format": FORMAT,
        "verified": report.accepted,
        **trajectory.header(),
        "verdict": report.to_json(),
        "trajectory": trajectory.digest,
        "samples": embedded(trajectory.arrays()),
    }
    write_text(
        path, json.dumps(header | {"digest": _seal(header)}, indent=1, allow_nan=False) + "\n"
    )


def check_name(path: str | Path) -> Path:
    """The file of a trajectory, asked for before the work whose result goes there.

    Raises InvalidInput.
    """
    path = Path(path)
    if path.suffix != ".json" or not path.stem:
        raise InvalidInput(f"{path}: expected a name that ends in .json, got something else")
    check_writable(path)
    return path


def read_trajectory(path: str | Path) -> _WalkRecord:
    """Read a file.

    Raises InvalidInput, one line, for whatever is not as it was written.
    """
    path = Path(path)
    data = read_json(path)
    came = data.get("format") if isinstance(data, dict) else type(data).__name__
    if came != FORMAT:
        raise InvalidInput(f"{path}: expected an object with format {FORMAT!r}, got {shown(came)}")
    header = validated(_Header, data, str(path))
    if header.digest != _seal({name: value for name, value in data.items() if name != "digest"}):
        raise InvalidInput(
            f"{path}: its digest does not fit its contents: changed since it was written"
        )
    samples = f"{path}: samples"
    arrays = unpacked(extracted(header.samples, samples), samples)
    try:
        trajectory = _assemble(header, arrays)
    except InvalidInput as error:
        raise InvalidInput(f"{samples}: {error}") from None
    if trajectory.digest != header.trajectory:
        raise InvalidInput(
            f"{samples}: these samples do not belong to {path.name}: changed since they were "
            "written"
        )
    return _WalkRecord(trajectory=trajectory, verified=header.verified, verdict=header.verdict)


def check_file(path: str | Path, *, robot: Robot | None = None) -> Report[Trajectory]:
    """Read a trajectory and verify it again, by the usual limits, whatever the file says.

    Arguments:
        robot: the one that the file's has to be; without it the file is believed what its robot is.

    Raises:
        InvalidInput: for a file that cannot be read, and for one of another robot.
    """
    trajectory = read_trajectory(path).trajectory
    if robot is not None and (other := _difference(trajectory.robot, robot)):
        raise InvalidInput(
            f"{path}: expected a walk of the robot {robot.name} as its file is, got one of "
            f"{trajectory.robot.name} "
            f"with numbers of its own: {other}"
        )
    return check_trajectory(trajectory)


def _difference(robot: Robot, expected: Robot) -> str:
    ours, theirs = (robot_numbers(each.to_json()) for each in (robot, expected))
    return first_difference(ours, theirs)


def is_trajectory(data: Any) -> bool:
    """Tell whether a parsed JSON document says that it is a trajectory, of any version."""
    return isinstance(data, dict) and str(data.get("format", "")).startswith("stancekit/gait/")


def _copied(trajectory: Trajectory) -> Trajectory:
    """Copy of a trajectory, made anew of the contents of its file.

    Raises InvalidInput where that is none.
    """
    header = trajectory.header() | {
        "verified": False,
        "verdict": {},
        "trajectory": "",
        "samples": "",
        "digest": "",
        "format": FORMAT,
    }
    arrays = {name: np.array(array) for name, array in trajectory.arrays().items()}
    return _assemble(_Header.model_validate(header), arrays)


def _assemble(header: _Header, arrays: Mapping[str, NDArray[Any]]) -> Trajectory:
    robot = robot_from_json(header.robot)
    missing = [name for name in SAMPLES if name not in arrays]
    if missing:
        raise InvalidInput(f"{missing[0]}: expected this array, got nothing")
    unknown = sorted(name for name in arrays if name not in SAMPLES and name not in TERRAIN)
    if unknown:
        raise InvalidInput(f"{unknown[0]}: unknown array")
    if arrays["contact"].dtype != np.bool_:
        raise InvalidInput(f"contact: expected truth values, got {arrays['contact'].dtype}")
    count, feet = arrays["times_s"].size, len(robot.feet)
    shapes: dict[str, tuple[int, ...]] = {
        "times_s": (count,),
        "torso_m": (count, 3),
        "rotation": (count, 3, 3),
        "feet_m": (count, feet, 3),
        "forces_n": (count, feet, 3),
    }
    samples = {name: read_only(arrays[name], shape, name) for name, shape in shapes.items()}
    if arrays["contact"].shape != (count, feet):
        raise InvalidInput(
            f"contact: expected shape {(count, feet)}, got {arrays['contact'].shape}"
        )
    surface = {
        name.removeprefix("terrain_"): array
        for name, array in arrays.items()
        if name.startswith("terrain_")
    }
    return Trajectory(
        **samples,
        contact=arrays["contact"],
        robot=robot,
        terrain=HeightField.from_arrays(surface, header.terrain),
        friction=header.friction,
        adhesive=np.array(header.adhesive, dtype=bool),
        start_xy_m=read_only(header.start_xy_m, (2,), "start_xy_m"),
        goal_xy_m=read_only(header.goal_xy_m, (2,), "goal_xy_m"),
        provenance=header.provenance,
        heading_rad=header.wishes.heading_rad,
        heading_end_rad=header.wishes.heading_end_rad,
        still=(header.wishes.still[0], header.wishes.still[1]),
        suction_n=header.wishes.suction_n,
    )


def _seal(header: Mapping[str, Any]) -> str:
    return hashlib.sha256(
        json.dumps(header, sort_keys=True, separators=(",", ":")).encode()
    ).hexdigest()


class _Wishes(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)
    heading_rad: float | None = None
    heading_end_rad: float | None = None
    still: list[bool] = Field(default=[False, False], min_length=2, max_length=2)
    suction_n: float | None = None


class _Header(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)
    format: Literal["stancekit/gait/3"]
    verified: bool
    robot: dict[str, Any]
    terrain: str
    friction: float
    adhesive: list[bool]
    start_xy_m: list[float]
    goal_xy_m: list[float]
    provenance: dict[str, str | float]
    wishes: _Wishes = Field(default=_Wishes(), alias="asked")
    verdict: dict[str, Any]
    trajectory: str
    samples: str
    digest: str
