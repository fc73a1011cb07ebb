"""What is said of leaps that are judged on legs and bent: of contacts, of legs, and of the time."""

import time
from dataclasses import replace
from pathlib import Path

import pytest

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.leap_plan import LeapPlan
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.formats.leap_file import read_leap
from stancekit.planners.leap.bend import LeapBender, judged_answer
from stancekit.planners.problem.leap import LeapLimits

pytest.importorskip("pinocchio")
FILE = Path(__file__).parents[2] / "data" / "leap-hop-anymal.json"


@pytest.fixture(scope="module")
def plan() -> LeapPlan:
    found = read_leap(FILE).plan
    assert found is not None
    return found


def said(plan: LeapPlan) -> Answer[LeapPlan]:
    """What is said of a plan when the time for bending has ended."""
    answer = Answer(status=Status.FEASIBLE, solution=plan, problem=plan.problem, method="finder")
    return judged_answer(answer, Programs(), deadline=time.perf_counter() - 1.0)


def test_contacts_that_do_not_hold_are_not_laid_to_legs(plan: LeapPlan):
    weak = replace(plan, problem=replace(plan.problem, limits=LeapLimits(force_share=0.3)))
    judged = LeapBender(Programs()).judge(weak)
    assert not any(group.verdict == "violated" for group in judged.groups)
    assert not judged.accepted
    assert judged.score > 0.0
    answer = said(weak)
    assert answer.status is Status.UNDECIDED
    assert answer.message.startswith("contacts of the bent leap do not hold: force_bounds")


def test_a_leap_that_nobody_had_time_to_bend_says_so(plan: LeapPlan, tmp_path):
    from stancekit.configs import config_path
    from stancekit.planners.robot.leg_limits import leaping_robot

    text = config_path("robots/anymal.urdf").read_text()
    (tmp_path / "slow.urdf").write_text(text.replace('velocity="12"', 'velocity="5"'))
    model = leaping_robot(tmp_path / "slow.urdf").source.own_model()
    robot = replace(plan.problem.robot, model=model)
    answer = said(replace(plan, problem=replace(plan.problem, robot=robot)))
    assert answer.status is Status.UNDECIDED
    assert answer.message.startswith("the time ended before legs could do it: joint_speed")
