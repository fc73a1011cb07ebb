"""The two seeds joined: contact plans of Lin et al., made on flat ground in warped space, pushed
forward to the terrain.

A place in warped space is pushed by φ, a body's orientation by the polar factor 𝒫(J) (W13), and a
flat patch to the tangent patch at its pushed centre, with its shear axes turned by 𝒫(J) and its
size kept: φ is no isometry, but a toe's ground is as large as it is. So an envelope that was
learned on flat ground is used on curved ground, and a plan of key frames becomes a guess for the
gait optimiser.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from ..answer.plan import Plan
from ..errors import InvalidInput
from ..files.arrays import Array, read_only
from ..problem import Problem
from ..relaxation.envelope import Envelope
from ..terrain.patch import Patch
from .pushforward import nearest_rotation
from .spline_map import SplineMap


@dataclass(frozen=True, kw_only=True, eq=False)
class WarpedPose:
    """A body in warped space: com_bar_m, shape (3,) [m], z̄ over the ground.

    What is given about the body, in axes that are level and along it, is pushed forward with it.

    Arguments:
        yaw_rad: its heading there.
    """

    warp: SplineMap
    com_bar_m: Array
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "com_bar_m", read_only(self.com_bar_m, (3,), "com_bar_m"))

    @property
    def com_m(self) -> Array:
        """φ of the body's place, shape (3,) [m]."""
        return self.warp.points(self.com_bar_m)

    @property
    def rotation(self) -> Array:
        """R_WB = 𝒫(J) R(yaw) at the body (W13), shape (3, 3)."""
        return self._turned(self.com_bar_m)

    def place(self, local: Array) -> Array:
        """Points about the body, shape (…, 3) [m], to the world."""
        return self.warp.points(self._bar(local))

    def patch(self, patch: Patch) -> Patch:
        """The tangent patch of a patch about the body.

        A patch that leans from level by a rotation leans from the tangent plane by the same, seen
        from there.
        """
        centre_bar = self._bar(patch.centre_m)
        ground = np.array([centre_bar[0], centre_bar[1], 0.0])
        frame = _surface_frame(self.warp.jacobians(ground), self._turned(ground))
        centre = self.warp.points(centre_bar)
        return Patch(
            vertices_m=centre + (patch.vertices_m - patch.centre_m) @ frame.T,
            normal=frame @ patch.normal,
            shear_reference=frame @ patch.shear_reference,
            friction=patch.friction,
        )

    def problem(self, problem: Problem) -> Problem:
        """A posture problem about the body, in the world about φ of the body's place; the body is
        turned with it.
        """
        rotation, home = self.rotation, self.com_m
        contacts = tuple(
            replace(
                contact,
                patch=_moved(self.patch(contact.patch), -home),
                shoulder_m=rotation @ contact.shoulder_m,
            )
            for contact in problem.contacts
        )
        nominal = self.place(problem.com_nominal_m[0]) - home
        return problem.posture_with(contacts=contacts, com_nominal_m=nominal)

    def envelope(self, envelope: Envelope, length_m: float) -> Envelope:
        """The box about what φ makes of a box over [p, f]; forces are in contact frames and stay.

        Arguments:
            length_m: the length scale of p.
        """
        low, high = envelope.position
        corners = np.array(list(product((0.0, 0.5, 1.0), repeat=3)))
        boxes = low[:, None] + corners * (high - low)[:, None]
        pushed = (self.place(boxes * length_m) - self.com_m) / length_m
        return Envelope(
            low=np.hstack([pushed.min(axis=1), envelope.force[0]]),
            high=np.hstack([pushed.max(axis=1), envelope.force[1]]),
        )

    def _bar(self, local: Array) -> Array:
        return np.asarray(self.com_bar_m + np.asarray(local) @ _yaw(self.yaw_rad).T)

    def _turned(self, at: Array) -> Array:
        return np.asarray(nearest_rotation(self.warp.jacobians(at)) @ _yaw(self.yaw_rad))


@dataclass(frozen=True, kw_only=True, eq=False)
class KeyFrames:
    """Key frames of a plan on level ground, pushed forward.

    Arguments:
        limbs: names.
        com_m: shape (M, 3) [m].
        rotation: R_WB, shape (M, 3, 3).
        toes_m: shape (M, N, 3) [m].
        problems: the posture problems of the plan's stances on tangent patches no larger than the
            toe needs, about the pushed bodies.
    """

    limbs: tuple[str, ...]
    com_m: Array
    rotation: Array
    toes_m: Array
    problems: tuple[Problem, ...]

    def com_at(self, shares: Array) -> Array:
        """The body's place after shares of the way, straight between key frames, shape (K,) → (K,
        3) [m].
        """
        at = np.asarray(shares) * (len(self.com_m) - 1)
        return np.stack(
            [np.interp(at, np.arange(len(self.com_m)), self.com_m[:, k]) for k in range(3)], axis=1
        )


def pushed_plan(
    warp: SplineMap, plan: Plan, start_xy_m: Array, yaw_rad: float = 0.0, toe_m: float = 0.02
) -> KeyFrames:
    """Push a plan on level ground z = 0 forward, its first body over (x̄, ȳ) = start_xy_m, its x
    along yaw_rad.

    Arguments:
        toe_m: half the width of the tangent patch under a toe.

    Raises:
        InvalidInput: for a plan whose toes are not on level ground.
    """
    if np.abs(plan.toes_m[:, 2]).max(initial=0.0) > 1e-6:
        raise InvalidInput("plan: expected toes on level ground z = 0, got one at another height")
    turn, home = (
        _yaw(yaw_rad),
        np.array([*start_xy_m, 0.0]) - _yaw(yaw_rad) @ (plan.com_m[0] * [1.0, 1.0, 0.0]),
    )
    com_bar, toes_bar = plan.com_m @ turn.T + home, plan.toes_m @ turn.T + home
    poses = [WarpedPose(warp=warp, com_bar_m=com, yaw_rad=yaw_rad) for com in com_bar]
    toes = warp.points(toes_bar)
    problems = []
    for stance in plan.problem.stances:
        flat = plan.problem.posture_problem(stance, plan.choice)
        body = plan.com_m[stance.frame]
        held = plan.problem.holds[stance.frame]
        contacts = tuple(
            replace(contact, patch=_toe_patch(contact.patch, plan.toes_m[held[limb]] - body, toe_m))
            for contact, limb in zip(flat.contacts, stance.limbs, strict=True)
        )
        level = flat.posture_with(contacts=contacts, com_nominal_m=np.zeros(3))
        problems.append(poses[stance.frame].problem(level))
    return KeyFrames(
        limbs=tuple(limb.name for limb in plan.problem.robot.limbs),
        com_m=np.array([pose.com_m for pose in poses]),
        rotation=np.array([pose.rotation for pose in poses]),
        toes_m=np.array([toes[plan.problem.holds[frame]] for frame in range(plan.problem.frames)]),
        problems=tuple(problems),
    )


def _toe_patch(patch: Patch, toe_m: Array, half_m: float) -> Patch:
    """A square of a patch's plane about a toe."""
    y, z = patch.frame[:, 1], patch.frame[:, 2]
    corners = [toe_m + half_m * (a * y + b * z) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return replace(patch, vertices_m=np.array(corners))


def _moved(patch: Patch, by: Array) -> Patch:
    return replace(patch, vertices_m=patch.vertices_m + by)


def _surface_frame(jacobian: Array, rotation: Array) -> Array:
    """The rotation nearest to ``rotation`` whose third column is the true normal, along J e_x × J
    e_y.
    """
    normal = np.cross(jacobian[:, 0], jacobian[:, 1])
    normal = normal / np.linalg.norm(normal)
    upright = Rotation.from_quat(
        [*np.cross(rotation[:, 2], normal), 1.0 + rotation[:, 2] @ normal]
    )  # the least turn
    return np.asarray(upright.as_matrix() @ rotation)


def _yaw(angle: float) -> Array:
    return np.asarray(Rotation.from_euler("z", angle).as_matrix())
