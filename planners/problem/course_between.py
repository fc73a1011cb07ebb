"""A course from a terrain and two places: a way over footholds, frames, gait and candidates, laid
out by themselves.

The guide path (``guide_path``) becomes the nominal path of the centre of mass, straight between few
points; the planner then chooses every toe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arguments import cached_property
from ..errors import InvalidInput, check_time
from ..files.arrays import Array, checked_int, read_only
from ..files.documents import validated
from ..robot.model import Robot, hexapod
from ..terrain.families import Terrain
from ..terrain.footholds import Footholds
from ..terrain.patch import Frame
from ..terrain.polygon import STEEP, Surface
from .contact import Weights
from .course_keys import AS_ASKED, AS_IT_STANDS, Alternative, BodySpec, CourseSpec, toe_offset
from .course_layout import build_course, gait_sets
from .course_terrain import FileTerrain, footholds_for
from .guide_path import Footprint, guide_path
from .passage import Passage, near_of
from .problem import MOST_FRAMES, Problem, local_origin

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets
    from .standing_map import StandingMap

_STRIDE = 0.5
"""Way of the body until all limbs have moved once, in reaches."""
_SWAY = 1.2
"""Distance of the body from its nominal path, in distances of toes from it, of two and three feet."""
_APART = 0.6
"""Width of their candidates, in distances of toes from each other, so that legs do not cross."""
_CANDIDATES, _WINDOWS = 3, (0.8, 1.2)
"""Candidates of a foothold, and their width in reaches, the second where legs stride."""
_LOPSIDED = 0.02
"""A share of what there is by which two sides of a way differ, or they are alike."""


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
    avoid_m: Sequence[Array] = (),
    standing: StandingMap | None = None,
    straight: bool = False,
) -> CourseSpec:
    """The course over a terrain's file from one place (x, y) [m] to another, the robot facing along
    x.

    Arguments:
        robot: the hexapod unless named.
        frames: M, by the length of the way if missing.
        avoid_m, standing: as for ``guide_path``.
        straight: the way of the body is the straight one, whatever is below it.

    Raises:
        InvalidInput: for a start or goal in a solid, off the terrain or without footholds for all
            toes, and PlanningFailed where no way is found, which names what is in the way and
            proves nothing.
    """
    keys: dict[str, Any] = {
        "name": name or _called(terrain.file),
        "frames": 1,
        "start_m": (*start_m, 0.0),
        "goal_m": (*goal_m, 0.0),
        "terrain": terrain,
        **({"robot": robot} if isinstance(robot, str) else {}),
    }

    def described(**more: Any) -> CourseSpec:
        made = validated(CourseSpec, {**keys, **more}, _called(terrain.file))
        return made.of_robot(robot) if isinstance(robot, Robot) else made

    check_time(doing="before the course was laid out")
    spec = described()
    body = spec.make_robot(folder)
    terrain = terrain.for_robot(body)
    spec = spec.standing(body)
    if not body.own:
        usual = spec.stance
        lower = {key: body.size * getattr(usual, key) for key in ("outward_m", "down_m")}
        spec = spec.model_copy(update={"stance": usual.model_copy(update=lower)})
    reach = float(np.mean([limb.reach_m for limb in body.limbs]))
    terrain_along = terrain.along(np.array(keys["goal_m"])[None], folder)
    ends = np.array([start_m, goal_m], dtype=np.float64)
    mirrored = _mirrored(terrain_along, body, ends)
    spec = alternative.of(spec, body, mirrored=mirrored)
    toes = np.array([limb.shoulder_m + toe_offset(limb, spec.stance) for limb in body.limbs])
    _check_standing(standing, body, terrain.friction)
    if straight:
        way = np.column_stack([ends, [_body_height(terrain_along, toes, end) for end in ends]])
    else:
        shape = Footprint.of(body, toes)
        found = guide_path(
            terrain_along,
            shape,
            ends,
            avoid_m,
            standing,
            mirrored=mirrored,
            striding=alternative.striding,
        )
        way = found.points_m
    turns = len(body.limbs)
    if alternative.gait is None:
        gait = "tripod" if turns >= 6 and turns % 2 == 0 else "wave"
        sets = [list(each) for each in gait_sets(gait, body, mirrored=True)]
        spec = spec.model_copy(update={"gait": sets if mirrored else gait})
        turns = 2 if gait == "tripod" else turns
    if len(body.limbs) < 4:  # in every other frame the body moves alone
        turns *= 2
    stride = _STRIDE * reach / turns
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    least = 2 if length > 0.0 else 1  # who stands still takes no step
    wanted = max(least, int(np.ceil(length / stride)) + 1) if frames is None else frames
    if wanted > MOST_FRAMES:
        raise InvalidInput(
            f"goal: expected a way of at most {stride * (MOST_FRAMES - 1):.3g} m ({MOST_FRAMES} "
            f"frames), got {length:.3g} m; plan it in parts"
        )
    last = max(1.0, length / max(wanted - 1, 1) / stride)  # of fewer frames, longer steps
    last *= alternative.free
    update: dict[str, Any] = {
        "frames": wanted,
        "gait": spec.gait,
        "start_m": tuple(way[0].tolist()),
        "goal_m": tuple(way[-1].tolist()),
        "via_m": [tuple(point) for point in way[1:-1].tolist()],
        "candidates": {
            "count": _CANDIDATES + alternative.candidates,
            "window_m": max(_WINDOWS[alternative.striding] * reach, 0.01),
            "margin_m": terrain.footholds.inset_m,
        },
        "steps": {"com_m": 1.5 * stride * last, "toe_m": 2.0 * _STRIDE * reach * last},
    }
    rooms = {"first_radius_m": BodySpec().first_radius_m * body.size}
    if not body.own:  # of others the height says it, too
        rooms["com_radius_m"] = BodySpec().com_radius_m * body.size * alternative.free
    elif alternative.free != 1.0:
        rooms["com_radius_m"] = alternative.free * spec.body.com_radius_m
    update["body"] = BodySpec(**rooms)
    if len(body.limbs) < 4:
        _let_sway(update, spec, rooms, body, toes)
    update["weights"] = {"tilt": Weights().tilt * body.size**2}
    if alternative.free != 1.0:
        update["weights"]["stance"] = AS_IT_STANDS
    if not alternative.near_toes:
        update["weights"]["stance"] = 0.0
    if alternative.level:
        update["body"] = described(**{k: v for k, v in update.items() if k == "body"}).level()
    return described(stance=spec.stance, **update)


def _mirrored(terrain: Terrain, robot: Robot, ends_m: Array) -> bool:
    """Tell whether a question is the mirror image of the one that is laid out: there is more ground
    to the right of its way than to the left, or as much and higher, or its robot faces to the right
    of it.

    Arguments:
        ends_m: start and goal, shape (2, 2) [m].
    """
    way = ends_m[1] - ends_m[0]
    ahead = way / np.linalg.norm(way) if way.any() else np.array([1.0, 0.0])
    left = np.array([-ahead[1], ahead[0]])
    fans = [patch.vertices_m for patch in terrain.patches]
    parts = np.concatenate(
        [
            np.stack([fan[:1].repeat(len(fan) - 2, axis=0), fan[1:-1], fan[2:]], axis=1)
            for fan in fans
        ]
    )
    area = np.linalg.norm(np.cross(parts[:, 1] - parts[:, 0], parts[:, 2] - parts[:, 0]), axis=1)
    aside, up = (parts[..., :2] - ends_m[0]) @ left, parts[..., 2] - parts[..., 2].min()
    higher = np.vecdot(aside, up) + aside.sum(axis=1) * up.sum(axis=1)
    away = np.vecdot(np.abs(aside), up) + np.abs(aside).sum(axis=1) * up.sum(axis=1)
    shoulders = np.array([limb.shoulder_m[:2] for limb in robot.limbs])
    facing = (shoulders @ ahead) * (shoulders @ left)
    for odd, even in (
        (area * aside.sum(axis=1), area * np.abs(aside).sum(axis=1)),
        (area * higher, area * away),
        (facing, np.vecdot(shoulders, shoulders)),
    ):
        if abs(odd.sum()) > _LOPSIDED * even.sum():
            return bool(odd.sum() < 0.0)
    return False


def _check_standing(standing: StandingMap | None, robot: Robot, friction: float) -> None:
    """Refuse a map of another robot, and one of ground with less friction."""
    if standing is None:
        return
    if standing.identity != robot.identity:
        mine, theirs = (
            name or "the default hexapod" for name in (standing.identity, robot.identity)
        )
        raise InvalidInput(f"standing: expected a map of {theirs}, got one of {mine}")
    if friction > standing.friction:
        raise InvalidInput(
            f"standing: expected a map at a friction of {friction:g} or more, got "
            f"{standing.friction:g}: what cannot be stood on there may be here"
        )


def _let_sway(
    update: dict[str, Any], spec: CourseSpec, rooms: dict[str, float], robot: Robot, toes_m: Array
) -> None:
    """Let the body of two or three legs go from over one foot to over another: keys of a course are
    changed in place.

    Arguments:
        rooms: radii of the body's balls.
        toes_m: vectors from the body to its toes, shape (N, 3) [m].
    """
    aside = float(np.linalg.norm(toes_m[:, :2], axis=1).max())
    between = np.linalg.norm(toes_m[:, None, :2] - toes_m[:, :2], axis=2)
    nearest = float(between[between > 0.0].min(initial=np.inf))
    if not robot.relative_reach:  # which keeps soles apart wherever they are
        window = min(update["candidates"]["window_m"], max(_APART * nearest, 0.02 * robot.size))
        update["candidates"]["window_m"] = window
    room = max(spec.body.com_radius_m, _SWAY * aside)
    more = {"com_radius_m": room, "last_radius_m": min(room, near_of(robot))}
    update["body"] = spec.body.model_copy(update=rooms | more)
    update["steps"]["com_m"] = max(update["steps"]["com_m"], 2.0 * _SWAY * aside)


def _body_height(terrain: Terrain, toes_m: Array, place_m: Array) -> float:
    """Height of a body over a place, shape (2,), its toes in the mean on what ground is below them
    [m].

    Arguments:
        toes_m: vectors from the body to its toes, shape (N, 3) [m].

    Raises:
        InvalidInput: where there is no ground below any.
    """
    grounds = [Surface(patch, 0.0) for _, patch in terrain.standing if patch.normal[2] >= STEEP]
    heights = []
    for toe in toes_m:
        under = [ground.under(place_m + toe[:2]) for ground in grounds]
        known = [height for height in under if height is not None]
        if known:
            heights.append(max(known) - toe[2])
    if not heights:
        raise InvalidInput(
            f"goal: expected ground under some toe, got ({place_m[0]:.3g}, {place_m[1]:.3g}) with "
            "none"
        )
    return float(np.mean(heights))


def laid_between(
    terrain: Footholds | str | Path,
    start_m: Array | Sequence[float],
    goal_m: Array | Sequence[float],
    *,
    robot: Robot | str | Path | None = None,
    frames: int | None = None,
    standing: StandingMap | None = None,
) -> LaidBetween:
    """Generator that lays out the course over a terrain from one place (x, y) [m] to another, see
    ``course_between``.

    Arguments:
        terrain: its footholds; or its file or name, whose footholds are those for the robot's feet.
    """
    from ..robot.robot_file import robot_of  # reads files

    who = None if robot is None else robot_of(robot)
    found = terrain if isinstance(terrain, Footholds) else footholds_for(who, terrain)
    start, goal = (
        read_only(place, (2,), name).tolist()
        for name, place in (("start", start_m), ("goal", goal_m))
    )
    count = None if frames is None else checked_int(frames, "frames", least=1, most=MOST_FRAMES)
    return LaidBetween(
        terrain=FileTerrain.of(found),
        start_m=tuple(start),
        goal_m=tuple(goal),
        robot=who,
        frames=count,
        standing=standing,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class LaidBetween:
    """Generator of the course over a terrain from one place (x, y) [m] to another, and on from
    where a plan failed.

    Arguments:
        seen_from: the frame in which all of it is; None for the world.
    """

    terrain: FileTerrain
    start_m: tuple[float, ...]
    goal_m: tuple[float, ...]
    robot: Robot | None
    frames: int | None
    standing: StandingMap | None = None
    straight: bool = False
    seen_from: Frame | None = None

    def __call__(self, sets: Sets, alternative: Alternative = AS_ASKED) -> Problem:
        """The course over the inner or outer sets of the robot's legs.

        Raises InvalidInput and PlanningFailed.
        """
        if sets == "inner" and alternative is AS_ASKED:
            return self._as_asked
        return self._laid(self.start_m, self.frames, sets, alternative, ())

    def passage(self) -> Passage:
        """The question itself, in whatever way a course is laid out for it.

        Raises InvalidInput.
        """
        robot = self.robot or hexapod()
        terrain = self.terrain.along(np.array([self.goal_m]), Path())
        return Passage(
            name=_called(self.terrain.file),
            robot=robot,
            terrain=terrain.patches,
            doubts=terrain.doubts,
            footholds=tuple(patch for _, patch in terrain.standing),
            start_m=np.array(self.start_m),
            goal_m=np.array(self.goal_m),
            near_m=near_of(robot),
            frame=self.seen_from,
        )

    @cached_property
    def frame(self) -> Frame | None:
        """Frame in which the course is planned, about a round place near the start, x towards the
        goal; None for the world's own, where the goal is ahead or feet are soles.
        """
        way, robot = np.subtract(self.goal_m, self.start_m), self.robot or hexapod()
        soles = any(limb.sole_m is not None for limb in robot.limbs)
        heading = float(np.arctan2(way[1], way[0]))
        if heading == 0.0 or soles or robot.feet:
            return None
        place = np.array([*self.start_m, 0.0])
        return Frame(origin_m=local_origin(place), heading_rad=heading)

    @cached_property
    def local(self) -> LaidBetween:
        """The same question in that frame."""
        if self.frame is None:
            return self
        robot, back = self.robot or hexapod(), self.frame.inverse
        terrain = self.terrain.for_robot(robot)
        moved = FileTerrain.of((terrain.given or terrain.read(Path())).moved(back))
        same = {"friction": terrain.friction, "footholds": terrain.footholds}
        ends = (back.places(np.array([*end, 0.0])) for end in (self.start_m, self.goal_m))
        start, goal = (tuple(end[:2].tolist()) for end in ends)
        turned, standing = robot.turned(back), self.standing
        if standing is not None and standing.identity == robot.identity:
            standing = replace(standing, identity=turned.identity, frame=self.frame)
        return replace(
            self,
            robot=turned,
            standing=standing,
            terrain=moved.model_copy(update=same),
            start_m=start,
            goal_m=goal,
            seen_from=self.frame,
        )

    def turned(self, wrench: Array | None) -> Array | None:
        """A wrench in that frame, shape (6,)."""
        if wrench is None or self.frame is None:
            return wrench
        return self.frame.inverse.vectors(wrench.reshape(2, 3)).ravel()

    @cached_property
    def _as_asked(self) -> Problem:
        return self._laid(self.start_m, self.frames, "inner", AS_ASKED, ())

    def onward(
        self, com_m: Array, avoid_m: Sequence[Array], alternative: Alternative = AS_ASKED
    ) -> Problem:
        """The course from a place of the centre of mass, shape (3,) [m], to the goal by another way
        than these places.

        Raises InvalidInput and PlanningFailed.
        """
        return self._laid(tuple(com_m[:2].tolist()), None, "inner", alternative, avoid_m)

    def _laid(
        self,
        start_m: Sequence[float],
        frames: int | None,
        sets: Sets,
        alternative: Alternative,
        avoid_m: Sequence[Array],
    ) -> Problem:
        spec = course_between(
            self.terrain,
            start_m,
            self.goal_m,
            robot=self.robot,
            frames=frames,
            alternative=alternative,
            avoid_m=avoid_m,
            standing=self.standing,
            straight=self.straight,
        )
        return build_course(spec, sets=sets)


def _called(file: str) -> str:
    """Name of a course over a terrain: as its file without the ending, or as its ground."""
    from ..terrain.reference import names_ground  # splines are slow to import

    return Path(file).name if names_ground(file) else Path(file).stem
