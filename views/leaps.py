"""Pictures, pages and films of leaps, and of crossings with leaps in them, as they are planned or as a
world had them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from stancekit.planners.answer.motion import Motion
from stancekit.planners.arguments import cached_property
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Played, Samples
from stancekit.planners.robot.model import Robot
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.patch import contact_frames
from stancekit.runner.motion.time_parametrization import streamed
from stancekit.runner.report import Execution

from .plans import FPS, LONGEST, MARGIN_M, View, aside, offered, outline, window
from .robots import cone, cone_body
from .scene import (
    Animation,
    Camera,
    Colour,
    DrawnBody,
    Label,
    Layer,
    Mesh,
    Path,
    Scene,
    Sphere,
    polyline,
)
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    GOAL,
    INK,
    REAL,
    Size,
    friction_colours,
    headline,
    leg_colour,
)
from .strips import picture, run_strips
from .terrain import SCALE, Entry, patches

_CLIMBS, _LEAPS = 4.0, 0.25
"""Numbers of films: how many times their pace key frames are shown, and
leaps."""
_ABOUT_S = 0.6
"""So long before and after a flight is its leap [s]."""
_ABOUT_M = 0.35
"""So much of the terrain is shown about the way [m]."""
_LOOK_S, _PUSHES_S = 0.005, 0.02
"""The motion is looked at so often, and drawn so long before a flight as it takes off [s]."""
UNJUDGED = "joints and bodies are not judged"
"""Words of every picture for a leap whose robot has limbs alone."""
_JUDGED = "the motion that joints and bodies are judged by"
"""Words of it for a leap of a robot whose legs are known."""


@dataclass(frozen=True, eq=False)
class LeapView(View):
    """View of a leap or a crossing, with viewpoint and colours.

    Arguments:
        subject: the leap, or the crossing.
        execution: measured motion in a world, in place of the planned one.
    """

    subject: Motion[Any]
    execution: Execution | None = field(default=None, kw_only=True)

    @property
    def robot(self) -> Robot:
        """The robot that leaps."""
        return self.subject.robot

    @property
    def name(self) -> str:
        """Name of the leap, or of the course."""
        return self.subject.name

    @property
    def parts(self) -> Sequence[Motion[Any]]:
        """The climbs and leaps, in order."""
        return self.subject.parts or (self.subject,)

    @property
    def judged(self) -> str:
        """Sentence about joints and bodies."""
        return _JUDGED if self.robot.own else UNJUDGED

    @cached_property
    def motion(self) -> Played:
        """Played that ``run`` streams."""
        return streamed(self.subject)

    @cached_property
    def times_s(self) -> Array:
        """Moments that are looked at, shape (T,) [s]."""
        return np.linspace(0.0, self.motion.duration_s, 2 + int(self.motion.duration_s / _LOOK_S))

    @cached_property
    def rows(self) -> Samples:
        """The motion at these moments."""
        return self.motion.at(self.times_s)

    @cached_property
    def flights_s(self) -> list[tuple[float, float]]:
        """When each flight begins and ends [s]."""
        air = ~np.any(self.rows.stands, axis=1)
        edges = np.flatnonzero(np.diff(air.astype(int), prepend=0, append=0)).tolist()
        last = len(air) - 1
        return [
            (float(self.times_s[first]), float(self.times_s[min(end, last)]))
            for first, end in zip(edges[::2], edges[1::2], strict=True)
        ]

    @cached_property
    def offered(self) -> list[Patch]:
        """Surfaces that are shown: the terrain, or every patch that a leap's toes were offered."""
        return list(offered(self.subject.problem))

    @cached_property
    def chosen(self) -> list[tuple[int, Patch]]:
        """Limb and patch of every foothold of every part; later parts begin where feet stand
        already.
        """
        names = self.robot.limb_names
        return [
            (names.index(foothold.limb), part.problem.patch(p, part.choice))
            for part in self.parts
            for p, foothold in enumerate(part.problem.footholds)
            if foothold.frame or part is self.parts[0]
        ]

    @cached_property
    def friction(self) -> ScalarMappable:
        """Colours of the surfaces."""
        return friction_colours([patch.friction for patch in self.offered])

    @property
    def goal_m(self) -> Array:
        """Place where the centre of mass is to end, shape (3,) [m]."""
        return np.asarray(self.parts[-1].problem.goal_m)

    @cached_property
    def path_m(self) -> Array:
        """Places of the centre of mass, shape (K, 3) [m]."""
        if self.execution is not None:
            return self.execution.trace.com_m[::20]
        return self.rows.com_m[::5]

    @cached_property
    def bounds_m(self) -> Array:
        """Lowest and highest coordinates of what is shown, shape (2, 3) [m]: about the bodies, and a
        leap's patches.
        """
        mounts = np.array([limb.shoulder_m for limb in self.robot.limbs])
        points, about_m = np.concatenate(self.path_m[:, None] + mounts), _ABOUT_M
        if not self.subject.has("parts"):
            points = np.concatenate([*(patch.vertices_m for patch in self.offered), points])
            about_m = MARGIN_M
        return np.array([points.min(axis=0) - about_m, points.max(axis=0) + about_m])

    @cached_property
    def camera(self) -> Camera:
        """From aside of the way, where the chosen patches show their faces."""
        faced = [patch for _, patch in self.chosen]
        return aside(self.bounds_m, self.path_m, faced, self.shape.size_m)

    @cached_property
    def metres_a_newton(self) -> float:
        """Length of a force's arrow per newton, so that the largest planned force is drawn as a
        fixed share of the robot's size.
        """
        largest = float(np.linalg.norm(self.rows.forces_n, axis=2).max())
        return LONGEST * self.shape.size_m / max(largest, 1e-9)

    @cached_property
    def fixed(self) -> Scene:
        """Surfaces, and the way over them."""
        return patches(self.offered, self.bounds_m, self.friction) + self.way

    @cached_property
    def way(self) -> Scene:
        """The chosen surfaces framed, the way of the centre of mass, and the goal."""
        way = Path(
            pieces_m=polyline(self.path_m),
            colour=INK if self.execution is None else REAL,
            width=1.8,
            layer=Layer.TOP,
            lift_m=60.0,
            halo=True,
        )
        mark = DrawnBody(
            name="goal",
            shape=Sphere(0.06 * self.shape.size_m),
            position_m=self.goal_m,
            colour=GOAL,
            edge="white",
            layer=Layer.TOP,
            lift_m=70.0,
        )
        outlines = [outline(patch, leg_colour(limb)) for limb, patch in self.chosen]
        return Scene(paths=[*outlines, way], bodies=[mark])

    def at(self, now: Samples) -> Scene:
        """The robot at a time, and the forces of feet that stand in cones of their friction."""
        bodies = self.bodies(now)
        if self.subject.has("timing"):
            bodies += [self._windows[int(p)] for p in np.unique(now.foothold[now.stands])]
        loaded = now.stands & (np.asarray(now.along_n) > 0.0)
        for i in np.flatnonzero(loaded).tolist():
            number, shape = self._cone(now.normals[i], float(now.friction[i]))
            bodies.append(cone_body(f"cone {i} {number}", shape, now.toes_m[i]))
        return Scene(bodies=bodies, arrows=self.forces(now))

    @cached_property
    def _windows(self) -> list[DrawnBody]:
        """The chosen patches, framed in the colour of their limb."""
        return [
            window(
                f"chosen {p}",
                patch,
                tuple(self.friction.to_rgba(np.array(patch.friction))[:3]),
                leg_colour(limb),
            )
            for p, (limb, patch) in enumerate(self.chosen)
        ]

    def _cone(self, normal: Array, friction: float) -> tuple[int, Mesh]:
        """The cone over a surface, and its number among those that were made, each once."""
        key = (*normal.round(6).tolist(), round(friction, 6))
        if key not in self._cones:
            frame = contact_frames(normal, np.eye(3)[np.argmin(np.abs(normal))])
            self._cones[key] = (
                len(self._cones),
                cone(min(friction, 4.0), frame, 0.3 * self.shape.size_m),
            )
        return self._cones[key]

    _cones = cached_property(lambda self: dict[tuple[float, ...], tuple[int, Mesh]]())

    def measured(self, execution: Execution, row: int) -> Samples:
        """The sample of the world after a control period."""
        trace = execution.trace
        return trace.sample(row, self.motion.at(float(trace.frame[row])))

    def scene(self) -> Scene:
        """The whole picture: the robot in full as it first takes off, and as ghosts at its ends and in
        the air; at the end of an execution.
        """
        labels = [Label(name="goal", position_m=self.goal_m, text="goal", colour=GOAL)]
        result = self.fixed + Scene(labels=labels)
        if self.execution is not None:
            last = len(self.execution.trace.time_s) - 1
            return result + self.at(self.measured(self.execution, last))
        shown = [0.0, self.motion.duration_s]
        for k, (begin, end) in enumerate(self.flights_s):
            shown += [0.6 * begin + 0.4 * end, *([begin - _PUSHES_S] if k else [])]
        full = max(self.flights_s[0][0] - _PUSHES_S, 0.0) if self.flights_s else 0.0
        for time_s in shown:
            result += self.ghost(self.motion.at(time_s))
        return result + self.at(self.motion.at(full))

    def pace_at(self, time_s: float) -> float:
        """Pace at which a moment of the motion is shown."""
        if self.subject.has("timing") and not self.flights_s:
            return _LEAPS
        near = any(begin - _ABOUT_S <= time_s < end + _ABOUT_S for begin, end in self.flights_s)
        return _LEAPS if near else _CLIMBS

    def film_times_s(self, fps: float = FPS) -> Array:
        """Moments of the motion that a film shows, shape (K,) [s]."""
        times, now = [0.0], 0.0
        while now < self.motion.duration_s:
            now = min(now + self.pace_at(now) / fps, self.motion.duration_s)
            times.append(now)
        return np.array(times)

    def film(self, *, fps: float = FPS) -> Animation:
        """The motion, key frames faster and leaps slower than they are; or its execution."""
        times, execution = self.film_times_s(fps), self.execution
        if execution is None:
            where, judged = "", f"{self.judged}   ·   "
            shown = [self.motion.at(float(time_s)) for time_s in times]
        else:
            where, judged, frames = f" in {execution.world}", "", execution.trace.frame
            rows = np.minimum(np.searchsorted(frames, times), len(frames) - 1).tolist()
            shown = [self.measured(execution, row) for row in rows]
        notes = [
            f"{time_s:.2f} s, {self._word(time_s, now)}, at {self.pace_at(time_s):g} times its pace"
            f"   ·   {judged}{SCALE}"
            for time_s, now in zip(times, shown, strict=True)
        ]
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
        if self.pace_at(time_s) == _CLIMBS:
            return "key frames" if self.subject.has("parts") else "rest"
        return "stance" if now.stands.any() else "flight"

    @property
    def legend(self) -> list[tuple[Colour, str]]:
        """Legend of the colours, for a page."""
        way = (
            (INK, "path of the centre of mass")
            if self.execution is None
            else (REAL, "path that was gone")
        )
        return [
            way,
            (ACCENT, "contact forces in friction cones"),
            (GOAL, "goal"),
            *(
                (leg_colour(k), f"patch chosen for {name}")
                for k, name in enumerate(self.robot.limb_names)
            ),
        ]

    @property
    def words(self) -> list[str]:
        """Words below the title of the picture."""
        result = list[str]()
        if self.execution is not None:
            done = "done" if self.execution.succeeded else "failed"
            result.append(f"{self.execution.world}: {done}")
        if self.subject.has("parts"):
            result.append(", ".join(self.subject.part_words))
        for begin, end in self.flights_s:
            result.append(f"takes off at {begin:.2f} s, flies for {end - begin:.2f} s")
        return [*result, *([] if self.execution else [self.judged]), SCALE]


@DEFAULT_STYLE
def draw_leap(
    subject: Motion[Any],
    execution: Execution | None = None,
    *,
    caption: str = "",
    size_px: Size | None = None,
) -> Figure:
    """Draw a leap, or a crossing: the robot as it takes off, ghosts of it in the air and at its ends,
    and its way; or the end of its execution.
    """
    view = LeapView(subject, execution=execution)
    entries = [
        Entry(text="cone", sign="cone", colour=ACCENT),
        Entry(text="centre of mass", sign="path")
        if execution is None
        else Entry(text="path that was gone", sign="path", colour=REAL),
        Entry(text="chosen", sign="box", colour=leg_colour(0), fill="#d6efd0"),
    ]
    figure = picture(
        view.scene(),
        view.camera,
        view.friction,
        entries,
        () if execution is None else run_strips(execution),
        metres_a_newton=view.metres_a_newton,
        size_px=size_px,
    )
    headline(figure, caption or view.name, "   ·   ".join(view.words))
    return figure
