"""A motion as MCAP (extra ``viz``) for ROS 2's tools and Foxglove.

All topics are messages of ROS 2 in CDR, with their definitions: readers of rosbags refuse a file
that has others beside them. Times begin at 0.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stancekit.planners.errors import installed
from stancekit.planners.files.arrays import Array

if TYPE_CHECKING:
    from .formats import Moved

_NANO = 1_000_000_000
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""Beginning of CDR: plain, little-endian."""
_TYPES = {
    "sensor_msgs/JointState": """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort""",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "geometry_msgs/TransformStamped": """std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform""",
    "geometry_msgs/Transform": """geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation""",
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers",
    "visualization_msgs/Marker": """std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
visualization_msgs/UVCoordinate[] uv_coordinates
string text
string mesh_resource
visualization_msgs/MeshFile mesh_file
bool mesh_use_embedded_materials""",
    "geometry_msgs/Pose": """geometry_msgs/Point position
geometry_msgs/Quaternion orientation""",
    "sensor_msgs/CompressedImage": """std_msgs/Header header
string format
uint8[] data""",
    "visualization_msgs/UVCoordinate": "float32 u\nfloat32 v",
    "visualization_msgs/MeshFile": "string filename\nuint8[] data",
    "std_msgs/ColorRGBA": "float32 r\nfloat32 g\nfloat32 b\nfloat32 a",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
}
"""Messages of ROS 2 since Humble, a field per line."""
_TOPICS = {
    "/joint_states": "sensor_msgs/JointState",
    "/tf": "tf2_msgs/TFMessage",
    "/forces": "visualization_msgs/MarkerArray",
    "/contacts": "sensor_msgs/JointState",
}
_MARKER = "iIssiii7d3d4fiI?DIsiIssIIsssI?"
"""A marker by the letters of ``_cdr``."""
_SPHERE_LIST, _LINE_LIST = 7, 5
_FORCE_M_PER_N = 1e-3
"""Length of the lines of forces."""
_FRAME = "world"


def write_mcap(moved: Moved, path: Path) -> None:
    """Write the log.

    Raises InvalidInput without the package mcap.
    """
    written = installed("mcap.writer", "foxglove", "mcap", "logs of Foxglove", "viz")
    table = moved.table
    known = table.arrays()
    with path.open("wb") as stream:
        writer = written.Writer(stream)
        writer.start(profile="ros2", library="stancekit")
        channels = dict[str, int]()
        for topic in _messages(moved, known, 0, 0):
            name, content = _TOPICS[topic].replace("/", "/msg/"), _definition(_TOPICS[topic])
            schema = writer.register_schema(name, "ros2msg", content.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for row, time_s in enumerate(table.time_s.tolist()):
            now = round(time_s * _NANO)
            for topic, message in _messages(moved, known, row, now).items():
                writer.add_message(channels[topic], now, message, now, row)
        writer.finish()


def _definition(kind: str) -> str:
    """The text of a message, and of all that are in it, as MCAP's schemas have them."""
    needed = [kind]
    for name in needed:
        words = [line.split()[0].removesuffix("[]") for line in _TYPES[name].splitlines()]
        needed += [word for word in words if word in _TYPES and word not in needed]
    first, *others = needed
    rule = "=" * 80
    return _TYPES[first] + "".join(f"\n{rule}\nMSG: {name}\n{_TYPES[name]}" for name in others)


def _cdr(kinds: str, *values: Any) -> bytes:
    """Values in CDR, little-endian, each number at a multiple of its own size.

    Arguments:
        kinds: a letter per value: of ``struct`` for a number, with a count before it for as many of
            them in an array; s for a text, S for a sequence of texts, D for one of float64 or of
            messages that are float64s.
    """
    content = bytearray()

    def numbers(kind: str, *those: float) -> None:
        padding = -len(content) % struct.calcsize(kind)
        content.extend(bytes(padding) + struct.pack(f"<{len(those)}{kind}", *those))

    def text(value: str) -> None:
        letters = value.encode() + b"\x00"
        numbers("I", len(letters))
        content.extend(letters)

    for kind, value in zip(re.findall(r"\d*.", kinds), values, strict=True):
        if kind == "s":
            text(value)
        elif kind in "SD":
            numbers("I", len(value))
            if kind == "D" and len(value):
                numbers("d", *np.ravel(value).tolist())
            for each in value if kind == "S" else ():
                text(each)
        else:
            numbers(kind[-1], *np.ravel(value).tolist())
    return _LITTLE_ENDIAN + bytes(content)


def _messages(moved: Moved, known: Mapping[str, Any], row: int, now: int) -> dict[str, bytes]:
    """Messages of each topic at a row."""
    stamp = divmod(now, _NANO)
    w, x, y, z = known["quaternion"][row].tolist()
    place = known.get("origin_m", known["com_m"])[row]
    feet, forces = known["feet_m"][row], known["forces_n"][row]
    sizes, joints = np.linalg.norm(forces, axis=-1), dict[str, bytes]()
    if "angles_rad" in known:
        columns = [known[key][row] for key in ("angles_rad", "rates_rad_s", "torques_nm")]
        joints["/joint_states"] = _cdr("iIsSDDD", *stamp, "", moved.table.joints, *columns)
    balls = _marker(stamp, 0, _SPHERE_LIST, 0.03, (0.2, 0.5, 0.4, 1.0), feet)
    ends = np.stack([feet, feet + _FORCE_M_PER_N * forces], axis=1).reshape(-1, 3)
    lines = _marker(stamp, 1, _LINE_LIST, 0.01, (0.9, 0.4, 0.1, 1.0), ends)
    return {
        **joints,
        "/tf": _cdr("IiIss3d4d", 1, *stamp, _FRAME, "body", place, (x, y, z, w)),
        "/forces": _cdr(f"I{_MARKER}{_MARKER}", 2, *balls, *lines),
        "/contacts": _cdr(
            "iIsSDDD", *stamp, "", moved.table.limbs, known["contact"][row], (), sizes
        ),
    }


def _marker(
    stamp: tuple[int, int], number: int, kind: int, size_m: float, colour: Any, points: Array
) -> tuple[Any, ...]:
    """The values of a marker of points in the world, in the order of its fields."""
    pose, scale, for_good = np.eye(7)[6], np.full(3, size_m), (0, 0)
    shape = (number, kind, 0, pose, scale, colour, *for_good, False, points)
    no_texture, no_mesh = ("", 0, 0, "", "", 0, 0), ("", "", "", 0, False)
    return (*stamp, _FRAME, "limbs", *shape, 0, *no_texture, *no_mesh)
