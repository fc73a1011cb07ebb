"""Plans judged by bodies: a block in the way is found with link, depth and frame, in a file as in
Python.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.formats.motion_file import check_file, write_motion
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_plan

pytest.importorskip("pinocchio")
pytest.importorskip("coal")
from stancekit.planners.robot.robot_file import BODY_HEIGHT_M
from tests.refusals import assert_names


def plate(x: float, height: float, half: float = 0.01) -> Patch:
    """A small level plate over or under the middle of the path."""
    corners = np.array(
        [
            (x - half, -half, height),
            (x + half, -half, height),
            (x + half, half, height),
            (x - half, half, height),
        ]
    )
    return Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.5)


def with_patch(plan: Motion, patch: Patch) -> Motion:
    return replace(plan, problem=replace(plan.problem, terrain=(*plan.problem.terrain, patch)))


def test_a_block_in_the_goal_is_refused_with_link_depth_and_frame(walk) -> None:
    plan = walk(5)
    under = plan.com_m[-1, 2] - BODY_HEIGHT_M / 2
    radius = 0.75 * np.mean([np.hypot(*limb.shoulder_m[:2]) for limb in plan.problem.robot.limbs])
    ahead = (
        plan.com_m[-1, 0] + radius
    )  # under the front of the trunk as it stands in the end, and not before
    inside = with_patch(plan, plate(ahead - 0.015, under + 0.006))
    assert check_plan(inside).accepted  # contacts know nothing of bodies
    report = check_plan(inside, joints=True)
    assert not report.accepted
    assert report.contacts
    assert_names(report.group("bodies").message, "frame 4", "body", "6 mm", "patch 1")
    assert report.group("bodies").figures["depth_m"] == pytest.approx(0.006, abs=1e-6)
    assert report.group("bodies").figures["worst"] == {
        "frame": 4,
        "link": "body",
        "other": "patch 1",
    }
    below = check_plan(with_patch(plan, plate(ahead - 0.015, under + 0.0009)), joints=True)
    assert below.accepted
    assert below.group("bodies").figures["hit"] == 0


def test_a_file_has_the_verdict_of_its_plan(walk, tmp_path: Path) -> None:
    plan = with_patch(walk(3), plate(0.0, 0.2))
    report = check_plan(plan, joints=True)
    write_motion(tmp_path / "plan.json", plan, report)
    check = check_file(tmp_path / "plan.json")
    assert not check.accepted
    assert check.same
    assert check.report.digest == report.digest
    assert check.report.checked == ("contacts", "joints", "torque", "bodies")
    assert check.report.group("motion").verdict == "not checked"
    assert check.report.group("bodies").verdict == "violated"
    assert_names(check.message, "motion", "bodies", "frame 0")
