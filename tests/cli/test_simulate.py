"""`stancekit simulate`: a plan file in, what happened out."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from stancekit.cli.simulate import _message
from stancekit.planners.answer.plan import Plan
from stancekit.planners.formats.plan_file import write_plan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_plan


@cache
def step() -> Plan:
    outcome = TwoStagePlanner().solve(read_course("walls", frames=2))
    assert outcome.solution is not None
    return outcome.solution


@pytest.fixture
def file(tmp_path: Path) -> str:
    write_plan(tmp_path / "plan.json", step(), check_plan(step()))
    return "plan.json"


def test_a_plan_that_is_executed_gives_one_object_and_exit_code_0(file, stancekit, tmp_path):
    ran = stancekit("simulate", file, "--pace", "2", "--out", "trace.npz", "--json")
    assert ran.code == 0
    (said,) = ran.records
    assert said["plan"] == "plan.json"
    assert (said["world"], said["succeeded"], said["message"]) == ("mujoco", True, "")
    with np.load(tmp_path / "trace.npz", allow_pickle=False) as arrays:
        assert len(arrays["time_s"]) == round(200 * said["seconds"])


def test_people_get_a_table_and_a_picture(file, stancekit, tmp_path):
    ran = stancekit("simulate", file, "--pace", "2", "--picture", "end.png")
    assert ran.code == 0
    assert "executed as planned" in ran.out
    assert "written: end.png" in ran.out
    assert (tmp_path / "end.png").read_bytes().startswith(b"\x89PNG")


def test_a_plan_that_the_verifier_rejected_is_not_executed(stancekit, tmp_path):
    bad = replace(step(), com_m=step().com_m + np.array([0.0, 0.05, 0.0]))
    write_plan(tmp_path / "bad.json", bad, check_plan(bad))
    ran = stancekit("simulate", "bad.json", "--json")
    assert (ran.code, ran.out) == (2, "")
    assert (
        " ".join(ran.err.split())
        == "stancekit: error: bad.json: expected a plan that the verifier accepted, this one it rejected"
    )


def test_a_plan_file_that_was_edited_is_refused(file, stancekit, tmp_path):
    header = json.loads((tmp_path / file).read_text())
    header["course"]["gravity_m_s2"] = 1.0
    (tmp_path / file).write_text(json.dumps(header))
    ran = stancekit("simulate", file)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith("stancekit: error: plan.json: ")
    assert ran.err.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--pace", "0"), "--pace: expected a number in [0.1, 4], got 0"),
        (("--out", "trace.csv"), "--out: expected a name that ends in .npz, got trace.csv"),
        (("--picture", "end.gif"), "end.gif: expected a name that ends in "),
    ],
)
def test_bad_options_are_refused_before_anything_moves(options, said, file, stancekit):
    ran = stancekit("simulate", file, *options)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"stancekit: error: {said}")


def test_a_run_that_was_stopped_says_so_before_how_far_it_was_from_its_end():
    off = SimpleNamespace(message="the centre of mass ended 529 mm from the plan's")
    report = SimpleNamespace(
        stopped_s=None, frames_done=2.0, frames=12.0, counted="key frames", message="off"
    )
    assert _message(report, off) == off.message
    report.stopped_s, report.message = 17.0, "signal SIGTERM"
    assert _message(report, off) == "stopped after 2 of 12 key frames: signal SIGTERM"
