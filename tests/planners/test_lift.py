"""The lift: a bound that is never too high, tight where it must be, and proved by its own multipliers."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stancekit.planners.conic import ConicModel, ConicStatus
from stancekit.planners.contact.lift import LiftModel
from stancekit.planners.contact.project import FixToes
from stancekit.planners.contact.scaled import ScaledProblem, skew
from stancekit.planners.outcome import Certificate, Posture
from stancekit.planners.scene import Contact, Patch, PostureProblem
from stancekit.planners.verify import check_certificate, check_posture

SEEDS = st.integers(0, 2**32 - 1)
LEAF = [[0.0, 0.0, 0.0, 0.0, 0.0]]
SEEDS_OF = {
    "wall-3": (0, 1, 2, 3, 5, 8, 12, 17, 20, 22, 225),
    "ground-3": (0, 1, 37, 86, 115),
    "wall-5": (0, 1, 7, 19, 45),
}
NATURAL = [(name, seed) for name, seeds in SEEDS_OF.items() for seed in seeds]
MIXED = [(seed, corners) for seed in range(4) for corners in ((3, 4, 5), (4,), (5, 3), (6, 3, 4, 3))]


def lift_again(model):
    """The lift in its own words: per vertex a share λ and a force λ f in the cone and in λ times the box."""
    problem = model.problem
    slack = cp.Variable()
    moment, rows = 0.0, [model.balance, *model.body, *model.on_patches, *model.in_reach]
    for i, contact in enumerate(problem.contacts):
        shared = cp.Variable((len(model.vertices[i]), 3))
        rows.append(cp.sum(shared, axis=0) == model.forces[i])
        for share, force, vertex in zip(model.shares[i], shared, model.vertices[i], strict=True):
            rows.append(cp.norm(force[1:]) <= contact.patch.friction * force[0])
            rows += [force >= share * contact.force_min, force <= share * contact.force_max]
            moment = moment + np.cross(vertex, np.eye(3)).T @ model.frames[i] @ force
    moment = moment - model.weight * cp.hstack([model.com[1], -model.com[0], 0.0])
    program = cp.Problem(cp.Minimize(slack), [*rows, cp.abs(moment) <= slack])
    return float(program.solve(solver=cp.CLARABEL))


@pytest.mark.parametrize("scene", [*NATURAL, *MIXED], ids=str)
def test_the_bound_is_that_of_the_lift_written_again(stages, drawn, mixed, written, scene):
    problem = drawn(*scene) if isinstance(scene[0], str) else mixed(*scene)
    bound = stages.lift(ScaledProblem.of(problem)).bound
    assert bound == pytest.approx(lift_again(written(problem)), abs=3e-7)


def test_the_scenes_above_are_of_all_sorts(stages, drawn, mixed):
    bounds = [stages.lift(ScaledProblem.of(drawn(*scene))).bound for scene in NATURAL]
    bounds += [stages.lift(ScaledProblem.of(mixed(*scene))).bound for scene in MIXED]
    assert sum(np.isinf(bounds)) >= 3
    assert sum(1e-3 < bound < 1.0 for bound in bounds) >= 10
    assert sum(bound < 1e-6 for bound in bounds) >= 10


def around_a_posture(seed):
    """A random posture in balance of forces, and a problem whose every other constraint it meets."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 4))
    com, rotation = rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.2, 0.2, 3)
    forces = rng.uniform([-40.0, -40.0, -20.0], [40.0, 40.0, 80.0], (count, 3))
    forces -= (forces.sum(axis=0) - [0.0, 0.0, 98.1]) / count
    toes = rng.uniform([-0.4, -0.4, -0.4], [0.4, 0.4, 0.1], (count, 3))
    contacts = []
    for leg, force, toe in zip(("RF", "RR", "LM"), forces, toes, strict=False):
        normal = force / np.linalg.norm(force) + rng.uniform(-0.4, 0.4, 3)
        normal = normal / np.linalg.norm(normal)
        reference = np.cross(normal, rng.normal(size=3))
        first = reference / np.linalg.norm(reference)
        corners = int(rng.integers(3, 6))
        angle = 2.0 * np.pi * (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) / corners
        border = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), np.cross(normal, first))
        border = rng.uniform(0.01, 0.15) * border
        border = border - rng.dirichlet(np.ones(corners)) @ border  # the toe is inside
        frame = np.column_stack([normal, np.cross(first, normal), first])
        f = frame.T @ force / 98.1
        shoulder = rng.uniform(-0.2, 0.2, 3)
        leg_vector = toe - com - shoulder - np.cross(rotation, shoulder)
        patch = Patch(
            vertices_m=toe + border, normal=normal, shear_reference=reference,
            friction=np.linalg.norm(f[1:]) / f[0] + rng.choice([1e-6, 0.2]),
        )  # fmt: skip
        room = rng.choice([1e-6, 0.3], size=(2, 3))
        contacts.append(
            Contact(
                leg=leg, shoulder_m=shoulder, reach_m=np.linalg.norm(leg_vector) + rng.choice([1e-6, 0.1]),
                patch=patch, force_min=f - room[0], force_max=f + room[1],
            )
        )  # fmt: skip
    problem = PostureProblem(
        contacts=tuple(contacts), mass_kg=10.0, com_nominal_m=com + rng.uniform(-0.01, 0.01, 3), com_radius_m=0.02
    )
    return problem, Posture(com_m=com, rotation_rad=rotation, toes_m=toes, forces_n=forces)


@given(SEEDS)
@settings(max_examples=120)
def test_the_bound_is_never_above_the_moment_of_a_posture_that_is_otherwise_right(stages, seed):
    problem, posture = around_a_posture(seed)
    groups = {g.group: g.worst for g in check_posture(problem, posture).groups}
    assert max(worst for group, worst in groups.items() if group != "moment_balance") < 1e-12
    moment = np.cross(posture.toes_m - posture.com_m, posture.forces_n).sum(axis=0) / (98.1 * 0.6)
    answer = stages.lift(ScaledProblem.of(problem))
    assert answer.solved
    assert answer.bound <= np.max(np.abs(moment)) + 1e-7


@given(SEEDS)
@settings(max_examples=40)
def test_on_patches_without_size_the_bound_is_the_least_residual_of_those_toes(stages, drawn, mixed, seed):
    rng = np.random.default_rng(seed)
    problem = mixed(int(rng.integers(20)), (3, 4, 5)) if rng.random() < 0.5 else drawn("wall-3", int(rng.integers(60)))
    scaled = ScaledProblem.of(problem)
    toes = np.einsum("nu,nud->nd", rng.dirichlet(np.ones(scaled.size[1]), scaled.size[0]), scaled.vertices)
    for i, toe in enumerate(toes):
        scaled = scaled.narrowed(i, np.repeat(toe[None], 3, axis=0), scaled.force_min[i], scaled.force_max[i])
    answer = stages.lift(scaled)
    assert answer.bound == pytest.approx(FixToes(len(toes)).solve(scaled, toes).residual, abs=2e-7)
    if np.isfinite(answer.bound):
        np.testing.assert_allclose(answer.toes, toes, atol=1e-8)


@pytest.mark.parametrize("name", ["wall-3", "ground-3"])
def test_the_small_form_says_what_the_whole_one_says_where_the_box_is_implied(drawn, name):
    small, whole = LiftModel(3, 3, whole_box=False), LiftModel(3, 3, whole_box=True)
    implied = 0
    for seed in range(40):
        scaled = ScaledProblem.of(drawn(name, seed))
        if not scaled.box_implied:
            continue
        implied += 1
        assert small.solve(scaled).bound == pytest.approx(whole.solve(scaled).bound, abs=3e-7)
    assert implied >= 10


@pytest.mark.parametrize("friction", [0.5, 1e-3, 1e-4, 1e-6, 0.0])
def test_the_form_that_is_chosen_says_what_the_whole_one_says_on_ice(stages, drawn, friction):
    small, whole = LiftModel(3, 3, whole_box=False), LiftModel(3, 3, whole_box=True)
    for seed in range(30):
        scaled = ScaledProblem.of(drawn("wall-3", seed))
        scaled = replace(scaled, friction=np.array([friction, 0.5, 0.5]))
        assert scaled.box_implied <= (friction > 1e-3)
        assert stages.lift(scaled).bound == pytest.approx(whole.solve(scaled).bound, abs=1e-6)
        if scaled.box_implied:
            assert small.solve(scaled).bound == pytest.approx(whole.solve(scaled).bound, abs=1e-6)


def test_the_box_is_implied_exactly_where_cone_and_normal_limit_reach_no_other_side():
    plain = ScaledProblem.typical(2, 3)  # friction 0.5, f in [0, 1] × [−1, 1]²
    assert plain.box_implied

    def box(low, high):
        return replace(plain, force_min=np.array([low, plain.force_min[1]]), force_max=np.array([high, [1, 1, 1]]))

    assert box([0, -0.5, -0.5], [1, 0.5, 0.5]).box_implied
    assert box([-1, -0.5, -0.5], [1, 0.5, 0.5]).box_implied
    for k, sign in ((1, 1), (2, 1), (1, -1), (2, -1)):
        low, high = np.array([0, -0.5, -0.5]), np.array([1, 0.5, 0.5])
        (high if sign > 0 else low)[k] = 0.499 * sign
        assert not box(low, high).box_implied
    assert not box([0.01, -1, -1], [1, 1, 1]).box_implied
    assert not box([-1, -1, -1], [0, 1, 1]).box_implied


@pytest.mark.parametrize("scene", [*NATURAL, *MIXED], ids=str)
def test_the_multipliers_prove_the_bound(stages, drawn, mixed, scene):
    problem = drawn(*scene) if isinstance(scene[0], str) else mixed(*scene)
    answer = stages.lift(ScaledProblem.of(problem))
    report = check_certificate(problem, Certificate(tree=LEAF, multipliers=answer.multipliers[None]))
    if np.isinf(answer.bound):
        assert report.lower_bound == np.inf
    else:
        assert report.lower_bound == pytest.approx(answer.bound, rel=3e-5, abs=2e-7)  # single precision
    assert report.accepted == (report.lower_bound > 1e-4)


@given(SEEDS)
@settings(max_examples=60)
def test_a_smaller_patch_or_force_box_never_lowers_the_bound(stages, drawn, mixed, seed):
    rng = np.random.default_rng(seed)
    problem = mixed(int(rng.integers(20)), (3, 4, 5)) if rng.random() < 0.5 else drawn("wall-3", int(rng.integers(60)))
    scaled = ScaledProblem.of(problem)
    before = stages.lift(scaled).bound
    for _ in range(3):
        i = int(rng.integers(scaled.size[0]))
        corners = scaled.vertices[i]
        if rng.random() < 0.5:
            corners = rng.dirichlet(np.ones(len(corners)), len(corners)) @ corners
        low, high = scaled.force_min[i], scaled.force_max[i]
        ends = low + (high - low) * np.sort(rng.uniform(0.0, 1.0, (2, 3)), axis=0)
        keep = rng.random(3) < 0.7
        scaled = scaled.narrowed(i, corners, np.where(keep, low, ends[0]), np.where(keep, high, ends[1]))
        after = stages.lift(scaled).bound
        assert after >= before - 2e-7
        before = after


@pytest.mark.parametrize("whole_box", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_repeated_corners_change_nothing(drawn, whole_box, seed):
    scaled = ScaledProblem.of(drawn("wall-3", seed))
    padded = replace(scaled, vertices=np.concatenate([scaled.vertices, scaled.vertices[:, [2, 2]]], axis=1))
    three = LiftModel(3, 3, whole_box=whole_box).solve(scaled)
    five = LiftModel(3, 5, whole_box=whole_box).solve(padded)
    assert five.bound == pytest.approx(three.bound, abs=2e-7)


def test_a_limb_that_may_not_push_must_stand_on_its_patch_all_the_same(stages, drawn):
    """A force box without size leaves the shares free unless λ ≥ 0 is asked for: the patch would be its whole plane."""
    scaled = ScaledProblem.of(drawn("wall-3", 0))
    nothing = np.zeros(3)
    assert np.isfinite(stages.lift(scaled.narrowed(0, scaled.vertices[0], nothing, nothing)).bound)
    side = scaled.vertices[0, 1] - scaled.vertices[0, 0]
    beyond = scaled.narrowed(0, scaled.vertices[0] + 20.0 * side, nothing, nothing)
    assert stages.lift(beyond).bound == np.inf


def test_where_the_solver_gives_up_nothing_is_proved(drawn, monkeypatch):
    solve = ConicModel.solve
    monkeypatch.setattr(
        ConicModel, "solve", lambda model, values: replace(solve(model, values), status=ConicStatus.FAILED)
    )
    answer = LiftModel(3, 3, whole_box=True).solve(ScaledProblem.of(drawn("wall-3", 5)))
    assert (answer.solved, answer.bound, answer.toes.size) == (False, 0.0, 0)


def test_a_mixed_scene_is_padded_by_its_last_corners(mixed):
    problem = mixed(0, (3, 5, 4))
    scaled = ScaledProblem.of(problem)
    assert scaled.size == (3, 5)
    for vertices, contact in zip(scaled.vertices, problem.contacts, strict=True):
        own = contact.patch.vertices_m / 0.6
        np.testing.assert_array_equal(vertices[: len(own)], own)
        np.testing.assert_array_equal(vertices[len(own) :], np.repeat(own[-1:], 5 - len(own), axis=0))


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4])
def test_the_answer_meets_what_the_lift_demands_of_it(stages, mixed, seed):
    problem = mixed(seed, (3, 4, 5))
    scaled = ScaledProblem.of(problem)
    answer = stages.lift(scaled)
    if not np.isfinite(answer.bound):
        assert answer.toes.size == answer.forces.size == 0
        return
    assert answer.weights.min() >= 0.0
    np.testing.assert_allclose(answer.weights.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(answer.toes, np.einsum("nu,nud->nd", answer.weights, scaled.vertices), atol=1e-12)
    np.testing.assert_allclose(answer.forces, answer.by_vertex.sum(axis=1), atol=1e-12)
    world = np.einsum("nij,nuj->nui", scaled.frames, answer.by_vertex)
    np.testing.assert_allclose(world.sum(axis=(0, 1)), [0.0, 0.0, 1.0], atol=1e-7)
    moment = np.cross(scaled.vertices, world).sum(axis=(0, 1)) - np.cross(answer.com, [0.0, 0.0, 1.0])
    assert np.max(np.abs(moment)) == pytest.approx(answer.bound, abs=1e-6)
    shear = np.linalg.norm(answer.by_vertex[..., 1:], axis=-1)
    assert np.all(shear <= scaled.friction[:, None] * answer.by_vertex[..., 0] + 1e-7)
    assert (answer.point.residual, answer.point.com.tolist()) == (answer.bound, answer.com.tolist())


@pytest.mark.parametrize("seed", range(3))
def test_units_come_off_and_on_again(mixed, seed):
    problem = replace(mixed(seed, (3, 4, 5)), force_scale_n=37.0, length_scale_m=0.41)
    scaled, rng = ScaledProblem.of(problem), np.random.default_rng(seed)
    com, toes, forces = rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    posture = scaled.posture(com=com, rotation=np.zeros(3), toes=toes, forces=forces)
    np.testing.assert_allclose(posture.com_m, 0.41 * com)
    for contact, mine, force in zip(problem.contacts, posture.forces_n, forces, strict=True):
        n, y, z = contact.patch.frame.T
        np.testing.assert_allclose(mine, 37.0 * (force[0] * n + force[1] * y + force[2] * z), atol=1e-12)
    np.testing.assert_allclose(scaled.point(posture), np.hstack([toes - com, forces]), atol=1e-12)
    assert scaled.weight == pytest.approx(98.1 / 37.0)
    v, w = rng.normal(size=(2, 4, 3))
    np.testing.assert_allclose(np.einsum("kij,kj->ki", skew(v), w), np.cross(v, w), atol=1e-14)
