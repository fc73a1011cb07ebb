"""Pictures and plots of gaits: what they show is where it should be, and nothing else is needed to
draw them.
"""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.text import Text

import stancekit
from stancekit import Motion, WalkQuestion
from stancekit.planners.motion.leap_motion import feet_of_leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.robot.walker import hexapod_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.planners.warp.conformal import fit_map
from stancekit.runner.motion.time_parametrization import joint_motion
from stancekit.views.gaits import GRID_M, GaitView, draw_motion
from stancekit.views.leaps import UNJUDGED, LeapView, draw_leap
from stancekit.views.maps import draw_map
from stancekit.views.page import page
from stancekit.views.plots import GaitRun, draw_directions, draw_times
from stancekit.views.scene import Box
from stancekit.views.sheet import ACCENT, leg_colour, save, to_rgb
from stancekit.views.still import Still, normals_of
from tests.refusals import refuses

SMALL = (600, 450)


def walk(terrain=None, count=81) -> Motion:
    """The hexapod glides ahead over two steps of each tripod; no dynamics, for the eye alone."""
    robot, share = hexapod_walker(), np.linspace(0.0, 1.0, count)
    field = terrain or HeightField.from_function(
        lambda x, y: 0.05 * np.sin(3.0 * x), 1.5, 0.1, name="swell"
    )
    torso = np.column_stack([0.6 * share - 0.3, 0.1 * share, 0.2 + 0.0 * share])
    feet = torso[:, None] + np.array([foot.nominal_m for foot in robot.feet])
    contact = (np.minimum(np.floor(4.0 * share), 3.0)[:, None] + np.arange(6)) % 2 == 0
    forces = np.where(contact[..., None], [0.0, 0.0, robot.mass_kg * 9.81 / 3.0], 0.0)
    return Motion(
        times_s=0.02 * np.arange(count),
        torso_m=torso,
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        feet_m=feet,
        forces_n=forces,
        contact=contact,
        problem=WalkQuestion(
            robot=robot,
            terrain=field,
            friction=0.6,
            adhesive=[True] + 5 * [False],
            start=torso[0, :2],
            goal=torso[-1, :2],
        ),
        provenance={"chart": "by hand"},
    )


def texts(figure) -> str:
    return "\n".join(
        text.get_text() for text in figure.findobj(match=lambda artist: hasattr(artist, "get_text"))
    )


def pixels_of(pixels, colour) -> int:
    """How many pixels have nearly this colour."""
    sought = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)])
    return int(np.sum(np.abs(pixels.astype(int) - sought).max(axis=2) < 40))


# ---------------------------------------------------------------------------------------------------
# the scene


@pytest.fixture
def view() -> GaitView:
    return GaitView(walk())


def test_the_robot_is_shown_at_both_ends_and_where_it_has_gone_on_between_them(view):
    assert view.shown[0] == 0
    assert view.shown[-1] == view.trajectory.samples - 1
    steps = np.linalg.norm(np.diff(view.trajectory.torso_m[view.shown], axis=0), axis=1)
    assert len(steps) > 1
    assert steps.max() < 1.2 * steps.min()
    assert GaitView(replace(walk(), torso_m=np.tile([0.0, 0.0, 0.2], (81, 1)))).shown == [0]


def test_touch_downs_are_the_samples_at_which_contact_begins(view):
    contact, names = view.trajectory.contact, view.trajectory.robot.limb_names
    assert len(view.footholds) == 12
    for sample, disc in view.footholds:
        foot = names.index(disc.name.split()[0])
        assert contact[sample, foot]
        assert sample == 0 or not contact[sample - 1, foot]
        assert np.array_equal(disc.position_m, view.trajectory.feet_m[sample, foot])
        assert disc.colour == leg_colour(foot)


def test_legs_join_hips_and_feet_by_bones_of_equal_length(view):
    for k, (hip, knee, toe) in enumerate(view.limbs_of(40)):
        foot = view.trajectory.robot.feet[k]
        assert np.allclose(hip, view.trajectory.torso_m[40] + foot.hip_m)
        assert np.array_equal(toe, view.trajectory.feet_m[40, k])
        assert np.linalg.norm(knee - hip) == pytest.approx(np.linalg.norm(toe - knee))
        assert knee[2] > toe[2]


def test_the_robot_of_a_scene_is_where_the_trajectory_has_it(view):
    scene = view.at(40)
    bodies = {body.name: body for body in scene.bodies}
    trunk = bodies["trunk 0"]
    assert isinstance(trunk.shape, Box)
    assert np.array_equal(trunk.shape.half_m, view.trajectory.robot.trunk_half_m)
    assert np.array_equal(trunk.position_m, view.trajectory.torso_m[40])
    assert np.array_equal(trunk.rotation, view.trajectory.rotation[40])
    for k, limb in enumerate(view.shape.limbs):
        assert np.array_equal(bodies[f"{limb} joint 2"].position_m, view.trajectory.feet_m[40, k])
        for link, (a, b) in enumerate(pairwise(view.limbs_of(40)[k])):
            body = bodies[f"{limb} link {link}"]
            half = 0.5 * body.shape.length_m * body.rotation[:, 2]
            assert np.allclose([body.position_m - half, body.position_m + half], [a, b])
    standing = np.flatnonzero(view.trajectory.contact[40])
    assert [arrow.name for arrow in scene.arrows] == [view.shape.limbs[k] for k in standing]
    for arrow, k in zip(scene.arrows, standing, strict=True):
        assert np.array_equal(arrow.start_m, view.trajectory.feet_m[40, k])
        assert np.allclose(arrow.vector_m, view.metres_a_newton * view.trajectory.forces_n[40, k])


def test_lines_of_the_map_lie_on_the_terrain_and_go_where_the_map_sends_them(view):
    plain = view.lines().reshape(-1, 3)
    assert len(plain)
    assert np.allclose(plain[:, 2], view.trajectory.problem.terrain.height(plain[:, :2]))
    on_line = np.abs(plain[:, :2] / GRID_M - np.round(plain[:, :2] / GRID_M)) < 1e-9
    assert np.all(on_line.any(axis=1))
    shifted = (
        GaitView(walk(), lambda points: points + np.array([0.1, 0.0, 0.0])).lines().reshape(-1, 3)
    )
    off = np.abs(
        (shifted[:, :2] - [0.1, 0.0]) / GRID_M - np.round((shifted[:, :2] - [0.1, 0.0]) / GRID_M)
    )
    assert np.all((off < 1e-9).any(axis=1))
    assert not np.all(np.abs(shifted[:, 0] / GRID_M - np.round(shifted[:, 0] / GRID_M)) < 1e-9)


def test_a_robot_behind_a_wall_is_looked_at_from_the_other_side():
    """A wall along y at x = .5: the viewer has to be where it does not hide a robot at x = 0."""
    wall = HeightField.from_function(
        lambda x, y: 1.2 / (1.0 + np.exp(-12.0 * (x - 0.7))), 1.5, 0.05
    )
    torso = np.column_stack([np.zeros(81), np.linspace(-0.4, 0.4, 81), np.full(81, 0.2)])
    gone = walk(wall)
    feet = torso[:, None] + np.array([foot.nominal_m for foot in gone.robot.feet])
    assert GaitView(replace(gone, torso_m=torso, feet_m=feet)).camera.axes[2][0] < 0.0


# --------------------------------------------------------------------------------------------------
# the motion


def test_forces_footholds_and_feet_have_their_colours():
    trajectory = walk()
    with_forces = to_rgb(draw_motion(trajectory, size_px=SMALL))
    without = to_rgb(
        draw_motion(replace(trajectory, forces_n=0.0 * trajectory.forces_n), size_px=SMALL)
    )
    assert with_forces.shape == (450, 600, 3)
    assert pixels_of(with_forces, ACCENT) > pixels_of(without, ACCENT) + 100
    assert all(pixels_of(with_forces, leg_colour(k)) > 10 for k in range(6))


def test_the_words_say_who_where_and_what_the_verifier_says():
    trajectory = walk()
    report = check_trajectory(trajectory)
    said = texts(draw_motion(trajectory, report, size_px=SMALL))
    assert "hexapod over swell, by hand" in said
    assert report.message in said
    assert "friction 0.6" in said
    assert "LF*" in said
    assert "* adhesive" in said
    assert "grid, 0.25 m" in said
    warped = draw_motion(trajectory, warp=lambda points: points, caption="ours", size_px=SMALL)
    assert "lines of the map, 0.25 m" in texts(warped)
    assert "not verified" in texts(warped)
    assert "ours" in texts(warped)


def test_equal_motions_give_equal_files(tmp_path):
    for name in ("a.png", "b.png"):
        save(draw_motion(walk(), size_px=SMALL), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_motion_off_the_grid_is_drawn_over_what_the_terrain_goes_on_as():
    far = walk()
    shift = np.array([9.0, 0.0, 0.0])
    moved = replace(far, torso_m=far.torso_m + shift, feet_m=far.feet_m + shift)
    assert to_rgb(draw_motion(moved, size_px=SMALL)).std() > 5.0


def test_what_is_no_motion_is_refused():
    hole = np.array(walk().torso_m)
    hole[3] = np.nan
    short = {
        n: getattr(walk(), n)[:1]
        for n in ("times_s", "torso_m", "rotation", "feet_m", "forces_n", "contact")
    }
    for spoilt in ({"torso_m": hole}, short):
        with refuses("trajectory"):
            draw_motion(replace(walk(), **spoilt))


def test_the_path_is_shown_between_the_trunks_and_not_through_them(view):
    path = view.fixed.paths[-1].pieces_m.mean(axis=1)
    inside = Still(view.scene(), view.camera).inside(path)
    local = np.abs(path[:, None] - view.trajectory.torso_m[view.shown])
    assert np.array_equal(
        inside, np.any(np.all(local < view.trajectory.robot.trunk_half_m, axis=2), axis=1)
    )
    assert 0 < inside.sum() < len(path)


def test_the_ground_is_the_terrain_and_its_block_looks_outward(view):
    top, *sides = view.ground
    assert np.allclose(
        top.points_m[..., 2], view.trajectory.problem.terrain.height(top.points_m[..., :2])
    )
    middle = top.points_m.reshape(-1, 3).mean(axis=0)
    for sheet in sides:
        corners = sheet.points_m.reshape(-1, 3)[sheet.faces]
        outward = np.sum(
            (corners.mean(axis=1) - middle) * [1.0, 1.0, 0.0] * normals_of(corners), axis=1
        )
        assert np.all(outward > 0.0)
    assert np.all(normals_of(top.points_m.reshape(-1, 3)[top.faces])[:, 2] > 0.0)


# ----------------------------------------------------------------------------------------------------
# the plots


def runs(directions=8):
    """Ours halves the violation at every iteration, the other fails in every fourth direction."""
    found = []
    for k in range(directions):
        turn = 2.0 * np.pi * k / directions
        found.append(
            GaitRun(
                method="ours", violations=0.5 ** np.arange(30), direction_rad=turn, seconds=1.0 + k
            )
        )
        slow = np.maximum(0.8 ** np.arange(80), 1e-2 if k % 4 == 0 else 0.0)
        found.append(GaitRun(method="other", violations=slow, direction_rad=turn, seconds=5.0))
    return found


def test_success_is_the_first_iterate_below_the_tolerance():
    run = GaitRun(method="m", violations=[1.0, 1e-3, 9e-5, 1e-2])
    assert (run.iterations, run.success) == (2, True)
    run = GaitRun(method="m", violations=[1.0, 1e-3, 1e-4])
    assert (run.iterations, run.success) == (2, False)
    assert (
        GaitRun(method="m", violations=[1e-5]).iterations,
        GaitRun(method="m", violations=[2.0]).iterations,
    ) == (0, 0)
    assert GaitRun(method="m", violations=[np.inf, 1e-5]).iterations == 1


@pytest.mark.parametrize("values", [[], [1.0, np.nan], [[1.0]]])
def test_violations_that_are_none_are_refused(values):
    with refuses("violations"):
        GaitRun(method="m", violations=values)


@pytest.mark.parametrize("draw", [draw_directions, draw_times])
def test_plots_count_what_succeeds_by_method(draw):
    said = texts(draw(runs(), size_px=SMALL, caption="a caption"))
    assert "ours: 8/8, 14 iterations" in said
    assert "other: 6/8, 42 iterations" in said
    assert "a caption" in said
    with refuses("runs"):
        draw([])


def test_failures_stand_out_in_every_plot():
    only = [run for run in runs() if run.method == "other"]
    good = [run for run in only if run.success]
    marks = [pixels_of(to_rgb(draw_directions(each)), ACCENT) for each in (only, good)]
    assert marks[0] > marks[1] + 20
    crosses = [line for line in draw_times(only).axes[0].lines if line.get_marker() == "x"]
    assert len(crosses[0].get_xdata()) == 2


def test_wedges_point_in_the_walking_direction_and_reach_as_far_as_iterations_go():
    axes = draw_directions(runs(4)[:2]).axes
    (ours,), (other,) = ([part.get_coordinates() for part in one.collections] for one in axes[:2])
    assert ours.shape[0] == 16  # edges of 15 iterates
    assert other[..., 1].max() > ours[..., 1].max()
    assert ours[..., 0].mean() == pytest.approx(0.0, abs=1e-12)


def test_a_colour_is_a_methods_own_whichever_others_are_there():
    def colours(shown):
        lines = draw_times(shown, methods=("third", "other", "ours")).axes[0].lines
        return {str(line.get_label()).partition(":")[0]: line.get_color() for line in lines}

    both = colours(runs())
    assert both["ours"] != both["other"]
    assert colours([run for run in runs() if run.method == "ours"])["ours"] == both["ours"]


def test_times_reach_as_far_as_what_is_drawn():
    # one slow success among three guesses in a direction is not drawn; as a failure it is, by its
    # cross
    def rim(last):
        solves = [GaitRun(method="m", violations=[1.0, 1e-5], seconds=1.0) for _ in range(2)]
        return (
            draw_times([*solves, GaitRun(method="m", violations=[1.0, last], seconds=90.0)])
            .axes[0]
            .get_ylim()[1]
        )

    assert rim(1e-5) == pytest.approx(1.02 * np.log1p(1.0 / 0.5))
    assert rim(1.0) == pytest.approx(1.02 * np.log1p(100.0 / 0.5))


def test_panels_have_titles_of_one_size():
    long = [
        *runs(),
        GaitRun(method="with a name that is much longer than others have", violations=[1.0, 1e-5]),
    ]
    sizes = {axes.title.get_fontsize() for axes in draw_directions(long).axes if axes.get_title()}
    assert len(sizes) == 1


def test_no_label_leaves_the_sheet():
    long = [
        GaitRun(method=f"warped, as published, L-BFGS {k}", violations=[1.0, 1e-5], seconds=3.0)
        for k in range(6)
    ]
    for draw in (draw_directions, draw_times):
        figure = draw(long)
        figure.canvas.draw()
        (left, below), (right, above) = figure.bbox.get_points()
        for text in figure.findobj(Text):
            if text.get_visible() and text.get_text() and "warped" in text.get_text():
                box = text.get_window_extent()
                assert left <= box.x0
                assert box.x1 <= right
                assert below <= box.y0
                assert box.y1 <= above


@pytest.mark.parametrize(
    ("told", "count"),
    [
        (json.dumps([[[0, 0, 0.5], [2, 1, 0.5]], [[0, 0, 0.5], [1, -1, 0.5], [2, 0, 0.5]]]), 2),
        ("", 0),
        ("[" * 100_000, 0),
        ('[[["a", 1, 2], [1, 2, 3]], [[1e999, 0, 0], [0, 0, 0]], [[0, 0, 0]]]', 0),
        ('{"a": 1}', 0),
    ],
)
def test_guide_paths_of_a_walk_are_shown_and_what_a_file_says_of_them_is_not_believed(told, count):
    trajectory = walk()
    view = GaitView(replace(trajectory, provenance={**trajectory.provenance, "guide_m": told}))
    assert len(view.ways_m) == count
    assert len(view.fixed.paths) == 2 + count
    assert any("guide path" in words for _, words in view.legend) == (count > 0)


def test_the_bar_of_violations_has_numbers_that_can_be_read():
    figure = draw_directions(runs(2))
    figure.canvas.draw()
    labels = [label.get_text() for label in figure.axes[-1].get_xticklabels()]
    assert "0.001" in labels
    assert not any("$" in label for label in labels)


@pytest.fixture(scope="module")
def leap():
    leap = leap_class("leap-given").draw(np.random.default_rng(0), "given")
    found = stancekit.plan(leap).solution
    assert found is not None
    return found


def test_a_film_shows_the_body_where_its_forces_move_it(leap):
    view = LeapView(leap)
    film, times = view.film(), view.film_times_s()
    assert len(film.moments) == len(times)
    motion = feet_of_leap(leap)
    for k in (0, len(times) // 3, len(times) // 2, len(times) - 1):
        now = motion.at(float(times[k]))
        trunk = next(body for body in film.moments[k].bodies if body.name == "trunk 0")
        np.testing.assert_array_equal(trunk.position_m, now.com_m)
        arrows = {arrow.name: arrow for arrow in film.moments[k].arrows}
        assert len(arrows) == int((np.linalg.norm(now.forces_n, axis=1) > 0.0).sum())


def test_a_film_of_legs_that_are_known_shows_the_joints_that_run():
    leap = stancekit.load("tests/data/leap-hop-anymal.json", Motion)
    view, runs = LeapView(leap), joint_motion(leap)
    film, times = view.film(fps=10.0), view.film_times_s(10.0)
    assert len(times) > 20
    for moment, time_s in zip(film.moments, times, strict=True):
        now = runs.at(float(time_s))
        expected = view.shape.links.bodies(
            now.origin_m + now.rotation @ view.robot.origin_m,
            now.rotation,
            view.shape.links.split(now.angles_rad),
        )
        places = {body.name: body.position_m for body in moment.bodies}
        assert len(expected) > 12
        for body in expected:
            np.testing.assert_allclose(places[body.name], body.position_m, atol=1e-9)


def test_in_the_air_there_are_no_forces(leap):
    view = LeapView(leap)
    ((begin, end),) = view.flights_s
    air = (leap.problem.holds[leap.problem.interval_phases] < 0).all(axis=1)
    assert begin == pytest.approx(leap.ends_s[int(np.argmax(air))], abs=0.006)
    middle = view.motion.at(0.5 * (begin + end))
    assert not middle.stands.any()
    assert view.at(middle).arrows == []


def test_pictures_and_pages_say_what_is_not_judged(leap):
    texts = [
        text.get_text() for text in draw_leap(leap).findobj(lambda it: hasattr(it, "get_text"))
    ]
    assert any(UNJUDGED in text for text in texts)
    film = LeapView(leap).film(fps=5.0)
    assert all(UNJUDGED in note for note in film.notes)
    assert "patch chosen for LF" in page(film)


def test_the_library_draws_a_leap_and_writes_its_page(leap, tmp_path):
    stancekit.draw(leap, out=tmp_path / "leap.png")
    assert (tmp_path / "leap.png").stat().st_size > 10_000
    stancekit.film(leap, tmp_path / "leap.html")
    assert "patch chosen for LF" in (tmp_path / "leap.html").read_text()
    with refuses(".txt"):
        stancekit.film(leap, "leap.txt")


def test_a_picture_of_an_execution_names_the_path_that_was_gone():
    leap = stancekit.load("tests/data/leap-hop-anymal.json", Motion)
    run = stancekit.simulate(leap).execution
    for executed, name in ((None, "centre of mass"), (run, "path that was gone")):
        texts = stancekit.draw(leap, executed=executed).findobj(lambda it: hasattr(it, "get_text"))
        named = {text.get_text() for text in texts}
        assert named & {"centre of mass", "path that was gone"} == {name}


FIELD = HeightField.from_function(
    lambda x, y: 0.1 * np.sin(3.0 * x) * np.cos(2.0 * y), 2.0, 0.1, name="egg box"
)


@pytest.fixture(scope="module")
def fits():
    return [fit_map(FIELD, cells=(8, 8, 3), method=method) for method in ("fast", "local-global")]


def test_a_map_is_drawn_with_its_figures(fits):
    figure = draw_map(fits[0].map, FIELD, fits[0].report, size_px=(600, 450))
    words = " ".join(text.get_text() for text in figure.texts)
    assert "Warp map of egg box" in words
    assert f"min det J {fits[0].report.least_det:.2f}" in words
    pixels = to_rgb(figure)
    assert pixels.shape == (450, 600, 3)
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 500
    np.testing.assert_array_equal(
        pixels, to_rgb(draw_map(fits[0].map, FIELD, fits[0].report, size_px=(600, 450)))
    )


def test_a_map_is_not_drawn_on_another_terrain(fits):
    with refuses("egg box"):
        draw_map(fits[0].map, FIELD.scaled(2.0), fits[0].report)
