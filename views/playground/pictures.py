"""Pictures of a scene and of the answer to it, in parts that change on their own."""

from __future__ import annotations

import logging
import multiprocessing
import signal
import threading
import time
from collections.abc import Callable, Hashable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.problem import Problem
from stancekit.planners.robot.model import Robot
from stancekit.planners.verify.explain import Relaxation

from ..plans import PlanView, asked, ghosts
from ..robots import RobotShape, climber
from ..scene import Scene
from ..sheet import INK, friction_colours
from ..terrain import Piece, pieces_within, surfaces
from .page_parts import SceneAnswer, patient_answer, quick_answer
from .scenario import Scenario

_Told = Callable[[int, SceneAnswer], None]


class _Judge:
    """Judges one scene after another; of those that wait only the newest is kept.

    on_answer(number, answer) is called in a thread of its own. The process starts with the first
    scene.
    """

    def __init__(self, on_answer: _Told) -> None:
        self._on_answer = on_answer
        self._lock = threading.Lock()
        self._pipe: Any = None
        self._process: Any = None
        self._waiting: tuple[int, Scenario] | None = None
        self._busy = self._closed = False

    def ask(self, number: int, scenario: Scenario) -> None:
        """Judge this next, and not what still waits."""
        with self._lock:
            if self._closed:
                return
            self._waiting = (number, scenario)
            if not self._busy:
                self._busy = True
                threading.Thread(target=self._work, name="judge", daemon=True).start()

    def drop(self) -> None:
        """Drop what waits: it is of no use any more."""
        with self._lock:
            self._waiting = None

    def close(self) -> None:
        """End the process, also in the middle of its work."""
        with self._lock:
            self._closed, self._waiting = True, None
            process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.join()

    def _work(self) -> None:
        while True:
            with self._lock:
                if self._waiting is None or self._closed:
                    self._busy = False
                    return
                (number, scenario), self._waiting = self._waiting, None
                if self._process is None:
                    self._start()
                pipe = self._pipe
            try:
                pipe.send(scenario)
                answer = pipe.recv()
            except (EOFError, OSError):  # it was ended, by us or by somebody else
                with self._lock:
                    self._process = None
                answer = SceneAnswer(
                    message="the process that judges plans has ended; any change starts it anew"
                )
                if self._closed:
                    continue
            self._on_answer(number, answer)

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there,), daemon=True)
        self._process.start()
        there.close()


def _serve(pipe: Any) -> None:
    """The process's whole life: it ends with its parent, who alone minds Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):
        while True:
            pipe.send(patient_answer(pipe.recv()))


_REST_S = 0.35
"""A scene that was not changed for so long is judged."""
log = logging.getLogger(__name__)


class Session:
    """on_answer(number, scenario, answer, since): called in the session's own thread for every
    answer that is drawn; since: time of the change [s], as time.perf_counter has it.
    """

    def __init__(
        self,
        scenario: Scenario,
        on_answer: Callable[[int, Scenario, SceneAnswer, float], None],
        *,
        judges: bool = True,
        rest_s: float = _REST_S,
    ) -> None:
        self._on_answer, self._rest_s = on_answer, rest_s
        self._news = threading.Condition()
        self._scenario, self._number, self._since = scenario, 0, time.perf_counter()
        self._answered, self._judged = -1, -1
        self._verdict: tuple[int, SceneAnswer] | None = None
        self._judge = _Judge(self._told) if judges else None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="playground", daemon=True)

    def start(self) -> None:
        """Answer the first scene, and all that follow."""
        self._thread.start()

    @property
    def scenario(self) -> Scenario:
        """The newest."""
        with self._news:
            return self._scenario

    @property
    def number(self) -> int:
        """Number of the newest change; 0 before the first."""
        with self._news:
            return self._number

    def change(self, edit: Callable[[Scenario], Scenario]) -> int:
        """Another scene, made of the newest by ``edit``; its number.

        Raises what ``edit`` raises.

        An edit that takes a while, as loading a robot, keeps nobody else from changing the scene:
        it is done again on what is the newest then, and what others change meanwhile stays.
        """
        while True:
            with self._news:
                base, number, since = self._scenario, self._number, time.perf_counter()
            edited = edit(base)
            with self._news:
                if number != self._number:
                    continue
                self._scenario, self._since = edited, since
                self._number += 1
                if self._judge is not None:
                    self._judge.drop()
                self._news.notify()
                return self._number

    def close(self) -> None:
        """End thread and process."""
        with self._news:
            self._closed = True
            self._news.notify()
        if self._judge is not None:
            self._judge.close()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)

    def _told(self, number: int, answer: SceneAnswer) -> None:
        with self._news:
            self._verdict = (number, answer)
            self._news.notify()

    def _work(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(self._is_due, timeout=self._patience_s())
                if self._closed:
                    return
                number, scenario, since = self._number, self._scenario, self._since
                verdict, self._verdict = self._verdict, None
            if number != self._answered:
                self._say(number, scenario, quick_answer(scenario), since)
                self._answered = number
            elif verdict is not None and verdict[0] == number:
                self._say(number, scenario, verdict[1], since)
            elif (
                self._judge is not None
                and self._judged != number
                and time.perf_counter() - since >= self._rest_s
            ):
                self._judged = number
                self._judge.ask(number, scenario)

    def _is_due(self) -> bool:
        return self._closed or self._number != self._answered or self._verdict is not None

    def _patience_s(self) -> float | None:
        """Until the scene counts as one that nobody changes any more; None where there is nothing
        to wait for.
        """
        if self._judge is None or self._judged == self._number or self._number != self._answered:
            return None
        return max(self._rest_s - (time.perf_counter() - self._since), 0.001)

    def _say(self, number: int, scenario: Scenario, answer: SceneAnswer, since: float) -> None:
        try:
            self._on_answer(number, scenario, answer, since)
        except Exception:  # a page that cannot draw one answer draws the next
            log.exception("an answer could not be drawn")


_STEP_M = 0.25
_AROUND_M = 0.75
"""Terrain is shown so far beyond the nominal path, at least."""
_WAY = "#73808d"
"""Colour of what is in ink on paper: a page is white or nearly black."""


class Pictures:
    """Draws scenes; what does not change from one to the next is kept."""

    def __init__(self) -> None:
        self._shape: tuple[Hashable, RobotShape] | None = None
        self._ground: tuple[Hashable, Scene] | None = None
        self._pieces: tuple[Hashable, list[Piece]] | None = None

    def shape(self, robot: Robot) -> RobotShape:
        """Shape of a robot."""
        key = (robot.name, robot.identity, tuple((each.name, each.reach_m) for each in robot.limbs))
        if self._shape is None or self._shape[0] != key:
            self._shape = (key, climber(robot))
        return self._shape[1]

    def view(self, plan: Plan) -> PlanView:
        """A plan as something to look at."""
        return PlanView(plan, drawn_as=self.shape(plan.problem.robot))

    def ground(self, course: Problem) -> Scene:
        """The surfaces about the path, in the tints of their friction."""
        box = bounds_m(course)
        places = (
            box.tobytes(),
            *((patch.vertices_m.tobytes(), patch.normal.tobytes()) for patch in course.terrain),
        )
        frictions = [patch.friction for patch in course.terrain]
        if self._pieces is None or self._pieces[0] != places:
            self._pieces = (places, pieces_within(course.terrain, box))
        key = (places, *frictions)
        if self._ground is None or self._ground[0] != key:
            colours = friction_colours(frictions)
            self._ground = (key, surfaces(course.terrain, self._pieces[1], colours))
        return self._ground[1]

    def asked(self, course: Problem, lack: Relaxation | None) -> Scene:
        """Without a plan: where the body was asked to go, and what is lacking."""
        return asked(course, self.shape(course.robot), lack)

    def found(self, view: PlanView) -> Scene:
        """The way of a plan, the tracks of its toes, and its robot at some key frames in thin
        lines.
        """
        scene = _between(view.way) + view.tracks
        for k in ghosts(view.plan, view.plan.problem.frames - 1):
            ghost = view.ghost(view.key(k))
            scene += Scene(paths=ghost.paths)
        return scene

    def moment(self, view: PlanView, now: Samples) -> tuple[Scene, Scene]:
        """The robot and its forces in their cones; and what they are called, in N."""
        names = Scene(
            labels=[each for each in view.names(now).labels if each.name != "goal"]
        )  # its grip has it
        return view.moving(now), names


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
