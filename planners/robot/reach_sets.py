"""Limbs of a robot's model as the contact planner sees them: for each leg the half-spaces that its
toe is in.

Plans take inner sets, proofs outer ones. A toe planned in the inner polytope is one that the leg
reaches, about the centre of mass of the standing robot; that no plan exists within inner sets proves
nothing of the robot. The outer set holds every place of the toe about the centre of mass, wherever
legs and other joints take that (``outer_sets``), so that a proof over outer sets is one. The toe is
on the foot's surface, a radius away from the foot's centre in a direction that the terrain decides:
the inner set is that much smaller, the outer one that much larger.

The inner polytope is grown as IRIS does (Deits and Tedrake, 2015): half-spaces against the voxels
that no sampled posture reaches, each tangent to an ellipsoid at the nearest of them, the ellipsoid
then fitted to what is left. It is checked by inverse kinematics on points of its own, and cut where
those are out of reach. A plan over it is one that the leg can follow; that nothing is possible
within it proves nothing.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.documents import read_text
from .hulls import Polytope
from .inverse_kinematics import REACHED_M, InverseKinematics, descend, starts_of
from .leg import Leg
from .meshes import kept
from .model import MOST_ROWS, Limb, ReachRows, RelativeReach, Robot
from .outer_sets import contact_radii_m, enclosing_ball, outer_sets
from .robot_model import RobotModel

_SAMPLES = 60_000
"""Postures a joint, by which voxels are reached."""
_VOXELS = 36
"""Along the leg's length."""
_VOXELS_LEVEL, _AROUND = 26, 0.5
"""The same of a leg with a sole, and where these are: as far from where it stands, in lengths of the
leg."""
_MOST_FACES, _ROUNDS = 200, 4
"""Most faces of a polytope while it grows; ellipsoids that are tried."""
_MOST_INSIDE = 12_000
"""Voxels by which an ellipsoid is fitted."""
_SEEDS, _TRIES = 8_000, 2
"""Postures to start inverse kinematics from, and how many of them for each point."""
_CHECKED, _CUTS = 4_000, 16
"""Points by which a polytope is checked, and by which shares are measured; how often it is cut."""
_RETREATS, _ENOUGH = (0.5, 1.0, 1.5), 0.4
"""Voxels by which half-spaces stay away from those that are not reached, one after the other until
the polytope covers so much: a thin set, of joints with narrow ranges, is cut to nothing where they
are near."""
_MISSED = 0.0008
"""Share of a polytope that may be out of reach, as far as its points tell."""
_DEAR = 25.0
"""Points within reach that may be lost with one that is not."""
_MOST_TANGENTS = 20
_USEFUL, _USEFUL_LEVEL = 0.15, 0.65
"""Share of the leg's length: feet that are so far below the hip are of use, and count in ``cover``;
and the same of soles, on which nobody crouches lower."""
_CUBE = np.ones((3, 3, 3), dtype=np.bool_)
_CUBE.setflags(write=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Workspace:
    """Sets of one leg's foot, in the base's frame.

    Arguments:
        inner: a polytope that is reached throughout, as far as ``unreachable`` says.
        ball_m: the largest ball in it, centre and radius, shape (4,).
        box_m: the largest upright box in it, low and high corner, shape (2, 3).
        reach_m: how far from its first joint the foot gets [m].
        cover: share of what is reachable, usefully below the hip, that is in ``inner``.
        unreachable: share of ``inner`` that is not; both by inverse kinematics on sampled points.
    """

    inner: Polytope
    ball_m: Array
    box_m: Array
    reach_m: float
    cover: float
    unreachable: float


def workspace_of(leg: Leg, *, seed: int = 0) -> Workspace:
    """Measure a leg.

    Raises InvalidInput for one whose foot stays on a surface: it has no inside.
    """
    if len(leg.joints) < 3:
        raise InvalidInput(
            f"leg {leg.name}: expected three joints or more for a workspace with an inside, got "
            f"{len(leg.joints)}"
        )
    if leg.sole is not None and len(leg.joints) < 6:
        raise InvalidInput(
            f"leg {leg.name}: expected six joints or more to keep its sole level wherever it stands, "
            f"got {len(leg.joints)}"
        )
    rng = np.random.default_rng(seed)
    voxels = _Voxels(leg, rng)
    solver = InverseKinematics([leg], [starts_of(leg, _SEEDS, rng)], tries=_TRIES)
    cover, inner = -1.0, Polytope(normals=np.zeros((0, 3)), offsets_m=np.zeros(0))
    for retreat in _RETREATS:
        tried = _cut(voxels.polytope(leg.nominal_m, retreat), solver, rng)
        useful = voxels.useful(_CHECKED, rng)
        held = tried.contains(useful[_reached(solver, useful)])
        share = float(held.mean()) if len(held) else 0.0
        if share > cover:
            cover, inner = share, tried
        if cover >= _ENOUGH:
            break
    return Workspace(
        inner=inner,
        ball_m=inner.largest_ball,
        box_m=inner.largest_box(),
        reach_m=voxels.reach_m,
        cover=cover,
        unreachable=float(1.0 - _reached(solver, inner.sample(_CHECKED, rng)).mean()),
    )


class _Voxels:
    """Voxels of space that a leg's foot reaches, by random postures."""

    def __init__(self, leg: Leg, rng: np.random.Generator) -> None:
        from scipy.ndimage import binary_closing  # slow to import

        self.size = leg.chain.length_m / (_VOXELS if leg.sole is None else _VOXELS_LEVEL)
        feet = (
            leg.chain.feet(leg.random_angles(_SAMPLES * len(leg.joints), rng))
            if leg.sole is None
            else self._level(leg)
        )
        self.reach_m = float(np.linalg.norm(feet - leg.hip_m, axis=1).max())
        self.corner = feet.min(axis=0) - 2.0 * self.size
        if leg.sole is not None:  # points of a grid are in the middles of cells
            self.corner -= 0.5 * self.size
        cells = ((feet - self.corner) / self.size).astype(np.intp)
        shape = tuple(cells.max(axis=0) + 3)
        reached = np.zeros(shape, dtype=np.bool_)
        reached.ravel()[np.ravel_multi_index(tuple(cells.T), shape)] = True
        self.reached = binary_closing(reached, _CUBE)
        swings = leg.chain.frames(leg.stance_rad[None])[1][0, min(1, len(leg.joints) - 1)]
        useful = _USEFUL if leg.sole is None else _USEFUL_LEVEL
        self.useful_m = float(swings[2] - useful * leg.chain.length_m)

    def _level(self, leg: Leg) -> Array:
        """Points of a grid about where a sole stands that it reaches level, by inverse kinematics,
        shape (K, 3) [m].
        """
        far = _AROUND * leg.chain.length_m
        steps = np.arange(-far, far, self.size)
        grid = np.stack(np.meshgrid(steps, steps, steps[steps > -0.5 * far]), axis=-1)
        points = leg.nominal_m + grid.reshape(-1, 3)
        start = np.repeat(leg.stance_rad[None], len(points), axis=0)
        level = points[descend(leg, points, start)[1] <= REACHED_M]
        if not len(level):
            raise InvalidInput(
                f"leg {leg.name}: expected a sole that stays level near where it stands, got none"
            )
        return np.asarray(level)

    def polytope(self, home: Array, retreat: float) -> Polytope:
        """Half-spaces around the home of a foot that no unreached voxel is in, so many voxels away
        from it.
        """
        from scipy.ndimage import binary_dilation, distance_transform_edt  # slow to import

        walls = self._centres(binary_dilation(self.reached) & ~self.reached)
        inside = self._centres(self.reached)
        deep = distance_transform_edt(self.reached)[self.reached] * (inside[:, 2] < self.useful_m)
        deepest, inside = inside[int(np.argmax(deep))], inside[:: 1 + len(inside) // _MOST_INSIDE]
        best = -1, np.zeros((0, 3)), np.zeros(0)
        for start in (home, deepest):
            metric, centre = np.eye(3), start
            for _ in range(_ROUNDS):
                normals, offsets = self._tangents(walls, metric, centre, home, retreat)
                within = inside[np.all(inside @ normals.T <= offsets, axis=1)]
                worth = int(np.count_nonzero(within[:, 2] < self.useful_m))
                if worth > best[0]:
                    best = worth, normals, offsets
                if len(within) < 10:
                    break
                metric, centre = (
                    np.cov(within.T) + 1e-6 * self.size**2 * np.eye(3),
                    within.mean(axis=0),
                )
        return self._fewer(best[1], best[2], walls)

    def useful(self, count: int, rng: np.random.Generator) -> Array:
        """Points spread evenly over the voxels that are reached, usefully below the hip, shape
        (count, 3).
        """
        corners = self._centres(self.reached) - 0.5 * self.size
        points = corners[rng.integers(len(corners), size=8 * count)] + self.size * rng.random(
            (8 * count, 3)
        )
        return np.asarray(points[points[:, 2] < self.useful_m][:count])

    def _centres(self, cells: np.ndarray) -> Array:
        return np.asarray(self.corner + self.size * (np.argwhere(cells) + 0.5))

    def _tangents(
        self, walls: Array, metric: Array, centre: Array, home: Array, retreat: float
    ) -> tuple[Array, Array]:
        """Planes against the walls, the nearest first in the ellipsoid's metric, so many voxels
        before each.
        """
        inverse = np.linalg.inv(metric)
        away = walls - centre
        left = walls[np.argsort(np.einsum("ki,ki->k", away @ inverse, away))]
        normals, offsets = list[Array](), list[float]()
        while len(left) and len(normals) < _MOST_FACES:
            wall = left[0]
            for normal in (
                inverse @ (wall - centre),
                wall - home,
            ):  # the second one keeps home inside
                normal = normal / np.linalg.norm(normal)
                offset = float(normal @ wall) - retreat * self.size
                if normal @ home < offset:
                    break
            normals.append(normal)
            offsets.append(offset)
            left = left[left @ normal < offset + 1e-9]
        return np.array(normals), np.array(offsets)

    def _fewer(self, normals: Array, offsets: Array, walls: Array) -> Polytope:
        """Without the faces that keep no wall out, the last found first."""
        out = walls @ normals.T > offsets - 0.25 * self.size
        keeping, keep = out.sum(axis=1), np.ones(len(normals), dtype=np.bool_)
        for i in reversed(range(len(normals))):
            if not np.any(out[:, i] & (keeping == 1)):
                keep[i] = False
                keeping = keeping - out[:, i]
        return Polytope(normals=normals[keep], offsets_m=offsets[keep])


def _cut(inner: Polytope, solver: InverseKinematics, rng: np.random.Generator) -> Polytope:
    """The polytope without the parts that inverse kinematics does not reach, tried on fresh points
    in every round.
    """
    for _ in range(_CUTS):
        points = inner.sample(_CHECKED, rng)
        missed = ~_reached(solver, points)
        if np.count_nonzero(missed) <= _MISSED * _CHECKED:
            break
        tangents = (points[missed] - points.mean(axis=0)) @ np.linalg.inv(np.cov(points.T))
        tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
        candidates = np.vstack([inner.normals, tangents[:_MOST_TANGENTS]])
        normals, offsets = _best_faces(candidates, points, missed)
        if not len(normals):
            break
        inner = inner.cut(normals, offsets)
    return inner.lean()


def _best_faces(candidates: Array, points: Array, missed: np.ndarray) -> tuple[Array, Array]:
    """Half-spaces that leave out missed points, one after the other, each worth the most: DEAR for
    each of those, less one for each other point that it leaves out.
    """
    normals, offsets = list[Array](), list[float]()
    along, value = points @ candidates.T, np.where(missed, _DEAR, -1.0)
    order = np.argsort(-along, axis=0).T  # of all points that are left, a row each candidate
    while missed.any():
        worth = np.cumsum(value[order], axis=1).T
        last, best = np.unravel_index(int(np.argmax(worth)), worth.shape)
        if worth[last, best] <= 0.0:
            break
        offset = float(along[order[best, last], best]) - 1e-9
        normals.append(candidates[best])
        offsets.append(offset)
        left = along[:, best] <= offset
        missed = missed & left
        order = order[left[order]].reshape(len(candidates), -1)
    return np.array(normals).reshape(-1, 3), np.array(offsets)


def _reached(solver: InverseKinematics, points: Array) -> np.ndarray:
    return np.asarray(solver.solve(points[:, None])[1][:, 0] <= REACHED_M)


_VERSION = "workspace/3"
"""Part of every digest: a change of method changes it, and older files are no longer found."""


def workspaces_of(robot: RobotModel, *, cached: bool = True) -> tuple[Workspace, ...]:
    """Workspaces of all legs, in the robot's order; read where a leg like it was measured before,
    on whatever robot.

    Arguments:
        cached: False measures again and keeps nothing. A file that is damaged counts as none, a
            folder that cannot be written to keeps none.

    Raises:
        InvalidInput: for a leg that reaches no volume, as one with a single joint, or less than its
            foot is large.
    """
    measured = tuple(_kept(leg) if cached else workspace_of(leg) for leg in robot.legs)
    for leg, each in zip(robot.legs, measured, strict=True):
        if each.ball_m[3] <= leg.radius_m:
            raise InvalidInput(
                f"leg {leg.name}: expected room for its foot, {leg.radius_m:g} m, in what it surely "
                f"reaches, got {each.ball_m[3]:.3g} m: say other limits or another posture_rad "
                "in a YAML file"
            )
    return measured


def _kept(leg: Leg) -> Workspace:
    """Workspace of one leg, kept by all that it depends on: chain, limits and the posture in which
    it stands.
    """
    chain = leg.chain
    numbers = (chain.rotations, chain.origins, chain.axes, chain.slides, chain.tip_m)
    sole: tuple[Any, ...] = ()
    if leg.sole is not None:
        sole = (leg.sole.points_m.tolist(), leg.sole.rotation.tolist(), _USEFUL_LEVEL)
    key_parts = [
        _VERSION,
        *sole,
        *(each.tolist() for each in (*numbers, leg.lower_rad, leg.upper_rad, leg.stance_rad)),
    ]
    return kept(
        "workspaces/",
        json.dumps(key_parts).encode(),
        lambda: _arrays(workspace_of(leg)),
        _workspace,
    )


def _arrays(each: Workspace) -> dict[str, Any]:
    return {
        "normals": each.inner.normals,
        "offsets": each.inner.offsets_m,
        "ball": each.ball_m,
        "box": each.box_m,
        "shares": [each.reach_m, each.cover, each.unreachable],
    }


def _workspace(arrays: Mapping[str, Any]) -> Workspace:
    reach, cover, unreachable = arrays["shares"]
    return Workspace(
        inner=Polytope(normals=arrays["normals"], offsets_m=arrays["offsets"]),
        ball_m=arrays["ball"],
        box_m=arrays["box"],
        reach_m=float(reach),
        cover=float(cover),
        unreachable=float(unreachable),
    )


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
        if robot.own:
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
            f"{path}: expected corners, normals and faces of an OBJ file (f v//n …), got other lines"
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
            "indices beyond them"
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
    robot: RobotModel,
    sets: Sets = "inner",
    workspaces: Sequence[Workspace] | None = None,
    tilt_rad: float = 0.0,
) -> tuple[Limb, ...]:
    """The limbs of a model over these sets of its legs, from its centre of mass as it stands.

    Arguments:
        workspaces: workspaces of the legs; None to measure them, or take them from the cache.
        tilt_rad: limit of the tilt of the body whose outer sets these are.

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
        return _outer_limbs(robot, tilt_rad)
    measured = workspaces_of(robot) if workspaces is None else workspaces
    return tuple(
        _limb(leg, each, robot.com_m) for leg, each in zip(robot.legs, measured, strict=True)
    )


def contains_all(robot: Robot, tilt_rad: float) -> bool:
    """Tell whether a robot's limbs may reach all that the legs of its own file may, its body within
    this limit of the tilt, wherever its other feet are.

    Raises InvalidInput for a robot without such legs.
    """
    model = robot.own_model()
    return not robot.relative_reach and outer_sets(model).tilted(tilt_rad).within(
        robot.limbs, contact_radii_m(model)
    )


def standing_toes(robot: RobotModel) -> Array:
    """Places of the toes as the robot stands on level ground, from its centre of mass, shape (N, 3)
    [m].
    """
    return np.array([leg.nominal_m - [0.0, 0.0, leg.radius_m] - robot.com_m for leg in robot.legs])


def _outer_limbs(robot: RobotModel, tilt_rad: float) -> tuple[Limb, ...]:
    """The limbs over all that the legs may reach, wherever the centre of mass is."""
    sets = outer_sets(robot).tilted(tilt_rad)
    each = zip(robot.legs, sets.feet_m, sets.balls_m, contact_radii_m(robot), strict=True)
    return tuple(
        Limb(
            name=leg.name,
            shoulder_m=ball[:3],
            reach_m=float(ball[3] + radius),
            reach_rows=ReachRows(normals=sets.normals, bounds_m=bounds + radius),
            hip_m=leg.hip_m - robot.com_m,
        )
        for leg, bounds, ball, radius in each
    )


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
