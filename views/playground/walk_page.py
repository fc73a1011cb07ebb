"""The page of walks: a terrain with a start and a goal to drag; the walk is planned beside it, and
then played.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.answer.report import Report, acceptance_word
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.gait.method.attempt import Attempt
from stancekit.planners.gait.method.portfolio import Caps
from stancekit.planners.gait.method.way import plan_walk
from stancekit.planners.gait.walk_table import GaitSettings
from stancekit.planners.motion.gait_motion import feet_motion
from stancekit.planners.problem.walk import Walk

from ..gaits import CELLS, GRID, GRID_M, GaitView
from ..page import GOAL
from ..scene import DrawnBody, Label, Path as Line, Scene, Stage
from ..shapes import Sphere
from ..sheet import INK, leg_colour
from ..terrain import block, grid_on_ground, on_ground
from .page_parts import (
    BAD,
    GOOD,
    UNSURE,
    LimbLoad,
    cone_share,
    from_behind,
    key_values,
    let_camera,
    limb_table,
    named_in,
    said,
    set_up,
)
from .playground import Files, ScenePage
from .scenario import WalkScenario

_ITERATIONS, _TOTAL_S = 80, 120.0
"""Most iterations of a solve, and CPU time of all solves of a walk [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _WalkAnswer:
    """Answer about a walk: how far its planning is, or what came of it.

    Arguments:
        seconds: since it was begun.
    """

    done: bool
    message: str
    seconds: float
    trajectory: Trajectory | None = None
    report: Report[Trajectory] | None = None

    @property
    def accepted(self) -> bool:
        """Tell whether the verifier accepts it."""
        return self.report is not None and self.report.accepted


_Told = Callable[[int, _WalkAnswer], None]


class WalkPlanning:
    """Plans one walk at a time. on_answer(number, answer): in a thread of its own, for every step
    and at the end.
    """

    def __init__(self, on_answer: _Told) -> None:
        self._on_answer = on_answer
        self._process: Any = None
        self._lock = threading.Lock()

    def begin(self, number: int, task: Walk) -> None:
        """Plan this walk, and no other any more."""
        self.end()
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_serve, args=(there, task), daemon=True)
        with self._lock:
            process.start()
            self._process = process
        there.close()
        threading.Thread(
            target=self._listen, args=(number, process, here, time.monotonic()), daemon=True
        ).start()

    def end(self) -> None:
        """Stop planning."""
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.join()

    def _listen(self, number: int, process: Any, pipe: Any, begun_s: float) -> None:
        done = False
        with suppress(EOFError, OSError):
            while not done:
                done, message, *result = pipe.recv()
                trajectory, report = result or (None, None)
                took_s = time.monotonic() - begun_s
                self._on_answer(
                    number,
                    _WalkAnswer(
                        done=done,
                        message=message,
                        seconds=took_s,
                        trajectory=trajectory,
                        report=report,
                    ),
                )
        if (
            not done and self._process is process
        ):  # nobody ended it: it was killed, or there was no memory left
            message = "the process that planned it ended without an answer"
            self._on_answer(
                number, _WalkAnswer(done=True, message=message, seconds=time.monotonic() - begun_s)
            )


def _serve(pipe: Any, task: Walk) -> None:
    """The process's whole life; its own children end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    last = [0.0]

    def progress(
        attempt: Attempt, iteration: int, violation: float, cost: float, phase: str
    ) -> bool:
        if time.monotonic() - last[0] > 0.15:
            last[0] = time.monotonic()
            words = f"{attempt.name}, {phase}: iteration {iteration}, violation {violation:.1e}"
            with suppress(OSError):
                pipe.send((False, words))
        return os.getppid() == 1

    try:
        settings, caps = (
            GaitSettings(max_iterations=_ITERATIONS),
            Caps(iterations=_ITERATIONS, total_s=_TOTAL_S),
        )
        plan = plan_walk(task, settings, progress, caps=caps)
        best = plan.best if plan.best is not None and plan.best.solution.success else None
        answer = (True, plan.message, best and best.trajectory, best and best.report)
    except StancekitError as error:
        answer = (True, str(error), None, None)
    with suppress(OSError):  # nobody asks any more
        pipe.send(answer)


_REST_S = 0.6
"""A walk that nobody changed for so long is planned."""


def save_walk(answer: _WalkAnswer | None, folder: Path, name: str) -> Path:
    """Write the walk of an answer; where it is.

    Raises InvalidInput where none was accepted.
    """
    if answer is None or answer.trajectory is None or answer.report is None or not answer.accepted:
        raise InvalidInput("walk: expected one that is accepted, got none to save")
    path = named_in(folder, name, "-walk.json")
    write_motion(path, answer.trajectory, answer.report)
    return path


class WalkPage(ScenePage):
    """The page of walks."""

    def __init__(
        self, server: Any, scenario: WalkScenario, *, robots: Sequence[str], folder: Path
    ) -> None:
        scenario.task()  # says what is wrong with it
        self.scenario, self.number = scenario, 0
        self.answer: _WalkAnswer | None = None
        self._view: GaitView | None = None
        self._timer = threading.Timer(0.0, lambda: None)
        size = scenario.walker.stand_height_m
        self._ground = _ground(scenario, size)
        way = 0.5 * (scenario.torso_m(scenario.start_m) + scenario.torso_m(scenario.goal_m))
        far_m = 2.2 * (
            float(np.hypot(*np.subtract(scenario.goal_m, scenario.start_m))) + 3.0 * size
        )
        set_up(server)
        towards = np.array([-0.45, -0.75, 0.5])
        let_camera(
            server,
            way,
            far_m,
            from_behind(towards, *map(np.array, (scenario.start_m, scenario.goal_m))),
        )
        self._stage = Stage(server.scene, far_m)
        super().__init__(
            server, scenario, robots=robots, folder=folder, tab="Walk", unit="time [s]"
        )
        self._planning = WalkPlanning(self._told)
        self._stage.show(self._ground, "/ground")
        self._ask()

    def close(self) -> None:
        """End what works behind the page."""
        self._timer.cancel()
        self._player.stop()
        self._planning.end()

    def _lay_out(self, gui: Any) -> None:
        saves = {
            "walk": (lambda name: save_walk(self.answer, self._folder, name), "stancekit verify")
        }
        Files(gui, self._folder, saves)

    # -----------------------------------------------------------------------------------------------
    # what changes

    def _edit(self, edit: Callable[[WalkScenario], WalkScenario]) -> None:
        """Another walk: the planning of the one before ends, and this one's begins once nothing is
        changed.
        """
        with self._lock:
            self.scenario = edit(self.scenario)
            self.number += 1
            self._planning.end()
            self._ask()

    def _ask(self) -> None:
        """Show what is asked for, and plan it when it rests."""
        self._timer.cancel()
        self.answer, self._view = None, None
        self._player.offer(False)
        try:
            self.scenario.task()
        except StancekitError as error:
            self._say(BAD, "No walk to plan", str(error), "")
        else:
            self._say(UNSURE, "To be planned", "The walk is planned once nothing is changed.", "")
            self._timer = threading.Timer(_REST_S, self._begin, (self.number,))
            self._timer.daemon = True
            self._timer.start()
        with self._server.atomic():
            self._controls.update(self.scenario.sliders(), self.scenario.grips())
            self._stage.show(self._asked(), "/way")
            self._stage.show(Scene(), "/names")
            self._stage.pose(Scene())
            self._limbs.content = self._summary.content = ""

    def _begin(self, number: int) -> None:
        with self._lock:
            if number == self.number:
                self._planning.begin(number, self.scenario.task())

    def _told(self, number: int, answer: _WalkAnswer) -> None:
        with self._lock:
            if number != self.number:
                return
            self.answer = answer
            took = f"{'planned in' if answer.done else 'for'} {answer.seconds:.1f} s"
            if not answer.done:
                self._say(UNSURE, "Walk is being planned", answer.message, took)
                return
            title, text = "No walk", answer.message
            if answer.accepted and answer.report is not None:
                word = acceptance_word(answer.report.unchecked)
                title, text = (
                    word.partition(":")[0].capitalize(),
                    text.removeprefix(word).lstrip(":; "),
                )
            self._say(GOOD if answer.accepted else BAD, title, text, took)
            if answer.trajectory is not None:
                self._view = GaitView(answer.trajectory, moves_as=feet_motion(answer.trajectory))
                self._player.offer(True)
                self._player.show(0.0, answer.trajectory.duration_s)
                self._summary.content = self._numbers()
                with self._server.atomic():
                    self._stage.show(Scene(paths=self._view.fixed.paths[1:]), "/way")
                    self._pose()

    # ------------------------------------------------------------------------------------------------
    # what is seen

    def _say(self, colour: str, title: str, text: str, took: str) -> None:
        done = self.answer is not None and self.answer.done
        below = " · ".join(filter(None, (f"change {self.number}", took)))
        self._verdict.content = said(colour, title, text, below, change=self.number, patient=done)

    def _asked(self) -> Scene:
        """A straight line on the ground from start to goal, and the goal."""
        scenario, size = self.scenario, self.scenario.walker.stand_height_m
        line = np.linspace(scenario.start_m, scenario.goal_m, 81)
        low, high = np.array(scenario.terrain.domain_m).T
        laid = on_ground(np.column_stack([line, 0.0 * line[:, :1]]), scenario.terrain, low, high)
        ball = DrawnBody(
            name="goal",
            shape=Sphere(0.06 * size),
            position_m=scenario.torso_m(scenario.goal_m),
            colour=GOAL,
        )
        return Scene(
            paths=[Line(pieces_m=laid[::2], colour=INK, width=2.0, lift_m=0.01)], bodies=[ball]
        )

    def _pose(self) -> None:
        """Draw the robot at the time that is shown, and list the contact forces on its feet at that
        time.
        """
        view = self._view
        assert view is not None
        trajectory, now = view.trajectory, view.now(self._player.at)
        self._stage.pose(view.moment(self._player.at))
        feet, forces = now.toes_m, now.forces_n
        rows, labels = list[LimbLoad](), list[Label]()
        for k, limb in enumerate(view.shape.limbs):
            down = bool(now.stands[k])
            share = (
                cone_share(forces[k], now.normals[k], trajectory.friction) if down else float("nan")
            )
            size_n = float(np.linalg.norm(forces[k]))
            rows.append(LimbLoad(name=limb, force_n=size_n, cone=share, in_air=not down))
            if down:
                labels.append(
                    Label(
                        name=limb,
                        position_m=feet[k],
                        text=f"{limb} {size_n:.0f} N",
                        colour=leg_colour(k),
                    )
                )
        self._stage.show(Scene(labels=labels), "/names")
        self._limbs.content = limb_table(
            rows, f"{self._player.at:.2f} s of {trajectory.duration_s:g} s"
        )

    def _numbers(self) -> str:
        """The walk in a few numbers."""
        assert self._view is not None
        trajectory = self._view.trajectory
        length = float(np.linalg.norm(np.diff(trajectory.torso_m, axis=0), axis=1).sum())
        robot = trajectory.robot
        rows = [
            ("robot", f"{robot.name}, {robot.mass_kg:.3g} kg"),
            ("way", f"{length:.2f} m in {trajectory.duration_s:g} s"),
            ("chart", str(trajectory.provenance.get("chart", "–"))),
        ]
        return key_values(rows)

    # ------------------------------------------------------------------------------------------ the
    # time, and files

    def _move(self) -> bool:
        """To the time that the player shows; whether there is anything to show."""
        if self._view is not None:
            with self._server.atomic():
                self._pose()
        return self._view is not None


def _ground(scenario: WalkScenario, size_m: float) -> Scene:
    """All of the terrain, with lines of constant x and y, ``GRID_M`` apart."""
    field = scenario.terrain
    low, high = np.array(field.domain_m).T
    sheets = block(field, low, high, facets=2 * CELLS, depth_m=0.25 * size_m, relief_m=0.5 * size_m)
    lines = grid_on_ground(field, low, high, GRID_M, 8 * CELLS)
    grid = Line(pieces_m=lines, colour=GRID, opacity=0.35, width=0.35, lift_m=0.006)
    return Scene(sheets=sheets, paths=[grid])
