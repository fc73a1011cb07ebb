"""The playground's page: a scene in three dimensions with grips and sliders, what is planned over
it, and what that asks of limbs.
"""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import write_text
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.motion.gait_motion import feet_motion
from stancekit.planners.problem import Problem
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import Robot

from ..gaits import CELLS, GRID, GRID_M, GaitView
from ..page import Stage
from ..plans import PlanView, asked, ghosts
from ..robots import RobotShape, climber
from ..scene import DrawnBody, Path as Line, Scene, Sphere
from ..sheet import GOAL, INK, friction_colours
from ..terrain import (
    block,
    grid_on_ground,
    on_ground,
    pieces_within,
    surfaces,
)
from .answers import SceneAnswer, Session, quick_answer
from .page_parts import (
    BRAND,
    Controls,
    Files,
    LimbLoad,
    Player,
    called,
    from_behind,
    key_values,
    let_camera,
    limb_table,
    loads,
    named_in,
    solver_of,
    summary,
    verdict,
    verdict_of_walk,
)
from .scenario import Scenario, WalkScenario

_STEP_M = 0.25
_AROUND_M = 0.75
"""Terrain is shown so far beyond the nominal path, at least."""
_WAY = "#73808d"
"""Colour of what is in ink on paper: a page is white or nearly black."""


class Pictures:
    """Draws courses and plans; what does not change from one to the next is kept."""

    tab, unit = "Plan", "key frame"

    def __init__(self) -> None:
        self._known = dict[str, tuple[Hashable, Any]]()

    def _kept(self, what: str, key: Hashable, make: Callable[[], Any]) -> Any:
        """What was made for a key, made anew for another one."""
        if what not in self._known or self._known[what][0] != key:
            self._known[what] = (key, make())
        return self._known[what][1]

    def shape(self, robot: Robot) -> RobotShape:
        """Shape of a robot."""
        key = (robot.name, robot.identity, tuple((each.name, each.reach_m) for each in robot.limbs))
        return self._kept("shape", key, lambda: climber(robot))  # type: ignore[no-any-return]

    def view(self, plan: Plan) -> PlanView:
        """A plan as something to look at."""
        return PlanView(plan, drawn_as=self.shape(plan.problem.robot))

    def camera(self, course: Problem, answer: SceneAnswer) -> tuple[Array, float, Array]:
        """The first view of a course: where it looks, from how far [m], and in what direction."""
        path = course.com_nominal_m
        reach = max(limb.reach_m for limb in course.robot.limbs)
        away_m = 2.0 * (float(np.linalg.norm(np.ptp(path, axis=0))) + 2.0 * reach)
        towards = np.array([-0.75, -0.45, 0.35])
        if answer.plan is not None and answer.plan.keyed:
            towards = self.view(answer.plan).camera.axes[2]
        return path.mean(axis=0), away_m, from_behind(towards, path[0], course.goal_m)

    def shown(self, before: SceneAnswer, answer: SceneAnswer, at: float) -> tuple[float, float]:
        """Key frame that is shown with another answer, and the last one; an end is followed."""
        course, earlier = answer.course, before.course
        last = float(course.frames - 1) if isinstance(course, Problem) else 0.0
        stays = isinstance(earlier, Problem) and at < earlier.frames - 1.001
        return at if stays else last, last

    def ground(self, course: Problem) -> Scene:
        """The surfaces about the path, in the tints of their friction."""
        box = bounds_m(course)
        places = (
            box.tobytes(),
            *((patch.vertices_m.tobytes(), patch.normal.tobytes()) for patch in course.terrain),
        )
        frictions = [patch.friction for patch in course.terrain]
        pieces = self._kept("pieces", places, lambda: pieces_within(course.terrain, box))
        return self._kept(  # type: ignore[no-any-return]
            "ground",
            (places, *frictions),
            lambda: surfaces(course.terrain, pieces, friction_colours(frictions)),
        )

    def asked(self, _scenario: Scenario, answer: SceneAnswer) -> Scene:
        """Without a plan: where the body was asked to go, and what is lacking."""
        course = answer.course
        if not isinstance(course, Problem):
            return Scene()
        return asked(course, self.shape(course.robot), answer.lack)

    def found(self, view: PlanView) -> Scene:
        """The way of a plan, the tracks of its toes, and its robot at some key frames in thin
        lines.
        """
        scene = _between(view.way) + view.tracks
        for k in ghosts(view.plan, view.plan.problem.frames - 1):
            ghost = view.ghost(view.key(k))
            scene += Scene(paths=ghost.paths)
        return scene

    def moment(self, view: PlanView, at: float) -> tuple[Scene, Scene, list[LimbLoad], str]:
        """The robot and its forces in their cones at a key frame or between two, what they are
        called, in N, what its limbs give, and what moment that is.
        """
        frame = round(at)
        rests = abs(at - frame) < 0.01
        now = view.key(frame) if rests else view.between_keys(at)
        title = f"key frame {frame} of {view.plan.problem.frames - 1}"
        if not rests:
            title = f"between key frames {int(at)} and {int(at) + 1}"
        limbs = loads(view, now, self._legs(view.plan.problem), view.near_rad(now))
        return view.moving(now), Scene(labels=view.force_labels(now)), limbs, title

    def _legs(self, course: Problem) -> Kinematics | None:
        """The solver for the robot, made once."""
        robot = course.robot
        key = (robot.name, robot.identity, robot.mass_kg, robot.limb_names, course.gravity_m_s2)
        return self._kept("solver", key, lambda: solver_of(course))  # type: ignore[no-any-return]

    summary, verdict = staticmethod(summary), staticmethod(verdict)


def _between(scene: Scene) -> Scene:
    """The scene with everything that is drawn in the ink colour drawn in the colour of ways
    instead.
    """
    bodies = [replace(each, colour=_WAY) if each.colour == INK else each for each in scene.bodies]
    paths = [replace(each, colour=_WAY) if each.colour == INK else each for each in scene.paths]
    return replace(scene, bodies=bodies, paths=paths)


def bounds_m(course: Problem) -> Array:
    """Lowest and highest corner of what is shown, shape (2, 3) [m]: about the path, as far as limbs
    reach, in steps.
    """
    reach = max(
        limb.reach_m + float(np.linalg.norm(limb.shoulder_m)) for limb in course.robot.limbs
    )
    around = max(_AROUND_M, 1.2 * reach)
    com = np.vstack([course.com_nominal_m, course.goal_m[None]])
    low, high = com.min(axis=0) - around, com.max(axis=0) + around
    return _STEP_M * np.array([np.floor(low / _STEP_M), np.ceil(high / _STEP_M)])


class WalkPictures:
    """Draws a terrain with a way over it, and walks, as ``Pictures`` does courses."""

    tab, unit = "Walk", "time [s]"

    def __init__(self, scenario: WalkScenario) -> None:
        self._first = scenario

    def camera(self, *_: Any) -> tuple[Array, float, Array]:
        """The first view of a walk."""
        walk = self._first
        start, goal = map(np.array, (walk.start_m, walk.goal_m))
        away_m = 2.2 * (float(np.hypot(*(start - goal))) + 3.0 * walk.walker.stand_height_m)
        middle = 0.5 * (walk.torso_m(walk.start_m) + walk.torso_m(walk.goal_m))
        return middle, away_m, from_behind(np.array([-0.45, -0.75, 0.5]), start, goal)

    def shown(self, _: Any, answer: SceneAnswer, at: float) -> tuple[float, float]:
        """A walk is shown from its beginning."""
        duration_s = getattr(answer.plan, "duration_s", 0.0)
        return 0.0, duration_s

    def view(self, trajectory: Trajectory) -> GaitView:
        """A walk as something to look at."""
        return GaitView(trajectory, moves_as=feet_motion(trajectory))

    def ground(self, _: Any) -> Scene:
        """All of the terrain, with lines of constant x and y, ``GRID_M`` apart."""
        return self._ground

    @cached_property
    def _ground(self) -> Scene:
        field, size_m = self._first.terrain, self._first.walker.stand_height_m
        low, high = np.array(field.domain_m).T
        sheets = block(
            field, low, high, facets=2 * CELLS, depth_m=0.25 * size_m, relief_m=0.5 * size_m
        )
        lines = grid_on_ground(field, low, high, GRID_M, 8 * CELLS)
        grid = Line(pieces_m=lines, colour=GRID, opacity=0.35, width=0.35, lift_m=0.006)
        return Scene(sheets=sheets, paths=[grid])

    def asked(self, scenario: WalkScenario, _: SceneAnswer) -> Scene:
        """A straight line on the ground from start to goal, and the goal."""
        line = np.linspace(scenario.start_m, scenario.goal_m, 81)
        low, high = np.array(scenario.terrain.domain_m).T
        laid = on_ground(np.column_stack([line, 0.0 * line[:, :1]]), scenario.terrain, low, high)
        ball = DrawnBody(
            name="goal",
            shape=Sphere(0.06 * scenario.walker.stand_height_m),
            position_m=scenario.torso_m(scenario.goal_m),
            colour=GOAL,
        )
        way = Line(pieces_m=laid[::2], colour=INK, width=2.0, lift_m=0.01)
        return Scene(paths=[way], bodies=[ball])

    def found(self, view: GaitView) -> Scene:
        """The ways of a walk."""
        return Scene(paths=view.fixed.paths[1:])

    def moment(self, view: GaitView, at: float) -> tuple[Scene, Scene, list[LimbLoad], str]:
        """The robot at a time, the contact forces on its feet in words, and as loads."""
        now = view.now(at)
        labels = [
            each for each, down in zip(view.force_labels(now), now.stands, strict=True) if down
        ]
        title = f"{at:.2f} s of {view.trajectory.duration_s:g} s"
        return view.moment(at), Scene(labels=labels), loads(view, now), title

    def summary(self, answer: SceneAnswer) -> str:
        """The walk in a few numbers, as HTML; empty without one."""
        walk = answer.plan
        if walk is None or not walk.has("times_s"):
            return ""
        length = float(np.linalg.norm(np.diff(walk.torso_m, axis=0), axis=1).sum())
        rows = [
            ("robot", f"{walk.robot.name}, {walk.robot.mass_kg:.3g} kg"),
            ("way", f"{length:.2f} m in {walk.duration_s:g} s"),
            ("chart", str(walk.provenance.get("chart", "–"))),
        ]
        return key_values(rows)

    verdict = staticmethod(verdict_of_walk)


def save_plan(answer: SceneAnswer, folder: Path, name: str, kind: str = "plan") -> Path:
    """Write the plan, or the walk, of an answer; where it is.

    Raises InvalidInput where there is none that was accepted.
    """
    if answer.plan is None:
        raise InvalidInput(f"{kind}: expected one, got none to save")
    if answer.report is None:
        raise InvalidInput(
            f"{kind}: expected one that was judged, got one whose joints and bodies are not yet"
        )
    if not answer.accepted:
        raise InvalidInput(f"{kind}: expected one that is accepted, got {answer.message}")
    path = named_in(folder, name, f"-{kind}.json")
    write_motion(path, answer.plan, answer.report)
    return path


def save_course(scenario: Scenario, folder: Path, name: str) -> Path:
    """Write the course that is asked for; where it is.

    Raises InvalidInput.
    """
    suffix, text = scenario.text()
    path = named_in(folder, name, f"-course{suffix}")
    write_text(path, text)
    return path


def _show_course(scenario: Scenario, client: Any, name: str) -> None:
    """Show the course's text in a tab, and offer it as a download."""
    try:
        suffix, text = scenario.text()
    except StancekitError as error:
        suffix, text = "", str(error)
    modal = client.gui.add_modal(f"{name}-course{suffix}")
    with modal:
        client.gui.add_html(
            f'<pre id="course" style="font:12px/1.45 ui-monospace,monospace;white-space:pre-wrap;'
            f'max-height:60vh;overflow:auto;user-select:text">{html.escape(text)}</pre>'
        )
        client.gui.add_button("close").on_click(lambda _: modal.close())
    client.send_file_download(f"{name}-course{suffix or '.txt'}", text.encode())


_PICK = "pick a surface"


class Playground:
    """A page on a viser server: what may be changed on the left, what comes of it on the right.

    Arguments:
        scenario: what it shows at first.
        robots: names and files in its menu.
        folder: where it saves.

    Raises:
        StancekitError: where the scene asks for nothing that makes sense to begin with.
    """

    def __init__(
        self, server: Any, scenario: Scenario, *, robots: Sequence[str], folder: Path
    ) -> None:
        course, gui = scenario.course(), server.gui
        self._server, self._folder, self._lock = server, folder, threading.RLock()
        self._look: Any = (
            WalkPictures(scenario) if isinstance(scenario, WalkScenario) else Pictures()
        )
        self._answer, self._view = quick_answer(scenario), None
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
        server.scene.configure_default_lights(cast_shadow=False)
        middle, away_m, towards = self._look.camera(course, self._answer)
        let_camera(server, middle, away_m, towards)
        self._stage = Stage(server.scene, away_m)
        gui.set_panel_label(f"Stancekit playground: {scenario.name}")
        gui.main_panel.dock_left()
        self._robots = called(list(dict.fromkeys(filter(None, (scenario.robot, *robots)))))
        self._controls = Controls(
            server,
            lambda key, value: self._change(lambda scenario: scenario.slid(key, value)),
            lambda key, place: self._change(lambda scenario: scenario.dragged(key, place)),
        )
        if scenario.robot:
            names = tuple(self._robots)
            self._robot = names[0]
            self._menu = gui.add_dropdown("robot", names, initial_value=self._robot)
            self._menu.on_update(self._robot_chosen)
        self._lay_out(gui, walks=isinstance(scenario, WalkScenario))
        panel = gui.add_panel()
        with panel.add_tab(self._look.tab):
            self._verdict, self._summary = gui.add_html(""), gui.add_html("")
            self._player = Player(gui, self._look.unit, self._move, self._lock)
            self._limbs = gui.add_html("")
        panel.dock_right()
        panel.set_width(380)
        server.on_client_disconnect(lambda _: self._controls.let_go())
        self._player.show(*self._look.shown(SceneAnswer(), SceneAnswer(course=course), 0.0))
        self.session = Session(scenario, self._draw)
        self._controls.update(scenario.sliders(), scenario.grips(course))
        self.session.start()

    def clients(self) -> list[Any]:
        """Tabs that show the page, as viser knows them."""
        return list(self._server.get_clients().values())

    def close(self) -> None:
        """End what works behind the page."""
        self._player.stop()
        self.session.close()

    def _lay_out(self, gui: Any, *, walks: bool) -> None:
        """Add the files, and of a course the button that picks a surface."""
        kind, reader = ("walk" if walks else "plan"), "stancekit verify"
        saves: dict[str, tuple[Callable[[str], Path], str]] = {
            kind: (lambda name: save_plan(self._answer, self._folder, name, kind), reader)
        }
        if walks:
            Files(gui, self._folder, saves)
            return
        self._picker = gui.add_button(
            _PICK, hint="The next click on a surface gives it a grip and a friction."
        )
        self._picker.on_click(self._pick)
        saves["course"] = (
            lambda name: save_course(self.session.scenario, self._folder, name),
            "stancekit plan",
        )
        self._files = Files(
            gui,
            self._folder,
            saves,
            show=lambda client, name: _show_course(self.session.scenario, client, name),
        )

    # -----------------------------------------------------------------------------------------------
    # what changes

    def _change(self, edit: Callable[[Any], Any]) -> bool:
        """Ask another question, made of the newest; whether that was possible."""
        try:
            self.session.change(edit)
        except StancekitError as error:
            self._notify(str(error))
            return False
        return True

    def _robot_chosen(self, event: Any) -> None:
        if event.client is not None:
            name = event.target.value
            if self._change(lambda scenario: scenario.with_robot(self._robots[name])):
                self._robot = name
            else:
                self._menu.value = self._robot

    def _notify(self, text: str) -> None:
        for client in self.clients():
            client.add_notification("Not possible", text, auto_close_seconds=8.0)

    def _pick(self, _event: Any) -> None:
        """The next click picks a surface."""
        if self._picker.label == _PICK:
            self._server.scene.on_click()(self._picked)
            self._picker.label = "click a surface"

    async def _picked(self, event: Any) -> None:
        self._server.scene.remove_click_callback()
        self._picker.label = _PICK
        course = self._answer.course
        hit = None
        if isinstance(course, Problem):
            hit = struck(course, event.ray_origin, event.ray_direction)
        if hit is None:
            self._notify("no surface was there; press the button and click once more")
        else:
            self._change(lambda scenario: scenario.picked(course, hit))

    # ------------------------------------------------------------------------------------------------
    # what is seen

    def _draw(self, number: int, scenario: Scenario, answer: SceneAnswer, since: float) -> None:
        """Show an answer, all of it at once."""
        with self._lock:
            before, self._answer = self._answer, answer
            course, look = answer.course, self._look
            with self._server.atomic():
                if course is not None:
                    self._player.show(*look.shown(before, answer, self._player.at))
                    self._stage.show(look.ground(course), "/ground")
                if course is not None or isinstance(scenario, WalkScenario):
                    self._controls.update(scenario.sliders(), scenario.grips(course))
                self._view = None if answer.plan is None else look.view(answer.plan)
                self._player.offer(self._view is not None)
                if self._view is None:
                    self._stage.show(look.asked(scenario, answer), "/way")
                    self._stage.show(Scene(), "/names")
                    self._stage.pose(Scene())
                    self._limbs.content = ""
                else:
                    self._stage.show(look.found(self._view), "/way")
                    self._pose()
                drawn_ms = 1e3 * (time.perf_counter() - since)
                self._verdict.content = look.verdict(answer, number, drawn_ms)
                self._summary.content = look.summary(answer)
            self._server.flush()

    def _pose(self) -> None:
        """The robot at the time that is shown, and what its limbs give then."""
        scene, names, limbs, title = self._look.moment(self._view, self._player.at)
        self._stage.pose(scene)
        self._stage.show(names, "/names")
        self._limbs.content = limb_table(limbs, title)

    def _move(self) -> bool:
        """To the time that the player shows; whether there is anything to show."""
        if self._view is not None:
            with self._server.atomic():
                self._pose()
        return self._view is not None


def struck(course: Problem, origin: Any, direction: Any) -> int | None:
    """The patch that a ray from ``origin``, shape (3,) [m], meets first, whichever of its sides;
    None for none.
    """
    start, ray = np.array(origin, dtype=np.float64), np.array(direction, dtype=np.float64)
    best, nearest = np.inf, None
    for index, patch in enumerate(course.terrain):
        slope = float(ray @ patch.normal)
        if abs(slope) < 1e-9:
            continue
        far = float((patch.centre_m - start) @ patch.normal) / slope
        if 0.0 < far < best and _inside(patch.vertices_m, patch.normal, start + far * ray):
            best, nearest = far, index
    return nearest


def _inside(corners: Array, normal: Array, point: Array) -> bool:
    """Tell whether a point on a convex polygon's plane is in it."""
    edges = np.roll(corners, -1, axis=0) - corners
    sides = np.cross(edges, point - corners) @ normal
    return bool(np.all(sides >= -1e-9) or np.all(sides <= 1e-9))
