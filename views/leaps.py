"""Pictures, pages and films of a leap: patches, the body on its way through the air, and the forces
of its legs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from stancekit.planners.answer.leap_plan import LeapPlan
from stancekit.planners.cached import cached_property
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.leap_motion import LeapMotion
from stancekit.planners.motion.leap_run import LeapRun
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.rotation import rotation_of
from stancekit.planners.robot.toes import ToeKinematics
from stancekit.planners.terrain import Patch

from .camera import Camera, best_view
from .film import film_frames
from .legend import Entry, draw_legend, force_entry
from .plans import FILM_PX, GOAL, LONGEST, MARGIN_M
from .robots import RobotShape, climber, cone, cone_body, limb_of_three
from .scene import ON_M, Animation, Colour, DrawnBody, Label, Layer, Path, Scene
from .shapes import Mesh, Sphere, hull, polyline, ring, unit
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    INK,
    SIZE_PX,
    Size,
    friction_colours,
    headline,
    leg_colour,
    plain_axes,
    sheet,
)
from .still import Still
from .terrain import SCALE, patches
from .video import Frame

FPS, PACE, HOLD_S = 25.0, 0.25, 0.4
"""Numbers of films: pictures per second, the pace at which a leap is shown, and for how long its
ends are held [s]."""
UNJUDGED = "joints and bodies are not judged"
"""Words of every picture for a leap whose robot has limbs alone."""
JUDGED = "the motion that joints and bodies are judged by"
"""Words of it for a leap of a robot whose legs are known."""


@dataclass(frozen=True, eq=False)
class LeapView:
    """A leap as something to look at, with the viewpoint and the colours of its pictures.

    Legs of a robot's file are bent by inverse kinematics, those of limbs alone as they might be:
    nobody has judged whether joints can do it.
    """

    plan: LeapPlan

    @cached_property
    def motion(self) -> LeapMotion | LeapRun:
        """The body as its forces move it, and its legs where they are known."""
        has_legs = self.plan.problem.robot.source.own
        return LeapRun(self.plan, settle_s=0.0, rest_s=0.0) if has_legs else LeapMotion(self.plan)

    @property
    def judged(self) -> str:
        """Sentence about joints and bodies."""
        return JUDGED if self.plan.problem.robot.source.own else UNJUDGED

    @cached_property
    def candidates(self) -> list[Patch]:
        """Every patch that a toe was offered, once."""
        offered = {
            id(p): p for foothold in self.plan.problem.footholds for p in foothold.candidates
        }
        return list(offered.values())

    @cached_property
    def chosen(self) -> list[Patch]:
        """The patch of every foothold."""
        leap = self.plan.problem
        return [leap.patch(p, self.plan.choice) for p in range(len(leap.footholds))]

    @cached_property
    def friction(self) -> ScalarMappable:
        """Colours of the surfaces."""
        return friction_colours([patch.friction for patch in self.candidates])

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot."""
        return climber(self.plan.problem.robot)

    @cached_property
    def colours(self) -> list[str]:
        """The limb's colour, by foothold."""
        names = self.plan.problem.robot.limb_names
        return [leg_colour(names.index(foothold.limb)) for foothold in self.plan.problem.footholds]

    @cached_property
    def path_m(self) -> Array:
        """Places of the centre of mass, shape (K, 3) [m]."""
        return self.motion.at(np.linspace(0.0, self.motion.duration_s, 61)).com_m

    @cached_property
    def bounds_m(self) -> Array:
        """Lowest and highest coordinates of what is shown, shape (2, 3) [m]."""
        mounts = np.array([limb.shoulder_m for limb in self.plan.problem.robot.limbs])
        bodies = (self.path_m[:, None] + mounts).reshape(-1, 3)
        points = np.concatenate([*(patch.vertices_m for patch in self.candidates), bodies])
        return np.array([points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M])

    @cached_property
    def camera(self) -> Camera:
        """From aside of the way, where the chosen patches show their faces."""
        box = self.bounds_m
        ends = self.path_m[[0, -1]]
        length = max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
        centres, normals = np.array([(p.centre_m, p.normal) for p in self.chosen]).swapaxes(0, 1)

        def merit(camera: Camera) -> float:
            (first, last), _ = camera.project(ends)
            faces = np.clip(camera.facing(centres, normals), -0.15, 0.15)
            return float(0.5 * faces.mean() + 0.2 * (last - first)[0] / length)

        away_m = max(4.0 * self.shape.size_m, 1.25 * float(np.linalg.norm(box[1] - box[0])))
        return best_view(box.mean(axis=0), away_m, merit, step_deg=7.5, elevations_deg=[15.0, 22.0])

    @cached_property
    def metres_a_newton(self) -> float:
        """Length of the arrow of a force: the largest one is so much of the robot's size."""
        largest = float(np.linalg.norm(self.plan.forces_n, axis=2).max())
        return LONGEST * self.shape.size_m / max(largest, 1e-9)

    @cached_property
    def fixed(self) -> Scene:
        """Every candidate, the chosen ones framed, the way of the centre of mass, and the goal."""
        size, goal = self.shape.size_m, self.plan.problem.goal.com_m
        way = Path(
            pieces_m=polyline(self.path_m),
            colour=INK,
            width=1.8,
            layer=Layer.TOP,
            lift_m=60.0,
            halo=True,
        )
        mark = DrawnBody(
            name="goal",
            shape=Sphere(0.06 * size),
            position_m=goal,
            colour=GOAL,
            edge="white",
            layer=Layer.TOP,
            lift_m=70.0,
        )
        rings = [
            Path(
                pieces_m=ring(patch.vertices_m + ON_M * patch.normal),
                colour=colour,
                width=1.4,
                layer=Layer.TERRAIN,
                lift_m=8.0,
            )
            for patch, colour in zip(self.chosen, self.colours, strict=True)
        ]
        return patches(self.candidates, self.bounds_m, self.friction) + Scene(
            paths=[*rings, way], bodies=[mark]
        )

    def limbs(self, now: Samples) -> Sequence[Array]:
        """Poses of the limbs: angles of a robot's own legs, or where the joints of a limb might
        be.
        """
        robot, turn = self.plan.problem.robot, rotation_of(now.rotation_rad)
        if self.shape.links is not None:
            postures = self._legs.solve(
                now.com_m[None], turn[None], now.toes_m[None], now.normals[None], None
            )
            return [angles[0] for angles in postures.angles]
        return [
            limb_of_three(now.com_m + arm, toe, unit(arm), limb.reach_m)
            for limb, toe in zip(robot.limbs, now.toes_m, strict=True)
            for arm in [turn @ limb.shoulder_m]
        ]

    @cached_property
    def _legs(self) -> ToeKinematics:
        return ToeKinematics(self.plan.problem.robot.legs)

    def at(self, now: Samples) -> Scene:
        """The robot at a time, and the forces of feet that stand in cones of their friction."""
        turn = rotation_of(now.rotation_rad)
        bodies, arrows = self.shape.bodies(now.com_m, turn, self.limbs(now)), []
        for i, (toe, force) in enumerate(zip(now.toes_m, now.forces_n, strict=True)):
            foothold = int(now.foothold[i])
            if foothold >= 0 and float(np.linalg.norm(force)) > 0.0:
                bodies += [
                    self._windows[foothold],
                    cone_body(f"cone {foothold}", self._cones[foothold], toe),
                ]
                arrows.append(
                    self.shape.force(self.shape.limbs[i], toe, self.metres_a_newton * force)
                )
        return Scene(bodies=bodies, arrows=arrows)

    @cached_property
    def _windows(self) -> list[DrawnBody]:
        """The chosen patches, framed in the colour of their limb."""
        return [
            DrawnBody(
                name=f"chosen {p}",
                shape=hull(np.vstack([patch.vertices_m, patch.vertices_m + ON_M * patch.normal])),
                position_m=np.zeros(3),
                colour=self.friction.to_rgba(np.array(patch.friction))[:3],
                edge=self.colours[p],
                opacity=0.55,
                layer=Layer.TERRAIN,
                lift_m=9.0,
            )
            for p, patch in enumerate(self.chosen)
        ]

    @cached_property
    def _cones(self) -> list[Mesh]:
        high = 0.3 * self.shape.size_m
        return [cone(min(patch.friction, 4.0), patch.frame, high) for patch in self.chosen]

    def scene(self) -> Scene:
        """The whole picture: the robot in full as it takes off, and as ghosts at its ends and in
        the air.
        """
        ends, flight = self.plan.times_s, self.flight_s
        full = self.motion.at(max(flight[0] - 1e-6, 0.0))
        result = self.fixed + self.at(full)
        for time_s in (float(ends[0]), 0.5 * (flight[0] + flight[1]), float(ends[-1])):
            now = self.motion.at(time_s)
            result += self.shape.ghost(now.com_m, rotation_of(now.rotation_rad), self.limbs(now))
        labels = [
            Label(name="goal", position_m=self.plan.problem.goal.com_m, text="goal", colour=GOAL)
        ]
        return result + Scene(labels=labels)

    @cached_property
    def flight_s(self) -> tuple[float, float]:
        """When the first flight begins and ends [s]; the whole leap where some limb always
        stands.
        """
        ends = self.plan.times_s
        airborne = (self.plan.problem.holds[self.plan.problem.interval_phases] < 0).all(axis=1)
        k = int(np.argmax(airborne)) if airborne.any() else 0
        return (
            (float(ends[k]), float(ends[k + 1]))
            if airborne.any()
            else (float(ends[0]), float(ends[-1]))
        )

    def film(self, *, fps: float = FPS, pace: float = PACE) -> Animation:
        """The leap's motion, slowed down, with its ends held for a moment."""
        times = film_times(self.plan, fps=fps, pace=pace)
        shown = [self.motion.at(float(time_s)) for time_s in times]
        notes = [
            f"{time_s:.2f} s, {'stance' if now.stands.any() else 'flight'}   ·   {self.judged}   ·   {SCALE}"
            for time_s, now in zip(times, shown, strict=True)
        ]
        return Animation(
            fixed=self.fixed,
            moments=[self.at(now) for now in shown],
            step_s=1.0 / fps,
            camera=self.camera,
            title=f"{self.plan.problem.name}, at {pace:.2g} times its pace",
            legend=self.legend,
            notes=notes,
        )

    @property
    def legend(self) -> list[tuple[Colour, str]]:
        """Legend of the colours, for a page."""
        return [
            (INK, "path of the centre of mass"),
            (ACCENT, "contact forces in friction cones"),
            (GOAL, "goal"),
            *self._limb_colours,
        ]

    @property
    def _limb_colours(self) -> list[tuple[Colour, str]]:
        names = self.plan.problem.robot.limb_names
        return [(leg_colour(k), f"patch chosen for {name}") for k, name in enumerate(names)]


@DEFAULT_STYLE
def draw_leap(plan: LeapPlan, *, caption: str = "", size_px: Size | None = None) -> Figure:
    """Draw a leap: the robot as it takes off, ghosts of it in the air and at its ends, and its
    way.
    """
    view = LeapView(plan)
    still = Still(view.scene(), view.camera)
    low, high = still.frame()
    fitted = (
        SIZE_PX[0],
        int(
            np.clip((SIZE_PX[0] - 48.0) * (high - low)[1] / (high - low)[0] + 162.0, 560.0, 1100.0)
        ),
    )
    figure = sheet(size_px or fitted, fitted)
    scale = still.paint(plain_axes(figure, 24.0, 70.0, 92.0))
    entries = [
        force_entry(scale / view.metres_a_newton, 120.0),
        Entry(text="cone", sign="cone", colour=ACCENT),
        Entry(text="centre of mass", sign="path"),
        Entry(text="chosen", sign="box", colour=leg_colour(0), fill="#d6efd0"),
    ]
    draw_legend(figure, 12.0, entries, view.friction)
    begin, end = view.flight_s
    words = [f"takes off at {begin:.2f} s", f"flies for {end - begin:.2f} s", view.judged, SCALE]
    headline(figure, caption or plan.problem.name, "   ·   ".join(words))
    return figure


def film_times(plan: LeapPlan, *, fps: float = FPS, pace: float = PACE) -> Array:
    """The times of a film's pictures, shape (K,) [s]."""
    last = float(plan.times_s[-1])
    held = np.zeros(round(fps * HOLD_S))
    return np.concatenate([held, np.linspace(0.0, last, round(fps * last / pace) + 1), held + last])


def leap_frames(plan: LeapPlan, *, size_px: Size = FILM_PX) -> Iterator[Frame]:
    """The frames of a film of a leap, uint8 of shape (H, W, 3), one by one, ``FPS`` a second."""
    return film_frames(LeapView(plan).film(), size_px)
