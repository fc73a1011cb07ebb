"""The motion between key frames as a group of the verdict: what only it sees, and what is not
judged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.errors import TimeEnded
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_plan

pytest.importorskip("pinocchio")
pytest.importorskip("coal")
from stancekit.planners.motion.joints import STRAY_M, JointPath
from stancekit.planners.motion.path import APART_M, MOST, PlanPath
from stancekit.planners.projection.whole_body import with_joints
from stancekit.planners.robot.kinematics import Kinematics
from tests.refusals import assert_names


def test_moments_are_a_centimetre_apart_and_meet_every_key_frame(
    walk: Callable[..., Motion],
) -> None:
    plan = walk(4)
    path = PlanPath(plan)
    moments = path.moments()
    for apart in (np.diff(moments.feet_m, axis=0), np.diff(moments.com_m, axis=0)):
        assert np.linalg.norm(apart, axis=-1).max() <= APART_M + 1e-12
    stands = np.flatnonzero(np.all(moments.foothold >= 0, axis=1))
    assert moments.frame[stands].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert np.array_equal(moments.com_m[stands], plan.com_m)
    for t, k in zip(stands, range(4), strict=True):
        assert np.allclose(moments.feet_m[t] - path.radii_m[:, None] * [0, 0, 1], plan.toes_at(k))
    assert all(np.all(late >= early) for early, late in pairwise(moments.frame))


@pytest.mark.parametrize(("heavier", "settles"), [(4.0, True), (7.0, True), (14.0, False)])
def test_postures_on_the_way_have_their_centre_of_mass_where_the_plan_has_it_or_are_refused(
    walk: Callable[..., Motion], monkeypatch: pytest.MonkeyPatch, heavier: float, settles: bool
) -> None:
    """Of a robot with heavy legs: what they shift the body by shifts them."""
    plan = with_joints(walk(3))
    solver = Kinematics(plan.problem.robot)
    light = solver.com_offset
    monkeypatch.setattr(solver, "com_offset", lambda angles: heavier * light(angles))
    moments, at = JointPath(PlanPath(plan), solver).judged()
    shifts = np.array([solver.com_offset(angles) for angles in at.angles])
    com_m = at.origin_m + np.einsum("tij,tj->ti", at.rotation, shifts)
    held = np.asarray(at.error_m).max(axis=1) <= STRAY_M
    far_m = np.abs(com_m - moments.com_m)[held].max(initial=0.0)
    assert (held.all(), far_m < STRAY_M) == (settles, True)


def test_joints_along_a_path_are_looked_for_until_the_time_ends(
    walk: Callable[..., Motion],
) -> None:
    plan = with_joints(walk(3))
    with pytest.raises(TimeEnded):
        JointPath(PlanPath(plan), Kinematics(plan.problem.robot)).judged(deadline=0.0)
    late = check_plan(plan, joints=True, deadline=0.0)
    assert late.late
    assert "motion" in late.unchecked


def test_a_collision_between_key_frames_alone_is_found(walk: Callable[..., Motion]) -> None:
    """A bead where the shank of a limb is in the middle of its swing, which no link is in at any
    key frame.
    """
    plan = with_joints(walk(3))
    solver = Kinematics(plan.problem.robot)
    moments, postures = JointPath(PlanPath(plan), solver).judged()
    middle = int(np.argmin(np.abs(moments.frame - 1.5)))
    limb = int(np.flatnonzero(moments.foothold[middle] < 0)[0])
    knee, foot = solver.chains(postures.angles[middle])[limb, -2:]
    at = postures.origin_m[middle] + postures.rotation[middle] @ (0.4 * knee + 0.6 * foot)
    corners = at + 0.004 * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    bead = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.5)
    strung = replace(plan, problem=replace(plan.problem, terrain=(*plan.problem.terrain, bead)))
    report = check_plan(strung, joints=True)
    assert report.group("bodies").verdict == "holds"
    assert report.group("motion").verdict == "violated"
    assert not report.accepted
    assert report.contacts
    assert 1.0 < report.group("motion").figures["worst"]["frame"] < 2.0
    assert (
        report.group("motion")
        .figures["worst"]["link"]
        .startswith(plan.problem.robot.limb_names[limb])
    )
    assert check_plan(plan, joints=True).accepted
    unseen = [
        group if group.name != "motion" else replace(group, verdict="not checked")
        for group in report.groups
    ]
    assert report.digest != replace(report, groups=tuple(unseen)).digest


def test_what_is_not_judged_is_said_loudly(walk: Callable[..., Motion]) -> None:
    jumps = check_plan(with_joints(walk(2, "all")), joints=True)
    assert jumps.group("motion").verdict == "not asked for"
    assert jumps.group("bodies").verdict == "holds"
    assert_names(jumps.hindrance, "frames")
    assert "motion" not in jumps.checked
    assert (
        check_plan(walk(2), joints=True).group("motion").verdict == "not checked"
    )  # without angles
    plan = with_joints(walk(2))
    far = replace(plan, com_m=plan.com_m + 2 * MOST * APART_M * np.array([[0, 0, 0], [1, 0, 0]]))
    report = check_plan(far, joints=True)
    assert not report.accepted
    assert_names(report.group("motion").message, "path", "500 m")


def test_a_foot_that_cannot_follow_its_path_is_named(walk: Callable[..., Motion]) -> None:
    """A body so low that the legs do not fold as far as feet are lifted."""
    plan = walk(2)
    low = with_joints(replace(plan, com_m=plan.com_m - [0.0, 0.0, 0.15], toes_m=0.6 * plan.toes_m))
    report = check_plan(low, joints=True)
    assert report.group("motion").verdict == "violated"
    assert_names(report.group("motion").message, "path")
