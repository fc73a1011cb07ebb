"""Files of trajectories, ``stancekit/gait/2``: JSON, the header with the verdict, and the samples as an archive in it.

The digest covers every value of both, so a file changed by hand is refused. Files of ``stancekit/gait/1`` have their
samples in NAME.npz beside them; they are read as ever, and half of a pair that belongs to another run is refused.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from ..arrays import frozen
from ..embedded import embedded, extracted
from ..files import check_writable, parse_json, read_text, write_text
from ..outcome import InvalidInput
from ..refusals import refusals
from ..scene.heightfield import HeightField
from .judge import GaitReport, check_trajectory
from .trajectory import SAMPLES, Trajectory, robot_from_json

FORMAT = "stancekit/gait/2"
PAIRED = "stancekit/gait/1"


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """A trajectory as it stood in a file. verified: the file says that the verifier accepted it, and what it said."""

    trajectory: Trajectory
    verified: bool
    verdict: Mapping[str, Any]


def write_trajectory(path: str | Path, trajectory: Trajectory, report: GaitReport) -> None:
    """Write NAME.json, whole or not at all; ``verified`` is the report's verdict.

    Raises InvalidInput for a name that does not end in .json, for a report of another trajectory, and where nothing
    can be written.
    """
    check_name(path)
    if report.trajectory.digest != trajectory.digest:
        raise InvalidInput("report: expected the verdict on this trajectory, got one on another")
    header = {
        "format": FORMAT,
        "verified": report.accepted,
        **trajectory.header(),
        "verdict": report.to_json(),
        "trajectory": trajectory.digest,
        "samples": embedded(trajectory.arrays()),
    }
    write_text(path, json.dumps(header | {"digest": _seal(header)}, indent=1, allow_nan=False) + "\n")


def check_name(path: str | Path) -> Path:
    """The file of a trajectory, asked for before the work whose result goes there. Raises InvalidInput."""
    path = Path(path)
    if path.suffix != ".json" or not path.stem:
        raise InvalidInput(f"{path}: expected a name that ends in .json")
    check_writable(path)
    return path


def read_trajectory(path: str | Path) -> Record:
    """Read a file, or an older pair. Raises InvalidInput, one line, for whatever is not as it was written."""
    path = Path(path)
    data = parse_json(read_text(path), str(path))
    if not is_trajectory(data):
        came = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise InvalidInput(f"{path}: expected an object with format {FORMAT!r}, got {came!r:.60}")
    try:
        header = _Header.model_validate(data)
    except ValidationError as error:
        raise InvalidInput(f"{path}: {'; '.join(refusals(error))}") from None
    if header.digest != _seal({name: value for name, value in data.items() if name != "digest"}):
        raise InvalidInput(f"{path}: its digest does not fit its contents: changed since it was written")
    if header.samples is None:
        samples = path.with_suffix(".npz")
        arrays = _read_arrays(samples)
    else:
        samples = Path(f"{path}: samples")
        arrays = _read_arrays(samples, extracted(header.samples, str(samples)))
    try:
        trajectory = _assemble(header, arrays)
    except InvalidInput as error:
        raise InvalidInput(f"{samples}: {error}") from None
    if trajectory.digest != header.trajectory:
        raise InvalidInput(f"{samples}: these samples do not belong to {path.name}: changed since they were written")
    return Record(trajectory=trajectory, verified=header.verified, verdict=header.verdict)


def check_file(path: str | Path) -> GaitReport:
    """Read a trajectory and verify it again, by the usual limits, whatever the file says. Raises InvalidInput."""
    return check_trajectory(read_trajectory(path).trajectory)


def is_trajectory(data: Any) -> bool:
    """Whether a parsed JSON document is the header of a trajectory."""
    return isinstance(data, dict) and data.get("format") in (FORMAT, PAIRED)


def _assemble(header: _Header, arrays: Mapping[str, NDArray[Any]]) -> Trajectory:
    robot = robot_from_json(header.robot)
    missing = [name for name in SAMPLES if name not in arrays]
    if missing:
        raise InvalidInput(f"{missing[0]}: expected this array, got nothing")
    if arrays["contact"].dtype != np.bool_:
        raise InvalidInput(f"contact: expected truth values, got {arrays['contact'].dtype}")
    count, feet = arrays["times_s"].size, len(robot.feet)
    shapes: dict[str, tuple[int, ...]] = {
        "times_s": (count,), "torso_m": (count, 3), "rotation": (count, 3, 3), "feet_m": (count, feet, 3),
        "forces_n": (count, feet, 3),
    }  # fmt: skip
    samples = {name: frozen(arrays[name], shape, name) for name, shape in shapes.items()}
    if arrays["contact"].shape != (count, feet):
        raise InvalidInput(f"contact: expected shape {(count, feet)}, got {arrays['contact'].shape}")
    surface = {name.removeprefix("terrain_"): array for name, array in arrays.items() if name.startswith("terrain_")}
    return Trajectory(
        **samples,
        contact=arrays["contact"],
        robot=robot,
        terrain=HeightField.from_arrays(surface, header.terrain),
        friction=header.friction,
        adhesive=np.array(header.adhesive, dtype=bool),
        start_xy_m=frozen(header.start_xy_m, (2,), "start_xy_m"),
        goal_xy_m=frozen(header.goal_xy_m, (2,), "goal_xy_m"),
        provenance=header.provenance,
    )


def _read_arrays(path: Path, content: bytes | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file, none of them pickled. Raises InvalidInput."""
    try:
        with np.load(path if content is None else io.BytesIO(content), allow_pickle=False) as packed:
            return {name: packed[name] for name in packed.files}
    except FileNotFoundError:
        raise InvalidInput(f"{path}: expected the samples of the trajectory, found nothing there") from None
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile):
        raise InvalidInput(f"{path}: expected arrays in .npz form, without pickled objects") from None


def _seal(header: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(header, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


class _Header(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    format: Literal["stancekit/gait/1", "stancekit/gait/2"]
    verified: bool
    robot: dict[str, Any]
    terrain: str
    friction: float
    adhesive: list[bool]
    start_xy_m: list[float]
    goal_xy_m: list[float]
    provenance: dict[str, str | float]
    verdict: dict[str, Any]
    trajectory: str
    samples: str | None = None
    digest: str

    @model_validator(mode="after")
    def _has_its_samples(self) -> Self:
        if (self.samples is None) != (self.format == PAIRED):
            raise InvalidInput(f"samples: expected in {FORMAT} and not in {PAIRED}")
        return self
