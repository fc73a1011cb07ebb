"""Limbs of a robot's model as the contact planner sees them: for each leg the half-spaces that its
toe is in.

Plans take inner sets, proofs outer ones. A toe planned in the inner polytope is one that the leg
reaches, about the centre of mass of the standing robot; that no plan exists within inner sets proves
nothing of the robot. The outer set holds every place of the toe about the centre of mass, wherever
legs and other joints take that (``outer_sets``), so that a proof over outer sets is one. The toe is
on the foot's surface, a radius away from the foot's centre in a direction that the terrain decides:
the inner set is that much smaller, the outer one that much larger.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.documents import read_text
from .hulls import Polytope
from .leg import Leg
from .limb import Limb
from .model import Robot
from .outer_sets import contact_radii_m, enclosing_ball, outer_sets
from .reach import MOST_ROWS, ReachRows, RelativeReach
from .robot_model import RobotModel
from .workspace import Workspace, workspaces_of

NAME = re.compile(r"^(?P<what>.+)_constraints_in_(?P<foot>[A-Za-z0-9]+).*\.obj$")
"""Name of a file: what the set is of, and the foot that it begins from."""
COM = "COM"
_PREFERRED = "reduced"
"""Of several files for the same set, the one whose name has this."""
_GAP_M = 0.02
"""Distance of two soles [m]."""
_SLACK_M = 1e-6
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
    return np.append(centre, radius + _SLACK_M)


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
    named = [path for path in paths if _PREFERRED in path.name.lower()] or paths
    if len(named) > 1:
        raise InvalidInput(
            f"{paths[0].parent}: expected one file a set, got {named[0].name} and {named[1].name}"
        )
    return named[0]


def same_limb(limb: str, name: str) -> bool:
    """Tell whether two names are of one limb, one being the other's beginning: LFleg, LF."""
    return len(name) > 1 and (limb.startswith(name) or name.startswith(limb))


Sets = Literal["inner", "outer"]


def limbs_over(
    robot: RobotModel, sets: Sets = "inner", workspaces: Sequence[Workspace] | None = None
) -> tuple[Limb, ...]:
    """The limbs of a model over these sets of its legs, from its centre of mass as it stands.

    Arguments:
        workspaces: workspaces of the legs; None to measure them, or take them from the cache.

    Raises:
        InvalidInput: for a leg whose foot is larger than its inner set, for one whose workspace has
            no inside, for outer sets of soles, and where a person has to say first what a leg touches with, or which way is
            up.
    """
    robot.check_known()
    if sets == "outer":
        if any(leg.sole is not None for leg in robot.legs):
            raise InvalidInput(
                f"robot {robot.name}: expected feet that are balls for outer sets, got soles, which "
                "may touch with any part of them"
            )
        return _outer_limbs(robot)
    measured = workspaces_of(robot) if workspaces is None else workspaces
    return tuple(
        _limb(leg, each, robot.body.com_m) for leg, each in zip(robot.legs, measured, strict=True)
    )


def contains_all(robot: Robot) -> bool:
    """Tell whether a robot's limbs may reach all that the legs of its own file may.

    Raises InvalidInput for a robot without such legs.
    """
    model = robot.source.own_model()
    return outer_sets(model).within(robot.limbs, contact_radii_m(model))


def standing_toes(robot: RobotModel) -> Array:
    """Places of the toes as the robot stands on level ground, from its centre of mass, shape (N, 3)
    [m].
    """
    down = np.array([0.0, 0.0, 1.0])
    return np.array([leg.nominal_m - leg.radius_m * down - robot.body.com_m for leg in robot.legs])


def _outer_limbs(robot: RobotModel) -> tuple[Limb, ...]:
    """The limbs over all that the legs may reach, wherever the centre of mass is."""
    sets, limbs = outer_sets(robot), []
    for leg, bounds, ball, radius in zip(
        robot.legs, sets.feet_m, sets.balls_m, contact_radii_m(robot), strict=True
    ):
        limbs.append(
            Limb(
                name=leg.name,
                shoulder_m=ball[:3],
                reach_m=float(ball[3] + radius),
                reach_rows=ReachRows(normals=sets.normals, bounds_m=bounds + radius),
                hip_m=leg.hip_m - robot.body.com_m,
            )
        )
    return tuple(limbs)


def _limb(leg: Leg, workspace: Workspace, com_m: Array) -> Limb:
    """One leg: its inner set as half-spaces, and a ball that holds them."""
    inner = workspace.inner
    centre, radius = enclosing_ball(inner.vertices)
    rows = ReachRows(
        normals=inner.normals, bounds_m=inner.offsets_m - leg.radius_m - inner.normals @ com_m
    )
    return Limb(
        name=leg.name,
        shoulder_m=centre - com_m,
        reach_m=radius,
        reach_rows=rows,
        sole_m=None if leg.sole is None else leg.sole.points_m,
        hip_m=leg.hip_m - com_m,
    )


def soles_apart(robot: RobotModel) -> tuple[RelativeReach, ...]:
    """Rows that keep the soles of two feet apart, whatever the body does: y_left − y_right is at
    least what both are wide, and ``_GAP_M``; none of other robots.
    """
    if len(robot.legs) != 2:
        return ()
    left, right = sorted(robot.legs, key=lambda leg: -float(leg.nominal_m[1]))
    if left.sole is None or right.sole is None:
        return ()
    wide = float(right.sole.points_m[:, 1].max() - left.sole.points_m[:, 1].min()) + _GAP_M
    aside = {left.name: 1.0, right.name: -1.0}
    return tuple(
        RelativeReach(
            limb=one.name,
            other=other.name,
            rows=ReachRows(
                normals=np.array([[0.0, aside[one.name], 0.0]]), bounds_m=np.array([-wide])
            ),
        )
        for one, other in (robot.legs, robot.legs[::-1])
    )
