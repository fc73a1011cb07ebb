"""Parts that the playground's pages share: their look, where they are seen from, verdicts, and
robots in a menu.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array

FOV_RAD = 0.75
BRAND = (39, 64, 127)
GOOD, UNSURE, BAD = (
    f"light-dark({pair})" for pair in ("#1d6f62, #5cc4b3", "#7a5f00, #e0bd4a", "#b81c33, #ff8b99")
)
"""Colours of good news, of what nobody knows yet, and of bad news, on light and on dark; each is at
least 4.5 : 1."""
QUIET, RULE, TROUGH = (
    f"light-dark({pair})" for pair in ("#5b6672, #a9b4c0", "#d5dae0, #4a525b", "#e3e7eb, #3d454e")
)
"""Colours of what is read last, of lines, and of the empty part of a bar. Text has the page's own
colour."""


def set_up(server: Any) -> None:
    """Colours and lights."""
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
    server.scene.configure_default_lights(cast_shadow=False)


def let_camera(server: Any, target_m: Array, away_m: float, towards: Array) -> None:
    """Set the first view of a page: the camera looks at ``target_m`` from a distance of ``away_m``,
    in the direction ``towards``, shape (3,).
    """
    camera = server.initial_camera
    camera.look_at, camera.fov = tuple(target_m), FOV_RAD
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


def said(colour: str, title: str, text: str, below: str, *, change: int, patient: bool) -> str:
    """A verdict as HTML: a title in its colour, a sentence, and a quiet line.

    Arguments:
        change: that it answers.
        patient: whether it is the last word on that.
    """
    return (
        f'<div id="verdict" data-change="{change}" data-patient="{int(patient)}" style="border-left:5px solid '
        f'{colour};padding:2px 0 4px 10px;margin:6px 2px;font:13px/1.45 system-ui,sans-serif">'
        f'<div style="font-size:15px;font-weight:700;color:{colour}">{html.escape(title)}</div>'
        f"<div>{html.escape(text)}</div>"
        f'<div style="color:{QUIET};font-size:11.5px">{html.escape(below)}</div></div>'
    )


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
