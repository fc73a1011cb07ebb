"""The exact planner of courses: against SCIP, against one posture's exact planner, and its parts against sampling."""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.contact.exact import ExactPlanner
from stancekit.planners.keyframes.clock import Clock
from stancekit.planners.keyframes.exact import ExactCoursePlanner
from stancekit.planners.keyframes.narrowed import NarrowedCourse, NarrowedLift
from stancekit.planners.keyframes.scaled import ScaledCourse
from stancekit.planners.keyframes.twostage import TwoStageCoursePlanner
from stancekit.planners.outcome import InvalidInput, Status
from stancekit.planners.verify import check_certificate, check_plan

GAPPED = (2, 4)
"""Seeds of courses whose lift is far below the best plan."""


@pytest.fixture(scope="module")
def planner(models):
    return ExactCoursePlanner(models=models, time_limit_s=20.0)


def test_every_answer_carries_what_it_promises_and_the_lift_alone_would_not_have_closed_some(climb, planner, models):
    seen, cuts = set(), 0.0
    for seed in (0, 1, 2, 5):
        course = climb(seed)
        outcome = planner.solve(course)
        seen.add(outcome.status)
        if outcome.status is Status.FEASIBLE:
            assert check_plan(outcome.plan).accepted
            assert outcome.bound <= outcome.objective * (1.0 + 1e-6)
            assert outcome.claim == "optimal"
            assert outcome.objective - outcome.bound <= 1.1e-3 * outcome.objective
            assert TwoStageCoursePlanner(models=models).solve(course).objective >= outcome.bound * (1.0 - 1e-6)
        else:
            assert check_certificate(course, outcome.certificate).accepted
        cuts += outcome.details["cuts"]
    assert seen == {Status.FEASIBLE, Status.INFEASIBLE}
    assert cuts > 0


def test_with_one_frame_it_finds_what_the_posture_planner_finds(climb, planner):
    seen = set()
    for seed in range(7):
        course = climb(seed, frames=1)
        ours = planner.solve(course)
        alone = ExactPlanner().solve(course.posture_problem(course.stances[0], np.zeros(4, dtype=int)))
        if ours.status is Status.FEASIBLE:
            assert alone.status is Status.FEASIBLE
        if alone.status is Status.INFEASIBLE:
            assert ours.status is Status.INFEASIBLE
        seen.add((ours.status, alone.status))
    assert {(Status.FEASIBLE, Status.FEASIBLE), (Status.INFEASIBLE, Status.INFEASIBLE)} <= seen


def test_parts_cover_the_course_and_never_lower_the_bound(climb):
    course = climb(GAPPED[0])
    scaled = ScaledCourse.of(course)
    whole = NarrowedCourse.whole(scaled)
    lift = NarrowedLift(whole.layout, whole)
    root = lift.solve(whole).objective
    for parts in (whole.split(0, 0, 0.3), whole.split(4, 2, 0.1), whole.halved(1)):
        bounds = [lift.solve(part) for part in parts]
        assert min(b.objective for b in bounds if b.status.value == "solved") >= root - 1e-7
    a, b = whole.halved(2)
    area = [_area(part.pieces[2]) for part in (whole, a, b)]
    assert area[0] == pytest.approx(area[1] + area[2])
    assert a.size(2) < whole.size(2) * 1.0001


def _area(border: np.ndarray) -> float:
    fan = np.cross(border[1:-1] - border[0], border[2:] - border[0])
    return float(0.5 * np.linalg.norm(fan, axis=1).sum())


def test_a_box_of_no_size_about_a_plans_forces_makes_the_lift_exact(climb, models):
    course = climb(GAPPED[1])
    outcome = TwoStageCoursePlanner(models=models, gap=1e-4).solve(course)
    scaled = ScaledCourse.of(course)
    whole = NarrowedCourse.whole(scaled)
    stance, limb, placement = scaled.layout.bearing
    world = outcome.plan.forces_n[stance, limb] / course.weight_n
    forces = np.einsum("bji,bj->bi", scaled.frames[placement], world)
    lift, part = NarrowedLift(whole.layout, whole), whole
    for b, f in enumerate(forces):
        for axis in range(3):
            part = part.split(b, axis, f[axis] + 1e-4)[0].split(b, axis, f[axis] - 1e-4)[1]
    held, root = lift.solve(part).objective, lift.solve(whole).objective
    unit = course.length_scale_m**2
    assert held * unit <= outcome.objective * (1.0 + 1e-4)
    assert held * unit >= outcome.objective * 0.99
    assert root * unit < outcome.objective * 0.9


def test_without_cuts_its_lift_is_the_planners_own(climb, models):
    course = climb(5, regions=2)
    scaled = ScaledCourse.of(course)
    whole = NarrowedCourse.whole(scaled)
    ours = NarrowedLift(whole.layout, whole).solve(whole)
    theirs = models.lift(scaled, Clock.start()).solve(scaled)
    assert ours.objective == pytest.approx(theirs.objective, rel=1e-5)


def test_at_its_limit_the_plan_stays_and_the_bound_says_how_far_it_may_be_off(climb, models):
    course = climb(GAPPED[1])
    outcome = ExactCoursePlanner(models=models, max_nodes=3).solve(course)
    assert outcome.status is Status.FEASIBLE
    assert outcome.claim == ""
    assert outcome.message == "the search met its limit (3 nodes)"
    assert outcome.bound < outcome.objective
    assert outcome.details["gap"] == pytest.approx(1.0 - outcome.bound / outcome.objective, rel=1e-6)


def test_bad_settings_are_refused():
    with pytest.raises(InvalidInput, match="gap: expected a number above 0"):
        ExactCoursePlanner(gap=0.0)
    with pytest.raises(InvalidInput, match="max_nodes: expected 1 or more, got 0"):
        ExactCoursePlanner(max_nodes=0)


@pytest.mark.parametrize("seed", GAPPED)
def test_scip_finds_the_same_best_plan_and_its_bound_does_not_exclude_it(seed, climb, planner):
    course, outcome = climb(seed), planner.solve(climb(seed))
    best, bound = scip(course, time_limit_s=4.0)
    assert bound <= outcome.objective * 1.002  # what SCIP proved does not exclude the plan
    assert best >= outcome.objective * (1.0 - 2e-3)  # nor does it find a better one; its tolerances are looser
    if np.isfinite(best):
        assert best >= outcome.bound * (1.0 - 1e-3)


def scip(course, *, time_limit_s):
    """Best objective and bound [m²] that SCIP has for the true bilinear problem, written from the course's numbers."""
    pyscipopt = pytest.importorskip("pyscipopt")
    model = pyscipopt.Model()
    model.hideOutput()
    model.setParam("limits/time", time_limit_s)
    model.setParam("limits/gap", 1e-3)

    def free(low, high):
        return [model.addVar(lb=float(a), ub=float(b)) for a, b in zip(low, high, strict=True)]

    def within(vector, radius):
        model.addCons(sum(x * x for x in vector) <= radius**2)

    def cross(a, b):
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    tilt, frames = course.tilt_limit_rad, range(course.frames)
    com = [free(course.com_nominal_m[k] - course.com_radius_m[k], course.com_nominal_m[k] + course.com_radius_m[k])
           for k in frames]  # fmt: skip
    turn = [free([-tilt] * 3, [tilt] * 3) for _ in frames]
    toes = []
    for put in course.placements:
        corners = put.candidates[0].vertices_m
        share, toe = free([0] * len(corners), [1] * len(corners)), free(corners.min(axis=0), corners.max(axis=0))
        model.addCons(sum(share) == 1)
        for j in range(3):
            model.addCons(sum(s * float(v) for s, v in zip(share, corners[:, j], strict=True)) == toe[j])
        toes.append(toe)
    for k in frames:
        within([com[k][j] - float(course.com_nominal_m[k][j]) for j in range(3)], float(course.com_radius_m[k]))
        for i, limb in enumerate(course.robot.limbs):
            turned = cross(turn[k], [float(x) for x in limb.shoulder_m])
            toe = toes[course.holds[k, i]]
            within([toe[j] - com[k][j] - float(limb.shoulder_m[j]) - turned[j] for j in range(3)], limb.reach_m)
    for stance in course.stances:
        net, moment = [0.0, 0.0, -1.0], [-com[stance.frame][1], 1.0 * com[stance.frame][0], 0.0]
        for i in stance.limbs:
            p = course.holds[stance.frame, i]
            patch = course.placements[p].candidates[0]
            f = free([0.0, -patch.friction, -patch.friction], [1.0, patch.friction, patch.friction])
            model.addCons(f[1] * f[1] + f[2] * f[2] <= patch.friction**2 * f[0] * f[0])
            world = [sum(float(patch.frame[j, a]) * f[a] for a in range(3)) for j in range(3)]
            net = [a + b for a, b in zip(net, world, strict=True)]
            moment = [a + b for a, b in zip(moment, cross(toes[p], world), strict=True)]
        for row in (*net, *moment):
            model.addCons(row == 0)
    weights, cost = course.weights, 0.0
    cost += weights.goal * sum((com[-1][j] - float(course.goal_m[j])) ** 2 for j in range(3))
    cost += weights.tilt * sum(x * x for row in turn for x in row)
    for k in range(1, course.frames):
        step = [com[k][j] - com[k - 1][j] for j in range(3)]
        within(step, course.steps.com_m)
        within([turn[k][j] - turn[k - 1][j] for j in range(3)], course.steps.rotation_rad)
        model.addCons(step[2] >= course.steps.progress_m)  # these courses lead straight up
        cost += weights.com_step * sum(x * x for x in step)
        for i in range(len(course.robot.limbs)):
            before, after = course.holds[k - 1, i], course.holds[k, i]
            if before != after:
                step = [toes[after][j] - toes[before][j] for j in range(3)]
                within(step, course.steps.toe_m)
                cost += weights.toe_step * sum(x * x for x in step)
    value = model.addVar(lb=0.0)
    model.addCons(cost <= value)
    model.setObjective(value)
    model.optimize()
    return model.getPrimalbound() if model.getNSols() else np.inf, model.getDualbound()
