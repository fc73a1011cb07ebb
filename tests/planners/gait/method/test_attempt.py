"""Attempts end where the optimiser ends and say what the verifier says; what is interrupted goes on
from there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.gait.method.attempt import Attempt, Workbench
from stancekit.planners.gait.method.budget import FAILED, Checkpoint
from stancekit.planners.gait.walk_table import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory

BUMPS = HeightField.from_function(
    lambda x, y: 0.06 * np.sin(4.0 * x) * np.cos(3.0 * y), 2.0, 0.1, name="bumps"
)
TASK = Walk(
    robot=anymal(), terrain=BUMPS, start_xy_m=[0.0, 0.0], goal_xy_m=[0.25, 0.1], duration_s=2.0
)


@pytest.fixture(scope="module")
def bench():
    """The task, written down once."""
    return Workbench(TASK)


@pytest.fixture(scope="module")
def found(bench):
    """The decoupled chart's answer."""
    return bench.run(Attempt())


def test_an_attempt_is_the_programs_own_solve_and_the_verifiers_verdict(bench, found):
    alone = bench.program("decoupled").solve()
    assert found.solution.success
    assert np.array_equal(found.solution.x, alone.x)
    assert found.iterations == alone.iterations
    assert found.history.tolist() == [violation for violation, _ in alone.history]
    assert found.verified == check_trajectory(found.trajectory).accepted
    assert found.trajectory.samples == 401
    assert found.trajectory.provenance["chart"] == "decoupled"


def test_equal_attempts_give_equal_trajectories(bench, found):
    assert bench.run(Attempt()).report.digest == found.report.digest
    noisy = [bench.run(Attempt(noise=0.01, seed=seed)).trajectory.digest for seed in (1, 1, 2)]
    assert noisy[0] == noisy[1] != noisy[2]


def test_heights_are_solved_one_after_another_each_from_the_last_point():
    bench = Workbench(TASK)
    program = bench.program("ambient")
    half = program.solve(program.guess, height_factor=0.5)
    whole = program.solve(half.x)
    found = bench.run(Attempt(chart="ambient", heights=(0.5, 1.0)))
    assert np.array_equal(found.solution.x, whole.x)
    assert found.iterations == half.iterations + whole.iterations
    assert found.trajectory.terrain is BUMPS


def test_progress_hears_of_every_iteration_and_may_end_it(bench, found):
    heard = []

    def listen(attempt, iteration, violation, cost, phase):
        heard.append((phase, iteration, violation, cost))
        return iteration == 1

    stopped = bench.run(Attempt(), listen)
    assert [iteration for _, iteration, _, _ in heard] == [0, 1]
    assert [violation for _, _, violation, *_ in heard] == found.history[:2].tolist()
    assert stopped.stopped
    assert not stopped.verified
    assert bench.run(Attempt(), guess=found.solution.x).iterations == 0


def test_an_attempt_is_called_by_what_it_does():
    assert Attempt().perturbed(3).name == "decoupled, seed 3"
    assert Attempt(chart="ambient", heights=(0.5, 1.0)).name == "ambient, 2 heights"
    assert (
        Attempt(chart="ambient", heights=(0.5, 1.0), by="smoothing").name == "ambient, 2 smoothings"
    )


# ----------------------------------------------------------------------------------------- what is
# interrupted


ATTEMPTS = [Attempt(), Attempt(chart="ambient", heights=(0.5, 1.0))]


def kept(path, **changes):
    return Checkpoint(
        path, changes.get("task", TASK), changes.get("settings", GaitSettings()), ATTEMPTS
    )


def test_points_come_back_to_the_same_task_and_to_no_other(tmp_path, found):
    out = tmp_path / "walk.json"
    partial = kept(out)
    assert partial.begin(0) == (None, 0)
    partial.keep(0, replace(found, stopped=True, stage=0))
    again = kept(out)
    point, stage = again.begin(0)
    assert np.array_equal(point, found.solution.x)
    assert stage == 0
    assert again.begin(1) == (None, 0)
    for change in (
        {"task": replace(TASK, friction=0.5)},
        {"settings": GaitSettings(chart="shear")},
        {"task": replace(TASK, goal_xy_m=[0.25, 0.11])},
        {"task": replace(TASK, terrain=BUMPS.scaled(0.9))},
    ):
        assert kept(out, **change).begin(0) == (None, 0)


def test_an_attempt_that_failed_is_not_tried_again(tmp_path, found):
    out = tmp_path / "walk.json"
    failed = replace(found, solution=replace(found.solution, success=False))
    kept(out).keep(0, failed)
    assert kept(out).begin(0) == (None, FAILED)
    stopped = replace(failed, stopped=True, stage=1)
    kept(out).keep(0, stopped)
    assert kept(out).begin(0)[1] == 1


def test_a_run_that_is_done_leaves_nothing_and_a_broken_file_counts_for_nothing(tmp_path, found):
    out = tmp_path / "walk.json"
    partial = kept(out)
    partial.keep(0, found)
    assert partial.path.exists()
    (tmp_path / ".walk.partial.npz.99-0123abcd.tmp").write_bytes(b"what a killed run was writing")
    partial.remove()
    assert list(tmp_path.iterdir()) == []
    (tmp_path / ".walk.partial.npz.99-0123abcd.tmp").write_bytes(b"of its first point")
    kept(out).remove()
    assert list(tmp_path.iterdir()) == []
    for content in (b"", b"no archive", b"PK\x03\x04 broken"):
        partial.path.write_bytes(content)
        assert kept(out).begin(0) == (None, 0)


def test_without_a_file_nothing_is_kept(found):
    partial = kept(None)
    partial.keep(0, found)
    partial.remove()
    assert np.array_equal(partial.begin(0)[0], found.solution.x)
