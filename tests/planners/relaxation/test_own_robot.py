"""Envelopes of a robot's file: P1 with half-spaces of reach, boxes in the course's units, and whose
they are.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.boxes import boxes_of, mirrored
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import McCormick, WithoutMoment
from stancekit.planners.robot.reach import ReachRows
from stancekit.planners.search.answer import plan_of
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.verify import check_postures
from tests.refusals import refuses


def walled(problem: Problem, shift_m: float = 0.0) -> Problem:
    """The problem with legs that reach little but their patches' middles, or places beside them,
    and a name.
    """
    contacts = []
    for i, contact in enumerate(problem.contacts):
        normals = np.vstack([np.eye(3), -np.eye(3)])
        middle = contact.patch.vertices_m.mean(axis=0) + np.array([shift_m, 0.0, 0.0])
        bounds = normals @ middle + 0.04 + 0.01 * i
        contacts.append(replace(contact, reach_rows=ReachRows(normals=normals, bounds_m=bounds)))
    return problem.posture_with(contacts=tuple(contacts), tilt_limit_rad=0.0, robot="dog-1")


def feasible(drawn, count: int) -> list[tuple[Problem, np.ndarray]]:
    """Problems with half-spaces, and [p, f] of a posture of each."""
    found, planner = [], ExactPlanner()
    for seed in range(60):
        problem = walled(drawn("ground-3", seed))
        posture = planner.solve(problem).solution
        if posture is not None:
            found.append((problem, Scaled.of(problem).point(posture)))
        if len(found) == count:
            break
    assert len(found) == count
    return found


def test_p1_over_half_spaces_admits_every_posture_in_its_box(drawn, programs: Programs) -> None:
    for problem, point in feasible(drawn, 6):
        scaled = Scaled.of(problem)
        box = Envelope(low=point - 0.05, high=point + 0.05)
        assert programs.get(McCormick, scaled.layout).solve(scaled, box).margin <= 1e-7


def test_p1_over_half_spaces_refuses_what_they_keep_out_and_balls_let_in(
    drawn, programs: Programs
) -> None:
    kept_out = 0
    for seed in range(20):
        plain, problem = drawn("ground-3", seed), walled(drawn("ground-3", seed), 0.3)
        wide = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
        loose, tight = (
            programs.get(McCormick, scaled.layout).solve(scaled, wide)
            for scaled in map(Scaled.of, (plain, problem))
        )
        assert loose.margin <= tight.margin + 1e-6
        kept_out += bool(np.isfinite(loose.margin) and np.isinf(tight.margin))
    assert kept_out > 5


def test_points_without_moments_are_in_the_inner_sets(drawn, programs: Programs) -> None:
    looked = 0
    for seed in range(12):
        problem = replace(walled(drawn("ground-3", seed)), tilt_limit_rad=0.2)
        scaled = Scaled.of(problem)
        point = programs.get(WithoutMoment, scaled.layout, True).solve(scaled)
        if point is not None:
            looked += 1
            worst = check_postures(
                [plan_of(problem, scaled, scaled.numbers, point)], without=("moment_balance",)
            )
            assert worst[0] <= 1e-6
    assert looked > 3


# ----------------------------------------------------------------------------------------------------
# whose they are


@pytest.fixture
def learned(drawn) -> EnvelopeSet:
    box = Envelope(low=np.full((3, 6), -0.9), high=np.full((3, 6), 0.9))
    return EnvelopeSet.for_problems(
        "ground-3-of-dog-1", [walled(drawn("ground-3", seed)) for seed in range(9)], [box]
    )


def test_envelopes_keep_the_name_of_their_robot_in_their_file(learned: EnvelopeSet) -> None:
    assert learned.robot == "dog-1"
    data = json.loads(json.dumps(learned.to_json()))
    assert EnvelopeSet.from_json(data).robot == "dog-1"
    del data["robot"]
    old = EnvelopeSet.from_json(data)
    assert (old.robot, "robot" in old.to_json()) == ("", False)


def test_envelopes_of_another_robot_are_refused(learned: EnvelopeSet, drawn) -> None:
    problem = walled(drawn("ground-3", 0))
    learned.check_fits(problem)
    for other, message in (("cat-2", "cat-2"), ("", "the default hexapod")):
        with pytest.raises(InvalidInput) as error:
            learned.check_fits(problem.posture_with(robot=other))
        wants = "robot: expected dog-1 for an envelope learned for ground-3-of-dog-1"
        assert str(error.value) == f"{wants}, got {message}"
    course = problem.posture_with(robot="cat-2").course()
    with refuses("robot"):
        boxes_of(course, learned)


def test_boxes_of_a_named_robot_are_told_in_the_units_of_the_course(
    learned: EnvelopeSet, drawn
) -> None:
    course = walled(drawn("ground-3", 0)).course()
    (box,) = boxes_of(replace(course, length_scale_m=0.3), learned)
    np.testing.assert_allclose(box.high, [[1.8] * 3 + [0.9] * 3] * 3)
    np.testing.assert_allclose(box.low, -box.high)


def test_a_stance_takes_the_set_of_its_own_legs(learned: EnvelopeSet, drawn) -> None:
    course = walled(drawn("ground-3", 0)).course()
    other = replace(learned, legs=tuple(reversed(learned.legs)), problem_class="reversed")
    with refuses("envelopes"):
        boxes_of(
            course,
            [learned, replace(learned, envelopes=learned.envelopes * 2, problem_class="doubled")],
        )
    (box,) = boxes_of(course, learned)
    for order in ([learned, other], [other, learned]):
        (one,) = boxes_of(course, order)
        np.testing.assert_array_equal(one.low, box.low)


def test_legs_that_were_measured_are_mirrored_to_the_nearest(drawn) -> None:
    course = walled(drawn("ground-3", 0)).course()
    limbs = course.robot.limbs
    away = [
        replace(limb, shoulder_m=limb.shoulder_m + np.array([0.01 * i, 0.0, 0.0]))
        for i, limb in enumerate(limbs)
    ]
    both = [
        replace(limb, name=f"{limb.name}'", shoulder_m=limb.shoulder_m * [1.0, -1.0, 1.0])
        for limb in limbs
    ]
    robot = replace(course.robot, limbs=(*away, *both))
    box = Envelope(low=np.full((3, 6), -0.9), high=np.full((3, 6), 0.9))
    problems = [walled(drawn("ground-3", seed)) for seed in range(3)]
    assert mirrored(EnvelopeSet.for_problems("x", problems, [box]), robot).legs == (
        "RF'",
        "RR'",
        "LM'",
    )
    with refuses("RR"):
        mirrored(EnvelopeSet.for_problems("x", problems, [box]), replace(robot, identity=""))
