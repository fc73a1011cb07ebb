"""Ground that yields: how deep robots sink into it, against a closed form, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.terrain.patch import Patch
from stancekit.runner.acceptance import Accepted
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import SoftContact, WorldSettings, make_world
from stancekit.runner.worlds.settings import SimulationSetup
from stancekit.runner.worlds.world import Ground, State, Terrain, World
from tests.refusals import assert_names, refuses

from .test_simulated_robots import FLAT, model, robot, stance

MODULES = {"bullet": "pybullet", "mujoco": "mujoco"}
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


@pytest.fixture(params=list(MODULES))
def made(request: pytest.FixtureRequest) -> Callable[..., World]:
    pytest.importorskip(MODULES[request.param])
    return lambda **options: make_world(request.param, robot(OF), **options)


def stood(world: World, terrain: Terrain, periods: int = 400) -> list[State]:
    """The states of the robot that is put on a terrain and keeps its joints."""
    height = OF.stand_height_m - float(OF.body.com_m[2])
    lean = terrain[0].frame if not isinstance(terrain, Ground) else np.eye(3)[:, [2, 0, 1]]
    turn = lean[:, [1, 2, 0]]
    states = [world.reset(terrain, stance(OF), turn @ np.array([0.0, 0.0, height]), turn)]
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
    made: Callable[..., World], terrain: Terrain, stiffness_n_m: float
) -> None:
    with made(contact=SoftContact(stiffness_n_m=stiffness_n_m)) as world:
        state = stood(world, terrain)[-1]
    sinks = OF.body.mass_kg * GRAVITY / (len(OF.legs) * stiffness_n_m)
    if terrain is FLAT:  # a foot meets the cells beside it, too, the more the deeper it is
        assert depths(state).mean() == pytest.approx(sinks, rel=0.08)
    else:
        assert depths(state).mean() == pytest.approx(sinks, rel=0.02)
        np.testing.assert_allclose(depths(state), state.forces_n[:, 2] / stiffness_n_m, rtol=0.02)
    assert state.forces_n[:, 2].sum() == pytest.approx(OF.body.mass_kg * GRAVITY, rel=0.01)


def test_hard_ground_is_as_it_was(made: Callable[..., World]) -> None:
    with made() as world:
        state = stood(world, patch())[-1]
    assert depths(state).max() < 1e-3


def test_a_robot_on_little_damped_ground_swings_and_on_damped_ground_does_not(
    made: Callable[..., World],
) -> None:
    swings = []
    for damping in (0.0, None):
        with made(contact=SoftContact(stiffness_n_m=8e3, damping_ns_m=damping)) as world:
            states = stood(world, patch())
        deepest = max(float(depths(state).mean()) for state in states)
        swings.append(deepest / float(depths(states[-1]).mean()) - 1.0)
    assert swings[0] > 0.3
    assert swings[1] < 0.5 * swings[0]


def test_feet_do_not_creep_along_soft_ground(made: Callable[..., World]) -> None:
    crept = []
    for contact in (None, SoftContact(stiffness_n_m=2e4)):
        with made(contact=contact) as world:
            states = stood(world, patch(lean_rad=0.1), periods=600)
        crept.append(float(np.linalg.norm(states[-1].feet_m - states[-201].feet_m, axis=1).max()))
    assert max(crept) < 5e-3  # it stands
    assert crept[1] < crept[0] + 2e-4  # over a second


def test_ground_that_cannot_bear_the_robot_is_refused(made: Callable[..., World]) -> None:
    with refuses("contact_stiffness_n_m"):
        made(contact=SoftContact(stiffness_n_m=5e3))


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ((0.0, None), "contact_stiffness_n_m"),
        ((float("nan"), None), "contact_stiffness_n_m"),
        ((1e4, -1.0), "contact_damping_ns_m"),
        ((None, 5.0), "contact_damping_ns_m"),
    ],
)
def test_numbers_out_of_range_are_named(
    numbers: tuple[float | None, float | None], said: str
) -> None:
    with pytest.raises(InvalidInput) as error:
        SoftContact.of(*numbers)
    assert_names(str(error.value), said)


def test_no_numbers_are_hard_ground() -> None:
    assert SoftContact.of(None, None) is None


def test_a_set_up_file_says_how_the_ground_yields(
    tmp_path: Path, made: Callable[..., World]
) -> None:
    file = tmp_path / "soft.yaml"
    file.write_text("format: stancekit/simulation/1\ncontact_stiffness_n_m: 2.0e+4\n")
    with made(setup=file) as world:
        assert world.contact == SoftContact(stiffness_n_m=2e4)  # type: ignore[attr-defined]
    with refuses():
        made(setup=file, contact=SoftContact(stiffness_n_m=2e4))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "format: stancekit/ros/1\n",
            "format",
        ),
        (
            "format: stancekit/simulation/1\ncontact_stiffness_n_m: -1\n",
            "contact_stiffness_n_m",
        ),
        ("format: stancekit/simulation/1\nstiff: 1\n", "stiff"),
        (
            "format: stancekit/simulation/1\ncontact_damping_ns_m: 1\n",
            "contact_damping_ns_m",
        ),
    ],
)
def test_a_set_up_file_that_is_wrong_is_refused_in_one_line(
    tmp_path: Path, text: str, said: str
) -> None:
    file = tmp_path / "soft.yaml"
    file.write_text(text)
    with pytest.raises(InvalidInput) as error:
        SimulationSetup.from_yaml(file)
    assert str(error.value).startswith(f"{file}: ")
    assert_names(str(error.value), said)
    assert "\n" not in str(error.value)


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


def test_feet_that_feel_hold_a_robot_between_walls_that_yield_and_joints_alone_do_not() -> None:
    """In MuJoCo; ``benchmarks/soft_ground.py`` has both simulators and more courses."""
    plan = TwoStagePlanner().solve(read_course("walls", frames=2)).solution
    assert plan is not None
    accepted, soft = Accepted.verified(plan, "walls"), SoftContact(stiffness_n_m=2e4)
    stood = []
    for blind in (False, True):
        world = make_world("mujoco", plan.problem.robot, contact=soft)
        report = Runner(world, settings=RunSettings(blind=blind)).run(accepted)
        stood.append(report.succeeded)
        if not blind:
            assert report.execution is not None
            assert report.execution.body_worst_m < 0.01
    assert stood == [True, False]
