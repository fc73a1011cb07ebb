"""The one drawer of robots: a trunk of any shapes, limbs as bars between joints, and feet in the
limbs' colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.colors import to_rgb as rgb

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.verify.explain import Relaxation

from .links import Links
from .scene import UP, Arrow, Colour, DrawnBody, Facet, Label, Layer, Path, Scene, between
from .shapes import Box, Mesh, Shape, Sphere, dashed, hull, polyline, prism, unit
from .sheet import ACCENT, leg_colour

_STEEL, JOINT, _RIM, _SHELL = "#5b6b7b", "#8593a1", "#2b3642", "#dfe6ee"
_GHOST = "#5c6b7a"
"""Colour of a robot in thin lines."""
_PAPER = np.array(rgb("#f4f1ea"))


@dataclass(frozen=True, eq=False)
class Part:
    """A shape that goes with the trunk, in the trunk's frame.

    Arguments:
        lift_m: a body's.
    """

    shape: Shape
    colour: Colour
    lift_m: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotShape:
    """Shape of a robot, as it is drawn.

    Arguments:
        outline_m: outline of its trunk from above, in the trunk's frame, shape (K, 3) [m].
        size_m: size of the robot, which sets the scale of forces and marks [m].
        bone_m: thickness of its limbs [m].
        links: the links of its URDF; None for a robot without one. With links a limb is given by
            its joint angles, shape (n,) [rad]; without, by the places of its joints, shape (J, 3)
            [m], foot last.
    """

    limbs: Sequence[str]
    trunk: Sequence[Part]
    outline_m: Array
    size_m: float
    bone_m: float
    links: Links | None = None

    def lines(self, position_m: Array, rotation: Array, limbs: Sequence[Array]) -> list[Array]:
        """Places of the joints of every limb, shape (J, 3) [m] each, foot last."""
        return list(limbs) if self.links is None else self.links.chains(position_m, rotation, limbs)

    def bodies(
        self, position_m: Array, rotation: Array, limbs: Sequence[Array], *, prefix: str = ""
    ) -> list[DrawnBody]:
        """The robot with its centre of mass at p_WB, R_WB, and its limbs."""
        if self.links is not None:
            return self.links.bodies(position_m, rotation, limbs, prefix=prefix)
        result = self.trunk_at(position_m, rotation, prefix=prefix)
        for k, (limb, joints) in enumerate(zip(self.limbs, limbs, strict=True)):
            name = f"{prefix}{limb}"
            sizes = self.bone_m * np.linspace(1.4, 0.95, len(joints))
            ends = [*0.85 * sizes[:-1], 0.5 * sizes[-1]]
            result += [
                between(
                    f"{name} link {j}",
                    joints[j],
                    joints[j + 1],
                    (ends[j], ends[j + 1]),
                    _STEEL,
                    _RIM,
                )
                for j in range(len(joints) - 1)
            ]
            colours = [JOINT] * (len(joints) - 1) + [leg_colour(k)]
            result += [
                ball(f"{name} joint {j}", at, float(size), colour)
                for j, (at, size, colour) in enumerate(zip(joints, sizes, colours, strict=True))
            ]
        return result

    def trunk_at(
        self, position_m: Array, rotation: Array, *, prefix: str = "", opacity: float = 1.0
    ) -> list[DrawnBody]:
        """The trunk alone."""
        return [
            DrawnBody(
                name=f"{prefix}trunk {k}",
                shape=part.shape,
                position_m=position_m,
                rotation=rotation,
                colour=part.colour,
                edge=_STEEL,
                opacity=opacity,
                lift_m=part.lift_m,
            )
            for k, part in enumerate(self.trunk)
        ]

    def ghost(self, position_m: Array, rotation: Array, limbs: Sequence[Array]) -> Scene:
        """Trunk and limbs as a drawing in thin lines."""
        trunk = Facet(
            corners_m=position_m + self.outline_m @ rotation.T,
            normal=rotation[:, 2],
            colour=_GHOST,
            edge=(*rgb(_GHOST), 0.75),
            width=1.0,
            opacity=0.16,
            layer=Layer.SPACE,
        )
        pieces = np.concatenate(
            [polyline(joints) for joints in self.lines(position_m, rotation, limbs)]
        )
        return Scene(
            facets=[trunk], paths=[Path(pieces_m=pieces, colour=_GHOST, opacity=0.5, width=1.6)]
        )

    def unheld(self, ends: Sequence[tuple[str, Array, Array]], lack: Relaxation | None) -> Scene:
        """Limbs that have no posture: a line from every shoulder to the middle of where its toe may
        stand; those to blame in full, the first with what it lacks.

        Arguments:
            ends: name of a limb, its shoulder and that middle, shape (3,) [m].
        """
        blamed = () if lack is None else lack.limbs
        bodies, paths, labels = list[DrawnBody](), list[Path](), list[Label]()
        for k, (limb, shoulder, place) in enumerate(ends):
            colour = ACCENT if limb in blamed else leg_colour(k)
            pieces = dashed(np.linspace(shoulder, place, 26))
            if limb in blamed:
                pieces = np.array([[shoulder, place]])
            paths.append(Path(pieces_m=pieces, colour=colour, width=1.6 + 1.4 * (limb in blamed)))
            bodies.append(ball(f"{limb} shoulder", shoulder, 0.05 * self.size_m, colour))
            words = f"{limb}: {lack.words}" if lack is not None and blamed[:1] == (limb,) else limb
            labels.append(Label(name=limb, position_m=place, text=words, colour=colour))
        return Scene(bodies=bodies, paths=paths, labels=labels)

    def force(self, limb: str, foot_m: Array, vector_m: Array, *, prefix: str = "") -> Arrow:
        """The arrow of a contact force at a foot, at the picture's scale."""
        return Arrow(
            name=f"{prefix}{limb}",
            start_m=foot_m,
            vector_m=vector_m,
            radius_m=0.019 * self.size_m,
            colour=ACCENT,
        )


def hexapod(limbs: Sequence[str], shoulders_m: Array, size_m: float) -> RobotShape:
    """A deck with six corners, one at the first shoulder; shoulders in the body's frame, shape (N,
    3) [m].
    """
    radius = max(float(np.mean(np.linalg.norm(shoulders_m[:, :2], axis=1))), 0.1 * size_m)
    turn = np.arctan2(shoulders_m[0, 1], shoulders_m[0, 0]) + np.pi / 3.0 * np.arange(6)
    ring, thick = radius * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn]), 0.06 * size_m
    deck = [
        share * ring + height * UP
        for share, height in ((0.97, -thick), (0.97, thick), (0.72, 2.0 * thick))
    ]
    nose = _nose(0.36 * radius, 0.55 * radius, 0.2 * radius, 2.0 * thick)
    return RobotShape(
        limbs=limbs,
        trunk=[Part(hull(np.concatenate(deck)), _SHELL), Part(nose, _STEEL, radius)],
        outline_m=0.97 * ring,
        size_m=size_m,
        bone_m=0.033 * size_m,
    )


def climber(robot: Robot) -> RobotShape:
    """A robot that climbs: its own links, or a deck with limbs."""
    size = float(np.mean([limb.reach_m for limb in robot.limbs]))
    if robot.source.own:
        return linked(robot.source.own_model(), size)
    return hexapod(robot.limb_names, np.array([limb.shoulder_m for limb in robot.limbs]), size)


def single_body(robot: Robot) -> RobotShape:
    """A walker: its own links, or a box of the trunk's measures."""
    half, size = robot.trunk_half_m, robot.stand_height_m
    if robot.source.own:
        return linked(robot.source.own_model(), size)
    nose = _nose(0.55 * half[0], 0.9 * half[0], 0.45 * half[1], half[2])
    outline = (
        np.array([(1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (1.0, -1.0, 0.0)]) * half
    )
    return RobotShape(
        limbs=robot.limb_names,
        trunk=[Part(Box(half), _SHELL), Part(nose, _STEEL, half[0])],
        outline_m=outline,
        size_m=size,
        bone_m=0.045 * size,
    )


def linked(model: RobotModel, size_m: float) -> RobotShape:
    """A URDF's robot, its own links."""
    links = Links(model)
    return RobotShape(
        limbs=model.leg_names,
        trunk=(),
        outline_m=links.outline_m,
        size_m=size_m,
        bone_m=0.045 * size_m,
        links=links,
    )


def bent(hip: Array, foot: Array, bend: Array, thigh_m: float, shank_m: float) -> Array:
    """Hip, knee and foot of a leg whose knee bends this way, shape (3, 3) [m]: a guess, for the
    eye.
    """
    line = foot - hip
    length = max(float(np.linalg.norm(line)), 1e-6)
    ahead = (length**2 + thigh_m**2 - shank_m**2) / (2.0 * length)
    aside = unit(bend - (bend @ line) * line / length**2)
    return np.array(
        [hip, hip + ahead / length * line + np.sqrt(max(thigh_m**2 - ahead**2, 0.0)) * aside, foot]
    )


def limb_of_three(shoulder: Array, foot: Array, outward: Array, reach_m: float) -> Array:
    """Shoulder, hip, knee and foot of a limb whose knee bends up and outward, shape (4, 3) [m]: a
    guess.
    """
    hip = shoulder + 0.13 * reach_m * unit(outward + 0.5 * unit(foot - shoulder))
    thigh, shank = np.array([0.44, 0.54]) * max(reach_m, 1.03 * float(np.linalg.norm(foot - hip)))
    return np.vstack([shoulder, bent(hip, foot, UP + 0.5 * outward, thigh, shank)])


def ball(name: str, position_m: Array, radius_m: float, colour: Colour) -> DrawnBody:
    """A joint or a foot."""
    return DrawnBody(
        name=name, shape=Sphere(radius_m), position_m=position_m, colour=colour, edge=_RIM
    )


def cone(friction: float, frame: Array, height_m: float) -> Mesh:
    """The friction cone μ over a contact frame, shape (3, 3), normal first, with its tip at the
    origin.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    across = np.column_stack([np.cos(turn), np.sin(turn)]) @ frame[:, 1:].T
    rim = height_m * (frame[:, 0] + max(friction, 1e-3) * across)
    corner = 1 + np.arange(len(rim))
    after = np.roll(corner, -1)
    sides = np.column_stack([0 * corner, after, corner])
    base = np.column_stack([np.ones_like(corner), corner, after])[1:-1]
    return Mesh(np.vstack([np.zeros(3), rim]), np.concatenate([sides, base]))


def cone_body(name: str, shape: Mesh, foot_m: Array) -> DrawnBody:
    """A friction cone at a foot."""
    return DrawnBody(
        name=name, shape=shape, position_m=foot_m, colour=ACCENT, edge=ACCENT, opacity=0.10
    )


def faded(bodies: Sequence[DrawnBody], strength: float) -> list[DrawnBody]:
    """Bodies that are paler the smaller the strength, 0 to 1."""

    def tone(colour: Colour) -> Colour:
        return (
            None
            if colour is None
            else tuple(strength * np.array(rgb(colour)) + (1.0 - strength) * _PAPER)
        )

    return [replace(body, colour=tone(body.colour), edge=tone(body.edge)) for body in bodies]


def _nose(back: float, tip: float, half: float, height: float) -> Mesh:
    """A thin triangle that points ahead.

    On paper it is lifted off the deck that it lies on, or that hides some.
    """
    return prism(np.array([[tip, 0.0], [back, half], [back, -half]]), height, height + 0.1 * half)
