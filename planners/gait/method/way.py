"""Walks along a guide path, in pieces that share their ends: each goes straight from one place to the next and ends as
the robot stands, so that the next one begins there, and all together are one walk, which the verifier judges as a
whole.

What a piece costs depends on its own length; one that has no walk is tried as two of half its length.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...answer.report import Report
from ...answer.trajectory import Trajectory
from ...errors import InvalidInput, PlanningFailed
from ...files.arrays import Array
from ...problem.guide_path import Footprint, GuidePath, guide_over
from ...problem.walk import Walk
from ...verify.trajectories import check_trajectory
from ..constraints.footing import steepest
from ..task import GaitSettings
from .attempt import Attempt, Attempted, Progress
from .budget import SolveRecord
from .checkpoint import Checkpoint
from .portfolio import Attempts, Caps, default_attempts, plan_gait

LOG = logging.getLogger(__name__)
FAR_M = 6.0
"""Longer walks are planned in pieces, whatever is in their way."""
WALL = 2.0
"""Terrain that is nowhere steeper has no walls, only slopes."""
PIECE_M = 1.6
"""Length of a piece, about."""
TURN_RAD = 0.02
"""A path that turns by less goes straight on."""
LEAST_S = 3.0
"""How long a piece lasts at least [s]."""
EVEN_S = 0.5
"""Pieces last a whole number of these, which spacings of knots and nodes divide [s]."""
AGAIN = 2
"""So often a piece without a walk is cut in two."""
PATIENCE = 4.0
"""A piece may take so many times its share of the time that is left."""


def guided(task: Walk) -> GuidePath | None:
    """The guide path of a walk that is planned in pieces: one that is long, or whose straight way is barred; else None,
    also for a short walk without such a path, which may be walked all the same: nothing is proved by its absence.

    Raises InvalidInput for a long walk whose start or goal the robot cannot stand at, and PlanningFailed where a long
    one has no way.
    """
    length = float(np.linalg.norm(task.goal_xy_m - task.start_xy_m))
    turns = task.yaws()[0] != task.yaws()[1]
    if any(task.adhesive) or turns or (length < FAR_M and steepest(task.terrain) < WALL):
        return None
    footprint = Footprint.of_walker(task.robot, task.start_yaw_rad)
    ends = np.array([task.start_xy_m, task.goal_xy_m])
    try:
        path, straight = guide_over(task.terrain, footprint, ends, task.friction)
    except (InvalidInput, PlanningFailed) as error:
        if length >= FAR_M:
            raise
        LOG.info("walk: no guide path: %s", error)
        return None
    return None if straight and length < FAR_M else path


def pieces_of(task: Walk, path: GuidePath) -> list[Walk]:
    """Walks straight from place to place along a path, as fast as the whole is asked to be, and no shorter than
    ``LEAST_S``."""
    places = _spread(path.points_m[:, :2])
    legs = np.linalg.norm(np.diff(places, axis=0), axis=1)
    pace = task.duration_s / path.length_m
    return [_between(task, places[k], places[k + 1], _lasting(leg * pace)) for k, leg in enumerate(legs)]


def _lasting(seconds: float) -> float:
    """Duration, rounded to ``EVEN_S`` and no shorter than a piece may be [s]."""
    return max(LEAST_S, EVEN_S * round(seconds / EVEN_S))


def _between(task: Walk, start: Array, goal: Array, duration_s: float) -> Walk:
    return replace(
        task, start_xy_m=start, goal_xy_m=goal, duration_s=duration_s, end_yaw_rad=task.start_yaw_rad
    )  # fmt: skip


def _spread(corners: Array) -> Array:
    """Places on a line through corners, those among them, no farther apart than ``PIECE_M``."""
    ahead = np.diff(corners, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    turns = np.linalg.norm(np.diff(ahead, axis=0), axis=1) > TURN_RAD
    found = [corners[0]]
    for corner in corners[1:][np.append(turns, True)]:
        count = math.ceil(float(np.linalg.norm(corner - found[-1])) / PIECE_M)
        found += [found[-1] + (corner - found[-1]) * k / count for k in range(1, count + 1)]
    return np.array(found)


def joined_walks(task: Walk, walks: Sequence[Trajectory]) -> Trajectory:
    """Walks each of which begins where the one before ends, as one."""
    first, clock = walks[0], 0.0
    parts: dict[str, list[Any]] = {}
    step_s = first.step_s
    for number, walk in enumerate(walks):
        own = slice(0 if number == 0 else 1, None)
        for name in ("torso_m", "rotation", "feet_m", "forces_n", "contact"):
            parts.setdefault(name, []).append(getattr(walk, name)[own])
        clock += walk.samples - (number > 0)
    whole: dict[str, Any] = {name: np.concatenate(each) for name, each in parts.items()}
    times_s = np.asarray(step_s * np.arange(int(clock)), dtype=np.float64)
    return replace(
        first, **whole, times_s=times_s, goal_xy_m=task.goal_xy_m, heading_end_rad=task.end_yaw_rad,
        provenance={**first.provenance, "pieces": float(len(walks))},
    )  # fmt: skip


def plan_walk(
    task: Walk,
    settings: GaitSettings | None = None,
    progress: Progress | None = None,
    *,
    caps: Caps | None = None,
    attempts: Sequence[Attempt] | None = None,
    checkpoint: Checkpoint | None = None,
) -> Attempts:
    """``plan_gait``, or, of a walk that is long or whose straight way is barred, the same along its guide path piece by
    piece; the one attempt is then the whole.

    Arguments and errors are those of ``plan_gait``; a walk without a way has no attempts, and its failure names what is
    in the way. checkpoint: of a walk in one piece; one in pieces begins anew.
    """
    settings, caps = settings or GaitSettings(), caps or Caps()
    try:
        path = guided(task)
    except PlanningFailed as error:
        return Attempts(walk=task, attempts=(), feasible=(), solves=(), failures=(str(error),))
    if path is None:
        return plan_gait(task, settings, progress, caps=caps, attempts=attempts, checkpoint=checkpoint)
    begun = time.process_time()
    done, solves = list[Attempted](), list[SolveRecord]()
    left = [(piece, 0) for piece in pieces_of(task, path)]
    while left:
        piece, cut = left.pop(0)
        remains_s = caps.total_s - (time.process_time() - begun)
        share_s = min(remains_s, PATIENCE * remains_s / (len(left) + 1))
        if share_s <= 0.0:
            return _ended(
                task, done, solves, f"the time limit ended after {len(done)} pieces of {len(left) + 1 + len(done)}"
            )
        own = default_attempts(piece) if attempts is None or len(attempts) > 1 else attempts
        found = plan_gait(
            piece, replace(settings, poised=True), progress, caps=replace(caps, total_s=share_s), attempts=own
        )
        solves += found.solves
        LOG.info("walk: piece %d, %d to go: %s", len(done) + 1, len(left), found.message)
        if found.best is not None and found.verified:
            done.append(found.best)
            continue
        if found.stopped:
            return replace(_ended(task, done, solves, found.message), stopped=True)
        if cut >= AGAIN:
            return _ended(
                task, done, solves, f"from ({piece.start_xy_m[0]:.2f}, {piece.start_xy_m[1]:.2f}): {found.message}"
            )
        middle = 0.5 * (piece.start_xy_m + piece.goal_xy_m)
        half_s = _lasting(0.5 * piece.duration_s)
        left[:0] = [
            (_between(task, piece.start_xy_m, middle, half_s), cut + 1),
            (_between(task, middle, piece.goal_xy_m, half_s), cut + 1),
        ]
    whole = joined_walks(task, [one.trajectory for one in done])
    report: Report[Trajectory] = check_trajectory(whole)
    last = done[-1]
    attempt = replace(
        last, trajectory=whole, report=report, iterations=sum(one.iterations for one in done),
        seconds=sum(one.seconds for one in done), history=np.concatenate([one.history for one in done]),
    )  # fmt: skip
    return Attempts(walk=task, attempts=(attempt,), feasible=(report,), solves=tuple(solves))


def _ended(task: Walk, done: Sequence[Attempted], solves: Sequence[SolveRecord], why: str) -> Attempts:
    """No walk: pieces that were planned alone are none."""
    said = f"planned {len(done)} pieces of a walk round; the next one: {why}"
    return Attempts(walk=task, attempts=(), feasible=(), solves=tuple(solves), failures=(said,))
