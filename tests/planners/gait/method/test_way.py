"""Walks in pieces along a guide path: one walk that the verifier accepts, what goes on after a
stop, other ways.
"""

from __future__ import annotations

import numpy as np
import pytest

from stancekit.planners.gait.method import way
from stancekit.planners.gait.method.budget import CUT, DONE, ROUND, Checkpoint
from stancekit.planners.gait.method.portfolio import Attempts, default_attempts
from stancekit.planners.gait.method.way import guided, pieces_of, plan_walk
from stancekit.planners.gait.walk_table import GaitSettings
from stancekit.planners.problem.candidates import NoPlace
from stancekit.planners.problem.walk import Walk
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory
from tests.refusals import assert_names, refuses

pytestmark = pytest.mark.usefixtures("each_gait_is_written_once")

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
    return Walk.over(terrain or level(), (goal, 0.0), start_xy_m=(0.0, 0.0), duration_s=seconds)


@pytest.fixture
def short(monkeypatch):
    """Walks of a metre are long, and pieces half as long."""
    monkeypatch.setattr(way, "FAR_M", 0.9)
    monkeypatch.setattr(way, "PIECE_M", 0.5)


def kept_in(folder, task):
    """The checkpoint of a task in a folder."""
    return Checkpoint(folder / "walk.json", task, SETTINGS, default_attempts(task))


def planned(task, kept=None, progress=None):
    """The walk, by the usual attempts."""
    return plan_walk(task, SETTINGS, progress, attempts=default_attempts(task), checkpoint=kept)


def test_pieces_are_one_walk_that_goes_on_after_a_stop_to_the_same(short, tmp_path):
    task, told = walk(), list[str]()
    whole = planned(
        task, progress=lambda attempt, iteration, violation, cost, phase: told.append(phase)
    )
    assert whole.verified, whole.message
    trajectory = whole.best.trajectory
    assert check_trajectory(trajectory).accepted
    assert trajectory.provenance["pieces"] == 2.0
    np.testing.assert_allclose(trajectory.torso_m[0, :2], 0.0, atol=1e-6)
    np.testing.assert_allclose(trajectory.goal_xy_m, (1.0, 0.0))
    assert {phase.split(",")[0] for phase in told} == {"piece 1 of 2", "piece 2 of 2"}

    def stop(attempt, iteration, violation, cost, phase):
        return phase.startswith("piece 2")

    stopped = planned(task, kept_in(tmp_path, task), stop)
    assert stopped.stopped
    kept = kept_in(tmp_path, task)
    assert kept.begun
    assert kept.pieces == (DONE,)
    told.clear()
    again = planned(
        task, kept, lambda attempt, iteration, violation, cost, phase: told.append(phase)
    )
    assert {phase.split(",")[0] for phase in told} == {"piece 2 of 2"}
    assert again.best.trajectory.digest == trajectory.digest

    for name, wrong in (("feet_m", 0.01), ("torso_m", 0.01), ("forces_n", 500.0)):
        forged = kept_in(tmp_path, task)
        forged.keep_pieces((DONE,), {**kept.samples, name: kept.samples[name] + wrong})
        path, back = way._gone_on(task, guided(task), kept_in(tmp_path, task))
        assert back is None, name
        assert len(path.left) == 2
    other = walk(seconds=7.0)
    assert not kept_in(tmp_path, other).begun


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
    np.testing.assert_array_equal(calls[0].goal_xy_m, straight[0].goal_xy_m)
    if len(fails) == 1:  # half of it
        np.testing.assert_allclose(calls[1].goal_xy_m, 0.5 * straight[0].goal_xy_m)
    else:  # the other side of the block
        assert np.sign(calls[-1].goal_xy_m[1]) == -np.sign(straight[0].goal_xy_m[1])


def test_the_same_outcomes_leave_the_same_pieces():
    task = walk(4.0, 20.0, level((1.8, 2.2, -0.8, 0.9)))
    one, other = (way._Way(task, guided(task)) for _ in range(2))
    for outcome in (DONE, CUT, CUT, ROUND, DONE):
        one.go(outcome)
        other.go(outcome)
    assert len(one.paths_m) == 2
    for (piece, cut), (same, level_) in zip(one.left, other.left, strict=True):
        assert cut == level_
        np.testing.assert_array_equal(piece.goal_xy_m, same.goal_xy_m)
        assert piece.duration_s == same.duration_s
    np.testing.assert_array_equal(one.left[-1][0].goal_xy_m, task.goal_xy_m)


def test_a_walk_without_a_way_says_how_far_it_came(monkeypatch):
    task = walk(4.0, 20.0, level((1.8, 2.2, -0.8, 0.9)))

    def none(piece, settings, progress=None, *, caps=None, attempts=None):
        return Attempts(walk=piece, attempts=(), feasible=(), solves=(), failures=("made to fail",))

    monkeypatch.setattr(way, "plan_gait", none)
    found = planned(task)
    assert not found.verified
    assert_names(found.message, "0 pieces", "(0.00, 0.00)", "made to fail")


@pytest.mark.parametrize(
    ("start", "goal", "name"), [((2, 0), (4, 0), "start_xy_m"), ((0, 0), (2, 0), "goal_xy_m")]
)
def test_a_walk_from_or_to_a_solid_is_refused_at_once(start, goal, name):
    task = Walk.over(level((1.8, 2.2, -0.8, 0.9)), goal, start_xy_m=start, duration_s=10.0)
    with refuses(name, kind=NoPlace):
        planned(task)


def test_the_top_of_a_wide_block_is_a_place_to_stand():
    terrain = level((1.0, 4.0, -2.0, 2.0))
    task = Walk.over(terrain, (2.6, 0.0), start_xy_m=(2.4, 0.0), duration_s=4.0)
    assert guided(task) is None
