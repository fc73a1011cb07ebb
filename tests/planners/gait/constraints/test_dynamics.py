"""The equations of motion against closed forms: rest, free fall, spin, tumbling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import casadi as cs
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.gait.charts.warped import Ambient, euler, shear_rotation
from stancekit.planners.gait.constraints.dynamics import (
    centred,
    lower_face,
    near,
    newton_euler,
    printed,
    wrench,
)
from stancekit.planners.gait.gait_program import GaitProgram, formulate
from stancekit.planners.gait.method.guess import euler_angles
from stancekit.planners.gait.variables import Structure
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.verify.trajectories import check_trajectory


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
    rim = np.abs(np.linalg.norm(walked(structure)[node], axis=1) - 1.3)
    assert rim.max() < 0.9


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
        start_xy_m=np.zeros(2),
        goal_xy_m=np.array([2.0, 0.0]),
        adhesive=(True, True, False, False),
        duration_s=duration_s,
    )
    return formulate(task)


def walked(structure: Structure) -> np.ndarray:  # type: ignore[type-arg]
    """Where the guess's torso is at the nodes, shape (K, 2) [m]."""
    from stancekit.planners.gait.method.guess import GuessedWalk

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
    inertia = np.diag([1.0, 1.0, 2.0])
    robot = replace(ROBOT, inertia_kgm2=inertia)
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
