"""The base of what shows a motion: the robot at a time, the forces of its feet, and a film of it all."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.chain import rotation_of
from stancekit.planners.robot.drawn_legs import ToeKinematics
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import Robot
from stancekit.planners.terrain import Patch

from .film import film_frames
from .robots import RobotShape, climber, limb_of_three
from .scene import ON_M, Animation, Arrow, Colour, DrawnBody, Layer, Path, Scene
from .shapes import plate, ring, unit
from .sheet import Size
from .video import Frame

GOAL, REAL = "#e8a317", "#c2410c"
"""Colours of the goal, and of the path of the robot in a world."""


class View(ABC):
    """A motion as something to look at: a picture, a page or a film.

    Joints are where the motion has them. Where it knows none they are found by inverse kinematics,
    and those of limbs without a file are a guess, for the eye.
    """

    film_px: ClassVar[Size] = (960, 720)

    @property
    @abstractmethod
    def robot(self) -> Robot:
        """The robot that moves."""

    @property
    @abstractmethod
    def metres_a_newton(self) -> float:
        """Length of the arrow of a force."""

    @abstractmethod
    def film(self) -> Animation:
        """The motion as moments, for a page or a film."""

    def frames(self, film: Animation, size_px: Size | None = None) -> Iterator[Frame]:
        """The frames of ``film``, uint8 of shape (H, W, 3), one by one.

        Raises InvalidInput without MuJoCo or a GL library.
        """
        return film_frames(film, size_px or self.film_px)

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot."""
        return climber(self.robot)

    def near_rad(self, now: Samples) -> Array | None:
        """Angles that unknown joints are sought near, shape (J,) [rad]; None for anywhere."""
        return None

    def guess(self, now: Samples) -> list[Array]:
        """Places of the joints of limbs of which only the reach is known, shape (J, 3) [m] each, the
        foot last.
        """
        turn = rotation_of(now.rotation_rad)
        return [
            limb_of_three(now.com_m + arm, toe, unit(arm), limb.reach_m)
            for limb, toe in zip(self.robot.limbs, now.toes_m, strict=True)
            for arm in [turn @ limb.shoulder_m]
        ]

    def limbs(self, now: Samples) -> Sequence[Array]:
        """Poses of the limbs: angles of a URDF's, shape (n,) [rad]; else where its joints are, shape
        (J, 3) [m], the foot last.
        """
        turn, links = rotation_of(now.rotation_rad), self.shape.links
        if links is not None and now.angles_rad is not None:
            return links.split(now.angles_rad)
        if links is not None:
            near = self.near_rad(now)
            postures = ToeKinematics(links.model).solve(
                now.com_m[None],
                turn[None],
                now.toes_m[None],
                now.normals[None],
                None if near is None else near[None],
            )
            return [angles[0] for angles in postures.angles]
        if now.angles_rad is not None and now.origin_m is not None and self._kinematics is not None:
            return list(now.origin_m + self._kinematics.chains(now.angles_rad) @ turn.T)
        return self.guess(now)

    @cached_property
    def _kinematics(self) -> Kinematics | None:
        """Legs that are drawn up for limbs; None where there are none, or pinocchio is not
        installed.
        """
        try:
            return Kinematics(self.robot)
        except InvalidInput:
            return None

    def pose(self, now: Samples) -> tuple[Array, Array]:
        """Pose in which the body is drawn, p_WB and R_WB: where its link is, or else at the centre
        of mass.
        """
        turn = rotation_of(now.rotation_rad)
        if now.origin_m is None:
            return now.com_m, turn
        return now.origin_m + turn @ self.robot.origin_m, turn

    def bodies(self, now: Samples) -> list[DrawnBody]:
        """The robot at a time."""
        return self.shape.bodies(*self.pose(now), self.limbs(now))

    def ghost(self, now: Samples) -> Scene:
        """Trunk and limbs as a drawing in thin lines."""
        return self.shape.ghost(*self.pose(now), self.limbs(now))

    def forces(self, now: Samples, *, prefix: str = "") -> list[Arrow]:
        """Arrows of the forces of the feet that stand and are loaded."""
        loaded = now.stands & (np.linalg.norm(now.forces_n, axis=1) > 0.0)
        return [
            self.shape.force(
                prefix + self.shape.limbs[k],
                now.toes_m[k],
                self.metres_a_newton * now.forces_n[k],
            )
            for k in np.flatnonzero(loaded).tolist()
        ]


def outline(patch: Patch, colour: Colour, opacity: float = 1.0, width: float = 1.4) -> Path:
    """The border of a chosen patch."""
    return Path(
        pieces_m=ring(patch.vertices_m + ON_M * patch.normal),
        colour=colour,
        opacity=opacity,
        width=width,
        layer=Layer.TERRAIN,
        lift_m=8.0,
    )


def window(name: str, patch: Patch, colour: Colour, edge: Colour) -> DrawnBody:
    """A chosen patch in full colour, framed in the colour of its limb."""
    return DrawnBody(
        name=name,
        shape=plate(patch.vertices_m, ON_M * patch.normal),
        position_m=np.zeros(3),
        colour=colour,
        edge=edge,
        opacity=0.55,
        layer=Layer.TERRAIN,
        lift_m=9.0,
    )
