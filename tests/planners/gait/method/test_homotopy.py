"""Homotopies end at the whole terrain or say how far they came."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from stancekit.planners.gait.method.attempt import Attempt, Workbench
from stancekit.planners.gait.method.portfolio import (
    GENTLE,
    GROWTH,
    follow_homotopy,
    heights_for,
    softened,
    stage_program,
)
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.verify.trajectories import check_trajectory


def slope(gradient: float) -> HeightField:
    return HeightField.from_function(lambda x, y: gradient * x, 2.0, 0.25)


def answers(*, fails):
    """Solves in which the variables say at which factor they were found."""
    asked = []

    def solve(program, guess, /, *, height_factor, max_iterations=None):
        asked.append((height_factor, float(guess[0])))
        success = not fails(height_factor, float(guess[0]))
        return SimpleNamespace(success=success, x=np.array([height_factor]))

    return solve, asked


def ambient(*heights, by="height"):
    return Attempt(chart="ambient", heights=heights, by=by)


@pytest.fixture(scope="module")
def bench():
    return SimpleNamespace(program=lambda chart: SimpleNamespace(guess=np.zeros(1)))


def test_the_steepest_gradient_of_a_plane_is_its_own():
    assert slope(0.7).steepest == pytest.approx(0.7, abs=1e-9)
    assert reference_terrain("hill").steepest == pytest.approx(
        1.7, rel=0.02
    )  # 60° is what its formula has


def test_gentle_terrains_need_no_stages_and_steep_ones_grow_evenly():
    assert heights_for(slope(0.9)) == (1.0,)
    heights = heights_for(slope(20.0))
    assert heights[0] * 20.0 == pytest.approx(GENTLE)
    assert heights[-1] == 1.0
    growth = np.array(heights[1:]) / np.array(heights[:-1])
    assert np.ptp(growth) < 1e-9
    assert growth.max() <= GROWTH + 1e-9


def test_each_stage_begins_where_the_last_one_ended(bench):
    solve, asked = answers(fails=lambda factor, at: False)
    found = follow_homotopy(bench, ambient(0.25, 0.5, 1.0), solve=solve)
    assert asked == [(0.25, 0.0), (0.5, 0.25), (1.0, 0.5)]
    assert found.reached == 1.0


def test_a_stage_that_fails_is_tried_again_from_half_way(bench):
    solve, asked = answers(fails=lambda factor, at: factor - at > 0.3)
    found = follow_homotopy(bench, ambient(0.25, 1.0), solve=solve)
    assert [factor for factor, _ in asked] == [0.25, 1.0, 0.625, 0.4375, 0.625, 1.0, 0.8125, 1.0]
    assert found.reached == 1.0
    assert found.solutions[-1].success


def test_a_homotopy_that_gets_stuck_says_how_far_it_came(bench):
    solve, asked = answers(fails=lambda factor, at: factor > 0.6)
    found = follow_homotopy(bench, ambient(0.5, 1.0), solve=solve, most_stages=30)
    assert found.reached == pytest.approx(0.6, abs=0.05)
    assert not found.solutions[-1].success
    assert len(asked) < 12


def test_without_stages_a_failure_is_final(bench):
    solve, asked = answers(fails=lambda factor, at: True)
    assert follow_homotopy(bench, ambient(1.0), solve=solve).reached == 0.0
    assert len(asked) == 1


@pytest.mark.parametrize("share", [0.8, 0.3])
def test_a_wall_that_is_widened_keeps_its_height_and_has_the_share_of_its_gradient(share):
    pit = reference_terrain("pit")
    wider = softened(pit, share)
    assert wider.steepest == pytest.approx(share * pit.steepest, rel=0.02)
    assert wider.height(np.zeros(2)) == pytest.approx(pit.height(np.zeros(2)), abs=5e-3)
    assert wider.height(np.array([2.2, 0.0])) == pytest.approx(
        pit.height(np.array([2.2, 0.0])), abs=5e-3
    )
    assert softened(pit, 1.0) is pit
    assert softened(slope(0.7), 0.5).steepest == pytest.approx(0.7)  # a plane has no wall to widen


def test_a_step_of_84_degrees_is_climbed_by_widening_it():
    step = HeightField.from_function(
        lambda x, y: 0.15 * np.tanh((x - 0.45) / 0.015), 1.2, 0.025, tolerance_m=0.05
    )
    task = Walk(
        robot=anymal(),
        terrain=step,
        start_xy_m=np.zeros(2),
        goal_xy_m=np.array([0.3, 0.0]),
        duration_s=4,
    )
    asked = []

    def solve(program, guess, /, **options):
        asked.append(program.task.terrain.steepest)
        return program.solve(guess, **options)

    found = follow_homotopy(Workbench(task), ambient(0.4, 1.0, by="smoothing"), solve=solve)
    assert found.reached == 1.0
    assert asked[0] == pytest.approx(0.4 * step.steepest, rel=0.02)
    assert asked[-1] == step.steepest
    report = check_trajectory(found.solutions[-1].trajectory())
    swings = {"penetration", "penetration_between", "clearance"}  # between the nodes
    assert {group.name for group in report.refused} <= swings, report.message


def test_terrain_that_no_gaussian_fits_is_solved_as_it_is(bench):
    lines = np.array([-1.0, -0.5, 0.0, 0.4, 1.0])
    heights = np.add.outer(lines**2, 0.0 * lines)
    bench.task = Walk(
        robot=anymal(),
        terrain=HeightField(2 * lines, 2 * lines, heights),
        start_xy_m=np.zeros(2),
        goal_xy_m=np.array([0.1, 0.0]),
    )
    solve, asked = answers(fails=lambda factor, at: False)
    assert follow_homotopy(bench, ambient(0.5, 1.0, by="smoothing"), solve=solve).reached == 1.0
    assert asked == [(1.0, 0.0)]


def test_warped_stages_have_a_map_of_their_own_terrain():
    bumps = HeightField.from_function(lambda x, y: 0.1 * np.cos(2.0 * x), 2.0, 0.2)
    task = Walk(
        robot=anymal(),
        terrain=bumps,
        start_xy_m=np.zeros(2),
        goal_xy_m=np.array([0.2, 0.0]),
        duration_s=2,
    )
    bench = Workbench(task)
    lower, factor = stage_program(bench, "warped-exact", 0.5)
    assert factor == 1.0
    assert lower.task.terrain.height(np.zeros(2)) == pytest.approx(0.5 * bumps.height(np.zeros(2)))
    same, factor = stage_program(bench, "decoupled", 0.5)
    assert factor == 0.5
    assert same.task.terrain is bumps
