"""The equations of motion against closed forms: rest, free fall, spin, tumbling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import casadi as cs
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit import Motion
from stancekit.planners.answer.trajectory import OFF_M
from stancekit.planners.gait.charts.warped import Ambient, euler, shear_rotation
from stancekit.planners.gait.constraints.dynamics import (
    centred,
    lower_face,
    near,
    newton_euler,
    printed,
    wrench,
)
from stancekit.planners.gait.constraints.feet import SHARE, Overlaps, apart, slope_about, sure_xy
from stancekit.planners.gait.gait_program import GaitProgram, formulate, sure
from stancekit.planners.gait.method.guess import GuessedWalk, euler_angles
from stancekit.planners.gait.method.portfolio import Checks, DenseProgram, densified, leg_loads
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.gait.variables import Structure, sampled
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.verify.bodies import WholeBodyMeasurements
from stancekit.planners.verify.trajectories import LIMITS, check_trajectory
from stancekit.planners.verify.trajectory_measurements import TrajectoryMeasurements
from tests.planners.verify.test_trajectory_whole_body import stepping


def test_points_of_the_lower_face_are_close_enough_together() -> None:
    points = lower_face(np.array([0.2655, 0.135, 0.12]))
    assert np.all(points[:, 2] == -0.12)
    for axis, spacing in ((0, 0.09), (1, 0.18)):
        lines = np.unique(points[:, axis])
        assert lines[[0, -1]].tolist() == [-[0.2655, 0.135][axis], [0.2655, 0.135][axis]]
        assert np.diff(lines).max() <= spacing + 1e-12


def test_level_ground_gets_no_rows_and_a_rim_gets_them_when_the_robot_is_there(
    small: Callable[..., GaitProgram],
) -> None:
    assert "trunk" not in {term.name for term in small().nlp.constraints}
    structure = pit().structure
    node, point = near(structure, lower_face(structure.task.robot.trunk_half_m))
    assert 0 < len(node) < 0.5 * structure.nodes * (point.max() + 1)
    assert np.abs(np.linalg.norm(walked(structure)[node], axis=1) - 1.3).max() < 0.9


def test_a_pit_of_79_degrees_is_climbed_with_the_trunk_clear_between_all_nodes_and_points() -> None:
    found = pit(duration_s=6.0).solve()
    assert found.success
    report = check_trajectory(found.trajectory())
    assert report.accepted, report.message
    at, half = found.samples(np.linspace(0.0, 6.0, 1001)), found.program.task.robot.trunk_half_m
    lines = (np.linspace(-side, side, count) for side, count in zip(half[:2], (25, 5), strict=True))
    face = np.array([(x, y, -half[2]) for x, y in product(*lines)])
    points = at.torso_m[:, None] + np.einsum("kij,nj->kni", at.rotation, face)
    assert float((points[..., 2] - found.program.task.terrain.height(points[..., :2])).min()) > 0.0


def pit(duration_s: float = 10.0) -> GaitProgram:
    """Out of the pit of 79°, straight ahead."""
    task = Walk(
        robot=anymal(),
        terrain=reference_terrain("pit"),
        start=np.zeros(2),
        goal=np.array([2.0, 0.0]),
        adhesive=(True, True, False, False),
        duration_s=duration_s,
    )
    return formulate(task)


def walked(structure: Structure) -> np.ndarray:  # type: ignore[type-arg]
    """Where the guess's torso is at the nodes, shape (K, 2) [m]."""
    return GuessedWalk(structure).torso_xy(structure.times_s)


STEP_S = 0.05
ROBOT = anymal()
MOMENT = ROBOT.mass_kg * GRAVITY_M_S2 * ROBOT.stand_height_m
LEVEL = Ambient(HeightField.from_function(lambda x, y: 0.0 * x, 1.0, 0.2))


def felt(form: Any, states: list[np.ndarray]) -> np.ndarray:  # type: ignore[type-arg]
    """(p̈ − g, d/dt (R I ω)) of three torsos, non-dimensional."""
    symbols = [cs.SX.sym("y", 6) for _ in states]
    value = form(LEVEL, ROBOT, STEP_S)(symbols, [None] * len(states))
    return -np.asarray(cs.Function("felt", symbols, [value])(*states)).ravel()


@pytest.mark.parametrize("form", [centred, printed])
def test_a_torso_at_rest_feels_its_weight_and_no_moment(form: Any) -> None:
    state = np.array([0.1, -0.2, 0.5, 0.1, 0.2, 0.3])
    assert felt(form, [state] * 3) == pytest.approx([0, 0, 1, 0, 0, 0], abs=1e-12)


@pytest.mark.parametrize("form", [centred, printed])
def test_a_torso_in_free_fall_feels_nothing(form: Any) -> None:
    def state(t: float) -> np.ndarray:  # type: ignore[type-arg]
        return np.array(
            [0.3 * t, -0.1 * t, 1.0 + 2.0 * t - 0.5 * GRAVITY_M_S2 * t**2, 0.0, 0.0, 0.0]
        )

    assert felt(form, [state(k * STEP_S) for k in (3, 4, 5)]) == pytest.approx(
        np.zeros(6), abs=1e-10
    )


def test_a_steady_spin_about_the_vertical_needs_no_moment_when_centred() -> None:
    robot = replace(ROBOT, inertia_kgm2=np.diag([1.0, 1.0, 2.0]))
    symbols = [cs.SX.sym("y", 6) for _ in range(3)]
    function = cs.Function("felt", symbols, [centred(LEVEL, robot, STEP_S)(symbols, [None] * 3)])
    turning = [np.array([0, 0, 0.5, 0, 0, 3.0 * k * STEP_S]) for k in range(3)]
    assert np.asarray(function(*turning)).ravel() == pytest.approx([0, 0, -1, 0, 0, 0], abs=1e-12)


def test_a_growing_spin_needs_the_moment_of_euler() -> None:
    rate = 0.8

    def state(t: float) -> np.ndarray:  # type: ignore[type-arg]
        return np.array([0, 0, 0.5, 0, 0, 0.5 * rate * t**2])

    wanted = ROBOT.inertia_kgm2[2, 2] * rate / MOMENT
    assert felt(centred, [state(k * STEP_S) for k in (0, 1, 2)])[5] == pytest.approx(
        wanted, rel=1e-3
    )


def test_newton_and_euler_of_a_tumbling_torso_is_the_rate_of_its_momentum() -> None:
    def state(t: float) -> np.ndarray:  # type: ignore[type-arg]
        return np.array(
            [np.sin(t), t**2, 0.5 + 0.1 * t**3, 0.3 * np.sin(2 * t), 0.2 * t, 0.4 * t**2]
        )

    def momentum(t: float) -> np.ndarray:  # type: ignore[type-arg]
        half = 1e-4
        turns = [Rotation.from_euler("ZYX", state(t + s * half)[:2:-1]) for s in (-1, 0, 1)]
        omega = (turns[2] * turns[0].inv()).as_rotvec() / (2 * half)
        r = turns[1].as_matrix()
        return np.asarray(r @ ROBOT.inertia_kgm2 @ r.T @ omega)

    at, step = 0.7, 1e-3
    moving = np.concatenate(
        [
            state(at),
            (state(at + step) - state(at - step)) / (2 * step),
            (state(at + step) - 2 * state(at) + state(at - step)) / step**2,
        ]
    )
    symbol = cs.SX.sym("y", 18)
    value = newton_euler(LEVEL, ROBOT)([symbol], [None])
    found = -np.asarray(cs.Function("felt", [symbol], [value])(moving)).ravel()
    rate = (momentum(at + step) - momentum(at - step)) / (2 * step)
    assert found[3:] == pytest.approx(rate / MOMENT, abs=1e-5)
    assert found[:3] == pytest.approx(np.array([0, 0, 1]) + moving[12:15] / GRAVITY_M_S2, abs=1e-9)


def test_the_wrench_of_a_foot_is_its_force_and_its_lever() -> None:
    foot, torso = cs.SX.sym("f", 6), cs.SX.sym("y", 6)
    function = cs.Function("w", [foot, torso], [wrench(LEVEL, ROBOT)([foot, torso], [None, None])])
    p_i, f_i, p = np.array([0.3, 0.2, 0.0]), np.array([0.1, 0.0, 0.5]), np.array([0.0, 0.1, 0.4])
    found = np.asarray(function(np.r_[p_i, f_i], np.r_[p, 0.1, 0.2, 0.3])).ravel()
    assert found == pytest.approx(np.r_[f_i, np.cross(p_i - p, f_i) / ROBOT.stand_height_m])


def test_the_polar_factor_of_a_shear_is_the_nearest_rotation() -> None:
    slope = cs.SX.sym("g", 2)
    function: Callable[..., Any] = cs.Function("r", [slope], [shear_rotation(slope)])
    for gradient in ([0.0, 0.0], [0.7, -0.4], [5.0, 3.0]):
        jacobian = np.eye(3)
        jacobian[2, :2] = gradient
        u, _, vt = np.linalg.svd(jacobian)
        assert np.asarray(function(gradient)) == pytest.approx(u @ vt, abs=1e-12)


def test_euler_angles_come_back() -> None:
    angles = np.array([0.3, -0.7, 2.0])
    symbol = cs.SX.sym("a", 3)
    rotation = np.asarray(cs.Function("r", [symbol], [euler(symbol)])(angles))
    assert rotation == pytest.approx(Rotation.from_euler("ZYX", angles[::-1]).as_matrix())
    assert euler_angles(rotation) == pytest.approx(angles)


def edge(height_m: float = 0.1, width_m: float = 0.06) -> HeightField:
    """A step up at x = .4, over so much way."""
    return HeightField.from_function(
        lambda x, y: height_m * np.clip((x - 0.4) / width_m + 0.5, 0.0, 1.0) + 0.0 * y,
        1.5,
        0.025,
        name="edge",
    )


def over(terrain: HeightField, adhesive: tuple[bool, ...] = ()) -> Walk:
    return Walk(
        robot=anymal(),
        terrain=terrain,
        start=np.zeros(2),
        goal=np.array([0.3, 0.0]),
        duration_s=3.0,
        adhesive=adhesive,
    )


def stances(program: GaitProgram, x: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Where feet stand, seen from above, shape (K, 2) [m]."""
    entries = np.concatenate([foot.stances for foot in program.structure.layout.feet])
    return np.asarray(x[entries[:, :2]])


def test_slope_about_a_place_is_the_steepest_of_it_and_of_what_is_beside_it() -> None:
    terrain = edge()
    xy = np.array([0.4 - 0.03 - OFF_M, 0.0])
    alone = float(np.linalg.norm(terrain.gradient(xy)))
    about = [
        np.linalg.norm(terrain.gradient(xy + OFF_M * np.array(way)))
        for way in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    assert float(slope_about(terrain, xy)) == pytest.approx(max(alone, *map(float, about)))
    assert float(slope_about(terrain, xy)) > alone + 0.1


def test_a_place_moves_to_the_nearest_that_is_sure_and_stays_where_there_is_none() -> None:
    task, hill = (
        over(edge()),
        over(HeightField.from_function(lambda x, y: 0.7 * x + 0.0 * y, 1.5, 0.1)),
    )
    xy = np.array([[0.4, 0.1], [0.0, 0.0]])
    moved = sure_xy(task, SHARE, xy)
    assert np.all(slope_about(task.terrain, moved) <= SHARE * task.friction)
    assert moved[1].tolist() == [0.0, 0.0]
    assert 0.03 < np.linalg.norm(moved[0] - xy[0]) <= 0.12
    assert sure_xy(hill, SHARE, xy).tolist() == xy.tolist()


def test_walks_over_an_edge_are_asked_to_stand_sure_and_those_over_gentle_ground_and_up_a_steep_hill_are_not() -> (
    None
):
    settings = GaitSettings()
    gentle, hill = (
        HeightField.from_function(lambda x, y, a=a: a * x + 0.0 * y, 1.5, 0.1) for a in (0.2, 0.6)
    )
    assert sure(over(edge()), settings).footing == SHARE
    assert sure(over(edge()), replace(settings, footing=0.0)).footing == 0.0
    assert [sure(over(ground), settings).footing for ground in (gentle, hill)] == [0.0, 0.0]
    assert sure(over(edge(), (True,) * 4), settings).footing == 0.0
    for chart in ("decoupled", "ambient"):
        assert formulate(over(edge()), GaitSettings(chart=chart)).settings.footing == SHARE


@pytest.mark.parametrize("chart", ["decoupled", "ambient"])
def test_feet_of_a_walk_over_an_edge_stand_where_a_foot_that_is_off_holds_too(chart: str) -> None:
    task = over(edge())
    program = formulate(task, GaitSettings(chart=chart, footing=SHARE))
    found = program.solve()
    assert found.success
    assert (
        float(slope_about(task.terrain, stances(program, found.x)).max())
        <= SHARE * task.friction + 1e-3
    )
    plain = formulate(task, GaitSettings(chart=chart, footing=0.0))
    assert float(slope_about(task.terrain, stances(plain, plain.guess)).max()) > task.friction


def test_feet_that_stick_have_no_rows_and_nothing_is_asked_where_all_of_them_do() -> None:
    counts = []
    for sticks in (0, 2, 4):
        task = replace(
            over(edge()), adhesive=tuple(foot < sticks for foot in range(4)), suction_n=100.0
        )
        terms = {
            term.name: term.rows
            for term in formulate(task, GaitSettings(footing=SHARE)).nlp.constraints
        }
        counts.append(terms.get("footing", 0))
    assert counts[0] == 2 * counts[1] > counts[2] == 0


LOW = {**LIMITS, "torque": 0.3}
"""Most joints are near this."""


@cache
def program(chart: str = "decoupled") -> GaitProgram:
    x = np.linspace(-2.0, 2.0, 41)
    slope = HeightField(x, x, 0.1 * x[:, None] + 0.05 * np.sin(4.0 * x), "waves")
    task = Walk(
        robot=stepping().robot,
        terrain=slope,
        start=np.zeros(2),
        goal=np.array([0.15, 0.05]),
        duration_s=2.0,
    )
    return formulate(task, GaitSettings(chart=chart))


def trajectory(x: np.ndarray, chart: str) -> Motion:
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
    ).asked(terrain=task.terrain)


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
    limits = {**LIMITS, "torque": 0.95 * worst}
    refused = check_trajectory(found.trajectory(), limits)
    assert "torque" in {group.name for group in refused.refused}
    solution = densified(base, refused).solve(found.x)
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
