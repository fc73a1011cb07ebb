"""The trunk over steep ground: which points get rows, and what holds between them."""

from collections.abc import Callable
from itertools import product

import numpy as np

from stancekit.planners.gait.constraints.dynamics import lower_face, near
from stancekit.planners.gait.gait_program import GaitProgram, formulate
from stancekit.planners.gait.variables import Structure
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import anymal
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
