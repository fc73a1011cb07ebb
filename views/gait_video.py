"""The film of a motion: the robot over its terrain with contact forces, and below it which feet stand when."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.colors import to_rgb as rgb
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.gait.trajectory import Trajectory
from stancekit.planners.verify.trajectories import GaitReport

from . import plot as chart
from .gait_scene import BONE, EARTH, GRID, RIM, SHELL, STEEL, MotionScene, Warp, check_drawable, view
from .painter import UP, Painter
from .plot import ACCENT, DEFAULT_STYLE, INK, QUIET, Size, leg_colour, to_rgb
from .raster import Mesh, Raster, arrow, ball, box, disc, ribbon, surface, tube

VIDEO_PX = (1280, 720)
FINE = 2
"""Nodes of the film's surface to a facet of the picture's."""
MARGIN = 0.08
"""Left and right of the strip's time axis, as a share of the width."""


def motion_frames(
    trajectory: Trajectory,
    report: GaitReport | None = None,
    *,
    fps: float = 25.0,
    speed: float = 1.0,
    warp: Warp | None = None,
    caption: str = "",
    size_px: Size = VIDEO_PX,
) -> Iterator[NDArray[np.uint8]]:
    """The frames of a trajectory's film, uint8 of shape (H, W, 3), one by one.

    speed: seconds of the motion to a second of the film. What else is drawn, and the arguments, are those of
    ``gait_picture.draw_motion``. Raises InvalidInput.
    """
    scene = check_drawable(trajectory)
    if not (0.0 < fps <= 1000.0 and 0.0 < speed <= 1000.0):
        raise InvalidInput(f"fps, speed: expected numbers above 0, up to 1000, got {fps:g} and {speed:g}")
    height = round(0.22 * size_px[1])
    strip = _strip(trajectory, report, caption, (size_px[0], size_px[1]), height)
    painter = view(scene)
    low, high = _shown(painter, scene)
    ground = Raster(painter, low, high, (size_px[0], size_px[1] - height - round(0.11 * size_px[1])))
    for mesh, raised in _terrain(painter, scene, warp):
        ground.draw(mesh, raised_m=raised)
    yield from _film(scene, ground, strip, height, speed / fps)


def _film(
    scene: MotionScene, ground: Raster, strip: NDArray[np.uint8], height: int, frame_s: float
) -> Iterator[NDArray[np.uint8]]:
    """One frame after another; where feet came down and where the torso went stays on the ground."""
    trajectory, painter = scene.trajectory, ground.painter
    times_s = trajectory.times_s - trajectory.times_s[0]
    landings, done = scene.footholds(), 0
    count = 1 + int(np.floor(trajectory.duration_s / frame_s + 1e-9))
    top = strip.shape[0] - height - ground.size_px[1]
    last = 0
    for index in range(count):
        sample = int(np.argmin(np.abs(times_s - index * frame_s)))
        while done < len(landings) and landings[done][0] <= sample:
            _, foot, place = landings[done]
            frame = trajectory.terrain.frame(place[:2])
            for size, colour in ((1.25, "white"), (1.0, leg_colour(foot))):
                mark = disc(place, frame, 0.055 * scene.size_m * size, colour)
                ground.draw(mark, raised_m=(0.09 - 0.02 * size) * scene.size_m)
            done += 1
        if sample > last:
            ground.draw(
                ribbon(trajectory.torso_m[last : sample + 1 : max(1, (sample - last) // 2)], painter, 0.012, INK)
            )
            last = sample
        shot = ground.copy()
        shot.draw(_robot(scene, sample))
        pixels = strip.copy()
        pixels[top : top + ground.size_px[1]] = shot.pixels()
        _cursor(pixels, height, float(times_s[sample]) / trajectory.duration_s)
        yield pixels


def _terrain(painter: Painter, scene: MotionScene, warp: Warp | None) -> Iterator[tuple[Mesh, float]]:
    """The surface, the block under it and the lines on it, with how far each is raised."""
    coarse_x, coarse_y, *_ = scene.surface
    x, y = (np.linspace(line[0], line[-1], FINE * (len(line) - 1) + 1) for line in (coarse_x, coarse_y))
    xy = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    heights = scene.trajectory.terrain.height(xy)
    points = np.concatenate([xy, heights[..., None]], axis=-1)
    yield surface(points, scene.trajectory.terrain.normal(xy), scene.colours(heights)), 0.0
    for border, outward in scene.sides():
        if painter.facing(border.mean(axis=0), outward) > 0.0:
            sheet = np.stack([border, border * [1.0, 1.0, 0.0] + scene.floor_m * UP])
            tints = np.broadcast_to(np.array(rgb(EARTH)), sheet.shape)
            yield surface(sheet, np.broadcast_to(outward, sheet.shape), tints), 0.0
    pale = tuple(0.45 * np.array(rgb(GRID)) + 0.55 * np.array(rgb("#dfd8c8")))
    pieces = [ribbon(line, painter, 0.006, pale) for line in scene.lines(warp)]
    if pieces:
        yield Mesh.joined(pieces), 0.03


def _robot(scene: MotionScene, sample: int) -> Mesh:
    """Trunk, legs and contact forces at one moment."""
    trajectory = scene.trajectory
    torso, turn, half = trajectory.torso_m[sample], trajectory.rotation[sample], trajectory.robot.trunk_half_m
    bone = BONE * scene.size_m
    nose = torso + turn @ (half * [0.72, 0.0, 1.0])
    parts = [box(torso, turn, half, SHELL), box(nose, turn, half * [0.12, 0.3, 0.06], STEEL)]
    for k, (hip, knee, toe) in enumerate(scene.legs(sample)):
        parts += [tube(hip, knee, (1.2 * bone, 0.9 * bone), STEEL), tube(knee, toe, (0.9 * bone, 0.5 * bone), STEEL)]
        parts += [ball(hip, 1.3 * bone, RIM), ball(knee, 1.0 * bone, RIM), ball(toe, 0.9 * bone, leg_colour(k))]
        if trajectory.contact[sample, k]:
            force = scene.metres_a_newton * trajectory.forces_n[sample, k]
            parts += arrow(toe, force, 0.022 * scene.size_m, ACCENT)
    return Mesh.joined(parts)


def _shown(painter: Painter, scene: MotionScene) -> tuple[Array, Array]:
    """Corners of what is to be seen on the picture plane, shape (2,) [m]."""
    borders = [border for border, _ in scene.sides()]
    floors = [border * [1.0, 1.0, 0.0] + scene.floor_m * UP for border in borders]
    body = scene.trajectory.torso_m + 0.4 * scene.size_m * UP
    plane = painter.project(np.concatenate([*borders, *floors, body]))[0]
    low, high = plane.min(axis=0), plane.max(axis=0)
    return low - 0.02 * (high - low), high + 0.02 * (high - low)


@DEFAULT_STYLE
def _strip(
    trajectory: Trajectory, report: GaitReport | None, caption: str, size_px: Size, height: int
) -> NDArray[np.uint8]:
    """All of a frame but the scene: title, verdict, and a bar a foot where it stands."""
    figure = chart.sheet(size_px, VIDEO_PX)
    name = trajectory.terrain.name or "a terrain"
    verdict = "not verified" if report is None else report.message
    title = caption or f"{trajectory.robot.name} over {name}"
    chart.headline(figure, title, verdict, alarm=report is not None and not report.accepted)
    feet = trajectory.robot.feet
    share = height / size_px[1]
    axes = figure.add_axes((MARGIN, 0.3 * share, 1.0 - 2.0 * MARGIN, 0.62 * share))
    times_s = trajectory.times_s - trajectory.times_s[0]
    for row in range(len(feet)):
        steps = np.diff(trajectory.contact[:, row].astype(int), prepend=0, append=0)
        begins, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1
        spans = [(times_s[a], max(times_s[b] - times_s[a], 1e-9)) for a, b in zip(begins, ends, strict=True)]
        axes.broken_barh(spans, (row - 0.36, 0.72), color=leg_colour(row), lw=0)
    axes.set(xlim=(0.0, trajectory.duration_s), ylim=(len(feet) - 0.4, -0.6))
    axes.set_yticks(range(len(feet)), [foot.name for foot in feet], size=10.5, color=INK)
    axes.tick_params(length=0, pad=6, labelsize=10.5, labelcolor=QUIET)
    axes.set_facecolor("#eef1f4")
    axes.set_xlabel("s", size=10.5, color=QUIET, loc="right", labelpad=-14)
    for side in axes.spines.values():
        side.set_visible(False)
    return np.array(to_rgb(figure))


def _cursor(pixels: NDArray[np.uint8], height: int, share: float) -> None:
    """A line across the strip at the share of the time that has passed."""
    rows, width = pixels.shape[:2]
    x = round((MARGIN + (1.0 - 2.0 * MARGIN) * share) * width)
    half = max(1, width // 900)
    top, bottom = rows - round(0.94 * height), rows - round(0.28 * height)
    pixels[top:bottom, max(0, x - half) : x + half] = (209, 35, 59)
