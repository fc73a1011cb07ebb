"""Sets of a leg's foot: nothing reachable outside the outer one, nothing out of reach in the inner
one.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from stancekit.planners.robot import hexapod, reach_sets as sets
from stancekit.planners.robot.hulls import Polytope
from stancekit.planners.robot.inverse_kinematics import REACHED_M, InverseKinematics, descend
from stancekit.planners.robot.leg import Chain, Joint, Leg
from stancekit.planners.robot.outer_sets import directions_of, enclosing_ball, foot_cloud
from stancekit.planners.robot.reach_sets import Workspace, workspace_of, workspaces_of
from stancekit.planners.robot.robot_file import drawn_urdf, hexapod_model
from stancekit.planners.robot.robot_model import RobotModel, model_of
from tests.planners.robot.small_urdfs import HIPS, joint, leg, link, quadruped, robot
from tests.refusals import refuses

pytest.importorskip("pinocchio")

Measured = tuple[RobotModel, tuple[Workspace, ...]]


@pytest.fixture(scope="module", params=["hexapod", "quadruped"])
def measured(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Measured:
    limbs = hexapod().limbs[:2]
    two = drawn_urdf(replace(hexapod(), limbs=limbs))
    model = model_of(two) if request.param == "hexapod" else model_of(quadruped(("RF", "LH")))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STANCEKIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        return model, workspaces_of(model)


def pendulum(*, length: float, low: float, high: float) -> Leg:
    """A rod that swings about y, and about x before that, from the origin."""
    joints = tuple(
        Joint(name=name, lower_rad=low, upper_rad=high, torque_nm=1.0, velocity_rad_s=1.0)
        for name in ("x", "y")
    )
    chain = Chain(
        rotations=np.stack([np.eye(3)] * 2),
        origins=np.zeros((2, 3)),
        axes=np.eye(3)[:2],
        slides=np.zeros(2, bool),
        tip_m=[0.0, 0.0, -length],
    )
    return Leg(
        name="rod", joints=joints, chain=chain, foot="end", radius_m=0.0, stance_rad=np.zeros(2)
    )


def test_nothing_reachable_is_outside_the_outer_set(measured: Measured) -> None:
    model, workspaces = measured
    for each, workspace in zip(model.legs, workspaces, strict=True):
        feet = each.chain.feet(each.random_angles(20_000, np.random.default_rng(7)))
        normals = directions_of()
        assert np.all(feet @ normals.T <= foot_cloud(each).supports(normals))
        points = workspace.inner.sample(1000, np.random.default_rng(7))
        room_m = 0.01  # an inner set is reached as far as its samples show
        assert np.all(points @ normals.T <= foot_cloud(each).supports(normals) + room_m)


def test_the_outer_set_is_hardly_larger_than_the_hull_of_what_is_reached(
    measured: Measured,
) -> None:
    model, _ = measured
    outer, normals = foot_cloud(model.legs[0]), directions_of()
    feet = model.legs[0].chain.feet(model.legs[0].random_angles(20_000, np.random.default_rng(8)))
    assert outer.slack_m < 0.025 * model.legs[0].chain.length_m
    around = Polytope(normals=normals, offsets_m=outer.supports(normals))
    assert (
        ConvexHull(feet).volume
        < ConvexHull(around.vertices).volume
        < 1.25 * ConvexHull(feet).volume
    )


def test_the_slack_of_the_hull_is_what_the_proof_says_and_no_less_is_needed() -> None:
    rod, step = pendulum(length=2.0, low=-1.0, high=1.0), 2.0 / 48
    points, slack = vars(foot_cloud(rod)).values()
    assert np.linalg.norm(points, axis=1).max() == pytest.approx(2.0)
    # twice, since it is a radius of 2 m about both axes: the rod's end is never farther from either
    assert slack == pytest.approx(2 * step**2 * 2.0 / 8.0, abs=3e-9)
    between = rod.chain.feet(np.array([[0.5 * step, 0.5 * step]]))[0]
    hull = ConvexHull(points)
    outside = float((hull.equations[:, :3] @ between + hull.equations[:, 3]).max())
    assert 0.2 * slack < outside < slack


def test_a_joint_that_slides_adds_no_slack_and_its_ends_are_in_the_set() -> None:
    parts = [link(f"{n}{i}") for n in "ab" for i in range(3)]
    limits = '<limit lower="0" upper=".4" effort="9" velocity="1"/>'
    for n, x in (("a", 0.2), ("b", -0.2)):
        parts += [
            joint(f"{n}_0", "base", f"{n}0", f"{x} 0 0", "1 0 0"),
            joint(f"{n}_1", f"{n}0", f"{n}1", "0 0 -.1"),
        ]
        parts.append(
            joint(f"{n}_2", f"{n}1", f"{n}2", "0 0 -.2", "0 0 -1", limits).replace(
                "revolute", "prismatic"
            )
        )
    each = model_of(robot(parts), feet=["a2", "b2"]).legs[0]
    assert each.joints[2].slides
    feet = each.chain.feet(np.array([[0.9, -0.8, 0.4], [-1.0, 1.0, 0.4], [0.0, 0.0, 0.0]]))
    assert np.all(feet @ directions_of().T <= foot_cloud(each).supports(directions_of()))
    assert np.linalg.norm(feet[0] - each.hip_m) > 0.6


def test_the_ball_around_points_holds_them_and_is_nearly_the_smallest() -> None:
    points = np.random.default_rng(0).normal(size=(500, 3))
    points = 3.0 * points / np.linalg.norm(points, axis=1, keepdims=True) + [1.0, 2.0, 3.0]
    centre, radius = enclosing_ball(points)
    assert np.all(np.linalg.norm(points - centre, axis=1) <= radius)
    assert 2.9 < radius < 3.1


def test_inner_sets_are_reached_and_cover_most_of_what_is_of_use(measured: Measured) -> None:
    model, workspaces = measured
    rng = np.random.default_rng(11)
    for each, workspace in zip(model.legs, workspaces, strict=True):
        assert workspace.cover >= 0.6
        assert workspace.unreachable <= 0.006
        points = workspace.inner.sample(1000, rng)
        _, error = InverseKinematics([each], [each.random_angles(8000, rng)]).solve(points[:, None])
        assert np.mean(error <= REACHED_M) >= 0.99


def test_joints_with_narrow_ranges_leave_room_to_plan_in() -> None:
    (leg,) = model_of(quadruped(("LF",))).legs
    joints = [
        replace(joint, lower_rad=low, upper_rad=high)
        for joint, low, high in zip(leg.joints, (-0.25, 0.2, -1.6), (0.25, 1.0, -0.9), strict=True)
    ]
    workspace = workspace_of(
        replace(leg, joints=tuple(joints), stance_rad=np.array([0, 0.6, -1.2]))
    )
    assert workspace.cover > 0.3
    assert workspace.unreachable < 0.005
    assert workspace.ball_m[3] > 0.05 * leg.chain.length_m


def test_balls_and_boxes_are_inside_and_touch(measured: Measured) -> None:
    _, workspaces = measured
    for workspace in workspaces:
        inner, (*centre, radius) = workspace.inner, workspace.ball_m
        room = inner.offsets_m - inner.normals @ np.array(centre)
        assert room.min() == pytest.approx(radius, abs=1e-9)
        assert np.count_nonzero(room < radius + 1e-6) >= 4
        corners = np.array(
            [[workspace.box_m[b, k] for k, b in enumerate(bits)] for bits in np.ndindex(2, 2, 2)]
        )
        assert np.all(corners @ inner.normals.T <= inner.offsets_m + 1e-9)
        assert (
            np.prod(workspace.box_m[1] - workspace.box_m[0])
            > (2.0 * radius / np.sqrt(3.0)) ** 3 * 0.999
        )


def test_the_largest_box_of_an_octahedron_is_known() -> None:
    signs = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / np.sqrt(3.0)
    octahedron = Polytope(normals=signs, offsets_m=np.full(8, 1.0 / np.sqrt(3.0)))
    np.testing.assert_allclose(octahedron.largest_box(), [[-1 / 3] * 3, [1 / 3] * 3], atol=1e-5)
    np.testing.assert_allclose(
        octahedron.largest_ball, [0.0, 0.0, 0.0, 1.0 / np.sqrt(3.0)], atol=1e-9
    )
    assert ConvexHull(octahedron.vertices).volume == pytest.approx(4.0 / 3.0)
    more = octahedron.cut(np.eye(3), np.full(3, 2.0))
    assert len(more.normals) == 11
    assert len(more.lean().normals) == 8


def test_the_largest_ball_is_that_of_another_formulation() -> None:
    """Bounded sets with an inside, unbounded ones, and empty ones, by SciPy's linprog."""
    rng, found = np.random.default_rng(0), []
    for _ in range(60):
        normals = rng.normal(size=(rng.integers(3, 30), 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        polytope = Polytope(normals=normals, offsets_m=rng.uniform(-0.1, 0.5, len(normals)))
        rows = np.column_stack([normals, np.ones(len(normals))])
        free = [(None, None)] * 3 + [(0.0, None)]
        answer = linprog([0.0, 0.0, 0.0, -1.0], rows, polytope.offsets_m, bounds=free)
        found.append(answer.status == 0 and answer.x[3] > 0.0)
        if found[-1]:
            np.testing.assert_allclose(polytope.largest_ball[3], answer.x[3], rtol=1e-9)
            assert polytope.contains(polytope.largest_ball[None, :3]).all()
        else:
            with refuses("polytope"):
                _ = polytope.largest_ball
    assert 10 < sum(found) < 50


def test_flat_sets_and_legs_without_an_inside_are_refused() -> None:
    flat = Polytope(
        normals=np.vstack([np.eye(3), -np.eye(3)]), offsets_m=[1.0, 1.0, 0.0, 1.0, 1.0, 0.0]
    )
    with refuses("polytope"):
        _ = flat.vertices
    parts = [link(f"{n}{i}") for n in "ab" for i in range(2)]
    for n in "ab":
        parts += [joint(f"{n}_{i}", ("base", f"{n}0")[i], f"{n}{i}", "0 0 -.3") for i in range(2)]
    with refuses("leg a"):
        workspaces_of(model_of(robot(parts), feet={"a": "a1", "b": "b1"}), cached=False)
    with refuses("leg LF", "room for its foot, 0.3 m", "posture_rad"):
        workspaces_of(model_of(quadruped(("LF",)).replace('radius="0.02"', 'radius="0.3"')))


def test_workspaces_are_kept_leg_by_leg_and_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STANCEKIT_CACHE", str(tmp_path))
    one = model_of(robot([leg(name) for name in list(HIPS)[:2]]))
    first = workspaces_of(one)
    second = {*(tmp_path / "workspaces").iterdir()}
    assert len(second) == 2
    for before, after in zip(first, workspaces_of(one), strict=True):
        np.testing.assert_array_equal(before.inner.normals, after.inner.normals)
        np.testing.assert_array_equal(before.ball_m, after.ball_m)
        assert (before.cover, before.unreachable) == (after.cover, after.unreachable)
    made = list[str]()
    monkeypatch.setattr(sets, "workspace_of", lambda leg: made.append(leg.name) or first[0])
    weak = model_of(robot([leg(name, effort=8.0) for name in list(HIPS)[:2]]))
    assert one.digest != weak.digest
    assert [each.cover for each in workspaces_of(weak)] == [
        each.cover for each in first
    ]  # the same legs: read
    assert made == []
    third = model_of(robot([leg(name) for name in list(HIPS)[1:3]]))
    assert workspaces_of(third)[0].cover == first[1].cover
    assert made == [third.leg_names[1]]  # the other is known
    short = model_of(
        robot([leg(name) for name in list(HIPS)[:2]]).replace('lower="-0.7"', 'lower="-0.6"')
    )
    workspaces_of(short)
    assert made == [third.leg_names[1], *short.leg_names]  # other limits: measured
    for file in second:
        content = file.read_bytes()
        file.write_bytes(content[: len(content) // 2])
    assert [each.cover for each in workspaces_of(one)] == [first[0].cover] * 2  # damaged: measured
    assert all(len(file.read_bytes()) > len(content) // 2 for file in second)


def test_inverse_kinematics_finds_what_forward_kinematics_made_and_keeps_limits(
    measured: Measured,
) -> None:
    model, _ = measured
    rng = np.random.default_rng(4)
    legs = InverseKinematics(model.legs, [each.random_angles(8000, rng) for each in model.legs])
    feet = np.stack([each.chain.feet(each.random_angles(300, rng)) for each in model.legs], axis=1)
    found, error_m = legs.solve(feet)
    assert (error_m <= REACHED_M).mean() >= 0.99
    ends = np.cumsum([len(each.joints) for each in model.legs])
    for i, (each, angles) in enumerate(
        zip(model.legs, np.split(found, ends[:-1], axis=1), strict=True)
    ):
        assert np.all((angles >= each.lower_rad) & (angles <= each.upper_rad))
        np.testing.assert_allclose(
            np.linalg.norm(each.chain.feet(angles) - feet[:, i], axis=1),
            error_m[:, i],
            atol=1e-12,
        )


def test_a_posture_near_the_foot_is_kept_to() -> None:
    each = hexapod_model().legs[0]
    solver = InverseKinematics([each], [each.random_angles(2000, np.random.default_rng(0))])
    near = np.array([[0.2, -0.4, 0.3, 1.2]])
    feet = each.chain.feet(near) + np.array([0.002, 0.0, 0.0])
    angles, error = solver.solve(feet[:, None], near=near)
    assert error[0, 0] <= REACHED_M
    assert np.abs(angles - near).max() < 0.05


def test_out_of_reach_is_the_distance_that_is_left() -> None:
    rod = pendulum(length=0.5, low=-1.0, high=1.0)
    angles, error = descend(rod, [[0.0, 0.0, -0.8]], [[0.3, 0.2]])
    assert error[0] == pytest.approx(0.3, abs=1e-3)
    np.testing.assert_allclose(rod.chain.feet(angles)[0], [0.0, 0.0, -0.5], atol=0.03)


def test_joints_that_turn_freely_pass_the_end_of_their_range() -> None:
    rod = pendulum(length=1.0, low=-np.pi, high=np.pi)
    target = rod.chain.feet(np.array([[0.0, np.pi - 0.1]]))
    angles, error = descend(rod, target, [[0.0, -np.pi + 0.1]])
    assert error[0] <= REACHED_M
    assert np.all(np.abs(angles) <= np.pi)


def test_feet_of_another_shape_are_refused() -> None:
    each = hexapod_model().legs[0]
    legs = InverseKinematics([each])
    with refuses("feet"):
        legs.solve(np.zeros((2, 6, 3)))
