"""Reach polytopes from files, as kinematic planners publish them: half-spaces of the centre of mass
and of other feet.

A folder has one OBJ file a set: ``…COM_constraints_in_X….obj``, where the centre of mass may be
from foot X, and ``…Y…_constraints_in_X….obj``, where foot Y may be. Every face is a half-space: its
normal is the row, the normal times the face's first corner the bound. That is not the hull of the
corners, some of which are off the planes of their faces. Axes are the heading's, which is +x of the
world.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.documents import read_text
from .model import Robot
from .outer import enclosing_ball
from .polytope import Polytope
from .reach import MOST_ROWS, ReachRows, RelativeReach

NAME = re.compile(r"^(?P<what>.+)_constraints_in_(?P<foot>[A-Za-z0-9]+).*\.obj$")
"""Name of a file: what the set is of, and the foot that it begins from."""
COM = "COM"
PREFERRED = "reduced"
"""Of several files for the same set, the one whose name has this."""
SLACK_M = 1e-6
"""The ball about a limb's half-spaces is this much larger than the one about their corners."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReachSets:
    """Sets of places of each limb's toe relative to the centre of mass, and of the feet relative to
    one another.

    Arguments:
        toes: half-spaces of p − c, by limb.
        balls: centre and radius of a ball that holds them, shape (4,) [m], by limb.
    """

    toes: Mapping[str, ReachRows]
    balls: Mapping[str, Array]
    feet: tuple[RelativeReach, ...]

    def applied(self, robot: Robot) -> Robot:
        """The robot with this reach in place of its own, limb by limb.

        Raises InvalidInput for one with a model.
        """
        if robot.source.own:
            raise InvalidInput(
                f"reach: expected a robot without a model of its legs, got {robot.name}, which has "
                "one"
            )
        limbs = tuple(
            replace(
                limb,
                shoulder_m=self.balls[limb.name][:3],
                reach_m=float(self.balls[limb.name][3]),
                reach_rows=self.toes[limb.name],
            )
            for limb in robot.limbs
        )
        return replace(robot, feet=(), limbs=limbs, relative_reach=self.feet)


def read_reach(folder: str | Path, limbs: Sequence[str], *, com_stretch: float = 1.0) -> ReachSets:
    """The sets of some limbs in a folder.

    Arguments:
        limbs: names; a file is of the limb whose name and the file's begin alike.
        com_stretch: the sets of the centre of mass are made so much larger, about the mean of their
            corners.

    Raises:
        InvalidInput: for a folder that lacks a limb's set of the centre of mass, for two files for
            one set, and for files that are no such sets.
    """
    files = _files(Path(folder), limbs)
    toes, balls, feet = dict[str, ReachRows](), dict[str, Array](), list[RelativeReach]()
    for limb in limbs:
        if (COM, limb) not in files:
            raise InvalidInput(
                f"{folder}: expected a file COM_constraints_in_{limb}*.obj, got none"
            )
        path = files[COM, limb]
        normals, bounds, _ = read_polytope(path, stretch=com_stretch)
        balls[limb] = _ball(path, -normals, bounds)
        toes[limb] = ReachRows(normals=-normals, bounds_m=bounds)
        for other in limbs:
            if other != limb and (other, limb) in files:
                normals, bounds, _ = read_polytope(files[other, limb])
                try:
                    rows = ReachRows(normals=normals, bounds_m=bounds)
                except InvalidInput as error:
                    raise InvalidInput(f"{files[other, limb]}: {error}") from None
                feet.append(RelativeReach(limb=limb, other=other, rows=rows))
    return ReachSets(toes=toes, balls=balls, feet=tuple(feet))


def read_polytope(path: str | Path, *, stretch: float = 1.0) -> tuple[Array, Array, Array]:
    """The half-spaces of an OBJ file, normals · x ≤ bounds, shapes (F, 3) and (F,), and its
    corners, (V, 3) [m].

    Normals are as the file has them.

    Arguments:
        stretch: factor on the distances of the corners from their mean.

    Raises:
        InvalidInput: for a file without corners, normals and faces that name them (``v//n``).
    """
    rows: dict[str, list[list[str]]] = {"v": [], "vn": [], "f": []}
    for line in read_text(path).splitlines():
        kind, *words = line.split() or [""]
        rows.get(kind, []).append(words)
    try:
        corners, normals = (
            np.array(rows[kind], dtype=np.float64).reshape(len(rows[kind]), 3)
            for kind in ("v", "vn")
        )
        faces = (
            np.array(
                [[int(part) for part in face[0].split("/")[::2]] for face in rows["f"]]
            ).reshape(-1, 2)
            - 1
        )
    except (ValueError, IndexError):
        raise InvalidInput(
            f"{path}: expected corners, normals and faces of an OBJ file (f v//n …), got others"
        ) from None
    if not 4 <= len(faces) <= MOST_ROWS or not (
        np.isfinite(corners).all() and np.isfinite(normals).all()
    ):
        raise InvalidInput(
            f"{path}: expected 4 to {MOST_ROWS} faces of finite corners, got {len(faces)}"
        )
    if faces.min() < 0 or faces[:, 0].max() >= len(corners) or faces[:, 1].max() >= len(normals):
        raise InvalidInput(
            f"{path}: expected faces of its {len(corners)} corners and {len(normals)} normals, got "
            "others"
        )
    middle = corners.mean(axis=0)
    corners = middle + stretch * (corners - middle)
    normals_of_faces = normals[faces[:, 1]]
    return normals_of_faces, np.vecdot(normals_of_faces, corners[faces[:, 0]]), corners


def _ball(path: Path, normals: Array, bounds: Array) -> Array:
    """Centre and radius of a ball that holds the half-spaces' set, shape (4,).

    Raises InvalidInput for an empty one.
    """
    length = np.linalg.norm(normals, axis=1)
    try:
        corners = Polytope(normals=normals / length[:, None], offsets_m=bounds / length).vertices
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
    centre, radius = enclosing_ball(corners)
    return np.append(centre, radius + SLACK_M)


def _files(folder: Path, limbs: Sequence[str]) -> dict[tuple[str, str], Path]:
    """The file of every set, by what it is of (``COM`` or a limb) and the limb that it begins
    from.
    """
    if not folder.is_dir():
        raise InvalidInput(f"{folder}: expected a folder of reach polytopes, found none")
    files = dict[tuple[str, str], list[Path]]()
    for path in sorted(folder.glob("*.obj")):
        match = NAME.match(path.name)
        if match is None:
            continue
        head = match["what"].split("_")
        limbs_of_foot = [name for name in limbs if same_limb(name, match["foot"])]
        what = (
            [COM]
            if head[-1] == COM
            else [name for name in limbs if any(same_limb(name, part) for part in head)]
        )
        if len(limbs_of_foot) == len(what) == 1:
            files.setdefault((what[0], limbs_of_foot[0]), []).append(path)
    return {key: _one(paths) for key, paths in files.items()}


def _one(paths: list[Path]) -> Path:
    named = [path for path in paths if PREFERRED in path.name.lower()] or paths
    if len(named) > 1:
        raise InvalidInput(
            f"{paths[0].parent}: expected one file a set, got {named[0].name} and {named[1].name}"
        )
    return named[0]


def same_limb(limb: str, name: str) -> bool:
    """Tell whether two names are of one limb, one being the other's beginning: LFleg, LF."""
    return len(name) > 1 and (limb.startswith(name) or name.startswith(limb))
