"""From a published scene to a course: the same surfaces, feet and phases, and what our plans need
beside them.

Between two steps the body may move with all feet down: a frame at which nobody moves. A kinematic
planner needs none, since nothing carries its robot; a biped that is to stand on one sole, then on
the other, does. Limits of steps are those of the polytopes alone: the others are too wide to
matter, and so is the ball that the body is in. Nothing is said of its path: the one in the file
only says which surfaces are near, and where a plan should end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..robot.model import Limb, Robot
from ..terrain.patch import Patch
from ..terrain.polygon import Surface, surface_patch
from ..terrain.sole import sole_offsets, sole_region
from .problem import Foothold, Problem, StepLimits, Weights
from .scene_keys import SceneSpec

OFF_M = 1e-3
"""A toe of a published start is at most this far off a surface [m]."""
BENT_M = 2e-3
"""A published corner is moved into the plane of its surface by this at most [m]."""
WIDE_M = 2.0
"""Steps are no longer than this; polytopes of reach allow less [m]."""


def build_scene(spec: SceneSpec, robot: Robot, tilt_rad: float = 0.0) -> Problem:
    """The course of a scene for a robot whose limbs have the scene's names.

    Arguments:
        tilt_rad: largest component of Θ; published polytopes know none.

    Raises:
        InvalidInput: e.g. for a start that is not on any surface.
    """
    patches = _patches(spec)
    moves = spec.moves()
    lifts: list[tuple[str, ...]] = [()]
    for step in moves:
        lifts += [tuple(name for name in robot.limb_names if name in dict(step)), ()]
    lifts = lifts[:-1]
    path = np.array(spec.ours.path_m)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, way[-1], len(lifts))
    com = np.stack([np.interp(at, way, axis) for axis in path.T], axis=1)
    corners = np.concatenate([patch.vertices_m for patch in patches])
    radius = (
        float(np.linalg.norm(np.ptp(corners, axis=0)))
        + 1.0
        + float(np.linalg.norm(np.ptp(path, axis=0)))
    )
    return Problem(
        name=spec.name,
        robot=robot,
        terrain=patches,
        footholds=_footholds(spec, robot, patches, lifts, moves, com),
        lifts=tuple(lifts),
        com_nominal_m=np.tile(com.mean(axis=0), (len(lifts), 1)),
        com_radius_m=np.full(len(lifts), radius),
        goal_m=path[-1],
        steps=StepLimits(com_m=WIDE_M, toe_m=WIDE_M, rotation_rad=2.0 * tilt_rad),
        weights=Weights(goal=1.0, com_step=0.2, toe_step=0.05, tilt=0.05),
        tilt_limit_rad=tilt_rad,
    )


def _patches(spec: SceneSpec) -> tuple[Patch, ...]:
    """The surfaces, facing up.

    Raises InvalidInput for one that is bent.
    """
    patches = []
    for index, polygon in enumerate(spec.surfaces):
        corners = np.array(polygon)
        middle = corners.mean(axis=0)
        normal = np.linalg.svd(corners - middle)[2][2]
        off = (corners - middle) @ normal
        if float(np.abs(off).max()) > BENT_M:
            raise InvalidInput(
                f"surfaces[{index}]: expected a plane, got corners {1e3 * np.abs(off).max():.3g} "
                "mm off"
            )
        flat = corners - off[:, None] * normal
        try:
            patches.append(
                surface_patch(
                    flat, spec.ours.friction, towards_m=middle + np.array([0.0, 0.0, 1.0])
                )
            )
        except InvalidInput as error:
            raise InvalidInput(f"surfaces[{index}]: {error}") from None
    return tuple(patches)


def _footholds(
    spec: SceneSpec,
    robot: Robot,
    patches: Sequence[Patch],
    lifts: Sequence[Sequence[str]],
    moves: Sequence[Sequence[tuple[str, tuple[int, ...]]]],
    com_m: Array,
) -> tuple[Foothold, ...]:
    """Every foothold in order of frame, then limb, its surfaces in order of their distance from its
    nominal place.
    """
    footholds, home = [], dict[str, Array]()
    for limb in robot.limbs:
        start = (
            None if spec.initial_contacts is None else np.array(spec.initial_contacts[limb.name])
        )
        home[limb.name] = limb.shoulder_m if start is None else start - com_m[0]
        footholds.append(
            _offered(spec, limb, 0, patches, spec.first_surfaces(), com_m[0] + home[limb.name])
            if start is None
            else _standing(spec, limb, start, patches)
        )
    for k, step in enumerate(moves):
        frame, allowed = 2 * k + 1, dict(step)
        last = (
            next(
                (j for j in range(frame + 1, len(lifts)) for name in lifts[j] if name in allowed),
                len(lifts),
            )
            - 1
        )
        middle = com_m[frame : max(last, frame) + 1].mean(axis=0)
        footholds += [
            _offered(spec, limb, frame, patches, allowed[limb.name], middle + home[limb.name])
            for limb in robot.limbs
            if limb.name in allowed
        ]
    return tuple(footholds)


def _offered(
    spec: SceneSpec,
    limb: Limb,
    frame: int,
    patches: Sequence[Patch],
    allowed: Sequence[int],
    toe_m: Array,
) -> Foothold:
    """A toe that the planner puts down.

    Raises InvalidInput for a sole that has no room anywhere.
    """
    surfaces = [Surface(patches[index], 0.0) for index in allowed]
    order = sorted(
        surfaces, key=lambda surface: float(np.linalg.norm(surface.nearest(toe_m) - toe_m))
    )
    candidates, yaws = list[Patch](), list[float]()
    for surface in order[: spec.ours.near]:
        for yaw in (0.0,) if limb.sole_m is None else spec.ours.yaws_rad:
            try:
                _ = limb.sole_m is None or sole_region(
                    surface.patch, sole_offsets(limb.sole_m, surface.patch, yaw)
                )
            except InvalidInput:
                continue
            candidates.append(surface.patch)
            yaws.append(yaw)
    if not candidates:
        raise InvalidInput(
            f"frame {frame}, limb {limb.name}: expected room for its sole on a surface, got none"
        )
    return Foothold(
        limb=limb.name,
        frame=frame,
        candidates=tuple(candidates),
        yaws_rad=() if limb.sole_m is None else tuple(yaws),
    )


def _standing(spec: SceneSpec, limb: Limb, toe_m: Array, patches: Sequence[Patch]) -> Foothold:
    """A toe of the start, on the nearest surface.

    Raises InvalidInput for one that is on none.
    """
    rooms = list[tuple[float, Array, Patch]]()
    for patch in patches:
        try:
            room = (
                patch
                if limb.sole_m is None
                else sole_region(patch, sole_offsets(limb.sole_m, patch, 0.0))
            )
        except InvalidInput:
            continue
        place = Surface(room, 0.0).nearest(toe_m)
        rooms.append((float(np.linalg.norm(place - toe_m)), place, patch))
    if not rooms:
        raise InvalidInput(
            f"initial_contacts.{limb.name}: expected room for its sole on a surface, got none"
        )
    off, place, patch = min(rooms, key=lambda room: room[0])
    if off > OFF_M and spec.ours.start == "published":
        raise InvalidInput(
            f"initial_contacts.{limb.name}: expected a toe on a surface, got one {1e3 * off:.3g} "
            "mm off the nearest "
            "(ours.start: nearest moves it there)"
        )
    return Foothold(
        limb=limb.name,
        frame=0,
        candidates=(patch,),
        toe_m=place,
        yaws_rad=() if limb.sole_m is None else (0.0,),
    )
