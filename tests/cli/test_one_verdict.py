"""One verdict: the command, Python and the runner say the same of one file, and name the groups
that were checked.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import stancekit as library
from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.formats.plan_file import write_plan
from stancekit.planners.formats.trajectory_file import read_trajectory, write_trajectory
from stancekit.planners.verify import PLAN_GROUPS, check_plan
from stancekit.planners.verify.trajectories import GROUPS, check_trajectory
from stancekit.planners.verify.trajectory_measurements import WHOLE_BODY
from stancekit.runner.acceptance import Accepted
from tests.forgeries import stances, walks
from tests.forgeries.crawl import crawl
from tests.refusals import assert_names, refuses

walk, plan = cache(crawl), cache(stances.honest_plan)
FORGED_WALKS = (
    "skating",
    "weight missing",
    "dragged",
    "facing elsewhere",
    "starting in motion",
    "sucking",
)
FORGED_PLANS = ("weight missing", "a toe moved", "a limb that moves carries", "the body tilted")


@cache
def walks_of() -> dict[str, Trajectory]:
    forged = {
        name: walks.KINDS[name](walk(), 2.0, np.random.default_rng(2)) for name in FORGED_WALKS
    }
    return {
        "honest": walk(),
        "open": replace(walk(), heading_rad=None, still=(False, False)),
        **forged,
    }


@cache
def plans_of() -> dict[str, Plan]:
    forged = {
        name: stances.PLANS[name](plan(), 3.0, np.random.default_rng(3)) for name in FORGED_PLANS
    }
    return {"honest": plan(), **forged}


@pytest.mark.parametrize("name", ["honest", "open", *FORGED_WALKS])
def test_a_walk_has_one_verdict(name: str, stancekit, tmp_path: Path) -> None:
    path, trajectory = tmp_path / "walk.json", walks_of()[name]
    written = check_trajectory(trajectory)
    write_trajectory(path, trajectory, written)
    ran = stancekit("verify", path, "--json")
    (message,) = ran.records
    python = library.verify(library.load(path))
    assert (ran.code == 0) == message["accepted"] == python.accepted == written.accepted
    assert message["accepted"] == (name in ("honest", "open"))
    assert message["message"] == python.message == written.message
    assert (
        message["digest"]
        == python.digest
        == written.digest
        == read_trajectory(path).verdict["digest"]
    )
    assert sorted(message["checked"] + message["not_checked"]) == sorted(GROUPS)
    assert stancekit("verify", path).out.splitlines()[0] == f"{path}: {written.message}"


def test_a_walk_of_which_something_is_not_checked_says_so_and_is_not_run(
    stancekit, tmp_path: Path
) -> None:
    path, trajectory = tmp_path / "walk.json", walks_of()["open"]
    report = check_trajectory(trajectory)
    assert report.unchecked == ("heading", "rest", "rest_acceleration", *WHOLE_BODY)
    assert report.accepted
    assert_names(report.message, *report.unchecked)
    write_trajectory(path, trajectory, report)
    assert stancekit("verify", path, "--json").records[0]["not_checked"] == list(report.unchecked)
    with refuses("heading", "rest", "rest_acceleration"):
        Accepted.from_file(path)


@pytest.mark.parametrize("name", ["honest", *FORGED_PLANS])
def test_a_plan_has_one_verdict(name: str, stancekit, tmp_path: Path) -> None:
    path, made = tmp_path / "plan.json", plans_of()[name]
    written = check_plan(made, joints=True)
    write_plan(path, made, written)
    ran = stancekit("verify", path, "--json")
    (record,) = ran.records
    message, python = record["report"], library.verify(library.load(path))
    assert (
        (ran.code == 0)
        == message["accepted"]
        == python.accepted
        == written.accepted
        == (name == "honest")
    )
    assert record["verdict"] == ("accepted" if message["accepted"] else "refused")
    assert message["digest"] == python.digest == written.digest
    assert message["checked"] == list(python.checked) == list(written.checked)
    assert [group["group"] for group in message["groups"]] == list(PLAN_GROUPS)
    if name == "honest":
        assert (
            Accepted.from_file(path).digest == check_plan(made).digest
        )  # of contacts; joints it asks of its world
    else:
        with refuses("plan.json"):
            Accepted.from_file(path)
