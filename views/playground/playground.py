"""The playground's page: a scene in three dimensions with grips and sliders, what is planned over
it, and what that asks of limbs.
"""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import write_text
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.problem import Problem
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import Robot

from ..page import Stage
from ..plans import PlanView, asked, ghosts, offered, solver_of
from ..robots import RobotShape, climber
from ..scene import Scene
from ..sheet import INK, friction_colours
from ..terrain import pieces_within, surfaces
from .answers import (
    BAD,
    GOOD,
    LimbLoad,
    SceneAnswer,
    Session,
    limb_table,
    loads,
    quick_answer,
    summary,
    verdict,
)
from .scenario import Grip, Scenario, Slider

_STEP_M = 0.25
_AROUND_M = 0.75
"""Terrain is shown so far beyond the nominal path, at least."""
_WAY = "#73808d"
"""Colour of what is in ink on paper: a page is white or nearly black."""


_FOV_RAD = 0.75
BRAND = (39, 64, 127)
_GRIP_M = 0.16
"""Length of the arrows of a grip."""
FAR_M = 1e3


class Controls:
    """Controls with which a page changes a scene. on_slid(key, value), on_dragged(key, position_m):
    called in order.
    """

    def __init__(
        self,
        server: Any,
        on_slid: Callable[[str, float], object],
        on_dragged: Callable[[str, Array], object],
    ) -> None:
        self._server, self._on_slid, self._on_dragged = server, on_slid, on_dragged
        self._sliders = dict[str, Any]()
        self._grips = dict[str, tuple[Any, Any]]()  # and their labels
        self._held = set[str]()
        self._folder = server.gui.add_folder("Scene")

    def update(self, sliders: Sequence[Slider], grips: Sequence[Grip]) -> None:
        """Show what may be changed now; a grip that is being dragged stays where it is."""
        for key in set(self._sliders) - {slider.key for slider in sliders}:
            self._sliders.pop(key).remove()
        for slider in sliders:
            self._slide(slider)
        for key in set(self._grips) - {grip.key for grip in grips}:
            self._grips.pop(key)[0].remove()  # with the label, which is its child
        for grip in grips:
            self._grip(grip)

    def let_go(self) -> None:
        """Nobody holds anything any more: a tab was closed."""
        self._held.clear()

    def _slide(self, slider: Slider) -> None:
        known = self._sliders.get(slider.key)
        kind: Any = int if slider.whole else float
        low, high = kind(min(slider.low, slider.value)), kind(max(slider.high, slider.value))
        if known is None:
            with self._folder:
                known = self._server.gui.add_slider(
                    slider.title,
                    min=low,
                    max=high,
                    step=kind(slider.step),
                    initial_value=kind(slider.value),
                    hint=slider.hint or None,
                )

            async def slid(event: Any, key: str = slider.key) -> None:
                if event.client is not None:  # else it was set here
                    self._on_slid(key, float(event.target.value))

            known.on_update(slid)
            self._sliders[slider.key] = known
        elif abs(known.value - slider.value) > 1e-9:
            known.max, known.min = max(known.max, high), min(known.min, low)
            known.value = kind(slider.value)

    def _grip(self, grip: Grip) -> None:
        known, label = self._grips.get(grip.key, (None, None))
        if known is None:
            name = f"/grips/{grip.key}"
            known = self._server.scene.add_transform_controls(
                name,
                scale=_GRIP_M,
                active_axes=grip.axes,
                disable_rotations=True,
                disable_sliders=sum(grip.axes) < 2,
                depth_test=False,
                line_width=3.0,
                position=tuple(grip.position_m.tolist()),
            )
            label = self._server.scene.add_label(
                f"{name}/label", grip.label, anchor="top-center", position=(0.0, 0.0, -0.03)
            )

            async def dragged(event: Any, key: str = grip.key) -> None:
                if event.phase == "start":
                    self._held.add(key)
                elif event.phase == "end":
                    self._held.discard(key)
                place = np.array(event.target.position, dtype=np.float64)
                if np.all(np.isfinite(place)) and event.phase != "start":
                    self._on_dragged(key, np.clip(place, -FAR_M, FAR_M))

            known.on_update(dragged)
            self._grips[grip.key] = known, label
        elif grip.key not in self._held:
            place = tuple(round(float(value), 6) for value in grip.position_m)
            if float(np.abs(np.array(known.position) - place).max()) > 1e-6:
                known.position = place
        if label.text != grip.label:
            label.text = grip.label


_FPS = 15.0


def next_picture(stop: threading.Event) -> bool:
    """Wait until the next picture is due; whether it was stopped before."""
    return stop.wait(1.0 / _FPS)


class Player:
    """In the tab that is open on ``gui``, one key frame a second.

    Arguments:
        on_time: called, with ``lock`` held, when another time is to be shown; it returns whether
            there is anything to show, and where there is nothing the time stays. at: the time that
            is shown; last: where it ends.
        pause: its clock.
    """

    def __init__(
        self,
        gui: Any,
        on_time: Callable[[], bool],
        lock: AbstractContextManager[Any],
        pause: Callable[[threading.Event], bool] = next_picture,
    ) -> None:
        self._on_time, self._lock, self._pause = on_time, lock, pause
        self._stop: threading.Event | None = None
        self.at, self.last = 0.0, 0.0
        self._button = gui.add_button("play")
        self._button.on_click(self._clicked)
        self._slider = gui.add_slider("key frame", min=0.0, max=1.0, step=0.02, initial_value=0.0)
        self._slider.on_update(self._slid)

    def show(self, at: float, last: float) -> None:
        """From now on it ends there, and this is shown; ``on_time`` is not called."""
        self.last, self.at = last, min(max(at, 0.0), last)
        if abs(self._slider.max - max(last, 1.0)) > 1e-9:
            self._slider.max = max(last, 1.0)
        if abs(self._slider.value - self.at) > 0.01:
            self._slider.value = round(self.at, 2)

    def offer(self, there: bool) -> None:
        """Show the button and the slider if there is something to play; without, neither button nor
        slider is seen.
        """
        if not there:
            self.stop()
            self._button.label = "play"
        for part in (self._button, self._slider):
            if part.visible != there:
                part.visible = there

    def stop(self) -> None:
        """Stay where it is."""
        if self._stop is not None:
            self._stop.set()
            self._stop = None

    def _clicked(self, _event: Any) -> None:
        if self._stop is not None:
            self.stop()
        else:
            self._stop = threading.Event()
            threading.Thread(
                target=self._play, args=(self._stop,), name="player", daemon=True
            ).start()
        self._button.label = "play" if self._stop is None else "stop"

    def _slid(self, event: Any) -> None:
        if event.client is not None:
            with self._lock:
                self._go(min(max(float(event.target.value), 0.0), self.last))

    def _play(self, stop: threading.Event) -> None:
        while not self._pause(stop):
            with self._lock:
                if self._go(0.0 if self.at >= self.last else min(self.at + 1.0 / _FPS, self.last)):
                    self.show(self.at, self.last)

    def _go(self, at: float) -> bool:
        """To another time; whether there was anything to show there."""
        before, self.at = self.at, at
        shown = self._on_time()
        self.at = at if shown else before
        return shown


class Files:
    """Names, buttons, and a line that says what was written.

    Arguments:
        saves: by what a button saves, a function of the name that writes it and gives its path, and
            the command that reads it.
        show: called with a tab and the name, shows the course's file there.
    """

    def __init__(
        self,
        gui: Any,
        folder: Path,
        saves: Mapping[str, tuple[Callable[[str], Path], str]],
        show: Callable[[Any, str], None],
    ) -> None:
        with gui.add_folder("Files"):
            self._name = gui.add_text(
                "name", "played", hint="Of the files, without a folder or an ending."
            )
            for what, (save, command) in saves.items():
                button = gui.add_button(f"save {what}", hint=f"Into {folder.resolve()}.")
                button.on_click(partial(self._save, save, command))
            show_button = gui.add_button("show course", hint="The course's file, to copy.")
            show_button.on_click(lambda event: show(event.client, str(self._name.value)))
            self._said = gui.add_html("")

    def _save(self, save: Callable[[str], Path], command: str, _event: Any) -> None:
        try:
            path = save(str(self._name.value))
            colour, words = GOOD, f"wrote {path}; {command} {path} reads it"
        except StancekitError as error:
            colour, words = BAD, str(error)
        self._said.content = (
            f'<div id="saved" style="font:12px/1.4 system-ui,sans-serif;color:{colour};margin:4px 2px;'
            f'overflow-wrap:anywhere">{html.escape(words)}</div>'
        )


def let_camera(server: Any, target_m: Array, away_m: float, towards: Array) -> None:
    """Set the first view of a page: the camera looks at ``target_m`` from a distance of ``away_m``,
    in the direction ``towards``, shape (3,).
    """
    camera = server.initial_camera
    camera.look_at, camera.fov = tuple(target_m), _FOV_RAD
    camera.position = tuple(target_m + away_m * towards / np.linalg.norm(towards))


def from_behind(towards: Array, start_m: Array, goal_m: Array) -> Array:
    """A direction to look from, behind who goes from start to goal: what is left of the robot is
    left on the page.

    Arguments:
        towards: from the scene to the eye, shape (3,); one that is ahead of the robot is mirrored.
    """
    way = np.array([*(np.asarray(goal_m)[:2] - np.asarray(start_m)[:2]), 0.0])
    length = float(np.linalg.norm(way))
    ahead = np.array([1.0, 0.0, 0.0]) if length < 1e-6 else way / length
    return np.asarray(towards - 2.0 * max(float(towards @ ahead), 0.0) * ahead)


def named_in(folder: Path, name: str, ending: str) -> Path:
    """A file of this name in the folder, and never outside of it, whoever asks.

    Raises InvalidInput.
    """
    name = name.strip()
    if not name or Path(name).name != name or name.startswith("."):
        raise InvalidInput(f"name: expected one without a folder, got {name!r}")
    return folder / f"{name}{ending}"


def called(robots: Sequence[str]) -> dict[str, str]:
    """Robots by what a menu calls them: a file by its name, or by all of its path where two have
    that name.
    """
    short = [Path(robot).name if Path(robot).suffix else robot for robot in robots]
    return {
        name if short.count(name) == 1 else robot: robot
        for name, robot in zip(short, robots, strict=True)
    }


class Pictures:
    """Draws questions and what is planned for them; what does not change from one to the next is
    kept.
    """

    def __init__(self) -> None:
        self._known = dict[str, tuple[Hashable, Any]]()

    def _kept(self, what: str, key: Hashable, make: Callable[[], Any]) -> Any:
        """What was made for a key, made anew for another one."""
        if what not in self._known or self._known[what][0] != key:
            self._known[what] = (key, make())
        return self._known[what][1]

    def shape(self, robot: Robot) -> RobotShape:
        """Shape of a robot that climbs."""
        key = (robot.name, robot.identity, tuple((each.name, each.reach_m) for each in robot.limbs))
        return self._kept("shape", key, lambda: climber(robot))  # type: ignore[no-any-return]

    def view(self, plan: Plan) -> PlanView:
        """What was planned as something to look at."""
        return PlanView(plan, drawn_as=self.shape(plan.robot))

    def camera(self, scenario: Scenario, answer: SceneAnswer) -> tuple[Array, float, Array]:
        """The first view of a scene: where it looks, from how far [m], and in what direction."""
        course = scenario.course()
        path = course.com_nominal_m
        reach = max(limb.reach_m for limb in course.robot.limbs)
        away_m = 2.0 * (float(np.linalg.norm(np.ptp(path, axis=0))) + 2.0 * reach)
        towards = np.array([-0.75, -0.45, 0.35])
        if answer.plan is not None:
            towards = self.view(answer.plan).camera.axes[2]
        return path.mean(axis=0), away_m, from_behind(towards, path[0], course.goal_m)

    def ground(self, course: Problem) -> Scene:
        """The surfaces about the path, in the tints of their friction."""
        box, terrain = bounds_m(course), offered(course)
        places = (
            box.tobytes(),
            *((patch.vertices_m.tobytes(), patch.normal.tobytes()) for patch in terrain),
        )
        frictions = [patch.friction for patch in terrain]
        pieces = self._kept("pieces", places, lambda: pieces_within(terrain, box))
        return self._kept(  # type: ignore[no-any-return]
            "ground",
            (places, *frictions),
            lambda: surfaces(terrain, pieces, friction_colours(frictions)),
        )

    def asked(self, answer: SceneAnswer) -> Scene:
        """Without a plan: where the body was asked to go, and what is lacking."""
        course = answer.course
        return Scene() if course is None else asked(course, self.shape(course.robot), answer.lack)

    def found(self, view: PlanView) -> Scene:
        """The way of a plan, the tracks of its toes, and its robot at some key frames in thin
        lines.
        """
        scene = _between(view.way) + view.tracks
        for k in ghosts(view.plan, view.plan.problem.frames - 1):
            scene += Scene(paths=view.ghost(view.key(k)).paths)
        return scene

    def moment(self, view: PlanView, at: float) -> tuple[Scene, Scene, list[LimbLoad], str]:
        """The robot and its forces at a time, what they are called, in N, what its limbs give, and
        what moment that is.
        """
        now, scene, title = view.seen(at)
        limbs = loads(view, now, self._legs(view.plan.problem), view.near_rad(now))
        return scene, Scene(labels=view.force_labels(now)), limbs, title

    def _legs(self, course: Problem) -> Kinematics | None:
        """The solver for the robot, made once."""
        robot = course.robot
        key = (robot.name, robot.identity, robot.mass_kg, robot.limb_names, course.gravity_m_s2)
        return self._kept("solver", key, lambda: solver_of(robot, course.gravity_m_s2))  # type: ignore[no-any-return]


def _between(scene: Scene) -> Scene:
    """The scene with everything that is drawn in the ink colour drawn in the colour of ways
    instead.
    """
    bodies = [replace(each, colour=_WAY) if each.colour == INK else each for each in scene.bodies]
    paths = [replace(each, colour=_WAY) if each.colour == INK else each for each in scene.paths]
    return replace(scene, bodies=bodies, paths=paths)


def shown(before: SceneAnswer, course: Problem, at: float) -> tuple[float, float]:
    """Key frame of a course that is shown with another answer, and the last one; an end is
    followed.
    """
    last, earlier = float(course.frames - 1), before.course
    stays = earlier is not None and at < earlier.frames - 1.001
    return at if stays else last, last


def bounds_m(course: Problem) -> Array:
    """Lowest and highest corner of what is shown, shape (2, 3) [m]: about the path, as far as limbs
    reach, in steps.
    """
    reach = max(
        limb.reach_m + float(np.linalg.norm(limb.shoulder_m)) for limb in course.robot.limbs
    )
    around = max(_AROUND_M, 1.2 * reach)
    com = np.vstack([course.com_nominal_m, course.goal_m])
    low, high = com.min(axis=0) - around, com.max(axis=0) + around
    return _STEP_M * np.array([np.floor(low / _STEP_M), np.ceil(high / _STEP_M)])


def save_plan(answer: SceneAnswer, folder: Path, name: str) -> Path:
    """Write the plan of an answer; where it is.

    Raises InvalidInput where there is none that was accepted.
    """
    if answer.plan is None:
        raise InvalidInput("plan: expected one, got none to save")
    if answer.report is None:
        raise InvalidInput(
            "plan: expected one that was judged, got one whose joints and bodies are not yet"
        )
    if not answer.accepted:
        raise InvalidInput(f"plan: expected one that is accepted, got {answer.message}")
    path = named_in(folder, name, "-plan.json")
    write_motion(path, answer.plan, answer.report)
    return path


def save_course(scenario: Scenario, folder: Path, name: str) -> Path:
    """Write the course that is asked for; where it is.

    Raises InvalidInput for a name with a folder.
    """
    suffix, text = scenario.text()
    path = named_in(folder, name, f"-course{suffix}")
    write_text(path, text)
    return path


def _show_course(scenario: Scenario, client: Any, name: str) -> None:
    """Show the course's text in a tab, and offer it as a download."""
    suffix, text = scenario.text()
    modal = client.gui.add_modal(f"{name}-course{suffix}")
    with modal:
        client.gui.add_html(
            f'<pre id="course" style="font:12px/1.45 ui-monospace,monospace;white-space:pre-wrap;'
            f'max-height:60vh;overflow:auto;user-select:text">{html.escape(text)}</pre>'
        )
        client.gui.add_button("close").on_click(lambda _: modal.close())
    client.send_file_download(f"{name}-course{suffix}", text.encode())


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
        self._look, self._answer = Pictures(), quick_answer(scenario)
        self._view: PlanView | None = None
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
        server.scene.configure_default_lights(cast_shadow=False)
        middle, away_m, towards = self._look.camera(scenario, self._answer)
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
        self._files = Files(
            gui,
            folder,
            {
                "plan": (lambda name: save_plan(self._answer, folder, name), "stancekit verify"),
                "course": (
                    lambda name: save_course(self.session.scenario, folder, name),
                    "stancekit plan",
                ),
            },
            lambda client, name: _show_course(self.session.scenario, client, name),
        )
        panel = gui.add_panel()
        with panel.add_tab("Plan"):
            self._verdict, self._summary = gui.add_html(""), gui.add_html("")
            self._player = Player(gui, self._move, self._lock)
            self._limbs = gui.add_html("")
        panel.dock_right()
        panel.set_width(380)
        server.on_client_disconnect(lambda _: self._controls.let_go())
        self._player.show(*shown(SceneAnswer(), course, 0.0))
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

    # -----------------------------------------------------------------------------------------------
    # what changes

    def _change(self, edit: Callable[[Scenario], Scenario]) -> bool:
        """Ask another question, made of the newest; whether that was possible."""
        try:
            self.session.change(edit)
        except StancekitError as error:
            for client in self.clients():
                client.add_notification("Not possible", str(error), auto_close_seconds=8.0)
            return False
        return True

    def _robot_chosen(self, event: Any) -> None:
        if event.client is not None:
            name = event.target.value
            if self._change(lambda scenario: scenario.with_robot(self._robots[name])):
                self._robot = name
            else:
                self._menu.value = self._robot

    # ------------------------------------------------------------------------------------------------
    # what is seen

    def _draw(self, number: int, scenario: Scenario, answer: SceneAnswer, since: float) -> None:
        """Show an answer, all of it at once."""
        with self._lock:
            before, self._answer = self._answer, answer
            course, look = answer.course, self._look
            self._view = None if answer.plan is None else look.view(answer.plan)
            with self._server.atomic():
                if course is not None:
                    self._player.show(*shown(before, course, self._player.at))
                    self._stage.show(look.ground(course), "/ground")
                    self._controls.update(scenario.sliders(), scenario.grips(course))
                self._player.offer(self._view is not None)
                if self._view is None:
                    self._stage.show(look.asked(answer), "/way")
                    self._stage.show(Scene(), "/names")
                    self._stage.pose(Scene())
                    self._limbs.content = ""
                else:
                    self._stage.show(look.found(self._view), "/way")
                    self._pose()
                drawn_ms = 1e3 * (time.perf_counter() - since)
                self._verdict.content = verdict(answer, number, drawn_ms)
                self._summary.content = summary(answer, self._view)
            self._server.flush()

    def _pose(self) -> None:
        """The robot at the time that is shown, and what its limbs give then."""
        assert self._view is not None
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
