"""Other layouts: what they change, and that they are tried in order while there is time."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit import Answer, Group, Motion, Status
from stancekit.planners.errors import NoPlace, PlanningFailed, StancekitError
from stancekit.planners.problem import Problem
from stancekit.planners.problem.contact import CandidatePatches
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.problem.course_file import read_course, read_spec
from stancekit.planners.problem.course_keys import (
    ALTERNATIVES,
    AS_ASKED,
    HIGHER,
    LOW,
    STRIDES,
    TABLE,
    Alternative,
    ordered,
)
from stancekit.planners.problem.guide_path import Overhead
from stancekit.planners.robot.model import Limb, hexapod
from stancekit.planners.search.plan_course import plan_course
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain.families import Terrain
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.verify import check_plan
from tests.refusals import refuses


def test_a_wider_and_lower_stance_scales_every_toe_about_the_centre_of_mass() -> None:
    robot, spec = hexapod(), read_spec("stairs")
    changed = Alternative(spread=1.2, height=0.5).of(spec, robot)
    for limb in robot.limbs:
        out = limb.shoulder_m * [1, 1, 0]
        before = (
            limb.shoulder_m
            + spec.stance.outward_m * out / np.linalg.norm(out)
            - [0, 0, spec.stance.down_m]
        )
        np.testing.assert_allclose(
            limb.shoulder_m + changed.stance.limbs[limb.name], before * [1.2, 1.2, 0.5]
        )


def test_a_wave_goes_from_the_rear_to_the_front_on_one_side_and_then_the_other() -> None:
    assert Alternative(gait="wave").of(read_spec("stairs"), hexapod()).gait == [
        [name] for name in ("LR", "LM", "LF", "RR", "RM", "RF")
    ]


def test_a_level_body_has_no_tilt_in_a_file_and_over_a_terrain() -> None:
    level = Alternative(level=True)
    assert read_course("walls", frames=2, alternative=level).tilt_limit_rad == 0.0
    ground = laid_between(stancekit.terrain("ramps:0.2:1"), (0.0, 0.0), (0.2, 0.0), frames=2)
    assert ground("inner", AS_ASKED).tilt_limit_rad > ground("inner", level).tilt_limit_rad == 0.0


def test_the_table_of_successes_has_every_other_layout_for_all_that_may_be_missing() -> None:
    table = json.loads(TABLE.read_text(encoding="utf-8"))
    assert set(table) == {"contacts", "body"}
    for rows in table.values():
        assert {row["layout"] for row in rows} == {each.message for each in ALTERNATIVES[1:]}
        assert sum(row["accepted"] for row in rows) > 0
        assert all(row["adds"] <= row["accepted"] <= row["of"] for row in rows)
    for missing, rows in table.items():
        assert ordered(ALTERNATIVES[1:], missing)[0].message == rows[0]["layout"]
    mine = Alternative(spread=2.0)
    assert [each.message for each in ordered([mine, *ALTERNATIVES[1:]], "body")] == [
        *(row["layout"] for row in table["body"]),
        mine.message,
    ]


def test_a_computer_that_is_busy_gives_layouts_as_much_of_its_processor_as_one_that_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wall_s, own_s = [0.0], [0.0]
    monkeypatch.setattr(
        "stancekit.planners.search.plan_course.time.perf_counter", lambda: wall_s[0]
    )
    monkeypatch.setattr("stancekit.planners.search.plan_course.time.process_time", lambda: own_s[0])
    ends = list[float]()

    class Slow(TwoStage):
        def with_limit(self, limit_s: float) -> Slow:
            ends.append(wall_s[0] + limit_s)
            return self

        def solve(self, course: Problem) -> Answer[Motion]:
            wall_s[0] = ends[-1]
            own_s[0] = wall_s[0] / 4.0  # a quarter of a processor
            return Answer(status=Status.UNDECIDED, method="slow", problem=course)

    def question(_: object, alternative: Alternative) -> Problem:
        return read_course("walls", frames=2)

    plan_course(question, Slow(reserve=False), limits=None, layouts=ALTERNATIVES[:4], deadline=60.0)
    assert ends == pytest.approx(
        [0.6 * 60.0, 60.0]
    )  # 8 s of a quarter take 32 s, and 24 s are left
    wall_s[0], own_s[0] = 0.0, 0.0
    ends.clear()
    plan_course(
        question, Slow(reserve=False), limits=None, layouts=ALTERNATIVES[:4], deadline=400.0
    )
    assert ends == pytest.approx([240.0, 336.0, 374.4, 400.0])


@pytest.mark.parametrize(
    ("good", "refused", "said"),
    [
        (ALTERNATIVES[2], NoPlace, "nowhere"),
        (STRIDES[1], NoPlace, "nowhere"),
        (LOW[1], PlanningFailed, "nowhere"),
        (LOW[-1], PlanningFailed, Overhead("no way: bar at (1, 0)")),
    ],
)
def test_others_are_tried_where_the_first_has_no_place_and_low_ones_first_where_it_is_too_high(
    good: Alternative, refused: type[StancekitError], said: str
) -> None:
    tried = list[str]()

    def question(_: object, alternative: Alternative) -> Problem:
        tried.append(alternative.message)
        if alternative is not good:
            raise refused(type(said)(f"frame 0: {said} ({len(tried)})"))
        return read_course("walls", frames=2)

    outcome: Answer[Motion] = plan_course(question, TwoStage(), layouts=ALTERNATIVES, stated=False)
    assert outcome.status is Status.FEASIBLE
    assert outcome.solution is not None
    assert outcome.solution.provenance["layout"] == good.message
    assert outcome.report is not None
    assert outcome.report.answer is outcome.solution
    others = [*ordered(ALTERNATIVES[1:], "contacts"), *STRIDES]
    order = [AS_ASKED, *others, *LOW]
    if isinstance(said, Overhead):
        lower = [ALTERNATIVES[1], STRIDES[2], *LOW]
        order = [AS_ASKED, *lower, *(each for each in others if each not in lower)]
    assert tried[1:] == [each.message for each in order[: order.index(good) + 1]]
    with refuses(f"({len(tried) + 1})", kind=refused):
        plan_course(question, TwoStage(), deadline=math.inf)  # the first alone


@pytest.mark.parametrize("worst", [None, {"frame": 1.0, "link": "trunk", "other": "patch 1"}])
def test_a_higher_body_is_tried_first_where_a_foot_alone_stays_from_its_path(worst: object) -> None:
    tried = list[str]()

    class Astray(TwoStage):
        def solve(self, course: Problem) -> Answer[Motion]:
            answer = super().solve(course)
            assert answer.solution is not None
            report, figures = check_plan(answer.solution), {"worst": worst}
            motion = Group(
                "motion", unit="m", verdict="violated", message="a foot", figures=figures
            )
            report = replace(report, groups=(*report.groups, motion))
            return replace(answer, status=Status.UNDECIDED, report=report)

    def question(_: object, alternative: Alternative) -> Problem:
        tried.append(alternative.message)
        return read_course("walls", frames=2)

    outcome: Answer[Motion] = plan_course(
        question, Astray(reserve=False), limits=None, layouts=ALTERNATIVES
    )
    assert outcome.status is Status.UNDECIDED
    others = [each.message for each in ordered(ALTERNATIVES[1:], "body")]
    if worst is None:
        others.remove(HIGHER.message)
        others.insert(0, HIGHER.message)
    assert tried == ["", *others]


def test_a_surface_has_to_face_the_hip_and_not_the_middle_of_what_the_foot_reaches() -> None:
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    floor = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.6)
    footing = CandidatePatches(Terrain(patches=(floor,), footing=(True,)), 0.0)
    below, toe = np.array([0.0, 0.0, -0.05]), np.zeros(3)
    ball = {"name": "leg", "shoulder_m": [0.0, 0.0, -0.35], "reach_m": 0.3}
    assert not footing.candidates(Limb(**ball), below, toe, 1, 0.2)
    assert footing.candidates(Limb(**ball, hip_m=np.zeros(3)), below, toe, 1, 0.2)
