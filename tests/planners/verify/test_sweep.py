"""One sweep over many stances says what the check of each alone says."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from stancekit import Motion
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import BETWEEN, GROUPS, check_plan, check_postures
from stancekit.planners.verify.geometry import patch_distances

SEEDS = st.integers(0, 2**32 - 1)
OF_ALL_LIMBS = ("patch", "reach")  # of limbs that carry nowhere, too


def perturbed(plan, rng, size):
    """The plan with noise in everything."""
    noise = {"com_m": 0.01, "rotation_rad": 0.05, "toes_m": 0.01, "forces_n": 5.0}
    return replace(
        plan,
        **{
            n: getattr(plan, n) + size * s * rng.normal(size=getattr(plan, n).shape)
            for n, s in noise.items()
        },
    )


@given(
    SEEDS, st.sampled_from(["tripod", "wave", "shift", "all"]), st.sampled_from([1e-6, 1e-2, 1.0])
)
@settings(max_examples=30, deadline=None)
def test_the_sweep_finds_what_the_check_of_every_stance_finds(walk, seed, gait, size):
    rng = np.random.default_rng(seed)
    plan = perturbed(walk(int(rng.integers(1, 6)), gait), rng, size)
    course = plan.problem
    worst = dict.fromkeys(GROUPS, (0.0, -1))
    for row, stance in enumerate(course.stances):
        for group in check_plan(plan.posture(row)).groups:
            if group.worst > worst[group.name][0]:
                worst[group.name] = (group.worst, stance.frame)
    looked = 0
    for group in check_plan(plan, between=False).groups:
        if group.name in GROUPS:
            value, frame = worst[group.name]
            assert group.worst >= value - 1e-12
            if group.name not in OF_ALL_LIMBS:
                looked += 1
                assert group.worst == pytest.approx(value, abs=1e-12)
                assert group.frame == frame or value < 1e-9
    assert looked == 6


@given(SEEDS, st.sampled_from(["tripod", "wave", "shift"]))
@settings(max_examples=20, deadline=None)
def test_the_sweep_finds_what_the_check_of_every_point_between_finds(walk, seed, gait):
    plan = perturbed(walk(4, gait), np.random.default_rng(seed), 0.3)
    course, names = plan.problem, plan.problem.robot.limb_names
    worst = 0.0
    for k in range(course.frames - 1):
        stay = tuple(i for i, name in enumerate(names) if name not in course.lifts[k + 1])
        rows = [
            next(r for r, s in enumerate(course.stances) if s == replace(s, frame=f, limbs=stay))
            for f in (k, k + 1)
        ]
        for t in BETWEEN:
            mixed = {
                name: (1 - t) * getattr(plan, name)[k] + t * getattr(plan, name)[k + 1]
                for name in ("com_m", "rotation_rad")
            }
            forces = (1 - t) * plan.forces_n[rows[0]] + t * plan.forces_n[rows[1]]
            problem = course.posture_problem(course.stances[rows[0]], plan.choice).posture_with(
                com_nominal_m=(1 - t) * course.com_nominal_m[k] + t * course.com_nominal_m[k + 1],
                com_radius_m=(1 - t) * course.com_radius_m[k] + t * course.com_radius_m[k + 1],
            )
            on = list(stay)
            posture = Motion.of_posture(
                problem, **mixed, toes_m=plan.toes_at(k)[on], forces_n=forces[on]
            )
            worst = max(worst, check_plan(posture).worst)
    assert check_plan(plan).figures["between"] == pytest.approx(worst, rel=1e-12)


def test_many_postures_at_once_are_judged_as_each_alone():
    rng, postures = np.random.default_rng(0), []
    for k in range(40):
        problem = DISTRIBUTIONS[("wall-3", "wall-5", "ground-3")[k % 3]].sample(rng)
        toes = [c.patch.centre_m + rng.normal(0, 0.03, 3) for c in problem.contacts]
        com, rotation, forces = (
            rng.normal(0, 0.1, 3),
            rng.normal(0, 0.2, 3),
            rng.normal(0, 80, (len(toes), 3)),
        )
        bad = {
            7: {"toes_m": toes[:-1]},
            11: {"com_m": com * np.nan},
            13: {"forces_n": 1e300 * forces},
        }.get(k, {})
        values = {"com_m": com, "rotation_rad": rotation, "toes_m": toes, "forces_n": forces} | bad
        postures.append(Motion.of_posture(problem, **values))
    found = check_postures(postures)
    alone = [check_plan(posture).worst for posture in postures]
    np.testing.assert_allclose(found, alone, rtol=1e-12)
    assert np.isinf(found).sum() == 3
    assert check_postures([]).shape == (0,)


def test_a_toe_off_a_patch_of_many_corners_is_measured_in_no_time():
    """Triangles of three corners would be 2.7 million; the figure is that of a flat disc within its
    rounding.
    """
    angles = 2 * np.pi * np.arange(256) / 256
    disc = np.round(np.column_stack([0.3 * np.cos(angles), 0.3 * np.sin(angles), 0.0 * angles]), 4)
    disc[:, 2] = np.random.default_rng(0).choice([0.0, 1e-4], 256)
    patch = Patch(vertices_m=disc, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.5)
    above, beside = np.array([0.05, 0.02, 0.01]), np.array([0.5, 0.0, 0.0])
    found = patch_distances([patch.vertices_m] * 2, np.array([above, beside]))
    assert found == pytest.approx([0.01, 0.2], abs=2e-4)
    inside = np.random.default_rng(1).dirichlet(np.ones(256)) @ disc
    assert patch_distances([disc], inside[None])[0] < 1e-12


@given(SEEDS)
@settings(max_examples=40, deadline=None)
def test_the_distance_from_a_thin_body_is_that_from_its_nearest_face(seed):
    """Of four points: 0 in the tetrahedron, else the least of four triangles, by projection onto
    planes and edges.
    """
    rng = np.random.default_rng(seed)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.05
    corners[:, 2] = rng.uniform(-1e-4, 1e-4, 4)
    point = np.array(
        [*rng.uniform(-0.07, 0.07, 2), rng.choice([0.0, 1e-4, 0.02]) * rng.uniform(-1, 1)]
    )
    shares = np.linalg.solve(np.vstack([corners.T, np.ones(4)]), np.append(point, 1.0))
    faces = [distance_from_triangle(np.delete(corners, k, axis=0), point) for k in range(4)]
    expected = 0.0 if shares.min() >= 0.0 else min(faces)
    assert patch_distances([corners], point[None])[0] == pytest.approx(expected, abs=1e-12)


def distance_from_triangle(corners, point):
    """Where the foot of the perpendicular is inside, its length; else the distance from an edge."""
    a, b, c = corners
    foot = np.linalg.lstsq(np.column_stack([b - a, c - a]), point - a, rcond=None)[0]
    if foot.min() >= 0.0 and foot.sum() <= 1.0:
        return np.linalg.norm(a + foot @ np.array([b - a, c - a]) - point)
    ends = [(a, b), (b, c), (c, a)]
    shares = [np.clip((point - p) @ (q - p) / ((q - p) @ (q - p)), 0.0, 1.0) for p, q in ends]
    return min(
        np.linalg.norm(p + t * (q - p) - point) for (p, q), t in zip(ends, shares, strict=True)
    )


def test_the_verifier_brings_no_solver_with_it():
    solvers = {"cvxpy", "clarabel", "casadi", "pinocchio", "highspy", "pyscipopt"}
    code = f"import sys, stancekit.planners.verify; print(sorted({solvers!r} & set(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"
