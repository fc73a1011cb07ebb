"""Pictures, pages and films of a trajectory: terrain with a map's grid, the robot, its contact
forces and footholds.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stancekit.planners.answer.report import Report
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.gait_motion import WALK_SETTLE_S
from stancekit.planners.motion.joints import walk_joints
from stancekit.planners.motion.motion import Played, Samples
from stancekit.planners.robot.leg import rotation_of
from stancekit.planners.robot.model import Robot
from stancekit.runner.motion.time_parametrization import streamed
from stancekit.runner.report import Execution

from .film import Frame, film_frames
from .plans import FPS, View
from .robots import RobotShape, bent, faded, single_body
from .scene import (
    UP,
    Animation,
    Camera,
    Colour,
    DrawnBody,
    Label,
    Path,
    Scene,
    Sheet,
    best_view,
    dashes,
    disc,
    lines_told,
    polyline,
    unit,
)
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    GUIDE,
    INK,
    QUIET,
    SIZE_PX,
    Size,
    headline,
    leg_colour,
    quiet_axes,
    sheet,
    to_rgb,
    wrapped,
)
from .strips import picture
from .terrain import Entry, block, grid_on_ground

_FILM_PX = (1280, 720)
_MARGIN = 0.08
"""Left and right of the time axis, as a share of the width."""


@DEFAULT_STYLE
def _draw_contacts(trajectory: Trajectory, size_px: Size, height: int) -> NDArray[np.uint8]:
    """A bar a foot where it stands, at the foot of every frame."""
    figure = sheet(size_px, _FILM_PX)
    feet, share = trajectory.robot.feet, height / size_px[1]
    axes = figure.add_axes((_MARGIN, 0.3 * share, 1.0 - 2.0 * _MARGIN, 0.62 * share))
    times_s = trajectory.times_s - trajectory.times_s[0]
    for row in range(len(feet)):
        steps = np.diff(trajectory.contact[:, row].astype(int), prepend=0, append=0)
        begins, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1
        spans = [
            (times_s[a], max(times_s[b] - times_s[a], 1e-9))
            for a, b in zip(begins, ends, strict=True)
        ]
        axes.broken_barh(spans, (row - 0.36, 0.72), color=leg_colour(row), lw=0)
    axes.set(xlim=(0.0, trajectory.duration_s), ylim=(len(feet) - 0.4, -0.6), facecolor="#eef1f4")
    quiet_axes(axes, grid=None, sides=())
    axes.set_yticks(range(len(feet)), [foot.name for foot in feet], size=10.5, color=INK)
    axes.tick_params(labelsize=10.5)
    axes.annotate(
        "s",
        (1.0, 0.0),
        (14, -4),
        "axes fraction",
        "offset points",
        size=10.5,
        color=QUIET,
        va="top",
    )
    return to_rgb(figure)[-height:]


def _mark_time(pixels: NDArray[np.uint8], height: int, share: float) -> None:
    """A line across the strip at the share of the time that has passed."""
    rows, width = pixels.shape[:2]
    x = round((_MARGIN + (1.0 - 2.0 * _MARGIN) * share) * width)
    half = max(1, width // 900)
    top, bottom = rows - round(0.94 * height), rows - round(0.28 * height)
    pixels[top:bottom, max(0, x - half) : x + half] = (209, 35, 59)


Warp = Callable[[Array], Array]
"""Points of the warped space, shape (N, 3) [m], to the world, shape (N, 3) [m]."""
GRID, GRID_M = "#4d5d66", 0.25
"""The lines drawn on the terrain, and their distance in the map's own metres."""
CELLS = 84
"""Facets of the terrain along its longer side."""
_WEIGHT_ARROW = 1.1
"""Length of an arrow as heavy as the robot, in stand heights."""


@dataclass(frozen=True, eq=False)
class GaitView(View):
    """View of a trajectory.

    Arguments:
        warp: the map whose lines are drawn on the terrain, None for x and y.
        joints_rad: angles of a URDF's joints at every sample, shape (K, J), where they were
            measured: the samples are then shown as they are.
        report: the verifier's word on it, which is shown.
        caption: title, in place of the usual one.
        note: words where there is no report.
    """

    trajectory: Trajectory
    warp: Warp | None = None
    joints_rad: Array | None = None
    report: Report[Trajectory] | None = field(default=None, kw_only=True)
    caption: str = field(default="", kw_only=True)
    note: str = field(default="not verified", kw_only=True)

    @classmethod
    def of_execution(cls, trajectory: Trajectory, execution: Execution) -> GaitView:
        """A walk as a world had it."""
        done = (
            "to its end" if execution.fallen_s is None else f"fell after {execution.fallen_s:.1f} s"
        )
        return cls(
            walked(trajectory, execution),
            joints_rad=execution.trace.angles_rad,
            caption=f"{trajectory.robot.name} in {execution.world}: {done}",
            note=(
                f"body {1e3 * execution.body_rms_m:.1f} mm from the plan (RMS)   ·   "
                f"feet slid {1e3 * execution.slip_m.max():.1f} mm at most   ·   "
                f"{execution.torque_share.max():.0%} of a joint's torque at most   ·   grid "
                f"{GRID_M:g} m"
            ),
        )

    def __post_init__(self) -> None:
        samples = ("torso_m", "rotation", "feet_m", "forces_n")
        if self.trajectory.samples < 2 or not all(
            np.isfinite(getattr(self.trajectory, n)).all() for n in samples
        ):
            raise InvalidInput(
                "trajectory: expected two or more samples of finite numbers, got fewer or other values"
            )

    @property
    def robot(self) -> Robot:
        """The robot that walks."""
        return self.trajectory.robot

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot; its size is the height at which it stands."""
        return single_body(self.robot)

    @property
    def metres_a_newton(self) -> float:
        """Length of the arrow of a force."""
        return _WEIGHT_ARROW * self.shape.size_m / (self.trajectory.robot.mass_kg * 9.81)

    @cached_property
    def bounds_m(self) -> Array:
        """Corners of the terrain that is shown, shape (2, 2): where feet go with room around,
        inside the grid.
        """
        feet = self.trajectory.feet_m[..., :2].reshape(-1, 2)
        room = 1.6 * self.shape.size_m
        low, high = feet.min(axis=0) - room, feet.max(axis=0) + room
        least, most = np.array(self.trajectory.problem.terrain.domain_m).T
        inside = np.array([np.clip(low, least, most), np.clip(high, least, most)])
        return (
            inside if float(np.min(inside[1] - inside[0])) > 0.5 * room else np.array([low, high])
        )

    @cached_property
    def ground(self) -> list[Sheet]:
        """The terrain on its block."""
        size = self.shape.size_m
        return block(
            self.trajectory.problem.terrain,
            *self.bounds_m,
            facets=CELLS,
            depth_m=0.25 * size,
            relief_m=0.5 * size,
        )

    @cached_property
    def camera(self) -> Camera:
        """From the side of the path and above, where the terrain hides the robot least."""
        terrain, points = self.trajectory.problem.terrain, self.ground[0].points_m.reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0) + self.shape.size_m * UP
        span = float(np.linalg.norm(high - low))
        torso = self.trajectory.torso_m[:: max(1, self.trajectory.samples // 40)]
        along = unit(np.append((self.trajectory.torso_m[-1] - self.trajectory.torso_m[0])[:2], 0.0))
        rays = np.linspace(0.05, 0.5, 30)[:, None, None]

        def merit(camera: Camera) -> float:
            towards = camera.axes[2]
            sight = torso + rays * span * towards
            free = np.all(sight[..., 2] > terrain.height(sight[..., :2]), axis=0)
            across = 1.0 - abs(float(along @ unit(towards * [1.0, 1.0, 0.0])))
            return (
                3.0 * float(free.mean()) + across + 0.8 * float(camera.axes[1] @ UP)
            )  # low enough to see heights

        return best_view(
            0.5 * (low + high), 1.9 * span, merit, step_deg=15.0, elevations_deg=[28.0, 38.0, 50.0]
        )

    @cached_property
    def shown(self) -> list[int]:
        """Samples at which a picture has the robot: the ends, and where it has gone on by its own
        length.
        """
        steps = np.linalg.norm(np.diff(self.trajectory.torso_m, axis=0), axis=1)
        path = np.concatenate([[0.0], np.cumsum(steps)])
        count = int(
            np.clip(round(path[-1] / (2.6 * float(self.trajectory.robot.trunk_half_m[0]))), 1, 8)
        )
        return sorted(
            {
                int(np.searchsorted(path, share * path[-1]))
                for share in np.linspace(0.0, 1.0, count + 1)
            }
        )

    def lines(self) -> Array:
        """Lines of constant x̄ and ȳ where they run over the surface, in pieces of shape (L, 2, 3)
        [m].
        """
        field = self.trajectory.problem.terrain
        longest = float(np.max(np.diff(field.domain_m)))
        return grid_on_ground(
            field, self.bounds_m[0], self.bounds_m[1], GRID_M, 1 + round(24 * longest), self.warp
        )

    @cached_property
    def fixed(self) -> Scene:
        """Terrain, the lines on it, and the torso's path."""
        cell = float(np.max(self.bounds_m[1] - self.bounds_m[0])) / CELLS
        lines = Path(pieces_m=self.lines(), colour=GRID, opacity=0.35, width=0.6, lift_m=0.8 * cell)
        return Scene(sheets=self.ground, paths=[lines]) + self.way

    @cached_property
    def way(self) -> Scene:
        """The torso's path, and the guide paths."""
        torso = self.trajectory.torso_m[:: max(1, self.trajectory.samples // 150)]
        lines = self.ways_m
        ways = [
            Path(pieces_m=dashes(line), colour=GUIDE, opacity=shown, width=1.2, lift_m=0.02)
            for line, shown in zip(lines, [*[0.35] * (len(lines) - 1), 0.9], strict=False)
        ]
        path = Path(pieces_m=polyline(torso), colour=INK, width=2.0, lift_m=0.02)
        return Scene(paths=[*ways, path])

    @property
    def ways_m(self) -> list[Array]:
        """Guide paths of a walk in pieces, shape (L, 3) each [m]: those that were left for another,
        and the last.
        """
        guide = self.trajectory.provenance.get("guide_m", "")
        with suppress(ValueError, RecursionError):
            return lines_told(json.loads(guide)) if isinstance(guide, str) else []
        return []

    @cached_property
    def footholds(self) -> list[tuple[int, DrawnBody]]:
        """Every touch-down with its sample."""
        contact, trajectory = self.trajectory.contact, self.trajectory
        began = contact & ~np.vstack([np.zeros((1, contact.shape[1]), dtype=bool), contact[:-1]])
        bodies, radius = list[tuple[int, DrawnBody]](), 0.06 * self.shape.size_m
        for k, foot in np.argwhere(began).tolist():
            at = trajectory.feet_m[k, foot]
            bodies.append(
                (
                    k,
                    DrawnBody(
                        name=f"{self.shape.limbs[foot]} foothold {k}",
                        shape=disc(trajectory.problem.terrain.normal(at[:2]), radius),
                        position_m=at,
                        colour=leg_colour(foot),
                        edge="white",
                        lift_m=1.8 * radius,
                    ),
                )
            )
        return bodies

    @cached_property
    def motion(self) -> Played:
        """Played that ``run`` streams, at rest before and after the walk."""
        return streamed(self.trajectory)

    def limbs_of(self, sample: int) -> list[Array]:
        """Poses of the limbs at a sample, as of ``limbs``."""
        trajectory, links = self.trajectory, self.shape.links
        if links is None:
            return self._bent(
                trajectory.torso_m[sample], trajectory.rotation[sample], trajectory.feet_m[sample]
            )
        if self.joints_rad is not None:
            return links.split(self.joints_rad[sample])
        angles, _ = walk_joints(trajectory, slice(sample, sample + 1))
        return links.split(angles[0])

    def guess(self, now: Samples) -> list[Array]:
        """Hip, knee and toe of every leg; the knees' places are guessed, for the picture alone."""
        return self._bent(now.com_m, rotation_of(now.rotation_rad), now.toes_m)

    def _bent(self, torso: Array, turn: Array, toes_m: Array) -> list[Array]:
        """Hip, knee and toe of every leg, shape (3, 3) [m]."""
        chains = []
        for foot, toe in zip(self.trajectory.robot.feet, toes_m, strict=True):
            hip = torso + turn @ foot.hip_m
            bone = max(0.7 * self.shape.size_m, 0.505 * float(np.linalg.norm(toe - hip)))
            bend = turn @ np.append([0.5, 0.9] * np.sign(foot.hip_m[:2]), 0.3)
            chains.append(bent(hip, toe, bend, bone, bone))
        return chains

    def at(self, sample: int, *, prefix: str = "", strength: float = 1.0) -> Scene:
        """The robot and its contact forces at a sample; paler with less strength."""
        trajectory = self.trajectory
        bodies = self.shape.bodies(
            trajectory.torso_m[sample],
            trajectory.rotation[sample],
            self.limbs_of(sample),
            prefix=prefix,
        )
        stands = np.flatnonzero(trajectory.contact[sample]).tolist()
        arrows = [
            self.shape.force(
                prefix + self.shape.limbs[k],
                trajectory.feet_m[sample, k],
                self.metres_a_newton * trajectory.forces_n[sample, k],
            )
            for k in stands
        ]
        return Scene(bodies=faded(bodies, strength), arrows=arrows)

    def moment(self, time_s: float) -> Scene:
        """The robot, its contact forces and the footholds until then, so long after the walk began.

        It is what ``run`` streams then, or the nearest sample of one that was measured.
        """
        times_s = self.trajectory.times_s - self.trajectory.times_s[0]
        if self.joints_rad is not None:
            sample = int(np.argmin(np.abs(times_s - time_s)))
            scene = self.at(sample)
        else:
            sample = int(np.searchsorted(times_s, time_s + 1e-9, side="right")) - 1
            now = self.motion.at(WALK_SETTLE_S + time_s)
            scene = Scene(bodies=self.bodies(now), arrows=self.forces(now))
        return scene + Scene(bodies=[disc for k, disc in self.footholds if k <= sample])

    def scene(self) -> Scene:
        """The picture: the robot at a few moments, the earlier the paler, and every foothold."""
        result = self.fixed + Scene(bodies=[body for _, body in self.footholds])
        for place, sample in enumerate(self.shown):
            strength = 0.35 + 0.65 * place / max(len(self.shown) - 1, 1)
            result += self.at(sample, prefix=f"{sample} ", strength=strength)
        ends = ((0, "start"), (-1, f"goal, {self.trajectory.duration_s:g} s"))
        above = self.trajectory.torso_m + 0.62 * self.shape.size_m * UP
        return result + Scene(
            labels=[
                Label(name=text, position_m=above[k], text=text, colour=INK) for k, text in ends
            ]
        )

    def film(self, *, step_s: float = 1.0 / FPS) -> Animation:
        """The trajectory's motion, a moment every ``step_s``: footholds stay once a foot came down."""
        count = 1 + int(np.floor(self.trajectory.duration_s / step_s + 1e-9))
        return Animation(
            fixed=self.fixed,
            moments=[self.moment(index * step_s) for index in range(count)],
            step_s=step_s,
            camera=self.camera,
            title=self.caption or self.title,
            note=self.note if self.report is None else self.report.message,
            alarm=_refused(self.report),
            legend=self.legend,
        )

    def frames(self, film: Animation, size_px: Size | None = None) -> Iterator[Frame]:
        """The frames of ``film``; below, which feet stand when.

        Raises InvalidInput without MuJoCo or a GL library.
        """
        size = size_px or self.film_px
        foot_px = round(0.22 * size[1])
        strip, last_s = _draw_contacts(self.trajectory, size, foot_px), self.trajectory.duration_s
        for index, pixels in enumerate(film_frames(film, size, foot_px=foot_px)):
            pixels[-foot_px:] = strip
            _mark_time(pixels, foot_px, min(index * film.step_s / last_s, 1.0))
            yield pixels

    @property
    def title(self) -> str:
        """Title: the robot and the terrain."""
        return f"{self.trajectory.robot.name} over {self.trajectory.problem.terrain.name or 'a terrain'}"

    @property
    def legend(self) -> list[tuple[Colour, str]]:
        """Legend of the colours, for a page."""
        guide = [(GUIDE, "guide path, dashed; ways that were tried, faint")] if self.ways_m else []
        legs = [(leg_colour(k), limb) for k, limb in enumerate(self.shape.limbs)]
        return [(ACCENT, "contact forces"), *guide, *legs]


@DEFAULT_STYLE
def draw_motion(
    trajectory: Trajectory,
    report: Report[Trajectory] | None = None,
    *,
    warp: Warp | None = None,
    caption: str = "",
    size_px: Size = SIZE_PX,
) -> Figure:
    """Draw a trajectory over its terrain: the robot at a few moments with its contact forces, and
    every foothold.

    Arguments:
        warp: the map of a warped space, whose lines of constant x̄ and ȳ are drawn on the terrain
            (Pan et al. Fig. 3); without one they are those of x and y.
        report: what the verifier says, put below the title.
        size_px: width and height.

    Raises:
        InvalidInput: for a trajectory of no samples or with values that are not finite.
    """
    view, sticky = GaitView(trajectory, warp), trajectory.problem.adhesive
    entries = [
        *(
            Entry(text=limb + "*" * bool(sticky[k]), sign="dot", colour=leg_colour(k))
            for k, limb in enumerate(view.shape.limbs)
        ),
        *([Entry(text="* adhesive")] if sticky.any() else []),
        Entry(
            text=f"{'grid' if warp is None else 'lines of the map'}, {GRID_M:g} m",
            sign="line",
            colour=GRID,
        ),
        *([Entry(text="guide path", sign="line", colour=GUIDE)] if view.ways_m else []),
    ]
    figure = picture(
        view.scene(),
        view.camera,
        None,
        entries,
        metres_a_newton=view.metres_a_newton,
        size_px=size_px,
    )
    made = trajectory.provenance.get("chart", "")
    length = float(np.linalg.norm(np.diff(trajectory.torso_m, axis=0), axis=1).sum())
    verdict = "not verified" if report is None else report.message
    words = wrapped(
        f"{length:.2f} m in {trajectory.duration_s:g} s   ·   friction "
        f"{trajectory.problem.friction:g}   ·   {verdict}"
    )
    headline(
        figure, caption or view.title + (f", {made}" if made else ""), words, alarm=_refused(report)
    )
    return figure


def walked(trajectory: Trajectory, execution: Execution) -> Trajectory:
    """A trajectory as the world had it: the body, the feet and what they felt, a sample a control
    period.
    """
    trace, robot = execution.trace, trajectory.robot
    centre, radii = robot.origin_m, robot.foot_radii_m
    return replace(
        trajectory,
        times_s=trace.time_s,
        torso_m=trace.origin_m + trace.rotation @ centre,
        rotation=trace.rotation,
        feet_m=trace.feet_m - radii[:, None] * UP,
        forces_n=trace.forces_n,
        contact=np.linalg.norm(trace.forces_n, axis=2) > trace.touch_n,
    )


def _refused(report: Report[Trajectory] | None) -> bool:
    return report is not None and not report.accepted
