"""Attempts end where the optimiser ends and say what the verifier says."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from stancekit.planners.gait.constraints.feet import reach
from stancekit.planners.gait.gait_program import GaitProgram
from stancekit.planners.gait.method.attempt import Attempt, Smoothing, Workbench, peak_g, smoothed
from stancekit.planners.gait.method.portfolio import (
    GENTLE,
    GROWTH,
    Checks,
    DenseProgram,
    densified,
    flaws,
    follow_homotopy,
    half_way,
    heights_for,
    restricted,
    softened,
    stage_program,
    tightened,
)
from stancekit.planners.gait.transcription.program import Program
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.verify.trajectories import LIMITS, check_trajectory
from tests.refusals import refuses

BUMPS = HeightField.from_function(
    lambda x, y: 0.06 * np.sin(4.0 * x) * np.cos(3.0 * y), 2.0, 0.1, name="bumps"
)
TASK = Walk(robot=anymal(), terrain=BUMPS, start=[0.0, 0.0], goal=[0.25, 0.1], duration_s=2.0)


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
    assert found.trajectory.problem.terrain is BUMPS


def test_progress_hears_of_every_iteration_and_may_end_it(bench, found):
    heard = []

    def listen(attempt, iteration, violation, cost, phase):
        heard.append((phase, iteration, violation, cost))
        return iteration == 1

    stopped = bench.run(Attempt(), listen)
    assert [iteration for _, iteration, _, _ in heard] == [0, 1]
    assert [violation for _, _, violation, *_ in heard] == found.history[:2].tolist()
    assert not stopped.verified


def test_an_attempt_is_called_by_what_it_does():
    assert Attempt().perturbed(3).name == "decoupled, seed 3"
    assert Attempt(chart="ambient", heights=(0.5, 1.0)).name == "ambient, 2 heights"
    assert (
        Attempt(chart="ambient", heights=(0.5, 1.0), by="smoothing").name == "ambient, 2 smoothings"
    )


@pytest.fixture(scope="module")
def rough(small):
    """A feasible motion that shakes, for its guess did."""
    program = small()
    solution = program.solve(program.perturbed(np.random.default_rng(3), 0.02))
    assert solution.success
    return solution


@pytest.fixture(scope="module")
def rounds(rough):
    return list(smoothed(rough, Smoothing(rounds=3, enough_g=0.0, gain=0.0)))


def test_every_round_ends_feasible_and_the_peak_goes_down(rough, rounds):
    peaks = [peak_g(check_trajectory(rough.trajectory())), *(one.peak_g for one in rounds)]
    assert rounds
    assert all(one.solution.success for one in rounds)
    assert all(one.solution.violation < rough.program.settings.tolerance for one in rounds)
    assert peaks[-1] < 0.8 * peaks[0]


def test_the_peak_is_that_of_the_samples_themselves(rounds):
    torso = rounds[-1].report.answer.torso_m
    samples = np.linalg.norm(np.diff(torso, 2, axis=0), axis=1) / 0.005**2
    assert rounds[-1].peak_g == pytest.approx(samples.max() / 9.81, rel=1e-6)


def test_a_calm_motion_is_left_alone(rough):
    assert list(smoothed(rough, Smoothing(enough_g=100.0))) == []


def test_what_asks_to_stop_is_heard_between_solves(rough):
    asked = iter([False, True])
    assert (
        len(
            list(
                smoothed(
                    rough, Smoothing(rounds=4, enough_g=0.0, gain=0.0), stop=lambda: next(asked)
                )
            )
        )
        == 1
    )


def test_a_round_that_loses_feasibility_is_the_last(rough):
    def failing(program: GaitProgram, guess, /, **options):
        return replace(rough, success=False)

    found = list(smoothed(rough, Smoothing(rounds=4, enough_g=0.0), solve=failing))
    assert len(found) == 1
    assert not found[0].solution.success


@pytest.mark.parametrize(("name", "value"), [("rounds", -1), ("iterations", 0), ("gain", -0.1)])
def test_settings_out_of_range_are_refused(name, value):
    with refuses(name):
        Smoothing(**{name: value})


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
def flat_bench():
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


def test_each_stage_begins_where_the_last_one_ended(flat_bench):
    solve, asked = answers(fails=lambda factor, at: False)
    *_, reached = follow_homotopy(flat_bench, ambient(0.25, 0.5, 1.0), solve=solve)
    assert asked == [(0.25, 0.0), (0.5, 0.25), (1.0, 0.5)]
    assert reached == 1.0


def test_a_stage_that_fails_is_tried_again_from_half_way(flat_bench):
    solve, asked = answers(fails=lambda factor, at: factor - at > 0.3)
    solution, _, reached = follow_homotopy(flat_bench, ambient(0.25, 1.0), solve=solve)
    assert [factor for factor, _ in asked] == [0.25, 1.0, 0.625, 0.4375, 0.625, 1.0, 0.8125, 1.0]
    assert reached == 1.0
    assert solution.success


def test_a_homotopy_that_gets_stuck_says_how_far_it_came(flat_bench):
    solve, asked = answers(fails=lambda factor, at: factor > 0.6)
    solution, _, reached = follow_homotopy(
        flat_bench, ambient(0.5, 1.0), solve=solve, most_stages=30
    )
    assert reached == pytest.approx(0.6, abs=0.05)
    assert not solution.success
    assert len(asked) < 12


def test_without_stages_a_failure_is_final(flat_bench):
    solve, asked = answers(fails=lambda factor, at: True)
    assert follow_homotopy(flat_bench, ambient(1.0), solve=solve)[2] == 0.0
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
        start=np.zeros(2),
        goal=np.array([0.3, 0.0]),
        duration_s=4,
    )
    asked = []

    def solve(program, guess, /, **options):
        asked.append(program.task.terrain.steepest)
        return program.solve(guess, **options)

    solution, _, reached = follow_homotopy(
        Workbench(task), ambient(0.4, 1.0, by="smoothing"), solve=solve
    )
    assert reached == 1.0
    assert asked[0] == pytest.approx(0.4 * step.steepest, rel=0.02)
    assert asked[-1] == step.steepest
    report = check_trajectory(solution.trajectory())
    swings = {"penetration", "penetration_between", "clearance"}  # between the nodes
    assert {group.name for group in report.refused} <= swings, report.message


def test_terrain_that_no_gaussian_fits_is_solved_as_it_is(flat_bench):
    lines = np.array([-1.0, -0.5, 0.0, 0.4, 1.0])
    heights = np.add.outer(lines**2, 0.0 * lines)
    flat_bench.task = Walk(
        robot=anymal(),
        terrain=HeightField(2 * lines, 2 * lines, heights),
        start=np.zeros(2),
        goal=np.array([0.1, 0.0]),
    )
    solve, asked = answers(fails=lambda factor, at: False)
    assert follow_homotopy(flat_bench, ambient(0.5, 1.0, by="smoothing"), solve=solve)[2] == 1.0
    assert asked == [(1.0, 0.0)]


def test_warped_stages_have_a_map_of_their_own_terrain():
    bumps = HeightField.from_function(lambda x, y: 0.1 * np.cos(2.0 * x), 2.0, 0.2)
    task = Walk(
        robot=anymal(),
        terrain=bumps,
        start=np.zeros(2),
        goal=np.array([0.2, 0.0]),
        duration_s=2,
    )
    flat_bench = Workbench(task)
    lower, factor = stage_program(flat_bench, "warped-exact", 0.5)
    assert factor == 1.0
    assert lower.task.terrain.height(np.zeros(2)) == pytest.approx(0.5 * bumps.height(np.zeros(2)))
    same, factor = stage_program(flat_bench, "decoupled", 0.5)
    assert factor == 0.5
    assert same.task.terrain is bumps


@pytest.fixture(scope="module")
def program(small):
    return small()


@pytest.fixture(scope="module")
def solution(program):
    found = program.solve()
    assert found.success
    return found


def checks(program, *, balance=(), reach=(), band=0.06):
    steps, feet = program.structure.nodes - 1, program.structure.feet
    at, arms = np.zeros(steps, dtype=bool), np.zeros((steps, feet), dtype=bool)
    at[list(balance)] = True
    for step, foot in reach:
        arms[step, foot] = True
    return Checks(balance=at, reach=arms, band=band)


def values(program, constraints, x):
    alone = Program(program.size, constraints, [], np.zeros((0, program.size)))  # type: ignore[arg-type]
    return np.asarray(alone.constraint(x, np.concatenate([x, np.zeros(3), [1.0]]))).ravel()


def test_some_rows_of_a_term_are_the_same_rows(program):
    rng = np.random.default_rng(5)
    whole = reach(program.structure)
    kept = np.repeat(rng.random(whole.rows // 3) < 0.1, 3)
    x = program.perturbed(rng)
    part = restricted(whole, kept)
    assert 0 < part.rows < whole.rows
    assert values(program, [part], x) == pytest.approx(values(program, [whole], x)[kept], abs=1e-12)
    assert part.lower.tolist() == whole.lower[kept].tolist()


def test_reach_half_way_is_that_of_the_samples(program, solution):
    asked = [(3, 0), (17, 2), (30, 3)]
    (term,) = half_way(program.structure, checks(program, reach=asked))
    found = values(program, [term], solution.x).reshape(-1, 3)
    at = solution.samples((np.array([step for step, _ in asked]) + 0.5) * program.settings.step_s)
    arms = at.feet_m - at.torso_m[:, None]
    expected = [at.rotation[k].T @ arms[k, foot] for k, (_, foot) in enumerate(asked)]
    assert np.sort(found, axis=0) == pytest.approx(np.sort(expected, axis=0), abs=1e-9)


def test_the_balance_half_way_is_newtons_of_the_samples(program, solution):
    step_s, robot = program.settings.step_s, program.task.robot
    (term,) = half_way(program.structure, checks(program, balance=[12]))
    found = values(program, [term], solution.x)
    at = solution.samples((np.array([11.5, 12.5, 13.5])) * step_s)
    weight = robot.mass_kg * 9.81
    felt = robot.mass_kg * (np.diff(at.torso_m, 2, axis=0)[0] / step_s**2 + [0.0, 0.0, 9.81])
    assert found[:3] == pytest.approx((at.forces_n[1].sum(axis=0) - felt) / weight, abs=1e-6)
    assert np.all(term.upper == 0.06)


def test_a_dense_program_holds_its_band(program, solution):
    everywhere = checks(program, balance=range(program.structure.nodes - 1), band=0.03)
    dense = DenseProgram(program, program.settings, everywhere)
    before = dense.violations(solution.x)["balance"]
    found = dense.solve(solution.x)
    assert dense.size == program.size
    assert before > 0.01  # there was something to do
    assert found.success
    assert found.violations["balance"] < 1e-4


def test_flaws_are_where_the_verifier_measures_them(program, solution):
    strict = {**LIMITS, "force_balance": 1e-6, "reach_m": -1.0}  # nothing keeps these
    report = check_trajectory(solution.trajectory(), strict)
    found = flaws(program, report, band=0.01)
    assert {"force_balance", "reach"} <= {group.name for group in report.refused}
    assert 0 < found.balance.sum() <= program.structure.nodes - 1
    assert found.reach.all()


def test_an_accepted_trajectory_asks_for_nothing(program, solution):
    report = check_trajectory(
        solution.trajectory(), {**LIMITS, "force_balance": 1.0, "moment_balance": 1.0}
    )
    assert report.accepted
    assert densified(program, report) is None


def test_what_was_missed_is_kept_in_hand(program, solution):
    settings = replace(program.settings, trunk_clearance_m=None)
    report = check_trajectory(
        solution.trajectory(), {**LIMITS, "trunk_m": -2.0, "reach_m": -1.0, "penetration_m": -1.0}
    )
    found = tightened(settings, report)
    assert found.trunk_clearance_m == pytest.approx(0.02)
    assert found.swing_nodes > settings.swing_nodes
    assert found.reach_margin_m >= settings.reach_margin_m
    again = tightened(replace(settings, trunk_clearance_m=0.05), report)
    assert again.trunk_clearance_m is not None
    assert again.trunk_clearance_m > 0.05


def test_rows_add_up_and_bands_narrow(program, solution):
    report = check_trajectory(solution.trajectory(), {**LIMITS, "force_balance": 1e-6})
    first = DenseProgram(program, program.settings, checks(program, balance=[5]))
    second = densified(first, report)
    assert second.checks.balance[5]
    assert second.checks.band == pytest.approx(0.7 * first.checks.band)
