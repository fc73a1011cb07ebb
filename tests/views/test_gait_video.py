"""Films and pages of motions: every frame is there, the robot is where it should be, and files are whole or absent."""

from __future__ import annotations

import base64
import json
import os
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.gait.trajectory import Trajectory
from stancekit.planners.robot.single_body import hexapod_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.views.gait_page import write_page
from stancekit.views.gait_video import motion_frames
from stancekit.views.painter import Painter
from stancekit.views.raster import Mesh, Raster, ball, box, disc, tube
from stancekit.views.video import write_video

SMALL = (480, 300)
DOWN = Painter(np.zeros(3), 0.0, np.deg2rad(89.999), 5.0)


def glide(count=41) -> Trajectory:
    """The hexapod glides .4 m along x over level ground, its left feet standing; for the eye alone."""
    robot = hexapod_walker()
    torso = np.column_stack([np.linspace(-0.2, 0.2, count), np.zeros(count), np.full(count, 0.2)])
    contact = np.tile([foot.hip_m[1] > 0.0 for foot in robot.feet], (count, 1))
    return Trajectory(
        times_s=0.005 * np.arange(count), torso_m=torso, rotation=np.tile(np.eye(3), (count, 1, 1)),
        feet_m=torso[:, None] + np.array([foot.nominal_m for foot in robot.feet]),
        forces_n=np.where(contact[..., None], [0.0, 0.0, 30.0], 0.0), contact=contact, robot=robot,
        terrain=HeightField.from_function(lambda x, y: 0.0 * x, 1.0, 0.25, name="</script><b>level"), friction=0.6,
        adhesive=np.zeros(6, dtype=bool), start_xy_m=torso[0, :2], goal_xy_m=torso[-1, :2],
    )  # fmt: skip


def frames_of(path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    reader = ffmpeg.read_frames(str(path))
    meta = next(reader)
    width, height = meta["size"]
    return meta, [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]


# ------------------------------------------------------------------------------------------------------ video


def test_every_frame_is_in_the_video_in_its_order(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    shades = [0, 60, 120, 180, 240]
    count = write_video(tmp_path / "a.mp4", (np.full((63, 81, 3), shade, np.uint8) for shade in shades), 10.0)
    meta, frames = frames_of(tmp_path / "a.mp4")
    assert (count, len(frames), meta["fps"]) == (5, 5, 10.0)
    assert meta["size"] == (80, 62)
    assert np.allclose([frame.mean() for frame in frames], shades, atol=6)
    assert os.listdir(tmp_path) == ["a.mp4"]


def test_a_video_is_whole_or_absent(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    (tmp_path / "a.mp4").write_bytes(b"before")

    def breaking():
        yield np.zeros((20, 20, 3), np.uint8)
        yield np.zeros((20, 22, 3), np.uint8)

    with pytest.raises(
        InvalidInput, match=r"^frames\[1\]: expected shape \(20, 20, 3\) as the first, got \(20, 22, 3\)$"
    ):
        write_video(tmp_path / "a.mp4", breaking())
    assert (tmp_path / "a.mp4").read_bytes() == b"before"
    assert os.listdir(tmp_path) == ["a.mp4"]


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ("cat > /dev/null; echo 'av_write_trailer(): No space left on device' >&2; exit 1", "No space left on device"),
        ("echo 'No space left on device' >&2; exit 1", "No space left on device"),
        ("cat > /dev/null; echo first >&2; echo last >&2; exit 3", "ffmpeg failed: last"),
        ("kill -9 $$", "ffmpeg failed: without a word"),
        ("exec <&-; sleep .1; exit 0", "ffmpeg failed: without a word"),
    ],
)
def test_an_encoder_that_fails_leaves_the_older_film(tmp_path, monkeypatch, script, said):
    pytest.importorskip("imageio_ffmpeg")
    (tmp_path / "ffmpeg").write_text(f"#!/bin/sh\n{script}\n")
    (tmp_path / "ffmpeg").chmod(0o755)
    monkeypatch.setattr("imageio_ffmpeg.get_ffmpeg_exe", lambda: str(tmp_path / "ffmpeg"))
    (tmp_path / "a.mp4").write_bytes(b"before")
    with pytest.raises(InvalidInput) as caught:
        write_video(tmp_path / "a.mp4", (np.zeros((200, 200, 3), np.uint8) for _ in range(20)))
    assert str(caught.value) == f"{tmp_path / 'a.mp4'}: cannot be written: {said}"
    assert (tmp_path / "a.mp4").read_bytes() == b"before"
    assert sorted(os.listdir(tmp_path)) == ["a.mp4", "ffmpeg"]


@pytest.mark.parametrize(
    ("name", "frames", "fps", "message"),
    [
        ("a.gif", [], 25.0, "a.gif: expected a name that ends in .mp4, got .gif"),
        ("none/a.mp4", [], 25.0, "none/a.mp4: expected an existing folder none"),
        ("a.mp4", [], 25.0, "a.mp4: expected one or more frames, got none"),
        ("a.mp4", [np.zeros((9, 9, 3))], 25.0, "frames[0]: expected uint8 of shape (H, W, 3), got float64 (9, 9, 3)"),
        ("a.mp4", [np.zeros((9, 9), np.uint8)], 25.0, "frames[0]: expected uint8 of shape (H, W, 3), got uint8 (9, 9)"),
        ("a.mp4", [np.zeros((9, 9, 3), np.uint8)], 0.0, "fps: expected a number above 0, up to 1000, got 0"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, monkeypatch, name, frames, fps, message):
    pytest.importorskip("imageio_ffmpeg")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInput) as caught:
        write_video(name, frames, fps)
    assert str(caught.value) == message
    assert os.listdir(tmp_path) == []


def test_without_ffmpeg_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(InvalidInput, match=r"pip install 'stancekit\[viz\]'$"):
        write_video(tmp_path / "a.mp4", [np.zeros((20, 20, 3), np.uint8)])


# ----------------------------------------------------------------------------------------------------- raster


def drawn(*meshes, raised=0.0):
    """What a viewer 5 m above sees of ±1 m, 100 pixels wide."""
    raster = Raster(DOWN, np.array([-1.0, -1.0]), np.array([1.0, 1.0]), (100, 100))
    for mesh in meshes:
        raster.draw(mesh, raised_m=raised)
    return raster.pixels()


def covered(pixels):
    return float(np.mean(pixels.min(axis=2) < 250))


def test_a_disc_covers_the_area_of_its_octagon():
    flat = disc(np.zeros(3), np.eye(3), 0.8, "#000000")
    assert covered(drawn(flat)) == pytest.approx(2.0 * np.sqrt(2.0) * 0.8**2 / 4.0, rel=0.03)


def test_what_is_nearer_hides_what_is_farther_in_either_order():
    high = disc(np.array([0.0, 0.0, 0.5]), np.eye(3), 0.4, "#ff0000")
    low = disc(np.zeros(3), np.eye(3), 0.8, "#0000ff")
    assert np.array_equal(drawn(high, low), drawn(low, high))
    middle = drawn(low, high)[50, 50]
    assert middle[0] > 150 > middle[2]


def test_nearer_things_are_larger_as_in_the_painters_perspective():
    for height in (-1.0, 0.0, 1.0):
        plate = box(np.array([0.0, 0.0, height]), np.eye(3), np.array([0.3, 0.3, 1e-3]), "#000000")
        side = np.sqrt(4.0 * (1.0 - drawn(plate).mean() / 255.0))
        assert side == pytest.approx(0.6 * 5.0 / (5.0 - height), abs=0.011)  # a fine pixel is 10 mm


def test_what_leaves_the_picture_is_cut_and_what_lies_behind_the_viewer_breaks_nothing():
    huge = disc(np.zeros(3), np.eye(3), 50.0, "#000000")
    assert covered(drawn(huge)) == 1.0
    assert covered(drawn(disc(np.array([30.0, 0.0, 0.0]), np.eye(3), 0.5, "#000000"))) == 0.0
    drawn(disc(np.array([0.0, 0.0, 7.0]), np.eye(3), 0.5, "#000000"))


@pytest.mark.parametrize(
    "mesh",
    [ball(np.array([0.1, 0.2, 0.3]), 0.4, "red"), box(np.zeros(3), np.eye(3), np.array([0.1, 0.2, 0.3]), "red"),
     tube(np.zeros(3), np.array([0.0, 0.3, 0.4]), (0.1, 0.05), "red")],
)  # fmt: skip
def test_normals_have_length_one_and_point_outward(mesh: Mesh):
    assert np.allclose(np.linalg.norm(mesh.normals, axis=-1), 1.0)
    middle = mesh.points.reshape(-1, 3).mean(axis=0)
    outward = np.sum((mesh.points - middle) * mesh.normals, axis=-1)
    assert outward.mean() > 0.0
    assert np.mean(outward > -1e-9) > 0.9


# ------------------------------------------------------------------------------------------------------- film


def test_a_film_has_a_frame_for_its_every_moment_and_the_robot_moves_in_it():
    trajectory = glide()
    frames = list(motion_frames(trajectory, fps=10.0, size_px=SMALL))
    assert len(frames) == 1 + round(0.2 * 10)
    assert {(frame.shape, frame.dtype.str) for frame in frames} == {((300, 480, 3), "|u1")}
    assert all(not np.array_equal(a, b) for a, b in pairwise(frames))
    assert len(list(motion_frames(trajectory, fps=10.0, speed=0.5, size_px=SMALL))) == 5


def test_the_cursor_runs_from_end_to_end_of_the_strip():
    frames = list(motion_frames(glide(), fps=20.0, size_px=SMALL))
    ends = []
    for frame in (frames[0], frames[-1]):
        row = frame[300 - round(0.29 * 66)].astype(int)
        ends.append(int(np.argmin(np.abs(row - [209, 35, 59]).sum(axis=1))))
    assert np.allclose(ends, [0.08 * 480, 0.92 * 480], atol=3)


def test_equal_motions_give_equal_frames():
    first, again = (list(motion_frames(glide(9), fps=50.0, size_px=SMALL)) for _ in range(2))
    assert len(first) == 3
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


@pytest.mark.parametrize("settings", [{"fps": 0.0}, {"speed": -1.0}, {"fps": float("nan")}])
def test_films_of_no_speed_are_refused(settings):
    with pytest.raises(InvalidInput, match=r"^fps, speed: expected numbers above 0, up to 1000, got "):
        next(motion_frames(glide(), **settings))


# ------------------------------------------------------------------------------------------------------- page


def data_of(path):
    text = path.read_text()
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', text, re.S)
    return text, json.loads(found[1])


def floats(text):
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


def test_a_page_holds_the_motion_and_asks_no_network(tmp_path):
    trajectory = glide()
    report = check_trajectory(trajectory)
    write_page(tmp_path / "a.html", trajectory, report)
    text, data = data_of(tmp_path / "a.html")
    assert not re.search(r"https?://|src=|@[A-Z]+@", text)
    assert np.allclose(floats(data["torso"]).reshape(-1, 3), trajectory.torso_m[::4], atol=1e-6)
    assert np.allclose(floats(data["times"]), trajectory.times_s[::4], atol=1e-6)
    legs = floats(data["legs"]).reshape(-1, 6, 3, 3)
    assert np.allclose(legs[:, :, 2], trajectory.feet_m[::4], atol=1e-6)
    assert np.allclose(floats(data["turn"]).reshape(-1, 3, 3), trajectory.rotation[::4])
    nodes = floats(data["nodes"]).reshape(-1, data["columns"], 3)
    assert np.allclose(nodes[..., 2], 0.0)
    assert data["names"] == [foot.name for foot in trajectory.robot.feet]


def test_names_in_a_page_are_words_and_no_program(tmp_path):
    write_page(tmp_path / "a.html", glide())
    text = (tmp_path / "a.html").read_text()
    assert "hexapod over &lt;/script&gt;&lt;b&gt;level" in text
    assert text.count("</script>") == 2
    assert "not verified" in text


@pytest.mark.parametrize("name", ["a.txt", "a", "none/a.html"])
def test_a_page_needs_a_name_of_its_own(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInput, match=r"expected (a name that ends in \.html|an existing folder)"):
        write_page(name, replace(glide()))
    assert os.listdir(tmp_path) == []
