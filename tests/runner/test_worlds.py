"""Both worlds under one contract: weight, friction, limits, repetition, and silence on standard
output.
"""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import hexapod
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M, Servo
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.robot.walker import contact_robot
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.runner.control.tracker import command
from stancekit.runner.worlds.world import WORLDS, Ground, JointBus, State, make_world
from tests.planners.robot.small_urdfs import biped
from tests.refusals import refuses

MODULES = {"bullet": ("pybullet", "catalogue"), "mujoco": ("mujoco", "robots")}
"""By world: its module, and the extra that has it."""
ROBOT = hexapod()
SHOULDERS = np.array([limb.shoulder_m for limb in ROBOT.limbs])
TOES = 1.8 * SHOULDERS + [0.0, 0.0, -0.2]


@pytest.fixture(params=list(MODULES), scope="module")
def world(request: pytest.FixtureRequest) -> Iterator[JointBus]:
    pytest.importorskip(MODULES[request.param][0])
    with make_world(request.param, ROBOT) as made:
        yield made


def ground(friction: float) -> Patch:
    corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
    return Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=friction)


def leaning(patch: Patch, turn: Rotation) -> Patch:
    vertices, normal, shear = (
        part @ turn.as_matrix().T
        for part in (patch.vertices_m, patch.normal, patch.shear_reference)
    )
    return Patch(vertices_m=vertices, normal=normal, shear_reference=shear, friction=patch.friction)


def standing() -> tuple[Array, Array]:
    """Angles, and targets that press with a sixth of the weight at every foot."""
    from stancekit.planners.robot.kinematics import Kinematics

    up, kinematics = np.tile([0.0, 0.0, 1.0], (6, 1)), Kinematics(ROBOT)
    angles, _, _ = kinematics.solve(np.zeros(3), np.zeros(3), TOES, normals=up)
    return angles, angles + (
        kinematics.torques(angles, np.eye(3), up * 98.1 / 6.0) / Servo().stiffness_nm_rad
    )


def stood(world: JointBus, friction: float, turn: Rotation, periods: int) -> tuple[State, State]:
    """The state at once and after some periods of standing on a plane that was turned together with
    the robot.
    """
    angles, targets = standing()
    first = world.connect(
        [leaning(ground(friction), turn)], angles, turn.apply([0.0, 0.0, 0.2]), turn.as_matrix()
    )
    last = first
    for _ in range(periods):
        last = world.step(targets)
    return first, last


def test_a_robot_that_stands_feels_its_weight_in_its_feet_and_nowhere_else(world: JointBus) -> None:
    first, last = stood(world, 0.7, Rotation.identity(), 100)
    np.testing.assert_allclose(last.forces_n.sum(axis=0), [0.0, 0.0, 98.1], atol=0.3)
    np.testing.assert_allclose(last.forces_n[:, 2], 98.1 / 6.0, atol=0.6)
    assert last.bump_n == 0.0
    np.testing.assert_allclose(last.position_m, [0.0, 0.0, 0.2], atol=5e-4)
    np.testing.assert_allclose(
        first.feet_m, TOES + np.array([0.0, 0.0, 0.2 + FOOT_RADIUS_M]), atol=1e-5
    )
    assert last.time_s == pytest.approx(0.5)


def test_a_robot_stands_far_from_the_origin_as_near_to_it(world: JointBus) -> None:
    angles, targets = standing()
    for at in (np.zeros(3), np.array([5e5, -2e5, 300.0])):
        level = ground(0.7)
        level = replace(level, vertices_m=level.vertices_m + at)
        world.connect([level], angles, at + np.array([0.0, 0.0, 0.2]), np.eye(3))
        state = [world.step(targets) for _ in range(40)][-1]
        np.testing.assert_allclose(state.position_m - at, [0.0, 0.0, 0.2], atol=5e-4)
        np.testing.assert_allclose(state.forces_n.sum(axis=0), [0.0, 0.0, 98.1], atol=0.5)


def hollow(friction: float) -> Ground:
    """Heights that are neither square nor about the origin, with walls beside a floor at −.1 m."""
    x, y = np.linspace(-1.0, 1.6, 53), np.linspace(-0.7, 0.9, 33)
    walls = 0.4 * np.clip(np.abs(y)[None, :] - 0.55, 0.0, 1.0) * np.ones((len(x), 1))
    lumps = np.where(x > 1.0, 0.3 * (x - 1.0), 0.0)[:, None] * np.ones(len(y))
    return Ground(
        heights=HeightField(x_m=x, y_m=y, heights_m=walls + lumps - 0.1), friction=friction
    )


def test_heights_carry_a_robot_where_they_are(world: JointBus) -> None:
    angles, targets = standing()
    floor = hollow(0.7)
    np.testing.assert_allclose(
        floor.distance(np.array([[0.3, 0.1, 0.2], [0.0, 0.0, -0.15]])), [0.3, -0.05], atol=1e-3
    )
    first = world.connect(floor, angles, np.array([0.3, 0.1, 0.1]), np.eye(3))
    for _ in range(100):
        last = world.step(targets)
    np.testing.assert_allclose(last.forces_n.sum(axis=0), [0.0, 0.0, 98.1], atol=0.5)
    np.testing.assert_allclose(last.position_m, [0.3, 0.1, 0.1], atol=1e-3)
    np.testing.assert_allclose(last.feet_m, first.feet_m, atol=2e-3)
    np.testing.assert_allclose(last.feet_m[:, 2], FOOT_RADIUS_M - 0.1, atol=1e-3)
    assert last.bump_n == 0.0


@pytest.mark.parametrize("friction", [0.0, 0.7])
def test_feet_of_mujoco_feel_what_their_contacts_with_the_terrain_press_and_all_else_is_a_bump(
    friction: float,
) -> None:
    import mujoco

    angles, targets = standing()
    tipped = Rotation.from_rotvec([0.3, 0.2, 0.0]).as_matrix()
    several = bumps = 0
    with make_world("mujoco", ROBOT, rate_hz=1000.0) as world:  # one step of physics a period
        world.connect(hollow(friction), angles, np.array([0.3, 0.2, 0.1]), tipped)
        for _ in range(600):
            state = world.step(targets)
            model, data = world._model, world._data  # type: ignore[attr-defined]
            feet = [model.body(leg.foot).id for leg in world.model.legs]  # type: ignore[attr-defined]
            felt, bump, force, met = np.zeros((6, 3)), 0.0, np.zeros(6), [0] * 6
            for index, contact in enumerate(data.contact):
                mujoco.mj_contactForce(model, data, index, force)
                first, second = (int(model.geom_bodyid[geom]) for geom in contact.geom)
                if 0 in (first, second) and (foot := first + second) in feet:
                    pressed = force[:3] @ contact.frame.reshape(3, 3)
                    felt[feet.index(foot)] += pressed if first == 0 else -pressed
                    met[feet.index(foot)] += 1
                else:
                    bump += float(np.linalg.norm(force[:3]))
            several, bumps = several + (max(met) > 1), bumps + (bump > 0.0)
            np.testing.assert_allclose(state.forces_n, felt, atol=1e-9)
            assert state.bump_n == pytest.approx(bump, abs=1e-9)
    assert several > 20
    assert bumps > 5


@pytest.mark.parametrize(("friction", "holds"), [(0.44, True), (0.30, False)])
def test_the_friction_of_heights_is_theirs(world: JointBus, friction: float, holds: bool) -> None:
    lines, rise = np.linspace(-1.0, 1.0, 41), float(np.tan(np.deg2rad(20.0)))
    slope = HeightField(x_m=lines, y_m=lines, heights_m=rise * lines[:, None] * np.ones(len(lines)))
    turn = Rotation.from_rotvec([0.0, -np.deg2rad(20.0), 0.0])
    angles, targets = standing()
    first = world.connect(
        Ground(heights=slope, friction=friction),
        angles,
        turn.apply([0.0, 0.0, 0.2]),
        turn.as_matrix(),
    )
    for _ in range(100):
        last = world.step(targets)
    slid = np.linalg.norm(last.feet_m - first.feet_m, axis=1)
    assert slid.max() < 2e-3 if holds else slid.min() > 5e-3


@pytest.mark.parametrize("azimuth_deg", [0.0, 45.0, 200.0])
def test_the_friction_is_the_patch_s_in_every_direction(
    world: JointBus, azimuth_deg: float
) -> None:
    # tan 20° = .364; a friction pyramid of μ = .30 would hold along its diagonal
    axis = Rotation.from_euler("z", azimuth_deg, degrees=True).apply([0.0, np.deg2rad(20.0), 0.0])
    turn = Rotation.from_rotvec(axis)
    first, held = stood(world, 0.44, turn, 100)
    assert np.linalg.norm(held.feet_m - first.feet_m, axis=1).max() < 2e-3
    first, slid = stood(world, 0.30, turn, 100)
    assert np.linalg.norm(slid.feet_m - first.feet_m, axis=1).min() > 0.02


def test_ice_holds_nothing(world: JointBus) -> None:
    turn = Rotation.from_rotvec([0.0, np.deg2rad(5.0), 0.0])
    first, slid = stood(world, 0.0, turn, 100)
    way = 0.5 * 9.81 * np.sin(np.deg2rad(5.0)) * 0.5**2  # a body on a frictionless plane
    assert np.linalg.norm(slid.position_m - first.position_m) == pytest.approx(way, rel=0.1)


def test_the_same_commands_give_the_same_states_to_the_last_bit(world: JointBus) -> None:
    angles, targets = standing()
    wave = (
        0.05 * np.sin(np.linspace(0.0, 6.0, 60))[:, None] * np.random.default_rng(0).normal(size=24)
    )
    runs = []
    for _ in range(2):
        world.connect([ground(0.7)], angles, np.array([0.0, 0.0, 0.2]), np.eye(3))
        runs.append([world.step(targets + part) for part in wave])
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one.angles_rad, other.angles_rad)
        np.testing.assert_array_equal(one.forces_n, other.forces_n)


def test_targets_are_sent_within_the_limits_of_joints_and_of_their_speed(world: JointBus) -> None:
    angles, _ = standing()
    world.connect([ground(0.7)], angles, np.array([0.0, 0.0, 0.2]), np.eye(3))
    state = world.step(angles + 1.0)
    np.testing.assert_allclose(
        state.sent_rad - angles, world.servo.velocity_rad_s / world.rate_hz, atol=1e-12
    )
    for _ in range(400):
        state = world.step(np.full(24, 99.0))
    np.testing.assert_allclose(state.sent_rad, np.tile(world.servo.upper_rad, 6))
    assert np.abs(state.torques_nm).max() <= world.servo.torque_nm + 1e-9


def test_it_says_what_it_can_do_and_closes_more_than_once(world: JointBus) -> None:
    assert world.joints == ROBOT.joint_names
    assert world.rate_hz == 200.0
    with make_world(world.name, ROBOT) as other:
        other.close()
    other.close()


def test_gravity_is_the_one_that_was_asked_for(world: JointBus) -> None:
    angles, _ = standing()
    with make_world(world.name, ROBOT, gravity_m_s2=1.62) as moon:
        moon.connect([], angles, np.array([0.0, 0.0, 5.0]), np.eye(3))
        for _ in range(40):
            state = moon.step(angles)
    assert state.velocity[2] == pytest.approx(-1.62 * 0.2, rel=0.02)


@pytest.mark.parametrize("name", list(MODULES))
def test_joints_that_turn_against_their_own_friction_are_where_they_are_sent(name: str) -> None:
    """Knees of a robot without weight, turned evenly: what its loops alone would lag behind by is
    (D q̇ + F) / Kp.
    """
    pytest.importorskip(MODULES[name][0])
    stiff = 'velocity="8"/><dynamics damping="4" friction="1"/>'
    robot = contact_robot(model_of(biped().replace('velocity="8"/>', stiff)))
    model = robot.own_model()
    angles = np.concatenate([leg.stance_rad for leg in model.legs])
    rates = np.where(np.char.find(model.joint_names, "knee") >= 0, 0.5, 0.0)
    with make_world(name, robot, gravity_m_s2=1e-6) as world:
        world.connect([], angles, np.array([0.0, 0.0, 5.0]), np.eye(3))
        lag = (4.0 * 0.5 + 1.0) / world.drives.stiffness_nm_rad.min()
        for k in range(100):
            wanted = angles + (k + 1) / world.rate_hz * rates
            state = world.step(command(world.drives, wanted, 0.0 * rates, rates, 0.0 * rates))
    assert lag > 0.01
    assert np.abs(state.angles_rad - wanted).max() < 0.2 * lag


def test_joints_that_drive_themselves_are_refused() -> None:
    wrong = biped().replace('velocity="8"/>', 'velocity="8"/><dynamics damping="-4"/>', 1)
    with refuses("left_hip_roll_j", "damping", "-4"):
        make_world("mujoco", contact_robot(model_of(wrong)))


def test_nothing_is_printed_on_standard_output() -> None:
    pytest.importorskip("pybullet")
    program = (
        "import numpy as np\n"
        "from stancekit.runner.worlds.world import make_world\n"
        "from stancekit.planners.robot import hexapod\n"
        "with make_world('bullet', hexapod()) as world:\n"
        "    world.connect([], np.zeros(24), np.zeros(3), np.eye(3))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout == ""


@pytest.mark.parametrize("name", list(MODULES))
def test_a_simulator_that_is_not_installed_is_named_with_its_extra(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, MODULES[name][0], None)
    with refuses(f"[{MODULES[name][1]}]"):
        make_world(name, ROBOT)


def test_an_unknown_world_is_refused_with_those_there_are() -> None:
    with refuses("world", *WORLDS.names()):
        make_world("gazebo", ROBOT)


def test_naming_a_world_imports_that_world_alone() -> None:
    program = (
        "import sys\n"
        "from stancekit.runner.worlds.world import WORLDS\n"
        "assert WORLDS.names()[:4] == ('bullet', 'mujoco', 'dynamixel', 'ros')\n"
        "assert WORLDS.get('mujoco').name == 'mujoco'\n"
        "others = ('bullet', 'dynamixel', 'ros')\n"
        "print([name for name in others if 'stancekit.runner.worlds.' + name in sys.modules])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"
