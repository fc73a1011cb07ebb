"""External wrenches in planners: every method, a batch, courses, and what changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.projection.force_distribution import (
    ForceDistribution,
    standing_forces,
    wrench_at,
)
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.search.batch import decide_all, unsupported
from stancekit.planners.search.exact import BoxSearch, Exact
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import refuses


def random_wrench(problem: Problem, rng: np.random.Generator) -> np.ndarray:
    """Up to two fifths of the weight in every direction, and a tenth of it at the length scale."""
    arm = 0.1 * problem.length_scale_m
    return problem.weight_n * rng.uniform(-1.0, 1.0, 6) * [0.4, 0.4, 0.4, arm, arm, arm]


@pytest.mark.parametrize("name", ["wall-3", "ground-3", "wall-5"])
def test_every_method_carries_a_wrench_or_proves_that_none_can(
    drawn: Callable[[str, int], Problem], name: str
) -> None:
    rng, statuses = np.random.default_rng(0), []
    for seed in range(8):
        plain = drawn(name, seed)
        problem = plain.posture_with(wrench=random_wrench(plain, rng))
        assert problem.wrench is not None
        found = {
            method: stancekit.solve(problem, method)
            for method in ("exact", "two-stage", "nlp", "lift")
        }
        for method, answer in found.items():
            where = f"{name} {seed} {method}"
            if answer.solution is not None and answer.status is Status.FEASIBLE:
                posture, wrench = answer.solution, problem.wrench[0]
                force = posture.forces_n[0].sum(axis=0) + wrench[:3] - [0.0, 0.0, problem.weight_n]
                moment = (
                    np.cross(posture.toes_m - posture.com_m, posture.forces_n[0]).sum(axis=0)
                    + wrench[3:]
                )
                np.testing.assert_allclose([*force, *moment], 0.0, atol=2e-4, err_msg=where)
            if answer.certificate is not None:
                assert check_certificate(answer.certificate).accepted, where
        said = {answer.status for answer in found.values()} - {Status.UNDECIDED}
        assert len(said) == 1, f"{name} {seed}: {said}"
        statuses.append(found["exact"].status)
    assert Status.UNDECIDED not in statuses
    assert Status.FEASIBLE in statuses


def test_a_batch_decides_as_its_problems_do_one_by_one(programs: Programs) -> None:
    problems = stancekit.sample("wall-3", rng=3, count=30)
    wrench = random_wrench(problems[0], np.random.default_rng(2))
    batch = PostureBatch.stacked([problem.posture_with(wrench=wrench) for problem in problems])
    planner = Exact(programs=programs)
    together, alone = (
        decide_all(planner, batch).outcomes,
        [planner.solve(problem) for problem in batch.problems],
    )
    assert [answer.status for answer in together] == [answer.status for answer in alone]
    refused = unsupported(ScaledBatch.of(batch))
    counts = {Status.FEASIBLE: 0, Status.INFEASIBLE: 0}
    for answer, hopeless in zip(together, refused, strict=True):
        counts[answer.status] += 1
        if answer.solution is not None:
            assert check_plan(answer.solution).accepted
            assert not hopeless
        else:
            assert answer.certificate is not None
            assert check_certificate(answer.certificate).accepted
    assert min(counts.values()) > 3
    assert 0 < refused.sum() < len(refused)


def test_problems_with_other_wrenches_are_of_no_batch(drawn: Callable[[str, int], Problem]) -> None:
    problem = drawn("wall-3", 0)
    with refuses("body", "limbs", "limits"):
        PostureBatch.stacked([problem, problem.posture_with(wrench=[1.0, 0, 0, 0, 0, 0])])


def test_boxes_are_cut_until_a_wrench_is_carried_or_refuted(
    drawn: Callable[[str, int], Problem], programs
) -> None:
    rng, decided = np.random.default_rng(4), 0
    for seed in range(6):
        plain = drawn("wall-3", seed)
        problem = plain.posture_with(wrench=random_wrench(plain, rng))
        search = BoxSearch(problem, Scaled.of(problem), programs)
        for _ in range(40):
            if search.verdict is not Status.UNDECIDED:
                break
            search.cut(int((search.current.box.high - search.current.box.low).argmax()))
        if search.verdict is not Status.UNDECIDED:
            assert search.verdict is Exact(programs=programs).solve(problem).status
            decided += 1
    assert decided > 3


def test_courses_carry_a_wrench_that_changes_or_it_is_proved_that_none_can(
    ragged: Callable[..., Problem], programs: Programs
) -> None:
    statuses = []
    for seed in range(12):
        plain, rng = ragged(seed, frames=2), np.random.default_rng(seed)
        course = replace(
            plain, wrench=np.array([0.4 * random_wrench(plain, rng) for _ in range(plain.frames)])
        )
        best = Exact(programs=programs, time_limit_s=600.0).solve(course)
        found = TwoStage(programs=programs).solve(course)
        for answer in (best, found):
            if answer.solution is not None:
                assert check_plan(answer.solution).accepted
                assert not check_plan(replace(answer.solution, problem=plain)).accepted
            if answer.certificate is not None:
                assert check_certificate(answer.certificate).accepted
        assert {best.status, found.status} != {Status.FEASIBLE, Status.INFEASIBLE}
        if best.solution is not None and found.solution is not None:
            assert best.bound <= found.objective + 1e-6
        statuses.append(best.status)
    assert min(statuses.count(status) for status in (Status.FEASIBLE, Status.INFEASIBLE)) > 1


def test_a_wrench_of_zeros_is_none(ragged: Callable[..., Problem], programs: Programs) -> None:
    planner, compared = TwoStage(programs=programs), 0
    for seed in range(10):
        course = ragged(seed, frames=2)
        plain, zeros = (
            planner.solve(course),
            planner.solve(replace(course, wrench=np.zeros((2, 6)))),
        )
        assert plain.status is zeros.status
        if plain.solution is not None:
            assert plain.objective == pytest.approx(zeros.objective, abs=1e-5)
            compared += 1
    assert compared > 1


def test_forces_that_are_distributed_anew_carry_the_wrench() -> None:
    answer = stancekit.plan(
        "stairs",
        frames=3,
        settings=stancekit.PlanSettings(wrench=(2.0, -4.0, -15.0, 0.5, 1.0, -0.3)),
    )
    plan = answer.solution
    assert plan is not None
    course, wrench = plan.problem, plan.problem.wrench
    assert wrench is not None
    distribution = ForceDistribution(6)
    anew = [
        (stance.frame, distribution.solve(plan, row)) for row, stance in enumerate(course.stances)
    ]
    anew += list(standing_forces(plan, Kinematics(course.robot)).items())
    assert len(anew) > len(course.stances)
    for frame, forces in anew:
        assert forces is not None
        arms = plan.toes_at(frame) - plan.com_m[frame]
        net = [*forces.sum(axis=0), *np.cross(arms, forces).sum(axis=0)]
        np.testing.assert_allclose(net, [0, 0, course.weight_n, 0, 0, 0] - wrench[frame], atol=1e-4)
    share = wrench_at(course, 0)
    assert share is not None
    np.testing.assert_allclose(share[:3] * course.weight_n, [2.0, -4.0, -15.0])
    np.testing.assert_allclose(
        share[3:] * course.weight_n * course.length_scale_m, [0.5, 1.0, -0.3]
    )
