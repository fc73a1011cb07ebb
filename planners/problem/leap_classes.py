"""Classes of leaps that are drawn at random: one numbers page per class, in
``configs/leaps.yaml``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ..errors import InvalidInput
from ..files.arrays import Array, checked_choice
from ..files.codec import LATER, fields_to_json, from_json, keys_of, to_json
from ..files.documents import YAML, read_yaml, shown, validated
from ..robot.model import LegLimits, Limb, Robot
from ..robot.walker import leaping_robot, no_motors
from ..terrain.families import SCENE, Terrain, family_terrain
from ..terrain.patch import Patch, flat_patches
from ..terrain.polygon import VOID_M
from .contact import CandidatePatches, Foothold
from .leap import FORMAT, BodyState, Leap, LeapLimits, Phase

_Range = tuple[float, float]
SPINS, _LOWEST = 0.5, 0.55
"""On another robot: largest momentum per mass over its height squared [1/s], and least height of
the body in units of that at which it stands."""
_DRAWS = 200
"""Scenes of a family are drawn so often until one has footholds for every toe."""
_MIDDLE_M = float(SCENE[:, 0].mean())
"""Leaps go over the middle of a family's scene [m]."""


class LeapClass(BaseModel):
    """The numbers of a class of leaps; pairs are the ends of what is drawn evenly.

    Arguments:
        robot: "nameless", or the name or file of a robot.
        height_m: height of the body over its toes at both ends.
        jump_m: distance of the goal ahead.
        aside_m, rise_m: distance of the goal to the side, and its height over the start.
        toes_m: nominal place of the first limb's toe (ahead, aside), mirrored for the others.
        spread_m: largest distance of candidates from it along each axis; drop_m is that up and
            down.
        radius_m: radius of the triangular patches.
        steep_deg: inclination of the patches.
        terrain: a family of terrain in place of such patches, at a level in ``level``: candidates
            are pieces of its surfaces, ``window_m`` wide, the nearest to the toe's place first, and
            the ground says how high the goal is.
        candidates: number of candidates per toe.
        given: True if the toes of the first stance stand already, on level ground of friction
            stands.
        intervals, timings_s: numbers of intervals and durations of stance, flight, stance.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    robot: str = "nameless"
    height_m: float = 0.24
    jump_m: _Range = (1.0, 1.3)
    aside_m: _Range = (-0.15, 0.15)
    rise_m: _Range = (-0.15, 0.25)
    toes_m: _Range = (0.15, 0.156)
    spread_m: float = 0.13
    drop_m: float = 0.07
    radius_m: _Range = (0.03, 0.06)
    steep_deg: float = 40.0
    friction: _Range = (0.05, 0.7)
    candidates: Annotated[int, Field(ge=1, le=64)] = 8
    given: bool = False
    stands: float = 0.8
    intervals: tuple[int, int, int] = (4, 1, 4)
    timings_s: tuple[tuple[float, float, float], ...] = ((0.32, 0.32, 0.32),)
    goal_radius_m: float = 0.06
    limits: dict[str, float] = {}
    terrain: str = ""
    level: _Range = (0.2, 0.8)
    window_m: float = 0.12

    def on(self, robot: str) -> LeapClass:
        """The class on another robot, whose legs are known: as far and as high as it says, from
        where that robot's feet are when it stands.

        Arguments:
            robot: a name or a file.

        Raises:
            InvalidInput: for one without legs of its own, or whose file has no limits of their
                joints.
        """
        stands = _robot(robot)
        model = stands.own_model()
        if unlimited := no_motors(model):
            raise InvalidInput(f"robot {stands.name}: {unlimited}")
        feet = np.array([leg.chain.feet(leg.stance_rad[None])[0] for leg in model.legs])
        feet -= model.com_m
        height = float(np.mean([leg.radius_m for leg in model.legs]) - feet[:, 2].mean())
        ahead, aside = np.abs(feet[:, :2]).mean(axis=0).tolist()
        limits = self.limits | {
            "momentum_m2_s": SPINS * height**2,
            "height_m": _LOWEST * height,
        }
        return self.model_copy(
            update={"robot": robot, "height_m": height, "toes_m": (ahead, aside), "limits": limits}
        )

    def draw(self, rng: np.random.Generator, name: str = "leap") -> Leap:
        """Draw a leap of the class."""
        if self.terrain:
            return self._on_terrain(rng, name)
        robot = _robot(self.robot)
        start = np.array([0.0, 0.0, self.height_m])
        ahead, aside, rise = (
            rng.uniform(*ends) for ends in (self.jump_m, self.aside_m, self.rise_m)
        )
        goal = start + np.array([ahead, aside, rise])
        footholds = []
        for phase, com in ((0, start), (2, goal)):
            for limb in robot.limbs:
                nominal = com + self._toe(limb, -self.height_m)
                if phase == 0 and self.given:
                    footholds.append(_standing(limb.name, nominal, self.stands))
                    continue
                patches = tuple(self._patches(nominal, rng))
                footholds.append(Foothold(limb=limb.name, frame=phase, candidates=patches))
        return self._leap(name, robot, footholds, start, goal)

    def _toe(self, limb: Limb, down_m: float) -> Array:
        """The nominal place of a limb's toe from the body, shape (3,) [m]."""
        return np.array([*(np.sign(limb.shoulder_m[:2]) * np.array(self.toes_m)), down_m])

    def _on_terrain(self, rng: np.random.Generator, name: str) -> Leap:
        """Draw a leap over a scene of the family, in which every toe has somewhere to stand."""
        robot = _robot(self.robot)
        for _ in range(_DRAWS):
            level, seed = float(rng.uniform(*self.level)), int(rng.integers(2**31))
            scene = family_terrain(self.terrain, level, seed)
            half = 0.5 * np.array([rng.uniform(*self.jump_m), rng.uniform(*self.aside_m)])
            middle = np.array([_MIDDLE_M + rng.uniform(-0.1, 0.1), 0.0])
            first, last = (self._place(scene, robot, middle + side * half) for side in (-1.0, 1.0))
            if first is not None and last is not None:
                footholds = [
                    Foothold(limb=limb.name, frame=phase, candidates=pieces)
                    for phase, (_, candidates) in ((0, first), (2, last))
                    for limb, pieces in zip(robot.limbs, candidates, strict=True)
                ]
                return self._leap(name, robot, footholds, first[0], last[0])
        raise InvalidInput(
            f"{name}: expected scenes of {self.terrain} with footholds for every toe, drew {_DRAWS} "
            "without"
        )

    def _place(
        self, scene: Terrain, robot: Robot, xy_m: Array
    ) -> tuple[Array, list[tuple[Patch, ...]]] | None:
        """Place of the body over a point, and the candidates of every toe; None where a toe has
        none.
        """
        toes = [xy_m + self._toe(limb, 0.0)[:2] for limb in robot.limbs]
        ground = [float(scene.grid(toe[:1], toe[1:])[0, 0]) for toe in toes]
        ground = [height for height in ground if height != VOID_M]
        if not ground:
            return None
        com = np.array([*xy_m, float(np.mean(ground)) + self.height_m])
        surfaces = CandidatePatches(scene, 0.0)
        candidates = []
        for limb in robot.limbs:
            toe = com + self._toe(limb, -self.height_m)
            pieces = surfaces.candidates(
                limb, com + limb.shoulder_m, toe, self.candidates, self.window_m
            )
            if not pieces:
                return None
            candidates.append(tuple(piece for _, piece in pieces))
        return com, candidates

    def _leap(
        self, name: str, robot: Robot, footholds: list[Foothold], start: Array, goal: Array
    ) -> Leap:
        """The leap from one place to another."""
        stance = [Phase(limbs=robot.limb_names, intervals=self.intervals[k]) for k in (0, 2)]
        flight = Phase(limbs=(), intervals=self.intervals[1])
        return Leap(
            name=name,
            robot=robot,
            phases=(stance[0], flight, stance[1]),
            timings_s=self.timings_s,
            footholds=tuple(footholds),
            start=BodyState(com_m=start),
            goal=BodyState(com_m=goal),
            goal_radius_m=self.goal_radius_m,
            limits=LeapLimits(**self.limits),
        )

    def _patches(self, nominal: Array, rng: np.random.Generator) -> list[Patch]:
        """Draw triangles near a nominal place."""
        spread, turn = (self.spread_m, self.spread_m, self.drop_m), (0.0, 2.0 * np.pi)
        ends = [*((-most, most) for most in spread), (0.0, self.steep_deg), turn, turn]
        low, high = np.array([*ends, self.radius_m, self.friction]).T
        drawn = rng.uniform(low, high, (self.candidates, 8))
        steep, (azimuth, first, radius, friction) = np.deg2rad(drawn[:, 3]), drawn.T[4:]
        along = np.sin(steep) * np.array([np.cos(azimuth), np.sin(azimuth)])
        normal = np.vstack([along, np.cos(steep)]).T
        across = np.cross(normal, [0.0, 1.0, 0.0])
        across /= np.sqrt(np.vecdot(across, across))[:, None]
        beside = np.cross(normal, across)
        angles = (first[:, None] + np.arange(3) * 2.0 * np.pi / 3.0)[..., None]
        border = np.cos(angles) * across[:, None] + np.sin(angles) * beside[:, None]
        places = (nominal + drawn[:, :3])[:, None] + radius[:, None, None] * border
        return flat_patches(places, normal, across, friction.tolist())


def leap_class(name: str) -> LeapClass:
    """The class of a name in ``configs/leaps.yaml``, or the one that a YAML file describes, whose
    name ends so.

    Raises InvalidInput for another name, and for a file that describes none.
    """
    if Path(name).suffix in YAML:
        return validated(LeapClass, read_yaml(name) or {}, name)
    classes = _classes()
    return classes[checked_choice(name, "distribution", classes)]


def leap_classes() -> tuple[str, ...]:
    """The names of all classes."""
    return tuple(_classes())


@lru_cache(maxsize=1)
def _classes() -> dict[str, LeapClass]:
    from stancekit.configs import config_path

    path = config_path("leaps.yaml")
    data = read_yaml(path)
    return {
        name: validated(LeapClass, keys or {}, f"{path}: {name}") for name, keys in data.items()
    }


@lru_cache(maxsize=8)
def _robot(name: str) -> Robot:
    return nameless() if name == "nameless" else leaping_robot(name)


def nameless() -> Robot:
    """The four-legged robot of the first leaps: 10 kg, hips at ±.15 and ±.12 m, legs of .34 m."""
    limbs = []
    for name, x, y in (
        ("LF", 0.15, 0.12),
        ("RF", 0.15, -0.12),
        ("LH", -0.15, 0.12),
        ("RH", -0.15, -0.12),
    ):
        hip = np.array([x, y, 0.0])
        leg = LegLimits(hip_m=hip, speed_m_s=3.0, power_w=200.0, fold_m=0.1)
        limbs.append(Limb(name=name, shoulder_m=hip, reach_m=0.34, leg=leg))
    inertia = 10.0 * np.diag([0.008, 0.029, 0.027])
    return Robot(name="nameless", mass_kg=10.0, limbs=tuple(limbs), inertia_kgm2=inertia)


def _standing(limb: str, toe_m: Array, friction: float) -> Foothold:
    """A toe that stands on level ground already."""
    if friction < 0.0:
        raise InvalidInput(f"stands: expected a friction of 0 or more, got {friction:g}")
    corners = np.array(
        [[0.05, 0.05, 0.0], [-0.05, 0.05, 0.0], [-0.05, -0.05, 0.0], [0.05, -0.05, 0.0]]
    )
    patch = Patch(
        vertices_m=toe_m + corners,
        normal=np.array([0.0, 0.0, 1.0]),
        shear_reference=np.array([1.0, 0.0, 0.0]),
        friction=friction,
    )
    return Foothold(limb=limb, frame=0, candidates=(patch,), toe_m=toe_m)


@dataclass(frozen=True, kw_only=True)
class _DrawKeys:
    """The keys of a leap that is drawn: distribution, a class of ``configs/leaps.yaml``, and a
    seed.
    """

    distribution: str
    seed: Annotated[int, Field(ge=0)] = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class _FootholdKeys:
    """The keys of a toe that is put down in a phase."""

    limb: str
    phase: int
    candidates: tuple[Patch, ...]
    toe_m: Array | None = field(default=None, metadata=LATER)


@dataclass(frozen=True, kw_only=True, eq=False)
class _LeapKeys:
    """The keys of a leap; see ``Leap``.

    Arguments:
        robot: a name, a file, or its numbers.
    """

    FORMAT: ClassVar = FORMAT

    name: str = "leap"
    robot: str | Robot
    phases: tuple[Phase, ...]
    timings_s: tuple[tuple[float, ...], ...]
    duration_s: float | None = None
    footholds: tuple[_FootholdKeys, ...]
    start: BodyState
    goal: BodyState
    goal_radius_m: float = 0.06
    limits: LeapLimits = field(default_factory=LeapLimits)


def leap_from_keys(data: Mapping[str, Any], where: str) -> Leap:
    """Read the keys of a leap; robot may be a name or a file, too.

    Arguments:
        where: the file, which messages begin with.

    Raises:
        InvalidInput: in one line.
    """
    if "distribution" in data:
        draw = from_json(_DrawKeys, data, whole=False, where=where)
        try:
            kind = leap_class(draw.distribution)
        except InvalidInput as error:
            raise InvalidInput(f"{where}: {error}") from None
        return kind.draw(np.random.default_rng(draw.seed), f"{draw.distribution}-{draw.seed}")
    if not isinstance(data.get("robot", ""), str | Mapping):
        raise InvalidInput(
            f"{where}: robot: expected a name, a file, or a robot's keys, got "
            f"{shown(data['robot'])}"
        )
    if isinstance(data.get("robot"), Mapping):  # or a message names what the union is of
        validated(keys_of(Robot, whole=False), data["robot"], where, key="robot.")
    try:
        keys = from_json(_LeapKeys, {"format": FORMAT, **data}, whole=False)
        robot = _named(keys.robot) if isinstance(keys.robot, str) else keys.robot
        footholds = tuple(
            _foothold(one, f"footholds[{j}]: ") for j, one in enumerate(keys.footholds)
        )
        return Leap(**{**vars(keys), "robot": robot, "footholds": footholds})
    except InvalidInput as error:
        if isinstance(data.get("robot"), Mapping):  # again: what a robot's parts say to each other
            from_json(Robot, data["robot"], whole=False, where=where)
        raise InvalidInput(f"{where}: {error}") from None


def leap_to_json(leap: Leap) -> dict[str, Any]:
    """A leap as JSON-ready values, which ``leap_from_keys`` reads back."""
    robot = {
        "name": leap.robot.name,
        "mass_kg": leap.robot.mass_kg,
        "inertia_kgm2": to_json(leap.robot.inertia),
        "identity": leap.robot.identity,
        "limbs": to_json(leap.robot.limbs),
    }
    if leap.robot.own:
        robot |= leap.robot.legs_to_json()
    footholds = tuple(
        _FootholdKeys(limb=one.limb, phase=one.frame, candidates=one.candidates, toe_m=one.toe_m)
        for one in leap.footholds
    )
    same = {f.name: getattr(leap, f.name) for f in fields(_LeapKeys)}
    return fields_to_json(_LeapKeys(**{**same, "footholds": footholds})) | {"robot": robot}


def _named(name: str) -> Robot:
    return (
        nameless()
        if name == "nameless"
        else leaping_robot(Path(name) if Path(name).suffix else name)
    )


def _foothold(keys: _FootholdKeys, where: str) -> Foothold:
    try:
        return Foothold(
            limb=keys.limb, frame=keys.phase, candidates=keys.candidates, toe_m=keys.toe_m
        )
    except InvalidInput as error:
        raise InvalidInput(f"{where}{error}") from None
