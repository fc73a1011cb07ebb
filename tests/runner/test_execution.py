"""Plans executed in both worlds, what the report says of them, and plans that cannot succeed."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stancekit.planners.answer.plan import Plan
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.search.friction_margin import slippery
from stancekit.runner.execution import Execution, Tolerance
from stancekit.runner.run import simulate
from stancekit.runner.settings import RunSettings
from tests.refusals import assert_names

FAST = RunSettings(timing=Timing().at_pace(2.0), check_limits=False)


def executed(plan: Plan, world: str = "mujoco", **options: Any) -> Execution:
    """What the record of a simulation says."""
    report = simulate(plan, world, **({"settings": FAST} | options))
    assert report.execution is not None
    assert report.succeeded == report.execution.succeeded
    return report.execution


@pytest.fixture(scope="module")
def climbed(step: Callable[[str], Plan]) -> Execution:
    return executed(step("walls"))


@pytest.mark.parametrize(("course", "world"), [("stairs", "mujoco"), ("walls", "bullet")])
def test_a_step_is_executed_as_planned(
    course: str, world: str, step: Callable[[str], Plan]
) -> None:
    pytest.importorskip({"bullet": "pybullet", "mujoco": "mujoco"}[world])
    run = executed(step(course), world)
    assert run.succeeded, run.message
    assert run.fallen_s is None
    assert run.com_worst_m < 0.006
    assert run.slip_m.max() < 0.005
    assert run.force_rms_n < 6.0
    assert run.error_m < 1e-4
    assert run.bump_s == 0.0
    assert run.torque_worst_nm < run.torque_limit_nm


def test_at_the_end_every_foot_presses_as_planned(climbed: Execution) -> None:
    trace = climbed.trace
    np.testing.assert_allclose(
        trace.forces_n[-20:].mean(axis=0), trace.planned_forces_n[-1], atol=4.0
    )
    np.testing.assert_allclose(
        trace.forces_n[-20:].mean(axis=0).sum(axis=0), [0.0, 0.0, 98.1], atol=0.5
    )


def test_the_trace_is_consistent(climbed: Execution) -> None:
    trace = climbed.trace
    assert trace.time_s[-1] == pytest.approx(climbed.seconds)
    np.testing.assert_allclose(np.diff(trace.time_s), 0.005, atol=1e-9)
    away = np.linalg.norm(trace.com_m - trace.planned_com_m, axis=1)
    assert climbed.com_worst_m == pytest.approx(away.max())
    offset = np.linalg.norm(trace.com_m - trace.origin_m, axis=1)
    assert 0.0 < offset.max() < 0.015


def test_the_same_plan_runs_the_same_way_twice(
    step: Callable[[str], Plan], climbed: Execution
) -> None:
    again = executed(step("walls"))
    np.testing.assert_array_equal(again.trace.com_m, climbed.trace.com_m)
    np.testing.assert_array_equal(again.trace.forces_n, climbed.trace.forces_n)


def test_walls_that_are_more_slippery_than_planned_end_in_a_fall_that_is_reported(
    step: Callable[[str], Plan],
) -> None:
    plan = step("walls")
    settings = RunSettings(check_limits=False)
    run = executed(plan, settings=settings, terrain=slippery(plan.problem, 0.2).terrain)
    assert not run.succeeded
    assert run.fallen_s is not None
    assert run.slip_m.max() > Tolerance().slip_m
    assert_names(run.message, f"{run.fallen_s:.2f} s")
    assert run.seconds == pytest.approx(run.fallen_s)


def test_what_is_not_good_enough_is_said_in_full(step: Callable[[str], Plan]) -> None:
    run = executed(
        step("walls"), settings=replace(FAST, tolerance=Tolerance(com_m=1e-7, slip_m=1e-7))
    )
    assert not run.succeeded
    assert run.fallen_s is None
    assert min(run.com_final_m, run.slip_m.max()) > 1e-7
    assert_names(run.message, "centre of mass", "slipped")


def test_the_report_is_json_and_the_trace_an_archive(
    climbed: Execution, tmp_path: pytest.TempPathFactory
) -> None:
    said = json.loads(json.dumps(climbed.to_json(), allow_nan=False))
    assert said["world"] == "mujoco"
    assert len(said["slip_m"]) == 9
    assert "trace" not in said
    path = tmp_path / "trace.npz"  # type: ignore[operator]
    path.write_bytes(climbed.trace.to_npz())
    with np.load(path, allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["com_m"], climbed.trace.com_m)


def test_what_a_foot_rolls_is_no_slip_but_what_it_slides_is(climbed: Execution) -> None:
    trace = climbed.trace
    standing = int(trace.foothold[0, 0])
    slid = trace.feet_m.copy()
    slid[len(slid) // 2 :, 0] += [0.0, 0.0, 0.01]
    assert replace(trace, feet_m=slid).slips(9)[standing] == pytest.approx(0.01, abs=0.003)
    rolled = trace.rolled_m.copy()
    rolled[len(slid) // 2 :, 0] += [0.0, 0.0, 0.01]
    both = replace(trace, feet_m=slid, rolled_m=rolled).slips(9)[standing]
    assert both == pytest.approx(trace.slips(9)[standing], abs=1e-12)
