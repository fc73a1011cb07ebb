"""Files of motions as tables: CSV, NPZ and ROS's JointTrajectory as JSON or YAML, written and read
back.

A CSV has one row per moment and a header of names: ``t``, ``q.JOINT``, ``qd.JOINT``, ``tau.JOINT``,
``contact.LIMB``, ``force.LIMB.x``, ``foot.LIMB.x``, ``body.x``, ``body.qw``, ``com.x``,
``com_v.x``, ``body_w.x``; SI units, world frame.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput, located, require
from ..files.arrays import Array, archive_of, checked_int, read_archive, read_only
from ..files.documents import YAML, neighbour, read_json, read_text, read_yaml, shown, yaml_of
from ..motion.motion import FORMAT, OF_JOINTS, OF_LIMBS, MotionTable, shapes

_AXES = "xyz"
_OF_BODY = {
    **{f"body.{axis}": ("origin_m", k) for k, axis in enumerate(_AXES)},
    **{f"body.q{axis}": ("quaternion", k) for k, axis in enumerate("wxyz")},
    **{f"com.{axis}": ("com_m", k) for k, axis in enumerate(_AXES)},
    **{f"com_v.{axis}": ("velocity_m_s", k) for k, axis in enumerate(_AXES)},
    **{f"body_w.{axis}": ("turning_rad_s", k) for k, axis in enumerate(_AXES)},
}
"""Columns of the body: the array, and which number of a row."""
_OF_POINTS = {"positions": "angles_rad", "velocities": "rates_rad_s", "effort": "torques_nm"}
"""Keys of a JointTrajectory's points, and the arrays that they hold."""
_TIME, _NANO = "t", 1_000_000_000


def _columns_of(table: MotionTable) -> dict[str, Array]:
    """The numbers of a table by the names of their columns, in order, each of shape (T,)."""
    known = table.arrays()
    places = _places(table.joints, table.limbs, known)
    return {name: known[key].T[place[::-1]] for name, (key, place) in places.items()}


def csv_of(table: MotionTable) -> bytes:
    """A table as CSV.

    Numbers are written so that the same ones are read back, to the last bit.
    """
    columns, text = _columns_of(table), io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    kinds = [int if name.startswith("contact.") else float for name in columns]
    rows = np.column_stack([column.astype(np.float64) for column in columns.values()]).tolist()
    writer.writerows(
        [kind(number) for kind, number in zip(kinds, row, strict=True)] for row in rows
    )
    return text.getvalue().encode()


def npz_of(table: MotionTable, **more: str) -> bytes:
    """A table as an NPZ archive: an array per name, the names of joints and limbs, and more that is
    said of it.
    """
    words = {name: getattr(table, name) for name in ("joints", "limbs", "robot", "source")}
    return archive_of({**table.arrays(), **words, **more, "format": FORMAT})


def joint_trajectory(table: MotionTable) -> dict[str, Any]:
    """A table as ROS 2's trajectory_msgs/JointTrajectory, JSON-ready: joints alone.

    Raises InvalidInput without any.
    """
    known = table.arrays()
    require(
        "angles_rad" in known, "jointtrajectory: expected a motion with joints, got one without"
    )
    rows = {key: known[name].tolist() for key, name in _OF_POINTS.items() if name in known}
    moments = [divmod(round(time_s * _NANO), _NANO) for time_s in table.time_s.tolist()]
    points = [
        {key: row[k] for key, row in rows.items()}
        | {"time_from_start": {"sec": sec, "nanosec": nanosec}}
        for k, (sec, nanosec) in enumerate(moments)
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": list(table.joints), "points": points}


def joint_trajectory_bytes(table: MotionTable, suffix: str) -> bytes:
    """Content of a file with the joint trajectory of a table: YAML for ".yaml" and ".yml", else
    JSON.
    """
    message = joint_trajectory(table)
    if suffix not in YAML:
        return (json.dumps(message) + "\n").encode()
    return yaml_of(message, width=1_000_000).encode()


def is_table(path: str | Path, data: object) -> bool:
    """Tell whether a file holds a motion as a table: by its name, a JSON file by its contents."""
    suffix = Path(path).suffix
    if suffix in YAML:
        with suppress(InvalidInput):
            return _is_joint_trajectory(read_yaml(path))
    if suffix == ".npz":
        with suppress(InvalidInput):
            return str(read_archive(path).get("format")) == FORMAT
    return suffix in (".csv", ".xml") or (suffix == ".json" and _is_joint_trajectory(data))


def _is_joint_trajectory(data: object) -> bool:
    """Tell whether the data is a JointTrajectory, by its keys."""
    return isinstance(data, Mapping) and {"joint_names", "points"} <= set(data)


def read_table(path: str | Path) -> MotionTable:
    """Read a table from .csv, .npz, or a JointTrajectory in .json or .yaml.

    Raises InvalidInput, with what is wrong.
    """
    readers: dict[str, Callable[[Path], MotionTable]] = {
        ".csv": lambda path: _from_csv(read_text(path), str(path)),
        ".npz": _from_npz,
        ".json": lambda path: _from_joint_trajectory(read_json(path), str(path)),
        **dict.fromkeys(YAML, lambda path: _from_joint_trajectory(read_yaml(path), str(path))),
    }
    path = Path(path)
    require(path.suffix in readers, f"{path}: expected a motion as .csv, .npz, .json or .yaml")
    with located(str(path)):
        return readers[path.suffix](path)


def _places(
    joints: Sequence[str], limbs: Sequence[str], keys: Collection[str]
) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Places of the columns' numbers in the arrays of these keys, in the order of a file."""
    places: dict[str, tuple[str, tuple[int, ...]]] = {_TIME: ("time_s", ())}
    places |= {name: (key, (k,)) for name, (key, k) in _OF_BODY.items() if key in keys}
    for key in (key for key in (*OF_JOINTS, *OF_LIMBS) if key in keys):
        word, one = {**OF_JOINTS, **OF_LIMBS}[key], key in OF_JOINTS or key == "contact"
        for k, owner in enumerate(joints if key in OF_JOINTS else limbs):
            places |= (
                {f"{word}.{owner}": (key, (k,))}
                if one
                else {f"{word}.{owner}.{axis}": (key, (k, n)) for n, axis in enumerate(_AXES)}
            )
    return places


def _from_csv(text: str, where: str) -> MotionTable:
    lines = csv.reader(io.StringIO(text))
    names = [name.strip() for name in next(lines, [])]
    joints, limbs = _named(names, where)
    rows = list(_rows(lines, names, where))
    require(rows, f"{where}: expected rows below the header, got none")
    columns = dict(zip(names, np.array(rows).T, strict=True))
    arrays = dict[str, Any]()
    for key, shape in shapes(len(rows), len(joints), len(limbs)).items():
        wanted = [name for name, (of, _) in _places(joints, limbs, (key,)).items() if of == key]
        there = [name for name in wanted if name in columns]
        if not there or not wanted:
            continue
        if len(there) < len(wanted):
            lacks = next(name for name in wanted if name not in columns)
            raise InvalidInput(f"{where}: expected the column {lacks} beside {there[0]}, got none")
        arrays[key] = np.stack([columns[name] for name in wanted], axis=-1).reshape(shape)
    if "contact" in arrays:
        arrays["contact"] = _truths(arrays["contact"], where)
    return MotionTable(joints=joints, limbs=limbs, columns=arrays, source=where)


def _named(names: Sequence[str], where: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Joints and limbs in the order in which columns name them first.

    Raises InvalidInput for an unknown column.
    """
    joints, limbs = dict[str, None](), dict[str, None]()
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InvalidInput(f"{where}: expected each column once, got {twice} again")
    require(_TIME in names, f"{where}: expected the column t, got {', '.join(names)!r:.80}")
    for name in names:
        word, dot, rest = name.partition(".")
        if name == _TIME or name in _OF_BODY:
            continue
        if dot and rest and word in OF_JOINTS.values():
            joints[rest] = None
        elif dot and rest and word in OF_LIMBS.values():
            limbs[rest if word == "contact" else rest.rpartition(".")[0]] = None
        else:
            known = (
                _TIME,
                *_OF_BODY,
                *(f"{one}.NAME" for one in (*OF_JOINTS.values(), "contact")),
                "force.NAME.x",
            )
            raise InvalidInput(
                f"{where}: expected columns as t, q.JOINT, force.LIMB.x, got "
                f"{name!r:.60}{neighbour(name, known)}"
            )
    return tuple(joints), tuple(limbs)


def _rows(lines: Iterator[list[str]], names: Sequence[str], where: str) -> Iterator[list[float]]:
    for number, line in enumerate(lines, 1):
        if line and len(line) != len(names):
            raise InvalidInput(
                f"{where}: row {number}: expected {len(names)} numbers, got {len(line)}"
            )
        if line:
            place = f"{where}: row {number}, column"
            yield [_number(part, place, name) for part, name in zip(line, names, strict=True)]


def _number(part: str, place: str, name: str) -> float:
    with suppress(ValueError):
        if math.isfinite(number := float(part)):
            return number
    raise InvalidInput(f"{place} {name}: expected a finite number, got {shown(part)}")


def _truths(numbers: NDArray[Any], where: str) -> NDArray[np.bool_]:
    odd = numbers[~np.isin(numbers, (0, 1))]
    if odd.size:
        raise InvalidInput(f"{where}: contact: expected 0 or 1, got {odd[0]:g}")
    return np.asarray(numbers == 1)


def _from_npz(path: Path) -> MotionTable:
    archive = read_archive(path)
    require(
        str(archive.get("format")) == FORMAT,
        f"{path}: format: expected {FORMAT}, got {shown(archive.get('format'))}",
    )
    joints, limbs = (
        tuple(map(str, np.atleast_1d(archive[name]))) if name in archive else ()
        for name in ("joints", "limbs")
    )
    arrays: dict[str, Any] = {name: archive[name] for name in shapes(0, 0, 0) if name in archive}
    for name, array in arrays.items():
        if array.dtype.kind not in ("biuf" if name == "contact" else "iuf"):
            raise InvalidInput(f"{name}: expected numbers, got {shown(array.tolist())}")
    timed = "time_s" in arrays and arrays["time_s"].ndim == 1
    require(timed, f"{path}: expected time_s of shape (T,), got none")
    if "contact" in arrays:
        arrays["contact"] = _truths(arrays["contact"], str(path))
    return MotionTable(
        joints=joints,
        limbs=limbs,
        columns=arrays,
        robot=str(archive.get("robot", "")),
        source=str(path),
    )


def _from_joint_trajectory(data: Any, where: str) -> MotionTable:
    require(
        _is_joint_trajectory(data),
        f"{where}: expected a JointTrajectory with joint_names and points, got {shown(data)}",
    )
    names, points = data["joint_names"], data["points"]
    for key, kind, wanted in (("joint_names", str, "names"), ("points", Mapping, "points")):
        given = data[key]
        right = given and isinstance(given, list) and all(isinstance(each, kind) for each in given)
        require(right, f"{where}: {key}: expected a list of {wanted}, got {shown(given)}")
    times = np.array([_seconds(point, k, where) for k, point in enumerate(points)])
    arrays: dict[str, Any] = {"time_s": times}
    for key, name in _OF_POINTS.items():
        if not points[0].get(key):
            require(
                not any(point.get(key) for point in points),
                f"{where}: points: expected {key} in all of them or in none, got something else",
            )
            continue
        arrays[name] = np.array(
            [
                read_only(point.get(key), (len(names),), f"{where}: points[{k}].{key}")
                for k, point in enumerate(points)
            ]
        )
    require("angles_rad" in arrays, f"{where}: points: expected positions, got none")
    return MotionTable(joints=tuple(names), limbs=(), columns=arrays, source=where)


def _seconds(point: Mapping[str, Any], k: int, where: str) -> float:
    """When a point is reached; ROS 1 calls the parts secs and nsecs, ROS 2 sec and nanosec."""
    time = point.get("time_from_start")
    if isinstance(time, Mapping):
        for whole, part in (("sec", "nanosec"), ("secs", "nsecs")):
            if whole in time:
                place = f"{where}: points[{k}].time_from_start"
                seconds = checked_int(time[whole], f"{place}.{whole}")
                return seconds + checked_int(time.get(part, 0), f"{place}.{part}") / _NANO
    raise InvalidInput(
        f"{where}: points[{k}].time_from_start: expected sec and nanosec, got {shown(time)}"
    )
