"""The picture of a posture: patches, the robot on them, its contact forces in their cones, and an
envelope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, read_only
from stancekit.planners.motion.motion import Samples
from stancekit.planners.motion.path import path_of
from stancekit.planners.motion.plan_motion import key_sample
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.terrain import Patch
from stancekit.planners.verify.explanation import Relaxation

from .plans import PlanView
from .robots import RobotShape, climber, cone, cone_body
from .scene import (
    UP,
    Arrow,
    Box,
    Camera,
    DrawnBody,
    Facet,
    Label,
    Layer,
    Path,
    Scene,
    best_view,
    dashed,
    unit,
)
from .sheet import (
    ACCENT,
    DEFAULT_STYLE,
    INK,
    LEG_COLOURS,
    QUIET,
    SIZE_PX,
    Size,
    friction_colours,
    headline,
    leg_colour,
    plain_axes,
    quiet_axes,
    sheet,
)
from .still import Still
from .terrain import Entry, draw_legend, force_entry, mark_com, plane, stone

_COMPONENTS = ("$p_x$", "$p_y$", "$p_z$", "$f_n$", "$f_y$", "$f_z$")


def _draw_strip(
    figure: Figure, legs: Sequence[str], envelope: Envelope, points: Array | None
) -> None:
    """One panel a limb, at the foot of the sheet: the bounds on each component as a bar and the
    answer as a dot.

    Arguments:
        points: the answer's [p, f], non-dimensional, shape (N, 6); None draws the bounds only.
    """
    width, height = 100.0 * figure.get_figwidth(), 100.0 * figure.get_figheight()
    words = "Envelope: bounds on [p, f], non-dimensional" + (
        "" if points is None else "; the dot is this posture"
    )
    figure.text(30.0 / width, 238.0 / height, words, size=11, color=QUIET, va="center")
    shown = [envelope.low, envelope.high, *([] if points is None else [points])]
    reach = max(1.0, *(float(np.max(np.abs(values))) for values in shown))
    panel = (width - 90.0 + 18.0) / len(legs)
    for index, leg in enumerate(legs):
        axes = figure.add_axes(
            ((60.0 + panel * index) / width, 32.0 / height, (panel - 18.0) / width, 166.0 / height)
        )
        _frame_panel(axes, reach, named=index == 0)
        axes.set_title(
            leg,
            size=11.5,
            weight="bold",
            color=leg_colour(index),
            loc="left",
            pad=5,
            parse_math=False,
        )
        for row in range(6):
            low, high = float(envelope.low[index, row]), float(envelope.high[index, row])
            colour, ends = leg_colour(index), [low, high]
            axes.plot(ends, [row, row], c=colour, lw=7.5, alpha=0.32, solid_capstyle="butt")
            axes.vlines(ends, row - 0.3, row + 0.3, color=colour, lw=1.4, zorder=3)
            if points is not None:
                dot = float(points[index, row])
                fill = INK if low - 1e-6 <= dot <= high + 1e-6 else ACCENT
                axes.plot([dot], [row], "o", ms=6.5, mfc=fill, mec="white", mew=0.9, zorder=4)


def _frame_panel(axes: Axes, reach: float, *, named: bool) -> None:
    axes.set(xlim=(-1.06 * reach, 1.06 * reach), ylim=(5.75, -0.75), facecolor="#f6f7f9")
    axes.set_yticks(
        range(6), _COMPONENTS if named else [""] * 6, size=12, color=INK, parse_math=True
    )
    ticks = (
        [-1.0, 0.0, 1.0] if reach < 1.5 else [-float(np.floor(reach)), 0.0, float(np.floor(reach))]
    )
    axes.set_xticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks], size=10, color=QUIET)
    quiet_axes(axes, grid="x", sides=())
    axes.axhspan(2.5, 5.75, color="#eceff3", lw=0, zorder=0)
    axes.axvline(0.0, color="#b9c1ca", lw=1.0, zorder=1)


_WEIGHT_ARROW = 0.8
"""Length of an arrow as heavy as the robot, in units of the mean reach."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _PostureView:
    """A posture problem, and a posture where there is one, as something to look at."""

    problem: Problem
    posture: Plan | None
    lack: Relaxation | None = None

    @property
    def patches(self) -> list[Patch]:
        """Patches on which the limbs stand."""
        return [contact.patch for contact in self.problem.contacts]

    @property
    def com_m(self) -> Array:
        """Centre of mass of the posture, else the nominal one, shape (3,)."""
        return np.asarray(
            (self.problem.com_nominal_m if self.posture is None else self.posture.com_m)[0]
        )

    @cached_property
    def held(self) -> tuple[PlanView, Samples] | None:
        """The robot in its posture, as a plan of one key frame."""
        if self.posture is None:
            return None
        return PlanView(self.posture), key_sample(path_of(self.posture), 0)

    @cached_property
    def shape(self) -> RobotShape:
        """Shape of the robot."""
        return climber(self.problem.robot)

    @property
    def size_m(self) -> float:
        """Size of the robot."""
        return self.shape.size_m

    @property
    def mounts_m(self) -> Array:
        """Shoulders in the body frame, shape (N, 3)."""
        return np.array([contact.shoulder_m for contact in self.problem.contacts])

    @cached_property
    def extent_m(self) -> Array:
        """Lowest and highest coordinates of patches and shoulders before anything is solved, shape
        (2, 3).
        """
        vertices = [patch.vertices_m for patch in self.patches]
        points = np.concatenate([*vertices, self.problem.com_nominal_m[0] + self.mounts_m])
        return np.array([points.min(axis=0), points.max(axis=0)])

    @property
    def grid_m(self) -> float:
        """0.1 m, or in a large scene a larger power of ten."""
        return float(
            0.1
            * 10.0 ** max(0.0, np.ceil(np.log10(np.max(self.extent_m[1] - self.extent_m[0]) / 3.0)))
        )

    @property
    def metres_a_newton(self) -> float:
        """Length of the arrow of a force."""
        return _WEIGHT_ARROW * self.size_m / self.problem.weight_n

    @cached_property
    def friction(self) -> ScalarMappable:
        """Colours of the patches."""
        return friction_colours([patch.friction for patch in self.patches])

    @cached_property
    def camera(self) -> Camera:
        """Direction of view in which the patches show their faces, are apart, and are not behind
        the body.
        """
        centres, normals = np.array(
            [(patch.centre_m, patch.normal) for patch in self.patches]
        ).swapaxes(0, 1)
        home = self.problem.com_nominal_m[0]
        points = np.concatenate([centres, home + self.mounts_m])
        radius = max(
            float(np.mean(np.linalg.norm(self.mounts_m[:, :2], axis=1))), 0.1 * self.size_m
        )

        def merit(camera: Camera) -> float:
            shown = float(camera.facing(centres, normals).min())
            xy, _ = camera.project(points)
            apart = np.linalg.norm(xy[:, None] - xy[None], axis=-1) + 9.0 * np.eye(len(xy))
            clear = np.linalg.norm(xy[: len(centres)] - camera.project(home)[0], axis=1)
            return (
                3.0 * min(shown, 0.3)
                + float(apart.min()) / self.size_m
                + min(float(clear.min()) / radius, 1.2)
            )

        away_m = max(
            4.5 * self.size_m, 1.5 * float(np.linalg.norm(self.extent_m[1] - self.extent_m[0]))
        )
        return best_view(
            self.extent_m.mean(axis=0), away_m, merit, step_deg=7.5, elevations_deg=[20.0, 27.0]
        )

    def scene(self, envelope: Envelope | None) -> Scene:
        """All of it."""
        result = self._terrain() + self._com()
        if self.held is None:
            ends = [
                (contact.leg, self.com_m + contact.shoulder_m, contact.patch.centre_m)
                for contact in self.problem.contacts
            ]
            result += Scene(bodies=self.shape.trunk_at(self.com_m, np.eye(3), opacity=0.55))
            result += self.shape.unheld(ends, self.lack)
        else:
            view, now = self.held
            result += Scene(bodies=view.bodies(now)) + self._forces(view, now)
        if envelope is not None:
            result += Scene(bodies=self._boxes(envelope))
        return result

    def _terrain(self) -> Scene:
        """Patches as the faces of stones on a wall or on the ground: one plane for each direction
        they face.
        """
        sides: dict[tuple[int, float], list[Patch]] = {}
        for patch in self.patches:
            axis = int(np.argmax(np.abs(patch.normal)))
            sides.setdefault((axis, float(np.sign(patch.normal[axis]))), []).append(patch)
        scene = Scene()
        for (axis, sign), patches in sides.items():
            level = sign * (
                min(float(np.min(sign * patch.vertices_m[:, axis])) for patch in patches) - 0.02
            )
            low, high = self.extent_m + 0.1 * self.size_m * np.array([[-1.0], [1.0]])
            scene += plane(
                axis, sign, np.where(np.arange(3) == axis, level, [low, high]), self.grid_m
            )
            if (axis, sign) == (2, 1.0):
                scene += self._shadow(level)
            for patch in patches:
                behind = bool(self.camera.facing(patch.centre_m, patch.normal) < 0.0)
                colour = self.friction.to_rgba(np.array(patch.friction))[:3]
                scene += stone(patch, axis, level, colour, behind=behind)
        return scene

    def _shadow(self, level: float) -> Scene:
        """Shadow of the robot on level ground under a high sun."""
        at, turn, limbs = self.com_m, np.eye(3), list[Array]()
        if self.held is not None:
            view, now = self.held
            at, turn = view.pose(now)
            limbs = self.shape.lines(at, turn, view.limbs(now))
        outlines = [at + self.shape.outline_m @ turn.T]
        for a, b in (pair for joints in limbs for pair in pairwise(joints)):
            aside, on = (
                0.035 * self.size_m * unit(np.cross(UP, b - a)),
                0.02 * self.size_m * unit(b - a),
            )
            outlines.append(
                np.array([a - on + aside, b + on + aside, b + on - aside, a - on - aside])
            )
        return Scene(
            facets=[
                Facet(
                    corners_m=np.where([False, False, True], level, outline),
                    normal=UP,
                    colour="#e3e7ec",
                    layer=Layer.BACKDROP,
                    lift_m=-66.0,
                )
                for outline in outlines
            ]
        )

    def _forces(self, view: PlanView, now: Samples) -> Scene:
        """Contact forces from the toes in cones as high as the normal force, and the weight."""
        scale, size = self.metres_a_newton, self.size_m
        bodies, arrows = list[DrawnBody](), list[Arrow]()
        for contact, toe, force in zip(
            self.problem.contacts, now.toes_m, now.forces_n, strict=True
        ):
            patch, widest = contact.patch, size / max(contact.patch.friction, 1e-9)
            height = min(max(float(force @ patch.normal) * scale, 0.15 * size), widest)
            shape = cone(patch.friction, patch.frame, height)
            bodies.append(cone_body(f"{contact.leg} cone", shape, toe))
            arrows.append(self.shape.force(contact.leg, toe, scale * force))
        weight = replace(
            self.shape.force("weight", self.com_m, -scale * self.problem.weight_n * UP), colour=INK
        )
        label = Label(
            name="weight",
            position_m=self.com_m + weight.vector_m,
            text=f"{self.problem.weight_n:.1f} N",
            colour=INK,
        )
        return Scene(
            bodies=bodies, arrows=[*arrows, weight], labels=[label, *view.force_labels(now)]
        )

    def _boxes(self, envelope: Envelope) -> list[DrawnBody]:
        """The envelope's bounds on p about the centre of mass."""
        low, high = (
            self.com_m + self.problem.length_scale_m * bounds for bounds in envelope.position
        )
        return [
            DrawnBody(
                name=f"{leg} bounds",
                shape=Box(0.5 * (high[k] - low[k])),
                position_m=0.5 * (low[k] + high[k]),
                colour=leg_colour(k),
                edge=leg_colour(k),
                opacity=0.05,
            )
            for k, leg in enumerate(self.problem.legs)
        ]

    def _com(self) -> Scene:
        """The outline of the ball that the centre of mass may move in; none that is much larger than
        the robot.
        """
        turn = np.linspace(0.0, 2.0 * np.pi, 49)
        circle = np.column_stack([np.cos(turn), np.sin(turn)]) @ self.camera.axes[:2]
        radius_m = float(self.problem.com_radius_m[0])
        circle *= radius_m if radius_m < 3.0 * self.size_m else 0.0
        outline = self.problem.com_nominal_m[0] + circle
        fill = Facet(
            corners_m=outline,
            normal=self.camera.axes[2],
            colour=INK,
            opacity=0.04,
            layer=Layer.TOP,
            lift_m=-9.0,
        )
        edge = Path(pieces_m=dashed(outline), colour=INK, opacity=0.5, layer=Layer.TOP, lift_m=-9.0)
        return Scene(facets=[fill], paths=[edge])


@DEFAULT_STYLE
def draw_posture(
    problem: Problem,
    posture: Plan | None = None,
    *,
    envelope: Envelope | None = None,
    caption: str = "",
    why: str = "",
    lack: Relaxation | None = None,
    size_px: Size = SIZE_PX,
) -> Figure:
    """Draw a posture problem, and a posture and an envelope where given.

    Patches are coloured by friction and stand out of the wall or ground behind them; the force at a
    toe is an arrow in its friction cone, which is as high as the normal force. The envelope's
    bounds on p are boxes about the centre of mass, and a strip below shows all of its bounds with
    the posture in them. Without a posture the body is shown at the nominal centre of mass, and the
    line below the caption is ``why`` there is none, or says that this is not known. Raises
    InvalidInput.

    Arguments:
        lack: what would have to change: written beside the limb that it is about.
        size_px: width and height.
    """
    count = len(problem.contacts)
    if posture is not None:
        shapes = {
            "com_m": (1, 3),
            "rotation_rad": (1, 3),
            "toes_m": (count, 3),
            "forces_n": (1, count, 3),
        }
        for name, shape in shapes.items():
            read_only(getattr(posture, name), shape, f"posture: {name}")
    if envelope is not None and envelope.contacts != count:
        raise InvalidInput(f"envelope: expected {count} contacts, got {envelope.contacts}")
    view = _PostureView(problem=problem, posture=posture, lack=lack)
    figure, foot = sheet(size_px), 0.0 if envelope is None else 252.0
    axes = plain_axes(figure, 24.0, foot + 70.0, 92.0)
    scale = Still(view.scene(envelope), view.camera).paint(axes)
    mark_com(axes, view.camera.project(view.com_m)[0].tolist(), 8.0 * scale)
    entries = [Entry(text="centre of mass, allowed ball", sign="ball")]
    if posture is not None:
        force = force_entry(scale / view.metres_a_newton, 160.0 if envelope is None else 95.0)
        entries = [force, Entry(text="friction cone", sign="cone", colour=ACCENT), *entries]
    if envelope is not None:
        entries.append(
            Entry(text="envelope on $p$", sign="box", colour=LEG_COLOURS[0], fill="#e7f1f3")
        )
        _draw_strip(
            figure, problem.legs, envelope, None if posture is None else _point(problem, posture)
        )
    draw_legend(figure, foot + 12.0, entries, view.friction)
    headline(figure, *_words(view, caption, why), alarm=posture is None)
    return figure


def _words(view: _PostureView, caption: str, why: str) -> tuple[str, str]:
    """Title and the line below it."""
    problem, posture = view.problem, view.posture
    weight = f"{problem.weight_n:.1f} N"
    if posture is None:
        unknown = "no posture (infeasible or unsolved): patches, and the shoulders at the nominal centre of mass"
        return caption or f"{len(problem.contacts)} contacts, {weight}: no posture", why or unknown
    count = len(problem.contacts)
    limbs = f"{count} limb{'s' if count > 1 else ''}"
    away_mm = 1e3 * float(np.linalg.norm(posture.com_m[0] - problem.com_nominal_m[0]))
    tilt_deg = np.rad2deg(np.linalg.norm(posture.rotation_rad))
    moved = f"centre of mass {away_mm:.0f} mm from nominal   ·   body turned by {tilt_deg:.1f}°"
    return caption or f"held by {limbs}, {weight}", f"{moved}   ·   grid {view.grid_m:g} m"


def _point(problem: Problem, posture: Plan) -> Array:
    """[p, f] of E2–E4, shape (N, 6)."""
    frames = np.array([contact.patch.frame for contact in problem.contacts])
    forces = np.einsum("nji,nj->ni", frames, posture.forces_n[0]) / float(
        problem.force_scale_n or 1.0
    )
    return np.concatenate(
        [(posture.toes_m - posture.com_m) / problem.length_scale_m, forces], axis=1
    )
