"""What becomes of an outcome when its plan is one of the whole body."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit import Answer, Motion, Status
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.search.answer import objective_of
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.margins import with_margins
from tests.planners.robot.small_urdfs import quadruped

pytest.importorskip("pinocchio")
from stancekit.planners.search import witness
from stancekit.planners.search.witness import with_whole_body
from tests.refusals import assert_names, refuses


@pytest.fixture(scope="module")
def planned() -> Answer[Motion]:
    return plan_with_reserve(TwoStage(), read_course("walls", frames=4))


def test_a_plan_within_torque_is_feasible_with_the_numbers_of_what_it_became(
    planned: Answer[Motion],
) -> None:
    outcome = with_whole_body(planned, WholeBodyLimits(torque_nm=10.0))
    said = outcome.report
    assert outcome.solution is not None
    assert planned.solution is not None
    assert said is not None
    assert outcome.status is Status.FEASIBLE
    report = check_plan(outcome.solution, joints=True)
    assert report.accepted
    assert said.answer is outcome.solution
    assert said.to_json() == report.to_json()
    assert outcome.objective == objective_of(outcome.solution) != planned.objective
    assert outcome.residual <= 1e-6
    assert outcome.details["torque_nm"] == pytest.approx(
        report.group("torque").figures["torque_nm"]
    )
    assert outcome.details["torque_nm"] <= 10.0 < outcome.details["torque_nm_before"]
    assert outcome.details["torque_steps"] >= 1.0
    assert set(planned.details) <= set(outcome.details)


def test_the_same_comes_of_the_library(planned: Answer[Motion]) -> None:
    limits = WholeBodyLimits(torque_nm=12.0, share=0.8)
    outcome = with_whole_body(planned, limits)
    same = stancekit.plan("walls", frames=4, settings=stancekit.PlanSettings(body=limits))
    assert outcome.solution is not None
    assert same.solution is not None
    np.testing.assert_array_equal(same.solution.com_m, outcome.solution.com_m)
    np.testing.assert_array_equal(same.solution.joints_rad, outcome.solution.joints_rad)
    assert same.details["torque_share"] <= 0.8
    assert stancekit.verify(same.solution).accepted


def test_what_torque_forbids_is_undecided_and_says_where(planned: Answer[Motion]) -> None:
    outcome = with_whole_body(planned, WholeBodyLimits(torque_nm=1.0, steps=2))
    assert outcome.status is Status.UNDECIDED
    assert outcome.certificate is None
    assert outcome.solution is not None
    assert check_plan(outcome.solution).accepted  # its contacts
    refused = check_plan(outcome.solution, joints=True)
    assert not refused.accepted
    worst = refused.group("torque").figures["worst"]
    assert_names(outcome.message, "torque", f"frame {worst['frame']}", f"limb {worst['limb']}")


def test_without_a_plan_there_is_nothing_to_bend(planned: Answer[Motion]) -> None:
    none = replace(planned, solution=None, status=Status.UNDECIDED)
    assert with_whole_body(none, WholeBodyLimits(torque_nm=10.0)) is none


def test_without_pinocchio_a_robot_of_balls_has_no_joints_unless_torques_are_asked_for(
    planned: Answer[Motion], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    outcome = with_whole_body(planned)
    assert outcome.solution is planned.solution
    assert (outcome.status, outcome.details) == (planned.status, planned.details)
    assert outcome.report is not None
    assert (outcome.report.accepted, outcome.report.group("joints").verdict) == (
        True,
        "not checked",
    )
    assert outcome.report.unchecked == ("joints", "torque", "bodies", "motion")
    with refuses("pinocchio"):
        with_whole_body(planned, WholeBodyLimits(torque_nm=10.0))


@pytest.mark.parametrize("written", [1e9, -5.0, "10", None, [10.0]])
def test_what_a_plan_says_of_its_torques_never_loosens_a_limit(
    planned: Answer[Motion], written: object
) -> None:
    assert planned.solution is not None
    forged = replace(
        planned.solution, provenance={**planned.solution.provenance, "torque_nm": written}
    )
    assert check_plan(forged, joints=True).group("torque") == check_plan(
        planned.solution, joints=True
    ).group("torque")


def test_a_plan_for_own_legs_that_is_about_to_tip_is_undecided_and_says_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "dog.urdf").write_text(quadruped())
    (tmp_path / "flat.yaml").write_text(
        "name: flat\nrobot: dog.urdf\nframes: 2\ngait: wave\nstart_m: [0.0, 0.0]\ngoal_m: [0.05, 0.0, 0.45]\n"
        "terrain: {kind: flat, friction: 0.7}\n"
    )
    planned = plan_with_reserve(TwoStage(), read_course(tmp_path / "flat.yaml"))
    stands = with_whole_body(planned)
    assert stands.report is not None
    least = with_margins(stands.report).group("margin").figures["push_n"] / planned.problem.weight_n
    assert stands.status is Status.FEASIBLE
    assert least > 0.01
    monkeypatch.setattr(witness, "LEAST_PUSH", least + 0.01)
    tips = with_whole_body(planned)
    assert tips.status is Status.UNDECIDED
    assert tips.report is not None
    assert tips.report.accepted  # what the verifier says of a file does not change
    assert_names(tips.message, "margin")
