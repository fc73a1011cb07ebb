"""Parts that the playground's pages share: their look, where they are seen from, verdicts, and
robots in a menu.
"""

from __future__ import annotations

import html
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.plan import WHOLE_BODY, Plan
from stancekit.planners.answer.report import acceptance_word
from stancekit.planners.errors import InvalidInput, StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import rotation_of
from stancekit.planners.verify import Report

from ..plans import PlanView, View
from ..sheet import leg_colour
from ..strips import cone_strip, torque_strip
from .answers import SceneAnswer
from .scenario import Grip, Slider

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
        self._grips = dict[str, Any]()
        self._labels = dict[str, Any]()
        self._held = set[str]()
        self._folder = server.gui.add_folder("Scene")

    def update(self, sliders: Sequence[Slider], grips: Sequence[Grip]) -> None:
        """Show what may be changed now; a grip that is being dragged stays where it is."""
        for key in set(self._sliders) - {slider.key for slider in sliders}:
            self._sliders.pop(key).remove()
        for slider in sliders:
            self._slide(slider)
        for key in set(self._grips) - {grip.key for grip in grips}:
            self._grips.pop(key).remove()  # with the label, which is its child
            self._labels.pop(key)
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
        known = self._grips.get(grip.key)
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
            self._labels[grip.key] = self._server.scene.add_label(
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
            self._grips[grip.key] = known
        elif grip.key not in self._held:
            place = tuple(round(float(value), 6) for value in grip.position_m)
            if float(np.abs(np.array(known.position) - place).max()) > 1e-6:
                known.position = place
        if self._labels[grip.key].text != grip.label:
            self._labels[grip.key].text = grip.label


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
        self._said.content = told(colour, words)


_FOV_RAD = 0.75
BRAND = (39, 64, 127)
GOOD, UNSURE, BAD = (
    f"light-dark({pair})" for pair in ("#1d6f62, #5cc4b3", "#7a5f00, #e0bd4a", "#b81c33, #ff8b99")
)
"""Colours of good news, of what nobody knows yet, and of bad news, on light and on dark; each is at
least 4.5 : 1."""
_QUIET, _RULE, _TROUGH = (
    f"light-dark({pair})" for pair in ("#5b6672, #a9b4c0", "#d5dae0, #4a525b", "#e3e7eb, #3d454e")
)
"""Colours of what is read last, of lines, and of the empty part of a bar. Text has the page's own
colour."""


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


def told(colour: str, words: str) -> str:
    """A line on what was saved, as HTML."""
    return (
        f'<div id="saved" style="font:12px/1.4 system-ui,sans-serif;color:{colour};margin:4px 2px;'
        f'overflow-wrap:anywhere">{html.escape(words)}</div>'
    )


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


_TIGHT = 0.95
"""A limit that is used this far is marked."""
_CARRIES_N = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class LimbLoad:
    """Load of one limb.

    Arguments:
        cone: of its friction cone, torque: of a joint's limit, both as shares; NaN where unknown.
        torque_nm: of the joint that has the least in hand [Nm].
    """

    name: str
    force_n: float
    cone: float
    torque_nm: float = float("nan")
    torque: float = float("nan")
    in_air: bool = False


def loads(
    view: View, now: Samples, solver: Kinematics | None = None, near: Array | None = None
) -> list[LimbLoad]:
    """Loads of every limb at a time.

    Arguments:
        solver: of the robot; without it no torque is known.
        near: angles that unknown ones are sought near, shape (J,) [rad].
    """
    limbs, pressed_n = view.robot.limb_names, now.along_n
    torques, shares = _torques(len(limbs), now, solver, near)
    cones = now.across_n / np.maximum(now.friction * pressed_n, 1e-9)
    cones = np.where(now.across_n > 1e-6 * pressed_n, cones, 0.0)
    cones = np.where(pressed_n < _CARRIES_N, np.nan, cones)
    return [
        LimbLoad(
            name=name,
            force_n=float(np.linalg.norm(now.forces_n[i])),
            cone=float(cones[i]),
            torque_nm=torques[i],
            torque=shares[i],
            in_air=not now.stands[i],
        )
        for i, name in enumerate(limbs)
    ]


def _torques(
    count: int, now: Samples, solver: Kinematics | None, near: Array | None
) -> tuple[list[float], list[float]]:
    """For each limb the torque of the joint that is nearest to its limit [Nm], and its share of the
    joint's limit.
    """
    if solver is None:
        return [float("nan")] * count, [float("nan")] * count
    angles = now.angles_rad
    if angles is None:
        angles, _, _ = solver.solve(
            now.com_m, now.rotation_rad, now.toes_m, normals=now.normals, seed=near
        )
    torque = np.abs(solver.torques(angles, rotation_of(now.rotation_rad), now.forces_n))
    share = torque / solver.torque_nm
    worst = [solver.joints_of(i)[int(share[solver.joints_of(i)].argmax())] for i in range(count)]
    return [float(torque[j]) for j in worst], [float(share[j]) for j in worst]


def verdict(answer: SceneAnswer, number: int, drawn_ms: float) -> str:
    """The verdict as HTML: a title in its colour, a sentence, and a quiet line.

    Arguments:
        number: of the change that it answers.
        drawn_ms: since that change.
    """
    colour, title, text = _words(answer)
    title, text = html.escape(title), html.escape(text)
    took = f"drawn after {drawn_ms:.0f} ms"
    if answer.patient:
        took = f"judged in {sum(answer.seconds):.1f} CPU-s"
    return (
        f'<div id="verdict" data-change="{number}" data-patient="{int(answer.patient)}" style="border-left:5px solid '
        f'{colour};padding:2px 0 4px 10px;margin:6px 2px;font:13px/1.45 system-ui,sans-serif">'
        f'<div style="font-size:15px;font-weight:700;color:{colour}">{title}</div>'
        f"<div>{text}</div>"
        f'<div style="color:{_QUIET};font-size:11.5px">change {number} · {took}</div></div>'
    )


def _words(answer: SceneAnswer) -> tuple[str, str, str]:
    """Colour, title and sentence."""
    if answer.course is None:
        return BAD, "Nothing to plan", answer.message
    if answer.status is Status.INFEASIBLE:
        return BAD, "No plan, and that is proved" if answer.patient else "No plan", answer.message
    if answer.accepted:
        assert answer.report is not None
        word = acceptance_word(answer.report.unchecked).partition(":")[0].capitalize()
        return GOOD, word, " ".join(filter(None, (_accepted(answer.report), answer.message)))
    if answer.plan is not None and not answer.patient:
        return (
            UNSURE,
            "Contacts hold",
            "Joints, torques and bodies are judged once nothing is changed.",
        )
    if answer.plan is not None:
        return BAD, "Not accepted", answer.message
    more = "" if answer.patient else "; the search goes on when nothing is changed"
    return UNSURE, "Undecided", f"{answer.message}{more}"


def _accepted(report: Report[Plan]) -> str:
    """Line on what was judged, and what could not be."""
    done = ["contacts", *(name for name in WHOLE_BODY if report.group(name).verdict == "holds")]
    finding = report.message.removeprefix(acceptance_word(report.unchecked)).lstrip(":; ")
    words = f"{finding}. Judged: {', '.join(done)}."
    if len(done) <= len(WHOLE_BODY):
        words += f" {report.body_message}."
    return words[0].upper() + words[1:]


def limb_table(rows: list[LimbLoad], title: str) -> str:
    """Forces, shares of cones, and torques of limbs as HTML, with bars against the limits."""
    cell = 'style="text-align:right;white-space:nowrap;padding:1px 4px"'
    head = "".join(
        f'<th style="text-align:{side};font-weight:600;padding:1px 4px;color:{_QUIET}">{words}</th>'
        for side, words in (
            ("left", "limb"),
            ("right", "force [N]"),
            ("left", "of its cone"),
            ("right", "torque [Nm]"),
            ("left", "of its limit"),
        )
    )
    lines = []
    for k, row in enumerate(rows):
        dot = f'<span style="display:inline-block;width:9px;height:9px;border-radius:5px;background:{leg_colour(k)}">'
        force = "in the air" if row.in_air else f"{row.force_n:.1f}"
        torque = "–" if np.isnan(row.torque_nm) else f"{row.torque_nm:.1f}"
        lines.append(
            f"<tr><td style='white-space:nowrap;padding:1px 4px'>{dot}</span> "
            f"{html.escape(row.name)}</td>"
            f"<td {cell}>{force}</td><td>{_bar(row.cone)}</td><td "
            f"{cell}>{torque}</td><td>{_bar(row.torque)}</td></tr>"
        )
    return (
        f'<div id="limbs" style="font:12px/1.5 system-ui,sans-serif;margin:4px 2px;'
        f'font-variant-numeric:tabular-nums"><b>{html.escape(title)}</b>'
        f'<table style="border-collapse:collapse;width:100%"><tr style="border-bottom:1px solid {_RULE}">{head}</tr>'
        f"{''.join(lines)}</table>"
        f'<div style="color:{_QUIET};font-size:11.5px">{html.escape(explained([row.name for row in rows]))}</div></div>'
    )


_SIDES, _PLACES = (
    {"L": "left", "R": "right"},
    {"F": "front", "M": "middle", "R": "rear", "H": "hind"},
)


def explained(limbs: list[str]) -> str:
    """The names of limbs in words, seen by the robot, and what the shares of the table are of."""
    names = [
        f"{name} {_SIDES[name[0]]} {_PLACES[name[1]]}"
        for name in limbs
        if len(name) == 2 and name[0] in _SIDES and name[1] in _PLACES
    ]
    seen = f"{', '.join(names)}, as the robot looks. " if names else ""
    return f"{seen}Cone: share of the friction that its force may use. Limit: of the joint with the least torque left."


def summary(answer: SceneAnswer, view: PlanView | None) -> str:
    """The plan in a few numbers, as HTML, empty without one: its reserves, the figures of the strips
    below its picture, what it was planned with, and where it ends.

    Arguments:
        view: of the plan.
    """
    if view is None:
        return ""
    plan, course, robot = view.plan, view.plan.problem, view.robot
    to_goal_mm = 1e3 * float(np.linalg.norm(plan.com_m[-1] - course.goal_m))
    strips = {"friction in hand": cone_strip(plan, view.keys)}
    if answer.report is not None:
        strips["torque in hand"] = torque_strip(plan)
    weight = f"{robot.mass_kg:.3g} kg ({robot.mass_kg * plan.gravity_m_s2:.1f} N)"
    reserves = [
        (
            name,
            f"{100 - used.values[used.worst]:.0f} % at least, at frame {used.at[used.worst]:.3g}",
        )
        for name, used in strips.items()
        if np.isfinite(used.values).any()
    ]
    ends = f"{to_goal_mm:.0f} mm from the goal, after {course.frames} key frames"
    planned = ("planned with", f"{100 * answer.share:.0f} % of the friction")
    return key_values([("robot", f"{robot.name}, {weight}"), *reserves, planned, ("ends", ends)])


def key_values(rows: list[tuple[str, str]]) -> str:
    """A few numbers with their names, as HTML."""
    return (
        '<table id="summary" style="font:12px/1.55 system-ui,sans-serif;margin:2px">'
        + "".join(
            f'<tr><td style="color:{_QUIET};padding-right:10px;white-space:nowrap">{html.escape(name)}</td>'
            f"<td>{html.escape(words)}</td></tr>"
            for name, words in rows
        )
        + "</table>"
    )


def _bar(share: float) -> str:
    """A share of a limit as a bar with its number; NaN is a dash."""
    if np.isnan(share):
        return f'<span style="color:{_QUIET}">–</span>'
    colour = BAD if share > 1.0 + 1e-6 else UNSURE if share > _TIGHT else GOOD
    return (
        f'<div style="display:flex;align-items:center;gap:5px"><div style="flex:1;min-width:34px;height:8px;'
        f'background:{_TROUGH};border-radius:4px;overflow:hidden"><div style="width:{100 * min(share, 1.0):.0f}%;'
        f'height:100%;background:{colour}"></div></div><span style="width:34px;text-align:right">{100 * share:.0f} %'
        "</span></div>"
    )
