"""The playground's page: a scene in three dimensions with grips and sliders, its plan, and what
that asks of limbs.
"""

from __future__ import annotations

import html
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import write_text
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.problem import Problem
from stancekit.planners.robot.kinematics import Kinematics

from ..plans import PlanView
from ..scene import Scene, Stage
from .page_parts import (
    BAD,
    GOOD,
    Controls,
    SceneAnswer,
    called,
    from_behind,
    let_camera,
    limb_table,
    loads,
    named_in,
    quick_answer,
    set_up,
    solver_of,
    summary,
    told,
    verdict,
)
from .pictures import Pictures, Session
from .scenario import Scenario

_FPS = 15.0


class Player:
    """In the tab that is open on ``gui``, one second, or key frame, of it a second.

    Arguments:
        unit: what the slider counts.
        on_time: called, with ``lock`` held, when another time is to be shown; it returns whether
            there is anything to show, and where there is nothing the time stays. at: the time that
            is shown; last: where it ends.
    """

    def __init__(
        self, gui: Any, unit: str, on_time: Callable[[], bool], lock: AbstractContextManager[Any]
    ) -> None:
        self._on_time, self._lock = on_time, lock
        self._stop: threading.Event | None = None
        self.at, self.last = 0.0, 0.0
        self._button = gui.add_button("play")
        self._button.on_click(self._clicked)
        self._slider = gui.add_slider(unit, min=0.0, max=1.0, step=0.02, initial_value=0.0)
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
        while not stop.wait(1.0 / _FPS):
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
        show: Callable[[Any, str], None] | None = None,
    ) -> None:
        with gui.add_folder("Files"):
            self._name = gui.add_text(
                "name", "played", hint="Of the files, without a folder or an ending."
            )
            for what, (save, command) in saves.items():
                button = gui.add_button(f"save {what}", hint=f"Into {folder.resolve()}.")
                button.on_click(partial(self._save, save, command))
            if show is not None:
                show_button = gui.add_button("show course", hint="The course's file, to copy.")
                show_button.on_click(lambda event: show(event.client, str(self._name.value)))
            self._said = gui.add_html("")

    def _save(self, save: Callable[[str], Path], command: str, _event: Any) -> None:
        try:
            path = save(str(self._name.value))
            colour, words = GOOD, f"wrote {path}; {command} {path} reads it"
        except StancekitError as error:
            colour, words = BAD, str(error)
        self._said.content = told(colour, words)


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


class ScenePage(ABC):
    """A page on a viser server: what may be changed on the left, what comes of it on the right.

    Arguments:
        scenario: what it shows at first.
        robots: names and files in its menu.
        folder: where it saves.
        tab, unit: titles of what comes of it, and of the time that is played.
    """

    def __init__(
        self,
        server: Any,
        scenario: Any,
        *,
        robots: Sequence[str],
        folder: Path,
        tab: str,
        unit: str,
    ) -> None:
        self._server, self._folder, self._lock = server, folder, threading.RLock()
        gui = server.gui
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
        self._lay_out(gui)
        panel = gui.add_panel()
        with panel.add_tab(tab):
            self._verdict, self._summary = gui.add_html(""), gui.add_html("")
            self._player = Player(gui, unit, self._move, self._lock)
            self._limbs = gui.add_html("")
        panel.dock_right()
        panel.set_width(380)
        server.on_client_disconnect(lambda _: self._controls.let_go())

    def clients(self) -> list[Any]:
        """Tabs that show the page, as viser knows them."""
        return list(self._server.get_clients().values())

    @abstractmethod
    def close(self) -> None:
        """End what works behind the page."""

    @abstractmethod
    def _lay_out(self, gui: Any) -> None:
        """Add buttons of its own, and files."""

    @abstractmethod
    def _edit(self, edit: Callable[[Any], Any]) -> None:
        """Ask another question, made of the newest."""

    @abstractmethod
    def _move(self) -> bool:
        """To the time that the player shows; whether there is anything to show."""

    def _change(self, edit: Callable[[Any], Any]) -> bool:
        """Ask another question; whether that was possible."""
        try:
            self._edit(edit)
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


_PICK = "pick a surface"


class Playground(ScenePage):
    """The page of a course.

    Raises StancekitError where the scene is no course to begin with.
    """

    def __init__(
        self, server: Any, scenario: Scenario, *, robots: Sequence[str], folder: Path
    ) -> None:
        course = scenario.course()
        self._answer = quick_answer(scenario)
        self._pictures = Pictures()
        self._view: PlanView | None = None
        self._solver: tuple[Any, Kinematics | None] | None = None
        distance_m = self._look(server, course)
        self._stage = Stage(server.scene, distance_m)
        super().__init__(
            server, scenario, robots=robots, folder=folder, tab="Plan", unit="key frame"
        )
        self._player.show(float(course.frames - 1), float(course.frames - 1))
        self.session = Session(scenario, self._draw)
        self._controls.update(scenario.sliders(), scenario.grips(course))
        self.session.start()

    def close(self) -> None:
        """End what works behind the page."""
        self._player.stop()
        self.session.close()

    # -------------------------------------------------------------------------------------------------
    # the page

    def _look(self, server: Any, course: Problem) -> float:
        """Set the lights and the first view of the scene; how far away it is seen from [m]."""
        set_up(server)
        path, answer = course.com_nominal_m, self._answer
        reach = max(limb.reach_m for limb in course.robot.limbs)
        middle, size = path.mean(axis=0), float(np.linalg.norm(np.ptp(path, axis=0))) + 2.0 * reach
        towards = from_behind(np.array([-0.75, -0.45, 0.35]), path[0], course.goal_m)
        if answer.plan is not None:
            self._view = self._pictures.view(answer.plan)
            towards = from_behind(self._view.camera.axes[2], path[0], course.goal_m)
        let_camera(server, middle, 2.0 * size, towards)
        return 2.0 * size

    def _lay_out(self, gui: Any) -> None:
        self._picker = gui.add_button(
            _PICK, hint="The next click on a surface gives it a grip and a friction."
        )
        self._picker.on_click(self._pick)
        self._files = Files(
            gui,
            self._folder,
            {
                "plan": (
                    lambda name: save_plan(self._answer, self._folder, name),
                    "stancekit verify",
                ),
                "course": (
                    lambda name: save_course(self.session.scenario, self._folder, name),
                    "stancekit plan",
                ),
            },
            show=lambda client, name: _show_course(self.session.scenario, client, name),
        )

    # -----------------------------------------------------------------------------------------------
    # what changes

    def _pick(self, _event: Any) -> None:
        """The next click picks a surface."""
        if self._picker.label == _PICK:
            self._server.scene.on_click()(self._picked)
            self._picker.label = "click a surface"

    async def _picked(self, event: Any) -> None:
        self._server.scene.remove_click_callback()
        self._picker.label = _PICK
        course = self._answer.course
        hit = None if course is None else struck(course, event.ray_origin, event.ray_direction)
        if course is None or hit is None:
            self._notify("no surface was there; press the button and click once more")
        else:
            self._change(lambda scenario: scenario.picked(course, hit))

    def _edit(self, edit: Callable[[Scenario], Scenario]) -> None:
        self.session.change(edit)

    # ------------------------------------------------------------------------------------------------
    # what is seen

    def _draw(self, number: int, scenario: Scenario, answer: SceneAnswer, since: float) -> None:
        """Show an answer, all of it at once."""
        with self._lock:
            followed = (
                self._answer.course is None or self._player.at >= self._answer.course.frames - 1.001
            )
            before = self._answer.course
            self._answer = answer
            course = answer.course
            with self._server.atomic():
                if course is not None:
                    last = float(course.frames - 1)
                    self._player.show(last if followed or before is None else self._player.at, last)
                    self._stage.show(self._pictures.ground(course), "/ground")
                    self._controls.update(scenario.sliders(), scenario.grips(course))
                self._view = None if answer.plan is None else self._pictures.view(answer.plan)
                self._show_plan(course)
                drawn_ms = 1e3 * (time.perf_counter() - since)
                self._verdict.content = verdict(answer, number, drawn_ms)
                self._summary.content = summary(answer)
            self._server.flush()

    def _show_plan(self, course: Problem | None) -> None:
        self._player.offer(self._view is not None)
        if self._view is None:
            wanted = Scene() if course is None else self._pictures.asked(course, self._answer.lack)
            self._stage.show(wanted, "/way")
            self._stage.show(Scene(), "/names")
            self._stage.pose(Scene())
            self._limbs.content = ""
        else:
            self._stage.show(self._pictures.found(self._view), "/way")
            self._pose(self._view)

    def _pose(self, view: PlanView) -> None:
        """The robot at the time that is shown, and what its limbs give then."""
        at = round(self._player.at)
        rests = abs(self._player.at - at) < 0.01
        now = view.key(at) if rests else view.between_keys(self._player.at)
        scene, names = self._pictures.moment(view, now)
        self._stage.pose(scene)
        self._stage.show(names, "/names")
        where = f"key frame {at} of {view.plan.problem.frames - 1}"
        title = (
            where
            if rests
            else f"between key frames {int(self._player.at)} and {int(self._player.at) + 1}"
        )
        self._limbs.content = limb_table(
            loads(view.plan, now, self._legs(view.plan.problem)), title
        )

    def _legs(self, course: Problem) -> Kinematics | None:
        """The solver for the robot, made once."""
        robot = course.robot
        key = (robot.name, robot.identity, robot.mass_kg, robot.limb_names, course.gravity_m_s2)
        if self._solver is None or self._solver[0] != key:
            self._solver = (key, solver_of(course))
        return self._solver[1]

    def _move(self) -> bool:
        """To the time that the player shows; whether there is anything to show."""
        if self._view is not None:
            with self._server.atomic():
                self._pose(self._view)
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
