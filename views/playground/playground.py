"""The playground's page: a scene in three dimensions with grips and sliders, what is planned over
it, and what that asks of limbs.
"""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import write_text
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.problem import Problem

from ..scene import Scene, Stage
from .answers import SceneAnswer, Session, quick_answer
from .page_parts import Controls, Files, Player, called, let_camera, limb_table, named_in, set_up
from .pictures import Pictures, WalkPictures
from .scenario import Scenario, WalkScenario


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
        set_up(server)
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
