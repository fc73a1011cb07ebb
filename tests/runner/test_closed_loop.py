"""The closed loop: what it makes of measurements, and that it finds its way with less friction than
was planned for.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.answer import Planner
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.terrain import Patch
from stancekit.runner.control.closed_loop import ClosedLoop, LoopReport
from stancekit.runner.control.envelope_choice import Observation
from stancekit.runner.control.estimation import nearest_on
from stancekit.runner.control.loop_settings import LoopSettings
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import make_world
from tests.emulators.memory_world import PATIENT, MemoryWorld
from tests.emulators.slipping import SlippingWorld
from tests.refusals import refuses

FAST = RunSettings(timing=Timing().at_pace(2.0), limits=PATIENT)
PLANNER = TwoStagePlanner()


def looped(
    share: float, settings: LoopSettings, frames: int = 3
) -> tuple[LoopReport, list[Observation]]:
    seen: list[Observation] = []

    def policy(observation: Observation) -> Planner:
        seen.append(observation)
        return PLANNER

    course = read_course("walls", frames=frames)
    runner = Runner(make_world("mujoco", course.robot), settings=FAST)
    return ClosedLoop(course, runner, policy, settings).run(slippery(course, share).terrain), seen


def test_windows_are_walked_one_after_the_other_from_where_the_robot_stands() -> None:
    report, seen = looped(1.0, LoopSettings(horizon=1))
    assert report.succeeded, report.message
    assert (report.plans, report.replans, report.frames, report.friction.share) == (2, 0, 2, 1.0)
    assert [observation.frame for observation in seen] == [0, 1]
    assert seen[0].standing is None
    standing, state = seen[1].standing, seen[1].state
    assert standing is not None
    assert state is not None
    away = np.linalg.norm(state.feet_m - standing.toes_m, axis=1)
    np.testing.assert_allclose(
        away, 0.012, atol=1e-3
    )  # a foot's radius from the surface on which it stands
    assert report.deviation_m < 0.01


def test_the_ending_of_a_loop_that_is_stopped_waits_for_no_planner() -> None:
    course, world, over = read_course("walls", frames=3), MemoryWorld(), threading.Event()
    windows = list[int]()

    def policy(observation: Observation) -> Planner:
        windows.append(observation.frame)
        if observation.frame:
            world.latch.trip("button")
            over.wait(30.0)  # a planner that thinks
        return PLANNER

    runner = Runner(world, settings=replace(FAST, ending="torque-off"), dry=False)
    report = ClosedLoop(course, runner, policy, LoopSettings(horizon=1)).run()
    over.set()
    assert windows == [0, 1]
    assert (report.message, report.ended.left, world.torque_on) == ("button", "torque off", False)
    assert report.ended.seconds < 5.0


def test_less_friction_than_planned_is_felt_by_feet_that_slide_and_planned_with() -> None:
    report, seen = looped(0.7, LoopSettings(replan_m=0.008), frames=3)
    assert report.succeeded, report.message
    assert report.replans >= 1
    assert report.friction.share == pytest.approx(0.7, abs=0.03)
    assert seen[-1].window.terrain[0].friction == pytest.approx(
        report.friction.share * seen[0].window.terrain[0].friction
    )


def test_where_bodies_can_do_one_key_frame_at_a_time_that_is_what_is_planned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    decided, prepared = list[str](), list[int]()
    prepare, decide = Runner.prepare, Runner.decide

    def refuse(self: Runner, accepted: Any, resumption: Any = None) -> Any:
        if resumption is not None and accepted.plan.problem.frames > 2:
            raise InvalidInput("expected a motion in which no bodies collide")
        prepared.append(accepted.plan.problem.frames)
        return prepare(self, accepted, resumption)

    def note(self: Runner, what: str, why: str) -> None:
        decided.append(what)
        decide(self, what, why)

    monkeypatch.setattr(Runner, "prepare", refuse)
    monkeypatch.setattr(Runner, "decide", note)
    report, _ = looped(0.7, LoopSettings(replan_m=0.008), frames=3)
    assert report.succeeded, report.message
    tries = [
        "bend the plan",
        "the next key frames alone",
        "bend the next key frames",
        "the next key frame alone",
    ]
    assert [what for what in decided if what in tries][:4] == tries
    assert prepared[0] == 3
    assert len(prepared) > 2
    assert set(prepared[1:]) == {2}


def test_without_planning_anew_it_keeps_its_first_plan() -> None:
    report, seen = looped(0.75, LoopSettings(replan_m=np.inf), frames=3)
    assert (report.plans, report.replans, len(seen)) == (1, 0, 1)
    assert report.friction.share == 1.0


def test_a_course_that_cannot_be_planned_fails_before_anything_moves() -> None:
    course = slippery(read_course("walls", frames=2), 0.05)
    runner = Runner(make_world("mujoco", course.robot), settings=FAST)
    with refuses("frame 0", kind=PlanningFailed):
        ClosedLoop(course, runner).run()
    assert runner.state is None


def dropping(settings: LoopSettings) -> LoopReport:
    """All surfaces lose friction while limbs swing."""
    course = read_course("walls", frames=3)
    world = SlippingWorld(course.robot, share=0.68)
    world.inject(
        "friction differs", 0.75
    )  # simulated time; at this pace limbs swing from 0.6 to 0.9 s
    return ClosedLoop(
        course, Runner(world, settings=FAST), lambda observation: PLANNER, settings
    ).run()


def test_feet_that_slide_while_others_swing_are_caught_and_the_rest_is_planned_anew() -> None:
    report = dropping(LoopSettings())
    assert report.succeeded, report.message
    assert report.replans >= 1
    assert report.deviation_m < 0.02
    assert report.friction.share == pytest.approx(0.68, abs=0.03)
    alone = dropping(LoopSettings(replan_m=np.inf))
    assert not alone.succeeded
    assert alone.deviation_m > 0.05


def test_the_nearest_point_of_a_patch_is_that_of_a_dense_search() -> None:
    rng = np.random.default_rng(0)
    corners = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.5, 0.3, 0.0], [0.1, 0.2, 0.0]])
    patch = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.5)
    weights = rng.dirichlet(0.4 * np.ones(4), 60000)
    dense = weights @ corners
    for point in rng.uniform(-0.2, 0.7, (20, 3)):
        found = nearest_on(patch, point)
        best = np.linalg.norm(dense - point, axis=1).min()
        assert np.linalg.norm(found - point) <= best + 1e-9
        assert best - np.linalg.norm(found - point) < 5e-3


def test_settings_out_of_range_are_refused() -> None:
    with refuses("loop.tries"):
        LoopSettings(tries=0)
    with refuses("loop.replan_m"):
        LoopSettings(replan_m=-1.0)
    assert replace(LoopSettings(), replan_m=np.inf).replan_m == np.inf
