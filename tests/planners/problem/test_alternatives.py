"""Other layouts: what they change, and that they are tried in order while there is time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.report import Group
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Problem
from stancekit.planners.problem.alternatives import ALTERNATIVES, AS_ASKED, HIGHER, Alternative
from stancekit.planners.problem.candidates import CandidatePatches, NoPlace
from stancekit.planners.problem.course_file import is_scene, read_course, read_spec
from stancekit.planners.robot.model import Limb, hexapod
from stancekit.planners.search.plan_course import plan_course
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.terrain.terrain import Terrain
from stancekit.planners.verify import check_plan


def test_the_first_alternative_changes_nothing() -> None:
    spec = read_spec("stairs")
    assert AS_ASKED.of(spec, hexapod()) == spec
    assert AS_ASKED.message == ""
    assert ALTERNATIVES[0] is AS_ASKED
    assert len({each.message for each in ALTERNATIVES}) == len(ALTERNATIVES)


def test_a_wider_and_lower_stance_scales_every_toe_about_the_centre_of_mass() -> None:
    robot, spec = hexapod(), read_spec("stairs")
    changed = Alternative(spread=1.2, height=0.5).of(spec, robot)
    for limb in robot.limbs:
        out = limb.shoulder_m * [1, 1, 0]
        before = limb.shoulder_m + spec.stance.outward_m * out / np.linalg.norm(out) - [0, 0, spec.stance.down_m]
        np.testing.assert_allclose(limb.shoulder_m + changed.stance.limbs[limb.name], before * [1.2, 1.2, 0.5])


def test_a_wave_goes_from_the_rear_to_the_front_on_one_side_and_then_the_other() -> None:
    spec = Alternative(gait="wave").of(read_spec("stairs"), hexapod())
    assert spec.gait == [["LR"], ["LM"], ["LF"], ["RR"], ["RM"], ["RF"]]


def test_further_candidates_are_offered() -> None:
    course = read_course("stairs", frames=3, alternative=Alternative(candidates=2))
    assert max(len(foothold.candidates) for foothold in course.footholds) > 1
    assert all(len(foothold.candidates) == 1 for foothold in read_course("stairs", frames=3).footholds)


def test_others_are_tried_where_the_first_has_no_place_for_a_toe() -> None:
    tried = list[str]()

    def question(_: object, alternative: Alternative) -> Problem:
        tried.append(alternative.message)
        if alternative is not ALTERNATIVES[2]:
            raise NoPlace(f"frame 0: nowhere ({len(tried)})")
        return read_course("walls", frames=2)

    outcome: Answer[Plan] = plan_course(question, TwoStageCoursePlanner(), layouts=ALTERNATIVES)
    assert outcome.status is Status.FEASIBLE
    assert outcome.solution is not None
    assert outcome.solution.provenance["layout"] == ALTERNATIVES[2].message
    assert outcome.report is not None
    assert outcome.report.answer is outcome.solution
    assert tried == [each.message for each in ALTERNATIVES[:3]]
    with pytest.raises(NoPlace, match=r"nowhere \(4\)"):
        plan_course(question, TwoStageCoursePlanner(), deadline=math.inf)  # the first alone


@pytest.mark.parametrize("worst", [None, {"frame": 1.0, "link": "trunk", "other": "patch 1"}])
def test_a_higher_body_is_tried_first_where_a_foot_alone_stays_from_its_path(worst: object) -> None:
    tried = list[str]()

    class Astray(TwoStageCoursePlanner):
        def solve(self, course: Problem) -> Answer[Plan]:
            answer = super().solve(course)
            assert answer.solution is not None
            report, figures = check_plan(answer.solution), {"worst": worst}
            motion = Group("motion", unit="m", verdict="violated", message="a foot", figures=figures)
            report = replace(report, groups=(*report.groups, motion))
            return replace(answer, status=Status.UNDECIDED, report=report)

    def question(_: object, alternative: Alternative) -> Problem:
        tried.append(alternative.message)
        return read_course("walls", frames=2)

    outcome: Answer[Plan] = plan_course(question, Astray(reserve=False), limits=None, layouts=ALTERNATIVES)
    assert outcome.status is Status.UNDECIDED
    second, *others = [each.message for each in ALTERNATIVES[1:]]
    order = ["", HIGHER.message, second, *others[:-1]] if worst is None else ["", second, *others]
    assert tried == order


def test_a_surface_has_to_face_the_hip_and_not_the_middle_of_what_the_foot_reaches() -> None:
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    floor = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.6)
    footing = CandidatePatches(Terrain(patches=(floor,), footing=(True,)), 0.0)
    below, toe = np.array([0.0, 0.0, -0.05]), np.zeros(3)
    ball = {"name": "leg", "shoulder_m": [0.0, 0.0, -0.35], "reach_m": 0.3}
    assert not footing.candidates(Limb(**ball), below, toe, 1, 0.2)
    assert footing.candidates(Limb(**ball, hip_m=np.zeros(3)), below, toe, 1, 0.2)


def test_a_published_scene_has_one_layout() -> None:
    assert is_scene("anymal-stairs")
    assert not is_scene("walls")
    with pytest.raises(InvalidInput, match=r"no other layout of a published scene, got toes 1\.15"):
        read_course("anymal-stairs", alternative=ALTERNATIVES[1])
