"""Distributions of posture problems (Lin et al. §IV-A): what terrains look like to limbs about to
stand on them.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, cast, runtime_checkable

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import read_yaml, validated
from stancekit.planners.plugins import Registry, made_or_class, of_file, packed
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.problem.posture import MAX_TILT_RAD, THREE_LEGS
from stancekit.planners.problem.posture_batch import Sampler
from stancekit.planners.robot import Robot, hexapod
from stancekit.planners.robot.robot_file import BUILT_IN

from .stance import (
    FIVE_LEGS,
    FORWARD,
    LAW,
    UPWARD,
    Law,
    NominalStance,
    StandingRobot,
    leaning,
    paper_stance,
    plain_problem,
    plane_of,
    triangle,
)

if TYPE_CHECKING:
    from .cut import CutDistribution


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
    of = robot.identity or ("" if standing.paper else robot.name)
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
