"""A motion as MCAP (extra ``viz``) for Foxglove and ROS 2's tools, with a layout for Foxglove
beside it.

/joint_states is sensor_msgs/msg/JointState in CDR; /tf is foxglove.FrameTransform and /forces
foxglove.SceneUpdate, in JSON; /contacts is JSON with a number per limb. Times begin at 0.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stancekit.planners.errors import not_installed
from stancekit.planners.files.arrays import Array

if TYPE_CHECKING:
    from .formats import Moved

_NANO = 1_000_000_000
_JOINT_STATE = "sensor_msgs/msg/JointState"
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""Beginning of CDR: plain, little-endian."""
_DEFINITION = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_FORCE_M_PER_N = 1e-3
"""Length of the arrows of forces."""
_FRAME = "world"


def write_mcap(moved: Moved, path: Path) -> None:
    """Write the log.

    Raises InvalidInput without the package mcap.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise not_installed("foxglove", "mcap", "logs of Foxglove", "viz") from None
    table = moved.table
    known = table.known()
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="stancekit")
        channels = {
            topic: writer.register_channel(
                topic, "json", writer.register_schema(name, "jsonschema", _schema(keys))
            )
            for topic, (name, keys) in _TOPICS.items()
        }
        if "angles_rad" in known:
            schema = writer.register_schema(_JOINT_STATE, "ros2msg", _DEFINITION.encode())
            channels["/joint_states"] = writer.register_channel("/joint_states", "cdr", schema)
        for row, time_s in enumerate(table.time_s.tolist()):
            now = round(time_s * _NANO)
            for topic, content in _messages(moved, known, row, now).items():
                writer.add_message(channels[topic], now, json.dumps(content).encode(), now, row)
            if "angles_rad" in known:
                numbers = [known[key][row] for key in ("angles_rad", "rates_rad_s", "torques_nm")]
                writer.add_message(
                    channels["/joint_states"],
                    now,
                    _joint_state(table.joints, numbers, now),
                    now,
                    row,
                )
        writer.finish()  # type: ignore[no-untyped-call]


def _joint_state(names: Sequence[str], rows: Sequence[Array], stamp_ns: int) -> bytes:
    """A sensor_msgs/JointState in CDR.

    Arguments:
        rows: positions, velocities and efforts, shape (J,) each.
    """
    message = _Cdr()
    message.number("i", stamp_ns // _NANO)
    message.number("I", stamp_ns % _NANO)
    message.text("")
    message.number("I", len(names))
    for name in names:
        message.text(name)
    for numbers in rows:
        message.number("I", len(numbers))
        for number in numbers.tolist():
            message.number("d", number)
    return _LITTLE_ENDIAN + bytes(message.content)


class _Cdr:
    """Content in CDR, little-endian, each number at a multiple of its own size."""

    def __init__(self) -> None:
        self.content = bytearray()

    def number(self, kind: str, value: float) -> None:
        size = struct.calcsize(kind)
        self.content += b"\x00" * (-len(self.content) % size) + struct.pack(f"<{kind}", value)

    def text(self, value: str) -> None:
        content = value.encode() + b"\x00"
        self.number("I", len(content))
        self.content += content


_TOPICS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "/tf": (
        "foxglove.FrameTransform",
        {
            "timestamp": "object",
            "parent_frame_id": "string",
            "child_frame_id": "string",
            "translation": "object",
            "rotation": "object",
        },
    ),
    "/forces": ("foxglove.SceneUpdate", {"deletions": "array", "entities": "array"}),
    "/contacts": ("stancekit.Contacts", {"contacts": "object"}),
}
"""The topics in JSON: the schema's name, and its keys by their types."""


def _schema(keys: Mapping[str, str]) -> bytes:
    return json.dumps(
        {"type": "object", "properties": {key: {"type": kind} for key, kind in keys.items()}}
    ).encode()


def _messages(moved: Moved, known: Mapping[str, Any], row: int, now: int) -> dict[str, Any]:
    """Messages of each topic in JSON at a row."""
    stamp = {"sec": now // _NANO, "nsec": now % _NANO}
    w, x, y, z = known["quaternion"][row].tolist()
    limbs = moved.table.limbs
    arrows = [
        _arrow(foot, force)
        for foot, force in zip(known["feet_m"][row], known["forces_n"][row], strict=True)
        if np.linalg.norm(force) > 0.0
    ]
    balls = [
        {
            "pose": _pose(foot),
            "size": _xyz(np.full(3, 0.03)),
            "color": {"r": 0.2, "g": 0.5, "b": 0.4, "a": 1.0},
        }
        for foot in known["feet_m"][row]
    ]
    entity = {
        "timestamp": stamp,
        "frame_id": _FRAME,
        "id": "limbs",
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [],
        "arrows": arrows,
        "cubes": [],
        "spheres": balls,
        "cylinders": [],
        "lines": [],
        "triangles": [],
        "texts": [],
        "models": [],
    }
    return {
        "/tf": {
            "timestamp": stamp,
            "parent_frame_id": _FRAME,
            "child_frame_id": "body",
            "translation": _xyz(known.get("origin_m", known["com_m"])[row]),
            "rotation": {"x": x, "y": y, "z": z, "w": w},
        },
        "/forces": {"deletions": [], "entities": [entity]},
        "/contacts": {
            "contacts": dict(zip(limbs, known["contact"][row].astype(int).tolist(), strict=True))
        },
    }


def _arrow(foot: Array, force: Array) -> dict[str, Any]:
    """The arrow of a force: Foxglove's points along the x axis of its pose."""
    size = float(np.linalg.norm(force))
    along = force / size
    axis, cosine = np.cross([1.0, 0.0, 0.0], along), float(along[0])
    turn = (
        np.array([0.0, 0.0, 1.0, 0.0]) if cosine < -1.0 + 1e-9 else np.array([*axis, 1.0 + cosine])
    )
    turn = turn / np.linalg.norm(turn)
    length = _FORCE_M_PER_N * size
    return {
        "pose": _pose(foot, turn),
        "shaft_length": 0.8 * length,
        "shaft_diameter": 0.01,
        "head_length": 0.2 * length,
        "head_diameter": 0.02,
        "color": {"r": 0.9, "g": 0.4, "b": 0.1, "a": 1.0},
    }


def _pose(place: Array, turn: Array | None = None) -> dict[str, Any]:
    x, y, z, w = (0.0, 0.0, 0.0, 1.0) if turn is None else turn.tolist()
    return {"position": _xyz(place), "orientation": {"x": x, "y": y, "z": z, "w": w}}


def _xyz(numbers: Array) -> dict[str, float]:
    return dict(zip("xyz", numbers.tolist(), strict=True))


def layout_of(moved: Moved) -> str:
    """A layout of Foxglove: the scene, the angles of all joints, and the contacts, to be imported
    there.
    """
    paths = [
        {
            "value": f"/joint_states.position[{k}]",
            "label": name,
            "enabled": True,
            "timestampMethod": "receiveTime",
        }
        for k, name in enumerate(moved.table.joints)
    ]
    contacts = [
        {
            "value": f"/contacts.contacts.{limb}",
            "label": limb,
            "enabled": True,
            "timestampMethod": "receiveTime",
        }
        for limb in moved.table.limbs
    ]
    return (
        json.dumps(
            {
                "configById": {
                    "3D!stance": {
                        "followTf": _FRAME,
                        "topics": {"/forces": {"visible": True}},
                        "scene": {},
                    },
                    "Plot!joints": {"title": "joints [rad]", "paths": paths, "showLegend": True},
                    "Plot!contacts": {"title": "contacts", "paths": contacts, "showLegend": True},
                },
                "globalVariables": {},
                "userNodes": {},
                "playbackConfig": {"speed": 1},
                "layout": {
                    "first": "3D!stance",
                    "direction": "row",
                    "splitPercentage": 60,
                    "second": {
                        "first": "Plot!joints",
                        "second": "Plot!contacts",
                        "direction": "column",
                    },
                },
            },
            indent=1,
        )
        + "\n"
    )
