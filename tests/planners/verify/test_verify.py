"""The verifier against closed forms, slow references and solvers it does not know."""

from __future__ import annotations

import hashlib
import itertools
import json
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import nnls

from stancekit import Certificate, Motion
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import GROUPS, check_certificate, check_plan, explain, geometry
from stancekit.planners.verify.geometry import cut, sag, triangle_distances
from stancekit.planners.verify.lagrangian import least_works
from tests.refusals import assert_names

SEEDS = st.integers(0, 2**32 - 1)
LEAF = [[0.0, 0.0, 0.0, 0.0, 0.0]]
WEIGHT_N = 98.1
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])


def ground(
    leg="RF",
    *,
    centre=(0.0, 0.0, -0.2),
    half=0.05,
    friction=0.6,
    shoulder=(0.0, 0.0, 0.0),
    reach=0.35,
    most=2.0,
):
    patch = Patch(
        vertices_m=np.array(centre) + half * SQUARE,
        normal=[0, 0, 1],
        shear_reference=[1, 0, 0],
        friction=friction,
    )
    return Contact(
        leg=leg,
        shoulder_m=shoulder,
        reach_m=reach,
        patch=patch,
        force_min=[0, -1, -1],
        force_max=[most, 1, 1],
    )


def wall(leg, side, *, friction=0.6, most=1.0, y=0.4, reach=0.35):
    corners = np.column_stack([0.05 * SQUARE[:, 0], np.full(4, side * y), 0.05 * SQUARE[:, 1]])
    patch = Patch(
        vertices_m=corners, normal=[0, -side, 0], shear_reference=[0, 0, 1], friction=friction
    )
    return Contact(
        leg=leg,
        shoulder_m=[0, 0.18 * side, 0],
        reach_m=reach,
        patch=patch,
        force_min=[0, -1, -1],
        force_max=[most, 1, 1],
    )


def problem_of(*contacts, com=(0.0, 0.0, 0.0), radius=0.08, **rest):
    return Problem.posture(
        contacts=contacts, mass_kg=10.0, com_nominal_m=com, com_radius_m=radius, **rest
    )


def standing(*, com=(0, 0, 0), rotation=(0, 0, 0), toe=(0, 0, -0.2), force=(0, 0, WEIGHT_N)):
    """The posture on one flat patch straight below the COM."""
    return Motion.of_posture(
        problem_of(ground()), com_m=com, rotation_rad=rotation, toes_m=[toe], forces_n=[force]
    )


def bracing(normal_n):
    """Two limbs that press on two facing walls and carry half the weight each."""
    forces = [[0, -normal_n, WEIGHT_N / 2], [0, normal_n, WEIGHT_N / 2]]
    toes = [[0, 0.4, 0], [0, -0.4, 0]]
    problem = problem_of(wall("LM", 1), wall("RM", -1))
    return Motion.of_posture(
        problem, com_m=np.zeros(3), rotation_rad=np.zeros(3), toes_m=toes, forces_n=forces
    )


def check_posture(problem, posture, **tolerance):
    return check_plan(replace(posture, problem=problem), **tolerance)


def violations(report):
    return {g.name: g.value for g in report.groups if g.worst > 1e-9}


# ----------------------------------------------------------------------------------------------------
# postures


def test_a_vertical_force_of_the_weight_below_the_com_is_accepted():
    report = check_posture(problem_of(ground()), standing())
    assert report.accepted
    assert report.worst < 1e-15
    assert report.figures["residual_nm"] == 0.0
    assert tuple(g.name for g in report.groups) == tuple(GROUPS)


def test_two_walls_brace_when_friction_carries_the_weight():
    problem = problem_of(wall("LM", 1, friction=0.6), wall("RM", -1, friction=0.6))
    assert check_posture(problem, bracing(WEIGHT_N / 2 / 0.6)).accepted
    assert not check_posture(problem, bracing(WEIGHT_N / 2 / 0.6 * 0.999)).accepted


@pytest.mark.parametrize(
    ("problem", "posture", "group", "value", "scale", "where"),
    [
        (
            problem_of(ground()),
            standing(com=(0.06, 0, 0), toe=(0.06, 0, -0.2)),
            "patch",
            0.01,
            0.6,
            "RF",
        ),
        (
            problem_of(ground()),
            standing(com=(0, 0, 0.02), toe=(0, 0, -0.18)),
            "patch",
            0.02,
            0.6,
            "RF",
        ),
        (
            problem_of(ground()),
            standing(force=(0, 0, WEIGHT_N + 5)),
            "force_balance",
            5.0,
            WEIGHT_N,
            "z",
        ),
        (
            problem_of(ground()),
            standing(com=(0.03, 0, 0)),
            "moment_balance",
            0.03 * WEIGHT_N,
            0.6 * WEIGHT_N,
            "y",
        ),
        (
            problem_of(wall("LM", 1), wall("RM", -1)),
            bracing(70.0),
            "friction",
            WEIGHT_N / 2 - 42.0,
            WEIGHT_N,
            "LM",
        ),
        (
            problem_of(wall("LM", 1), wall("RM", -1)),
            bracing(100.0),
            "force_bounds",
            1.9,
            WEIGHT_N,
            "LM n",
        ),
        (problem_of(ground(reach=0.21)), standing(com=(0, 0, 0.03)), "reach", 0.02, 0.6, "RF"),
        (problem_of(ground()), standing(rotation=(0, -0.2718, 0)), "tilt", 0.01, 1.0, "y"),
        (
            problem_of(ground(), radius=0.02),
            standing(com=(0, 0.03, 0), toe=(0, 0.03, -0.2)),
            "com",
            0.01,
            0.6,
            "",
        ),
    ],
)
def test_what_is_broken_trips_its_own_group_by_its_own_amount(
    problem, posture, group, value, scale, where
):
    report = check_posture(problem, posture)
    assert violations(report) == {group: pytest.approx(value, rel=1e-9)}
    tripped = next(g for g in report.groups if g.name == group)
    assert tripped.worst == pytest.approx(value / scale, rel=1e-9) == report.worst
    assert (tripped.where, tripped.unit) == (where, GROUPS[group])
    assert not report.accepted
    assert check_posture(problem, posture, tolerance=1.001 * report.worst).accepted
    assert_names(report.message, group, *([where] if where else []), f"{value:.3g}")


def test_the_rotation_moves_the_shoulders_by_its_cross_product():
    contact = ground(shoulder=(0.2, 0, 0), centre=(0.0, 0, -0.2), half=0.3, reach=0.2)
    posture = standing(com=(0, 0, 0), rotation=(0, -0.1, 0), toe=(0, 0, -0.2))
    shoulder = np.array([0.2, 0, 0.02])  # turning by −0.1 about y lifts the front by 0.2 · 0.1
    excess = np.linalg.norm(np.array([0, 0, -0.2]) - shoulder) - 0.2
    report = check_posture(problem_of(contact), posture)
    assert violations(report)["reach"] == pytest.approx(excess, rel=1e-12)
    turned = 0.2 * np.array(
        [np.cos(0.1), 0, np.sin(0.1)]
    )  # and by the exact rotation, which decides nothing
    beyond = np.linalg.norm(np.array([0, 0, -0.2]) - turned) - 0.2
    assert report.figures["exact_reach_m"] == pytest.approx(beyond, rel=1e-12)
    assert report.figures["linearisation_m"] == pytest.approx(
        np.linalg.norm(turned - shoulder), rel=1e-9
    )
    assert 0.0 < report.figures["linearisation_m"] < 0.5 * 0.1**2 * 0.2


@given(SEEDS)
@settings(max_examples=40, deadline=None)
def test_every_group_agrees_with_a_slow_reference_at_random_postures(seed):
    rng = np.random.default_rng(seed)
    problem = DISTRIBUTIONS[rng.choice(["wall-3", "wall-5", "ground-3"])].sample(rng)
    posture = Motion.of_posture(
        problem,
        com_m=rng.normal(0, 0.1, 3),
        rotation_rad=rng.normal(0, 0.2, 3),
        toes_m=[c.patch.centre_m + rng.normal(0, 0.03, 3) for c in problem.contacts],
        forces_n=rng.normal(0, 80, (len(problem.contacts), 3)),
    )
    got = {g.name: g.value for g in check_posture(problem, posture).groups}
    x, y, z = posture.rotation_rad[0]
    turned = np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    net, moment = np.array([0, 0, -problem.weight_n]), np.zeros(3)
    worst = dict.fromkeys(("friction", "force_bounds", "reach", "patch"), 0.0)
    for contact, toe, force in zip(
        problem.contacts, posture.toes_m, posture.forces_n[0], strict=True
    ):
        net, moment = net + force, moment + np.cross(toe - posture.com_m[0], force)
        f = contact.patch.frame.T @ force
        outside = np.maximum(
            contact.force_min * WEIGHT_N - f, f - contact.force_max * WEIGHT_N
        ).max()
        arm = np.linalg.norm(toe - posture.com_m[0] - turned @ contact.shoulder_m)
        found = {
            "friction": np.hypot(f[1], f[2]) - contact.patch.friction * f[0],
            "force_bounds": outside,
            "reach": arm - contact.reach_m,
            "patch": hull_distance(contact.patch.vertices_m, toe),
        }
        worst = {name: max(value, found[name]) for name, value in worst.items()}
    worst["force_balance"], worst["moment_balance"] = np.linalg.norm(net), np.linalg.norm(moment)
    worst["tilt"] = max(0.0, np.abs(posture.rotation_rad).max() - problem.tilt_limit_rad)
    worst["com"] = max(
        0.0, np.linalg.norm(posture.com_m - problem.com_nominal_m[0]) - problem.com_radius_m[0]
    )
    assert got == pytest.approx(worst, abs=1e-7)


def hull_distance(vertices, point):
    """By non-negative least squares with the sum of the weights held by a large row."""
    rows = np.vstack([(vertices - point).T, np.full(len(vertices), 1e3)])
    weights, _ = nnls(rows, np.array([0, 0, 0, 1e3]))
    return float(np.linalg.norm((weights / weights.sum()) @ vertices - point))


def polygon_patch(rng, *, bend=0.0, corners=None):
    """A convex polygon in any plane, in either direction, its corners off the plane by up to
    ``bend`` diameters.
    """
    count = corners or int(rng.integers(3, 9))
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    flat = np.column_stack([0.08 * np.cos(angles), 0.05 * np.sin(angles)])[:: rng.choice([-1, 1])]
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    heights = bend * 0.1 * rng.uniform(-1, 1, count)
    vertices = rng.normal(0, 0.3, 3) + flat @ axes[:2] + heights[:, None] * axes[2]
    return Patch(
        vertices_m=vertices, normal=axes[2], shear_reference=axes[0] + 0.3 * axes[2], friction=0.5
    )


def on_patch(patch, toe):
    contact = replace(ground(), patch=patch)
    report = check_posture(problem_of(contact), standing(toe=toe))
    return next(g for g in report.groups if g.name == "patch").value


@given(SEEDS, st.sampled_from([0.0, 1.5e-3]))
@settings(max_examples=60, deadline=None)
def test_the_patch_distance_is_that_from_the_convex_hull(seed, bend):
    rng = np.random.default_rng(seed)
    patch = polygon_patch(rng, bend=bend)
    toe = patch.centre_m + rng.normal(0, 0.05, 3)
    assert on_patch(patch, toe) == pytest.approx(hull_distance(patch.vertices_m, toe), abs=1e-7)


@pytest.mark.parametrize("name", ["com_m", "rotation_rad", "toes_m", "forces_n"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, "shape", "scalar"])
def test_what_is_no_posture_is_rejected_without_an_exception(name, bad):
    posture = standing()
    values = {each: np.array(value) for each, value in posture.to_json().items()}
    if bad == "shape":
        values[name] = np.zeros((2, 3))
    elif bad == "scalar":
        values[name] = 0.0
    else:
        values[name] = values[name].copy()
        values[name].flat[1] = bad
    report = check_plan(
        Motion.of_posture(problem_of(ground()), **values),
        tolerance=np.inf if bad != 1e300 else 1e-6,
    )
    assert not report.accepted
    if bad != 1e300:
        assert report.worst == np.inf
        assert_names(report.message, name)
        assert all(g.worst == np.inf for g in report.groups)
    json.dumps(report.to_json(), allow_nan=False)


def test_a_tolerance_that_is_no_number_accepts_nothing():
    assert not check_posture(problem_of(ground()), standing(), tolerance=float("nan")).accepted


def canonical(data):
    return json.dumps(data, sort_keys=True, separators=(",", ":")).encode()


def test_the_digest_is_that_of_the_canonical_json_and_changes_with_anything():
    problem, posture = problem_of(ground()), standing()
    report = check_posture(problem, posture)
    head = {"question": problem.to_json(), "provenance": {}}
    answer = hashlib.sha256(canonical(head))
    for name, array in sorted(report.answer.arrays().items()):
        answer.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode() + array.tobytes())
    told = {"accepted": True, "tolerance": 1e-6, "checked": ["contacts"], "limits": {}}
    content = canonical({**told, "answer": answer.hexdigest()})
    assert report.digest == hashlib.sha256(content).hexdigest()
    assert report.digest == check_posture(Problem.from_json(problem.to_json()), standing()).digest
    others = [
        check_posture(problem.posture_with(mass_kg=np.nextafter(10.0, 11.0)), posture),
        check_posture(problem, standing(com=(5e-324, 0, 0))),
        check_posture(problem, posture, tolerance=2e-6),
        check_posture(problem_of(ground(friction=0.61)), posture),
        check_posture(problem_of(ground("RR")), posture),
        replace(report, defect="no posture"),
    ]
    assert len({report.digest, *(other.digest for other in others)}) == 7


def test_a_report_goes_to_json():
    report = check_posture(problem_of(ground()), standing(force=(0, 0, 100.0)))
    data = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert data["accepted"] is False
    assert data["digest"] == report.digest
    assert [g["group"] for g in data["groups"]] == list(GROUPS)
    assert data["figures"]["residual_nm"] == 0.0


# ------------------------------------------------------------------------------------- the least
# work of a force


def random_forces(rng, count):
    """Directions, boxes and frictions with every degeneracy: zeros, thin boxes, no friction, boxes
    off the cone.
    """
    a = rng.normal(size=(count, 3)) * rng.choice([0, 1, 1, 1, 0.01], size=(count, 3))
    lower = rng.uniform(-1, 1, size=(count, 3))
    lower[:, 0] = rng.choice([0, 0, -0.2, 0.1, 0.4], size=count)
    width = rng.uniform(0, 1, size=(count, 3)) * rng.choice([0, 1, 1, 1, 1e-3], size=(count, 3))
    wide = rng.random(count) < 0.4
    lower[wide, 1:], width[wide, 1:] = -1.0, 2.0
    friction = rng.choice([0, 0, 0.1, 0.3, 0.7, 1, 1.2, 3], size=count)
    lower[friction == 0, 0] = np.abs(lower[friction == 0, 0])
    return a, lower, lower + width, friction


def least_work_by_search(a, lower, upper, friction):
    """Primal: for a fixed f_n the best corner of rectangle and disc; zoom in on f_n, in which it is
    convex.
    """
    (_, y0, z0), (top, y1, z1) = lower, upper
    bottom = max(lower[0], 0.0)
    nearest = np.hypot(max(y0, -y1, 0), max(z0, -z1, 0))
    if top < bottom or nearest > friction * top:
        return None
    bottom = min(max(bottom, nearest / friction if friction else 0.0), top)
    tangent, best = np.hypot(a[1], a[2]), np.inf
    for _ in range(6):
        n = np.linspace(bottom, top, 41)
        disc, flat = friction * n, np.zeros_like(n)
        points = [
            (flat + y, flat + z)
            for y in (y0, y1, np.clip(0, y0, y1))
            for z in (z0, z1, np.clip(0, z0, z1))
        ]
        for sign in (-1, 1):
            points += [(flat + y, sign * np.sqrt(np.maximum(disc**2 - y * y, 0))) for y in (y0, y1)]
            points += [(sign * np.sqrt(np.maximum(disc**2 - z * z, 0)), flat + z) for z in (z0, z1)]
        points.append((-disc * a[1] / max(tangent, 1e-300), -disc * a[2] / max(tangent, 1e-300)))
        y, z = np.array(points).swapaxes(0, 1)
        inside = (y > y0 - 1e-13) & (y < y1 + 1e-13) & (z > z0 - 1e-13) & (z < z1 + 1e-13)
        value = np.where(
            inside & (np.hypot(y, z) < disc + 1e-13), a[0] * n + a[1] * y + a[2] * z, np.inf
        ).min(axis=0)
        at = int(np.argmin(value))
        best = min(best, value[at])
        bottom, top = n[max(at - 1, 0)], n[min(at + 1, 40)]
    return best


def test_the_least_work_is_tight_against_a_primal_search():
    rows = random_forces(np.random.default_rng(1), 3000)
    got, looked = least_works(*rows)[0], 0
    for value, a, lower, upper, friction in zip(got, *rows, strict=True):
        best = least_work_by_search(a, lower, upper, friction)
        if best is not None:
            looked += 1
            assert value <= best + 1e-11
            assert value >= best - 1e-7, (a, lower, upper, friction)
    assert looked > 1000


@pytest.mark.parametrize("slack", [0.0, 1e-3])
def test_no_force_of_box_and_cone_does_less_than_the_least_work(slack):
    rng = np.random.default_rng(2)
    a, lower, upper, friction = random_forces(rng, 5000)
    bound, looked = least_works(a, lower, upper, friction, slack)[bool(slack)], 0
    for _ in range(60):
        shares = rng.choice([0.0, 1.0, rng.uniform()], size=a.shape)
        force = lower - slack + shares * (upper - lower + 2 * slack)
        shear = np.linalg.norm(force[:, 1:], axis=1)
        force[:, 1:] *= np.minimum(
            1, np.maximum(friction * force[:, 0] + slack, 0) / np.maximum(shear, 1e-9)
        )[:, None]
        held = np.all((force >= lower - slack) & (force <= upper + slack), axis=1)
        held &= np.linalg.norm(force[:, 1:], axis=1) <= friction * force[:, 0] + slack
        looked += held.sum()
        assert np.all(((a * force).sum(axis=1) >= bound - 1e-12)[held])
    assert looked > 50_000


def test_the_least_work_agrees_with_a_conic_solver():
    rows = random_forces(np.random.default_rng(3), 60)
    f, a, low, high, mu = (
        cp.Variable(3),
        cp.Parameter(3),
        cp.Parameter(3),
        cp.Parameter(3),
        cp.Parameter(nonneg=True),
    )
    model = cp.Problem(cp.Minimize(a @ f), [f >= low, f <= high, cp.norm(f[1:]) <= mu * f[0]])
    looked = 0
    for value, *row in zip(least_works(*rows)[0], *rows, strict=True):
        a.value, low.value, high.value, mu.value = row
        model.solve(solver=cp.CLARABEL)
        if model.status == "optimal":
            looked += 1
            assert value == pytest.approx(model.value, abs=1e-6)
    assert looked > 20


# ----------------------------------------------------------------------------------------------
# certificates


def certificate(*, force=(0, 0, 0), moment=(0, 0, 0), reach=((0, 0, 0),), tree=LEAF, leaves=1):
    row = np.concatenate([force, moment, np.ravel(reach)])
    return Certificate(tree=tree, multipliers=np.tile(row, (leaves, 1)))


def test_a_frictionless_wall_holds_no_weight_and_friction_is_what_is_missing():
    proof = certificate(force=(0, 0, -1))  # the weight less what the wall carries
    report = check_certificate(proof.of(problem_of(wall("LM", 1, friction=0.0))))
    assert report.accepted
    assert report.figures["lower_bound"] == np.inf
    assert (
        json.loads(json.dumps(report.to_json(), allow_nan=False))["figures"]["lower_bound"] is None
    )
    assert not check_certificate(proof.of(problem_of(wall("LM", 1, friction=1.2)))).accepted
    needs = explain(proof.of(problem_of(wall("LM", 1, friction=0.5))))
    assert [(r.parameter, r.leg) for r in needs.relaxations[:2]] == [
        ("friction", "LM"),
        ("force_max", "LM"),
    ]
    assert needs.relaxations[0].needed == pytest.approx(1.0, rel=1e-4)  # μ · 1 · m g = m g
    assert needs.relaxations[0].relative == pytest.approx(1.0, rel=1e-4)
    assert needs.relaxations[1].needed == pytest.approx(2 * WEIGHT_N, rel=1e-4)
    assert all(r.needed == np.inf for r in needs.relaxations[2:])
    assert_names(needs.message, "infeasible", "friction of LM", "0.5", "1")
    json.dumps(needs.to_json(), allow_nan=False)


def test_a_patch_out_of_reach_needs_the_missing_length_of_reach_or_com():
    problem = problem_of(
        wall("LM", 1, y=0.7)
    )  # the shoulder comes to 0.18 + 0.08 (COM): 0.09 m are missing
    proof = certificate(reach=[(0, 1, 0)])
    assert check_certificate(proof.of(problem)).figures["lower_bound"] == np.inf
    needed = {r.parameter: r.needed for r in explain(proof.of(problem)).relaxations}
    assert needed["reach"] == pytest.approx(0.44, abs=1e-5)
    assert needed["com_radius"] == pytest.approx(0.17, abs=1e-5)
    assert needed["friction"] == needed["force_max"] == np.inf
    tilted = explain(certificate(reach=[(0.1, 0.995, 0)]).of(problem_of(wall("LM", 1, y=0.63))))
    assert {r.parameter for r in tilted.relaxations if np.isfinite(r.needed)} == {
        "reach",
        "com_radius",
        "tilt_limit",
    }


def test_a_foot_beside_the_com_leaves_the_moment_of_its_distance():
    """q_x ≥ d − h, c_x ≤ R: the moment about y is (d − h − R) m g at least."""
    problem = problem_of(ground(centre=(0.25, 0, -0.2)))
    proof = certificate(force=(-0.2 / 0.6, 0, -0.2 / 0.6), moment=(0, -1, 0))
    report = check_certificate(proof.of(problem))
    assert report.figures["lower_bound"] == pytest.approx((0.25 - 0.05 - 0.08) / 0.6, rel=1e-9)
    assert_names(report.message, "11.8 Nm")
    refused = check_certificate(proof.of(problem), tolerance=0.21)
    assert not refused.accepted
    assert_names(refused.message, "leaf 0", "0.2", "0.21")
    needs = explain(proof.of(problem))
    assert needs.relaxations[0].parameter == "com_radius"
    assert needs.relaxations[0].needed == pytest.approx(0.2 - 1e-4 * 0.6, abs=1e-5)


def test_a_leaf_is_called_empty_just_where_no_force_is_in_box_and_cone():
    nothing, seen = certificate(), {True: 0, False: 0}
    for _, lower, upper, friction in zip(
        *random_forces(np.random.default_rng(6), 400), strict=True
    ):
        contact = replace(ground(friction=friction), force_min=lower, force_max=upper)
        empty = least_work_by_search(np.ones(3), lower, upper, friction) is None
        assert (
            check_certificate(nothing.of(problem_of(contact))).figures["lower_bound"] == np.inf
        ) is empty
        seen[empty] += 1
    assert min(seen.values()) > 100


def lift_certificate(problem):
    """The root relaxation by cvxpy, sharing nothing with the planners: its least moment residual
    and its duals.
    """
    length, w = problem.length_scale_m, problem.weight_n / problem.force_scale_n
    com, theta, left = cp.Variable(3), cp.Variable(3), cp.Variable(3)
    rows = [cp.norm(com - problem.com_nominal_m[0] / length) <= problem.com_radius_m[0] / length]
    rows.append(cp.abs(theta) <= problem.tilt_limit_rad)
    force, moment, reach = 0, 0, []
    for contact in problem.contacts:
        frame, vertices, shoulder = (
            contact.patch.frame,
            contact.patch.vertices_m / length,
            contact.shoulder_m / length,
        )
        share, f, limb = (
            cp.Variable(len(vertices), nonneg=True),
            cp.Variable((len(vertices), 3)),
            cp.Variable(3),
        )
        rows += [cp.sum(share) == 1, cp.norm(limb) <= contact.reach_m / length]
        rows += [f >= cp.outer(share, contact.force_min), f <= cp.outer(share, contact.force_max)]
        rows += [cp.norm(f[:, 1:], axis=1) <= contact.patch.friction * f[:, 0]]
        force = force + frame @ cp.sum(f, axis=0)
        moment = moment + sum(np.cross(v, frame.T).T @ f[u] for u, v in enumerate(vertices))
        turned = np.cross(shoulder, np.eye(3)).T @ theta  # −Θ × s = s × Θ
        reach.append(vertices.T @ share - com - shoulder + turned == limb)
    balance = force == np.array([0, 0, w])
    moments = moment - cp.hstack([w * com[1], -w * com[0], 0]) == left
    model = cp.Problem(cp.Minimize(cp.norm_inf(left)), [*rows, balance, moments, *reach])
    model.solve(solver=cp.CLARABEL)
    if model.status != "optimal":
        return None, None
    duals = [balance.dual_value, moments.dual_value, *(row.dual_value for row in reach)]
    return model.value, certificate(force=duals[0], moment=duals[1], reach=duals[2:])


@pytest.fixture(scope="module")
def refuted():
    """Problems with a certificate of the root relaxation, and its bound."""
    rng, found = np.random.default_rng(0), []
    while len(found) < 6:
        problem = DISTRIBUTIONS[("wall-3", "wall-5")[len(found) % 2]].sample(rng)
        value, proof = lift_certificate(problem)
        if value is not None and value > 2e-3:
            found.append((problem, proof, value))
    return found


def test_the_certified_bound_is_the_relaxations_optimum(refuted):
    for problem, proof, value in refuted:
        report = check_certificate(proof.of(problem))
        assert report.accepted
        assert value - 1e-6 < report.figures["lower_bound"] < value + 1e-6


def test_multipliers_may_have_any_length(refuted):
    problem, proof, _ = refuted[0]
    bound = check_certificate(proof.of(problem)).figures["lower_bound"]
    for factor in (1e-200, 3.0, 1e200):
        scaled = Certificate(tree=proof.tree, multipliers=factor * proof.multipliers)
        assert check_certificate(scaled.of(problem)).figures["lower_bound"] == pytest.approx(
            bound, rel=1e-9
        )
    assert not check_certificate(
        Certificate(tree=LEAF, multipliers=0 * proof.multipliers).of(problem)
    ).accepted


def random_tree(rng, problem, depth=4):
    """A tree of random splits and cuts, and its number of leaves."""
    polygons = [contact.patch.vertices_m for contact in problem.contacts]
    boxes = [np.array([contact.force_min, contact.force_max]) for contact in problem.contacts]

    def grow(polygons, boxes, depth):
        if depth == 0 or rng.random() < 0.2:
            return LEAF
        i = int(rng.integers(len(polygons)))
        if rng.random() < 0.5:
            k = int(rng.integers(3))
            at = rng.uniform(*boxes[i][:, k])
            node, children = [3, i, k, at, 0], []
            for side in (1, 0):
                box = boxes[i].copy()
                box[side, k] = at
                children.append((polygons, [*boxes[:i], box, *boxes[i + 1 :]]))
        else:
            ends = np.sort(rng.uniform(0, len(polygons[i]), 2))
            ends = np.unique(np.floor(ends)) if rng.random() < 0.3 else ends
            if len(ends) < 2:
                return LEAF
            node = [2, i, 0, *ends]
            children = [
                ([*polygons[:i], part, *polygons[i + 1 :]], boxes)
                for part in cut(polygons[i], *ends)
            ]
        return [node, *(row for child in children for row in grow(*child, depth - 1))]

    tree = np.array(grow(polygons, boxes, depth), dtype=float)
    return tree, int(np.sum(tree[:, 0] == 0))


def test_splitting_a_leaf_never_weakens_its_bound(refuted):
    rng = np.random.default_rng(4)
    for problem, proof, value in refuted:
        for _ in range(5):
            tree, leaves = random_tree(rng, problem)
            split = Certificate(tree=tree, multipliers=np.tile(proof.multipliers, (leaves, 1)))
            report = check_certificate(split.of(problem))
            assert report.figures["leaves"] == leaves
            assert (
                report.figures["lower_bound"]
                >= check_certificate(proof.of(problem)).figures["lower_bound"] - 1e-9
            )
            assert value > 0


def test_the_explained_values_are_where_the_certificate_stops_refuting_the_changed_problem(refuted):
    problem, proof, _ = refuted[0]
    looked = 0
    for relaxation in explain(proof.of(problem)).relaxations:
        if np.isfinite(relaxation.needed):
            looked += 1
            grown = relaxation.needed - relaxation.now
            assert check_certificate(proof.of(changed(problem, relaxation, 0.999 * grown))).accepted
            assert not check_certificate(
                proof.of(changed(problem, relaxation, 1.001 * grown))
            ).accepted
    assert looked >= 3
    costs = [r.relative for r in explain(proof.of(problem)).relaxations]
    assert costs == sorted(costs)


def changed(problem, relaxation, by):
    """The problem with one parameter grown by ``by`` (SI)."""
    name = relaxation.parameter
    if name == "com_radius":
        return problem.posture_with(com_radius_m=float(problem.com_radius_m[0]) + by)
    if name == "tilt_limit":
        return replace(problem, tilt_limit_rad=problem.tilt_limit_rad + by)
    contacts = []
    for contact in problem.contacts:
        if contact.leg == relaxation.leg:
            if name == "friction":
                contact = replace(
                    contact, patch=replace(contact.patch, friction=contact.patch.friction + by)
                )
            elif name == "reach":
                contact = replace(contact, reach_m=contact.reach_m + by)
            else:
                contact = replace(
                    contact,
                    force_max=contact.force_max + np.array([by / problem.force_scale_n, 0, 0]),
                )
        contacts.append(contact)
    return problem.posture_with(contacts=tuple(contacts))


def feasible(rng):
    """A problem made around a posture, most of its constraints tight there, and the posture."""
    while True:
        problem = DISTRIBUTIONS[rng.choice(["wall-3", "wall-5", "ground-3"])].sample(rng)
        com, rotation = rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.2, 0.2, 3)
        toes = np.array(
            [rng.dirichlet(np.full(3, 0.3)) @ c.patch.vertices_m for c in problem.contacts]
        )
        maps = [np.vstack([np.eye(3), np.cross(toe - com, np.eye(3)).T]) for toe in toes]
        pull = rng.normal(0, 0.3 * WEIGHT_N, (len(toes), 3))
        wanted = np.array([0, 0, WEIGHT_N, 0, 0, 0]) - np.hstack(maps) @ pull.ravel()
        forces = pull + np.linalg.lstsq(np.hstack(maps), wanted, rcond=None)[0].reshape(-1, 3)
        contacts = []
        for contact, toe, force in zip(problem.contacts, toes, forces, strict=True):
            patch = contact.patch
            patch = patch if force @ patch.normal > 0 else replace(patch, normal=-patch.normal)
            f = patch.frame.T @ force / WEIGHT_N
            friction = np.hypot(f[1], f[2]) / max(f[0], 1e-9)
            arm = toe - com - contact.shoulder_m - np.cross(rotation, contact.shoulder_m)
            contacts.append(
                replace(
                    contact,
                    patch=replace(patch, friction=min(friction, 1e5) + 1e-12),
                    reach_m=np.linalg.norm(arm) + 1e-12,
                    force_max=np.maximum(1, f),
                    force_min=np.minimum([0, -1, -1], f),
                )
            )
        if max(contact.patch.friction for contact in contacts) < 3:
            limits = {
                "com_nominal_m": com + np.array([0.08, 0, 0]),
                "tilt_limit_rad": np.abs(rotation).max(),
            }
            problem = problem.posture_with(contacts=tuple(contacts), **limits)
            return Motion.of_posture(
                problem, com_m=com, rotation_rad=rotation, toes_m=toes, forces_n=forces
            )


def slipperier(problem, share):
    """The problem with longer legs but only a share of the friction."""
    contacts = [
        replace(
            c, reach_m=c.reach_m + 0.1, patch=replace(c.patch, friction=share * c.patch.friction)
        )
        for c in problem.contacts
    ]
    return problem.posture_with(contacts=tuple(contacts))


def test_no_certificate_refutes_a_problem_that_has_a_posture(refuted):
    rng, accepted_elsewhere = np.random.default_rng(5), 0
    for _ in range(12):
        witness = feasible(rng)
        problem = witness.problem
        assert check_plan(witness, tolerance=1e-9).accepted
        for share in (0.4, 0.3, 0.2):
            value, proof = lift_certificate(slipperier(problem, share))
            if proof is not None and value > 1e-3:
                accepted_elsewhere += check_certificate(
                    proof.of(slipperier(problem, share))
                ).accepted
                assert check_certificate(proof.of(problem)).figures["lower_bound"] == 0.0
        proofs = [
            p.multipliers[0]
            for _, p, _ in refuted
            if p.multipliers.shape[1] == 6 + 3 * len(problem.contacts)
        ]
        for _ in range(30):
            tree, leaves = random_tree(rng, problem)
            rows = [
                row + rng.normal(0, rng.choice([0.1, 1]), row.shape)
                for row in rng.choice(proofs, leaves)
            ]
            sparse = np.array(rows) * rng.choice([0, 1, 1], size=(leaves, 1))
            report = check_certificate(Certificate(tree=tree, multipliers=sparse).of(problem))
            assert report.figures["leaves"] == leaves
            assert report.figures["lower_bound"] == 0.0
    assert accepted_elsewhere >= 5


@given(st.floats(-2e-6, 2e-6), st.sampled_from(["reach", "friction"]))
@settings(max_examples=60, deadline=None)
def test_no_problem_has_both_an_accepted_posture_and_an_accepted_certificate(short, what):
    if what == "reach":
        problem = problem_of(
            ground(half=0.01, reach=0.2 - 0.6 * short), radius=0.0, tilt_limit_rad=0.0
        )
        posture, proof = standing(), certificate(reach=[(0, 0, -1)])
    else:
        problem = problem_of(
            wall("LM", 1, friction=0.5 - short), wall("RM", -1, friction=0.5 - short), radius=0.0
        )
        posture, proof = bracing(WEIGHT_N), certificate(force=(0, 0, -1), reach=np.zeros((2, 3)))
    found, refuted = (
        check_posture(problem, posture).accepted,
        check_certificate(proof.of(problem)).accepted,
    )
    assert not (found and refuted)
    assert found == (short <= 1e-6) or abs(short - 1e-6) < 1e-12


def test_a_clear_miss_is_refuted_where_a_hairs_breadth_is_not():
    for short, expected in ((1e-7, False), (1e-4, True)):
        problem = problem_of(
            ground(half=0.01, reach=0.2 - 0.6 * short), radius=0.0, tilt_limit_rad=0.0
        )
        assert check_certificate(certificate(reach=[(0, 0, -1)]).of(problem)).accepted is expected


@pytest.mark.parametrize(
    ("tree", "rows", "name"),
    [
        (np.zeros((0, 5)), 1, "tree"),
        (np.zeros(5), 1, "tree"),
        (np.zeros((1, 4)), 1, "tree"),
        ([*LEAF, *LEAF], 1, "tree[1]"),
        ([[3, 0, 0, 0.5, 0], *LEAF], 1, "tree"),
        ([[3, 0, 0, 0.5, 0], *LEAF, *LEAF], 1, "2 leaves"),
        (LEAF, 2, "1 leaves"),
        ([[0, 0, 0, 0, 1]], 1, "tree[0]"),
        ([[5, 0, 0, 0, 0]], 1, "tree[0]"),
        ([[0.5, 0, 0, 0, 0]], 1, "tree[0]"),
        ([[-1, 0, 0, 0, 0]], 1, "tree[0]"),
        ([[1, 0, 0, 0.5, 0]], 1, "tree[0]"),
        ([[1, 1, 0, 0, 0]], 1, "foothold"),
        ([[1, 0, 1, 0, 0]], 1, "candidate"),
        ([[1, 0, -1, 0, 0]], 1, "candidate"),
        ([[3, 1, 0, 0.5, 0]], 1, "contact"),
        ([[3, -1, 0, 0.5, 0]], 1, "contact"),
        ([[3, 0.5, 0, 0.5, 0]], 1, "contact"),
        ([[3, 0, 3, 0.5, 0]], 1, "force component"),
        ([[3, 0, 0, 0.5, 1]], 1, "tree[0]"),
        ([[3, 0, 0, 2.5, 0]], 1, "force"),
        ([[3, 0, 1, -1.5, 0]], 1, "force"),
        ([[2, 0, 0, 1.0, 1.0]], 1, "border"),
        ([[2, 0, 0, 2.0, 1.0]], 1, "border"),
        ([[2, 0, 0, 0.0, 4.0]], 1, "border"),
        ([[2, 0, 0, -0.5, 1.0]], 1, "border"),
        ([[2, 1e300, 0, 0.5, 1.0]], 1, "foothold"),
        (
            [[1, 0, 0, 0, 0], *LEAF, [2, 0, 0, 0.5, 1.0], *LEAF, *LEAF],
            3,
            "candidate",
        ),
        ([[np.nan, 0, 0, 0, 0]], 1, "certificate"),
        ([[3, 0, 0, np.inf, 0]], 1, "certificate"),
    ],
)
def test_a_malformed_tree_is_rejected_with_its_reason(tree, rows, name):
    proof = Certificate(tree=tree, multipliers=np.tile([0, 0, -1.0, 0, 0, 0, 0, 0, 0], (rows, 1)))
    report = check_certificate(proof.of(problem_of(ground(friction=0.0))))
    assert not report.accepted
    assert_names(report.message, name)
    assert explain(proof.of(problem_of(ground()))).relaxations == ()


@pytest.mark.parametrize("bad", [np.nan, np.inf, "columns", "flat"])
def test_malformed_multipliers_are_rejected(bad):
    row = np.array([[0, 0, -1.0, 0, 0, 0, 0, 0, 0]])
    rows = (
        {"columns": row[:, :8], "flat": row[0]}.get(bad)
        if isinstance(bad, str)
        else np.where(row == -1, bad, row)
    )
    report = check_certificate(
        Certificate(tree=LEAF, multipliers=rows).of(problem_of(ground(friction=0.0)))
    )
    assert not report.accepted
    assert_names(report.message, "certificate")


@pytest.mark.parametrize("tolerance", [float("nan"), -1.0, 0.0])
def test_no_tolerance_lets_a_proof_of_nothing_pass(tolerance):
    assert not check_certificate(
        certificate(force=(0, 0, 1)).of(problem_of(ground())), tolerance=tolerance
    ).accepted


# -------------------------------------------------------------------------------------------------------
# cover


def area(polygon):
    first = polygon[0]
    return 0.5 * np.linalg.norm(np.cross(polygon[1:-1] - first, polygon[2:] - first).sum(axis=0))


def random_pieces(rng, polygon, cuts):
    pieces = [polygon]
    for _ in range(cuts):
        piece = pieces.pop(int(rng.integers(len(pieces))))
        ends = np.sort(rng.uniform(0, len(piece), 2))
        pieces += cut(piece, *ends)
    return pieces


def test_a_cut_gives_the_two_sides_of_its_chord():
    one, other = cut(SQUARE, 0.5, 2.0)
    np.testing.assert_allclose(one, [[0, -1, 0], [1, -1, 0], [1, 1, 0]])
    np.testing.assert_allclose(other, [[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [0, -1, 0]])
    one, other = cut(SQUARE, 1.0, 3.25)
    np.testing.assert_allclose(one, [[1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, 0.5, 0]])
    np.testing.assert_allclose(other, [[-1, 0.5, 0], [-1, -1, 0], [1, -1, 0]])


@given(SEEDS)
@settings(max_examples=40, deadline=None)
def test_the_pieces_of_random_cuts_cover_the_patch(seed):
    rng = np.random.default_rng(seed)
    polygon = polygon_patch(rng).vertices_m
    pieces = random_pieces(rng, polygon, 5)
    assert sum(area(piece) for piece in pieces) == pytest.approx(area(polygon), rel=1e-9)
    toe = rng.dirichlet(np.full(len(polygon), 0.5)) @ polygon
    assert min(hull_distance(piece, toe) for piece in pieces) < 1e-7


@given(SEEDS)
@settings(max_examples=40, deadline=None)
def test_a_bent_patch_is_not_refuted_in_the_gap_between_its_pieces(seed):
    """A toe inside the hull of a bent patch but off all pieces: the proof that no piece is there
    must not count.
    """
    patch = polygon_patch(np.random.default_rng(seed), bend=1.5e-3, corners=4)
    one, other = cut(patch.vertices_m, 0.0, 2.0)
    toe = patch.centre_m
    away = [np.asarray(np.cross(p[1] - p[0], p[2] - p[0])) for p in (one, other)]
    rows = []
    for piece, normal in zip((one, other), away, strict=True):
        towards = normal * np.sign(
            normal @ (piece[0] - toe)
        )  # min r·q over the piece is more than r·toe
        rows.append(np.concatenate([np.zeros(6), towards / np.linalg.norm(towards)]))
    contact = replace(ground(reach=1e-6), patch=patch)
    problem = problem_of(contact, com=toe, radius=0.0, tilt_limit_rad=0.0)
    proof = Certificate(tree=[[2, 0, 0, 0, 2], *LEAF, *LEAF], multipliers=rows)
    assert not check_certificate(proof.of(problem)).accepted


def test_the_sag_covers_the_notch_of_a_corner_that_points_inwards():
    notched = np.insert(SQUARE, 1, [0.0, -0.999, 0.0], axis=0)
    gap = min(hull_distance(piece, np.array([0.0, -1.0, 0.0])) for piece in cut(notched, 1.0, 3.5))
    assert gap == pytest.approx(0.001, rel=1e-3)
    assert sag(notched) == pytest.approx(0.002, rel=1e-9)


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_no_point_of_a_rounded_patch_is_further_from_its_pieces_than_the_sag(seed):
    rng = np.random.default_rng(seed)
    count, places = int(rng.integers(4, 9)), int(rng.integers(2, 5))
    patch = polygon_patch(rng, corners=count)
    corners = patch.vertices_m * ([1, 1, 0] if abs(patch.normal[2]) > 0.5 else [1, 1, 1])
    between = corners + rng.uniform(0.2, 0.8, (count, 1)) * (np.roll(corners, -1, axis=0) - corners)
    polygon = np.round(
        np.stack([corners, between], axis=1).reshape(-1, 3), places
    )  # every other corner nearly flat
    pieces = random_pieces(rng, polygon, 3)
    for _ in range(5):
        toe = rng.dirichlet(np.full(len(polygon), 0.2)) @ polygon
        assert min(hull_distance(piece, toe) for piece in pieces) <= sag(polygon) + 1e-7
    assert sag(polygon[:3]) == 0.0
    assert sag(polygon) < 6 * 10.0**-places


def _by_all_tetrahedra(vertices: np.ndarray, point: np.ndarray) -> float:
    """Distance from a hull by every tetrahedron at its first corner and every triangle: exact, and
    cubic in corners.
    """
    away = point - vertices[0]
    corners = vertices[list(itertools.combinations(range(1, len(vertices)), 3))] - vertices[0]
    corners = corners[np.abs(np.linalg.det(corners)) > 1e-12 * np.ptp(vertices, axis=0).max() ** 3]
    shares = np.linalg.solve(
        corners.swapaxes(1, 2), np.broadcast_to(away, (len(corners), 3))[..., None]
    )[..., 0]
    if np.any((shares.min(axis=1, initial=0.0) >= 0.0) & (shares.sum(axis=1) <= 1.0)):
        return 0.0
    triangles = vertices[list(itertools.combinations(range(len(vertices)), 3))]
    return float(triangle_distances(triangles, np.broadcast_to(point, (len(triangles), 3))).min())


def test_the_distance_from_a_hull_is_that_by_all_its_tetrahedra():
    rng, seen = np.random.default_rng(0), 0
    for case in range(400):
        count, thick = (
            int(rng.integers(4, 12)),
            rng.choice([0.0, 1e-15, 1e-9, 1e-6, 1e-4, 2e-3, 0.3]),
        )
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
        flat = np.stack([np.cos(angle), np.sin(angle), thick * rng.normal(size=count)], axis=1)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        size = rng.choice([0.01, 0.3, 10.0])
        vertices = size * flat @ turn
        inside = rng.dirichlet(0.3 * np.ones(count)) @ vertices
        off = [
            0.0,
            1e-9 * turn[2],
            1e-7 * rng.normal(size=3),
            size * rng.normal(size=3),
            vertices[0] - inside,
        ][case % 5]
        found, expected = (
            geometry.hull_distance(vertices, inside + off),
            _by_all_tetrahedra(vertices, inside + off),
        )
        assert abs(found - expected) < 1e-11 * size + 1e-12 * expected
        seen += expected > 0.0
    assert seen > 100
