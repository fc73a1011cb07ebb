"""Pictures, pages and films of motions over patches, as they are planned or as a world had them: plans of
key frames, leaps, and crossings with leaps in them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Played, Samples
from stancekit.planners.motion.path import PlanPath
from stancekit.planners.motion.plan_motion import key_sample, plan_motion, reached_s
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.problem import Problem
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.passage import Passage
from stancekit.planners.robot.inverse_kinematics import InverseKinematics, centres_of
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import rotation_of
from stancekit.planners.robot.model import Robot
from stancekit.planners.terrain import Patch
from stancekit.planners.verify.explanation import Relaxation
from stancekit.planners.verify.margins import support_region
from stancekit.runner.log import Trace
from stancekit.runner.motion.time_parametrization import RATE_HZ, streamed
from stancekit.runner.report import Execution

from .film import Frame, film_frames
from .robots import RobotShape, climber, cone, cone_body, force_label, limb_of_three
from .scene import (
    ON_M,
    Animation,
    Arrow,
    Camera,
    Colour,
    DrawnBody,
    Label,
    Layer,
    Mesh,
    Path,
    Scene,
    Sphere,
    best_view,
    dashed,
    lines_told,
    plate,
    polyline,
    ring,
    unit,
)
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    GOAL,
    GUIDE,
    INK,
    REAL,
    Size,
    friction_colours,
    headline,
    leg_colour,
    wrapped,
)
from .strips import Strip, parted, picture, plan_strips, run_strips, strip_svg
from .terrain import ICE, ICE_EDGE, ICY, SCALE, Entry, patches, tint

FPS = 20.0
"""Pictures per second of films."""
_RESTS = 0.01
"""A moment so near to a key frame is that key frame."""


class View(ABC):
    """View of a motion: a picture, a page or a film.

    Joints are where the motion has them. Where it knows none they are found by inverse kinematics,
    and those of limbs without a file are a guess, for the eye.
    """

    film_px: ClassVar[Size] = (854, 480)

    @property
    @abstractmethod
    def motion(self) -> Played:
        """The motion that is shown."""

    @property
    @abstractmethod
    def robot(self) -> Robot:
        """The robot that moves."""

    @property
    @abstractmethod
    def metres_a_newton(self) -> float:
        """Length of the arrow of a force."""

    @abstractmethod
    def film(self) -> Animation:
        """The motion as moments, for a page or a film."""

    def frames(self, film: Animation, size_px: Size | None = None) -> Iterator[Frame]:
        """The frames of ``film``, uint8 of shape (H, W, 3), one by one.

        Raises InvalidInput without MuJoCo or a GL library.
        """
        return film_frames(film, size_px or self.film_px)

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot."""
        return climber(self.robot)

    @property
    @abstractmethod
    def camera(self) -> Camera:
        """Where it is seen from."""

    def near_rad(self, now: Samples) -> Array | None:
        """Angles that unknown joints are sought near, shape (J,) [rad]; None for anywhere."""
        return None

    def guess(self, now: Samples) -> list[Array]:
        """Places of the joints of limbs of which only the reach is known, shape (J, 3) [m] each, the
        foot last.
        """
        turn = rotation_of(now.rotation_rad)
        return [
            limb_of_three(now.com_m + arm, toe, unit(arm), limb.reach_m)
            for limb, toe in zip(self.robot.limbs, now.toes_m, strict=True)
            for arm in [turn @ limb.shoulder_m]
        ]

    def limbs(self, now: Samples) -> Sequence[Array]:
        """Poses of the limbs: angles of a URDF's, shape (n,) [rad]; else where its joints are, shape
        (J, 3) [m], the foot last.
        """
        turn, links = rotation_of(now.rotation_rad), self.shape.links
        if links is not None and now.angles_rad is not None:
            return links.split(now.angles_rad)
        if links is not None:
            body = (now.com_m[None], turn[None], now.toes_m[None], now.normals[None])
            solver, near = InverseKinematics(links.model.legs), self.near_rad(now)
            start = solver.standing if near is None else near
            angles, _ = solver.solve(centres_of(links.model, *body), near=start)
            return links.split(angles[0])
        if now.angles_rad is not None and now.origin_m is not None and self._kinematics is not None:
            return list(now.origin_m + self._kinematics.chains(now.angles_rad) @ turn.T)
        return self.guess(now)

    @cached_property
    def _kinematics(self) -> Kinematics | None:
        """Legs that are drawn up for limbs; None where there are none, or pinocchio is not
        installed.
        """
        return solver_of(self.robot)

    def pose(self, now: Samples) -> tuple[Array, Array]:
        """Pose in which the body is drawn, p_WB and R_WB: where its link is, or else at the centre
        of mass.
        """
        turn = rotation_of(now.rotation_rad)
        if now.origin_m is None:
            return now.com_m, turn
        return now.origin_m + turn @ self.robot.origin_m, turn

    def bodies(self, now: Samples) -> list[DrawnBody]:
        """The robot at a time."""
        return self.shape.bodies(*self.pose(now), self.limbs(now))

    def ghost(self, now: Samples) -> Scene:
        """Trunk and limbs as a drawing in thin lines."""
        return self.shape.ghost(*self.pose(now), self.limbs(now))

    def force_labels(self, now: Samples) -> list[Label]:
        """Every limb with its force."""
        return [
            force_label(k, *limb)
            for k, limb in enumerate(zip(self.shape.limbs, now.toes_m, now.forces_n, strict=True))
        ]

    def forces(self, now: Samples, *, prefix: str = "") -> list[Arrow]:
        """Arrows of the forces of the feet that stand and are loaded."""
        loaded = now.stands & (np.linalg.norm(now.forces_n, axis=1) > 0.0)
        return [
            self.shape.force(
                prefix + self.shape.limbs[k],
                now.toes_m[k],
                self.metres_a_newton * now.forces_n[k],
            )
            for k in np.flatnonzero(loaded).tolist()
        ]


def solver_of(robot: Robot, gravity_m_s2: float = GRAVITY_M_S2) -> Kinematics | None:
    """The legs of a robot; None where they are not known, or pinocchio is not installed."""
    try:
        return Kinematics(robot, gravity_m_s2=gravity_m_s2)
    except InvalidInput:
        return None


def outline(patch: Patch, colour: Colour, opacity: float = 1.0, width: float = 1.4) -> Path:
    """The border of a chosen patch."""
    return Path(
        pieces_m=ring(patch.vertices_m + ON_M * patch.normal),
        colour=colour,
        opacity=opacity,
        width=width,
        layer=Layer.TERRAIN,
        lift_m=8.0,
    )


def window(name: str, patch: Patch, colour: Colour, edge: Colour) -> DrawnBody:
    """A chosen patch in full colour, framed in the colour of its limb."""
    return DrawnBody(
        name=name,
        shape=plate(patch.vertices_m, ON_M * patch.normal),
        position_m=np.zeros(3),
        colour=colour,
        edge=edge,
        opacity=0.55,
        layer=Layer.TERRAIN,
        lift_m=9.0,
    )


_SUPPORT = "#2a7f62"
LONGEST = 0.6
"""Length of the arrow of the largest force, in units of the mean reach."""
MARGIN_M = 0.08
"""Terrain is shown so far beyond everywhere that the robot goes."""
_STEP_S, _HOLD_S, SPEED = 1.2, 0.5, 2.0
"""Numbers of films: seconds per step, those that the beginning and the end take
in addition, and how much faster than the world an execution plays."""


@dataclass(frozen=True, eq=False)
class PlanView(View):
    """View of a plan, with viewpoint and colours.

    Arguments:
        plan: the plan.
        execution: how a world had it, in place of the motion that is planned.
        drawn_as: what its robot looks like, where that is known already.
    """

    plan: Plan
    execution: Execution | None = field(default=None, kw_only=True)
    drawn_as: RobotShape | None = field(default=None, kw_only=True)

    @property
    def robot(self) -> Robot:
        """The robot of the course."""
        return self.plan.problem.robot

    @cached_property
    def motion(self) -> Played:
        """Played that ``run`` streams."""
        return streamed(self.plan)

    @cached_property
    def keys(self) -> Played:
        """The key frames as they are planned, and the path of body and feet through them."""
        return plan_motion(self.plan, uncarried=True)

    @cached_property
    def strips(self) -> list[Strip]:
        """What the plan has in hand along its motion, or how its execution was from it; of a single
        posture, nothing.
        """
        if self.execution is not None:
            return run_strips(self.execution)
        return plan_strips(self.plan, self.keys) if self.plan.problem.frames > 1 else []

    @property
    def path(self) -> PlanPath:
        """The path of body and feet through the key frames."""
        assert self.keys.path is not None
        return self.keys.path

    def key(self, frame: int) -> Samples:
        """A key frame as it is planned."""
        return key_sample(self.path, frame)

    @cached_property
    def friction(self) -> ScalarMappable:
        """Colours of the surfaces, by their friction."""
        course = self.plan.problem
        terrain = course.terrain or tuple(foothold.candidates[0] for foothold in course.footholds)
        return friction_colours([patch.friction for patch in terrain])

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot."""
        return self.drawn_as or climber(self.robot)

    @cached_property
    def chosen(self) -> list[Patch]:
        """The patch of every foothold."""
        return self.plan.patches

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
        return aside(self.bounds_m, self.plan.com_m, self.chosen, self.shape.size_m)

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
            outline(patch, colour, 0.4, 0.9)
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

    @cached_property
    def colours(self) -> list[str]:
        """Colour of the limb of every foothold."""
        names = self.plan.problem.robot.limb_names
        return [leg_colour(names.index(foothold.limb)) for foothold in self.plan.problem.footholds]

    @cached_property
    def _windows(self) -> list[DrawnBody]:
        """The chosen patches in the colour of their friction, framed in that of their limb."""
        return [
            window(
                f"chosen {p}",
                patch,
                tuple(self.friction.to_rgba(np.array(patch.friction))[:3]),
                colour,
            )
            for p, (patch, colour) in enumerate(zip(self.chosen, self.colours, strict=True))
        ]

    def near_rad(self, now: Samples) -> Array | None:
        """Angles of the key frames around."""
        key = self.plan.joints_rad
        return None if key is None else between(key, now.frame)

    def seen(self, at: float) -> tuple[Samples, Scene, str]:
        """A key frame or a moment between two, what is drawn of it, and words for it."""
        frame, last = round(at), self.plan.problem.frames - 1
        now, words = self.key(frame), f"key frame {frame} of {last}"
        if abs(at - frame) >= _RESTS:
            now, words = self.between_keys(at), f"between key frames {int(at)} and {int(at) + 1}"
        return now, self.moving(now), words

    def at(self, now: Samples, *, cone_m: float | None = None) -> Scene:
        """``moving``, and what carries it: the support region."""
        return self.moving(now, cone_m=cone_m) + Scene(paths=self.support(now))

    def moving(self, now: Samples, *, cone_m: float | None = None) -> Scene:
        """The robot at a time, the forces of standing feet in their friction cones, and the patches
        under them in full colour; ``fixed`` has the outlines of the others.
        """
        under = np.unique(now.foothold[now.stands]).tolist()
        bodies = [*self.bodies(now), *(self._windows[p] for p in under)]
        for toe, force, normal, foothold in zip(
            now.toes_m, now.forces_n, now.normals, now.foothold.tolist(), strict=True
        ):
            height = float(force @ normal) * self.metres_a_newton
            if foothold >= 0 and height > 1e-9:
                shape = self._cone(foothold, height) if cone_m is None else self._cones[foothold]
                bodies.append(cone_body(f"cone {foothold}", shape, toe))
        return Scene(bodies=bodies, arrows=self.forces(now))

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
            Path(pieces_m=ring(corners), colour=_SUPPORT, width=1.6, layer=Layer.TOP, lift_m=20.0),
            Path(
                pieces_m=under,
                colour=_SUPPORT,
                width=0.9,
                opacity=0.7,
                layer=Layer.TOP,
                lift_m=20.0,
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

    @cached_property
    def tracks(self) -> Scene:
        """The path of every toe from foothold to foothold, dashed."""
        course, paths = self.plan.problem, list[Path]()
        for p, foothold in enumerate(course.footholds):
            if foothold.frame:
                line = self.path.swing(p, np.linspace(0.0, 1.0, 26))
                paths.append(Path(pieces_m=dashed(line), colour=self.colours[p], opacity=0.55))
        return Scene(paths=paths)

    def names(self, now: Samples) -> Scene:
        """The goal, and every limb with its force."""
        return Scene(
            labels=[
                Label(name="goal", position_m=self.plan.problem.goal_m, text="goal", colour=GOAL),
                *self.force_labels(now),
            ]
        )

    def scene(self, frame: int) -> Scene:
        """The whole picture, the robot in full at one key frame and as ghosts at some others."""
        now = self.key(frame)
        result = self.fixed + self.tracks + self.at(now) + self.names(now)
        for k in ghosts(self.plan, frame):
            result += self.ghost(self.key(k))
        return result

    def film(
        self, *, fps: float = FPS, step_s: float = _STEP_S, hold_s: float = _HOLD_S
    ) -> Animation:
        """The plan's motion at an even pace, as much faster than it is run as lets each step last
        ``step_s``; its execution at ``SPEED`` times the pace of the world.
        """
        last, height = self.plan.problem.frames - 1, 0.3 * self.shape.size_m
        fixed, legend, execution = self.fixed, self.legend, self.execution
        if execution is None:
            times = self.shown_s(round(fps * (step_s * last + 2.0 * hold_s)) + 1)
            shown = [self.motion.at(float(time_s)) for time_s in times]
            notes = [f"key frame {int(now.frame + 1e-9)} of {last}   ·   {SCALE}" for now in shown]
            where, speed = "", float(times[-1]) * fps / (len(times) - 1)
        else:
            trace = execution.trace
            count = int(np.ceil(trace.time_s[-1] * fps / SPEED))
            rows = np.searchsorted(trace.time_s, np.arange(count) * SPEED / fps).tolist()
            shown = [self.measured(execution, row) for row in rows]
            notes = [note(execution, row) for row in rows]
            where, speed = f" in {execution.world}", SPEED
            fixed, legend = fixed + _went(trace), [*legend, (REAL, "path that was gone")]
        return Animation(
            fixed=fixed,
            moments=[self.at(now, cone_m=height) for now in shown],
            step_s=1.0 / fps,
            camera=self.camera,
            title=f"{self.plan.problem.name}{where}, at {speed:.2g} times its pace",
            legend=legend,
            notes=notes,
            strips=[strip_svg(strip) for strip in self.strips],
        )

    def measured(self, execution: Execution, row: int) -> Samples:
        """The sample of the world after a control period."""
        trace = execution.trace
        return trace.sample(row, self.between_keys(float(trace.frame[row])))

    def between_keys(self, progress: float) -> Samples:
        """Body and feet at a fractional key frame: at 1.5 half of the time between key frames 1 and
        2 is over.
        """
        reached = reached_s(self.keys)
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
            (_SUPPORT, "where contacts carry the centre of mass"),
            (ACCENT, "contact forces in friction cones"),
            (GOAL, "goal"),
        ]
        for friction in sorted({patch.friction for patch in self.plan.problem.terrain})[:6]:
            words = f"ice, μ = {friction:g}" if friction < ICY else f"friction μ = {friction:g}"
            rows.append((tint(friction, self.friction), words))
        return rows


def aside(box: Array, com: Array, faced: Sequence[Patch], size_m: float) -> Camera:
    """The camera to which these patches show their faces, and that sees the path from the side.

    Arguments:
        box: lowest and highest corner of what is shown, shape (2, 3) [m].
    """
    centres, normals = np.array([(patch.centre_m, patch.normal) for patch in faced]).swapaxes(0, 1)
    length = max(float(np.linalg.norm(com[-1] - com[0])), 1e-9)

    def merit(camera: Camera) -> float:
        (x, y), _ = camera.project(com[[0, -1]])
        seen = (y - x) / length
        faces = np.clip(camera.facing(centres, normals), -0.15, 0.15)
        return float(faces.mean() + 0.10 * abs(seen[0]) + 0.05 * seen[0] + 0.10 * abs(seen[1]))

    away_m = max(4.5 * size_m, 1.25 * float(np.linalg.norm(box[1] - box[0])))
    return best_view(box.mean(axis=0), away_m, merit, step_deg=7.5, elevations_deg=[18.0, 25.0])


Unplanned = Problem | Passage
"""A course, or two places on a ground, that have no plan."""


def way_of(question: Unplanned) -> Array:
    """Places of the centre of mass from start to goal, shape (K, 3) [m]; above the nearest corner of
    the ground where only x and y are asked for.
    """
    if isinstance(question, Problem):
        return np.vstack([question.com_nominal_m, question.goal_m])
    corners = np.concatenate([patch.vertices_m for patch in question.footholds])
    places, up = (
        np.array([question.start_m, question.goal_m]),
        0.7 * question.robot.limbs[0].reach_m,
    )
    away = np.linalg.norm(corners[None, :, :2] - places[:, None], axis=2)
    return np.column_stack([places, corners[away.argmin(axis=1), 2] + up])


def offered(question: Unplanned | Leap) -> Sequence[Patch]:
    """Surfaces that are shown: the terrain, or every patch that toes are offered, once."""
    if not isinstance(question, Leap) and question.terrain:
        return question.terrain
    each = ((at,) if isinstance(at, Patch) else at.candidates for at in question.footholds)
    return list({id(patch): patch for patches in each for patch in patches}.values())


def asked(question: Unplanned, shape: RobotShape, lack: Relaxation | None = None) -> Scene:
    """Where the body was asked to go, and of a course the stance that cannot be held and what it
    lacks.
    """
    com, size = way_of(question), 0.02 * shape.size_m
    line = dashed(np.concatenate([np.linspace(a, b, 9) for a, b in pairwise(com)]))
    marks = [
        DrawnBody(name=f"asked {k}", shape=Sphere(size), position_m=at, colour=ACCENT)
        for k, at in enumerate(com)
    ] + [DrawnBody(name="goal", shape=Sphere(3.0 * size), position_m=com[-1], colour=GOAL)]
    frame = 0 if lack is None or lack.frame is None else min(lack.frame, len(com) - 1)
    words = Label(name="asked", position_m=com[-1], text="asked for: no plan", colour=ACCENT)
    way = Path(pieces_m=line, colour=ACCENT, width=2.0, layer=Layer.TOP)
    trunk = shape.trunk_at(com[frame], np.eye(3), opacity=0.55)
    scene = Scene(paths=[way], bodies=[*marks, *trunk], labels=[words])
    if not isinstance(question, Problem):
        return scene
    middles = [
        np.mean([patch.centre_m for patch in question.footholds[foothold].candidates], axis=0)
        for foothold in question.holds[frame]
    ]
    ends = [
        (limb.name, com[frame] + limb.shoulder_m, middle)
        for limb, middle in zip(question.robot.limbs, middles, strict=True)
    ]
    return scene + shape.unheld(ends, lack)


@DEFAULT_STYLE
def draw_asked(
    question: Unplanned, why: str, lack: Relaxation | None = None, *, caption: str = ""
) -> Figure:
    """Draw a question that has no plan, and why: the stance that cannot be held, its limbs to where
    their toes may stand, and what the one to blame lacks.

    Arguments:
        why: the sentence below the title.
        lack: what would have to change.
    """
    shape, com = climber(question.robot), way_of(question)
    reach = max(
        limb.reach_m + float(np.linalg.norm(limb.shoulder_m)) for limb in question.robot.limbs
    )
    box = np.array([com.min(axis=0) - reach, com.max(axis=0) + reach])
    faced = [
        patch
        for each in question.footholds
        for patch in ([each] if isinstance(each, Patch) else each.candidates)
    ]
    terrain = offered(question)
    friction = friction_colours([patch.friction for patch in terrain])
    figure = picture(
        patches(terrain, box, friction) + asked(question, shape, lack),
        aside(box, com, faced, shape.size_m),
        friction,
        [Entry(text="asked for", sign="path", colour=ACCENT)],
    )
    headline(
        figure,
        caption or f"{question.name}: no plan",
        wrapped(why),
        alarm=True,
    )
    return figure


def _area(corners: Array) -> float:
    """Area of a polygon whose corners are in order, shape (K, 2) [m²]."""
    x, y = corners.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


@DEFAULT_STYLE
def draw_plan(
    plan: Plan,
    *,
    caption: str = "",
    size_px: Size | None = None,
    strips: bool = False,
) -> Figure:
    """Draw a plan over its course: the robot in full at the last key frame, with its contact forces
    in their friction cones, and as ghosts at some of the others.

    Surfaces are in tints of their friction, icy ones in pale blue with glints, and those between
    the viewer and the robot are glass; the patches that the plan chose are framed in the colour of
    their limb.

    Arguments:
        caption: title, in place of the usual one.
        size_px: width and height; as high as the scene asks for at the usual width where it is
            None.
        strips: draw below it what the plan has in hand along its motion.
    """
    frames, view = plan.problem.frames, PlanView(plan)
    shown = frames - 1
    entries = [
        Entry(text="cone", sign="cone", colour=ACCENT),
        Entry(text="centre of mass", sign="path"),
        Entry(text="its support", sign="path", colour=_SUPPORT),
        Entry(text="chosen", sign="box", colour=leg_colour(0), fill="#d6efd0"),
    ]
    if any(patch.friction < ICY for patch in plan.problem.terrain):
        entries.append(Entry(text="ice", sign="ice", colour=ICE_EDGE, fill=ICE))
    figure = picture(
        view.scene(shown),
        view.camera,
        view.friction,
        entries,
        view.strips if strips else (),
        metres_a_newton=view.metres_a_newton,
        size_px=size_px,
    )
    to_goal_mm = 1e3 * float(np.linalg.norm(plan.com_m[-1] - plan.problem.goal_m))
    words = [
        f"the robot at key frame {shown} of {frames - 1}",
        f"{to_goal_mm:.0f} mm from goal at the end",
        SCALE,
    ]
    headline(figure, caption or f"{plan.problem.name}: {frames} key frames", "   ·   ".join(words))
    return figure


@DEFAULT_STYLE
def draw_execution(
    plan: Plan,
    execution: Execution,
    *,
    time_s: float | None = None,
    caption: str = "",
    size_px: Size | None = None,
) -> Figure:
    """Draw the robot as the world had it at a time, at the end unless one is named, and the path it
    went (red), beside the planned ones (a ghost, and in black): where and when they part, and how far.
    """
    view, trace = PlanView(plan, execution=execution), execution.trace
    last = len(trace.time_s) - 1
    row = last if time_s is None else min(int(np.searchsorted(trace.time_s, time_s)), last)
    apart, words = parted(execution)
    now = view.measured(execution, row)
    scene = view.fixed + view.ghost(view.between_keys(float(now.frame))) + view.at(now)
    scene += _went(trace, row) + _mark(trace.com_m[apart], words, view)
    entries = [
        Entry(text="cone", sign="cone", colour=ACCENT),
        Entry(text="as planned", sign="path"),
        Entry(text="as it went", sign="path", colour=REAL),
        Entry(text="its support", sign="path", colour=_SUPPORT),
    ]
    figure = picture(
        scene,
        view.camera,
        view.friction,
        entries,
        view.strips,
        metres_a_newton=view.metres_a_newton,
        size_px=size_px,
    )
    done = "done" if execution.succeeded else "failed"
    title = caption or f"{plan.problem.name} in {execution.world}: {done}"
    headline(figure, title, note(execution, row), alarm=not execution.succeeded)
    return figure


def _mark(place_m: Array, words: str, view: PlanView) -> Scene:
    """A dot where an execution was farthest from its plan, or parted from it."""
    dot = Sphere(0.03 * view.shape.size_m)
    at: dict[str, Any] = {"name": "apart", "position_m": place_m, "colour": REAL}
    body = DrawnBody(shape=dot, edge="white", layer=Layer.TOP, lift_m=75.0, **at)
    return Scene(bodies=[body], labels=[Label(text=words, **at)])


def _went(trace: Trace, row: int | None = None) -> Scene:
    """The path that the centre of mass went, over the planned one; until ``row``, or to its end."""
    line = polyline(trace.com_m[: None if row is None else row + 1 : 20])
    return Scene(paths=[Path(pieces_m=line, colour=REAL, width=1.4, layer=Layer.TOP, lift_m=65.0)])


def note(execution: Execution, row: int) -> str:
    """Note on the distance from the plan."""
    trace = execution.trace
    away = 1e3 * float(np.linalg.norm(trace.com_m[row] - trace.planned_com_m[row]))
    most = np.abs(trace.torques_nm[: row + 1]).max()
    return (
        f"{trace.time_s[row]:.1f} s   ·   centre of mass {away:.1f} mm from the plan   ·   "
        f"largest torque so far {most:.1f} of {execution.torque_limit_nm:g} Nm   ·   {SCALE}"
    )


def ghosts(plan: Plan, shown: int) -> list[int]:
    """Key frames to show beside one, evenly spread and the first among them."""
    others = np.linspace(0, plan.problem.frames - 1, 4).round().astype(int).tolist()
    return sorted(set(others) - {shown})[:3]


def between(key: Array, frame: Array) -> Array:
    """A row between those of key frames, on the straight line, shape (J,)."""
    first = int(frame)
    then = min(first + 1, len(key) - 1)
    return np.asarray(key[first] + (frame - first) * (key[then] - key[first]))
