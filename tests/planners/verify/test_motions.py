"""The verifier of motions from elsewhere: ours hold, with and without contacts and forces; spoiled
ones are found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("pinocchio")
pytest.importorskip("coal")

import stancekit
from stancekit.planners.answer.report import Report
from stancekit.planners.motion.motion import MotionTable, shapes
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.terrain.obstacles import Ground
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.verify.motions import _MotionLimits, check_motion, nearest
from stancekit.runner.export.formats import Moved, moved_of
from tests.refusals import assert_names, refuses


@pytest.fixture(scope="module")
def moved() -> Moved:
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    walk = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled").solution
    assert walk is not None
    return moved_of(walk, "npz")


def judged(table: MotionTable, moved: Moved) -> Report[MotionTable]:
    assert moved.robot is not None
    return check_motion(table, moved.robot, moved.terrain)


def arrays(table: MotionTable) -> tuple[np.ndarray, np.ndarray]:
    """Angles and origins that may be changed."""
    known = table.arrays()
    return np.array(known["angles_rad"]), np.array(known["origin_m"])


def test_an_exported_walk_holds_in_every_group(moved: Moved) -> None:
    report = judged(moved.table, moved)
    assert (report.accepted, len(report.checked)) == (True, 17)
    assert report.checked == tuple(group.name for group in report.groups)


def test_joints_alone_say_little_and_that_is_said(moved: Moved) -> None:
    report = judged(moved.table.with_columns(origin_m=None, quaternion=None), moved)
    assert report.checked == ("joints", "joint_speed", "torque", "rates", "com_velocity")
    assert_names(report.group("balance").message, "body")


def test_joints_in_another_order_are_the_same_motion(moved: Moved) -> None:
    table = moved.table
    turned = {
        name: table.columns[name][:, ::-1] for name in ("angles_rad", "rates_rad_s", "torques_nm")
    }
    report = judged(replace(table.with_columns(**turned), joints=table.joints[::-1]), moved)
    assert [group.value for group in report.groups] == [
        group.value for group in judged(table, moved).groups
    ]


def test_large_feet_alone_may_roll_farther_from_where_the_table_has_them(moved: Moved) -> None:
    feet = moved.table.arrays()["feet_m"] + [0.03, 0.0, 0.0]
    table = moved.table.with_columns(feet_m=feet)
    model = moved.robot.legs_with(moved.robot.servo)
    for first_m, others_m in ((0.02, 0.02), (0.05, 0.02), (0.05, 0.05)):
        radii_m = first_m, *[others_m] * 3
        legs = [replace(leg, radius_m=r) for leg, r in zip(model.legs, radii_m, strict=True)]
        robot = replace(moved.robot, model=replace(model, legs=tuple(legs)))
        group = check_motion(table, robot, moved.terrain).group("feet")
        assert (group.verdict == "violated") == (others_m < 0.05)
        assert first_m == others_m or group.where != table.limbs[0]


def test_a_joint_beyond_its_limit_is_named(moved: Moved) -> None:
    assert moved.robot is not None
    angles, _ = arrays(moved.table)
    joint = int(np.argmax(np.isfinite(Kinematics(moved.robot).highest_rad)))
    angles[100:120, joint] = Kinematics(moved.robot).upper_rad[joint] + 0.05
    group = judged(moved.table.with_columns(angles_rad=angles), moved).group("joints")
    assert (group.verdict, group.where) == ("violated", moved.table.joints[joint])
    assert group.value == pytest.approx(0.05)


def test_a_body_beside_its_feet_tips_over(moved: Moved) -> None:
    angles, origin = arrays(moved.table)
    known, kinematics = moved.table.arrays(), Kinematics(moved.robot)
    origin[:, 1] += 0.6 * np.sin(np.pi * np.linspace(0.0, 1.0, len(origin))) ** 2
    for row, turn in enumerate(moved.table.rotation):
        feet = known["origin_m"][row] + kinematics.feet(known["angles_rad"][row]) @ turn.T
        angles[row] = kinematics.reach(
            (feet - origin[row]) @ turn, angles[max(0, row - 1)], angles[row], limits=False
        )[0]
    report = judged(
        moved.table.with_columns(angles_rad=angles, origin_m=origin, forces_n=None), moved
    )
    assert "balance" in [group.name for group in report.refused]


@pytest.mark.parametrize(("beyond_m", "held"), [(0.003, True), (0.03, False)])
def test_a_robot_at_rest_does_not_lean_beyond_its_feet_for_seconds(
    moved: Moved, beyond_m: float, held: bool
) -> None:
    still = {name: np.array(each[:1] + 0 * each) for name, each in moved.table.columns.items()}
    still["contact"] = np.tile([True, True, True, False], (len(still["origin_m"]), 1))
    first, last = still["feet_m"][0, [1, 2], :2]  # the long side of the three feet that stand
    along = (last - first) / np.linalg.norm(last - first)
    out = np.array([along[1], -along[0]])
    out *= np.sign((still["feet_m"][0, 3, :2] - first) @ out)
    way = (beyond_m - (still["com_m"][0, :2] - first) @ out) * out
    kinematics, turn = Kinematics(moved.robot), moved.table.rotation[0]
    for _ in range(20):  # the centre of mass moves in the body, too
        feet = (still["feet_m"][0] - still["origin_m"][0] - [*way, 0.0]) @ turn
        angles = kinematics.reach(feet, still["angles_rad"][0], still["angles_rad"][0])[0]
        com = still["origin_m"][0] + [*way, 0.0] + turn @ kinematics.com_offset(angles)
        way += (beyond_m - (com[:2] - first) @ out) * out
    still["angles_rad"][:] = angles
    still["origin_m"] += [*way, 0.0]
    names = ("angles_rad", "origin_m", "quaternion", "contact")
    columns = {"time_s": moved.table.time_s} | {name: still[name] for name in names}
    group = judged(replace(moved.table, columns=columns), moved).group("balance")
    assert group.value == pytest.approx(
        0.08 * beyond_m / 5e-3, rel=0.05
    )  # as far as a foot may slip
    assert (group.verdict == "holds") == held


def on_a_slope(
    moved: Moved, slope_deg: float, heading_deg: float, noise: float = 0.0
) -> Report[MotionTable]:
    """Two seconds of a still robot, its centre of mass above the middle of its feet."""
    assert moved.robot is not None
    way, known, kinematics = np.radians(heading_deg), moved.table.arrays(), Kinematics(moved.robot)
    turn = Rotation.from_rotvec(np.radians(slope_deg) * np.array([-np.sin(way), np.cos(way), 0.0]))
    feet, body, angles = known["feet_m"][0], moved.table.rotation[0], known["angles_rad"][0]
    up = turn.inv().apply([0.0, 0.0, 1.0])
    com = feet.mean(axis=0) + 0.5 * moved.robot.legs.stand_height_m * up / up[2]
    for _ in range(20):
        origin = com - body @ kinematics.com_offset(angles)
        angles = kinematics.reach((feet - origin) @ body, angles, angles, limits=False)[0]
    rng, rows = np.random.default_rng(0), 100
    shakes = Rotation.from_rotvec(np.radians(0.3 * noise) * rng.uniform(-1.0, 1.0, (rows, 3)))
    columns = {
        "time_s": np.arange(rows) / 50.0,
        "angles_rad": np.tile(angles, (rows, 1)),
        "origin_m": turn.apply(origin) + 2e-3 * noise * rng.uniform(-1.0, 1.0, (rows, 3)),
        "quaternion": (shakes * turn * Rotation.from_matrix(body)).as_quat(scalar_first=True),
        "contact": np.ones((rows, len(feet)), dtype=bool),
    }
    corners = turn.apply([[-5, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]])
    normal, along = turn.apply([[0, 0, 1], [1, 0, 0]])
    ground = Patch(vertices_m=corners, normal=normal, shear_reference=along, friction=0.6)
    # noise alone is a multiple of the weight within 0.2 s: only what lasts is asked for then
    limits = _MotionLimits(balance=10.0 if noise else 0.08)
    return check_motion(replace(moved.table, columns=columns), moved.robot, [ground], limits)


@pytest.mark.parametrize("heading_deg", [0.0, 15.0, 22.5, 30.0, 45.0])
def test_a_robot_stands_on_slopes_up_to_the_angle_of_friction(
    moved: Moved, heading_deg: float
) -> None:
    steepest_deg = np.degrees(np.arctan(0.6))  # 30.96
    for slope_deg in (25.0, 30.9, 31.1, 32.0):
        group = on_a_slope(moved, slope_deg, heading_deg).group("balance")
        lacks = np.sin(np.radians(max(0.0, slope_deg - steepest_deg)))  # distance from the cone
        assert group.value == pytest.approx(80.0 * lacks, rel=0.01, abs=1e-3)
        assert (group.verdict == "holds") == (slope_deg < steepest_deg)


@pytest.mark.parametrize(("slope_deg", "held"), [(25.0, True), (32.0, False)])
def test_the_noise_of_a_log_is_no_lasting_lack_and_hides_none(
    moved: Moved, slope_deg: float, held: bool
) -> None:
    group = on_a_slope(moved, slope_deg, 22.5, noise=1.0).group("balance")
    assert (group.verdict == "holds") == held


def test_a_body_that_is_too_low_has_its_feet_in_the_ground(moved: Moved) -> None:
    _, origin = arrays(moved.table)
    report = judged(
        moved.table.with_columns(origin_m=origin - [0.0, 0.0, 0.02], contact=None, forces_n=None),
        moved,
    )
    assert report.group("penetration").value == pytest.approx(0.02, abs=2e-3)
    assert report.group("penetration").verdict == "violated"


def test_beyond_the_border_of_heights_there_is_no_ground(moved: Moved) -> None:
    away = {name: moved.table.arrays()[name] + [30.0, 0.0, 0.0] for name in ("com_m", "feet_m")}
    table = moved.table.with_columns(origin_m=arrays(moved.table)[1] + [30.0, 0.0, 0.0], **away)
    group = judged(table, moved).group("contact_gap")
    assert group.verdict == "violated"
    assert group.value == pytest.approx(
        28.5, abs=0.1
    )  # the front feet come to 0.5, and the grid ends at 2


def test_a_body_that_slides_while_its_feet_stand_slips(moved: Moved) -> None:
    _, origin = arrays(moved.table)
    origin[:, 0] += 0.03 * np.linspace(0.0, 1.0, len(origin))
    group = judged(moved.table.with_columns(origin_m=origin), moved).group("slip")
    assert 5e-3 < group.value < 0.03
    taps = moved.table.arrays()["contact"] & (
        np.add.outer(np.arange(len(origin)), range(4)) % 2 > 0
    )
    tapping = moved.table.with_columns(
        origin_m=origin, contact=taps
    )  # a foot that does not lift stands
    assert judged(tapping, moved).group("slip").verdict == "violated"


def test_feet_that_are_taken_for_points_stand_though_their_balls_would_scrub(moved: Moved) -> None:
    assert moved.robot is not None
    kinematics = Kinematics(moved.robot)
    angles, origin = arrays(moved.table)
    feet = np.array(
        [origin[0] + kinematics.feet(angles[0]) @ moved.table.rotation[0].T] * len(angles)
    )
    origin[:, 0] = origin[0, 0] + 0.06 * np.sin(
        np.linspace(0.0, np.pi, len(angles))
    )  # the body sways, feet stay
    near = angles[0]
    for row, turn in enumerate(moved.table.rotation):
        near = kinematics.reach((feet[row] - origin[row]) @ turn, near, near, limits=False)[0]
        angles[row] = near
    table = moved.table.with_columns(
        angles_rad=angles, origin_m=origin, contact=None, forces_n=None
    )
    assert judged(table, moved).group("slip").verdict == "holds"
    slid = origin + [0.0, 0.03, 0.0] * np.linspace(0.0, 1.0, len(angles))[:, None]
    assert judged(table.with_columns(origin_m=slid), moved).group("slip").value == pytest.approx(
        0.03, abs=2e-3
    )


@pytest.mark.parametrize(
    ("rolling", "slides", "slip_m"),
    [
        ((0, 1, 2, 3), (), 0.0),  # balls that roll
        ((), (), 0.0),  # points that stay
        ((0,), (), None),  # one rolls, and three spin in place: either rule finds slip
        ((0, 1, 3), (2,), 0.03),  # three roll, and one slides
        ((), (2,), 0.03),
        ((0,), (0,), 0.03),  # the one that rolls slides beside that
    ],
)
def test_feet_that_roll_or_spin_in_place_and_one_that_slides_beside_them(
    moved: Moved, rolling: tuple[int, ...], slides: tuple[int, ...], slip_m: float | None
) -> None:
    kinematics, known = Kinematics(moved.robot), moved.table.arrays()
    count, turn = 80, moved.table.rotation[0]
    origin = np.tile(known["origin_m"][0], (count, 1))
    origin[:, 0] += 0.14 * np.linspace(-0.5, 0.5, count)  # the body sways; shanks turn
    near = known["angles_rad"][0]
    chains = [leg.chain for leg in kinematics.model.legs]
    joints = [kinematics.joints_of(i) for i in range(len(chains))]
    slid = np.zeros((count, len(chains), 3))
    slid[:, list(slides), 1] = np.linspace(0.0, 0.03, count)[:, None]
    feet = known["origin_m"][0] + kinematics.feet(near) @ turn.T
    angles: list[np.ndarray] = []

    def shanks(of: np.ndarray) -> list[np.ndarray]:
        return [
            turn @ chain.frames(of[None, j])[0][0, -1]
            for chain, j in zip(chains, joints, strict=True)
        ]

    for row in range(count):
        target = feet.copy()
        for _ in range(4):  # where a ball is that rolled since the row before
            found = kinematics.reach(
                (target + slid[row] - origin[row]) @ turn, near, near, limits=False
            )[0]
            if not angles:
                break
            for i in rolling:
                skewed = shanks(found)[i] @ shanks(angles[-1])[i].T
                omega = 0.5 * np.array(
                    [
                        skewed[2, 1] - skewed[1, 2],
                        skewed[0, 2] - skewed[2, 0],
                        skewed[1, 0] - skewed[0, 1],
                    ]
                )
                target[i, :2] = (
                    feet[i] + kinematics.radii_m[i] * np.cross(omega, [0.0, 0.0, 1.0])
                )[:2]
        feet, near = target, found
        angles.append(found)
    table = MotionTable(
        joints=moved.table.joints,
        limbs=moved.table.limbs,
        columns={
            "time_s": 0.01 * np.arange(count),
            "angles_rad": np.array(angles),
            "origin_m": origin,
            "quaternion": np.tile(known["quaternion"][0], (count, 1)),
            "contact": np.ones((count, len(chains)), dtype=bool),
        },
    )
    group = judged(table, moved).group("slip")
    if slip_m is None:
        assert group.verdict == "violated"
    else:
        assert group.value == pytest.approx(slip_m, abs=2e-3)


def test_forces_outside_of_their_cones_and_in_the_air_are_found(moved: Moved) -> None:
    forces, contact = np.array(moved.table.columns["forces_n"]), moved.table.columns["contact"]
    assert contact is not None
    forces[..., 0] += np.where(contact, 0.9 * forces[..., 2], 5.0)
    report = judged(moved.table.with_columns(forces_n=forces), moved)
    assert {"cone", "swing_force", "forces"} <= {group.name for group in report.refused}


def test_a_foot_in_a_corner_may_press_on_the_floor_though_the_wall_is_nearer(moved: Moved) -> None:
    assert moved.robot is not None
    assert isinstance(moved.terrain, Ground)
    known, sides = moved.table.arrays(), np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    floor = Patch(
        vertices_m=3.0 * sides, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.75
    )
    foot, radius = known["feet_m"][0, 0], float(Kinematics(moved.robot).radii_m[0])
    upright = (
        foot + 0.05 * sides[:, [2, 0, 1]] + [radius - 2e-4, 0.0, 0.0]
    )  # a wall just ahead, 0.2 mm in the foot
    wall = Patch(vertices_m=upright, normal=[-1, 0, 0], shear_reference=[0, 1, 0], friction=0.75)
    rest = moved.table.with_columns(
        **{name: array[:40] for name, array in known.items()}
    )  # before the first step
    report = check_motion(rest, moved.robot, [floor, wall])
    assert report.group("penetration").value == pytest.approx(2e-4, abs=5e-5)
    assert report.group("cone").verdict == report.group("balance").verdict == "holds"


def test_a_foot_that_skims_over_the_ground_swings_where_the_file_does_not_say_that_it_stands(
    moved: Moved,
) -> None:
    angles, origin = arrays(moved.table)
    still = moved.table.with_columns(
        angles_rad=np.tile(angles[0], (len(angles), 1)), contact=None, forces_n=None
    )
    for speed, stands in ((0.05, True), (0.3, False)):
        moving = origin[0] + np.outer(moved.table.time_s - moved.table.time_s[0], [speed, 0.0, 0.0])
        table = still.with_columns(
            origin_m=moving,
            quaternion=np.tile(moved.table.arrays()["quaternion"][0], (len(angles), 1)),
        )
        report = judged(table, moved)
        assert (report.group("slip").verdict == "violated") == stands
        assert (report.group("balance").verdict == "violated") != stands


def spoiled(table: MotionTable, **columns: Callable[[np.ndarray], np.ndarray]) -> MotionTable:
    return table.with_columns(**{name: of(table.columns[name]) for name, of in columns.items()})


def digits(count: int) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """All columns but the contacts with so many decimals, as files of other programs have them."""
    names = shapes(0, 0, 0).keys() - {"contact"}
    return {name: lambda array: np.round(array, count) for name in names}


def stamps(error_s: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda times: times + np.random.default_rng(0).uniform(-error_s, error_s, len(times))


NO_LOGS = ("forces_n", "contact", "torques_nm", "rates_rad_s", "feet_m", "com_m", "velocity_m_s")
HARMLESS = {
    "four decimals": digits(4),
    "three decimals": digits(3),
    "single precision": {name: lambda array: np.float64(np.float32(array)) for name in digits(4)},
    "stamps that jitter by 0.3 ms": {"time_s": stamps(3e-4)},
    "seconds since 1970": {"time_s": lambda times: times + 1732456789.25},
    "since 1970, four decimals": digits(4)
    | {"time_s": lambda times: np.round(times + 1732456789.25, 4)},
    "quaternions on either side": digits(4)
    | {"quaternion": lambda q: np.round(q, 4) * np.where(np.arange(len(q)) % 2, 1, -1)[:, None]},
    "body and angles alone": {name: lambda _: None for name in NO_LOGS},
}


@pytest.mark.parametrize("name", HARMLESS)
def test_rounding_jitter_and_missing_columns_do_no_harm(name: str, moved: Moved) -> None:
    report = judged(spoiled(moved.table, **HARMLESS[name]), moved)
    assert report.accepted
    bare = {"torque", "contact_gap", "forces", "cone", "swing_force"}
    assert set(report.unchecked) == (bare if "alone" in name else set())


def bump(size: float, axis: int) -> Callable[[np.ndarray], np.ndarray]:
    """A body that swings by so much [m], four times per second."""

    def shaken(array: np.ndarray) -> np.ndarray:
        wave = np.sin(2.0 * np.pi * 0.04 * np.arange(len(array)))
        return np.round(array + size * wave[:, None] * np.eye(3)[axis], 4)

    return shaken


WRONG = {
    "a shaken body": ({"origin_m": bump(0.004, 2)}, "forces"),
    "a body that slides": ({"origin_m": bump(0.01, 0)}, "slip"),
    "weak forces": ({"forces_n": lambda forces: 0.8 * forces}, "forces"),
    "two decimals": (digits(2), "balance"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_beyond_the_digits_is_refused(name: str, moved: Moved) -> None:
    columns, group = WRONG[name]
    report = judged(spoiled(moved.table, **digits(4) | columns), moved)
    assert group in [each.name for each in report.refused]
    assert ("rounded to 0.01" in report.message) is (name == "two decimals")


def test_rows_that_are_lost_or_late_are_no_jitter(moved: Moved) -> None:
    table, rows = moved.table, np.arange(len(moved.table.time_s))
    with refuses("time_s", "row 90"):
        table.with_columns(**{name: array[rows != 90] for name, array in table.arrays().items()})
    with refuses("time_s", "row 91"):
        table.with_columns(time_s=table.time_s + 2e-3 * (rows > 90))
    with refuses("time_s"):
        spoiled(table, time_s=stamps(2e-3))
    with refuses("time_s"):  # gaps of 30 and 10 ms, which no digits excuse
        table.with_columns(time_s=np.round(0.02 * rows + 0.01 * (rows % 2), 2))


def test_other_joints_are_refused_by_name(moved: Moved) -> None:
    with refuses("joints"):
        judged(replace(moved.table, joints=("arm", *moved.table.joints[1:])), moved)
    with refuses():
        judged(moved.table.with_columns(angles_rad=None), moved)
    with refuses("motion"):
        judged(
            replace(
                moved.table.with_columns(angles_rad=None, rates_rad_s=None, torques_nm=None),
                joints=(),
            ),
            moved,
        )


def test_a_ball_over_a_patch_its_edge_and_heights() -> None:
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    patch = Patch(vertices_m=square, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.6)
    centres = np.array([[0.5, 0.5, 0.1], [1.3, 0.5, 0.4], [0.5, 0.5, -0.01], [1.3, 0.5, -0.4]])
    gap, normal, friction = nearest([patch], centres, np.full(4, 0.02))
    np.testing.assert_allclose(gap, [0.08, 0.48, -0.03, 0.48])
    assert (normal == [0, 0, 1]).all()
    assert (friction == 0.6).all()
    level = Ground(
        heights=stancekit.HeightField.from_array(np.full((41, 41), 0.2), spacing_m=0.1),
        friction=0.5,
    )
    gap, _, _ = nearest(level, np.array([[0.0, 0.0, 0.3]]), np.array([0.02]))
    assert gap[0] == pytest.approx(0.08)


def test_a_ball_beside_a_step_of_heights_is_as_near_as_a_fine_grid_says() -> None:
    x = np.linspace(-0.5, 0.5, 41)
    step = stancekit.HeightField.from_array(
        np.where(x[:, None] > 0.0, 0.1, 0.0) * np.ones(41), spacing_m=0.025
    )
    rng, radius = np.random.default_rng(0), 0.0265
    centres = np.stack(
        [rng.uniform(-0.04, 0.06, 40), rng.uniform(-0.1, 0.1, 40), rng.uniform(0.0, 0.16, 40)],
        axis=1,
    )
    gap, normal, _ = nearest(Ground(heights=step, friction=0.5), centres, np.full(40, radius))
    side = np.arange(-0.06, 0.06, 0.001)
    for centre, its_gap, its_normal in zip(centres, gap, normal, strict=True):
        places = centre[:2] + np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        surface = np.column_stack([places, step.height(places)])
        far = float(np.linalg.norm(surface - centre, axis=1).min())
        signed = -far if centre[2] < step.height(centre[None, :2])[0] else far
        if abs(signed) > 1.2 * radius:  # nobody asks how far away a foot in the air is
            assert its_gap > 0.0 or signed < 0.0
            continue
        assert its_gap == pytest.approx(signed - radius, abs=1e-3)
        assert np.linalg.norm(its_normal) == pytest.approx(1.0)


COLUMNS = {
    "rates": ("rates_rad_s", 0.06, "share of the limit"),
    "com": ("com_m", 0.012, "m"),
    "com_velocity": ("velocity_m_s", 0.06, "m/s"),
    "turning": ("turning_rad_s", 0.12, "rad/s"),
    "feet": ("feet_m", 0.035, "m"),
    "effort": ("torques_nm", 0.2, "share of the limit"),
}
"""Groups of columns, the column, and an error that is above the width."""


@pytest.mark.parametrize("name", COLUMNS)
@pytest.mark.parametrize("rows", [slice(None), slice(90, 130)])
def test_a_column_that_the_others_contradict_is_refused(
    name: str, rows: slice, moved: Moved
) -> None:
    column, error, _ = COLUMNS[name]
    assert moved.robot is not None
    kinematics = Kinematics(moved.robot)
    scale = {"rates": kinematics.velocity_rad_s, "effort": kinematics.torque_nm}.get(name, 1.0)
    report = judged(moved.table, moved)
    assert report.group(name).value < 0.6 * report.group(name).limit
    for share, holds in ((1.0, False), (0.1, True)):
        array = np.array(moved.table.arrays()[column])
        array[rows] += share * error * scale
        group = judged(moved.table.with_columns(**{column: array}), moved).group(name)
        assert (group.verdict == "holds") is holds
    none = judged(moved.table.with_columns(**{column: None}), moved)
    assert name not in [group.name for group in none.groups]
    assert none.accepted


def test_torques_are_worked_out_where_the_file_says_none_or_zeros(moved: Moved) -> None:
    assert moved.robot is not None
    model = moved.robot.own_model()
    weak = replace(
        moved.robot,
        model=replace(
            model,
            legs=tuple(
                replace(
                    leg,
                    joints=tuple(replace(joint, torque_nm=2.0) for joint in leg.joints),
                )
                for leg in model.legs
            ),
        ),
    )
    for torques in (None, np.zeros_like(moved.table.arrays()["torques_nm"])):
        report = check_motion(moved.table.with_columns(torques_nm=torques), weak, moved.terrain)
        assert report.group("torque").value > 3.0
        assert not report.accepted


def test_numbers_that_no_motion_has_and_a_turn_that_is_none_are_refused(moved: Moved) -> None:
    far = np.array(moved.table.arrays()["origin_m"])
    far[3, 1] = 1e308
    with refuses("origin_m", "row 3"):
        moved.table.with_columns(origin_m=far)
    flat = np.zeros_like(moved.table.arrays()["quaternion"])
    with refuses("quaternion", "row 0"):
        judged(moved.table.with_columns(quaternion=flat), moved)
