"""Walks along a guide path, in pieces that share their ends: each goes straight from one place to
the next and ends as the robot stands, so that the next one begins there, and all together are one
walk, which the verifier judges as a whole.

What a piece costs depends on its own length. One that has no walk is tried as two of half its
length, and then another way is taken round its middle.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...answer.report import Report
from ...answer.trajectory import Trajectory
from ...errors import InvalidInput, NoPlace, PlanningFailed
from ...files.arrays import Array
from ...problem.guide_path import Footprint, GuidePath, guide_over
from ...problem.walk import Walk
from ...verify.trajectories import check_trajectory
from ..settings import GaitSettings
from .attempt import Attempt, Attempted, Progress, SolveRecord, cpu_s
from .portfolio import Attempts, Caps, default_attempts, plan_gait

LOG = logging.getLogger(__name__)
FAR_M = 6.0
"""Longer walks are planned in pieces, whatever is in their way."""
_WALL = 2.0
"""Terrain that is nowhere steeper has no walls, only slopes."""
PIECE_M = 1.6
"""Length of a piece, about."""
TURN_RAD = 0.02
"""A path that turns by less goes straight on."""
_LEAST_S = 3.0
"""Least duration of a piece [s]."""
_EVEN_S = 0.5
"""Pieces last a whole number of these, which spacings of knots and nodes divide [s]."""
_AGAIN = 2
"""So often a piece without a walk is cut in two."""
_DETOURS = 2
"""Other ways that are tried, all pieces together."""
_PATIENCE = 4.0
"""A piece may take so many times its share of the time that is left."""


def guided(task: Walk) -> GuidePath | None:
    """The guide path of a walk that is planned in pieces: one that is long, or whose straight way
    is barred; else None, also for a short walk without such a path, which may be walked all the
    same: nothing is proved by its absence.

    Raises InvalidInput for a start or goal in a solid, and of a long walk also for one that the
    robot cannot stand at, and PlanningFailed where a long one has no way.
    """
    length = float(np.linalg.norm(task.goal - task.start))
    turns = task.yaws()[0] != task.yaws()[1]
    if any(task.adhesive) or turns or (length < FAR_M and task.terrain.steepest < _WALL):
        return None
    footprint = Footprint.of_walker(task.robot, task.start_yaw_rad)
    ends = np.array([task.start, task.goal])
    for name, place in zip(("start", "goal"), ends, strict=True):
        ground = float(np.median(task.terrain.height(place + footprint.toes_m[:, :2])))
        high = float(task.terrain.height(place)) - ground
        if high > task.robot.stand_height_m:  # the torso would be in it
            raise NoPlace(
                f"{name}: expected a place outside of solids, got ({place[0]:g}, {place[1]:g}) in "
                "a solid that is "
                f"{high:.3g} m high"
            )
    try:
        path, straight = guide_over(task.terrain, footprint, ends, task.friction)
    except (InvalidInput, PlanningFailed) as error:
        if length >= FAR_M:
            raise
        LOG.info("walk: no guide path: %s", error)
        return None
    return None if straight and length < FAR_M else path


def pieces_of(task: Walk, path: GuidePath) -> list[Walk]:
    """Walks straight from place to place along a path, as fast as the whole is asked to be, and no
    shorter than ``_LEAST_S``.
    """
    places = _spread(path.points_m[:, :2])
    legs = np.linalg.norm(np.diff(places, axis=0), axis=1)
    pace = task.duration_s / path.length_m
    return [
        _between(task, places[k], places[k + 1], _lasting(leg * pace)) for k, leg in enumerate(legs)
    ]


def _lasting(seconds: float) -> float:
    """Duration, rounded to ``_EVEN_S`` and no shorter than a piece may be [s]."""
    return max(_LEAST_S, _EVEN_S * round(seconds / _EVEN_S))


def _between(task: Walk, start: Array, goal: Array, duration_s: float) -> Walk:
    return replace(
        task,
        start=start,
        goal=goal,
        duration_s=duration_s,
        end_yaw_rad=task.start_yaw_rad,
    )


def _spread(corners: Array) -> Array:
    """Places on a line through corners, those among them, no farther apart than ``PIECE_M``."""
    ahead = np.diff(corners, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    turns = np.linalg.norm(np.diff(ahead, axis=0), axis=1) > TURN_RAD
    points = [corners[0]]
    for corner in corners[1:][np.append(turns, True)]:
        count = math.ceil(float(np.linalg.norm(corner - points[-1])) / PIECE_M)
        points += [points[-1] + (corner - points[-1]) * k / count for k in range(1, count + 1)]
    return np.array(points)


def _joined_walks(task: Walk, walks: Sequence[Trajectory]) -> Trajectory:
    """Walks each of which begins where the one before ends, as one."""
    first, last, clock = walks[0], walks[-1], 0
    parts: dict[str, list[Any]] = {}
    for number, walk in enumerate(walks):
        rows = slice(0 if number == 0 else 1, None)
        for name in ("torso_m", "rotation", "feet_m", "forces_n", "contact"):
            parts.setdefault(name, []).append(getattr(walk, name)[rows])
        clock += walk.samples - (number > 0)
    whole: dict[str, Any] = {name: np.concatenate(each) for name, each in parts.items()}
    times_s = np.asarray(first.step_s * np.arange(clock), dtype=np.float64)
    asked = last.asked(
        start=first.problem.start,
        heading_rad=first.problem.heading_rad,
        heading_end_rad=task.end_yaw_rad,
    )
    return replace(asked, **whole, times_s=times_s)


def plan_walk(
    task: Walk,
    settings: GaitSettings | None = None,
    progress: Progress | None = None,
    *,
    caps: Caps | None = None,
    attempts: Sequence[Attempt] | None = None,
) -> Attempts:
    """``plan_gait``, or, of a walk that is long or whose straight way is barred, the same along its
    guide path piece by piece; the one attempt is then the whole.

    Arguments and errors are those of ``plan_gait``; a walk without a way has no attempts, and its
    failure names what is in the way.
    """
    settings, caps = settings or GaitSettings(), caps or Caps()
    try:
        path = guided(task)
    except PlanningFailed as error:
        return Attempts(walk=task, attempts=(), feasible=(), solves=(), failures=(str(error),))
    if path is None:
        return plan_gait(task, settings, progress, caps=caps, attempts=attempts)
    begun, way = cpu_s(), _Way(task, path)
    done, solves = list[Attempted](), list[SolveRecord]()
    while way.left:
        piece, _ = way.left[0]
        remains_s = caps.total_s - (cpu_s() - begun)
        share_s = min(remains_s, _PATIENCE * remains_s / len(way.left))
        if share_s <= 0.0:
            pieces = f"{way.done} pieces of {len(way.left) + way.done}"
            return _ended(task, way, solves, f"the time limit ended after {pieces}")
        choices = default_attempts(piece) if attempts is None or len(attempts) > 1 else attempts
        watched, share_caps = (
            None if progress is None else way.telling(progress),
            replace(caps, total_s=share_s),
        )
        attempts_of_piece = plan_gait(
            piece, replace(settings, poised=True), watched, caps=share_caps, attempts=choices
        )
        solves += attempts_of_piece.solves
        LOG.info(
            "walk: piece %d, %d to go: %s",
            way.done + 1,
            len(way.left) - 1,
            attempts_of_piece.message,
        )
        if attempts_of_piece.stopped:
            return replace(_ended(task, way, solves, attempts_of_piece.message), stopped=True)
        if attempts_of_piece.best is not None and attempts_of_piece.verified:
            done.append(attempts_of_piece.best)
        try:
            way.go(attempts_of_piece.verified)
        except (InvalidInput, PlanningFailed) as error:
            place = f"from ({piece.start[0]:.2f}, {piece.start[1]:.2f})"
            other = f"; another way: {error}" if str(error) else ""
            return _ended(task, way, solves, f"{place}: {attempts_of_piece.message}{other}")
    walked = _joined_walks(task, [one.trajectory for one in done])
    told = {**walked.provenance, **way.told}
    whole = replace(walked.asked(goal=task.goal), provenance=told)
    report: Report[Trajectory] = check_trajectory(whole)
    attempt = replace(
        done[-1],
        trajectory=whole,
        report=report,
        iterations=sum(one.iterations for one in done),
        seconds=sum(one.seconds for one in done),
        history=np.concatenate([one.history for one in done]),
    )
    return Attempts(walk=task, attempts=(attempt,), feasible=(report,), solves=tuple(solves))


class _Way:
    """The pieces of a walk that are left, and how many are done."""

    def __init__(self, task: Walk, path: GuidePath) -> None:
        self._task, self._pace = task, task.duration_s / path.length_m
        self.paths_m, self._avoid_m = [path.points_m], list[Array]()
        self.done = 0
        self.left = [(piece, 0) for piece in pieces_of(task, path)]

    @property
    def told(self) -> dict[str, str | float]:
        """Number of pieces, and the guide path and the ways that were left for another, for
        pictures.
        """
        paths = [np.round(points, 3).tolist() for points in self.paths_m]
        return {"pieces": float(self.done), "guide_m": json.dumps(paths)}

    def telling(self, progress: Progress) -> Progress:
        """Progress that reports the piece with the phase."""
        piece = f"piece {self.done + 1} of {self.done + len(self.left)}"

        def told(
            attempt: Attempt, iteration: int, violation: float, cost: float, phase: str
        ) -> bool | None:
            return progress(attempt, iteration, violation, cost, f"{piece}, {phase}")

        return told

    def go(self, planned: bool) -> None:
        """Go on after the next piece: cut in two, or another way round it, where it was not planned.

        Raises InvalidInput and PlanningFailed where there is no other way.
        """
        piece, cut = self.left[0]
        if planned:
            del self.left[0]
            self.done += 1
        elif cut < _AGAIN:
            middle, half_s = (
                0.5 * (piece.start + piece.goal),
                _lasting(0.5 * piece.duration_s),
            )
            self.left[:1] = [
                (_between(self._task, piece.start, middle, half_s), cut + 1),
                (_between(self._task, middle, piece.goal, half_s), cut + 1),
            ]
        else:
            if len(self._avoid_m) >= _DETOURS:
                raise PlanningFailed("")
            place = 0.5 * (piece.start + piece.goal)
            ends = np.array([piece.start, self._task.goal])
            footprint = Footprint.of_walker(self._task.robot, self._task.start_yaw_rad)
            avoid = [*self._avoid_m, place]
            path, _ = guide_over(self._task.terrain, footprint, ends, self._task.friction, avoid)
            onward = replace(self._task, start=ends[0], duration_s=self._pace * path.length_m)
            self._avoid_m, self.left = avoid, [(each, 0) for each in pieces_of(onward, path)]
            self.paths_m.append(path.points_m)


def _ended(task: Walk, way: _Way, solves: Sequence[SolveRecord], why: str) -> Attempts:
    """No walk: pieces that were planned alone are none."""
    message = f"planned {way.done} pieces of a walk round; the next one: {why}"
    return Attempts(walk=task, attempts=(), feasible=(), solves=tuple(solves), failures=(message,))
