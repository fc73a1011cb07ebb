"""The question of a walk is one value, whether it was written with names or as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit import Walk
from tests.refusals import assert_names, refuses


@pytest.fixture(scope="module")
def level() -> stancekit.HeightField:
    return stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)


def test_a_walk_that_is_handed_over_is_the_one_of_its_arguments(level):
    asked = Walk.over(level, (0.2, 0.0), duration_s=2.0)
    how = {"chart": "decoupled", "total_iterations": 40, "time_limit_s": 1e6}
    answer, same = (
        stancekit.walk(asked, **how),
        stancekit.walk(level, (0.2, 0.0), duration_s=2.0, **how),
    )
    assert answer.problem is asked
    assert isinstance(same.problem, Walk)
    for name in vars(asked).keys() - {"robot"}:
        assert np.array_equal(getattr(same.problem, name), getattr(asked, name)), name
    assert answer.solution.digest == same.solution.digest


def test_nothing_goes_beside_a_walk_that_it_says_itself(level):
    asked = Walk.over(level, (0.2, 0.0), duration_s=2.0)
    for name, value in (
        ("goal", (0.3, 0.0)),
        ("start", (0.1, 0.0)),
        ("robot", "hexapod"),
        ("gait", "trot"),
        ("duration_s", 3.0),
        ("friction", 0.5),
        ("adhesive", ["LF"]),
    ):
        with refuses(name):
            stancekit.walk(asked, **{name: value})
    with refuses("stancekit.walk", "goal", kind=TypeError):
        stancekit.walk(level)


def slope(folder, degrees):
    """The file of one tilted plane, 4 m wide."""
    k, path = np.tan(np.radians(degrees)), folder / f"slope{degrees}.obj"
    corners = [(x, y, k * x) for x, y in ((-2, -2), (2, -2), (2, 2), (-2, 2))]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    path.write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4", ""]))
    return path


def planned(terrain, goal, friction=None, robot=None):
    """The answer for the hexapod, where no other robot is named."""
    if friction is not None:
        terrain = stancekit.terrain(terrain, friction=friction, robot=robot)
    return stancekit.plan(terrain, start=(0.0, 0.0), goal=goal, robot=robot)


@pytest.mark.parametrize(
    ("robot", "degrees", "goal"),
    [
        (None, 20, (0.6, 0.0)),
        (None, 30, (-0.4, 0.0)),
        (None, 33, (0.6, 0.0)),
        ("a1", 30, (-0.4, 0.0)),
    ],
)
def test_slopes_are_planned_the_hexapods_over_layouts_that_need_no_bending(
    robot, degrees, goal, tmp_path
):
    answer = planned(slope(tmp_path, degrees), goal, 0.9, robot)
    assert answer.status.value == "feasible"
    assert answer.report.accepted
    assert answer.details["torque_steps"] <= (0 if robot is None else 5)


def test_stairs_whose_risers_the_legs_can_step_are_planned_from_a_tread():
    assert planned("stairs:0.3:7", (0.3, 0.0)).status.value == "feasible"


@pytest.mark.parametrize(("degrees", "friction"), [(12, 0.15), (25, 0.3)])
def test_a_slope_that_friction_forbids_names_friction_and_how_much_it_needs(
    degrees, friction, tmp_path
):
    answer = planned(slope(tmp_path, degrees), (0.6, 0.0), friction)
    assert answer.status.value == "undecided"  # a layout of the planner's own proves nothing
    assert_names(answer.message, "friction everywhere", f"{friction:g}")
    needed = float(answer.message.partition(" to ")[2].partition(" to ")[2].partition(";")[0])
    assert 0.99 * np.tan(np.radians(degrees)) < needed <= 1.001 * np.tan(np.radians(degrees))


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        ([(-1.0, 0.0), (0.4, 0.0), (0.8, 0.4767), (2.0, 0.4767)], "slope of 50 degrees at (0.4,"),
        ([(-1.0, 0.0), (0.4, 0.0), (0.4, -0.3), (1.6, -0.3)], "step at (0.4,"),
        ([(-1.0, 0.0), (0.4, 0.0), (0.4, 0.45), (1.6, 0.45)], "wall at (0.4,"),
    ],
)
def test_what_is_in_the_way_is_named_at_its_place(profile, words, tmp_path):
    path = tmp_path / "ground.obj"
    lines = [f"v {x} {y} {z}" for x, z in profile for y in (-1.2, 1.2)]
    faces = [f"f {2 * k + 1} {2 * k + 3} {2 * k + 4} {2 * k + 2}" for k in range(len(profile) - 1)]
    path.write_text("\n".join([*lines, *faces, ""]))
    assert_names(planned(path, (profile[-1][0] - 0.7, 0.0)).message, words)


ANT = Path(__file__).parents[2] / "configs/demo/ant.yaml"
TORQUE = stancekit.WholeBodyLimits(torque_nm=10.0)
STRAIGHT = stancekit.WholeBodyLimits(torque_nm=10.0, steps=0)


def test_postures_between_walls_are_bent_until_the_torque_is_enough() -> None:
    held = bent = 0
    for problem in stancekit.sample("wall-3", count=12, rng=2):
        straight, answer = (
            stancekit.plan(problem, robot="hexapod", settings=stancekit.PlanSettings(body=body))
            for body in (STRAIGHT, TORQUE)
        )
        assert (answer.certificate is None) == (straight.certificate is None)
        held += straight.status.value == "feasible"
        if answer.status.value != "feasible":
            continue
        bent += 1
        plan = answer.solution
        assert plan.problem.robot.limb_names == tuple(sorted(problem.legs))
        assert plan.joints_rad.shape == (1, 12)
        assert answer.report.group("torque").verdict == "holds"
        bodies = answer.report.group("bodies")
        assert bodies.verdict == "not checked"
        assert (answer.report.accepted, "bodies" in answer.report.unchecked) == (True, True)
        assert answer.details["torque_nm"] <= 10.0
        order = [plan.problem.robot.limb_names.index(name) for name in problem.legs]
        posture = stancekit.Motion.of_posture(
            problem,
            com_m=plan.com_m[0],
            rotation_rad=plan.rotation_rad[0],
            toes_m=plan.toes_m[order],
            forces_n=plan.forces_n[0, order],
        )
        assert stancekit.verify(posture).accepted
    assert bent >= held + 3


def test_a_posture_of_some_legs_of_a_file_is_bent_saved_and_read(tmp_path: Path) -> None:
    """Of six problems the first that has a posture."""
    looked = 0
    for problem in stancekit.sample("wall-3", robot=str(ANT), count=6, rng=0):
        answer = stancekit.plan(problem, robot=ANT)
        assert answer.problem.legs == tuple(
            name for name in stancekit.robot(ANT).limb_names if name in problem.legs
        )
        if answer.status.value != "feasible":
            continue
        stancekit.save(answer.solution, tmp_path / "plan.json")
        plan = stancekit.load(tmp_path / "plan.json")
        assert plan.problem.robot.absent == answer.solution.problem.robot.absent
        assert stancekit.verify(plan).unchecked
        np.testing.assert_array_equal(plan.joints_rad, answer.solution.joints_rad)
        assert stancekit.verify(plan).accepted
        looked += 1
        break
    assert looked


def test_a_file_of_a_posture_takes_the_robot_too(tmp_path: Path) -> None:
    problem = stancekit.sample("wall-3", rng=0)[0]
    stancekit.save(problem, tmp_path / "posture.json")
    answer = stancekit.plan(
        tmp_path / "posture.json", robot="hexapod", settings=stancekit.PlanSettings(body=TORQUE)
    )
    assert answer.status.value == "feasible"
    assert answer.solution.joints_rad is not None


def test_another_robot_and_one_without_these_limbs_are_refused() -> None:
    problem = stancekit.sample("wall-3", rng=0)[0]
    ant = stancekit.robot(ANT)
    with refuses("robot", ant.identity):
        stancekit.plan(problem, robot=ant)
    other = stancekit.sample("wall-3", robot=str(ANT), rng=0)[0]
    with refuses("robot", ant.identity):
        stancekit.plan(other, robot="hexapod")
    two = stancekit.Robot(name="two", mass_kg=10.0, limbs=stancekit.hexapod().limbs[:2])
    with refuses("leg", "RF"):
        stancekit.plan(problem, robot=two)
