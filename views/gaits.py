"""Pictures, pages and films of a trajectory: terrain with a map's grid, the robot, its contact
forces and footholds.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stancekit.planners.answer.report import Report
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.cached import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.gait_motion import SETTLE_S
from stancekit.planners.motion.motion import Motion, Samples
from stancekit.planners.motion.walk_joints import walk_joints
from stancekit.planners.robot.rotation import rotation_of
from stancekit.planners.robot.toes import ToeKinematics
from stancekit.runner.motion.stream import streamed

from .camera import Camera, best_view
from .contact_strip import FILM_PX, draw_contacts, mark_time
from .film import film_frames
from .legend import Entry, draw_legend, force_entry
from .robots import RobotShape, bent, faded, single_body
from .scene import UP, Animation, Arrow, Colour, DrawnBody, Label, Path, Scene, Sheet
from .shapes import dashes, disc, lines_told, polyline, unit
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    GUIDE,
    INK,
    SIZE_PX,
    Size,
    headline,
    leg_colour,
    plain_axes,
    sheet,
)
from .still import Still
from .terrain import block, grid_on_ground
from .video import Frame

Warp = Callable[[Array], Array]
"""Points of the warped space, shape (N, 3) [m], to the world, shape (N, 3) [m]."""
GRID, GRID_M = "#4d5d66", 0.25
"""The lines drawn on the terrain, and their distance in the map's own metres."""
CELLS = 84
"""Facets of the terrain along its longer side."""
WEIGHT_ARROW = 1.1
"""Length of an arrow as heavy as the robot, in stand heights."""


@dataclass(frozen=True, eq=False)
class GaitView:
    """A trajectory as something to look at.

    Arguments:
        warp: the map whose lines are drawn on the terrain, None for x and y.
        joints_rad: angles of a URDF's joints at every sample, shape (K, J), where they were
            measured: the samples are then shown as they are.
        moves_as: its motion, where that is not to be what ``run`` streams.
    """

    trajectory: Trajectory
    warp: Warp | None = None
    joints_rad: Array | None = None
    moves_as: Motion | None = None

    def __post_init__(self) -> None:
        samples = ("torso_m", "rotation", "feet_m", "forces_n")
        if self.trajectory.samples < 2 or not all(
            np.isfinite(getattr(self.trajectory, n)).all() for n in samples
        ):
            raise InvalidInput("trajectory: expected two or more samples of finite numbers")

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot; its size is the height at which it stands."""
        return single_body(self.trajectory.robot)

    @property
    def metres_a_newton(self) -> float:
        """Length of the arrow of a force."""
        return WEIGHT_ARROW * self.shape.size_m / (self.trajectory.robot.mass_kg * 9.81)

    @cached_property
    def bounds_m(self) -> Array:
        """Corners of the terrain that is shown, shape (2, 2): where feet go with room around,
        inside the grid.
        """
        feet = self.trajectory.feet_m[..., :2].reshape(-1, 2)
        room = 1.6 * self.shape.size_m
        low, high = feet.min(axis=0) - room, feet.max(axis=0) + room
        least, most = np.array(self.trajectory.terrain.domain_m).T
        inside = np.array([np.clip(low, least, most), np.clip(high, least, most)])
        return (
            inside if float(np.min(inside[1] - inside[0])) > 0.5 * room else np.array([low, high])
        )

    @cached_property
    def ground(self) -> list[Sheet]:
        """The terrain on its block."""
        size = self.shape.size_m
        return block(
            self.trajectory.terrain,
            *self.bounds_m,
            facets=CELLS,
            depth_m=0.25 * size,
            relief_m=0.5 * size,
        )

    @cached_property
    def camera(self) -> Camera:
        """From the side of the path and above, where the terrain hides the robot least."""
        terrain, points = self.trajectory.terrain, self.ground[0].points_m.reshape(-1, 3)
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
        field = self.trajectory.terrain
        longest = float(np.max(np.diff(field.domain_m)))
        return grid_on_ground(
            field, self.bounds_m[0], self.bounds_m[1], GRID_M, 1 + round(24 * longest), self.warp
        )

    @cached_property
    def fixed(self) -> Scene:
        """Terrain, the lines on it, and the torso's path."""
        cell = float(np.max(self.bounds_m[1] - self.bounds_m[0])) / CELLS
        torso = self.trajectory.torso_m[:: max(1, self.trajectory.samples // 150)]
        lines = self.ways_m
        ways = [
            Path(pieces_m=dashes(line), colour=GUIDE, opacity=shown, width=1.2, lift_m=0.02)
            for line, shown in zip(lines, [*[0.35] * (len(lines) - 1), 0.9], strict=False)
        ]
        return Scene(
            sheets=self.ground,
            paths=[
                Path(
                    pieces_m=self.lines(), colour=GRID, opacity=0.35, width=0.6, lift_m=0.8 * cell
                ),
                *ways,
                Path(pieces_m=polyline(torso), colour=INK, width=2.0, lift_m=0.02),
            ],
        )

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
                        shape=disc(trajectory.terrain.normal(at[:2]), radius),
                        position_m=at,
                        colour=leg_colour(foot),
                        edge="white",
                        lift_m=1.8 * radius,
                    ),
                )
            )
        return bodies

    @cached_property
    def motion(self) -> Motion:
        """Motion that ``run`` streams, at rest before and after the walk."""
        return self.moves_as or streamed(self.trajectory)

    def limbs(self, sample: int) -> list[Array]:
        """Angles of every leg, where the robot is a URDF's; else hip, knee and toe, shape (3, 3)
        [m], and where knees bend is a guess, for the eye.
        """
        trajectory, links = self.trajectory, self.shape.links
        if links is None:
            return self._bent(
                trajectory.torso_m[sample], trajectory.rotation[sample], trajectory.feet_m[sample]
            )
        if self.joints_rad is not None:
            return links.split(self.joints_rad[sample])
        return [angles[0] for angles in walk_joints(trajectory, slice(sample, sample + 1)).angles]

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
            self.limbs(sample),
            prefix=prefix,
        )
        arrows = self._forces(
            trajectory.feet_m[sample],
            trajectory.forces_n[sample],
            trajectory.contact[sample],
            prefix=prefix,
        )
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
            scene = self.drawn(self.now(time_s))
        return scene + Scene(bodies=[disc for k, disc in self.footholds if k <= sample])

    def drawn(self, now: Samples) -> Scene:
        """The robot and its contact forces at one time."""
        turn, links = rotation_of(now.rotation_rad), self.shape.links
        body = now.com_m
        if now.origin_m is not None and links is not None:
            body = now.origin_m + turn @ links.model.body.com_m
        return Scene(
            bodies=self.shape.bodies(body, turn, self._limbs_at(now, turn)),
            arrows=self._forces(now.toes_m, now.forces_n, now.stands),
        )

    def now(self, time_s: float) -> Samples:
        """The motion so long after the walk began."""
        return self.motion.at(SETTLE_S + time_s)

    def _limbs_at(self, now: Samples, turn: Array) -> list[Array]:
        """The limbs of samples at one time, as of ``limbs``."""
        links = self.shape.links
        if links is None:
            return self._bent(now.com_m, turn, now.toes_m)
        if now.angles_rad is not None:
            return links.split(now.angles_rad)
        postures = ToeKinematics(links.model).solve(
            now.com_m[None], turn[None], now.toes_m[None], now.normals[None]
        )
        return [angles[0] for angles in postures.angles]

    def _forces(
        self, toes_m: Array, forces_n: Array, stands: NDArray[np.bool_], *, prefix: str = ""
    ) -> list[Arrow]:
        """Arrows of the forces of the feet that stand."""
        return [
            self.shape.force(
                prefix + self.shape.limbs[k], toes_m[k], self.metres_a_newton * forces_n[k]
            )
            for k in np.flatnonzero(stands).tolist()
        ]

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

    def film(
        self,
        report: Report[Trajectory] | None,
        *,
        caption: str = "",
        note: str = "not verified",
        step_s: float = 0.05,
    ) -> Animation:
        """The trajectory's motion, a moment every ``step_s``: footholds stay once a foot came down.

        Arguments:
            note: what is said where there is no report.
        """
        count = 1 + int(np.floor(self.trajectory.duration_s / step_s + 1e-9))
        return Animation(
            fixed=self.fixed,
            moments=[self.moment(index * step_s) for index in range(count)],
            step_s=step_s,
            camera=self.camera,
            title=caption or self.title,
            note=note if report is None else report.message,
            alarm=_refused(report),
            legend=self.legend,
        )

    @property
    def title(self) -> str:
        """Title: the robot and the terrain."""
        return f"{self.trajectory.robot.name} over {self.trajectory.terrain.name or 'a terrain'}"

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
    view, figure = GaitView(trajectory, warp), sheet(size_px)
    scale = Still(view.scene(), view.camera).paint(plain_axes(figure, 18.0, 66.0, 88.0))
    sticky = trajectory.adhesive
    entries = [
        force_entry(scale / view.metres_a_newton, 150.0),
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
    draw_legend(figure, 12.0, entries)
    made = trajectory.provenance.get("chart", "")
    length = float(np.linalg.norm(np.diff(trajectory.torso_m, axis=0), axis=1).sum())
    verdict = "not verified" if report is None else report.message
    words = f"{length:.2f} m in {trajectory.duration_s:g} s   ·   friction {trajectory.friction:g}   ·   {verdict}"
    headline(
        figure, caption or view.title + (f", {made}" if made else ""), words, alarm=_refused(report)
    )
    return figure


def motion_frames(
    trajectory: Trajectory,
    report: Report[Trajectory] | None = None,
    *,
    fps: float = 25.0,
    speed: float = 1.0,
    warp: Warp | None = None,
    caption: str = "",
    note: str = "not verified",
    joints_rad: Array | None = None,
    size_px: Size = FILM_PX,
) -> Iterator[Frame]:
    """The frames of a trajectory's film, uint8 of shape (H, W, 3), one by one; below, which feet
    stand when.

    Arguments:
        speed: seconds of the motion to a second of the film.
        note, joints_rad: as of ``GaitView``. What else is drawn, and the arguments, are those of
            ``draw_motion``.

    Raises:
        InvalidInput: also without MuJoCo or a GL library.
    """
    if not (0.0 < fps <= 1000.0 and 0.0 < speed <= 1000.0):
        raise InvalidInput(
            f"fps, speed: expected numbers above 0, up to 1000, got {fps:g} and {speed:g}"
        )
    motion = GaitView(trajectory, warp, joints_rad).film(
        report, caption=caption, note=note, step_s=speed / fps
    )
    foot_px = round(0.22 * size_px[1])
    strip = draw_contacts(trajectory, size_px, foot_px)
    for index, pixels in enumerate(film_frames(motion, size_px, foot_px=foot_px)):
        pixels[-foot_px:] = strip
        mark_time(pixels, foot_px, min(index * motion.step_s / trajectory.duration_s, 1.0))
        yield pixels


def _refused(report: Report[Trajectory] | None) -> bool:
    return report is not None and not report.accepted
