"""Motion files (``stancekit/motion/1``) of plans, walks and leaps, read by their keys alone."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from .robots import Robot, robot_of

Array = NDArray[np.float64]
MOTION = "stancekit/motion/1"
GRAVITY_M_S2 = 9.81


class BrokenFile(ValueError):
    """A file that cannot be played; the message is one line."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Patch:
    """A convex polygon of the ground: corners, shape (V, 3) [m]; unit normal, shape (3,);
    coefficient of friction.
    """

    corners_m: Array
    normal: Array
    friction: float


@dataclass(frozen=True, kw_only=True, eq=False)
class KeyFrames:
    """A plan of M key frames of N limbs, with P footholds.

    Attributes:
        com_m: centre of mass, shape (M, 3) [m].
        rotation_rad: rotation vectors of the body, shape (M, 3).
        holds: which foothold each limb is on, shape (M, N).
        toes_m: where feet touch at each foothold, shape (P, 3) [m].
        normals: of the patches there, shape (P, 3).
        friction: of the patches there, shape (P,).
        lifted: limbs that move to each frame, and after the last one.
        forces_n: by frame and the limbs that carry, shape (N, 3) each [N].
        stances: frame and limbs of each row of the file's forces, in its order.
        joints_rad: by joint name, shape (M,) each; empty where the file has none.
        patches: all of the ground.
        gravity_m_s2: how strong gravity is.
    """

    com_m: Array
    rotation_rad: Array
    holds: NDArray[np.int64]
    toes_m: Array
    normals: Array
    friction: Array
    lifted: tuple[frozenset[int], ...]
    forces_n: Mapping[tuple[int, frozenset[int]], Array]
    stances: tuple[tuple[int, frozenset[int]], ...]
    joints_rad: Mapping[str, Array]
    patches: tuple[Patch, ...]
    gravity_m_s2: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """A walk of T samples of N feet over heights.

    Attributes:
        times_s: shape (T,) [s].
        com_m: centre of mass, shape (T, 3) [m].
        rotation: of the body, shape (T, 3, 3).
        feet_m: where feet touch or would touch, shape (T, N, 3) [m].
        forces_n: on the feet, shape (T, N, 3) [N].
        contact: whether they stand, shape (T, N).
        x_m: grid lines of the heights, shape (X,) [m].
        y_m: grid lines of the heights, shape (Y,) [m].
        heights_m: shape (X, Y) [m].
        friction: of all of the ground.
    """

    times_s: Array
    com_m: Array
    rotation: Array
    feet_m: Array
    forces_n: Array
    contact: NDArray[np.bool_]
    x_m: Array
    y_m: Array
    heights_m: Array
    friction: float


GATHER = (0.3, 0.8)
"""How legs are drawn up in a leap that does not say it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Leap:
    """A leap of M intervals of N limbs, with P footholds.

    Attributes:
        times_s: ends of the intervals, shape (M + 1,) [s].
        com_m: centre of mass at these, shape (M + 1, 3) [m].
        velocity_m_s: of it, shape (M + 1, 3).
        rotation_rad: rotation vectors of the body, shape (M + 1, 3).
        holds: which foothold each limb is on, -1 in the air, shape (M, N).
        toes_m: where feet touch at each foothold, shape (P, 3) [m].
        patches: under each foothold.
        forces_n: on the feet, shape (M, N, 3) [N].
        gather: of a flight, the share of it after which legs are drawn up, and of the shorter of
            their lengths at its ends.
        hips_m: of the legs, from the centre of mass, shape (N, 3) [m].
        folded_m: least length of each leg, shape (N,) [m].
    """

    times_s: Array
    com_m: Array
    velocity_m_s: Array
    rotation_rad: Array
    holds: NDArray[np.int64]
    toes_m: Array
    patches: tuple[Patch, ...]
    forces_n: Array
    gather: tuple[float, float]
    hips_m: Array
    folded_m: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Played:
    """What a file asks for: a robot, and key frames, samples or a leap."""

    robot: Robot
    motion: KeyFrames | Samples | Leap

    @property
    def gravity_m_s2(self) -> float:
        """How strong gravity is."""
        return self.motion.gravity_m_s2 if isinstance(self.motion, KeyFrames) else GRAVITY_M_S2


def read(path: str | Path) -> Played:
    """Read a plan, a walk or a leap. Raises BrokenFile, in one line, for what cannot be played."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
        kind = data.get("format") if isinstance(data, dict) else type(data).__name__
        if kind != MOTION:
            raise ValueError(f"expected the format {MOTION}, got {str(kind)[:80]!r}")
        question, columns = data["question"], data["columns"]
        asked = question["format"] if isinstance(question, dict) else type(question).__name__
        if asked not in READERS:
            known = ", ".join(READERS)
            raise ValueError(f"question: expected the format {known}, got {str(asked)[:80]!r}")
        return READERS[asked](question, _arrays(columns["npz"]), columns)
    except KeyError as error:
        raise BrokenFile(f"{path}: expected the key {error}, found nothing there") from None
    except (
        ValueError,
        TypeError,
        IndexError,
        AttributeError,
        OSError,
        EOFError,
        ElementTree.ParseError,
    ) as error:
        raise BrokenFile(f"{path}: {' '.join(str(error).split())[:300]}") from None


def _plan(course: Mapping[str, Any], arrays: Mapping[str, Any], columns: Any) -> Played:
    if "points_m" in arrays:
        raise ValueError("arrays: points_m: expected feet that are points or balls, got soles")
    names = [limb["name"] for limb in course["robot"]["limbs"]]
    holds = np.full((len(course["lifts"]), len(names)), -1, dtype=np.int64)
    for index, placed in enumerate(course["placements"]):
        holds[placed["frame"] :, names.index(placed["limb"])] = index
    frames, limbs, places = *holds.shape, len(course["placements"])
    if (holds < 0).any():
        raise ValueError(
            "course: placements: expected every limb to stand somewhere at every frame"
        )
    lifted = tuple(
        frozenset(names.index(name) for name in each)
        for each in (*course["lifts"], course["next_lift"])
    )
    stances = _stances(lifted, limbs)
    wanted = {
        "com_m": (frames, 3),
        "rotation_rad": (frames, 3),
        "toes_m": (places, 3),
        "forces_n": (len(stances), limbs, 3),
        "choice": (places,),
    }
    _check(arrays, wanted)
    chosen = [
        _patch(placed["candidates"][int(arrays["choice"][index])])
        for index, placed in enumerate(course["placements"])
    ]
    joints = columns.get("joints", ()) if "joints_rad" in arrays else ()
    if joints:
        _check(arrays, {"joints_rad": (frames, len(joints))})
    return Played(
        robot=robot_of(course["robot"], joints),
        motion=KeyFrames(
            com_m=arrays["com_m"],
            rotation_rad=arrays["rotation_rad"],
            holds=holds,
            toes_m=arrays["toes_m"],
            normals=np.array([patch.normal for patch in chosen]),
            friction=np.array([patch.friction for patch in chosen]),
            lifted=lifted,
            forces_n=dict(zip(stances, arrays["forces_n"], strict=True)),
            stances=stances,
            joints_rad={name: arrays["joints_rad"][:, j] for j, name in enumerate(joints)},
            patches=tuple(_patch(each) for each in course["terrain"]),
            gravity_m_s2=float(course["gravity_m_s2"]),
        ),
    )


def _stances(
    lifted: Sequence[frozenset[int]], limbs: int
) -> tuple[tuple[int, frozenset[int]], ...]:
    """Who carries alone at each frame: after the move to it, and before the next; all where nobody
    moves.
    """
    everybody, found = frozenset(range(limbs)), list[tuple[int, frozenset[int]]]()
    for frame in range(len(lifted) - 1):
        moves = [each for each in (lifted[frame], lifted[frame + 1]) if each]
        kept = [each for each in dict.fromkeys(everybody - each for each in moves) if each]
        found += [(frame, each) for each in kept or [everybody]]
    return tuple(found)


def _walk(data: Mapping[str, Any], arrays: Mapping[str, Any], columns: Any) -> Played:
    if any(data["adhesive"]):
        raise ValueError("adhesive: expected feet that do not stick, got some that do")
    samples, feet = len(arrays["times_s"]), len(data["robot"]["feet"])
    across, along = len(arrays["terrain_x_m"]), len(arrays["terrain_y_m"])
    _check(
        arrays,
        {
            "times_s": (samples,),
            "torso_m": (samples, 3),
            "rotation": (samples, 3, 3),
            "feet_m": (samples, feet, 3),
            "forces_n": (samples, feet, 3),
            "contact": (samples, feet),
            "terrain_heights_m": (across, along),
        },
    )
    return Played(
        robot=robot_of(data["robot"], ()),
        motion=Samples(
            times_s=arrays["times_s"],
            com_m=arrays["torso_m"],
            rotation=arrays["rotation"],
            feet_m=arrays["feet_m"],
            forces_n=arrays["forces_n"],
            contact=arrays["contact"].astype(bool),
            x_m=arrays["terrain_x_m"],
            y_m=arrays["terrain_y_m"],
            heights_m=arrays["terrain_heights_m"],
            friction=float(data["friction"]),
        ),
    )


def _leap(data: Mapping[str, Any], plan: Mapping[str, Any], columns: Any) -> Played:
    limbs = data["robot"]["limbs"]
    names = [limb["name"] for limb in limbs]
    number = {(each["limb"], each["phase"]): j for j, each in enumerate(data["footholds"])}
    rows, before = list[list[int]](), [-1] * len(names)
    for q, phase in enumerate(data["phases"]):
        now = [number.get((name, q), before[i]) for i, name in enumerate(names)]
        before = [j if names[i] in phase["limbs"] else -1 for i, j in enumerate(now)]
        if any(j < 0 and names[i] in phase["limbs"] for i, j in enumerate(before)):
            raise ValueError(f"footholds: expected one under every limb that stands in phase {q}")
        rows += [before] * phase["intervals"]
    lasts = [
        seconds / phase["intervals"]
        for seconds, phase in zip(
            data["timings_s"][int(plan["timing"])], data["phases"], strict=True
        )
        for _ in range(phase["intervals"])
    ]
    count, places = len(rows), len(data["footholds"])
    if len(plan["choice"]) != places:
        raise ValueError(f"plan: choice: expected {places} numbers, got {len(plan['choice'])}")
    shapes = {
        **dict.fromkeys(("com_m", "velocity_m_s", "rotation_rad"), (count + 1, 3)),
        "toes_m": (places, 3),
        "forces_n": (count, len(names), 3),
    }
    arrays = {name: np.array(plan[name], dtype=float) for name in shapes}
    _check(arrays, shapes)
    legs = [limb["leg"] or {"hip_m": limb["shoulder_m"], "fold_m": 0.0} for limb in limbs]
    edge, fold = plan.get("gather", GATHER)
    return Played(
        robot=robot_of(data["robot"], ()),
        motion=Leap(
            times_s=np.r_[0.0, np.cumsum(lasts)],
            **arrays,
            holds=np.array(rows),
            patches=tuple(
                _patch(each["candidates"][int(plan["choice"][j])])
                for j, each in enumerate(data["footholds"])
            ),
            gather=(float(edge), float(fold)),
            hips_m=np.array([leg["hip_m"] for leg in legs], dtype=float),
            folded_m=np.array([leg["fold_m"] for leg in legs], dtype=float),
        ),
    )


READERS = {
    "stancekit/course/1": _plan,
    "stancekit/walk/1": _walk,
    "stancekit/leap/1": _leap,
}
"""By the format of the question."""


def _patch(raw: Mapping[str, Any]) -> Patch:
    corners = np.array(raw["vertices_m"], dtype=float).reshape(-1, 3)
    apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > 1e-9
    normal = np.array(raw["normal"], dtype=float).reshape(3)
    return Patch(
        corners_m=corners[apart],
        normal=normal / np.linalg.norm(normal),
        friction=float(raw["friction"]),
    )


def _arrays(text: str) -> dict[str, Any]:
    try:
        with np.load(io.BytesIO(base64.b64decode(text, validate=True)), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except Exception as error:  # zipfile and zlib have many of their own
        raise ValueError(f"expected an archive of arrays in base64, got none: {error}") from None


def _check(arrays: Mapping[str, Any], wanted: Mapping[str, tuple[int, ...]]) -> None:
    for name, shape in wanted.items():
        array = arrays[name]
        if array.shape != shape or array.dtype.kind not in "fib" or not np.isfinite(array).all():
            raise ValueError(
                f"{name}: expected finite numbers of shape {shape}, "
                f"got {array.dtype} of shape {array.shape}"
            )
