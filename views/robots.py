"""The one drawer of robots: a robot's own links, or a trunk of any shapes, limbs as bars between
joints, and feet in the limbs' colours.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from matplotlib.colors import to_rgb as rgb
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull, QhullError

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.inverse_kinematics import base_of
from stancekit.planners.robot.meshes import Shape as FileShape, thinned_mesh
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.reach_sets import Workspace
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.verify.explanation import Relaxation

from .scene import (
    UP,
    Arrow,
    Box,
    Camera,
    Colour,
    DrawnBody,
    Faces,
    Facet,
    Label,
    Layer,
    Mesh,
    Path,
    Scene,
    Shape,
    Sphere,
    between,
    dashed,
    hull,
    polyline,
    prism,
    unit,
)
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    INK,
    SIZE_PX,
    Size,
    headline,
    leg_colour,
    plain_axes,
    sheet,
)
from .still import Still

_CASE, _LINK = "#aab5c0", "#7b8a99"
_TINT = 0.3
"""Share of its leg's colour that a link has."""
TRIANGLES = 3000
"""Most triangles of the mesh of one file: a quadruped is drawn with 20,000 to 50,000, and
its page opens at once."""
_SMALLEST = 0.012
"""Radius of the ball that marks a foot, in stand heights, where the foot is a point."""


class Links:
    """The links of a robot's model, in the frames of the joints that carry them."""

    def __init__(self, model: RobotModel) -> None:
        self.model = model

    @cached_property
    def meshes(self) -> dict[tuple[int | None, int], Mesh]:
        """Meshes that a leg's joint carries, (leg, joint), in its frame; by none, (None, -1), in
        the base's.
        """
        pieces = dict[tuple[int | None, int], list[tuple[Array, Faces]]]()
        for shape in self._shapes():
            mesh = _mesh(shape)
            if mesh is not None:
                mount = self.model.mounts[shape.link]
                points = (
                    shape.origin_m + mesh.vertices_m @ shape.rotation.T
                ) @ mount.rotation.T + mount.origin_m
                pieces.setdefault((mount.leg, mount.joint), []).append((points, mesh.faces))
        return {key: _joined(each) for key, each in pieces.items()}

    def _shapes(self) -> Iterator[FileShape]:
        """For each link what it looks like, or where that cannot be had what it collides with: where
        a mesh's file is not at hand, and no hull is known, as of a robot that a plan's file carries.
        """
        for link in self.model.mounts:
            shapes = [shape for shape in self.model.shapes if shape.link == link]
            seen = [
                shape
                for shape in shapes
                if not shape.collides
                and (shape.kind != "mesh" or shape.mesh is not None or shape.corners_m is not None)
            ]
            yield from seen or [shape for shape in shapes if shape.collides]

    @cached_property
    def outline_m(self) -> Array:
        """Outline of the trunk from above, or where nothing is seen of it the hips: corners about
        the centre of mass, shape (K, 3) [m].
        """
        trunk = self.meshes.get((None, -1))
        points = (
            np.array([leg.hip_m for leg in self.model.legs]) if trunk is None else trunk.vertices_m
        )
        flat = (points - self.model.com_m)[:, :2]
        try:
            return np.pad(flat[ConvexHull(flat).vertices], ((0, 0), (0, 1)))
        except QhullError:
            return np.pad(flat, ((0, 0), (0, 1)))

    def bodies(
        self, com_m: Array, rotation: Array, angles: Sequence[Array], *, prefix: str = ""
    ) -> list[DrawnBody]:
        """The robot with its centre of mass at p_WC, R_WB, and the angles of every leg, shape (n,)
        [rad].

        Legs without shapes are bars from joint to joint.
        """
        base, model = base_of(self.model, com_m, rotation), self.model
        chains, trunk = self.chains(com_m, rotation, angles), self.meshes.get((None, -1))
        result = (
            [] if trunk is None else [self._body(f"{prefix}base", trunk, base, rotation, _CASE)]
        )
        for i, (leg, q, chain) in enumerate(zip(model.legs, angles, chains, strict=True)):
            colour = _mixed(_LINK, leg_colour(i), _TINT)
            turns, places = (part[0] for part in leg.chain.frames(np.asarray(q)[None]))
            joints = [k for k in range(len(leg.joints)) if (i, k) in self.meshes]
            result += [
                self._body(
                    f"{prefix}{leg.name} link {k}",
                    self.meshes[i, k],
                    base + rotation @ places[k],
                    rotation @ turns[k],
                    colour,
                )
                for k in joints
            ]
            if not joints:
                thick = 0.05 * model.stand_height_m
                result += [
                    between(f"{prefix}{leg.name} bar {k}", a, b, (1.2 * thick, thick), colour, _RIM)
                    for k, (a, b) in enumerate(pairwise(chain))
                    if np.linalg.norm(b - a) > 1e-9
                ]
            radius = max(leg.radius_m, _SMALLEST * model.stand_height_m)
            foot = Sphere(radius)
            result.append(
                DrawnBody(
                    name=f"{prefix}{leg.name} foot",
                    shape=foot,
                    position_m=chain[-1],
                    colour=leg_colour(i),
                )
            )
        return result

    def split(self, angles: Array) -> list[Array]:
        """Angles of all joints, shape (J,), leg by leg."""
        return np.split(angles, np.cumsum([len(leg.joints) for leg in self.model.legs])[:-1])

    def chains(self, com_m: Array, rotation: Array, angles: Sequence[Array]) -> list[Array]:
        """Joints of every leg in the world, the foot last, shape (n + 1, 3) [m]."""
        base, result = base_of(self.model, com_m, rotation), []
        for leg, q in zip(self.model.legs, angles, strict=True):
            q = np.asarray(q)[None]
            result.append(
                base + np.vstack([leg.chain.frames(q)[1][0], leg.chain.feet(q)]) @ rotation.T
            )
        return result

    @staticmethod
    def _body(name: str, mesh: Mesh, place: Array, rotation: Array, colour: Colour) -> DrawnBody:
        return DrawnBody(name=name, shape=mesh, position_m=place, rotation=rotation, colour=colour)


def _mesh(shape: FileShape) -> Mesh | None:
    """One shape in its own frame, by its hull where its mesh is not at hand; None for what is flat
    or unknown.
    """
    if shape.mesh is not None:
        with suppress(InvalidInput):
            mesh = thinned_mesh(shape.mesh, shape.size_m, TRIANGLES)
            if len(mesh.faces):
                return Mesh(mesh.vertices_m, mesh.faces)
    try:
        points = shape.points_m
        return None if points is None else hull(points)
    except QhullError:
        return None


def _joined(pieces: Sequence[tuple[Array, Faces]]) -> Mesh:
    starts = np.cumsum([0, *(len(points) for points, _ in pieces[:-1])])
    faces = [each + start for (_, each), start in zip(pieces, starts, strict=True)]
    return Mesh(np.vstack([points for points, _ in pieces]), np.vstack(faces))


def _mixed(one: Colour, other: Colour, share: float) -> Colour:
    return tuple((1.0 - share) * np.array(rgb(one)) + share * np.array(rgb(other)))


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
            told = lack is not None and blamed[:1] == (limb,)
            words = f"{', '.join(blamed)}: {lack.words}" if lack is not None and told else limb
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
    if robot.own:
        return linked(robot.own_model(), size)
    return hexapod(robot.limb_names, np.array([limb.shoulder_m for limb in robot.limbs]), size)


def single_body(robot: Robot) -> RobotShape:
    """A walker: its own links, or a box of the trunk's measures."""
    half, size = robot.trunk_half_m, robot.stand_height_m
    if robot.own:
        return linked(robot.own_model(), size)
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


def force_label(limb: int, name: str, toe_m: Array, force_n: Array) -> Label:
    """A limb's name with its force, at its toe."""
    text = f"{name} {np.linalg.norm(force_n):.0f} N"
    return Label(name=name, position_m=toe_m, text=text, colour=leg_colour(limb))


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


@DEFAULT_STYLE
def draw_robot(
    robot: RobotModel, workspaces: Sequence[Workspace] | None = None, *, size_px: Size = SIZE_PX
) -> Figure:
    """The robot in its standing posture, its own links.

    Arguments:
        workspaces: of its legs; the inner polytopes are drawn in the legs' colours.

    Raises:
        InvalidInput: below 300 pixels.
    """
    stance = [leg.stance_rad for leg in robot.legs]
    feet = np.array([leg.nominal_m for leg in robot.legs])
    size = float(np.ptp(np.vstack([feet, [leg.hip_m for leg in robot.legs]]), axis=0).max())
    bodies = Links(robot).bodies(robot.com_m, np.eye(3), stance)
    bodies.append(
        DrawnBody(name="com", shape=Sphere(0.018 * size), position_m=robot.com_m, colour=INK)
    )
    for index, workspace in enumerate(workspaces or ()):
        bodies.append(
            DrawnBody(
                name="",
                shape=hull(workspace.inner.vertices),
                position_m=np.zeros(3),
                colour=leg_colour(index),
                opacity=0.1,
                layer=Layer.GLASS,
                edge=leg_colour(index),
            )
        )
    ground = float(feet[:, 2].min()) - max(leg.radius_m for leg in robot.legs)
    (x0, y0), (x1, y1) = feet[:, :2].min(axis=0) - 0.4 * size, feet[:, :2].max(axis=0) + 0.4 * size
    corners = np.array([[x0, y0, ground], [x1, y0, ground], [x1, y1, ground], [x0, y1, ground]])
    floor = Facet(
        corners_m=corners, normal=np.array([0.0, 0.0, 1.0]), colour="#f3f5f7", edge="#c3cad2"
    )
    labels = [
        Label(name=leg.name, position_m=leg.nominal_m, text=leg.name, colour=leg_colour(index))
        for index, leg in enumerate(robot.legs)
    ]
    camera = Camera(
        target_m=feet.mean(axis=0) * [1.0, 1.0, 0.5],
        azimuth_rad=np.deg2rad(-58.0),
        elevation_rad=np.deg2rad(20.0),
        distance_m=4.0 * size,
    )
    figure = sheet(size_px)
    joints = sum(len(leg.joints) for leg in robot.legs)
    words = f"{len(robot.legs)} legs, {joints} joints, {robot.mass_kg:.3g} kg"
    headline(
        figure,
        robot.name,
        words + ("; inside the veils every foot is reached" if workspaces else ""),
    )
    Still(Scene(bodies=bodies, facets=[floor], labels=labels), camera).paint(
        plain_axes(figure, 20.0, 20.0, 90.0)
    )
    return figure
