"""Pictures of plans: what they show is where the plan has it, and a bad request is one line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.planners.verify import check_posture
from stancekit.views.plan_motion import LOAD, PlanMotion
from stancekit.views.plan_picture import PlanStage, check_picture, draw_plan, frame_count, ghosts, plan_frames
from stancekit.views.plan_terrain import ICE, bounds, cells, pieces
from stancekit.views.posture_picture import save, to_rgb


@pytest.fixture(scope="module")
def plan():
    found = TwoStageCoursePlanner().solve(read_course("icy-walls", 3)).plan
    assert found is not None
    return found


def test_the_picture_has_ice_and_friction_and_changes_with_the_frame(plan):
    last, first = to_rgb(draw_plan(plan, size_px=(600, 500))), to_rgb(draw_plan(plan, frame=0, size_px=(600, 500)))
    assert last.shape == (500, 600, 3)
    assert (last != first).any()
    bluish = (last[..., 2].astype(int) - last[..., 0] > 15) & (last[..., 2] > 180)
    greenish = (last[..., 1].astype(int) - last[..., 2] > 40) & (last[..., 1] > 120)
    assert min(bluish.mean(), greenish.mean()) > 0.01, ICE


def test_without_ice_there_is_none(plan):
    rough = replace(plan.course, terrain=tuple(replace(patch, friction=0.8) for patch in plan.course.terrain))
    shown = to_rgb(draw_plan(replace(plan, course=rough), size_px=(600, 500)))
    bluish = (shown[..., 2].astype(int) - shown[..., 0] > 15) & (shown[..., 2] > 180)
    assert bluish.mean() < 0.01


def test_the_same_plan_gives_the_same_bytes(plan, tmp_path):
    for name in ("a.png", "b.png"):
        save(draw_plan(plan, caption="one", note="two", size_px=(400, 400)), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize("frame", [-1, 3, 99])
def test_a_frame_that_there_is_not_is_refused(frame, plan):
    with pytest.raises(InvalidInput, match=f"frame: expected 0 to 2, got {frame}"):
        draw_plan(plan, frame=frame)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.jpg", "expected a name that ends in .png, .pdf, .svg, got .jpg"),
        ("a", "expected a name that ends in .png, .pdf, .svg, got no suffix"),
        ("none/a.png", "expected an existing folder none"),
    ],
)
def test_a_name_that_is_no_picture_is_refused(name, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInput) as refused:
        check_picture(name)
    assert str(refused.value) == f"{name}: {message}"


def test_ghosts_are_other_frames_and_few(plan):
    for shown in range(3):
        assert shown not in ghosts(plan, shown)
        assert 0 < len(ghosts(plan, shown)) <= 3


def test_cells_cover_their_patch_and_no_more(plan):
    box = np.array([[-9.0] * 3, [9.0] * 3])
    for patch in plan.course.terrain[:5]:
        parts = [cell for _, cell in cells(patch, box)]
        assert sum(area(part) for part in parts) == pytest.approx(area(patch.vertices_m), rel=1e-9)
        assert all(np.abs((part - patch.centre_m) @ patch.normal).max() < 1e-9 for part in parts)


def test_cells_stay_in_the_bounds(plan):
    low, high = bounds(plan)
    shown = [cell for _, grid in pieces(plan) for _, cell in grid]
    assert shown
    assert all((cell >= low - 1e-9).all() and (cell <= high + 1e-9).all() for cell in shown)


def test_the_viewer_sees_the_faces_of_both_walls(plan):
    painter = PlanStage(plan).painter()
    for patch in plan.course.terrain:
        if patch.centre_m[2] < 0.3:
            assert painter.facing(patch.centre_m + 0.3 * patch.normal, patch.normal) > -0.3


def test_a_stance_holds_the_robot_at_every_moment_of_the_motion(plan):
    course, motion = plan.course, PlanMotion(plan)
    assert motion.end == 2.0
    for time in np.linspace(0.0, 2.0, 41):
        moment = motion.at(float(time))
        assert moment.forces_n.sum(axis=0) == pytest.approx([0.0, 0.0, course.weight_n], abs=1e-6)
        torque = np.cross(moment.toes_m - moment.com_m, moment.forces_n).sum(axis=0)
        assert np.abs(torque).max() < 1e-5
        assert np.abs(moment.forces_n[list(moment.moving)]).max(initial=0.0) == 0.0


def test_key_frames_of_the_motion_are_those_of_the_plan(plan):
    motion = PlanMotion(plan)
    for k in range(3):
        moment = motion.at(float(k))
        assert (moment.frame, moment.moving) == (k, ())
        assert np.array_equal(moment.toes_m, plan.toes_at(k))
        assert np.array_equal(moment.com_m, plan.com_m[k])
    first = motion.at(0.5 * LOAD)
    assert np.array_equal(first.toes_m, plan.toes_at(0))  # only the load shifts
    problem = plan.course.posture_problem(plan.course.stances[0], plan.choice)
    assert check_posture(problem, plan.posture(0)).accepted


def test_a_toe_in_the_air_is_off_both_its_patches(plan):
    motion, course = PlanMotion(plan), plan.course
    swung = [p for p, put in enumerate(course.placements) if put.frame]
    assert swung
    for p in swung:
        top = motion.swing(p, 0.5)
        patch = course.patch(p, plan.choice)
        assert (top - patch.centre_m) @ patch.normal > 0.05
        assert motion.swing(p, 1.0) == pytest.approx(plan.toes_m[p])


def test_a_video_shows_one_room_and_ends_at_the_last_frame(plan):
    count = frame_count(plan)
    pictures = plan_frames(plan, size_px=(320, 300))
    first = next(pictures)
    assert first.shape == (300, 320, 3)
    assert np.array_equal(first, next(pictures))  # it stays a moment at the first key frame
    assert count == round(20.0 * (2 * 1.2 + 1.0)) + 1
    stage = PlanStage(plan)
    moving = stage.picture(0.6, (320, 300))
    assert (moving != first).any()
    corner = (slice(30, None), slice(0, 8))
    assert np.array_equal(moving[corner], first[corner])


def area(polygon):
    fan = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
    return 0.5 * np.linalg.norm(fan.sum(axis=0))


def test_one_frame_and_no_terrain_are_drawn_too():
    plan = TwoStageCoursePlanner().solve(read_course("walls", 1)).plan
    assert plan is not None
    bare = replace(plan, course=replace(plan.course, terrain=()))
    for shown in (plan, bare):
        assert to_rgb(draw_plan(shown, size_px=(400, 300))).std() > 10.0
        assert frame_count(shown) == 21
        assert np.array_equal(PlanMotion(shown).at(0.0).com_m, plan.com_m[0])
