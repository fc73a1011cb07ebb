"""Contact sequences from elsewhere, which foot comes down where and in which order, as courses whose
footholds are points.

A CSV has a row per foot that comes down and a header of names, an NPZ archive an array a name:
``foot``, ``step`` (or ``t``, seconds), ``x``, ``y``, ``z`` [m], and where they are known the ground's
``nx``, ``ny``, ``nz`` and ``friction``, and the centre of mass ``com.x``, ``com.y``, ``com.z`` [m].
Rows of the first step say where every foot stands; those of a later one which feet lift after the
step before and come down.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array, flat_cross, read_archive
from ..files.documents import read_text, shown, validated
from ..robot.model import Robot
from ..terrain.families import Terrain
from ..terrain.footholds import FRICTION
from ..terrain.patch import Frame, Patch, contact_frames
from ..terrain.polygon import Surface
from .course_keys import CourseSpec, toe_offset
from .problem import MOST_FRAMES, Foothold, Problem, StepLimits, Weights

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets

Rows = Mapping[str, NDArray[Any]]
"""Columns of a sequence by name, of R rows each; ``step`` counts from 0."""
PLACE, NORMAL, COM = ("x", "y", "z"), ("nx", "ny", "nz"), ("com.x", "com.y", "com.z")
_ORDERS = ("step", "t")
_UNIT = 0.01
"""A normal is off length 1 by no more."""
_POINT_M, _ROUND_M = 0.002, 0.02
"""Side of the piece of ground that stands for a point, and what is known of the ground about it [m]."""
OFF_M = 0.005
"""A foot stands on ground that is so near [m]."""
_MOST_SPREAD = 20.0
"""Feet of one stance that are so many reaches apart are in other units than metres."""
_FREE = 5.0
"""Distance of a body from a guessed place, and its longest step, in reaches."""
_KNOWN_M = 0.02
"""Distance of a body from where the sequence says that it is [m]."""


def is_sequence(path: str | Path) -> bool:
    """Tell whether a CSV or an NPZ archive says which foot comes down."""
    with suppress(InvalidInput):
        if Path(path).suffix.lower() == ".csv":
            first = read_text(path).lstrip("\ufeff").partition("\n")[0]
            return "foot" in re.split(r"[\s,;]+", first.lower())
        return Path(path).suffix.lower() == ".npz" and "foot" in read_archive(path)
    return False


def read_sequence(path: str | Path) -> Rows:
    """The rows of a sequence.

    Raises InvalidInput for missing or unknown columns, entries that are no numbers, normals that
    are no unit vectors, and steps that go back.
    """
    if Path(path).suffix.lower() == ".npz":
        columns: dict[str, Any] = dict(read_archive(path))
        header = list(columns)
    else:
        text = io.StringIO(read_text(path).lstrip("\ufeff"))
        names, *table = [[part.strip() for part in line] for line in csv.reader(text) if line]
        if odd := [k for k, line in enumerate(table, 1) if len(line) != len(names)]:
            got = len(table[odd[0] - 1])
            raise InvalidInput(f"{path}: row {odd[0]}: expected {len(names)} values, got {got}")
        header, columns = names, {name: [line[k] for line in table] for k, name in enumerate(names)}
    order = [name for name in _ORDERS if name in columns]
    groups = [("foot",), ("friction",), tuple(order), PLACE, NORMAL, COM]
    known = {name for names in groups for name in names}
    whole = all(sum(name in columns for name in names) in (0, len(names)) for names in groups)
    asked = len(order) == 1 and {"foot", *PLACE} <= set(columns) <= known
    if not asked or not whole or len(set(header)) != len(header):
        raise InvalidInput(
            f"{path}: expected the columns foot, step or t, x, y, z, and maybe all of "
            f"{', '.join(NORMAL)}, friction, all of {', '.join(COM)}, separated by commas and each "
            f"once, got {shown(', '.join(header))}"
        )
    feet = np.array(columns.pop("foot"))
    if feet.ndim != 1 or feet.dtype.kind != "U" or not len(feet):
        raise InvalidInput(
            f"{path}: column foot: expected a name in every row, got another value or none"
        )
    rows: dict[str, NDArray[Any]] = {
        name: _numbers(column, f"{path}: column {name}", len(feet))
        for name, column in columns.items()
    }
    if NORMAL[0] in rows:
        off = np.abs(np.linalg.norm([rows[name] for name in NORMAL], axis=0) - 1.0)
        if (row := int(off.argmax())) >= 0 and not off[row] < _UNIT:
            raise InvalidInput(f"{path}: row {row + 1}: expected a normal of length 1, got another")
    when = rows.pop(order[0])
    if (back := np.flatnonzero(np.diff(when) < 0.0)).size:
        row = int(back[0]) + 2
        raise InvalidInput(
            f"{path}: row {row}: expected rows in the order of {order[0]}, got {when[row - 1]:g} "
            f"after {when[row - 2]:g}"
        )
    return {**rows, "foot": feet, "step": np.unique(when, return_inverse=True)[1]}


def _numbers(column: Any, where: str, count: int) -> Array:
    """A column as finite numbers, shape (R,)."""
    try:
        numbers = np.array(column, dtype=np.float64)
    except ValueError as error:
        raise InvalidInput(f"{where}: expected numbers: {error}") from None
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise InvalidInput(f"{where}: expected {count} finite numbers, got other values")
    return numbers


def places_of(rows: Rows) -> Array:
    """Where the feet of all rows come down, shape (R, 3) [m]."""
    return np.stack([rows[name] for name in PLACE], axis=1)


def held_rows(rows: Rows, robot: Robot) -> NDArray[np.int_]:
    """The row by which each limb stands at each step, shape (M, N).

    Raises InvalidInput for feet that the robot does not have or that stand nowhere at first, a foot
    twice in a step, and stances of a size that no robot has.
    """
    names, feet, step = robot.limb_names, rows["foot"], rows["step"]
    if any(limb.sole_m is not None for limb in robot.limbs):
        raise InvalidInput("robot: expected feet that are points or balls, got soles")
    if strange := [name for name in feet.tolist() if name not in names]:
        raise InvalidInput(f"foot: expected one of {', '.join(names)}, got {shown(strange[0])}")
    if (frames := int(step[-1]) + 1) > MOST_FRAMES:
        raise InvalidInput(f"step: expected at most {MOST_FRAMES} steps, got {frames}")
    holds = np.full((frames, len(names)), -1)
    for row, (k, name) in enumerate(zip(step.tolist(), feet.tolist(), strict=True)):
        if row and (feet[:row][step[:row] == k] == name).any():
            raise InvalidInput(f"row {row + 1}: expected {name} once in a step, got it again")
        holds[k:, names.index(name)] = row
    if (holds[0] < 0).any():
        lacks = [name for name, row in zip(names, holds[0], strict=True) if row < 0]
        raise InvalidInput(f"step: expected every foot in the first, got none of {lacks[0]}")
    lifted = np.bincount(step)[1:]
    if (lifted == len(names)).any():
        k = int(lifted.argmax()) + 1
        raise InvalidInput(f"step {k}: expected a foot that stays, got a leap: all of them lift")
    spread = np.ptp(places_of(rows)[holds], axis=1).max()
    reach = max(limb.reach_m for limb in robot.limbs)
    if spread > _MOST_SPREAD * reach:
        raise InvalidInput(
            f"x, y, z: expected metres, got feet {spread:.3g} apart, of legs that reach {reach:.3g} m"
        )
    return holds


def headings(rows: Rows, robot: Robot) -> Array:
    """Which way the robot faces at every step, by where its feet are but one each time, which may be
    wrong: from x towards y, shape (M, N) [rad].
    """
    toes = places_of(rows)[held_rows(rows, robot)][:, :, :2]
    shoulders, names = np.array([limb.shoulder_m[:2] for limb in robot.limbs]), robot.limb_names
    guesses = []
    for left_out in range(len(names) if len(names) > 2 else 1):
        kept = [k for k in range(len(names)) if k != left_out or len(names) < 3]
        out = toes[:, kept] - toes[:, kept].mean(axis=1, keepdims=True)
        like = shoulders[kept] - shoulders[kept].mean(axis=0)
        across = flat_cross(like, out).sum(axis=1)
        guesses.append(np.arctan2(across, (like * out).sum(axis=(1, 2))))
    return np.stack(guesses, axis=1)


def seen_from(rows: Rows, frame: Frame) -> Rows:
    """The rows in a frame of the world."""
    new, back = dict(rows), frame.inverse
    for names, moved in ((PLACE, back.places), (NORMAL, back.vectors), (COM, back.places)):
        if names[0] in rows:
            new |= zip(
                names, moved(np.stack([rows[name] for name in names], axis=1)).T, strict=True
            )
    return new


def grounded(rows: Rows, ground: Terrain) -> tuple[Rows, Array]:
    """The rows with normals and friction of the ground under their feet, and how far each foot is
    off it, shape (R,) [m].

    Raises InvalidInput for rows that say them, too.
    """
    if said := [name for name in (*NORMAL, "friction") if name in rows]:
        raise InvalidInput(
            f"{said[0]}: expected no such column with a terrain, which has its own, got one"
        )
    under = [nearest_ground(place, ground) for place in places_of(rows)]
    normals = np.array([np.eye(3)[2] if patch is None else patch.normal for patch, _ in under])
    friction = np.array([FRICTION if patch is None else patch.friction for patch, _ in under])
    known = {**dict(zip(NORMAL, normals.T, strict=True)), "friction": friction, **rows}
    return known, np.array([distance for _, distance in under])


def sequence_course(
    rows: Rows,
    robot: Robot,
    ground: Terrain | None,
    rooms_m: Array,
    sets: Sets = "inner",
    alternative: object = None,
) -> Problem:
    """The course of a sequence, in which every foot comes down where its row says: step k is key
    frame 2 k, and before it the body may move on all feet.

    Arguments:
        ground: surfaces of the terrain; None for a piece of ground under every foot.
        rooms_m: how far each row's foot may come down from its place, shape (R,) [m].
        sets: sets of the legs, see ``contact_robot``.
        alternative: a sequence has no other layout.

    Raises:
        InvalidInput: as of ``held_rows``.
    """
    keys = {"name": "sequence", "frames": 1, "start_m": (0.0, 0.0, 0.0), "goal_m": (1.0, 0.0, 0.0)}
    keys["terrain"] = {"kind": "flat"}
    spec = validated(CourseSpec, keys, "sequence").of_robot(robot)
    who = spec.make_robot(Path(), sets)
    spec = spec.standing(spec.make_robot(), sets)
    holds, places = held_rows(rows, who), places_of(rows)
    reach = float(np.mean([limb.reach_m for limb in who.limbs]))
    likes = np.array([limb.shoulder_m + toe_offset(limb, spec.stance) for limb in who.limbs])
    com_m, far_m = (places[holds] - likes).mean(axis=1), _FREE * reach
    radius_m = np.full(2 * len(holds) - 1, far_m)
    if COM[0] in rows:
        com, (_, first) = (
            np.stack([rows[name] for name in COM], axis=1),
            np.unique(rows["step"], return_index=True),
        )
        com_m, radius_m[::2] = com[first], _KNOWN_M
        if (odd := np.flatnonzero((com != com_m[rows["step"]]).any(axis=1))).size:
            raise InvalidInput(f"row {odd[0] + 1}: expected one centre of mass a step, got another")
    footholds, under = list[Foothold](), list[Patch]()
    for row, (name, k) in enumerate(zip(rows["foot"].tolist(), rows["step"].tolist(), strict=True)):
        side_m = _POINT_M + 2.0 * float(rooms_m[row])
        under.append(_under(rows, row, ground, 0.5 * side_m + _ROUND_M))
        piece = Surface(under[row], 0.0).window(places[row], side_m)
        piece = _square(places[row], under[row], 0.5 * side_m) if piece is None else piece
        footholds.append(Foothold(limb=name, frame=2 * k, candidates=(piece,)))
    ranks = [who.limb_names.index(each.limb) for each in footholds]
    order = np.lexsort((np.array(ranks), rows["step"]))
    moved = [set(rows["foot"][rows["step"] == k]) for k in range(len(holds))]
    lifts = [tuple(name for name in who.limb_names if name in each) for each in moved[1:]]
    com_m = np.repeat(com_m, 2, axis=0)[:-1]
    return Problem(
        name="sequence",
        robot=who,
        terrain=tuple(under) if ground is None else ground.patches,
        doubts=() if ground is None else ground.doubts,
        footholds=tuple(footholds[row] for row in order),
        lifts=((), *(names for lifted in lifts for names in ((), lifted))),
        com_nominal_m=com_m,
        com_radius_m=radius_m,
        goal_m=com_m[-1],
        steps=StepLimits(
            com_m=far_m, toe_m=max(far_m, 2.0 * float(np.ptp(places))), rotation_rad=1.0
        ),
        weights=Weights(goal=0.0, com_path=1.0, com_step=0.0, toe_step=0.0, tilt=spec.weights.tilt),
        tilt_limit_rad=spec.body.tilt_limit_rad,
    )


def _under(rows: Rows, row: int, ground: Terrain | None, half_m: float) -> Patch:
    """The surface under the foot of a row, or the piece of ground that its row speaks of.

    Arguments:
        half_m: half of a side of that piece [m].
    """
    place = places_of(rows)[row]
    if ground is not None and (found := nearest_ground(place, ground))[0] is not None:
        return found[0]
    normal = np.array([rows[name][row] for name in NORMAL]) if NORMAL[0] in rows else np.eye(3)[2]
    normal, shear = normal / np.linalg.norm(normal), np.eye(3)[np.abs(normal).argmin()]
    corners = _corners(place, normal, shear, half_m)
    mu = float(rows["friction"][row]) if "friction" in rows else FRICTION
    return Patch(vertices_m=corners, normal=normal, shear_reference=shear, friction=mu)


def _square(place_m: Array, of: Patch, half_m: float) -> Patch:
    """The piece of a surface about a place at its edge, beyond it, too."""
    down = float((place_m - of.centre_m) @ of.normal)
    corners = _corners(place_m - down * of.normal, of.normal, of.shear_reference, half_m)
    return of.with_vertices(corners)


def _corners(place_m: Array, normal: Array, shear: Array, half_m: float) -> Array:
    """Corners of a square about a place, in order, shape (4, 3) [m]."""
    first, second = half_m * contact_frames(normal, shear).T[1:]
    return np.array(
        [place_m + a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )


def nearest_ground(place_m: Array, ground: Terrain) -> tuple[Patch | None, float]:
    """The surface under a foot, None where none is near enough, and how far the nearest is [m]."""
    above = [
        (abs(surface.height(place_m)), k)
        for k, patch in enumerate(ground.patches)
        if (surface := Surface(patch, 0.0)).covers(place_m)
    ]
    distance, k = min(above, default=(np.inf, 0))
    return (ground.patches[k] if distance <= OFF_M else None), distance
