"""Worlds in which something is not as planned: surfaces elsewhere, a place where there is nothing,
a push.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from stancekit import Motion
from stancekit.planners.problem import Problem
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.terrain.polygon import Surface
from stancekit.runner.control.estimation import coplanar
from stancekit.runner.worlds.world import Imperfections, Push

START_M, HOLE_M = 0.10, 0.04
"""Half sides of squares: where feet stand at first the ground is as planned, and a place where
there is none."""
PUSH_S, PUSHED_S = (0.5, 12.0), (0.1, 0.3)
"""When a push comes, and how long it lasts."""


@dataclass(frozen=True, kw_only=True)
class Perturbed:
    """What a world has in place of what a course says. course: that a planner would be told, who
    knew.
    """

    terrain: tuple[Patch, ...]
    course: Problem
    imperfections: Imperfections = field(default_factory=Imperfections)


def moved(plan: Motion, rng: np.random.Generator, far_m: float, turned_rad: float) -> Perturbed:
    """Every plane moved along its normal and turned about a random axis in it, each by up to so
    much, either way.
    """
    course, planes = plan.problem, list[tuple[Patch, Callable[[Patch], Patch]]]()

    def of(patch: Patch) -> Patch:
        for plane, move in planes:
            if coplanar(patch, plane):
                return move(patch)
        middle = np.mean(
            [c.centre_m for f in course.footholds for c in f.candidates if coplanar(c, patch)]
            or [patch.centre_m],
            axis=0,
        )
        across = patch.frame[:, 1:] @ (lambda a: np.array([np.cos(a), np.sin(a)]))(
            rng.uniform(0.0, 2.0 * np.pi)
        )
        turn = Rotation.from_rotvec(rng.uniform(-turned_rad, turned_rad) * across).as_matrix()
        shift = rng.uniform(-far_m, far_m) * patch.normal

        def move(each: Patch) -> Patch:
            return Patch(
                vertices_m=middle + (each.vertices_m - middle) @ turn.T + shift,
                normal=turn @ each.normal,
                shear_reference=turn @ each.shear_reference,
                friction=each.friction,
            )

        planes.append((patch, move))
        return move(patch)

    terrain = list[Patch]()
    for patch in course.terrain:
        kept, rest = [], [patch]
        for index, toe in zip(course.holds[0], plan.toes_at(0), strict=True):
            if coplanar(course.patch(int(index), plan.choice), patch):
                kept.append(Surface(patch, 0.0).window(toe, 2.0 * START_M))
                rest = [
                    piece
                    for each in rest
                    for piece in Surface(each, 0.0).around(toe, 2.0 * START_M)
                ]
        terrain += [each for each in kept if each is not None] + list(map(of, rest))
    footholds = tuple(
        replace(each, candidates=tuple(map(of, each.candidates))) for each in course.footholds
    )
    told = replace(course, terrain=tuple(map(of, course.terrain)), footholds=footholds)
    return Perturbed(terrain=tuple(terrain), course=told)


def missing(plan: Motion, rng: np.random.Generator) -> Perturbed:
    """Nothing around one of the places where a foot should come down."""
    course, starts = plan.problem, plan.toes_at(0)
    later = [
        index
        for index, each in enumerate(course.footholds)
        if each.frame > 0
        and np.linalg.norm(plan.toes_m[index] - starts, axis=1).min() > np.sqrt(2.0) * HOLE_M
    ]
    if not later:
        raise SystemExit(
            f"--wrong missing: {course.name}: no foot comes down away from where feet stand at first"
        )
    index = int(rng.choice(later))
    place, toe = course.patch(index, plan.choice), plan.toes_m[index]

    def left(patch: Patch) -> tuple[Patch, ...]:
        surface = Surface(patch, 0.0)
        hit = coplanar(patch, place) and surface.window(toe, 2.0 * HOLE_M) is not None
        return surface.around(toe, 2.0 * HOLE_M) if hit else (patch,)

    footholds = tuple(
        each if each.frame == 0 else replace(each, candidates=pieces)
        for each in course.footholds
        if (pieces := tuple(piece for patch in each.candidates for piece in left(patch)))
    )
    terrain = tuple(piece for patch in course.terrain for piece in left(patch))
    return Perturbed(terrain=terrain, course=replace(course, terrain=terrain, footholds=footholds))


def pushed(plan: Motion, rng: np.random.Generator, share: float) -> Perturbed:
    """A push on the body from anywhere, of half to all of this share of the weight."""
    course, way = plan.problem, rng.standard_normal(3)
    force = rng.uniform(0.5, 1.0) * share * course.weight_n * way / np.linalg.norm(way)
    push = Push(
        force_n=tuple(force.tolist()), at_s=rng.uniform(*PUSH_S), seconds=rng.uniform(*PUSHED_S)
    )
    return Perturbed(
        terrain=course.terrain, course=course, imperfections=Imperfections(pushes=(push,))
    )
