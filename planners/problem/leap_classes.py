"""Classes of leaps that are drawn at random: one numbers page per class, in ``configs/leaps.yaml``."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ..errors import InvalidInput
from ..files.arrays import Array, checked_choice
from ..files.documents import read_yaml
from ..files.validation import validated
from ..robot.leg_limits import leaping_robot
from ..robot.model import LegLimits, Limb, Robot
from ..terrain.patch import Patch
from .foothold import Foothold
from .leap import BodyState, Leap, LeapLimits, Phase

Range = tuple[float, float]


class LeapClass(BaseModel):
    """The numbers of a class of leaps; pairs are the ends of what is drawn evenly.

    robot: "nameless" or a robot's name. height_m: of the body over its toes at both ends. jump_m: ahead; aside_m,
    rise_m: of the goal. toes_m: nominal place of the first limb's toe (ahead, aside), mirrored for the others.
    spread_m: how far candidates lie from it, along each axis, and drop_m up and down. radius_m: of the triangular
    patches; steep_deg: their inclination. candidates: per toe; given: whether the toes of the first stance stand
    already, on level ground of friction stands. intervals, timings_s: of stance, flight, stance.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    robot: str = "nameless"
    height_m: float = 0.24
    jump_m: Range = (1.0, 1.3)
    aside_m: Range = (-0.15, 0.15)
    rise_m: Range = (-0.15, 0.25)
    toes_m: Range = (0.15, 0.156)
    spread_m: float = 0.13
    drop_m: float = 0.07
    radius_m: Range = (0.03, 0.06)
    steep_deg: float = 40.0
    friction: Range = (0.05, 0.7)
    candidates: Annotated[int, Field(ge=1, le=64)] = 8
    given: bool = False
    stands: float = 0.8
    intervals: tuple[int, int, int] = (4, 1, 4)
    timings_s: tuple[tuple[float, float, float], ...] = ((0.32, 0.32, 0.32),)
    goal_radius_m: float = 0.06
    limits: dict[str, float] = {}

    def draw(self, rng: np.random.Generator, name: str = "leap") -> Leap:
        """Draw a leap of the class."""
        robot = _robot(self.robot)
        limbs = robot.limb_names
        start = np.array([0.0, 0.0, self.height_m])
        ahead, aside, rise = (rng.uniform(*ends) for ends in (self.jump_m, self.aside_m, self.rise_m))
        goal = start + np.array([ahead, aside, rise])
        footholds = []
        for phase, com in ((0, start), (2, goal)):
            for limb in robot.limbs:
                signs = np.sign(limb.shoulder_m[:2])
                nominal = com + np.array([*(signs * np.array(self.toes_m)), -self.height_m])
                if phase == 0 and self.given:
                    footholds.append(_standing(limb.name, nominal, self.stands))
                    continue
                patches = [self._patch(nominal, rng) for _ in range(self.candidates)]
                footholds.append(Foothold(limb=limb.name, frame=phase, candidates=tuple(patches)))
        stance = [Phase(limbs=limbs, intervals=self.intervals[k]) for k in (0, 2)]
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

    def _patch(self, nominal: Array, rng: np.random.Generator) -> Patch:
        """Draw a triangle near a nominal place."""
        spread = np.array([self.spread_m, self.spread_m, self.drop_m])
        centre = nominal + rng.uniform(-spread, spread)
        steep, azimuth = np.deg2rad(rng.uniform(0.0, self.steep_deg)), rng.uniform(0.0, 2.0 * np.pi)
        normal = np.array([np.sin(steep) * np.cos(azimuth), np.sin(steep) * np.sin(azimuth), np.cos(steep)])
        across = np.cross(normal, [0.0, 1.0, 0.0])
        across /= np.linalg.norm(across)
        beside = np.cross(normal, across)
        angles = rng.uniform(0.0, 2.0 * np.pi) + np.arange(3) * 2.0 * np.pi / 3.0
        radius = rng.uniform(*self.radius_m)
        border = np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * beside
        return Patch(
            vertices_m=centre + radius * border,
            normal=normal,
            shear_reference=across,
            friction=float(rng.uniform(*self.friction)),
        )


def leap_class(name: str) -> LeapClass:
    """The class of a name in ``configs/leaps.yaml``. Raises InvalidInput for another one."""
    classes = _classes()
    return classes[checked_choice(name, "distribution", classes)]


def is_leap_class(name: str) -> bool:
    """Whether a name speaks of a class of leaps, be there one or not."""
    return name == "leap" or name.startswith("leap-")


def leap_classes() -> tuple[str, ...]:
    """The names of all classes."""
    return tuple(_classes())


@lru_cache(maxsize=1)
def _classes() -> dict[str, LeapClass]:
    from stancekit.configs import config_path

    path = config_path("leaps.yaml")
    data = read_yaml(path)
    return {name: validated(LeapClass, keys or {}, f"{path}: {name}") for name, keys in data.items()}


@lru_cache(maxsize=8)
def _robot(name: str) -> Robot:
    return nameless() if name == "nameless" else leaping_robot(name)


def nameless() -> Robot:
    """The four-legged robot of the first leaps: 10 kg, hips at ±.15 and ±.12 m, legs of .34 m."""
    limbs = []
    for name, x, y in (("LF", 0.15, 0.12), ("RF", 0.15, -0.12), ("LH", -0.15, 0.12), ("RH", -0.15, -0.12)):
        hip = np.array([x, y, 0.0])
        leg = LegLimits(hip_m=hip, speed_m_s=3.0, power_w=200.0, fold_m=0.1)
        limbs.append(Limb(name=name, shoulder_m=hip, reach_m=0.34, leg=leg))
    inertia = 10.0 * np.diag([0.008, 0.029, 0.027])
    return Robot(name="nameless", mass_kg=10.0, limbs=tuple(limbs), inertia_kgm2=inertia)


def _standing(limb: str, toe_m: Array, friction: float) -> Foothold:
    """A toe that stands on level ground already."""
    if friction < 0.0:
        raise InvalidInput(f"stands: expected a friction of 0 or more, got {friction:g}")
    corners = np.array([[0.05, 0.05, 0.0], [-0.05, 0.05, 0.0], [-0.05, -0.05, 0.0], [0.05, -0.05, 0.0]])
    patch = Patch(
        vertices_m=toe_m + corners,
        normal=np.array([0.0, 0.0, 1.0]),
        shear_reference=np.array([1.0, 0.0, 0.0]),
        friction=friction,
    )
    return Foothold(limb=limb, frame=0, candidates=(patch,), toe_m=toe_m)
