"""IPOPT's form of the posture problem: it agrees with the verifier, and claims nothing that it cannot show."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from stancekit.envs.terrains import DISTRIBUTIONS
from stancekit.planners.contact.exact import ExactPlanner
from stancekit.planners.contact.lift import LiftModel
from stancekit.planners.contact.nlp import NlpModel, NlpPlanner, posture_program, starting_points
from stancekit.planners.contact.project import Point
from stancekit.planners.contact.scaled import ScaledProblem
from stancekit.planners.outcome import InvalidInput, Outcome, Status
from stancekit.planners.scene import Patch, PostureProblem
from stancekit.planners.verify import check_posture


@pytest.fixture(scope="module")
def scenes() -> list[tuple[PostureProblem, Outcome]]:
    """Natural wall-3 scenes with the exact planner's answer, the trivially infeasible ones left out."""
    rng, exact = np.random.default_rng(1), ExactPlanner()
    drawn = [DISTRIBUTIONS["wall-3"].sample(rng) for _ in range(20)]
    answered = [(problem, exact.solve(problem)) for problem in drawn]
    kept = [(problem, outcome) for problem, outcome in answered if not outcome.details["trivial"]]
    assert {outcome.status for _, outcome in kept} == {Status.FEASIBLE, Status.INFEASIBLE}
    return kept


def point_of(problem: PostureProblem, outcome: Outcome) -> Point:
    """The witness in the numbers of the models."""
    assert outcome.posture is not None
    scaled, posture = ScaledProblem.of(problem), outcome.posture
    forces = np.einsum("nji,nj->ni", scaled.frames, posture.forces_n) / scaled.force_n
    return Point(
        com=posture.com_m / scaled.length_m,
        rotation=posture.rotation_rad,
        toes=posture.toes_m / scaled.length_m,
        forces=forces,
        residual=0.0,
    )


def test_it_finds_a_verified_witness_exactly_where_there_is_one(scenes: list[tuple[PostureProblem, Outcome]]) -> None:
    planner = NlpPlanner()
    for problem, exact in scenes:
        outcome = planner.solve(problem)
        assert (outcome.status is Status.FEASIBLE) == (exact.status is Status.FEASIBLE)
        if outcome.status is Status.FEASIBLE:
            assert outcome.posture is not None
            assert check_posture(problem, outcome.posture).accepted
            assert outcome.claim == "Solve_Succeeded"
        else:
            assert outcome.status is Status.UNDECIDED
            assert outcome.message == f"no witness from 5 starts; IPOPT said {outcome.claim}"


def test_five_legs_and_the_ground_are_no_different() -> None:
    for name in ("wall-5", "ground-3"):
        problem = DISTRIBUTIONS[name].sample(np.random.default_rng(3))
        assert ExactPlanner().solve(problem).status is Status.FEASIBLE
        assert NlpPlanner().solve(problem).status is Status.FEASIBLE


def test_as_a_projection_it_lands_on_the_bilinear_surface_or_says_inf(
    scenes: list[tuple[PostureProblem, Outcome]],
) -> None:
    model, lift = NlpModel(3, 3), LiftModel(3, 3, whole_box=True)
    for problem, exact in scenes:
        scaled = ScaledProblem.of(problem)
        relaxed = lift.solve(scaled)
        start = Point(
            com=relaxed.com, rotation=relaxed.rotation, toes=relaxed.toes, forces=relaxed.forces, residual=np.nan
        )
        point = model.solve(scaled, start)
        assert point.residual < 1e-6 if exact.status is Status.FEASIBLE else point.residual == np.inf


def test_a_point_on_the_surface_keeps_every_other_constraint_too() -> None:
    # A limb that hardly pushes: (μ f_n)² forgives 1e-4 of shear for a tolerance of 1e-8, as in the ninth of these.
    rng, model, looked_at = np.random.default_rng(0), NlpModel(5, 3), 0
    for _ in range(9):
        problem = DISTRIBUTIONS["wall-5"].sample(rng)
        scaled = ScaledProblem.of(problem)
        for start in starting_points(scaled, 2, seed=0):
            point = model.solve(scaled, start)
            if np.isfinite(point.residual):
                parts = {"com": point.com, "rotation": point.rotation, "toes": point.toes, "forces": point.forces}
                worst = check_posture(problem, scaled.posture(**parts)).worst
                assert worst < 1e-6 or worst < 2.0 * point.residual
                looked_at += 1
    assert looked_at > 10


def test_the_programs_rows_vanish_at_a_witness_and_say_how_far_off_another_point_is(
    scenes: list[tuple[PostureProblem, Outcome]],
) -> None:
    from stancekit.planners.contact import nlp

    rows = cs.Function("rows", [(program := posture_program(3, 3))["x"], program["p"]], [program["g"]])
    looked_at = 0
    for problem, outcome in scenes:
        if outcome.status is not Status.FEASIBLE:
            continue
        scaled, point = ScaledProblem.of(problem), point_of(problem, outcome)
        x = nlp._vector(scaled, point)
        g = np.asarray(rows(x, nlp._parameters(scaled, x))).ravel()
        assert np.abs(g[:9]).max() < 2e-6
        assert g[9:].max() < 2e-6
        moved = replace(point, com=point.com + np.array([0.1, 0.0, 0.0]))
        g = np.asarray(rows(nlp._vector(scaled, moved), nlp._parameters(scaled, x))).ravel()
        np.testing.assert_allclose(g[6:9], [0.0, scaled.weight * 0.1, 0.0], atol=3e-6)  # −Δc × w e_z
        looked_at += 1
    assert looked_at > 5


def test_derivatives_match_finite_differences_and_the_objectives_gradient_is_dense() -> None:
    program = posture_program(2, 4)
    x, p = program["x"], program["p"]
    both = cs.vertcat(program["f"], program["g"])
    value, slope = cs.Function("v", [x, p], [both]), cs.Function("s", [x, p], [cs.jacobian(both, x)])
    rng = np.random.default_rng(0)
    at, data = rng.normal(size=x.numel()), rng.normal(size=p.numel())
    steps = 1e-6 * np.eye(x.numel())
    measured = np.column_stack([np.asarray(value(at + h, data) - value(at - h, data)).ravel() / 2e-6 for h in steps])
    np.testing.assert_allclose(np.asarray(slope(at, data)), measured, atol=1e-7)
    assert cs.gradient(program["f"], x).nnz() == x.numel()


def test_patches_may_have_different_numbers_of_vertices(scenes: list[tuple[PostureProblem, Outcome]]) -> None:
    problem = next(problem for problem, outcome in scenes if outcome.status is Status.FEASIBLE)
    first, *rest = problem.contacts
    a, b, c = first.patch.vertices_m
    square = Patch(
        vertices_m=np.array([a, 0.5 * (a + b), b, c]),
        normal=first.patch.normal,
        shear_reference=first.patch.shear_reference,
        friction=first.patch.friction,
    )
    same = replace(problem, contacts=(replace(first, patch=square), *rest))
    assert NlpPlanner().solve(same).status is Status.FEASIBLE


def test_ice_on_level_ground_is_no_obstacle() -> None:
    problem = DISTRIBUTIONS["ground-3"].sample(np.random.default_rng(3))
    level = tuple(
        replace(
            contact,
            patch=Patch(
                vertices_m=np.column_stack([contact.patch.vertices_m[:, :2], np.full(3, -0.2)]),
                normal=np.array([0.0, 0.0, 1.0]),
                shear_reference=np.array([1.0, 0.0, 0.0]),
                friction=0.0,
            ),
        )
        for contact in problem.contacts
    )
    problem = replace(problem, contacts=level)
    assert ExactPlanner().solve(problem).status is Status.FEASIBLE
    assert NlpPlanner().solve(problem).status is Status.FEASIBLE


def test_a_solve_does_not_depend_on_the_solves_before_it(scenes: list[tuple[PostureProblem, Outcome]]) -> None:
    model = NlpModel(3, 3)
    (first, _), (second, _) = scenes[:2]
    problems = [ScaledProblem.of(problem) for problem in (first, second, first)]
    one, _, again = (model.solve(scaled, starting_points(scaled, 1, seed=0)[0]) for scaled in problems)
    np.testing.assert_array_equal(one.toes, again.toes)
    np.testing.assert_array_equal(one.forces, again.forces)


def test_starts_are_the_centroids_and_then_seeded_points_of_the_patches() -> None:
    scaled = ScaledProblem.of(DISTRIBUTIONS["wall-5"].sample(np.random.default_rng(0)))
    starts = starting_points(scaled, 4, seed=7)
    np.testing.assert_allclose(starts[0].toes, scaled.vertices.mean(axis=1))
    assert len({start.toes.tobytes() for start in starts}) == 4
    for start, again in zip(starts, starting_points(scaled, 4, seed=7), strict=True):
        np.testing.assert_array_equal(start.toes, again.toes)
        assert np.all((start.forces >= scaled.force_min) & (start.forces <= scaled.force_max))


def test_a_limit_leaves_the_problem_undecided(scenes: list[tuple[PostureProblem, Outcome]]) -> None:
    problem = next(problem for problem, outcome in scenes if outcome.status is Status.FEASIBLE)
    few = NlpPlanner(max_iterations=1, starts=2).solve(problem)
    assert (few.status, few.claim, few.solves) == (Status.UNDECIDED, "Maximum_Iterations_Exceeded", 2)
    short = NlpPlanner(time_limit_s=1e-6).solve(problem)
    assert (short.status, short.claim) == (Status.UNDECIDED, "Maximum_WallTime_Exceeded")


def test_it_prints_nothing(scenes: list[tuple[PostureProblem, Outcome]], capfd: pytest.CaptureFixture[str]) -> None:
    for problem, _ in scenes[:3]:
        NlpPlanner().solve(problem)
    assert capfd.readouterr() == ("", "")


def test_options_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InvalidInput, match=r"^starts: expected 1 or more, got 0$"):
        NlpPlanner(starts=0)
    with pytest.raises(InvalidInput, match=r"^time_limit_s: expected a number above 0, got -1$"):
        NlpPlanner(time_limit_s=-1.0)
