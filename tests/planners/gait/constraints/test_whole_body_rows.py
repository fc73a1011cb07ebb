"""Rows of torque and of bodies: at the point they are about they are what the verifier measures
there, and beside it what it measures then, as far as a tangent goes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.gait.constraints.feet import Overlaps, apart
from stancekit.planners.gait.gait_program import GaitProgram, formulate
from stancekit.planners.gait.method.portfolio import Checks, DenseProgram, densified, leg_loads
from stancekit.planners.gait.variables import sampled
from stancekit.planners.gait.walk_table import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.moving_body import WholeBodyMeasurements
from stancekit.planners.verify.trajectories import WalkLimits, check_trajectory
from stancekit.planners.verify.trajectory_measurements import TrajectoryMeasurements
from tests.planners.verify.test_trajectory_whole_body import stepping

LOW = WalkLimits(torque=0.3)
"""Most joints are near this."""


@cache
def program(chart: str = "decoupled") -> GaitProgram:
    x = np.linspace(-2.0, 2.0, 41)
    slope = HeightField(x, x, 0.1 * x[:, None] + 0.05 * np.sin(4.0 * x), "waves")
    task = Walk(
        robot=stepping().robot,
        terrain=slope,
        start_xy_m=np.zeros(2),
        goal_xy_m=np.array([0.15, 0.05]),
        duration_s=2.0,
    )
    return formulate(task, GaitSettings(chart=chart))


def trajectory(x: np.ndarray, chart: str) -> Trajectory:
    at = sampled(program(chart).structure, x, np.linspace(0.0, 2.0, 401))
    walk, task = stepping(), program(chart).task
    return replace(
        walk,
        times_s=at.times_s,
        torso_m=at.torso_m,
        rotation=at.rotation,
        feet_m=at.feet_m,
        forces_n=at.forces_n,
        contact=at.contact,
        terrain=task.terrain,
    )


@pytest.mark.parametrize("chart", ["decoupled", "ambient"])
def test_torque_rows_are_the_torques_that_the_verifier_measures(chart: str) -> None:
    base, rng = program(chart), np.random.default_rng(0)
    structure, x = base.structure, base.guess
    loads = leg_loads(structure, check_trajectory(trajectory(x, chart), LOW, body=False))
    assert len(loads) > 50
    rows = DenseProgram(
        base,
        base.settings,
        Checks(
            balance=np.zeros(structure.nodes - 1, dtype=bool),
            reach=np.zeros((structure.nodes - 1, 4), dtype=bool),
            loads=loads,
        ),
    )
    first = sum(one.rows for one in rows.nlp.constraints[:-1])
    assert rows.nlp.constraints[-1].name == "torque"
    order = np.concatenate(
        [group.find(loads.foot, loads.node)[1] for group in structure.feet_at_nodes if group.pushes]
    )

    def by_rows(x: np.ndarray) -> np.ndarray:
        values = np.asarray(
            rows.nlp.constraint(x, np.concatenate([x, np.zeros(3), [1.0]]))
        ).ravel()[first:]
        return values * loads.most_nm[order]

    def by_verifier(x: np.ndarray) -> np.ndarray:
        body = WholeBodyMeasurements(TrajectoryMeasurements(trajectory(x, chart)))
        angles, solver = body.postures.angles, body.kinematics
        sample = np.clip(np.rint(structure.times_s / 0.005).astype(int), 1, 399)[loads.node[order]]
        walk = body.trajectory
        given = np.array(
            [solver.torques(angles[k], walk.rotation[k], walk.forces_n[k]) for k in sample]
        )
        levers = np.array(
            [solver.loads(angles[k], walk.rotation[k])[1] @ walk.rotation[k] for k in sample]
        )
        off = np.linalg.norm(
            levers.reshape(len(sample), 4, 3, 3)[np.arange(len(sample)), foot] - near[:, None],
            axis=2,
        )
        return given[
            np.arange(len(sample)), 3 * foot + off.argmin(axis=1)
        ]  # the joint by its lever

    near, foot = loads.levers_m[order], loads.foot[order]
    here = by_rows(x)
    np.testing.assert_allclose(
        by_verifier(x), here, atol=0.05 * np.abs(here).max()
    )  # but for legs in motion
    step = 0.004 * rng.normal(size=len(x))
    changed, expected = by_rows(x + step) - here, by_verifier(x + step) - by_verifier(x)
    inner = (loads.node[order] > 0) & (
        loads.node[order] < structure.nodes - 1
    )  # at the ends it measures beside them
    assert np.abs(expected).max() > 0.5
    assert np.abs(changed - expected)[inner].max() < 0.1 * np.abs(expected).max()


def test_a_refused_torque_gets_rows_that_a_solve_keeps() -> None:
    base = program()
    found = base.solve()
    report = check_trajectory(found.trajectory())
    worst = next(group for group in report.groups if group.name == "torque").value
    limits = WalkLimits(torque=0.95 * worst)
    refused = check_trajectory(found.trajectory(), limits)
    assert "torque" in {group.name for group in refused.refused}
    dense = densified(base, refused)
    assert dense is not None
    solution = dense.solve(found.x)
    assert solution.success
    again = check_trajectory(solution.trajectory(), limits)
    assert "torque" not in {group.name for group in again.refused}


def test_rows_of_bodies_are_their_tangent() -> None:
    """Against the same numbers by numpy, at a point and beside it."""
    base, rng = program(), np.random.default_rng(1)
    structure, count = base.structure, 6
    node, feet = rng.integers(0, structure.nodes, count), rng.integers(0, 4, (count, 2))
    overlaps = Overlaps(
        node=node,
        feet=feet,
        depth_m=rng.normal(size=count),
        feet_m=rng.normal(size=(count, 2, 3)),
        by_foot=rng.normal(size=(count, 2, 3)),
        torso_m=rng.normal(size=(count, 3)),
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        by_torso=rng.normal(size=(count, 6)),
    )
    term = apart(structure, overlaps, 0.003)
    assert term is not None
    assert term.rows == count
    np.testing.assert_array_equal(term.lower, 0.003)
    rows = DenseProgram(
        base,
        base.settings,
        Checks(
            balance=np.zeros(structure.nodes - 1, dtype=bool),
            reach=np.zeros((structure.nodes - 1, 4), dtype=bool),
            overlaps=overlaps,
        ),
    )
    x = base.guess + 0.01 * rng.normal(size=base.size)
    found = np.asarray(rows.nlp.constraint(x, np.concatenate([x, np.zeros(3), [1.0]]))).ravel()[
        -count:
    ]
    walk = trajectory(x, "decoupled")
    expected = []
    for k, at in enumerate(np.rint(structure.times_s[node] / 0.005).astype(int)):
        turn, torso = walk.rotation[at], walk.torso_m[at]
        arms = (walk.feet_m[at, feet[k]] - torso) @ turn
        spin = 0.5 * np.array(
            [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
        depth = overlaps.depth_m[k] + np.sum(overlaps.by_foot[k] * (arms - overlaps.feet_m[k]))
        depth += overlaps.by_torso[k] @ np.concatenate([torso - overlaps.torso_m[k], spin])
        expected.append(-depth)
    np.testing.assert_allclose(np.sort(found), np.sort(expected), atol=1e-9)
