"""Leaps in MuJoCo: landing, and stops before, in and after the air."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit.planners.leap.finder import find_leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.runner.acceptance import Accepted
from stancekit.runner.report import RunReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import make_world
from tests.refusals import refuses

FILE = Path(__file__).parents[1] / "data" / "leap-hop-anymal.json"


@pytest.fixture(scope="module")
def accepted() -> Accepted:
    return Accepted.from_file(FILE)


def stopped_at(accepted: Accepted, when_s: float) -> RunReport:
    """The report of a run whose e-stop is pressed at a time of the world."""
    runners = list[Runner]()

    def pressed() -> str:
        state = runners[0].state if runners else None
        return "e-stop" if state is not None and state.time_s >= when_s else ""

    world = make_world("mujoco", accepted.robot)
    runners.append(Runner(world, sources=(pressed,)))
    return runners[0].run(accepted)


@pytest.fixture(scope="module")
def ran(accepted: Accepted, tmp_path_factory: pytest.TempPathFactory) -> tuple[RunReport, Path]:
    """A run that nothing stops, and its log."""
    log = tmp_path_factory.mktemp("ran") / "leap.mcap"
    return stancekit.run(accepted, "mujoco", log=log), log


def test_a_leap_lands_where_it_should_and_stands(ran: tuple[RunReport, Path]):
    report, _ = ran
    assert report.succeeded, report.message
    assert report.execution.com_final_m < 0.01
    assert report.execution.trace.rotation[-1, 2, 2] > 0.95
    flies = ~(report.execution.trace.foothold >= 0).any(axis=1)
    assert np.count_nonzero(flies) > 20


def test_a_replay_sends_the_same(accepted: Accepted, ran: tuple[RunReport, Path]):
    first, log = ran
    again = stancekit.run(accepted, "replay", setup=log)
    assert again.sent == first.sent
    assert again.replay_rad == 0.0


def test_a_stop_before_take_off_is_obeyed_at_once(accepted: Accepted):
    report = stopped_at(accepted, 0.6)
    assert report.message == "e-stop"
    assert report.execution.seconds < 0.75
    assert report.execution.trace.rotation[-1, 2, 2] > 0.95


def test_a_stop_in_the_air_lands_first(accepted: Accepted):
    report = stopped_at(accepted, 1.4)
    assert report.message == "e-stop"
    assert not report.succeeded
    assert report.execution.seconds > 2.0
    assert report.execution.trace.rotation[-1, 2, 2] > 0.95
    assert report.execution.com_final_m < 0.02


def test_a_fault_in_the_air_leaves_no_leap_that_a_stop_waits_for(accepted: Accepted):
    world = make_world("mujoco", accepted.robot)
    runner = Runner(world)

    def fails(state: object) -> None:
        if runner.latch.lands:
            raise ValueError("in the air")

    runner.check_body = lambda target, state: fails(state)
    with refuses(kind=ValueError):
        runner.run(accepted)
    assert not runner.latch.lands


def test_a_leap_that_nobody_judged_with_legs_is_not_run():
    plan = find_leap(leap_class("leap-given").draw(np.random.default_rng(0))).solution
    with refuses("leap", "joints", "torque"):
        stancekit.run(plan, "mujoco")


def test_a_leap_has_one_pace(accepted: Accepted):
    with refuses("timing"):
        stancekit.run(
            accepted, "mujoco", settings=RunSettings(timing=RunSettings().timing.at_pace(0.5))
        )


def test_a_leap_that_begins_in_motion_is_not_run(accepted: Accepted):
    leap = accepted.plan.problem
    start = replace(leap.start, velocity_m_s=np.array([5e-4, 0.0, 0.0]))
    with refuses("x1"):
        stancekit.run(replace(accepted.plan, problem=replace(leap, start=start)), "mujoco")


def test_no_push_is_asked_of_a_leap(accepted: Accepted):
    with refuses("least_push"):
        stancekit.run(accepted, "mujoco", settings=RunSettings(least_push=0.5))
