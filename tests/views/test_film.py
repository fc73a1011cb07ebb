"""Films of motions: every frame is there, things are where the scene has them, and files are whole
or absent.
"""

from __future__ import annotations

import importlib
import os
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stancekit import Motion, WalkQuestion
from stancekit.planners.robot.walker import hexapod_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.views import film
from stancekit.views.film import check_film, rendered, write_video
from stancekit.views.gaits import GaitView
from stancekit.views.robots import cone
from stancekit.views.scene import (
    Animation,
    Arrow,
    Box,
    Camera,
    Capsule,
    DrawnBody,
    Facet,
    Scene,
    Sphere,
    disc,
    hull,
    mesh_of,
    plate,
    triangles_of,
)
from tests.refusals import refuses

SMALL = (480, 300)


def glide(count=41) -> Motion:
    """The hexapod glides .4 m along x over level ground, its left feet standing; for the eye
    alone.
    """
    robot = hexapod_walker()
    torso = np.column_stack([np.linspace(-0.2, 0.2, count), np.zeros(count), np.full(count, 0.2)])
    contact = np.tile([foot.hip_m[1] > 0.0 for foot in robot.feet], (count, 1))
    return Motion(
        times_s=0.005 * np.arange(count),
        torso_m=torso,
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        feet_m=torso[:, None] + np.array([foot.nominal_m for foot in robot.feet]),
        forces_n=np.where(contact[..., None], [0.0, 0.0, 30.0], 0.0),
        contact=contact,
        problem=WalkQuestion(
            robot=robot,
            terrain=HeightField.from_function(
                lambda x, y: 0.0 * x, 1.0, 0.25, name="</script><b>level"
            ),
            friction=0.6,
            adhesive=np.zeros(6, dtype=bool),
            start=torso[0, :2],
            goal=torso[-1, :2],
        ),
    )


def frames_of(path):
    import imageio_ffmpeg as ffmpeg

    reader = ffmpeg.read_frames(str(path))
    meta = next(reader)
    width, height = meta["size"]
    return meta, [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]


# ------------------------------------------------------------------------------------------------------
# video


def test_every_frame_is_in_the_video_in_its_order(tmp_path):
    shades = [0, 60, 120, 180, 240]
    write_video(
        tmp_path / "a.mp4", (np.full((63, 81, 3), shade, np.uint8) for shade in shades), 10.0
    )
    meta, frames = frames_of(tmp_path / "a.mp4")
    assert (len(frames), meta["fps"]) == (5, 10.0)
    assert meta["size"] == (80, 62)
    assert np.allclose([frame.mean() for frame in frames], shades, atol=6)
    assert os.listdir(tmp_path) == ["a.mp4"]


def test_a_video_is_whole_or_absent(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"before")

    def breaking():
        yield np.zeros((20, 20, 3), np.uint8)
        raise RuntimeError("in the middle")

    with pytest.raises(RuntimeError):
        write_video(tmp_path / "a.mp4", breaking(), 10.0)
    assert (tmp_path / "a.mp4").read_bytes() == b"before"
    assert os.listdir(tmp_path) == ["a.mp4"]


@pytest.mark.parametrize(
    ("script", "said"),
    [
        (
            "cat > /dev/null; echo 'av_write_trailer(): No space left on device' >&2; exit 1",
            "No space left on device",
        ),
        ("echo 'No space left on device' >&2; exit 1", "No space left on device"),
        ("cat > /dev/null; echo first >&2; echo last >&2; exit 3", "ffmpeg failed: last"),
        ("kill -9 $$", "ffmpeg failed: without a word"),
        ("exec <&-; sleep .1; exit 0", "ffmpeg failed: without a word"),
    ],
)
def test_an_encoder_that_fails_leaves_the_older_film(tmp_path, monkeypatch, script, said):
    (tmp_path / "ffmpeg").write_text(f"#!/bin/sh\n{script}\n")
    (tmp_path / "ffmpeg").chmod(0o755)
    monkeypatch.setattr("imageio_ffmpeg.get_ffmpeg_exe", lambda: str(tmp_path / "ffmpeg"))
    (tmp_path / "a.mp4").write_bytes(b"before")
    with refuses(tmp_path / "a.mp4"):
        write_video(
            tmp_path / "a.mp4", (np.zeros((200, 200, 3), np.uint8) for _ in range(20)), 10.0
        )
    assert (tmp_path / "a.mp4").read_bytes() == b"before"
    assert sorted(os.listdir(tmp_path)) == ["a.mp4", "ffmpeg"]


@pytest.mark.parametrize("name", ["a.gif", "none/a.mp4"])
def test_a_name_that_no_film_can_have_is_refused(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with refuses(name):
        write_video(name, [], 10.0)


# ------------------------------------------------------------------------------------------------------
# shapes


SQUARE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.4, 0.0], [0.0, 0.4, 0.0]])


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (Sphere(0.4), 4.0 / 3.0 * np.pi * 0.4**3),
        (Box(np.array([0.1, 0.2, 0.3])), 0.048),
        (Capsule(0.5, (0.1, 0.1)), np.pi * 0.01 * (0.5 + 4.0 / 3.0 * 0.1)),
        (disc(np.array([0.6, 0.0, 0.8]), 0.5), 0.02 * np.pi * 0.5),
        (cone(0.5, np.eye(3), 0.6), np.pi * 0.3**2 * 0.6 / 3.0),
        (plate(SQUARE, np.array([0.1, 0.0, 0.3])), 0.12),
        (plate(SQUARE[::-1], np.array([0.1, 0.0, 0.3])), 0.12),
    ],
    ids=["sphere", "box", "capsule", "disc", "cone", "plate", "plate the other way round"],
)
def test_shapes_are_closed_look_outward_and_have_their_volume(shape, volume):
    """By the divergence theorem; what is round has corners, and so a few percent less."""
    points, faces = mesh_of(shape)
    corners = points[triangles_of(faces)]
    found = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    assert 0.92 * volume < found < 1.001 * volume
    assert (
        np.abs(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
        ).max()
        < 1e-9
    )


# -------------------------------------------------------------------------------------------------------
# film


def seen(*bodies, arrows=(), facets=()):
    """What a viewer 50 m before the x-z plane sees of ±1 m of it, 100 pixels wide, and where its
    window is.
    """
    corners = [
        DrawnBody(
            name=f"corner {x}", shape=Sphere(1e-4), position_m=np.array([x, 0.0, x]), colour="white"
        )
        for x in (-1, 1)
    ]
    motion = Animation(
        fixed=Scene(facets=facets),
        moments=[Scene(bodies=[*corners, *bodies], arrows=arrows)],
        step_s=1.0,
        title="",
        camera=Camera(
            target_m=np.zeros(3), azimuth_rad=-0.5 * np.pi, elevation_rad=0.0, distance_m=50.0
        ),
    )
    (pixels,) = rendered(motion, (100, 100))
    return pixels.astype(int), *motion.windows(1.0)[0]


def extent(colour, pixels, low, high):
    """Lowest and highest x and z of what is red or blue, as the picture has it [m]."""
    channel = {"red": 0, "blue": 2}[colour]
    rows, columns = np.nonzero(
        pixels[..., channel] > pixels[..., [1, 2 - channel]].max(axis=-1) + 60
    )
    size = (high - low) / 100.0
    return (
        low[0] + columns.min() * size[0],
        low[0] + (columns.max() + 1) * size[0],
        high[1] - (rows.max() + 1) * size[1],
        high[1] - rows.min() * size[1],
    )


PLATE = Box(np.array([0.2, 0.01, 0.3]))
BODIES = [
    (PLATE, 0.2, 0.3),
    (Sphere(0.25), 0.25, 0.25),
    (Capsule(0.4, (0.1, 0.1)), 0.1, 0.3),
    (hull(mesh_of(PLATE)[0]), 0.2, 0.3),
]


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize(
    ("shape", "across", "up"), BODIES, ids=["box", "sphere", "capsule", "mesh"]
)
def test_bodies_are_where_the_scene_has_them(shape, across, up):
    body = DrawnBody(name="a", shape=shape, position_m=np.array([0.3, 0.0, -0.2]), colour="red")
    found = extent("red", *seen(body))
    assert found == pytest.approx(
        (0.3 - across, 0.3 + across, -0.2 - up, -0.2 + up), abs=0.03
    )  # a pixel is 24 mm
    turned = replace(body, rotation=np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
    found = extent("red", *seen(turned))
    assert found == pytest.approx((0.3 - up, 0.3 + up, -0.2 - across, -0.2 + across), abs=0.03)


@pytest.mark.usefixtures("gl")
def test_terrain_may_be_one_triangle():
    corners = np.array([[-0.5, 0.0, -0.5], [0.5, 0.0, -0.5], [0.0, 0.0, 0.5]])
    found = seen(facets=[Facet(corners_m=corners, normal=-np.eye(3)[1], colour="red")])
    assert extent("red", *found) == pytest.approx((-0.5, 0.5) * 2, abs=0.03)


@pytest.mark.usefixtures("gl")
def test_an_arrow_runs_from_its_start_as_far_as_its_vector():
    arrow = Arrow(
        name="f",
        start_m=np.array([0.2, 0.0, 0.1]),
        vector_m=np.array([0.0, 0.0, 0.6]),
        radius_m=0.02,
        colour="red",
    )
    left, right, low, high = extent("red", *seen(arrows=[arrow]))
    assert (low, high) == pytest.approx((0.1, 0.7), abs=0.03)
    assert 0.5 * (left + right) == pytest.approx(0.2, abs=0.03)


@pytest.mark.usefixtures("gl")
def test_what_is_nearer_hides_what_is_farther_in_either_order():
    near, far = (
        DrawnBody(name=colour, shape=PLATE, position_m=np.array([0.0, y, 0.0]), colour=colour)
        for y, colour in ((-0.5, "red"), (0.5, "blue"))
    )
    first, again = seen(near, far)[0], seen(far, near)[0]
    assert np.array_equal(first, again)
    assert first[50, 50, 0] > 150 > first[50, 50, 2]


@pytest.mark.usefixtures("gl")
def test_terrain_is_solid_behind_the_robot_and_glass_before_it():
    square = np.array([(-0.4, 0.0, -0.4), (0.4, 0.0, -0.4), (0.4, 0.0, 0.4), (-0.4, 0.0, 0.4)])
    robot = DrawnBody(name="a", shape=Sphere(0.2), position_m=np.zeros(3), colour="red")
    for y, sign, blue in (
        (1.0, -1.0, True),
        (-1.0, 1.0, False),
    ):  # turned to the viewer behind, and away before
        wall = Facet(
            corners_m=square + np.array([0.0, y, 0.0]),
            normal=np.array([0.0, sign, 0.0]),
            colour="blue",
        )
        pixels = seen(robot, facets=[wall])[0]
        assert pixels[50, 50, 0] > 150 > pixels[50, 50, 2]
        assert (pixels[50, 64, 0] < 100) == blue


def test_a_window_holds_the_robot_at_all_times_and_has_the_shape_of_the_picture():
    motion = GaitView(glide()).film(step_s=0.05)
    low, high = motion.window(1.6)
    assert (high - low)[0] / (high - low)[1] == pytest.approx(1.6)
    for moment in motion.moments:
        xy = motion.camera.project(np.array([body.position_m for body in moment.bodies]))[0]
        assert np.all((xy > low) & (xy < high))
    for (near, far), moment in zip(motion.windows(1.6), motion.moments, strict=True):
        solid = np.array([body.position_m for body in moment.bodies if body.solid])
        xy = motion.camera.project(solid)[0]
        assert np.all((xy > near) & (xy < far))
        assert np.max(np.ptp(xy, axis=0) / (far - near)) > 1.0 / 3.0


def walked(trajectory, step_s):
    """The frames of a small film."""
    view = GaitView(trajectory)
    return list(view.frames(view.film(step_s=step_s), SMALL))


@pytest.mark.usefixtures("gl")
def test_a_film_has_a_frame_for_its_every_moment_and_the_robot_moves_in_it():
    trajectory = glide()
    frames = walked(trajectory, 0.1)
    assert len(frames) == 1 + round(0.2 * 10)
    assert {(frame.shape, frame.dtype.str) for frame in frames} == {((300, 480, 3), "|u1")}
    assert all(not np.array_equal(a[:234], b[:234]) for a, b in pairwise(frames))  # above the strip
    assert len(walked(trajectory, 0.05)) == 5


@pytest.mark.usefixtures("gl")
def test_the_cursor_runs_from_end_to_end_of_the_strip():
    frames = walked(glide(), 0.05)
    ends = []
    for frame in (frames[0], frames[-1]):
        row = frame[300 - round(0.29 * 66)].astype(int)
        ends.append(int(np.argmin(np.abs(row - [209, 35, 59]).sum(axis=1))))
    assert np.allclose(ends, [0.08 * 480, 0.92 * 480], atol=3)


@pytest.mark.usefixtures("gl")
def test_equal_motions_give_equal_frames():
    first, again = (walked(glide(9), 0.02) for _ in range(2))
    assert len(first) == 3
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


@pytest.mark.parametrize("broken", [ImportError, AttributeError, OSError, RuntimeError])
def test_without_a_gl_library_one_line_names_the_package(tmp_path, monkeypatch, broken):

    def missing(name):
        if name in ("mujoco", "imageio_ffmpeg"):
            return importlib.import_module(name)
        raise broken("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr(film, "import_module", missing)
    monkeypatch.setenv("MUJOCO_GL", "egl")
    for work in (lambda: check_film(tmp_path / "a.mp4"), lambda: walked(glide(), 0.04)):
        with refuses("video"):
            work()


def test_without_mujoco_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with refuses("video", "MuJoCo", "[viz]"):
        check_film(tmp_path / "a.mp4")
