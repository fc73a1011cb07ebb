"""The formats in which motions leave, by name: what each needs, and what its files are called."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

from stancekit.planners.answer.motion import Motion
from stancekit.planners.errors import InvalidInput, installed
from stancekit.planners.files.arrays import Array, archive_of, checked
from stancekit.planners.files.writing import replaced, write_bytes
from stancekit.planners.formats.table_file import csv_of, joint_trajectory_bytes, npz_of, read_table
from stancekit.planners.motion.gait_motion import feet_motion
from stancekit.planners.motion.motion import LARGEST_RATE_HZ, MotionTable, Played, table_of
from stancekit.planners.motion.plan_motion import reached_s
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.meshes import numbers_of
from stancekit.planners.robot.model import Robot
from stancekit.planners.terrain.mesh_file import compiled_mjcf

from ..motion.time_parametrization import RATE_HZ, joint_motion
from ..worlds.mujoco import MujocoWorld, mujoco_module
from ..worlds.simulation import SimulatedBody, local_origin, simulated_body
from ..worlds.world import Drives, Terrain


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """A motion on its way out: its table, who moves, over what, and at which moments key frames are
    reached [s].

    Arguments:
        motion: what was sampled.
        without: why there are no joints, empty where there are.
        open_loop: what became of the rows in MuJoCo without feedback of the body, or why that was
            not tried.
    """

    table: MotionTable
    motion: Played
    robot: Robot | None
    terrain: Terrain
    gravity_m_s2: float
    keys_s: tuple[float, ...] = ()
    without: str = ""
    open_loop: str = ""


def scene_of(subject: Motion[Any]) -> tuple[Robot | None, tuple[str, ...], Terrain, float]:
    """Robot that moves, None where its legs are not known, the names of its limbs, the terrain, and
    gravity.
    """
    robot: Robot | None = None
    with suppress(InvalidInput):
        robot = subject.legged
    return robot, subject.robot.limb_names, subject.ground(), subject.gravity_m_s2


_FELL_RAD = 0.6
"""Farther turned from the motion than this the body has fallen."""
_SUNK_M = 0.1
"""A body that is lower than its motion's by more than this has fallen, of a robot of usual size."""
_PACES = (1.0, 0.5)
"""Paces that are tried, one after another."""


def played(moved: Moved) -> str:
    """Say at which pace, and with which gains, a motion stands open loop in MuJoCo, or where it
    falls; nothing of one without joints.

    Every joint is sent its row's angle, and by how much its loop yields to the row's torque. A body
    falls that turns away from its rows or sinks below them; where it drifts to is not looked at.
    """
    table, fell = moved.table, list[str]()
    if moved.robot is None or "torques_nm" not in table.columns:
        return ""
    for pace in _PACES:
        try:
            world = MujocoWorld(moved.robot, gravity_m_s2=moved.gravity_m_s2)
        except InvalidInput as error:
            return f"not tried: {error}"
        targets, known, turn = _targets(table, world.drives), table.arrays(), table.rotation
        world.connect(moved.terrain, known["angles_rad"][0], known["origin_m"][0], turn[0])
        world.preload(targets[0])
        rows_per_step = pace * table.rate_hz / world.rate_hz
        for row in (np.arange(1, int(len(turn) / rows_per_step)) * rows_per_step).astype(int):
            world.send(targets[row])
            state = world.read()
            if (
                0.5 * (np.einsum("ij,ij->", state.rotation, turn[row]) - 1.0) < np.cos(_FELL_RAD)
                or known["origin_m"][row, 2] - state.position_m[2] > _SUNK_M * moved.robot.size
            ):
                fell.append(f"fell after {table.time_s[row] / pace:.2f} s at pace {pace:g}")
                break
        else:
            return "; ".join([*fell, f"stood at pace {pace:g} with {_gains(world.drives)}"])
    return f"{'; '.join(fell)}, with {_gains(world.drives)}"


def _gains(drives: Drives) -> str:
    """The least and the greatest of the loops' gains."""
    kp, kd = (
        " to ".join(f"{gain:.4g}" for gain in np.unique([each.min(), each.max()]))
        for each in (drives.stiffness_nm_rad, drives.damping_nms_rad)
    )
    return f"Kp {kp} Nm/rad, Kd {kd} Nms/rad"


def _targets(table: MotionTable, drives: Drives) -> Array:
    """Angles to which loops are sent that yield to the torques of each row, shape (T, J) [rad]."""
    known = table.arrays()
    pressed = known["torques_nm"] + drives.damping_nms_rad * known["rates_rad_s"]
    return np.asarray(known["angles_rad"] + pressed / drives.stiffness_nm_rad)


def _mjcf_of(moved: Moved) -> str:
    """The file's text.

    Raises InvalidInput without MuJoCo, and for a robot that it cannot hold.
    """
    assert moved.robot is not None
    world, table = MujocoWorld(moved.robot, gravity_m_s2=moved.gravity_m_s2), moved.table
    origin_m = local_origin(table.arrays()["origin_m"][0], _FAR_M)
    spec = world.scene(moved.terrain, origin_m)
    _embed(spec, world.body)
    model = spec.compile()
    spec.modelname = moved.robot.name
    qpos, qvel = states(model, table, world.body.base, origin_m)
    targets = _targets(table, world.drives)
    names = _key_names(table.time_s, moved.keys_s)
    keys = zip(
        names, table.time_s.tolist(), qpos.tolist(), qvel.tolist(), targets.tolist(), strict=True
    )
    lines = [
        f'    <key name="{name}" time="{time_s!r}" qpos="{_text(q)}" qvel="{_text(v)}" ctrl="{_text(target)}"/>'
        for name, time_s, q, v, target in keys
    ]
    head, end, _ = str(spec.to_xml()).rpartition("</mujoco>")
    texts = {"open_loop": moved.open_loop} if moved.open_loop else {}
    texts |= {_ORIGIN: _text(origin_m.tolist())} if origin_m.any() else {}
    said = [f'    <text name="{name}" data={quoteattr(text)}/>' for name, text in texts.items()]
    head += "\n".join(["  <custom>", *said, "  </custom>\n\n"]) if said else ""
    text = "\n".join([f"{head}  <keyframe>", *lines, "  </keyframe>", f"{end}\n"])
    _check_written(text, model, qpos)
    return text


_FAR_M = 5.0
"""Farther from the world's origin than this a file for MuJoCo, whose writer keeps six digits, has one
of its own."""
_ORIGIN = "origin_m"
"""Name of the text that says where in the world the file's own origin is."""
_OFF_M = 1e-5
"""Farther off nothing may be in a file that was written [m]."""


def _check_written(text: str, model: Any, qpos: Array) -> None:
    """Raise InvalidInput unless MuJoCo reads a file back as it was meant: bodies and shapes of robot
    and terrain at their places in the first, middle and last row.
    """
    mujoco = mujoco_module()
    try:
        read = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        why = " ".join(str(error).split())[:200]
        raise InvalidInput(
            f"mujoco: expected a file that is read back, got one that is not: {why}"
        ) from None
    for row in (0, len(qpos) // 2, -1):
        places = []
        for one, q in ((read, read.key_qpos[row]), (model, qpos[row])):
            data = mujoco.MjData(one)
            data.qpos[:] = q
            mujoco.mj_kinematics(one, data)
            places.append(np.concatenate([data.xpos, data.geom_xpos]))
        off = float(np.abs(places[0] - places[1]).max())
        if off > _OFF_M:
            raise InvalidInput(
                f"mujoco: expected places to {1e3 * _OFF_M:g} mm in the file, got {1e3 * off:.2g}"
            )


def _text(numbers: list[float]) -> str:
    """Numbers to the last bit; MuJoCo's own writer keeps six digits."""
    return " ".join(map(repr, numbers))


def _key_names(times_s: Array, keys_s: tuple[float, ...]) -> list[str]:
    """Name of each row: by its number, and those at which a plan's key frame is reached by that,
    too.
    """
    names = [f"row {k}" for k in range(len(times_s))]
    for frame, time_s in enumerate(keys_s):
        names[int(np.abs(times_s - time_s).argmin())] += f", frame {frame}"
    return names


def states(
    model: Any, table: MotionTable, base: str, origin_m: ArrayLike = 0.0
) -> tuple[Array, Array]:
    """qpos and qvel of every row, shape (T, nq), (T, nv), from the model's own origin: turning
    velocities of the base are in its own frame.
    """
    known = table.arrays()
    if not {"angles_rad", "rates_rad_s", "origin_m"} <= set(known):
        raise InvalidInput("motion: expected joints and the body's place, got none")
    rows = len(table.time_s)
    qpos, qvel = np.tile(model.qpos0, (rows, 1)), np.zeros((rows, model.nv))
    root = int(model.body(base).jntadr[0])
    at, speed = int(model.jnt_qposadr[root]), int(model.jnt_dofadr[root])
    qpos[:, at : at + 7] = np.concatenate(
        [known["origin_m"] - origin_m, known["quaternion"]], axis=1
    )
    qvel[:, speed : speed + 3] = np.gradient(known["origin_m"], table.time_s, axis=0)
    qvel[:, speed + 3 : speed + 6] = np.einsum("tji,tj->ti", table.rotation, known["turning_rad_s"])
    for k, name in enumerate(table.joints):
        joint = model.joint(name)
        qpos[:, int(joint.qposadr[0])] = known["angles_rad"][:, k]
        qvel[:, int(joint.dofadr[0])] = known["rates_rad_s"][:, k]
    return qpos, qvel


def _embed(spec: Any, body: SimulatedBody) -> None:
    """Put the shapes of the robot's hulls into the file in place of the names of theirs, and those of
    the terrain about places in whole millimetres, so that six digits are enough.
    """
    for geom in spec.worldbody.geoms:
        if geom.meshname:
            mesh = spec.mesh(geom.meshname)
            corners = np.reshape(mesh.uservert, (-1, 3))
            geom.pos = np.round(corners.mean(axis=0), 3)
            mesh.uservert = (corners - geom.pos).ravel()
    for mesh in spec.meshes:
        content = body.hulls.get(mesh.file)
        if content is not None:
            lines = [line.split() for line in content.decode().splitlines()]
            mesh.uservert = [float(x) for line in lines if line[0] == "v" for x in line[1:]]
            mesh.file = ""


def read_keys(path: Path) -> MotionTable:
    """The key frames of an MJCF file as a motion, by their times: joints and body, and nothing of
    contacts and forces.

    The body is what the first free joint moves. Raises InvalidInput for a file that MuJoCo does not
    read, without key frames, or without a free joint.
    """
    model, mujoco = compiled_mjcf(path)[0], mujoco_module()
    if model.nkey < 2:
        raise InvalidInput(f"{path}: expected two key frames or more, got {model.nkey}")
    free = [i for i in range(model.njnt) if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE]
    if not free:
        raise InvalidInput(f"{path}: expected a body with a free joint, got none")
    order = np.argsort(model.key_time, kind="stable")
    qpos, qvel, times = model.key_qpos[order], model.key_qvel[order], model.key_time[order]
    turning = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    joints = [i for i in range(model.njnt) if int(model.jnt_type[i]) in turning]
    at = int(model.jnt_qposadr[free[0]])
    origin_m, number = np.zeros(3), mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, _ORIGIN)
    if number >= 0:
        said = bytes(model.text_data).split(b"\0")[number].decode()
        origin_m = np.array(numbers_of(said, 3, f"{path}: {_ORIGIN}"))
    try:
        return MotionTable(
            joints=tuple(model.joint(i).name for i in joints),
            limbs=(),
            columns={
                "time_s": times,
                "angles_rad": qpos[:, model.jnt_qposadr[joints]],
                "rates_rad_s": qvel[:, model.jnt_dofadr[joints]] if qvel.any() else None,
                "origin_m": qpos[:, at : at + 3] + origin_m,
                "quaternion": qpos[:, at + 3 : at + 7],
            },
            source=str(path),
        )
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None


def _reference_bytes(moved: Moved) -> bytes:
    """The file's content.

    Raises InvalidInput without MuJoCo.
    """
    assert moved.robot is not None
    mujoco, table = mujoco_module(), moved.table
    world = MujocoWorld(moved.robot, gravity_m_s2=moved.gravity_m_s2)
    origin_m = local_origin(table.arrays()["origin_m"][0], _FAR_M)
    model = world.scene(moved.terrain, origin_m).compile()
    data = mujoco.MjData(model)
    qpos, qvel = states(model, table, world.body.base, origin_m)
    bodies = range(1, model.nbody)
    place, turn = np.zeros((len(qpos), len(bodies), 3)), np.zeros((len(qpos), len(bodies), 4))
    moving, turning = np.zeros_like(place), np.zeros_like(place)
    velocity = np.zeros(6)
    for row, (q, v) in enumerate(zip(qpos, qvel, strict=True)):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_fwdVelocity(model, data)
        place[row], turn[row] = data.xpos[1:] + origin_m, data.xquat[1:]
        for k, body in enumerate(bodies):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
            turning[row, k], moving[row, k] = velocity[:3], velocity[3:]
    hinges = [i for i in range(model.njnt) if model.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE]
    names = [model.joint(i).name for i in hinges]
    order = [table.joints.index(name) for name in names]
    known = table.arrays()
    fps = (
        round(table.rate_hz) if abs(table.rate_hz - round(table.rate_hz)) < 1e-6 else table.rate_hz
    )
    arrays: dict[str, Any] = {
        "joint_pos": known["angles_rad"][:, order],
        "joint_vel": known["rates_rad_s"][:, order],
        "body_pos_w": place,
        "body_quat_w": turn,
        "body_lin_vel_w": moving,
        "body_ang_vel_w": turning,
        "tau": known["torques_nm"][:, order],
        "contact": known["contact"],
        "force": known["forces_n"],
    }
    words: dict[str, Any] = {
        "joint_names": names,
        "body_names": [model.body(body).name for body in bodies],
        "limb_names": table.limbs,
        "open_loop": moved.open_loop,
    }
    return archive_of({"fps": [fps], **arrays, **words})


def _write_crocoddyl(moved: Moved, path: Path) -> None:
    """The numbers, and beside them the script that follows them, unless one is there.

    Raises InvalidInput for joints that turn without end, which Pinocchio counts otherwise.
    """
    assert moved.robot is not None
    world, at = moved.robot.legs, moved.motion.at(moved.table.time_s)
    body, drives = simulated_body(world), Drives.of(world)
    if endless := [
        name
        for leg in world.legs
        for name, turns in zip(leg.joint_names, leg.turns, strict=True)
        if turns
    ]:
        raise InvalidInput(f"crocoddyl: expected joints with limits, got {endless[0]} without")
    content = {
        **moved.table.arrays(),
        "joints": moved.table.joints,
        "urdf": body.urdf,
        "feet": body.feet,
        "tips_m": body.tips_m,
        "rotors_kg_m2": drives.rotor_kg_m2,
        "normals": at.normals,
        "friction": at.friction,
        "gravity_m_s2": moved.gravity_m_s2,
        "open_loop": moved.open_loop,
    }
    write_bytes(path, archive_of(content))
    script = path.with_suffix(".py")
    if not script.exists():
        write_bytes(script, files(__package__).joinpath("follow.py.txt").read_bytes())


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


def _write_mcap(moved: Moved, path: Path) -> None:
    """Write a log of ROS 2's tools and Foxglove: all topics are messages of ROS 2 in CDR, with their
    definitions, as readers of rosbags refuse a file that has others beside them. Times begin at 0.

    Raises InvalidInput without the package mcap.
    """
    written = installed("mcap.writer", "foxglove", "mcap", "logs of Foxglove", "viz")
    table = moved.table
    known = table.arrays()
    with replaced(path) as temporary, temporary.open("wb") as stream:
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


@dataclass(frozen=True, kw_only=True)
class _Format:
    """A format: how its files end, whether it is of joints, and who writes it to a path."""

    suffixes: tuple[str, ...]
    joints: bool
    write: Callable[[Moved, Path], None]


FORMATS: Mapping[str, _Format] = MappingProxyType(
    {
        "csv": _Format(
            suffixes=(".csv",),
            joints=False,
            write=lambda moved, path: write_bytes(path, csv_of(moved.table)),
        ),
        "npz": _Format(
            suffixes=(".npz",),
            joints=False,
            write=lambda moved, path: write_bytes(
                path, npz_of(moved.table, open_loop=moved.open_loop)
            ),
        ),
        "jointtrajectory": _Format(
            suffixes=(".json", ".yaml", ".yml"),
            joints=True,
            write=lambda moved, path: write_bytes(
                path, joint_trajectory_bytes(moved.table, path.suffix)
            ),
        ),
        "mujoco": _Format(
            suffixes=(".xml",),
            joints=True,
            write=lambda moved, path: write_bytes(path, _mjcf_of(moved).encode()),
        ),
        "reference": _Format(
            suffixes=(".npz",),
            joints=True,
            write=lambda moved, path: write_bytes(path, _reference_bytes(moved)),
        ),
        "crocoddyl": _Format(suffixes=(".npz",), joints=True, write=_write_crocoddyl),
        "foxglove": _Format(suffixes=(".mcap",), joints=False, write=_write_mcap),
    }
)
"""By the name that ``export --to`` takes."""


def write_moved(moved: Moved, to: str, path: Path) -> None:
    """Write a motion in a format, and read it back where that is one of ours to read.

    Raises InvalidInput where nothing can be written, or something else is there then.
    """
    FORMATS[to].write(moved, path)
    if to not in ("csv", "npz", "jointtrajectory"):
        return
    meant = moved.table.arrays()
    for name, there in read_table(path).arrays().items():
        if not np.allclose(there, meant[name], rtol=0.0, atol=1e-8):
            raise InvalidInput(f"{path}: expected {name} as it was written, got other values")


def moved_of(subject: Motion[Any], to: str, rate_hz: float = RATE_HZ, source: str = "") -> Moved:
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
    sampled = feet_motion(subject) if motion is None else motion
    robot, limbs, terrain, gravity_m_s2 = scene_of(subject)
    joints = () if motion is None or robot is None else robot.joint_names
    name = "" if robot is None else robot.name
    table = table_of(sampled, limbs, joints, rate_hz, robot=name, source=source)
    if motion is not None:
        table = table.with_columns(feet_m=_centres(table, Kinematics(subject.legged)))
    keys = reached_s(motion).tolist() if motion is not None and subject.keyed else ()
    return Moved(
        table=table,
        motion=sampled,
        robot=robot,
        terrain=terrain,
        gravity_m_s2=gravity_m_s2,
        keys_s=tuple(keys),
        without=without,
    )


def _centres(table: MotionTable, kinematics: Kinematics) -> Array:
    """Centres of the feet where the joints have them, shape (T, N, 3) [m]: balls roll."""
    origin, angles = table.columns["origin_m"], table.columns["angles_rad"]
    feet = [
        leg.chain.feet(angles[:, kinematics.joints_of(i)])
        for i, leg in enumerate(kinematics.model.legs)
    ]
    return np.asarray(origin[:, None] + np.einsum("tij,ntj->tni", table.rotation, feet))


def beside(source: Path, to: str) -> Path:
    """The file of a format beside another file: its name with an ending that neither it nor its
    samples have.
    """
    suffix = FORMATS[to].suffixes[0]
    word = "motion" if to == "npz" else to
    return source.with_suffix(f".{word}{suffix}" if suffix in (".npz", ".json") else suffix)
