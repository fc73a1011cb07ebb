"""Pictures and films of a plan: terrain, chosen patches, the robot with its forces, and its path to
the goal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from stancekit.planners.answer.plan import Plan
from stancekit.planners.cached import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Motion, Samples
from stancekit.planners.motion.plan_motion import PlanMotion
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.rotation import rotation_of
from stancekit.planners.robot.toes import ToeKinematics
from stancekit.planners.terrain import Patch
from stancekit.planners.verify.margins import support_region
from stancekit.runner.motion.stream import streamed
from stancekit.runner.motion.time_parametrization import RATE_HZ

from .camera import Camera, best_view
from .film import film_frames
from .legend import Entry, draw_legend, force_entry
from .robots import RobotShape, climber, cone, cone_body, limb_of_three
from .scene import ON_M, Animation, Colour, DrawnBody, Label, Layer, Path, Scene
from .shapes import Mesh, Sphere, dashed, hull, lines_told, polyline, ring, unit
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    GUIDE,
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
from .terrain import ICE, ICE_EDGE, ICY, SCALE, patches, tint
from .video import Frame

GOAL, SUPPORT = "#e8a317", "#2a7f62"
LONGEST = 0.6
"""Length of the arrow of the largest force, in units of the mean reach."""
MARGIN_M = 0.08
"""Terrain is shown so far beyond everywhere that the robot goes."""
FILM_PX = (960, 720)
FPS, STEP_S, HOLD_S = 20.0, 1.2, 0.5
"""Numbers of films: pictures a second, seconds per step, and those that the beginning and the end
take in addition."""
GHOSTS = 3
"""Key frames beside the one in full, at most."""


@dataclass(frozen=True, eq=False)
class PlanView:
    """A plan as something to look at, with the viewpoint and the colours of its pictures.

    Arguments:
        drawn_as: what its robot looks like, where that is known already.
    """

    plan: Plan
    drawn_as: RobotShape | None = field(default=None, kw_only=True)

    @cached_property
    def motion(self) -> Motion:
        """Motion that ``run`` streams."""
        return streamed(self.plan)

    @cached_property
    def keys(self) -> PlanMotion:
        """The key frames as they are planned, and the path of body and feet through them."""
        return PlanMotion(self.plan, uncarried=True)

    @cached_property
    def friction(self) -> ScalarMappable:
        """Colours of the surfaces."""
        course = self.plan.problem
        terrain = course.terrain or tuple(foothold.candidates[0] for foothold in course.footholds)
        return friction_colours([patch.friction for patch in terrain])

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot."""
        return self.drawn_as or climber(self.plan.problem.robot)

    @cached_property
    def chosen(self) -> list[Patch]:
        """The patch of every foothold."""
        course = self.plan.problem
        return [course.patch(p, self.plan.choice) for p in range(len(course.footholds))]

    @cached_property
    def bounds_m(self) -> Array:
        """Lowest and highest coordinates of what is shown, shape (2, 3): chosen patches, bodies,
        goal, and a margin.
        """
        course = self.plan.problem
        mounts = np.array([limb.shoulder_m for limb in course.robot.limbs])
        bodies = (self.plan.com_m[:, None] + mounts).reshape(-1, 3)
        points = np.concatenate(
            [*(patch.vertices_m for patch in self.chosen), bodies, course.goal_m[None]]
        )
        return np.array([points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M])

    @cached_property
    def camera(self) -> Camera:
        """Direction of view in which the chosen patches show their faces and the path is seen from
        the side.
        """
        box, com = self.bounds_m, self.plan.com_m
        centres, normals = np.array(
            [(patch.centre_m, patch.normal) for patch in self.chosen]
        ).swapaxes(0, 1)
        length = max(float(np.linalg.norm(com[-1] - com[0])), 1e-9)

        def merit(camera: Camera) -> float:
            (x, y), _ = camera.project(com[[0, -1]])
            seen = (y - x) / length
            faces = np.clip(camera.facing(centres, normals), -0.15, 0.15)
            return float(faces.mean() + 0.10 * abs(seen[0]) + 0.05 * seen[0] + 0.10 * abs(seen[1]))

        away_m = max(4.5 * self.shape.size_m, 1.25 * float(np.linalg.norm(box[1] - box[0])))
        return best_view(box.mean(axis=0), away_m, merit, step_deg=7.5, elevations_deg=[18.0, 25.0])

    @cached_property
    def metres_a_newton(self) -> float:
        """The largest force of the plan is an arrow of so much of the robot's size."""
        return (
            LONGEST
            * self.shape.size_m
            / max(float(np.linalg.norm(self.plan.forces_n, axis=2).max()), 1e-9)
        )

    @cached_property
    def fixed(self) -> Scene:
        """Terrain, and the way over it."""
        return patches(self.plan.problem.terrain, self.bounds_m, self.friction) + self.way

    @cached_property
    def way(self) -> Scene:
        """The path of the centre of mass with a dot at every key frame, chosen patches in outline,
        and the goal.
        """
        course, com, size = self.plan.problem, self.plan.com_m, self.shape.size_m
        path = Path(
            pieces_m=polyline(com), colour=INK, width=1.8, layer=Layer.TOP, lift_m=60.0, halo=True
        )
        sizes = [(f"com {k}", at, 0.022, INK) for k, at in enumerate(com)] + [
            ("goal", course.goal_m, 0.06, GOAL)
        ]
        marks = [
            DrawnBody(
                name=name,
                shape=Sphere(share * size),
                position_m=at,
                colour=colour,
                edge="white",
                layer=Layer.TOP,
                lift_m=70.0,
            )
            for name, at, share, colour in sizes
        ]
        outlines = [
            Path(
                pieces_m=ring(patch.vertices_m + ON_M * patch.normal),
                colour=colour,
                opacity=0.4,
                width=0.9,
                layer=Layer.TERRAIN,
                lift_m=8.0,
            )
            for patch, colour in zip(self.chosen, self.colours, strict=True)
        ]
        guide = Path(
            pieces_m=dashed(course.com_nominal_m),
            colour=GUIDE,
            width=1.2,
            layer=Layer.TOP,
            lift_m=50.0,
        )
        tried = [
            Path(pieces_m=dashed(line), colour=GUIDE, opacity=0.35, layer=Layer.TOP, lift_m=50.0)
            for line in self.tried_m
        ]
        return Scene(paths=[*outlines, *tried, guide, path], bodies=marks)

    @property
    def tried_m(self) -> list[Array]:
        """Nominal paths of the body that the planner tried and gave up, each of L points, shape (L,
        3) [m].
        """
        return lines_told(self.plan.provenance.get("tried_m"))

    def chosen_at(self, now: Samples) -> list[DrawnBody]:
        """The chosen patches that feet stand on in full colour; of the others ``fixed`` has the
        outlines.
        """
        return [self._window(int(p)) for p in np.unique(now.foothold[now.stands])]

    @cached_property
    def colours(self) -> list[str]:
        """Colour of the limb of every foothold."""
        names = self.plan.problem.robot.limb_names
        return [leg_colour(names.index(foothold.limb)) for foothold in self.plan.problem.footholds]

    def _window(self, foothold: int) -> DrawnBody:
        """The chosen patch of a foothold, framed in the colour of its limb; made once."""
        if foothold not in self._windows:
            patch = self.chosen[foothold]
            self._windows[foothold] = DrawnBody(
                name=f"chosen {foothold}",
                shape=hull(np.vstack([patch.vertices_m, patch.vertices_m + ON_M * patch.normal])),
                position_m=np.zeros(3),
                colour=self.friction.to_rgba(np.array(patch.friction))[:3],
                edge=self.colours[foothold],
                opacity=0.55,
                layer=Layer.TERRAIN,
                lift_m=9.0,
            )
        return self._windows[foothold]

    _windows = cached_property(lambda self: dict[int, DrawnBody]())

    def limbs(self, now: Samples) -> Sequence[Array]:
        """Poses of the limbs: angles of a URDF's; else where its joints are, shape (J, 3) [m], the
        foot last.

        Where no angles are known they are found, and those of limbs without a file are a guess, for
        the eye.
        """
        if self.shape.links is not None:
            return (
                self._angles(now)
                if now.angles_rad is None
                else self.shape.links.split(now.angles_rad)
            )
        if now.angles_rad is not None and now.origin_m is not None and self._kinematics is not None:
            return list(
                now.origin_m
                + self._kinematics.chains(now.angles_rad) @ rotation_of(now.rotation_rad).T
            )
        rotation = np.eye(3) + np.cross(np.eye(3), now.rotation_rad)  # as the planner has it
        return [
            limb_of_three(now.com_m + arm, toe, unit(arm), limb.reach_m)
            for limb, toe in zip(self.plan.problem.robot.limbs, now.toes_m, strict=True)
            for arm in [rotation @ limb.shoulder_m]
        ]

    def _angles(self, now: Samples) -> list[Array]:
        """Angles of each leg of a URDF's robot, near those of the key frames around; feet face
        their surfaces.
        """
        model, key = self.plan.problem.robot.source.own_model(), self.plan.joints_rad
        near = None if key is None else between(key, now.frame)[None]
        turn = rotation_of(now.rotation_rad)
        postures = ToeKinematics(model).solve(
            now.com_m[None], turn[None], now.toes_m[None], now.normals[None], near
        )
        return [angles[0] for angles in postures.angles]

    @cached_property
    def _kinematics(self) -> Kinematics | None:
        """Legs that are drawn up for limbs; None where there are none, or pinocchio is not
        installed.
        """
        try:
            return Kinematics(self.plan.problem.robot)
        except InvalidInput:
            return None

    def _body(self, now: Samples) -> tuple[Array, Array]:
        """Pose in which the body is drawn, p_WB and R_WB: where its link is, or else at the centre
        of mass.
        """
        turn = rotation_of(now.rotation_rad)
        if now.origin_m is None:
            return now.com_m, turn
        return now.origin_m + turn @ self.plan.problem.robot.origin_m, turn

    def at(self, now: Samples, *, cone_m: float | None = None) -> Scene:
        """The robot at a time, and the forces of feet that stand, in cones as high as the normal
        force or so.
        """
        bodies = [*self.shape.bodies(*self._body(now), self.limbs(now)), *self.chosen_at(now)]
        arrows = []
        for i, (toe, force) in enumerate(zip(now.toes_m, now.forces_n, strict=True)):
            foothold = int(now.foothold[i])
            height = float(force @ now.normals[i]) * self.metres_a_newton
            if foothold >= 0 and height > 1e-9:
                shape = self._cone(foothold, height) if cone_m is None else self._cones[foothold]
                bodies.append(cone_body(f"cone {foothold}", shape, toe))
                arrows.append(
                    self.shape.force(self.shape.limbs[i], toe, self.metres_a_newton * force)
                )
        return Scene(bodies=bodies, arrows=arrows, paths=self.support(now))

    def support(self, now: Samples) -> list[Path]:
        """Region in which the centre of mass may be before its contacts no longer carry it, and
        where it is, at their height.
        """
        frame, standing = int(now.frame + 1e-9), now.toes_m[now.stands]
        region = self._region(frame)
        if not len(region) or not len(standing):
            return []
        height = float(standing[:, 2].mean())
        corners = np.column_stack([region, np.full(len(region), height)])
        under = np.array([[now.com_m, [*now.com_m[:2], height]]])
        return [
            Path(pieces_m=ring(corners), colour=SUPPORT, width=1.6, layer=Layer.TOP, lift_m=20.0),
            Path(
                pieces_m=under, colour=SUPPORT, width=0.9, opacity=0.7, layer=Layer.TOP, lift_m=20.0
            ),
        ]

    def _region(self, frame: int) -> Array:
        """The support region of the tightest stance at a key frame, shape (K, 2) [m]; worked out
        once.
        """
        if frame not in self._regions:
            of_frame = [stance for stance in self.plan.problem.stances if stance.frame == frame]
            regions = [support_region(self.plan, stance) for stance in of_frame]
            self._regions[frame] = min(regions, key=_area, default=np.zeros((0, 2)))
        return self._regions[frame]

    _regions = cached_property(lambda self: dict[int, Array]())

    def _cone(self, foothold: int, height_m: float) -> Mesh:
        """The friction cone of a foothold; a wide one is cut to what the picture has room for."""
        patch = self.chosen[foothold]
        return cone(min(patch.friction, 1.2 * self.shape.size_m / height_m), patch.frame, height_m)

    @cached_property
    def _cones(self) -> list[Mesh]:
        return [self._cone(p, 0.3 * self.shape.size_m) for p in range(len(self.chosen))]

    def ghost(self, now: Samples) -> Scene:
        """Trunk and limbs as a drawing in thin lines."""
        return self.shape.ghost(*self._body(now), self.limbs(now))

    @cached_property
    def tracks(self) -> Scene:
        """The path of every toe from foothold to foothold, dashed."""
        course, paths = self.plan.problem, list[Path]()
        for p, foothold in enumerate(course.footholds):
            if foothold.frame:
                line = self.keys.path.swing(p, np.linspace(0.0, 1.0, 26))
                paths.append(Path(pieces_m=dashed(line), colour=self.colours[p], opacity=0.55))
        return Scene(paths=paths)

    def names(self, now: Samples) -> Scene:
        """The goal, and every limb with its force."""
        labels = [Label(name="goal", position_m=self.plan.problem.goal_m, text="goal", colour=GOAL)]
        for k, (limb, toe, force) in enumerate(
            zip(self.shape.limbs, now.toes_m, now.forces_n, strict=True)
        ):
            text = f"{limb} {np.linalg.norm(force):.0f} N"
            labels.append(Label(name=limb, position_m=toe, text=text, colour=leg_colour(k)))
        return Scene(labels=labels)

    def scene(self, frame: int) -> Scene:
        """The whole picture, the robot in full at one key frame and as ghosts at some others."""
        now = self.keys.key(frame)
        result = self.fixed + self.tracks + self.at(now) + self.names(now)
        for k in ghosts(self.plan, frame):
            result += self.ghost(self.keys.key(k))
        return result

    def film(
        self, *, fps: float = FPS, step_s: float = STEP_S, hold_s: float = HOLD_S
    ) -> Animation:
        """The plan's motion at an even pace, as much faster than it is run as lets each step last
        ``step_s``.
        """
        times = self.shown_s(frame_count(self.plan, fps=fps, step_s=step_s, hold_s=hold_s))
        speed = float(times[-1]) * fps / (len(times) - 1)
        shown = [self.motion.at(float(time_s)) for time_s in times]
        last, height = self.plan.problem.frames - 1, 0.3 * self.shape.size_m
        return Animation(
            fixed=self.fixed,
            moments=[self.at(each, cone_m=height) for each in shown],
            step_s=1.0 / fps,
            camera=self.camera,
            title=f"{self.plan.problem.name}, at {speed:.2g} times its pace",
            legend=self.legend,
            notes=[f"key frame {int(each.frame + 1e-9)} of {last}   ·   {SCALE}" for each in shown],
        )

    def between_keys(self, progress: float) -> Samples:
        """Body and feet at a fractional key frame: at 1.5 half of the time between key frames 1 and
        2 is over.
        """
        reached = self.keys.reached_s
        return self.keys.at(float(np.interp(progress, np.arange(len(reached)), reached)))

    def shown_s(self, count: int) -> Array:
        """Times of ``count`` pictures, spread evenly over the motion and rounded to rows that are
        streamed, shape (count,) [s].
        """
        return np.round(np.linspace(0.0, self.motion.duration_s, count) * RATE_HZ) / RATE_HZ

    @property
    def legend(self) -> list[tuple[Colour, str]]:
        """Legend of the colours, for a page."""
        rows = [
            (INK, "path of the centre of mass"),
            (GUIDE, "guide path, dashed; ways that were tried, faint"),
            (SUPPORT, "where contacts carry the centre of mass"),
            (ACCENT, "contact forces in friction cones"),
            (GOAL, "goal"),
        ]
        for friction in sorted({patch.friction for patch in self.plan.problem.terrain})[:6]:
            words = f"ice, μ = {friction:g}" if friction < ICY else f"friction μ = {friction:g}"
            rows.append((tint(friction, self.friction), words))
        return rows


def _area(corners: Array) -> float:
    """Area of a polygon whose corners are in order, shape (K, 2) [m²]."""
    x, y = corners.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


@DEFAULT_STYLE
def draw_plan(
    plan: Plan,
    *,
    frame: int | None = None,
    caption: str = "",
    note: str = "",
    size_px: Size | None = None,
) -> Figure:
    """Draw a plan over its course.

    Arguments:
        frame: the key frame at which the robot is drawn in full, with its contact forces in their
            friction cones; the last one unless another is named. Some of the others are ghosts.
            Surfaces are in tints of their friction, icy ones in pale blue with glints, and those
            between the viewer and the robot are glass; the patches that the plan chose are framed
            in the colour of their limb.
        caption, note: title, and what the line below it says first.
        size_px: width and height; as high as the scene asks for at the usual width where it is
            None.

    Raises:
        InvalidInput: for a frame that there is not.
    """
    frames = plan.problem.frames
    shown = frames - 1 if frame is None else frame
    if not 0 <= shown < frames:
        raise InvalidInput(f"frame: expected 0 to {frames - 1}, got {shown}")
    view = PlanView(plan)
    still = Still(view.scene(shown), view.camera)
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
        Entry(text="its support", sign="path", colour=SUPPORT),
        Entry(text="chosen", sign="box", colour=leg_colour(0), fill="#d6efd0"),
    ]
    if any(patch.friction < ICY for patch in plan.problem.terrain):
        entries.append(Entry(text="ice, μ = 0", sign="ice", colour=ICE_EDGE, fill=ICE))
    draw_legend(figure, 12.0, entries, view.friction)
    to_goal_mm = 1e3 * float(np.linalg.norm(plan.com_m[-1] - plan.problem.goal_m))
    words = [
        f"the robot at key frame {shown} of {frames - 1}",
        f"{to_goal_mm:.0f} mm from goal at the end",
        SCALE,
    ]
    title = "   ·   ".join(filter(None, (note, *words)))
    headline(figure, caption or f"{plan.problem.name}: {frames} key frames", title)
    return figure


def plan_frames(plan: Plan, *, size_px: Size = FILM_PX) -> Iterator[Frame]:
    """The frames of a film of the plan, uint8 of shape (H, W, 3), one by one, ``FPS`` a second."""
    return film_frames(PlanView(plan).film(), size_px)


def frame_count(
    plan: Plan, *, fps: float = FPS, step_s: float = STEP_S, hold_s: float = HOLD_S
) -> int:
    """Pictures of a film of the plan."""
    return round(fps * (step_s * (plan.problem.frames - 1) + 2.0 * hold_s)) + 1


def ghosts(plan: Plan, shown: int) -> list[int]:
    """Key frames to show beside one, evenly spread and the first among them."""
    others = np.linspace(0, plan.problem.frames - 1, GHOSTS + 1).round().astype(int).tolist()
    return sorted(set(others) - {shown})[:GHOSTS]


def between(key: Array, frame: Array) -> Array:
    """A row between those of key frames, on the straight line, shape (J,)."""
    first = int(frame)
    then = min(first + 1, len(key) - 1)
    return np.asarray(key[first] + (frame - first) * (key[then] - key[first]))
