"""Rows between the nodes say what the verifier measures there, and only where it found fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.gait.constraints.feet import reach
from stancekit.planners.gait.method.portfolio import (
    Checks,
    DenseProgram,
    densified,
    flaws,
    half_way,
    restricted,
    tightened,
)
from stancekit.planners.gait.transcription.program import Program
from stancekit.planners.verify.trajectories import WalkLimits, check_trajectory


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
    strict = WalkLimits(force_balance=1e-6, reach_m=-1.0)  # nothing keeps these
    report = check_trajectory(solution.trajectory(), strict)
    found = flaws(program, report, band=0.01)
    assert {"force_balance", "reach"} <= {group.name for group in report.refused}
    assert 0 < found.balance.sum() <= program.structure.nodes - 1
    assert found.reach.all()


def test_an_accepted_trajectory_asks_for_nothing(program, solution):
    report = check_trajectory(
        solution.trajectory(), WalkLimits(force_balance=1.0, moment_balance=1.0)
    )
    assert report.accepted
    assert densified(program, report) is None


def test_what_was_missed_is_kept_in_hand(program, solution):
    settings = replace(program.settings, trunk_clearance_m=None)
    report = check_trajectory(
        solution.trajectory(), WalkLimits(trunk_m=-2.0, reach_m=-1.0, penetration_m=-1.0)
    )
    found = tightened(settings, report)
    assert found.trunk_clearance_m == pytest.approx(0.02)
    assert found.swing_nodes > settings.swing_nodes
    assert found.reach_margin_m >= settings.reach_margin_m
    again = tightened(replace(settings, trunk_clearance_m=0.05), report)
    assert again.trunk_clearance_m is not None
    assert again.trunk_clearance_m > 0.05


def test_rows_add_up_and_bands_narrow(program, solution):
    report = check_trajectory(solution.trajectory(), WalkLimits(force_balance=1e-6))
    first = DenseProgram(program, program.settings, checks(program, balance=[5]))
    second = densified(first, report)
    assert second is not None
    assert second.checks.balance[5]
    assert second.checks.band == pytest.approx(0.7 * first.checks.band)
