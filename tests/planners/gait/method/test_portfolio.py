"""A portfolio gives what the verifier accepts or nothing, within its caps, and goes on where it was
stopped.
"""

from __future__ import annotations

import multiprocessing
import os
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.answer import Status
from stancekit.planners.errors import NoPlace, PlanningFailed
from stancekit.planners.gait.method import attempt, way
from stancekit.planners.gait.method.attempt import Attempt, Smoothing, SolveBudget
from stancekit.planners.gait.method.portfolio import Attempts, Caps, default_attempts, plan_gait
from stancekit.planners.gait.method.way import guided, pieces_of, plan_walk
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.gait.transcription import program as transcribed
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.verify.trajectories import check_trajectory
from tests.refusals import assert_names, refuses

pytestmark = pytest.mark.usefixtures("each_gait_is_written_once")

BUMPS = HeightField.from_function(
    lambda x, y: 0.06 * np.sin(4.0 * x) * np.cos(3.0 * y), 2.0, 0.1, name="bumps"
)
TASK = Walk(robot=anymal(), terrain=BUMPS, start=[0.0, 0.0], goal=[0.25, 0.1], duration_s=2.0)
FIRST = [Attempt(chart="decoupled")]
LAGGING = GaitSettings(dynamics="printed")  # the printed PCDM balances the forces of a step later
PLAIN = Caps(smoothing=Smoothing(rounds=0), densifications=0)


@pytest.fixture(scope="module")
def plan():
    return plan_gait(TASK, caps=Caps(smoothing=Smoothing(rounds=2, enough_g=0.0, gain=0.0)))


def test_a_plan_is_what_the_verifier_accepts(plan):
    assert plan.verified
    answer = plan.answer
    assert (answer.status, answer.method) == (Status.FEASIBLE, plan.best.attempt.name)
    assert answer.solution is not None
    again = check_trajectory(answer.solution)
    assert again.accepted
    assert again.digest == answer.report.digest
    assert answer.solution.provenance["chart"] == "decoupled"
    assert answer.report.answer.torso_m.tolist() == answer.solution.torso_m.tolist()
    assert answer.effort.solves == len(plan.solves)


def test_the_first_chart_that_verifies_ends_the_search(plan):
    assert [one.attempt.chart for one in plan.attempts] == ["decoupled"]
    assert [way.chart for way in default_attempts(TASK)] == ["decoupled", "warped-exact", "ambient"]


def test_every_solve_is_on_the_account(plan):
    assert plan.solves[0].phase == "feasible"
    assert "smooth" in {step.phase for step in plan.solves}
    assert plan.seconds == pytest.approx(sum(step.seconds for step in plan.solves))
    assert all(
        step.seconds_evaluating + step.seconds_linear == pytest.approx(step.seconds)
        for step in plan.solves
    )
    assert all(len(step.violations) == step.iterations + 1 for step in plan.solves)


def test_the_second_phase_does_not_make_the_peak_worse(plan):
    assert plan.feasible[0] is not None
    before = plan.feasible[0].figures["peak_acceleration_g"]
    assert plan.answer.report.figures["peak_acceleration_g"] <= before


def test_what_the_verifier_refuses_is_no_walk_but_the_best_attempt():
    refused = plan_gait(TASK, LAGGING, caps=PLAIN, attempts=FIRST)
    assert refused.attempts[0].solution.success
    assert not refused.verified
    assert refused.answer.status is Status.UNDECIDED
    assert refused.answer.solution is refused.best.trajectory
    assert not refused.answer.report.accepted
    assert_names(refused.message, "verifier")
    assert refused.best.trajectory.samples > 2
    assert not refused.best.report.accepted


def test_no_feasible_point_is_no_walk():
    failed = plan_gait(TASK, caps=Caps(iterations=1), attempts=FIRST)
    assert (failed.answer.status, failed.answer.solution, failed.answer.report) == (
        Status.UNDECIDED,
        None,
        None,
    )
    assert failed.feasible == (None,)
    assert_names(failed.message, "violation")


def test_a_plan_that_is_stopped_has_no_answer():
    stopped = plan_gait(
        TASK, progress=lambda attempt, iteration, *at: iteration >= 2, attempts=FIRST
    )
    assert stopped.stopped
    assert stopped.answer.solution is None
    assert len(stopped.solves) == 1


def test_progress_sees_every_iteration():
    seen = []
    found = plan_gait(
        TASK,
        None,
        lambda attempt, *at: seen.append((attempt.chart, *at)),
        caps=PLAIN,
        attempts=FIRST,
    )
    assert [violation for _, _, violation, *_ in seen] == list(found.solves[0].violations)
    assert [iteration for _, iteration, *_ in seen] == list(range(len(seen)))


def test_a_child_process_takes_the_same_steps():
    here = plan_gait(TASK, caps=PLAIN, attempts=FIRST)
    apart = Caps(smoothing=Smoothing(rounds=0), densifications=0, in_subprocess=True)
    there = plan_gait(TASK, caps=apart, attempts=FIRST)
    assert there.solves[0].violations == here.solves[0].violations
    assert there.answer.solution.digest == here.answer.solution.digest


def test_an_account_that_is_used_up_ends_the_plan():
    seconds = 1e-6
    found = plan_gait(TASK, caps=Caps(total_s=seconds), attempts=[*FIRST, Attempt(chart="ambient")])
    assert len(found.attempts) == 1
    assert {step.phase for step in found.solves} == {"feasible"}


class Clock:
    """CPU time of this process and of those that are forked off, which passes when it is asked
    for: a tenth of a second each time.
    """

    def __init__(self):
        self._all, self._own = multiprocessing.Value("d"), Counter()

    def passes(self, seconds):
        self._all.value += seconds
        self._own[os.getpid()] += seconds

    def process_time(self):
        self.passes(0.1)
        return self._own[os.getpid()]

    def cpu_s(self):
        return self._all.value


@pytest.mark.parametrize("apart", [False, True])
def test_a_search_that_fails_ends_with_its_time(apart, monkeypatch):
    clock, write = Clock(), attempt.formulate
    for module in (attempt, transcribed):
        monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(attempt, "cpu_s", clock.cpu_s)
    monkeypatch.setattr(attempt, "_PATIENCE", 1e6)  # a child is given all the time by the wall
    monkeypatch.setattr(attempt, "formulate", lambda *of: clock.passes(2.0) or write(*of))
    places = {"start": [-2.6, 0.0], "goal": [-0.4, 0.35]}
    steep = Walk(  # a higher hill is not looked for at all
        robot=anymal(), terrain=reference_terrain("hill").scaled(0.9), **places, duration_s=10.0
    )
    assert not plan_gait(steep, caps=Caps(total_s=3.0, in_subprocess=apart)).verified
    assert 3.0 - 0.6 < clock.cpu_s() < 1.2 * 3.0


def test_a_solver_that_does_not_answer_has_found_nothing(monkeypatch, plan):
    def hanging(*_, time_limit_s, **__):
        raise PlanningFailed(f"the solver did not answer within {time_limit_s:g} s")

    monkeypatch.setattr(attempt, "solve_in_subprocess", hanging)
    program = plan.attempts[0].solution.program
    held = SolveBudget(solve_s=2.0, in_subprocess=True)
    solution = held(program, program.guess)
    assert not solution.success
    assert solution.status == "the solver did not answer within 20 s"
    assert held.seconds == 2.0


def test_steep_terrain_gets_stages_in_the_world_chart():
    pit = Walk(
        robot=anymal(),
        terrain=reference_terrain("pit"),
        start=[0.0, 0.0],
        goal=[2.2, 0.0],
    )
    heights = default_attempts(pit)[-1].heights
    assert len(heights) > 2
    assert heights[-1] == 1.0
    assert default_attempts(TASK)[-1].heights == (1.0,)


def test_walls_beyond_81_degrees_are_widened_first():
    deep = Walk(
        robot=anymal(),
        terrain=reference_terrain("pit-87"),
        start=[0.0, 0.0],
        goal=[2.2, 0.0],
    )
    first = default_attempts(deep)[0]
    assert first.name == "ambient, 4 smoothings"
    assert first.heights[0] * deep.terrain.steepest == pytest.approx(4.0)
    assert first.heights[-1] == 1.0
    assert {way.by for way in default_attempts(TASK)} == {"height"}


@pytest.mark.parametrize(
    ("name", "value"), [("iterations", 0), ("densifications", -1), ("solve_s", 0.0)]
)
def test_caps_out_of_range_are_refused(name, value):
    with refuses(name):
        Caps(**{name: value})


def test_a_gentler_terrain_that_is_walked_is_no_answer():
    asked = replace(
        TASK,
        terrain=reference_terrain("hill"),
        start=np.array([-1.95, 0.0]),
        goal=np.array([-1.7, 0.0]),
        adhesive=(True, True, False, False),
    )
    growing = [Attempt(chart="ambient", heights=(0.05, 1.0))]
    plan = plan_gait(asked, caps=Caps(total_s=0.01), attempts=growing)
    assert plan.solves[0].success
    assert [step.factor for step in plan.solves] == [0.05]
    (one,) = plan.attempts
    assert not one.solution.success
    assert not one.report.accepted
    assert (plan.answer.status, plan.answer.solution) == (Status.UNDECIDED, None)
    assert one.trajectory.problem.terrain is asked.terrain
    assert one.solution.violation > 0.1


SETTINGS = GaitSettings()


def level(block: tuple[float, float, float, float] | None = None) -> HeightField:
    """A floor of 7 × 5 m, with a block 1 m high from x to x and y to y."""
    x, y = np.linspace(-1.5, 5.5, 141), np.linspace(-2.5, 2.5, 101)
    heights = np.zeros((len(x), len(y)))
    if block is not None:
        heights[np.ix_((x > block[0]) & (x < block[1]), (y > block[2]) & (y < block[3]))] = 1.0
    return HeightField(x_m=x, y_m=y, heights_m=heights)


def walk(goal: float = 1.0, seconds: float = 6.0, terrain: HeightField | None = None) -> Walk:
    """Straight ahead from the origin."""
    return Walk.over(terrain or level(), (goal, 0.0), start=(0.0, 0.0), duration_s=seconds)


@pytest.fixture
def short(monkeypatch):
    """Walks of a metre are long, and pieces half as long."""
    monkeypatch.setattr(way, "FAR_M", 0.9)
    monkeypatch.setattr(way, "PIECE_M", 0.5)


def planned(task, progress=None):
    """The walk, by the usual attempts."""
    return plan_walk(task, SETTINGS, progress, attempts=default_attempts(task))


def test_pieces_are_one_walk(short):
    task, told = walk(), list[str]()
    whole = planned(
        task, progress=lambda attempt, iteration, violation, cost, phase: told.append(phase)
    )
    assert whole.verified, whole.message
    trajectory = whole.best.trajectory
    assert check_trajectory(trajectory).accepted
    assert trajectory.provenance["pieces"] == 2.0
    np.testing.assert_allclose(trajectory.torso_m[0, :2], 0.0, atol=1e-6)
    np.testing.assert_allclose(trajectory.problem.goal, (1.0, 0.0))
    assert {phase.split(",")[0] for phase in told} == {"piece 1 of 2", "piece 2 of 2"}

    def stop(attempt, iteration, violation, cost, phase):
        return phase.startswith("piece 2")

    assert planned(task, stop).stopped


@pytest.mark.parametrize("fails", [{1}, {1, 2, 3}])
def test_a_piece_that_fails_is_cut_and_then_goes_another_way_before_the_whole_fails(
    monkeypatch, fails
):
    task, calls = walk(4.0, 20.0, level((1.8, 2.2, -0.8, 0.9))), list[Walk]()
    straight = pieces_of(task, guided(task))

    def answer(piece, settings, progress=None, *, caps=None, attempts=None):
        calls.append(piece)
        if len(calls) not in fails:
            raise KeyboardInterrupt
        return Attempts(walk=piece, attempts=(), feasible=(), solves=(), failures=("made to fail",))

    monkeypatch.setattr(way, "plan_gait", answer)
    with pytest.raises(KeyboardInterrupt):
        planned(task)
    np.testing.assert_array_equal(calls[0].goal, straight[0].goal)
    if len(fails) == 1:  # half of it
        np.testing.assert_allclose(calls[1].goal, 0.5 * straight[0].goal)
    else:  # the other side of the block
        assert np.sign(calls[-1].goal[1]) == -np.sign(straight[0].goal[1])


def test_a_walk_without_a_way_says_how_far_it_came(monkeypatch):
    task = walk(4.0, 20.0, level((1.8, 2.2, -0.8, 0.9)))

    def none(piece, settings, progress=None, *, caps=None, attempts=None):
        return Attempts(walk=piece, attempts=(), feasible=(), solves=(), failures=("made to fail",))

    monkeypatch.setattr(way, "plan_gait", none)
    found = planned(task)
    assert not found.verified
    assert_names(found.message, "0 pieces", "(0.00, 0.00)", "made to fail")


@pytest.mark.parametrize(
    ("start", "goal", "name"), [((2, 0), (4, 0), "start"), ((0, 0), (2, 0), "goal")]
)
def test_a_walk_from_or_to_a_solid_is_refused_at_once(start, goal, name):
    task = Walk.over(level((1.8, 2.2, -0.8, 0.9)), goal, start=start, duration_s=10.0)
    with refuses(name, kind=NoPlace):
        planned(task)


def test_the_top_of_a_wide_block_is_a_place_to_stand():
    terrain = level((1.0, 4.0, -2.0, 2.0))
    assert guided(Walk.over(terrain, (2.6, 0.0), start=(2.4, 0.0), duration_s=4.0)) is None
