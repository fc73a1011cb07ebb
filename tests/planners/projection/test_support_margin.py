"""Quadrupeds that do not balance on an edge: their feet press, and their bodies are inside of what
carries them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.held import pressing, steady
from stancekit.planners.projection.whole_body import WholeBodyLimits, whole_body
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify.margins import stance_margins
from tests.planners.robot.small_urdfs import quadruped

pytest.importorskip("pinocchio")

WAVE = """
name: flat
robot: dog.urdf
frames: 7
gait: wave
start_m: [0.0, 0.0]
goal_m: [0.2, 0.0, 0.45]
steps: {com_m: 0.15, toe_m: 0.4}
terrain: {kind: flat, friction: 0.7}
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Motion:
    folder = tmp_path_factory.mktemp("course")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.yaml").write_text(WAVE)
    outcome = plan_with_reserve(TwoStage(), read_course(folder / "flat.yaml"))
    assert outcome.solution is not None
    return outcome.solution


def shares(plan: Motion, stance: int) -> Array:
    """Of a weight, what three feet on level ground carry: the centre's barycentric coordinates,
    shape (3,).
    """
    of = plan.problem.stances[stance]
    corners = plan.toes_at(of.frame)[list(of.limbs), :2]
    rows = np.vstack([corners.T, np.ones(3)])
    return np.asarray(np.linalg.solve(rows, [*plan.com_m[of.frame, :2], 1.0]))


def test_a_plan_on_an_edge_is_planned_anew_with_its_centre_inside_of_what_carries_it(
    plan: Motion,
) -> None:
    threes = [index for index, stance in enumerate(plan.problem.stances) if len(stance.limbs) == 3]
    assert len(threes) >= 8
    assert plan.provenance["push_share"] == 0.05
    assert stance_margins(plan)["push_n"].min() >= 0.05 * plan.problem.weight_n
    assert all(shares(plan, stance).min() > 0.05 for stance in threes)
    loose = plan_with_reserve(TwoStage(), plan.problem, presses=()).solution
    assert loose is not None
    assert "push_share" not in loose.provenance
    assert min(shares(loose, stance).min() for stance in threes) < 0.01


def test_steady_is_what_barycentric_coordinates_say_of_three_feet(plan: Motion) -> None:
    threes = [index for index, stance in enumerate(plan.problem.stances) if len(stance.limbs) == 3]
    least = min(shares(plan, stance).min() for stance in threes)
    assert steady(plan, least - 1e-3)
    assert not steady(plan, least + 1e-3)


def test_a_plan_that_is_bent_for_its_torques_still_bears_its_push(plan: Motion) -> None:
    bent = whole_body(plan, WholeBodyLimits(torque_nm=17.5)).plan
    assert not np.array_equal(bent.com_m, plan.com_m)
    assert stance_margins(bent)["push_n"].min() >= 0.05 * bent.problem.weight_n - 1e-3


def test_pressing_changes_the_least_normal_force_alone(plan: Motion) -> None:
    course = pressing(plan.problem, 0.2)
    assert course.force_min.tolist() == [0.2, -1.0, -1.0]
    assert pressing(course, 0.1).force_min.tolist() == [0.2, -1.0, -1.0]
    assert replace(course, force_min=plan.problem.force_min).stances == plan.problem.stances
