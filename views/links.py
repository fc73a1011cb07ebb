"""A robot's own links: what they look like, or collide with, as one mesh for all that moves
together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.colors import to_rgb as rgb
from scipy.spatial import ConvexHull, QhullError

from stancekit.planners.arguments import cached_property
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.inverse_kinematics import base_of
from stancekit.planners.robot.meshes import Shape, shape_points, thinned_mesh
from stancekit.planners.robot.robot_model import RobotModel

from .scene import Colour, DrawnBody, between
from .shapes import Faces, Mesh, Sphere, hull
from .sheet import leg_colour

_SHELL, _STEEL, _RIM = "#aab5c0", "#7b8a99", "#2b3642"
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

    def _shapes(self) -> Iterator[Shape]:
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
        flat = (points - self.model.body.com_m)[:, :2]
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
            [] if trunk is None else [self._body(f"{prefix}base", trunk, base, rotation, _SHELL)]
        )
        for i, (leg, q, chain) in enumerate(zip(model.legs, angles, chains, strict=True)):
            colour = _mixed(_STEEL, leg_colour(i), _TINT)
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


def _mesh(shape: Shape) -> Mesh | None:
    """One shape in its own frame, by its hull where its mesh is not at hand; None for what is flat
    or unknown.
    """
    if shape.kind == "mesh":
        mesh = None if shape.mesh is None else thinned_mesh(shape.mesh, shape.size_m, TRIANGLES)
        if mesh is not None and len(mesh.faces):
            return Mesh(mesh.vertices_m, mesh.faces)
    try:
        points = shape_points(shape)
        return None if points is None else hull(points)
    except QhullError:
        return None


def _joined(pieces: Sequence[tuple[Array, Faces]]) -> Mesh:
    starts = np.cumsum([0, *(len(points) for points, _ in pieces[:-1])])
    faces = [each + start for (_, each), start in zip(pieces, starts, strict=True)]
    return Mesh(np.vstack([points for points, _ in pieces]), np.vstack(faces))


def _mixed(one: Colour, other: Colour, share: float) -> Colour:
    return tuple((1.0 - share) * np.array(rgb(one)) + share * np.array(rgb(other)))
