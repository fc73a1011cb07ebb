"""A course from a terrain and two places: a way over footholds, frames, gait and candidates, laid out by themselves.

Body places are the nodes of a lattice. At a node every toe, as the robot stands, needs a foothold close by, and they
may not differ much in height; the way is the shortest over such nodes, longer where footholds are rare. It becomes the
nominal path of the centre of mass, straight between few points; the planner then chooses every toe.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from ..errors import InvalidInput, PlanningFailed
from ..files.arrays import Array, checked_int, read_only
from ..robot.model import Limb, Robot
from ..terrain.footholds import Footholds
from ..terrain.patch import Patch
from ..terrain.polygon import half_planes
from .alternatives import AS_ASKED, Alternative
from .candidates import NoPlace
from .course_keys import CourseSpec
from .course_layout import build_course
from .file_terrain import FileTerrain
from .problem import MOST_FRAMES, Problem
from .toe_offset import toe_offset

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets

LATTICE_M = 0.04
"""Between nodes [m]; more on terrains that have too many."""
MOST_NODES = 1_000_000
ASIDE = 0.35
"""How far a toe's foothold may be from where it likes to be, in reaches."""
APART = (0.3, 0.5)
"""How far a foothold may be above or below the mean of all, in reaches: the second where the first leaves no way."""
STRIDE = 0.5
"""Way of the body until all limbs have moved once, in reaches."""
STRAIGHT_M = 0.03
"""Points of the way this close to a straight line are left out [m]."""
RARE = 3.0
"""A way costs so many times its length where every toe is as far aside as it may be."""
CANDIDATES = 3
STEPS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2))


def course_between(
    terrain: FileTerrain,
    start_m: Sequence[float],
    goal_m: Sequence[float],
    *,
    robot: Robot | str | None = None,
    frames: int | None = None,
    name: str = "",
    folder: Path = Path(),
    alternative: Alternative = AS_ASKED,
) -> CourseSpec:
    """The course over a terrain's file from one place (x, y) [m] to another, the robot facing along x.

    robot: the hexapod unless named; frames: M, by the length of the way if missing. Raises InvalidInput for a start or
    goal without footholds for all toes, and PlanningFailed where no way over footholds is found, which proves nothing.
    """
    keys: dict[str, Any] = {
        "name": name or _called(terrain.file), "frames": 1, "start_m": (*start_m, 0.0), "goal_m": (*goal_m, 0.0),
        "terrain": terrain, **({"robot": robot} if isinstance(robot, str) else {}),
    }  # fmt: skip

    def described(**more: Any) -> CourseSpec:
        made = CourseSpec(**{**keys, **more})
        return made.of_robot(robot) if isinstance(robot, Robot) else made

    spec = described()
    model = spec.robot_model(folder)
    body = spec.make_robot(model)
    spec = alternative.of(spec.standing(model, body), body)
    toes = np.array([limb.shoulder_m + toe_offset(limb, spec.stance) for limb in body.limbs])
    reach = float(np.mean([limb.reach_m for limb in body.limbs]))
    found = terrain.along(np.array(keys["goal_m"])[None], folder)
    ends = np.array([start_m, goal_m], dtype=np.float64)
    way = _way([patch for _, patch in found.standing], toes, reach, ends, body)
    gait = "tripod" if len(body.limbs) >= 6 and len(body.limbs) % 2 == 0 else "wave"
    turns = 2 if gait == "tripod" else len(body.limbs)
    if alternative.gait is not None:
        turns = len(body.limbs)
    stride = STRIDE * reach / turns
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    wanted = max(2, int(np.ceil(length / stride)) + 1) if frames is None else frames
    if wanted > MOST_FRAMES:
        raise InvalidInput(
            f"goal: expected a way of at most {stride * (MOST_FRAMES - 1):.3g} m ({MOST_FRAMES} frames), got "
            f"{length:.3g} m; plan it in parts"
        )
    last = max(1.0, length / max(wanted - 1, 1) / stride)  # fewer frames than that take longer steps
    update = {
        "frames": wanted, "gait": gait if alternative.gait is None else spec.gait,
        "start_m": tuple(way[0].tolist()), "goal_m": tuple(way[-1].tolist()),
        "via_m": [tuple(point) for point in way[1:-1].tolist()],
        "candidates": {
            "count": CANDIDATES + alternative.candidates, "window_m": float(np.clip(0.8 * reach, 0.1, 0.5)),
            "margin_m": terrain.footholds.margin_m,
        },
        "steps": {"com_m": 1.5 * stride * last, "toe_m": 2.0 * STRIDE * reach * last},
    }  # fmt: skip
    if not alternative.drawn:
        update["weights"] = {"stance": 0.0}
    if alternative.level:
        update["body"] = {"tilt_limit_rad": 0.0}
    return described(stance=spec.stance, **update)


def laid_between(
    terrain: Footholds | str | Path,
    start_m: Array | Sequence[float],
    goal_m: Array | Sequence[float],
    *,
    robot: Robot | str | None = None,
    frames: int | None = None,
) -> Callable[[Sets, Alternative], Problem]:
    """What lays out the course over a terrain from one place (x, y) [m] to another, see ``course_between``.

    terrain: its footholds, or its file.
    """
    start, goal = (
        read_only(place, (2,), name).tolist() for name, place in (("start_xy_m", start_m), ("goal_xy_m", goal_m))
    )
    count = None if frames is None else checked_int(frames, "frames", least=1, most=MOST_FRAMES)
    over = FileTerrain.of(terrain) if isinstance(terrain, Footholds) else FileTerrain(file=str(Path(terrain).resolve()))
    who = str(Path(robot).resolve()) if isinstance(robot, str) and Path(robot).suffix else robot

    def laid_out(sets: Sets, alternative: Alternative = AS_ASKED) -> Problem:
        try:
            spec = course_between(over, start, goal, robot=who, frames=count, alternative=alternative)
            return build_course(spec, sets=sets)
        except InvalidInput as error:
            name, colon, rest = str(error).partition(":")
            said = f"{name}_xy_m{colon}{rest}" if name in ("start", "goal") else str(error)
            raise type(error)(said) from None

    return laid_out


def _way(patches: Sequence[Patch], toes: Array, reach_m: float, ends_m: Array, robot: Robot) -> Array:
    """Points of the shortest way between two places, shape (L, 3) [m]. Raises NoPlace and PlanningFailed."""
    start, goal = ends_m
    try:
        return _Lattice.over(patches, toes, reach_m, APART[0]).way(start, goal, robot)
    except (NoPlace, PlanningFailed) as error:
        try:
            return _Lattice.over(patches, toes, reach_m, APART[1]).way(start, goal, robot)
        except (NoPlace, PlanningFailed):
            raise error from None


def _called(file: str) -> str:
    """What a course over a terrain is called: as its file without the ending, or as its ground."""
    from ..terrain.reference import names_ground  # splines are slow to import

    return Path(file).name if names_ground(file) else Path(file).stem


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lattice:
    """Nodes on an even grid from a corner, shape (2,) [m]; z_m: height of the body there, NaN where it cannot be, shape
    (n, m); worth: cost of a way there by its length, shape (n, m); missing: which toe lacks a foothold, −1 for none."""

    corner_m: Array
    spacing_m: float
    z_m: Array
    worth: Array
    missing: NDArray[np.int_]
    reach_m: float

    @classmethod
    def over(cls, patches: Sequence[Patch], toes: Array, reach_m: float, apart: float) -> _Lattice:
        """The lattice over footholds. toes: from the centre of mass as the robot stands, shape (N, 3) [m]; apart: how
        far one may be above or below their mean, in reaches."""
        corners = np.concatenate([patch.vertices_m for patch in patches])[:, :2]
        room = float(np.abs(toes[:, :2]).max()) + ASIDE * reach_m
        low, high = corners.min(axis=0) - room, corners.max(axis=0) + room
        spacing = max(LATTICE_M, float(np.sqrt(np.prod(high - low) / MOST_NODES)))
        shape = np.ceil((high - low) / spacing).astype(int) + 1
        heights = _rastered(patches, low, spacing, shape)
        away, nearest = distance_transform_edt(np.isnan(heights), return_indices=True)
        aside = spacing * away / (ASIDE * reach_m)
        close = np.where(aside <= 1.0, heights[tuple(nearest)], np.nan)
        each, costs = [], []
        for toe in toes:
            shift = np.round(toe[:2] / spacing).astype(int)
            each.append(_moved(close, shift, np.nan) - toe[2])
            costs.append(_moved(aside, shift, 1.0))
        levels = np.array(each)
        lacking = np.where(np.isnan(levels).any(axis=0), np.isnan(levels).argmax(axis=0), -1)
        z = levels.mean(axis=0)
        z[np.abs(levels - z).max(axis=0) > apart * reach_m] = np.nan
        worth = 1.0 + (RARE - 1.0) * np.clip(np.mean(costs, axis=0), 0.0, 1.0)
        return cls(corner_m=low, spacing_m=spacing, z_m=z, worth=worth, missing=lacking, reach_m=reach_m)

    def way(self, start: Array, goal: Array, robot: Robot) -> Array:
        """Points of the way, straight between them, shape (L, 3) [m]."""
        ends = [self._node(place, name, robot.limbs) for place, name in ((start, "start"), (goal, "goal"))]
        if ends[0] == ends[1]:
            gap = float(np.linalg.norm(goal - start))
            raise InvalidInput(f"goal: expected a place {self.spacing_m:.2g} m or more from the start, got {gap:.2g} m")
        shortest: Any = dijkstra
        cost, before = shortest(self._graph(), indices=ends[0], return_predecessors=True, directed=False)
        if not np.isfinite(cost[ends[1]]):
            raise PlanningFailed(
                f"no way over footholds from ({start[0]:g}, {start[1]:g}) to ({goal[0]:g}, {goal[1]:g}) with every toe "
                f"within {ASIDE * self.reach_m:.2g} m of where it likes to be; a course in a file may ask for more"
            )
        nodes = [ends[1]]
        while nodes[-1] != ends[0]:
            nodes.append(int(before[nodes[-1]]))
        points = np.array([self._point(node) for node in nodes[::-1]])
        points[0, :2], points[-1, :2] = start, goal
        return _straightened(points)

    def _point(self, node: int) -> Array:
        i, j = np.unravel_index(node, self.z_m.shape)
        return np.array([*(self.corner_m + self.spacing_m * np.array([i, j])), self.z_m[i, j]])

    def _node(self, place: Array, name: str, limbs: Sequence[Limb]) -> int:
        """The node at a place. Raises InvalidInput where the robot cannot stand."""
        at = np.round((place - self.corner_m) / self.spacing_m).astype(int)
        known = np.isfinite(self.z_m)
        where = f"{name}: expected footholds for every toe about ({place[0]:g}, {place[1]:g})"
        if not known.any():
            raise NoPlace(f"{where}, got a terrain on which the robot can stand nowhere")
        inside = bool(np.all((at >= 0) & (at < self.z_m.shape)))
        if inside and known[tuple(at)]:
            return int(np.ravel_multi_index(tuple(at), self.z_m.shape))
        gaps = self.corner_m + self.spacing_m * np.argwhere(known) - place
        gap = float(np.linalg.norm(gaps, axis=1).min())
        lacking = int(self.missing[tuple(at)]) if inside else 0
        reason = (
            f"none near that of {limbs[lacking].name}" if lacking >= 0 else "some too far above or below the others"
        )
        raise NoPlace(f"{where}, got {reason}; the nearest place to stand is {gap:.3g} m away")

    def _graph(self) -> Any:
        """Ways between neighbouring nodes, by what they cost."""
        index = np.arange(self.z_m.size).reshape(self.z_m.shape)
        ones, others, costs = [], [], []
        for step in STEPS:
            here, there = _pair(self.z_m.shape, step)
            rise = np.abs(self.z_m[there] - self.z_m[here])
            flat = self.spacing_m * float(np.hypot(*step))
            good = rise <= flat  # not steeper than 45 degrees
            ones.append(index[here][good])
            others.append(index[there][good])
            cost = np.hypot(flat, rise) * 0.5 * (self.worth[here] + self.worth[there])
            costs.append(cost[good])
        shape = (self.z_m.size, self.z_m.size)
        return coo_array((np.concatenate(costs), (np.concatenate(ones), np.concatenate(others))), shape=shape).tocsr()


def _rastered(patches: Sequence[Patch], low: Array, spacing: float, shape: Array) -> Array:
    """The height of the highest of patches at every node, NaN where there is none, shape (n, m) [m]."""
    heights = np.full(tuple(shape), -np.inf)
    for patch in patches:
        if patch.normal[2] < 1e-3:
            continue
        flat = patch.vertices_m[:, :2]
        (i0, j0), (i1, j1) = (
            np.floor((flat.min(axis=0) - low) / spacing),
            np.ceil((flat.max(axis=0) - low) / spacing) + 1.0,
        )
        i, j = np.arange(int(i0), int(i1)), np.arange(int(j0), int(j1))
        xy = low + spacing * np.stack(np.meshgrid(i, j, indexing="ij"), axis=-1)
        normals, offsets = half_planes(flat)
        inside = np.all(xy @ normals.T <= offsets + 1e-9, axis=-1)
        z = patch.centre_m[2] - (xy - patch.centre_m[:2]) @ patch.normal[:2] / patch.normal[2]
        window = np.ix_(i, j)
        heights[window] = np.maximum(heights[window], np.where(inside, z, -np.inf))
    return np.where(np.isfinite(heights), heights, np.nan)


def _moved(values: Array, shift: NDArray[np.int_], beyond: float) -> Array:
    """values at (i, j) + shift, and ``beyond`` where that is none."""
    found = np.full(values.shape, beyond)
    here, there = _pair(values.shape, (int(shift[0]), int(shift[1])))
    found[here] = values[there]
    return found


def _pair(shape: tuple[int, ...], step: tuple[int, int]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of nodes, and of those a step away."""
    here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, shape, strict=True))
    there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(step, shape, strict=True))
    return here, there


def _straightened(points: Array) -> Array:
    """The way without points that are close to straight lines between the others (Douglas and Peucker)."""
    if len(points) < 3:
        return points
    line = points[-1] - points[0]
    about = points - points[0]
    share = np.clip(about @ line / max(float(line @ line), 1e-12), 0.0, 1.0)
    off = np.linalg.norm(about - share[:, None] * line, axis=1)
    farthest = int(off.argmax())
    if off[farthest] <= STRAIGHT_M:
        return points[[0, -1]]
    return np.concatenate([_straightened(points[: farthest + 1])[:-1], _straightened(points[farthest:])])
