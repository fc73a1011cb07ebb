"""Distributions of posture problems (Lin et al. §IV-A): what terrains look like to limbs about to
stand on them, drawn about the stance of any robot.
"""

from __future__ import annotations

import hashlib
import json
import pickle
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, cast, runtime_checkable

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, cross
from stancekit.planners.files.codec import to_json
from stancekit.planners.files.documents import read_yaml, validated
from stancekit.planners.plugins import Registry, made_or_class, of_file, packed
from stancekit.planners.problem import Contact, PostureBatch, Problem
from stancekit.planners.problem.posture import MAX_TILT_RAD, THREE_LEGS, TILT_LIMIT_RAD
from stancekit.planners.problem.posture_batch import Sampler
from stancekit.planners.robot import Limb, Robot, hexapod
from stancekit.planners.robot.model import BUILT_IN
from stancekit.planners.terrain import Patch

if TYPE_CHECKING:
    from stancekit.planners.robot.hulls import Polytope

    from .cut import CutDistribution


Law = Literal["ground", "wall", "terrain"]
LAW = re.compile(r"(ground|wall|terrain)-([1-9]\d?)")
"""Names of classes: a law, and how many legs stand."""
FIVE_LEGS = ("RF", "RM", "RR", "LF", "LR")
PAPER_LEGS = MappingProxyType({3: THREE_LEGS, 5: FIVE_LEGS})
_PAPER_REACH_M = 0.35
_PAPER_LENGTH_M = 0.6
"""Length scale of Lin et al.'s robot."""
_GROUND_ROOM_M, _WALL_ROOM_M = (0.20, 0.20, 0.10), (0.15, 0.06, 0.15)
"""Distance that a patch may have from its nominal place, along x, y and z, to either side."""
_CIRCUMRADIUS_M = (0.03, 0.08)
_COM_RADIUS_M = 0.08
_BEYOND = 1.1
"""The length scale of a robot from a file, in units of how far a toe may be from its centre of
mass."""
_POINTS = 4000
"""Number of points of a leg's set, by which the walls are placed."""
_SIDEWAYS = 0.8
"""Share of a leg's set that is nearer than the wall is."""


@dataclass(frozen=True, eq=False)
class NominalStance:
    """Stance about which a law draws: nominal centres of the patches and their normals, from the
    centre of mass, shape (N, 3) each [m].

    With legs of half-spaces the body is level: a tilt would leave many scenes undecided, feasible
    by what bounds take for their reach and not by what plans take (``planners.robot.model``); where
    it is 0 both are the sets themselves.

    Arguments:
        room_m: how far off a centre may be, outwards positive, (N, 3) [m]; sizes [m]; and the
            body's tilt [rad].
    """

    centre_m: Array
    normal: Array
    room_m: Array
    circumradius_m: tuple[float, float] = _CIRCUMRADIUS_M
    com_radius_m: float = _COM_RADIUS_M
    length_scale_m: float = _PAPER_LENGTH_M
    tilt_limit_rad: float = TILT_LIMIT_RAD


def paper_stance(limbs: Sequence[Limb], law: Law) -> NominalStance:
    """Lin et al.'s: patches beside and below the shoulders, or on walls at .40 m to each side."""
    centre, normal, room = zip(
        *((_wall if law == "wall" else _ground)(limb) for limb in limbs), strict=True
    )
    return NominalStance(np.array(centre), np.array(normal), np.array(room))


def _ground(limb: Limb) -> tuple[Array, Array, Array]:
    """Centre and normal of a patch on the ground beside and below the shoulder, and how far off it
    may be [m].
    """
    outward = limb.shoulder_m / np.linalg.norm(limb.shoulder_m)
    centre = limb.shoulder_m + 0.15 * outward + np.array([0.0, 0.0, -0.20])
    return centre, np.array([0.0, 0.0, 1.0]), np.array(_GROUND_ROOM_M)


def _wall(limb: Limb) -> tuple[Array, Array, Array]:
    """Centre and normal of a patch on the wall at the limb's side, and how far off it may be [m],
    outwards positive.
    """
    side = 1.0 if limb.shoulder_m[1] >= 0.0 else -1.0
    centre = np.array([limb.shoulder_m[0], side * 0.40, limb.shoulder_m[2]])
    return centre, np.array([0.0, -side, 0.0]), np.array([1.0, side, 1.0]) * _WALL_ROOM_M


@dataclass(frozen=True, kw_only=True, eq=False)
class StandingRobot:
    """A robot that scenes are drawn for, and where its toes are as it stands.

    Arguments:
        robot: the robot over the inner sets of its legs, as the contact planner has it.
        toes_m: vectors from its centre of mass to the toes, shape (N, 3) [m].
        reach_m: mean distance that a foot can have from its first joint [m].
        paper: the default hexapod, about which Lin et al.'s law draws.
        of_file: its limbs reach the inner sets of its file's legs; others count as another robot.
    """

    robot: Robot
    toes_m: Array
    reach_m: float
    paper: bool = False
    of_file: bool = False

    @classmethod
    def of(cls, robot: Robot | str | None) -> StandingRobot:
        """The robot of a built-in name, a ``.urdf`` or a ``.yaml`` file, or as it is; the default
        hexapod where None.

        Raises InvalidInput for anything else, and for a leg without a workspace that has an inside.
        """
        if robot is None or robot in BUILT_IN:
            robot = hexapod()
        if isinstance(robot, Robot):
            robot.check_limbs()
        if isinstance(robot, Robot) and not robot.own:
            return cls(
                robot=robot,
                toes_m=paper_stance(robot.limbs, "ground").centre_m,
                reach_m=float(np.mean([limb.reach_m for limb in robot.limbs])),
                paper=_is_default(robot),
            )
        from stancekit.planners.robot.reach_sets import (
            standing_toes,  # slow to import
            workspaces_of,
        )
        from stancekit.planners.robot.robot_file import named_robot  # loads all that reads robots
        from stancekit.planners.robot.walker import contact_robot, sets_of  # slow to import

        model = named_robot(robot) if isinstance(robot, str) else robot.own_model()
        try:
            workspaces = workspaces_of(model)
        except InvalidInput as error:
            raise InvalidInput(
                f"{robot if isinstance(robot, str) else robot.name}: {error}"
            ) from None
        reach = float(np.mean([workspace.reach_m for workspace in workspaces]))
        made = robot if isinstance(robot, Robot) else contact_robot(model, workspaces)
        return cls(
            robot=made,
            toes_m=standing_toes(model),
            reach_m=reach,
            of_file=made is not robot or sets_of(made) == "inner",
        )

    def legs(self, count: int, name: str) -> tuple[str, ...]:
        """Choose this many legs: those whose toes hold its centre of mass best, by the largest
        margin inside their hull.

        Raises InvalidInput for a robot with fewer.
        """
        names = self.robot.limb_names
        if count > len(names):
            legs = ", ".join(names)
            raise InvalidInput(
                f"{name}: expected a robot of {count} legs or more, got {self.robot.name} with "
                f"{legs}"
            )
        if self.paper and count in PAPER_LEGS:
            return PAPER_LEGS[count]
        chosen = max(
            combinations(range(len(names)), count),
            key=lambda some: round(_held(self.toes_m[list(some)]), 6),
        )
        return tuple(names[index] for index in chosen)

    def stance(self, law: Law, legs: Sequence[str]) -> NominalStance:
        """Stance about which scenes on these legs are drawn.

        Raises InvalidInput for a leg that is not there.
        """
        limbs = self.robot.select(legs)
        if self.paper:
            return paper_stance(limbs, law)
        toes = self.toes_m[[self.robot.limb_names.index(leg) for leg in legs]]
        size = self.reach_m / _PAPER_REACH_M
        side, upwards = (
            np.where(toes[:, 1] >= 0.0, 1.0, -1.0),
            np.tile([0.0, 0.0, 1.0], (len(toes), 1)),
        )
        radii = (size * _CIRCUMRADIUS_M[0], size * _CIRCUMRADIUS_M[1])
        reaches = [np.linalg.norm(_set_of(each).vertices, axis=1) for each in self.robot.limbs]
        farthest_m = float(np.concatenate(reaches).max())
        sizes = radii, size * _COM_RADIUS_M, _BEYOND * farthest_m, 0.0
        if law != "wall":
            room = np.tile(size * np.array(_GROUND_ROOM_M), (len(toes), 1))
            return NominalStance(toes, upwards, room, *sizes)
        out = np.column_stack([np.ones(len(toes)), side, np.ones(len(toes))])
        centres = _on_walls([_set_of(limb) for limb in limbs], side, size * _WALL_ROOM_M[1])
        return NominalStance(
            centres, out * [0.0, -1.0, 0.0], out * (size * np.array(_WALL_ROOM_M)), *sizes
        )


def _held(toes: Array) -> float:
    """Margin of the centre of mass inside the toes' hull, seen from above [m]; below 0 outside, or
    without a hull.
    """
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    try:
        return -float(ConvexHull(toes[:, :2]).equations[:, 2].max())
    except QhullError:  # fewer than three, or all in one line
        return -float(np.linalg.norm(toes[:, :2].mean(axis=0)))


def _set_of(limb: Limb) -> Polytope:
    from stancekit.planners.robot.hulls import Polytope  # slow to import

    if limb.reach_rows is None:
        raise InvalidInput(
            "robot: expected legs with half-spaces of reach, as a robot file has them, got "
            f"{limb.name} with none"
        )
    return Polytope(normals=limb.reach_rows.normals, offsets_m=limb.reach_rows.bounds_m)


def _on_walls(sets: Sequence[Polytope], side: Array, thickness_m: float) -> Array:
    """The middles of what legs reach of two walls, as far to either side, shape (N, 3) [m]."""
    points = [polytope.sample(_POINTS, np.random.default_rng(0)) for polytope in sets]
    out = [sign * some[:, 1] for sign, some in zip(side, points, strict=True)]
    away = float(np.mean([np.quantile(beside, _SIDEWAYS) for beside in out]))
    centres = []
    for sign, some, beside in zip(side, points, out, strict=True):
        off = np.abs(beside - away)
        near = some[off <= max(thickness_m, float(np.min(off)))]
        centres.append([near[:, 0].mean(), sign * away, near[:, 2].mean()])
    return np.array(centres)


def _is_default(robot: Robot) -> bool:
    """Tell whether a robot without a model is the default hexapod, about which the law of Lin et
    al. draws.
    """
    default = hexapod()
    return robot.limb_names == default.limb_names and all(
        one.reach_m == other.reach_m
        and one.reach_rows is None
        and one.sole_m is None
        and np.array_equal(one.shoulder_m, other.shoulder_m)
        for one, other in zip(robot.limbs, default.limbs, strict=True)
    )


_AXES = np.eye(3)
FORWARD, UPWARD = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
"""Shear references on the ground and on walls."""


def plain_problem(
    robot: Robot, legs: Sequence[str], stance: NominalStance, *, shear: Sequence[float]
) -> Problem:
    """A problem whose patches are all in their nominal places, have the smallest size that is ever
    drawn, and have no friction.
    """
    triangles = stance.centre_m[:, None] + triangle(
        stance.normal, np.full(len(legs), stance.circumradius_m[0]), np.zeros(len(legs))
    )
    contacts = tuple(
        Contact(
            leg=limb.name,
            shoulder_m=limb.shoulder_m,
            reach_m=limb.reach_m,
            patch=Patch(
                vertices_m=corners, normal=normal, shear_reference=np.array(shear), friction=0.0
            ),
            force_min=np.array([0.0, -1.0, -1.0]),
            force_max=np.ones(3),
            reach_rows=limb.reach_rows,
        )
        for limb, corners, normal in zip(robot.select(legs), triangles, stance.normal, strict=True)
    )
    return Problem.posture(
        contacts=contacts,
        mass_kg=robot.mass_kg,
        com_nominal_m=np.zeros(3),
        com_radius_m=stance.com_radius_m,
        length_scale_m=stance.length_scale_m,
        tilt_limit_rad=stance.tilt_limit_rad,
        robot=robot.identity,
    )


def leaning(
    axis: Array, angle_rad: Array, azimuth_rad: Array, plane: tuple[Array, Array] | None = None
) -> Array:
    """Unit vectors at these angles from axes of shape (..., 3), leaning towards these azimuths.

    Arguments:
        plane: ``plane_of`` the axes, where it is known.
    """
    first, second = plane or plane_of(axis)
    angle, azimuth = angle_rad[..., None], azimuth_rad[..., None]
    sideways = np.cos(azimuth) * first + np.sin(azimuth) * second
    return _unit(np.cos(angle) * axis + np.sin(angle) * sideways)


def triangle(normals: Array, radius_m: Array, turn_rad: Array) -> Array:
    """Equilateral triangles about the origin in the planes of these normals, shape (..., 3, 3)
    [m].
    """
    angles = (turn_rad[..., None] + 2.0 * np.pi / 3.0 * np.arange(3))[..., None]
    first, second = (axis[..., None, :] for axis in plane_of(normals))
    return np.asarray(
        radius_m[..., None, None] * (np.cos(angles) * first + np.sin(angles) * second)
    )


def plane_of(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with each normal, shape (..., 3)."""
    helper = _AXES[np.abs(normals).argmin(axis=-1)]
    first = _unit(cross(normals, helper))
    return first, cross(normals, first)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.sqrt(np.vecdot(vectors, vectors))[..., None])


@runtime_checkable
class Distribution(Protocol):
    """Anything that draws posture problems, G(θ)."""

    @property
    def name(self) -> str:
        """Name by which it is requested."""

    @property
    def terrain(self) -> str:
        """Name that the mode of a course has over such terrain."""

    @property
    def legs(self) -> tuple[str, ...]:
        """The limbs of every problem."""

    def sample(self, rng: np.random.Generator) -> Problem:
        """Draw one posture problem."""

    def batch(self, rng: np.random.Generator, count: int) -> PostureBatch:
        """Draw this many: those that as many calls of ``sample`` draw."""


@runtime_checkable
class Repeatable(Distribution, Protocol):
    """A distribution whose draws depend on the generator's state alone: they can be repeated and
    passed over.

    One with ``whole_words = True`` takes whole 64-bit words, so that a half that others left over
    changes nothing.
    """

    def skip(self, rng: np.random.Generator, count: int) -> None:
        """Leave the generator as ``batch`` of so many leaves it."""


@dataclass(frozen=True, kw_only=True)
class PostureDistribution:
    """G(θ) of Lin et al.: one random triangle a limb, on the ground or on two facing walls.

    Each normal leans by up to 30° from the nominal one in a random direction. ``sample`` draws one
    problem.

    Arguments:
        stance: nominal places of the patches; None for Lin et al.'s places about the robot's
            shoulders.
    """

    name: str
    terrain: Literal["ground", "wall"]
    legs: tuple[str, ...]
    friction: tuple[float, float]
    robot: Robot = field(default_factory=hexapod)
    stance: NominalStance | None = None
    whole_words: ClassVar[bool] = True  # every number is a uniform double

    def sample(self, rng: np.random.Generator) -> Problem:
        """Draw one posture problem."""
        return self.batch(rng, 1).problem(0)

    def batch(self, rng: np.random.Generator, count: int) -> PostureBatch:
        """Draw this many problems: bit for bit those that as many calls of ``sample`` draw."""
        stance, low, high = self._about
        values = low + (high - low) * self._shares(rng, count)
        offset, (lean, towards, radius, turn, friction) = (
            values[..., :3],
            np.moveaxis(values[..., 3:], -1, 0),
        )
        normals = leaning(stance.normal, lean, towards, self._upright)
        vertices = (stance.centre_m + offset)[:, :, None] + triangle(normals, radius, turn)
        convex = stance.circumradius_m[0] >= LEAST_M
        return PostureBatch(
            like=self._plain, vertices_m=vertices, normals=normals, friction=friction, convex=convex
        )

    def skip(self, rng: np.random.Generator, count: int) -> None:
        """Leave the generator as ``batch`` of so many leaves it."""
        self._shares(rng, count)

    def _shares(self, rng: np.random.Generator, count: int) -> Array:
        """Uniform numbers, of each problem and limb one a column of ``_about``."""
        return rng.random((count, *self._about[1].shape))

    @cached_property
    def _about(self) -> tuple[NominalStance, Array, Array]:
        """Stance about which scenes are drawn, and for each limb the bounds of the draw, shape (N,
        8).
        """
        stance = self.stance or paper_stance(self.robot.select(self.legs), self.terrain)
        turn = (0.0, 2.0 * np.pi)
        of_all = np.array([(0.0, MAX_TILT_RAD), turn, stance.circumradius_m, turn, self.friction])
        low, high = (np.tile(of_all[:, k], (len(self.legs), 1)) for k in (0, 1))
        return stance, np.hstack([-stance.room_m, low]), np.hstack([stance.room_m, high])

    @cached_property
    def _upright(self) -> tuple[Array, Array]:
        """The plane of every nominal patch."""
        return plane_of(self._about[0].normal)

    @cached_property
    def _plain(self) -> Problem:
        """The problem with every patch in its nominal place."""
        shear = FORWARD if self.terrain == "ground" else UPWARD
        return plain_problem(self.robot, self.legs, self._about[0], shear=shear)


LEAST_M = 1e-3
"""Triangles of this circumradius [m] and more are patches, however they are turned."""
GROUND_FRICTION, WALL_FRICTION = (0.1, 0.8), (0.1, 1.2)
GROUND_3 = PostureDistribution(
    name="ground-3", terrain="ground", legs=THREE_LEGS, friction=GROUND_FRICTION
)
WALL_3 = PostureDistribution(name="wall-3", terrain="wall", legs=THREE_LEGS, friction=WALL_FRICTION)
WALL_5 = PostureDistribution(name="wall-5", terrain="wall", legs=FIVE_LEGS, friction=WALL_FRICTION)
DISTRIBUTIONS: Mapping[str, PostureDistribution] = MappingProxyType(
    {d.name: d for d in (GROUND_3, WALL_3, WALL_5)}
)
"""Lin et al.'s three problem classes by name."""
REGISTRY: Registry[Any] = Registry(
    "distribution",
    "stancekit.distributions",
    {name: f"{__name__}:{name.upper().replace('-', '_')}" for name in DISTRIBUTIONS},
    expected="something with sample(rng), or a class of it that is made without arguments",
    accepts=lambda it: made_or_class(it, "sample"),
    further=("another ground-k, wall-k or terrain-k", "a YAML file"),
)
"""All distributions."""


class OwnDistribution:
    """A distribution from elsewhere: something with ``sample(rng)``, or its class, which is made
    without arguments.

    Arguments:
        name: name by which it was requested. Its ``terrain`` counts if it has one. It can be copied
            and pickled, to processes that have not run its file, too.
    """

    def __init__(self, thing: Any, name: str) -> None:
        self._thing, self.name = thing() if isinstance(thing, type) else thing, name
        self.terrain = str(getattr(self._thing, "terrain", name))
        self.legs = self.sample(np.random.default_rng(0)).legs

    def sample(self, rng: np.random.Generator) -> Problem:
        """Draw one posture problem.

        Raises InvalidInput where something else comes.
        """
        problem = self._thing.sample(rng)
        if not (isinstance(problem, Problem) and problem.is_posture):
            raise InvalidInput(
                f"distribution {self.name}: expected a Problem, got a {type(problem).__name__}"
            )
        return problem

    def batch(self, rng: np.random.Generator, count: int) -> PostureBatch:
        """Draw ``count`` problems.

        Raises InvalidInput if they differ in more than their patches.
        """
        try:
            return PostureBatch.stacked([self.sample(rng) for _ in range(count)])
        except InvalidInput as error:
            raise InvalidInput(f"distribution {self.name}: {error}") from None

    def __getstate__(self) -> dict[str, Any]:
        packs = of_file(self._thing)
        return {**self.__dict__, "_thing": packed(self._thing)} if packs else self.__dict__

    def __setstate__(self, state: dict[str, Any]) -> None:
        thing = state["_thing"]
        self.__dict__.update(
            state, _thing=pickle.loads(thing) if isinstance(thing, bytes) else thing
        )


class _Yaml(BaseModel):
    """A distribution's file.

    Arguments:
        terrain: ground, wall, or a terrain's file or name; files are paths from the folder.
    """

    model_config = ConfigDict(extra="forbid", strict=True)
    terrain: str
    legs: list[str] = Field(min_length=1)
    friction: tuple[float, float] = Field(strict=False)
    robot: str | None = None


def distribution(
    name: str, *, robot: Robot | str | Path | None = None, terrain: str | Path | None = None
) -> Distribution:
    """A distribution by name, from "FILE.py:NAME", or from a YAML file with terrain, legs, friction
    and robot.

    Names of classes are ``ground-k``, ``wall-k`` and ``terrain-k``, k legs of the robot; the last
    one's scenes are cut from a terrain's file.

    What is drawn is named after the class, the robot and the terrain, by name and digest.

    Arguments:
        robot: a built-in name, a ``.urdf`` or a ``.yaml`` file, or a ``Robot``; the default hexapod
            where None.
        terrain: a mesh or a grid, or a ground by its name.

    Raises:
        InvalidInput: that lists the names there are, and for a robot with fewer legs, a leg without
            an inside, a terrain without footholds.
    """
    if not isinstance(name, str):
        raise REGISTRY.unknown(name)
    if isinstance(robot, Robot):
        robot.check_limbs()
    own_robot = (
        robot
        if isinstance(robot, Robot)
        else None
        if robot is None or str(robot) in BUILT_IN
        else str(robot)
    )
    if name in DISTRIBUTIONS and own_robot is None and terrain is None:
        return DISTRIBUTIONS[name]
    if name.endswith((".yaml", ".yml")):
        return _from_yaml(name, own_robot, terrain)
    law = LAW.fullmatch(name)
    if law is None:
        for key, value in (("robot", own_robot), ("terrain", terrain)):
            if value is not None:
                came = value.name if isinstance(value, Robot) else value
                raise InvalidInput(
                    f"{key}: expected none for {name}, which draws for its own, got {came}"
                )
        return OwnDistribution(REGISTRY.get(name), name)
    standing = StandingRobot.of(own_robot)
    legs, kind = standing.legs(int(law[2]), name), cast(Law, law[1])
    return composed(
        name, kind, standing, legs, WALL_FRICTION if kind == "wall" else GROUND_FRICTION, terrain
    )


def distribution_of(
    problems: str | Sampler,
    *,
    robot: Robot | str | Path | None = None,
    terrain: str | Path | None = None,
) -> Distribution:
    """A distribution by name, as ``distribution`` has it, or anything with ``sample(rng)``.

    Without a ``name`` of its own the latter goes by its class's. Raises InvalidInput, also for a
    robot or a terrain beside something that draws for its own.
    """
    if isinstance(problems, str):
        return distribution(problems, robot=robot, terrain=terrain)
    if isinstance(problems, type) or not callable(getattr(problems, "sample", None)):
        raise REGISTRY.unknown(problems)
    name = str(getattr(problems, "name", type(problems).__name__))
    if robot is not None or terrain is not None:
        raise InvalidInput(f"robot, terrain: expected none beside {name}, which has its own")
    return problems if isinstance(problems, Distribution) else OwnDistribution(problems, name)


def composed(
    name: str,
    law: Law,
    standing: StandingRobot,
    legs: Sequence[str],
    friction: tuple[float, float],
    terrain: str | Path | None,
) -> PostureDistribution | CutDistribution:
    """A robot and a law of scenes.

    Raises InvalidInput where a law wants a terrain's file, or has none.
    """
    if (terrain is not None) != (law == "terrain"):
        wants = (
            "a terrain's file"
            if law == "terrain"
            else "terrain-k for scenes cut from a terrain's file"
        )
        raise InvalidInput(
            f"{name}: expected {wants}, got {'none' if terrain is None else terrain}"
        )
    robot = standing.robot
    of = "" if standing.paper else robot.identity or robot.name
    if of and not standing.of_file:
        limbs = json.dumps(to_json(robot.limbs)).encode()
        of = f"{of}-{hashlib.sha256(limbs).hexdigest()[:12]}"
    named = f"{name}-of-{of}" if of else name
    stance = standing.stance(law, legs)
    if law == "terrain":
        from .cut import cut  # slow to import

        assert terrain is not None
        return cut(terrain, named, robot, legs, stance, friction)
    return PostureDistribution(
        name=named, terrain=law, legs=tuple(legs), friction=friction, robot=robot, stance=stance
    )


def _names_ground(name: str) -> bool:
    from stancekit.planners.terrain.reference import names_ground  # slow to import

    return names_ground(name)


def _from_yaml(
    path: str, robot: Robot | str | None, terrain: str | Path | None
) -> PostureDistribution | CutDistribution:
    folder = Path(path).parent
    try:
        raw = validated(_Yaml, read_yaml(path))
        low, high = raw.friction
        if not 0.0 <= low <= high < float("inf"):
            raise InvalidInput(f"friction: expected 0 ≤ low ≤ high, got {low:g} and {high:g}")
        if robot is None and raw.robot is not None:
            robot = str(folder / raw.robot) if Path(raw.robot).suffix else raw.robot
        law: Law = raw.terrain if raw.terrain in ("ground", "wall") else "terrain"  # type: ignore[assignment]
        has_file = ".py" in raw.terrain  # reading a distribution runs nothing
        named = law == "terrain" and not has_file and _names_ground(raw.terrain)
        if has_file or (law == "terrain" and not named and not Path(raw.terrain).suffix):
            raise InvalidInput(
                f"terrain: expected ground, wall, or a terrain's file or name, got {raw.terrain!r}"
            )
        file = (
            terrain
            if terrain is not None or law != "terrain"
            else raw.terrain
            if named
            else folder / raw.terrain
        )
        standing = StandingRobot.of(robot)
        standing.robot.select(raw.legs)
        return composed(path, law, standing, raw.legs, raw.friction, file)
    except InvalidInput as error:
        raise InvalidInput(
            str(error) if str(error).startswith(path) else f"{path}: {error}"
        ) from None
