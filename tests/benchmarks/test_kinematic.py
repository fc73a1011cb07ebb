"""Planners without forces: what they place is within the published sets, and what they choose is
allowed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.published.kinematic import KinematicPlanner, Placed
from benchmarks.published.scene import read_scene
from stancekit.planners.answer.answer import Status
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.answer import Clock
from stancekit.planners.verify import check_plan

NEAR_M = 1e-5


def part(name: str, frames: int) -> Problem:
    """The beginning of a scene."""
    whole = read_scene(name)
    return replace(
        whole,
        footholds=tuple(put for put in whole.footholds if put.frame < frames),
        lifts=whole.lifts[:frames],
        com_nominal_m=whole.com_nominal_m[:frames],
        com_radius_m=whole.com_radius_m[:frames],
        goal_m=np.add(whole.footholds[0].toe_m, (0.5, 0.2, 0.47)),
    )


def misses(course: Problem, placed: Placed) -> dict[str, float]:
    """The worst of every kind of constraint, one after the other [m]."""
    names, found = (
        course.robot.limb_names,
        {"surface": 0.0, "reach": 0.0, "feet": 0.0, "sideways": 0.0},
    )
    for put, toe, chosen in zip(course.footholds, placed.toes_m, placed.choice, strict=True):
        patch = put.candidates[int(chosen)]
        found["surface"] = max(found["surface"], abs(float((toe - patch.centre_m) @ patch.normal)))
        low, high = patch.vertices_m.min(axis=0), patch.vertices_m.max(axis=0)
        found["surface"] = max(
            found["surface"], float(np.max(low - toe)), float(np.max(toe - high))
        )
    for stance in course.stances:
        for limb in stance.limbs:
            rows, toe = (
                course.robot.limbs[limb].reach_rows,
                placed.toes_m[course.holds[stance.frame, limb]],
            )
            out = rows.normals @ (toe - placed.com_m[stance.frame]) - rows.bounds_m
            found["reach"] = max(found["reach"], float(out.max()))
    for frame, lifted in enumerate(course.lifts):
        for pair in course.robot.relative_reach:
            if pair.limb in lifted:
                here, there = (
                    placed.toes_m[course.holds[frame, names.index(n)]]
                    for n in (pair.limb, pair.other)
                )
                found["feet"] = max(
                    found["feet"],
                    float((pair.rows.normals @ (there - here) - pair.rows.bounds_m).max()),
                )
        if lifted and frame + 1 < course.frames:
            step = placed.com_m[frame + 1, :2] - placed.com_m[frame, :2]
            found["sideways"] = max(found["sideways"], float(np.abs(step).max()))
    return found


@pytest.mark.parametrize("choice", ["l1", "mip"])
def test_feet_and_body_are_where_the_published_sets_have_them(choice):
    course = part("anymal-trot", 9)
    placed, message = KinematicPlanner(choice).place(course, Clock.start())
    assert not message
    assert max(misses(course, placed).values()) < NEAR_M


@pytest.mark.parametrize("solver", ["highs", "scip"])
def test_the_mixed_integer_program_chooses_surfaces_that_slacks_of_least_sum_leave_open(solver):
    """Published of the inclined surfaces: SL1M does not converge, the mixed-integer program
    does.
    """
    pytest.importorskip({"highs": "highspy", "scip": "pyscipopt"}[solver])
    course = part("anymal-inclined-surfaces", 26)
    placed, message = KinematicPlanner("mip", solver=solver).place(course, Clock.start())
    assert not message
    assert max(misses(course, placed).values()) < NEAR_M
    assert (
        len(
            {
                tuple(put.candidates[int(c)].normal)
                for put, c in zip(course.footholds, placed.choice, strict=True)
            }
        )
        > 1
    )


def test_what_has_no_forces_is_refused_as_planned_and_accepted_where_forces_are_found():
    course = part("anymal-trot", 9)
    outcome = KinematicPlanner("mip").solve(course)
    assert outcome.claim == "feasible"
    assert outcome.details["as_planned"] == 0.0
    assert "moment_balance" in outcome.message
    assert (outcome.status is Status.FEASIBLE) == bool(outcome.details["freed"])
    assert outcome.solution is not None
    assert check_plan(outcome.solution).accepted


def test_a_course_without_positions_is_claimed_not_proved():
    course = read_scene("anymal-complex")
    for choice in ("l1", "mip"):
        outcome = KinematicPlanner(choice).solve(course)
        assert outcome.status is Status.UNDECIDED
        assert outcome.message.startswith("kinematics: ")
        assert outcome.claim == ("infeasible" if choice == "mip" else "unknown")


def test_feet_alone_have_no_body():
    course = part("anymal-trot", 9)
    planner = KinematicPlanner("mip", body=False)
    placed, _ = planner.place(course, Clock.start())
    assert placed.com_m is None
    outcome = planner.solve(course)
    assert outcome.message == "there is no body in the plan"


def test_other_names_and_other_reach_are_refused():
    with pytest.raises(InvalidInput, match=r"^choice: expected one of l1, mip, got 'l2'$"):
        KinematicPlanner("l2")
    with pytest.raises(
        InvalidInput, match=r"^solver: expected one of highs, scip that is installed, got 'mosek'$"
    ):
        KinematicPlanner("mip", solver="mosek")
    with pytest.raises(InvalidInput, match=r"expected reach as half-spaces, got a ball$"):
        KinematicPlanner("mip").solve(read_course("stairs", frames=3))
