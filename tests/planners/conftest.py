"""What the tests of planners share: a walk whose forces are known in closed form, small courses
between two walls, and the lift of a course written a second time.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import cvxpy as cp
import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.problem.problem import Foothold, StepLimits, Weights
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.model import Limb, ReachRows, RelativeReach, Robot
from stancekit.planners.terrain import Patch

STEP_M, HEIGHT_M = 0.03, 0.2
TRIPODS = (("RF", "RR", "LM"), ("RM", "LF", "LR"))
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])

FOUR = ("LF", "LR", "RF", "RR")
CLIMB_M = 0.04


@pytest.fixture(scope="session")
def walk() -> Callable[..., Motion]:
    """``walk(frames, gait)``: level ground, the body at constant speed, every stance held by
    vertical forces.

    Three toes that carry share the weight as barycentric coordinates do, more toes by the least sum
    of squares.
    """
    return _walk


def _walk(frames: int = 5, gait: str = "tripod") -> Motion:
    robot = hexapod()
    lifted = {
        "tripod": [TRIPODS[k % 2] for k in range(frames)],
        "wave": [(robot.limb_names[k % 6],) for k in range(frames)],
        "all": [robot.limb_names] * frames,
        "shift": [()] * frames,
    }[gait]
    lifts = ((), *lifted[: frames - 1])
    com = np.array([[STEP_M * k, 0.0, HEIGHT_M] for k in range(frames)])
    footholds, toes = [], []
    for k in range(frames):
        for limb in robot.limbs:
            if k == 0 or limb.name in lifts[k]:
                toe = np.array([*(com[k] + 1.8 * limb.shoulder_m)[:2], 0.0])
                patches = (_square(toe + 0.1 * np.eye(3)[2], 0.0), _square(toe, 0.6))
                start = k == 0
                stands = toe if start else None
                footholds.append(
                    Foothold(limb=limb.name, frame=k, candidates=patches[start:], toe_m=stands)
                )
                toes.append(toe)
    course = Problem(
        name=f"walk-{gait}",
        robot=robot,
        terrain=(_square(np.zeros(3), 0.6, 2.0),),
        footholds=tuple(footholds),
        lifts=lifts,
        next_lift=lifted[frames - 1],
        com_nominal_m=com,
        com_radius_m=np.full(frames, 0.02),
        goal_m=com[-1] + [0.1, 0.0, 0.0],
        steps=StepLimits(com_m=0.05, toe_m=0.2, progress_m=0.02),
    )
    forces = np.zeros((len(course.stances), 6, 3))
    for row, stance in enumerate(course.stances):
        limbs = list(stance.limbs)
        under = np.array(toes)[course.holds[stance.frame, limbs]]
        balance = np.vstack([np.ones(len(limbs)), under[:, :2].T])
        forces[row, limbs, 2] = (
            course.weight_n * np.linalg.pinv(balance) @ [1.0, *com[stance.frame, :2]]
        )
    choice = [len(foothold.candidates) - 1 for foothold in footholds]
    return Motion(
        problem=course,
        com_m=com,
        rotation_rad=np.zeros((frames, 3)),
        toes_m=toes,
        choice=choice,
        forces_n=forces,
        provenance={"method": "closed form"},
    )


def _square(centre: np.ndarray, friction: float, half: float = 0.1) -> Patch:
    return Patch(
        vertices_m=centre + half * SQUARE,
        normal=[0, 0, 1],
        shear_reference=[1, 0, 0],
        friction=friction,
    )


@pytest.fixture(scope="session")
def climb() -> Callable[..., Problem]:
    """``climb(seed, frames=2, regions=1, ice=0.0)``: four limbs on tilted patches of two walls, one
    limb moves a frame.

    Some seeds have a plan and some do not. ice: the chance that a patch has no friction.
    """
    return cache(_climb)


def _climb(seed: int, frames: int = 2, regions: int = 1, ice: float = 0.0) -> Problem:
    rng = np.random.default_rng(seed)
    robot = Robot(name="four", mass_kg=10.0, limbs=hexapod().select(FOUR))
    com = np.array([[0.0, 0.0, CLIMB_M * k] for k in range(frames)])
    lifts = ((), *((FOUR[k % 4],) for k in range(frames - 1)))
    footholds = tuple(
        Foothold(
            limb=limb.name,
            frame=k,
            candidates=tuple(_tilted(rng, com[k], limb, ice) for _ in range(regions)),
        )
        for k in range(frames)
        for limb in robot.limbs
        if k == 0 or limb.name in lifts[k]
    )
    return Problem(
        name=f"climb-{seed}",
        robot=robot,
        terrain=tuple(p for put in footholds for p in put.candidates),
        footholds=footholds,
        lifts=lifts,
        next_lift=(FOUR[(frames - 1) % 4],) if frames == 1 else (),
        com_nominal_m=com,
        com_radius_m=np.full(frames, 0.05),
        goal_m=com[-1] + rng.uniform(-0.1, 0.1, 3),
        steps=StepLimits(com_m=0.09, toe_m=0.3, progress_m=0.01),
    )


def _rough(seed: int, frames: int = 2, regions: int = 1, ice: float = 0.0) -> Problem:
    course, rng = _climb(seed, frames, regions, ice), np.random.default_rng([seed, frames, regions])
    footholds = []
    for index, put in enumerate(course.footholds):
        some = put.candidates[: 1 if index == 0 else int(rng.integers(1, regions + 1))]
        patches = tuple(_polygon(rng, patch) for patch in some)
        toe = patches[0].vertices_m.mean(axis=0) if index == 0 else None
        footholds.append(replace(put, candidates=patches, toe_m=toe))
    terrain = tuple(patch for put in footholds for patch in put.candidates)
    return replace(course, name=f"rough-{seed}", terrain=terrain, footholds=tuple(footholds))


def _polygon(rng: np.random.Generator, patch: Patch) -> Patch:
    """The same place, normal and friction; the border is around a circle, up to a thousandth of it
    off the plane.
    """
    count, radius = int(rng.integers(3, 7)), rng.uniform(0.04, 0.07)
    angle = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    flat = radius * np.outer(np.cos(angle), patch.frame[:, 1]) + radius * np.outer(
        np.sin(angle), patch.frame[:, 2]
    )
    off = rng.uniform(-1e-3, 1e-3, (count, 1)) * radius * patch.normal
    return replace(patch, vertices_m=patch.vertices_m.mean(axis=0) + flat + off)


def _tilted(rng: np.random.Generator, com: np.ndarray, limb: object, ice: float) -> Patch:
    side = np.sign(limb.shoulder_m[1])
    normal = np.array([*rng.uniform(-0.25, 0.25, 1), -side, *rng.uniform(-0.25, 0.25, 1)])
    normal /= np.linalg.norm(normal)
    first = np.cross(normal, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    second = np.cross(first, normal)
    away = [0.06 * np.sign(limb.shoulder_m[0]), side * 0.36, -0.03]
    centre = com + np.add(away, [limb.shoulder_m[0], 0.0, 0.0]) + rng.uniform(-0.06, 0.06, 3)
    corners = 0.05 * np.array([first + second, first - second, -first - second, second - first])
    friction = 0.0 if rng.random() < ice else rng.uniform(0.35, 0.9)
    return Patch(
        vertices_m=centre + corners,
        normal=normal,
        shear_reference=[0.0, 0.0, 1.0],
        friction=friction,
    )


@pytest.fixture(scope="session")
def rough() -> Callable[..., Problem]:
    """``rough(seed, frames=2, regions=1, ice=0.0)``: such a course on polygons of 3 to 6 corners,
    not quite flat.

    A foothold has one or more candidates, ``regions`` at most, and the first limb's toe stands
    already.
    """
    return cache(_rough)


@pytest.fixture(scope="session")
def written_course() -> Callable[[Problem], tuple[cp.Problem, list[list[cp.Variable]]]]:
    """``written_course(course)``: the lift from the course's own numbers, one sentence of the paper
    after another.

    The problem, objective in m², and the shares λ by foothold and candidate. No line is shared with
    the planners.
    """
    return _written_course


def _written_course(course: Problem) -> tuple[cp.Problem, list[list[cp.Variable]]]:
    frames, robot = course.frames, course.robot
    com, turn = cp.Variable((frames, 3)), cp.Variable((frames, 3))
    borders = [
        [patch.vertices_m if put.toe_m is None else put.toe_m[None] for patch in put.candidates]
        for put in course.footholds
    ]
    shares = [[cp.Variable(len(border), nonneg=True) for border in row] for row in borders]
    toes = [
        sum(border.T @ share for border, share in zip(row, weights, strict=True))
        for row, weights in zip(borders, shares, strict=True)
    ]
    rows = [sum(cp.sum(share) for share in row) == 1 for row in shares]
    standing = {}
    for k in range(frames):
        rows += [cp.norm(com[k] - course.com_nominal_m[k]) <= course.com_radius_m[k]]
        rows += [cp.abs(turn[k]) <= course.tilt_limit_rad]
        for put_index, put in enumerate(course.footholds):
            if put.frame <= k:
                standing[k, put.limb] = put_index
        for limb in robot.limbs:
            shoulder = (
                com[k] + limb.shoulder_m - _times(limb.shoulder_m) @ turn[k]
            )  # Θ × v = −v × Θ
            rows.append(cp.norm(toes[standing[k, limb.name]] - shoulder) <= limb.reach_m)
            if limb.reach_rows is not None:  # where the body does not turn these are as they are
                assert course.tilt_limit_rad == 0.0
                rows.append(
                    limb.reach_rows.normals @ (toes[standing[k, limb.name]] - com[k])
                    <= limb.reach_rows.bounds_m
                )
    for stance in course.stances:
        force, moment = (
            np.array([0.0, 0.0, -1.0]),
            _times(np.array([0.0, 0.0, -1.0])) @ com[stance.frame] * -1.0,
        )
        for i in stance.limbs:
            p = standing[stance.frame, robot.limb_names[i]]
            for patch, border, share in zip(
                course.footholds[p].candidates, borders[p], shares[p], strict=True
            ):
                for u, vertex in enumerate(border):
                    f = cp.Variable(3)  # λ_u f in the contact frame
                    rows += [cp.norm(f[1:]) <= patch.friction * f[0]]
                    rows += [f <= share[u] * course.force_max, f >= share[u] * course.force_min]
                    force = force + patch.frame @ f
                    moment = moment + _times(vertex) @ patch.frame @ f
        rows += [force == 0, moment == 0]
    cost = course.weights.goal * cp.sum_squares(com[frames - 1] - course.goal_m)
    cost += course.weights.tilt * cp.sum_squares(turn)
    cost += course.weights.com_path * cp.sum_squares(com - course.com_nominal_m)
    for k in range(1, frames):
        rows += [cp.norm(com[k] - com[k - 1]) <= course.steps.com_m]
        rows += [cp.norm(turn[k] - turn[k - 1]) <= course.steps.rotation_rad]
        ahead = course.com_nominal_m[k] - course.com_nominal_m[k - 1]
        rows += [(com[k] - com[k - 1]) @ (ahead / np.linalg.norm(ahead)) >= course.steps.progress_m]
        cost += course.weights.com_step * cp.sum_squares(com[k] - com[k - 1])
        for name in robot.limb_names:
            before, after = standing[k - 1, name], standing[k, name]
            if before != after:
                rows += [cp.norm(toes[after] - toes[before]) <= course.steps.toe_m]
                cost += course.weights.toe_step * cp.sum_squares(toes[after] - toes[before])
    return cp.Problem(cp.Minimize(cost), rows), shares


def _times(v: np.ndarray) -> np.ndarray:
    """The matrix of v × ·."""
    return np.cross(v, np.eye(3)).T


@pytest.fixture(scope="session")
def ragged() -> Callable[..., Problem]:
    """``ragged(seed, frames=2, candidates=3, ice=0.3)``: four limbs between two walls, one moves a
    frame.

    A toe has up to so many candidate patches, each of 3 to 5 corners, with no friction at the
    chance of ``ice``. One toe of the first frame already stands where frames > 1. Some seeds have a
    plan and some do not.
    """
    return cache(_ragged)


@pytest.fixture(scope="session")
def bounded() -> Callable[..., Problem]:
    """``bounded(subject, seed, room_m=0.1, of=None)``: every limb, or these, in a polytope about
    its nominal toe.

    Six half-spaces to random sides, each ``room_m`` from where the first toe lies from the nominal
    COM, or less.
    """
    return _bounded


@pytest.fixture(scope="session")
def paired() -> Callable[..., Problem]:
    """``paired(course, seed, room_m=0.2)``: every two feet in a polytope about where they begin
    from one another.

    Six half-spaces to random sides, each ``room_m`` away, or less.
    """
    return _paired


def _paired(course: Problem, seed: int, room_m: float = 0.2) -> Problem:
    rng, found = np.random.default_rng(seed), []
    toes = {
        name: course.footholds[p].candidates[0].centre_m
        for name, p in zip(course.robot.limb_names, course.holds[0], strict=True)
    }
    for limb, other in itertools.permutations(course.robot.limb_names, 2):
        normals = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        normals, size = np.vstack([normals, -normals]), rng.uniform(0.5, 2.0, 6)
        bounds = normals @ (toes[other] - toes[limb]) + room_m * rng.uniform(0.6, 1.0, 6)
        rows = ReachRows(normals=size[:, None] * normals, bounds_m=size * bounds)
        found.append(RelativeReach(limb=limb, other=other, rows=rows))
    return replace(course, robot=replace(course.robot, relative_reach=tuple(found)))


def _bounded(
    subject: Problem, seed: int, room_m: float = 0.1, of: Sequence[str] | None = None
) -> Problem:
    rng = np.random.default_rng(seed)

    def rows(name: str, toe: np.ndarray, com: np.ndarray) -> ReachRows | None:
        normals = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        normals, size = np.vstack([normals, -normals]), rng.uniform(0.5, 2.0, 6)
        bounds = normals @ (toe - com) + room_m * rng.uniform(0.6, 1.0, 6)
        return (
            ReachRows(normals=size[:, None] * normals, bounds_m=size * bounds)
            if of is None or name in of
            else None
        )

    if subject.is_posture:
        each = [
            (c, rows(c.leg, c.patch.centre_m, subject.com_nominal_m[0])) for c in subject.contacts
        ]
        return subject.posture_with(
            contacts=tuple(replace(contact, reach_rows=its) for contact, its in each)
        )
    limbs = []
    for limb, first in zip(subject.robot.limbs, subject.holds[0], strict=True):
        toe = subject.footholds[first].candidates[0].centre_m
        limbs.append(replace(limb, reach_rows=rows(limb.name, toe, subject.com_nominal_m[0])))
    return replace(subject, robot=replace(subject.robot, limbs=tuple(limbs)))


@pytest.fixture(scope="session")
def soled() -> Callable[..., Problem]:
    """``soled(subject, seed)``: every second foot a small sole of three or four points, at its
    candidate's own yaw.
    """
    return _soled


def _soled(subject: Problem, seed: int) -> Problem:
    rng = np.random.default_rng(seed)

    def sole(i: int) -> np.ndarray | None:
        corners = np.array([[6e-3, 3e-3], [5e-3, -3e-3], [-4e-3, -3e-3], [-4e-3, 3e-3]])
        return corners[: 3 + (i // 2) % 2] if i % 2 == 0 else None

    if subject.is_posture:
        contacts = (
            replace(contact, sole_m=sole(i), yaw_rad=float(rng.uniform(-3.0, 3.0)))
            for i, contact in enumerate(subject.contacts)
        )
        return subject.posture_with(contacts=tuple(contacts))
    limbs = tuple(replace(limb, sole_m=sole(i)) for i, limb in enumerate(subject.robot.limbs))
    puts = (
        replace(put, yaws_rad=tuple(rng.uniform(-3.0, 3.0, len(put.candidates))))
        for put in subject.footholds
    )
    return replace(subject, robot=replace(subject.robot, limbs=limbs), footholds=tuple(puts))


@pytest.fixture(scope="session")
def near() -> Callable[[Scaled, int], Point]:
    """``near(scaled, seed)``: toes on one candidate a foothold, body and forces about nominal."""
    return _near


def _ragged(seed: int, frames: int = 2, candidates: int = 3, ice: float = 0.3) -> Problem:
    rng = np.random.default_rng(seed)
    robot = Robot(name="four", mass_kg=10.0, limbs=hexapod().select(FOUR))
    com = np.array([[0.0, 0.0, CLIMB_M * k] for k in range(frames)])
    lifts = ((), *((FOUR[k % 4],) for k in range(frames - 1)))
    footholds = []
    for k in range(frames):
        for limb in robot.limbs:
            if k == 0 or limb.name in lifts[k]:
                stands = k == 0 and frames > 1 and limb.name == FOUR[1]
                count = 1 if stands else int(rng.integers(1, candidates + 1))
                patches = tuple(
                    _patch(rng, com[k], limb, 0.0 if stands else ice) for _ in range(count)
                )
                toe = patches[0].vertices_m.mean(axis=0) if stands else None
                footholds.append(Foothold(limb=limb.name, frame=k, candidates=patches, toe_m=toe))
    return Problem(
        name=f"ragged-{seed}",
        robot=robot,
        terrain=tuple(p for put in footholds for p in put.candidates),
        footholds=tuple(footholds),
        lifts=lifts,
        next_lift=(FOUR[(frames - 1) % 4],) if frames == 1 else (),
        com_nominal_m=com,
        com_radius_m=np.full(frames, 0.05),
        goal_m=com[-1] + rng.uniform(-0.1, 0.1, 3),
        steps=StepLimits(com_m=0.09, toe_m=0.3, progress_m=0.01),
        weights=Weights(com_path=0.03),
    )


def _patch(rng: np.random.Generator, com: np.ndarray, limb: Limb, ice: float) -> Patch:
    side = np.sign(limb.shoulder_m[1])
    normal = np.array([rng.uniform(-0.25, 0.25), -side, rng.uniform(-0.25, 0.25)])
    normal /= np.linalg.norm(normal)
    first = np.cross(normal, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    count = int(rng.integers(3, 6))
    angle = -2.0 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    corners = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), np.cross(first, normal))
    away = [0.06 * np.sign(limb.shoulder_m[0]) + limb.shoulder_m[0], side * 0.36, -0.03]
    centre = com + away + rng.uniform(-0.06, 0.06, 3)
    friction = 0.0 if rng.random() < ice else rng.uniform(0.35, 0.9)
    return Patch(
        vertices_m=centre + 0.07 * corners,
        normal=normal,
        shear_reference=[0.0, 0.0, 1.0],
        friction=friction,
    )


def _near(scaled: Scaled, seed: int) -> Point:
    rng, layout = np.random.default_rng(seed), scaled.layout
    weights = rng.uniform(0.1, 1.0, len(layout.vertex_footholds))
    weights /= np.bincount(layout.vertex_footholds, weights)[layout.vertex_footholds]
    toes = np.zeros((layout.footholds, 3))
    np.add.at(toes, layout.vertex_footholds, weights[:, None] * scaled.vertices)
    return Point(
        com=scaled.com + rng.normal(scale=0.02, size=scaled.com.shape),
        rotation=rng.normal(scale=0.02, size=scaled.com.shape),
        toes=toes,
        forces=rng.uniform(0.1, 0.6, (len(layout.contacts[0]), 3)),
        residual=float("inf"),
    )
