"""Robots from files in both simulators: masses, feet, limits, meshes, what touches what, and what
is imperfect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import ActuatorModel, Actuators
from stancekit.planners.robot.model import Limb, Robot
from stancekit.planners.robot.robot_model import RobotModel, model_of
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.tracker import LoopStiffness
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.simulation import simulated_body
from stancekit.runner.worlds.world import (
    Ground,
    Imperfections,
    JointBus,
    SoftContact,
    State,
    Terrain,
    WorldSettings,
    make_world,
)
from tests.planners.robot.small_urdfs import fixed, link, quadruped
from tests.refusals import refuses

MODULES = {"bullet": "pybullet", "mujoco": "mujoco"}
STANCE = {"*_HAA": 0.0, "*_HFE": 0.6, "*_KFE": -1.2}
FLAT = Ground(heights=HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1), friction=0.7)
TETRAHEDRON = "v 0 0 0\nv .2 0 0\nv 0 .2 0\nv 0 0 .2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def model(text: str = "", **options: object) -> RobotModel:
    return model_of(text or quadruped(), posture_rad=STANCE, **options)  # type: ignore[arg-type]


def robot(of: RobotModel) -> Robot:
    limbs = tuple(
        Limb(name=leg.name, shoulder_m=leg.hip_m - of.com_m, reach_m=leg.chain.length_m)
        for leg in of.legs
    )
    return Robot(name=of.name, mass_kg=of.mass_kg, limbs=limbs, model=of)


def stance(of: RobotModel) -> Array:
    return np.concatenate([leg.stance_rad for leg in of.legs])


def feet(of: RobotModel, state: State) -> Array:
    """By the legs' chains, which no simulator had a part in."""
    angles = np.split(state.angles_rad, np.cumsum([len(leg.joints) for leg in of.legs])[:-1])
    local = np.array([leg.chain.feet(q[None])[0] for leg, q in zip(of.legs, angles, strict=True)])
    return np.asarray(state.position_m + local @ state.rotation.T)


@pytest.fixture(params=list(MODULES))
def made(request: pytest.FixtureRequest) -> Callable[..., JointBus]:
    pytest.importorskip(MODULES[request.param])
    return lambda of, **options: make_world(request.param, robot(of), **options)


def dropped(world: JointBus, of: RobotModel, periods: int = 600, above_m: float = 0.001) -> State:
    """A robot in its stance, just above the ground, after a while."""
    height = of.stand_height_m - float(of.com_m[2]) + above_m
    state = world.connect(FLAT, stance(of), np.array([0.0, 0.0, height]), np.eye(3))
    for _ in range(periods):
        state = world.step(stance(of))
    return state


def test_a_robot_of_a_file_stands_on_its_feet_with_its_weight(
    made: Callable[..., JointBus],
) -> None:
    of = model()
    with made(of) as world:
        assert world.joints == tuple(name for leg in of.legs for name in leg.joint_names)
        state = dropped(world, of)
    np.testing.assert_allclose(state.forces_n.sum(axis=0), [0.0, 0.0, of.mass_kg * 9.81], atol=1.0)
    assert (state.forces_n[:, 2] > 0.1 * of.mass_kg * 9.81).all()
    assert state.bump_n == 0.0
    np.testing.assert_allclose(state.feet_m, feet(of, state), atol=1e-4)
    np.testing.assert_allclose(state.feet_m[:, 2], [leg.radius_m for leg in of.legs], atol=2e-3)


def test_a_base_that_is_called_world_falls_as_any_other(made: Callable[..., JointBus]) -> None:
    of = model(quadruped().replace('"base"', '"world"'))
    with made(of) as world:
        state = dropped(world, of, periods=300, above_m=0.05)
    assert state.position_m[2] < of.stand_height_m - float(of.com_m[2]) + 0.01


def test_its_base_is_where_it_was_put_wherever_the_base_s_mass_is(
    made: Callable[..., JointBus],
) -> None:
    heavy = '<link name="base"><inertial><mass value="10.0"/>'
    of = model(quadruped().replace(heavy, f'{heavy}<origin xyz=".05 -.02 .03" rpy=".3 0 .1"/>'))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    with made(of) as world:
        state = world.connect(FLAT, stance(of), np.array([0.1, 0.2, 1.0]), turn)
        np.testing.assert_allclose(state.position_m, [0.1, 0.2, 1.0], atol=1e-9)
        np.testing.assert_allclose(state.rotation, turn, atol=1e-9)
        np.testing.assert_allclose(state.feet_m, feet(of, state), atol=1e-5)
        for _ in range(20):
            state = world.step(stance(of))
    assert state.velocity[2] == pytest.approx(-9.81 * 0.1, rel=0.02)
    assert state.position_m[2] == pytest.approx(1.0 - 0.5 * 9.81 * 0.1**2, abs=2e-3)


def test_a_robot_that_is_written_otherwise_is_the_same_in_every_world(
    made: Callable[..., JointBus],
) -> None:
    """Axes of any length, digits that are none, a link without mass, efforts that are replaced."""
    odd = quadruped(effort=5.0).replace('axis xyz="0 1 0"', 'axis xyz="3e-20 2 5e-20"')
    odd = odd.replace("</robot>", f"{link('cam', 0.0)}{fixed('mount', 'base', 'cam')}</robot>")
    kind = ActuatorModel(stall_nm=15.0, no_load_rad_s=10.0, curve="flat")
    strong, states = Actuators(joints={"*": "strong"}, actuators={"strong": kind}), list[State]()
    for text, actuators in ((quadruped(effort=15.0), None), (odd, strong)):
        of = model(text)
        with made(of, actuators=actuators) as world:
            dropped(world, of, periods=0, above_m=5.0)
            states += [world.step(stance(of) + 0.9) for _ in range(60)]
    one, other = states[59], states[119]
    np.testing.assert_allclose(other.angles_rad, one.angles_rad, atol=1e-6)
    np.testing.assert_allclose(other.position_m, one.position_m, atol=1e-6)
    torques = np.abs([state.torques_nm for state in states])
    np.testing.assert_allclose(torques[60:], torques[:60], atol=1e-4)
    assert 14.0 < torques.max() <= 15.0 + 1e-9


def with_mesh(folder: Path, name: str) -> RobotModel:
    """Its trunk is a mesh, a tetrahedron .2 m high."""
    text = quadruped().replace(
        '<box size="0.6 0.25 0.1"/>', f'<mesh filename="{name}" scale="2 2 2"/>'
    )
    return model(text, folder=folder)


def test_meshes_collide_as_their_hulls_and_a_missing_one_with_nothing(
    tmp_path: Path, made: Callable[..., JointBus]
) -> None:
    (tmp_path / "trunk.obj").write_text(TETRAHEDRON)
    body = simulated_body(with_mesh(tmp_path, "trunk.obj"))
    corners = [
        line.split()[1:]
        for line in body.hulls["hull_0.obj"].decode().splitlines()
        if line.startswith("v")
    ]
    np.testing.assert_allclose(
        np.sort(np.array(corners, dtype=float), axis=0).max(axis=0), [0.4, 0.4, 0.4]
    )
    lost = simulated_body(with_mesh(tmp_path, "lost.obj"))
    assert (lost.missing, dict(lost.hulls)) == (("lost.obj",), {})
    assert ElementTree.fromstring(lost.urdf).find("link[@name='base']/collision") is None
    for of, bumps in (
        (with_mesh(tmp_path, "trunk.obj"), True),
        (with_mesh(tmp_path, "lost.obj"), False),
    ):
        with made(of) as world:
            tucked = np.tile([0.0, 1.3, -2.3], 4)
            state = world.connect(FLAT, tucked, np.array([0.0, 0.0, 0.06]), np.eye(3))
            upside_down = np.diag([1.0, -1.0, -1.0])
            state = world.connect(FLAT, tucked, np.array([0.0, 0.0, 0.395]), upside_down)
            for _ in range(10):
                state = world.step(tucked)
        assert (state.bump_n > 0.0) == bumps


def test_links_stop_each_other_unless_they_may_touch(made: Callable[..., JointBus]) -> None:
    fat = quadruped().replace('<sphere radius="0.02"/>', '<sphere radius="0.1"/>')
    inwards = {"LF_HAA": -0.6, "RF_HAA": 0.6}
    pair = '<robot name="quadruped"><disable_collisions link1="LF_FOOT" link2="RF_FOOT" reason="drawn"/></robot>'
    found = []
    for of in (model(fat), model(fat, srdf=pair)):
        angles = stance(of)
        for leg, name in enumerate(of.leg_names):
            angles[3 * leg] += inwards.get(f"{name}_HAA", 0.0)
        with made(of) as world:
            world.connect(FLAT, stance(of), np.array([0.0, 0.0, 2.0]), np.eye(3))
            states = [world.step(angles) for _ in range(60)]
        found.append(max(state.bump_n for state in states))
    assert found[0] > 1.0
    assert found[1] == 0.0


def test_a_root_without_mass_and_inertias_that_files_rounded_off_are_made_ones_that_bodies_have() -> (
    None
):
    text = quadruped().replace(
        '<robot name="quadruped">', '<robot name="quadruped"><link name="root"/>'
    )
    text = text.replace(
        "</robot>",
        '<joint name="up" type="fixed"><parent link="root"/><child link="base"/></joint></robot>',
    )
    flat = (
        'ixx=".0102" ixy="0" ixz="0" iyy=".01" iyz="0" izz="0"'  # 2 % more than the others together
    )
    text = text.replace('ixx=".01" ixy="0" ixz="0" iyy=".01" iyz="0" izz=".01"', flat, 1)
    body = simulated_body(model(text))
    assert body.base == "root"
    for each in ElementTree.fromstring(body.urdf).findall("link"):
        inertia = each.find("inertial/inertia")
        assert inertia is not None
        xx, xy, xz, yy, yz, zz = (
            float(inertia.get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert a > 0.0
        assert a + b >= c * (1.0 - 1e-9)


def test_a_shape_that_no_simulator_knows_is_left_out(made: Callable[..., JointBus]) -> None:
    cone = '<collision><geometry><cone radius=".1" length=".3"/></geometry></collision></link>'
    of = model(quadruped().replace("</link>", cone, 1))
    assert "cone" in "".join(of.doubts)
    assert "cone" not in simulated_body(of).urdf
    dropped(made(of), of, periods=1)


def test_a_joint_without_a_torque_limit_is_refused(made: Callable[..., JointBus]) -> None:
    with refuses("joint LF_HAA"):
        made(model(quadruped(effort=0.0)))


def test_late_commands_and_joints_mounted_off_are_as_said(made: Callable[..., JointBus]) -> None:
    of = model()
    start = np.array([0.0, 0.0, 2.0])
    with made(of, imperfections=Imperfections(delay_s=0.02)) as late, made(of) as prompt:
        for world in (late, prompt):
            world.connect(FLAT, stance(of), start, np.eye(3))
        waited = [late.step(stance(of) + 0.02).angles_rad for _ in range(12)][4:]
        at_once = [prompt.step(stance(of) + 0.02).angles_rad for _ in range(8)]
    away = np.abs(np.array(waited) - np.array(at_once)).max()
    assert away < 2e-3  # it fell for four periods more
    off = Imperfections(offset_rad=0.02, seed=3)
    with made(of, imperfections=off) as world:
        state = world.connect(FLAT, stance(of), start, np.eye(3))
        wrong = np.linalg.norm(state.feet_m - feet(of, state), axis=1)
    np.testing.assert_allclose(state.angles_rad, stance(of), atol=1e-6)
    assert 1e-3 < wrong.max() < 0.02 * sum(0.6 for _ in range(3))


def test_feet_feel_late_what_they_touch(made: Callable[..., JointBus]) -> None:
    of = model()
    found = []
    for delay_s in (0.0, 0.02):
        with made(of, imperfections=Imperfections(felt_delay_s=delay_s)) as world:
            height = of.stand_height_m - float(of.com_m[2]) + 0.001
            states = [world.connect(FLAT, stance(of), np.array([0.0, 0.0, height]), np.eye(3))]
            states += [world.step(stance(of)) for _ in range(60)]
        found.append(np.array([state.forces_n for state in states]))
    at_once, late = found
    assert np.abs(at_once[:-4]).max() > 10.0
    np.testing.assert_array_equal(late[4:], at_once[:-4])
    np.testing.assert_array_equal(late[:4], 0.0)


def test_feet_read_their_forces_as_wrongly_as_said(made: Callable[..., JointBus]) -> None:
    of = model()
    wrong = (
        Imperfections(),
        Imperfections(felt_share=0.7, deaf=(1,)),
        Imperfections(felt_noise_n=5.0, seed=2),
    )
    found = []
    for imperfections in wrong:
        with made(of, imperfections=imperfections) as world:
            height = of.stand_height_m - float(of.com_m[2]) + 0.001
            states = [world.connect(FLAT, stance(of), np.array([0.0, 0.0, height]), np.eye(3))]
            states += [world.step(stance(of)) for _ in range(60)]
        found.append(np.array([state.forces_n for state in states]))
    true, less, noisy = found  # nothing here moves by what feet read
    kept = np.array([0.7, 0.0, 0.7, 0.7])[:, None]
    assert np.abs(true).max() > 10.0
    np.testing.assert_allclose(less, kept * true)
    assert (noisy - true).std() == pytest.approx(5.0, rel=0.1)
    with refuses("imperfections.deaf"):
        made(of, imperfections=Imperfections(deaf=(4,)))


def test_a_heavier_robot_and_softer_loops_are_as_said() -> None:
    of = model()
    heavier = simulated_body(of, mass_share=1.15)
    again = replace(of, urdf=heavier.urdf)
    masses = [
        float(m.get("value", "0"))
        for m in ElementTree.fromstring(again.urdf).findall("link/inertial/mass")
    ]
    assert sum(masses) == pytest.approx(1.15 * of.mass_kg)
    sunk, legs = [], Kinematics(robot(of))
    for share in (1.0, 0.7):
        with make_world(
            "mujoco", robot(of), imperfections=Imperfections(stiffness_share=share)
        ) as world:
            stands = dropped(world, of)
            sunk.append(of.stand_height_m - float(of.com_m[2]) - stands.position_m[2])
            loops = LoopStiffness(world.drives, 1.0, 100.0)
            torques = legs.torques(stands.angles_rad, stands.rotation, stands.forces_n)
            for _ in range(100):
                loops.see(stands, torques, np.ones(len(torques), dtype=np.bool_))
        assert loops.share == pytest.approx(share, abs=0.02)
    assert sunk[1] > 1.2 * sunk[0] > 0.0


GRAVITY = 9.81
SQUARE = np.array([[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]])
OF = model()


def patch(lean_rad: float = 0.0) -> tuple[Patch, ...]:
    """A square that leans along x."""
    cos, sin = np.cos(lean_rad), np.sin(lean_rad)
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    return (
        Patch(
            vertices_m=SQUARE @ turn.T, normal=turn[:, 2], shear_reference=turn[:, 0], friction=0.7
        ),
    )


def stood(world: JointBus, terrain: Terrain, periods: int = 400) -> list[State]:
    """The states of the robot that is put on a terrain and keeps its joints."""
    height = OF.stand_height_m - float(OF.com_m[2])
    lean = terrain[0].frame if not isinstance(terrain, Ground) else np.eye(3)[:, [2, 0, 1]]
    turn = lean[:, [1, 2, 0]]
    states = [world.connect(terrain, stance(OF), turn @ np.array([0.0, 0.0, height]), turn)]
    for _ in range(periods):
        states.append(world.step(stance(OF)))
    return states


def depths(state: State) -> np.ndarray:
    """How deep feet are in level ground, shape (N,) [m]."""
    return np.array([leg.radius_m for leg in OF.legs]) - state.feet_m[:, 2]


@pytest.mark.parametrize(
    ("terrain", "stiffness_n_m"),
    [(patch(), 8e3), (patch(), 5e4), (FLAT, 2e4)],
    ids=["soft patch", "stiff patch", "heights"],
)
def test_a_robot_at_rest_sinks_by_its_weight_over_the_stiffness_of_its_feet(
    made: Callable[..., JointBus], terrain: Terrain, stiffness_n_m: float
) -> None:
    with made(OF, contact=SoftContact(stiffness_n_m=stiffness_n_m)) as world:
        state = stood(world, terrain)[-1]
    sinks = OF.mass_kg * GRAVITY / (len(OF.legs) * stiffness_n_m)
    if terrain is FLAT:  # a foot meets the cells beside it, too, the more the deeper it is
        assert depths(state).mean() == pytest.approx(sinks, rel=0.08)
    else:
        assert depths(state).mean() == pytest.approx(sinks, rel=0.02)
        np.testing.assert_allclose(depths(state), state.forces_n[:, 2] / stiffness_n_m, rtol=0.02)
    assert state.forces_n[:, 2].sum() == pytest.approx(OF.mass_kg * GRAVITY, rel=0.01)


def test_a_robot_on_little_damped_ground_swings_and_on_damped_ground_does_not(
    made: Callable[..., JointBus],
) -> None:
    swings = []
    for damping in (0.0, None):
        with made(OF, contact=SoftContact(stiffness_n_m=8e3, damping_ns_m=damping)) as world:
            states = stood(world, patch())
        deepest = max(float(depths(state).mean()) for state in states)
        swings.append(deepest / float(depths(states[-1]).mean()) - 1.0)
    assert swings[0] > 0.3
    assert swings[1] < 0.5 * swings[0]


def test_feet_do_not_creep_along_soft_ground(made: Callable[..., JointBus]) -> None:
    crept = []
    for contact in (None, SoftContact(stiffness_n_m=2e4)):
        with made(OF, contact=contact) as world:
            states = stood(world, patch(lean_rad=0.1), periods=600)
        crept.append(float(np.linalg.norm(states[-1].feet_m - states[-201].feet_m, axis=1).max()))
    assert max(crept) < 5e-3  # it stands
    assert crept[1] < crept[0] + 2e-4  # over a second


def test_ground_that_cannot_bear_the_robot_is_refused(made: Callable[..., JointBus]) -> None:
    with refuses("contact_stiffness_n_m"):
        made(OF, contact=SoftContact(stiffness_n_m=5e3))


def test_a_set_up_file_is_of_no_use_to_a_simulation(
    tmp_path: Path, made: Callable[..., JointBus]
) -> None:
    with refuses("setup", "soft.yaml"):
        made(OF, setup=tmp_path / "soft.yaml")


def test_worlds_of_other_people_without_soft_ground_are_made_as_before() -> None:
    from stancekit.runner.worlds.mujoco import MujocoWorld

    class Plain(MujocoWorld):
        def __init__(self, robot, servo=None, *, rate_hz, gravity_m_s2, imperfections, actuators):  # type: ignore[no-untyped-def]
            super().__init__(
                robot,
                servo,
                rate_hz=rate_hz,
                gravity_m_s2=gravity_m_s2,
                imperfections=imperfections,
                actuators=actuators,
            )

    with Plain.make(WorldSettings(robot=robot(OF))) as world:
        assert world.contact is None


def test_feet_that_feel_hold_a_robot_between_walls_that_yield_and_joints_alone_do_not(
    accepted: Accepted,
) -> None:
    """In MuJoCo; ``benchmarks/soft_ground.py`` has both simulators and more courses."""
    soft, stood = SoftContact(stiffness_n_m=2e4), []
    for blind in (False, True):
        world = make_world("mujoco", accepted.plan.problem.robot, contact=soft)
        report = Runner(world, settings=RunSettings(blind=blind)).run(accepted)
        stood.append(report.succeeded)
        if not blind:
            assert report.execution.body_worst_m < 0.01
    assert stood == [True, False]
