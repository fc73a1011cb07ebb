"""Pictures of plans: what they show is where the plan has it, and a bad request is one line."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stancekit
from stancekit.planners.verify import check_plan
from stancekit.terrains import terrain
from stancekit.views.plans import PlanView, draw_plan, ghosts
from stancekit.views.sheet import save, to_rgb
from stancekit.views.terrain import ICE, cells, draw_footholds, foothold_motion


@pytest.fixture(scope="module")
def plan(course_plan):
    return course_plan("icy-walls", 3)


@pytest.fixture
def view(plan):
    return PlanView(plan)


def test_the_picture_has_ice_and_friction(plan):
    last = to_rgb(draw_plan(plan, size_px=(600, 500)))
    assert last.shape == (500, 600, 3)
    bluish = (last[..., 2].astype(int) - last[..., 0] > 15) & (last[..., 2] > 180)
    greenish = (last[..., 1].astype(int) - last[..., 2] > 40) & (last[..., 1] > 120)
    assert min(bluish.mean(), greenish.mean()) > 0.01, ICE


def test_without_ice_there_is_none(plan):
    rough = replace(
        plan.problem, terrain=tuple(replace(patch, friction=0.8) for patch in plan.problem.terrain)
    )
    shown = to_rgb(draw_plan(replace(plan, problem=rough), size_px=(600, 500)))
    bluish = (shown[..., 2].astype(int) - shown[..., 0] > 15) & (shown[..., 2] > 180)
    assert bluish.mean() < 0.01


def test_the_same_plan_gives_the_same_bytes(plan, tmp_path):
    for name in ("a.png", "b.png"):
        save(draw_plan(plan, caption="one", size_px=(400, 400)), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_strips_have_the_margins_of_the_verifier_and_the_shares_of_the_planned_forces():
    plan = stancekit.plan("icy-walls", frames=3).solution
    course, used, (push, cone, torque) = plan.problem, [0.0], PlanView(plan).strips
    group = stancekit.verify(plan, margins=True).group("margin").figures
    assert (push.values.min(), push.at[push.worst]) == (group["push_n"], group["push_frame"])
    for stance, forces in zip(course.stances, plan.forces_n, strict=True):
        for limb in stance.limbs:
            patch = course.patch(int(course.holds[stance.frame][limb]), plan.choice)
            across = np.linalg.norm(np.cross(forces[limb], patch.normal))
            used.append(100.0 * across / (patch.friction * (forces[limb] @ patch.normal)))
    assert cone.values.max() == pytest.approx(max(used), rel=1e-3)
    still = {text.get_text() for axes in stancekit.draw(plan).axes for text in axes.texts}
    page = "".join(PlanView(plan).film().strips)
    for strip in (push, cone, torque):
        assert (strip.words in still, f"<!-- {strip.words} -->" in page) == (True, True)
    unknown = PlanView(replace(plan, joints_rad=None)).strips[-1]
    assert (len(unknown.values), unknown.words) == (0, "not measured: joints are not known")


def test_ghosts_are_other_frames_and_few(plan):
    for shown in range(3):
        assert shown not in ghosts(plan, shown)
        assert 0 < len(ghosts(plan, shown)) <= 3


def test_cells_cover_their_patch_and_no_more(plan):
    box = np.array([[-9.0] * 3, [9.0] * 3])
    for patch in plan.problem.terrain[:5]:
        parts = [cell for _, cell in cells(patch, box)]
        assert sum(area(part) for part in parts) == pytest.approx(area(patch.vertices_m), rel=1e-9)
        assert all(np.abs((part - patch.centre_m) @ patch.normal).max() < 1e-9 for part in parts)


def test_cells_stay_in_the_bounds(view):
    low, high = view.bounds_m
    shown = [facet.corners_m for facet in view.fixed.facets]
    assert shown
    assert all((cell >= low - 1e-9).all() and (cell <= high + 1e-9).all() for cell in shown)


def test_the_viewer_sees_the_faces_of_both_walls(plan):
    camera = PlanView(plan).camera
    for patch in plan.problem.terrain:
        if patch.centre_m[2] < 0.3:
            assert camera.facing(patch.centre_m + 0.3 * patch.normal, patch.normal) > -0.3


def test_a_stance_holds_the_robot_at_every_moment_of_the_film(plan):
    course, view = plan.problem, PlanView(plan)
    times = view.shown_s(41)
    assert times[-1] > 3.0
    for time_s in times:
        now = view.motion.at(float(time_s))
        assert now.forces_n.sum(axis=0) == pytest.approx([0.0, 0.0, course.weight_n], abs=1e-6)
        assert np.abs(np.cross(now.toes_m - now.com_m, now.forces_n).sum(axis=0)).max() < 1e-5
        assert np.abs(now.forces_n[~now.stands]).max(initial=0.0) == 0.0


def test_key_frames_are_those_of_the_plan(plan, view):
    for k in range(3):
        key, there = view.key(k), view.between_keys(float(k))
        assert key.frame == there.frame == k
        assert np.allclose(key.toes_m, plan.toes_at(k), atol=1e-12)
        assert np.array_equal(key.com_m, plan.com_m[k])
        assert np.allclose(there.com_m, plan.com_m[k], atol=1e-12)
    first = view.motion.at(0.5)
    assert np.allclose(first.toes_m, plan.toes_at(0), atol=1e-12)  # only the load shifts
    assert check_plan(plan.posture(0)).accepted


def test_a_toe_on_its_track_is_off_both_its_patches(plan):
    path, course = PlanView(plan).keys.path, plan.problem
    swung = [p for p, put in enumerate(course.footholds) if put.frame]
    assert swung
    for p in swung:
        patch = course.patch(p, plan.choice)
        start, top, end = path.swing(p, np.array([0.0, 0.5, 1.0]))
        assert (top - patch.centre_m) @ patch.normal > 0.045
        assert end == pytest.approx(plan.toes_m[p])
        limb = course.robot.limb_names.index(course.footholds[p].limb)
        assert start == pytest.approx(plan.toes_at(course.footholds[p].frame - 1)[limb])


def test_the_robot_of_a_scene_is_where_the_plan_has_it(plan, view):
    for frame in range(3):
        scene = view.at(view.key(frame))
        bodies = {body.name: body for body in scene.bodies}
        trunk = bodies["trunk 0"]
        assert np.array_equal(trunk.position_m, plan.com_m[frame])
        assert trunk.rotation == pytest.approx(
            Rotation.from_rotvec(plan.rotation_rad[frame].copy()).as_matrix()
        )
        assert np.array_equal(
            [bodies[f"{limb} joint 3"].position_m for limb in view.shape.limbs], plan.toes_at(frame)
        )
        forces = dict(zip(view.shape.limbs, plan.forces_at(frame), strict=True))
        assert scene.arrows
        for arrow in scene.arrows:
            assert arrow.vector_m == pytest.approx(view.metres_a_newton * forces[arrow.name])
        filled = {name for name in bodies if name.startswith("chosen ")}
        assert filled == {f"chosen {p}" for p in plan.problem.holds[frame].tolist()}


def test_a_cone_holds_every_force_of_its_friction_and_no_other(view):
    for body in view.at(view.key(1)).bodies:
        if body.name.startswith("cone "):
            patch = view.chosen[int(body.name.split()[1])]
            rays = body.shape.vertices_m[1:]
            normal = rays @ patch.normal
            aside = np.linalg.norm(rays - np.outer(normal, patch.normal), axis=1)
            assert aside / normal == pytest.approx(patch.friction)
            assert np.array_equal(body.shape.vertices_m[0], np.zeros(3))


def test_a_film_stays_at_both_ends_and_passes_every_key_frame(plan, view):
    motion = view.film()
    count = len(motion.moments)
    assert count == round(20.0 * (2 * 1.2 + 1.0)) + 1
    assert len(motion.notes) == count
    trunks = np.array(
        [
            next(b.position_m for b in moment.bodies if b.name == "trunk 0")
            for moment in motion.moments
        ]
    )
    shown = [view.motion.at(float(time_s)) for time_s in view.shown_s(count)]
    assert np.array_equal(trunks, [now.origin_m for now in shown])
    coms = np.array([now.com_m for now in shown])
    assert np.allclose(coms[:10], plan.com_m[0], atol=1e-12)
    assert np.allclose(coms[-10:], plan.com_m[-1], atol=1e-12)
    assert np.abs(coms - plan.com_m[1]).max(axis=1).min() < 1e-3
    assert motion.notes[0] == "key frame 0 of 2   ·   grid 0.1 m"
    assert motion.notes[-1] == "key frame 2 of 2   ·   grid 0.1 m"


@pytest.mark.usefixtures("gl")
def test_frames_of_a_film_show_one_room(view):
    pictures = list(islice(view.frames(view.film(), (320, 300)), 0, 24, 23))
    assert [picture.shape for picture in pictures] == [(300, 320, 3)] * 2
    first, moving = pictures
    assert (moving[33:] != first[33:]).any()
    corner = (slice(33, -3), slice(0, 8))  # above the line that says how far it is
    assert np.array_equal(moving[corner], first[corner])
    bluish = (first[..., 2].astype(int) - first[..., 0] > 15) & (first[..., 2] > 150)
    greenish = (first[..., 1].astype(int) - first[..., 2] > 40) & (first[..., 1] > 120)
    assert min(bluish.mean(), greenish.mean()) > 0.01


def area(polygon):
    fan = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
    return 0.5 * np.linalg.norm(fan.sum(axis=0))


def test_footholds_are_drawn():
    found = terrain("slopes:0.3:4")
    assert len(foothold_motion(found).fixed.facets) > len(found.pieces)
    assert to_rgb(draw_footholds(found, size_px=(400, 300))).std() > 5.0


def test_one_frame_and_no_terrain_are_drawn_too(course_plan):
    plan = course_plan("walls", 1)
    bare = replace(plan, problem=replace(plan.problem, terrain=()))
    for shown in (plan, bare):
        assert to_rgb(draw_plan(shown, size_px=(400, 300))).std() > 10.0
        assert len(PlanView(shown).film().moments) == 21
        assert np.array_equal(PlanView(shown).motion.at(0.0).com_m, plan.com_m[0])
