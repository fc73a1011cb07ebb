"""Slopes and steps as questions to the library: planned, or refused for the friction that they
need.
"""

import numpy as np
import pytest

import stancekit
from tests.refusals import assert_names


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
    return stancekit.plan(terrain, start_xy_m=(0.0, 0.0), goal_xy_m=goal, robot=robot)


@pytest.mark.parametrize(
    ("robot", "degrees", "goal"),
    [
        (None, 20, (0.6, 0.0)),
        (None, 30, (-0.4, 0.0)),
        (None, 33, (0.6, 0.0)),
        ("a1", 30, (-0.4, 0.0)),
    ],
)
def test_slopes_are_planned_over_layouts_that_need_no_bending(robot, degrees, goal, tmp_path):
    answer = planned(slope(tmp_path, degrees), goal, 0.9, robot)
    assert answer.status.value == "feasible"
    assert answer.report.accepted
    assert answer.details["torque_steps"] == 0


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
        ([(-1.0, 0.0), (0.6, 0.0), (0.6, -0.3), (2.0, -0.3)], "step at (0.6,"),
        ([(-1.0, 0.0), (0.6, 0.0), (0.6, 0.25), (2.0, 0.25)], "wall at (0.6,"),
    ],
)
def test_what_is_in_the_way_is_named_at_its_place(profile, words, tmp_path):
    path = tmp_path / "ground.obj"
    lines = [f"v {x} {y} {z}" for x, z in profile for y in (-1.2, 1.2)]
    faces = [f"f {2 * k + 1} {2 * k + 3} {2 * k + 4} {2 * k + 2}" for k in range(len(profile) - 1)]
    path.write_text("\n".join([*lines, *faces, ""]))
    assert_names(planned(path, (1.3, 0.0)).message, words)
