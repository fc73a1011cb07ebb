"""Pictures, pages and films of a crossing, and of leaps and crossings as a world had them: the robot
over the terrain, what its feet press with, and its way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from stancekit.planners.answer.crossing import Crossing
from stancekit.planners.answer.leap_plan import LeapPlan
from stancekit.planners.cached import cached_property
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.crossing_motion import CrossingMotion
from stancekit.planners.motion.leap_run import LeapRun
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.rotation import rotation_of
from stancekit.planners.robot.toes import ToeKinematics
from stancekit.planners.terrain import Patch
from stancekit.runner.execution import Execution

from .camera import Camera, best_view
from .film import film_frames
from .plans import FILM_PX, LONGEST, MARGIN_M
from .robots import RobotShape, climber
from .scene import Animation, Colour, Layer, Path, Scene
from .shapes import polyline
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    INK,
    SIZE_PX,
    Size,
    friction_colours,
    headline,
    plain_axes,
    sheet,
)
from .still import Still
from .terrain import SCALE, patches
from .video import Frame

FPS = 25.0
CLIMBS, LEAPS = 4.0, 0.4
"""Films show key frames at so many times their pace, and leaps."""
ABOUT_M = 0.35
"""So much of the terrain is shown about the way [m]."""
REAL = "#c2410c"
WEIGHTS = 1.5
"""The arrow of a force of so many weights is as long as arrows are."""


@dataclass(frozen=True, eq=False)
class CrossingView:
    """A crossing, or a leap, as something to look at; on its execution where there is one.

    Arguments:
        subject: a crossing, or a leap of a robot whose legs are known.
        execution: how a world had it.
    """

    subject: Crossing | LeapPlan
    execution: Execution | None = field(default=None, kw_only=True)

    @property
    def name(self) -> str:
        """Name of the course, or of the leap."""
        return (
            self.subject.name if isinstance(self.subject, Crossing) else self.subject.problem.name
        )

    @property
    def robot(self) -> Robot:
        """The robot."""
        subject = self.subject
        return subject.robot if isinstance(subject, Crossing) else subject.problem.robot

    @cached_property
    def motion(self) -> CrossingMotion | LeapRun:
        """The motion as it is planned."""
        subject = self.subject
        return CrossingMotion(subject) if isinstance(subject, Crossing) else LeapRun(subject)

    @cached_property
    def terrain(self) -> tuple[Patch, ...]:
        """Surfaces that are shown."""
        if isinstance(self.subject, Crossing):
            return self.subject.terrain
        leap = self.subject.problem
        return tuple(leap.patch(j, self.subject.choice) for j in range(len(leap.footholds)))

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot."""
        return climber(self.robot)

    @cached_property
    def path_m(self) -> Array:
        """Places of the centre of mass, shape (K, 3) [m]."""
        if self.execution is not None:
            return self.execution.trace.com_m[::20]
        return self.motion.at(np.linspace(0.0, self.motion.duration_s, 161)).com_m

    @cached_property
    def bounds_m(self) -> Array:
        """Lowest and highest coordinates of what is shown, shape (2, 3) [m]."""
        mounts = np.array([limb.shoulder_m for limb in self.robot.limbs])
        bodies = (self.path_m[:, None] + mounts).reshape(-1, 3)
        low, high = bodies.min(axis=0) - ABOUT_M, bodies.max(axis=0) + ABOUT_M
        return np.array([low - MARGIN_M, high + MARGIN_M])

    @cached_property
    def camera(self) -> Camera:
        """From aside of the way."""
        box, ends = self.bounds_m, self.path_m[[0, -1]]
        length = max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)

        def merit(camera: Camera) -> float:
            (first, last), _ = camera.project(ends)
            return float((last - first)[0] / length)

        away_m = max(4.0 * self.shape.size_m, 1.1 * float(np.linalg.norm(box[1] - box[0])))
        return best_view(box.mean(axis=0), away_m, merit, step_deg=15.0, elevations_deg=[18.0])

    @cached_property
    def metres_a_newton(self) -> float:
        """Length of the arrow of a force."""
        return LONGEST * self.shape.size_m / (WEIGHTS * 9.81 * self.robot.mass_kg)

    @cached_property
    def fixed(self) -> Scene:
        """Terrain, and the way of the centre of mass."""
        colour = INK if self.execution is None else REAL
        way = Path(
            pieces_m=polyline(self.path_m), colour=colour, width=1.8, layer=Layer.TOP, lift_m=60.0
        )
        colours = friction_colours([patch.friction for patch in self.terrain])
        return patches(self.terrain, self.bounds_m, colours) + Scene(paths=[way])

    @cached_property
    def _legs(self) -> ToeKinematics:
        return ToeKinematics(self.robot.legs)

    def limbs(self, now: Samples) -> Sequence[Array]:
        """Angles of each leg."""
        assert self.shape.links is not None
        if now.angles_rad is not None:
            return self.shape.links.split(now.angles_rad)
        turn = rotation_of(now.rotation_rad)
        postures = self._legs.solve(
            now.com_m[None], turn[None], now.toes_m[None], now.normals[None], None
        )
        return [angles[0] for angles in postures.angles]

    def at(self, now: Samples) -> Scene:
        """The robot at a time, and the forces of feet that press."""
        turn = rotation_of(now.rotation_rad)
        place = now.com_m if now.origin_m is None else now.origin_m + turn @ self.robot.origin_m
        arrows = [
            self.shape.force(self.shape.limbs[i], toe, self.metres_a_newton * force)
            for i, (toe, force) in enumerate(zip(now.toes_m, now.forces_n, strict=True))
            if float(np.linalg.norm(force)) > 0.01 * 9.81 * self.robot.mass_kg
        ]
        return Scene(bodies=self.shape.bodies(place, turn, self.limbs(now)), arrows=arrows)

    def instant(self, row: int) -> Samples:
        """The sample of the world after a control period."""
        assert self.execution is not None
        trace = self.execution.trace
        planned = self.motion.at(float(trace.frame[row]))
        turn = Rotation.from_matrix(trace.rotation[row]).as_rotvec()
        return Samples(
            com_m=trace.com_m[row],
            velocity_m_s=np.zeros(3),
            rotation_rad=turn,
            rotation_rate_rad_s=np.zeros(3),
            frame=trace.frame[row],
            feet_m=trace.feet_m[row],
            radii_m=planned.radii_m,
            forces_n=trace.forces_n[row],
            foothold=trace.foothold[row],
            normals=planned.normals,
            friction=planned.friction,
            origin_m=trace.origin_m[row],
            angles_rad=trace.angles_rad[row],
            torques_nm=trace.torques_nm[row],
        )

    def pace_at(self, time_s: float) -> float:
        """Pace at which a moment of the motion is shown."""
        motion = self.motion
        if isinstance(motion, LeapRun):
            return LEAPS
        return LEAPS if isinstance(motion.parts[motion.part_at(time_s)], LeapRun) else CLIMBS

    def times_s(self, fps: float = FPS) -> Array:
        """Moments of the motion that a film shows, shape (K,) [s]."""
        times, now = [0.0], 0.0
        while now < self.motion.duration_s:
            now = min(now + self.pace_at(now) / fps, self.motion.duration_s)
            times.append(now)
        return np.array(times)

    def film(self, *, fps: float = FPS) -> Animation:
        """The motion, key frames faster and leaps slower than they are."""
        times = self.times_s(fps)
        if self.execution is None:
            shown = [self.motion.at(float(time_s)) for time_s in times]
        else:
            frames = self.execution.trace.frame
            rows = np.minimum(np.searchsorted(frames, times), len(frames) - 1)
            shown = [self.instant(int(row)) for row in rows]
        notes = [
            f"{time_s:.2f} s, {self._word(time_s, now)}, at {self.pace_at(time_s):g} times its pace   ·   {SCALE}"
            for time_s, now in zip(times, shown, strict=True)
        ]
        where = "" if self.execution is None else f" in {self.execution.world}"
        return Animation(
            fixed=self.fixed,
            moments=[self.at(now) for now in shown],
            step_s=1.0 / fps,
            camera=self.camera,
            title=f"{self.name}{where}",
            legend=self.legend,
            notes=notes,
        )

    def _word(self, time_s: float, now: Samples) -> str:
        """Word for what goes on at a time."""
        if self.pace_at(time_s) == CLIMBS:
            return "key frames"
        return "leap, stance" if now.stands.any() else "leap, flight"

    @property
    def legend(self) -> list[tuple[Colour, str]]:
        """Legend of the colours, for a page."""
        way = "path that was gone" if self.execution is not None else "path of the centre of mass"
        return [
            (INK if self.execution is None else REAL, way),
            (ACCENT, "contact forces"),
        ]

    def scene(self) -> Scene:
        """The whole picture: the robot in full at the end, and as ghosts where parts begin and in the
        air.
        """
        motion = self.motion
        last = motion.at(motion.duration_s)
        if self.execution is not None:
            return self.fixed + self.at(self.instant(len(self.execution.trace.time_s) - 1))
        result = self.fixed + self.at(last)
        times = [0.0]
        for begin, end in motion.committed_s:
            times += [begin, 0.6 * begin + 0.4 * end]
        for time_s in times:
            now = motion.at(time_s)
            result += self.shape.ghost(now.com_m, rotation_of(now.rotation_rad), self.limbs(now))
        return result


@DEFAULT_STYLE
def draw_crossing(
    subject: Crossing | LeapPlan,
    execution: Execution | None = None,
    *,
    caption: str = "",
    size_px: Size = SIZE_PX,
) -> Figure:
    """Draw a crossing: the robot at its end, and ghosts of it where leaps begin and in the air; or the
    end of its execution, or of a leap's.
    """
    view = CrossingView(subject, execution=execution)
    figure = sheet(size_px, SIZE_PX)
    Still(view.scene(), view.camera).paint(plain_axes(figure, 10.0, 10.0, 92.0))
    words = [f"{view.motion.duration_s:.1f} s", SCALE]
    if isinstance(subject, Crossing):
        words.insert(
            0, ", ".join("leap" if isinstance(p, LeapPlan) else "climb" for p in subject.parts)
        )
    if execution is not None:
        words.insert(0, f"{execution.world}: {'done' if execution.succeeded else 'failed'}")
    headline(figure, caption or view.name, "   ·   ".join(words))
    return figure


def crossing_frames(
    subject: Crossing | LeapPlan,
    execution: Execution | None = None,
    *,
    size_px: Size = FILM_PX,
) -> tuple[Iterator[Frame], int]:
    """The frames of a film, uint8 of shape (H, W, 3), one by one, ``FPS`` a second, and how many."""
    view = CrossingView(subject, execution=execution)
    return film_frames(view.film(), size_px), len(view.times_s())
