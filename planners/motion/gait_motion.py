"""Walks, leaps and crossings as motions that the tracker follows: at rest before and after, at
their own pace in between.

They are dynamic: at another pace their forces balance no longer, so they are run as planned or not
at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.certificate import Way
from ..answer.motion import Motion
from ..answer.trajectory import Trajectory
from ..files.arrays import Array
from ..robot.robot_file import FOOT_RADIUS_M
from .leap_motion import SETTLE_S, feet_of_leap, leap_motion
from .motion import Played, Samples, combined, rotation_rate, smooth, smooth_rate
from .plan_motion import plan_motion

BLEND_S = 1.0
"""From the end of one part to the beginning of the next."""
_BLEND_KNOTS = 10


def crossing_motion(crossing: Motion[Way], climbs: Sequence[Played] | None = None) -> Played:
    """A crossing over time; ``Samples.frame`` counts seconds.

    Arguments:
        crossing: the crossing.
        climbs: the motions of its plans of key frames, timed by whoever follows them; None for
            those of the plans as they are.

    Raises:
        InvalidInput: for a robot without legs of its own, and for climbs in which no limb carries.
    """
    timed = iter(climbs or map(plan_motion, crossing.climbs))
    parts = [
        next(timed) if part.keyed else leap_motion(part, rest_s=SETTLE_S) for part in crossing.parts
    ]
    begins = np.cumsum([0.0, *(part.duration_s + BLEND_S for part in parts[:-1])])
    ends = begins + [part.duration_s for part in parts]
    numbers, stances = _numbered(crossing, parts)

    def of(k: int, within_s: Array, time_s: Array) -> Samples:
        """The samples of a part at times of its own, by the numbers of the whole."""
        sample = parts[k].at(within_s)
        foothold = np.where(sample.foothold >= 0, numbers[k][np.maximum(sample.foothold, 0)], -1)
        return replace(sample, foothold=foothold, frame=np.clip(time_s, 0.0, ends[-1]))

    def blended(k: int, when: Array) -> Samples:
        """Samples on the way from the end of the part before to the beginning of this one."""
        s = (when - ends[k - 1]) / BLEND_S
        last = np.full_like(when, parts[k - 1].duration_s)
        before, after = of(k - 1, last, when), of(k, np.zeros_like(when), when)
        share, rate = smooth(s)[:, None], (smooth_rate(s) / BLEND_S)[:, None]
        com, turn = (
            getattr(after, name) - getattr(before, name) for name in ("com_m", "rotation_rad")
        )
        return replace(
            after,
            com_m=before.com_m + share * com,
            velocity_m_s=rate * com,
            rotation_rad=before.rotation_rad + share * turn,
            rotation_rate_rad_s=rate * turn,
            feet_m=before.feet_m + share[..., None] * (after.feet_m - before.feet_m),
            forces_n=before.forces_n + share[..., None] * (after.forces_n - before.forces_n),
        )

    def at(times_s: float | Array) -> Samples:
        times = np.asarray(times_s, dtype=np.float64)
        when = times.ravel()
        part = ends.searchsorted(when).clip(0, len(parts) - 1)
        within, pieces = when - begins[part], list[tuple[NDArray[np.int_], Samples]]()
        for k in range(len(parts)):
            begun = (within >= 0.0) | (k == 0)
            if len(here := np.flatnonzero((part == k) & begun)):
                pieces.append((here, of(k, within[here], when[here])))
            if len(here := np.flatnonzero((part == k) & ~begun)):
                pieces.append((here, blended(k, when[here])))
        order = np.argsort(np.concatenate([rows for rows, _ in pieces]))
        sampled = [samples for _, samples in pieces]
        rows = combined(sampled, lambda tables: np.concatenate(tables)[order])
        return rows if times.ndim else rows.rows()[0]

    between = [np.linspace(ends[k - 1], begins[k], _BLEND_KNOTS + 1) for k in range(1, len(parts))]
    knots = [parts[0].knots_s]
    for k, blend in enumerate(between, 1):
        knots += [blend[1:-1], begins[k] + parts[k].knots_s]
    committed = [
        (begin + first, begin + last)
        for begin, part in zip(begins.tolist(), parts, strict=True)
        for first, last in part.committed_s
    ]
    return Played(
        at=at,
        knots_s=np.concatenate(knots),
        solids=parts[0].solids,
        stances=stances,
        committed_s=tuple(committed),
    )


def _numbered(
    crossing: Motion[Way], parts: Sequence[Played]
) -> tuple[list[NDArray[np.int_]], tuple[str, ...]]:
    """Number of every foothold of every part in the whole, those that stand when a part begins
    being those of the one before; and what each is called.
    """
    numbers, names, standing = list[NDArray[np.int_]](), list[str](), None
    for k, (part, motion) in enumerate(zip(crossing.parts, parts, strict=True), 1):
        holds, mine = part.problem.holds, np.zeros(len(part.problem.footholds), dtype=int)
        for j, foothold in enumerate(part.problem.footholds):
            if standing is not None and foothold.frame == 0:
                mine[j] = standing[part.problem.robot.limb_names.index(foothold.limb)]
                continue
            mine[j] = len(names)
            names.append(f"part {k}: {motion.stances[j]}")
        numbers.append(mine)
        standing = mine[holds[-1]]
    return numbers, tuple(names)


WALK_SETTLE_S = 0.5
"""At rest before and after."""
_KNOT_S = 0.05
"""Comfortable postures are looked for so often."""


def gait_motion(trajectory: Trajectory, radii_m: Array | float = FOOT_RADIUS_M) -> Played:
    """A walk over time; ``Samples.frame`` counts seconds, and ``foothold`` the stances of all feet.

    Feet are spheres: a radius above what they touch.

    Arguments:
        radii_m: of the feet, shape (N,), or of all of them.
    """
    from scipy.spatial.transform import Rotation, Slerp  # slow to import

    times, torso, contact = trajectory.times_s, trajectory.torso_m, trajectory.contact
    radii = np.broadcast_to(radii_m, (len(trajectory.robot.feet),))
    rotations = Rotation.from_matrix(trajectory.rotation)
    turned, turns = Slerp(times, rotations), (rotations[1:] * rotations[:-1].inv()).as_rotvec()
    facing, foothold = (
        trajectory.problem.terrain.normal(trajectory.feet_m[..., :2]),
        footholds(contact),
    )
    duration_s = trajectory.duration_s + 2.0 * WALK_SETTLE_S

    def at(times_s: float | Array) -> Samples:
        when = np.asarray(times_s, dtype=np.float64)
        now = np.clip(times[0] + when - WALK_SETTLE_S, times[0], times[-1])
        k = np.clip(np.searchsorted(times, now, side="right") - 1, 0, len(times) - 2)
        last = times[k + 1] - times[k]
        s = (now - times[k]) / last

        def between(table: Array) -> Array:
            share = s.reshape(s.shape + (1,) * (table.ndim - 1))
            return np.asarray(table[k] + share * (table[k + 1] - table[k]))

        normals = between(facing)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        walks = (now == times[0] + when - WALK_SETTLE_S)[..., None] / last[..., None]
        rotation = np.asarray(turned(now).as_rotvec())
        return Samples(
            com_m=between(torso),
            velocity_m_s=walks * (torso[k + 1] - torso[k]),
            rotation_rad=rotation,
            rotation_rate_rad_s=rotation_rate(rotation, walks * turns[k]),
            frame=np.clip(when, 0.0, duration_s),
            feet_m=between(trajectory.feet_m) + radii[:, None] * normals,
            radii_m=radii,
            forces_n=between(trajectory.forces_n),
            foothold=foothold[k + (s >= 1.0)],
            normals=normals,
            friction=np.full((*when.shape, len(radii)), trajectory.problem.friction),
        )

    begins = (np.argwhere(foothold == k)[0] for k in range(int(foothold.max()) + 1))
    return Played(
        at=at,
        knots_s=np.linspace(0.0, duration_s, int(np.ceil(duration_s / _KNOT_S)) + 1),
        stances=tuple(
            f"{trajectory.robot.limb_names[foot]}, put down at {times[row]:.2f} s,"
            for row, foot in begins
        ),
    )


def footholds(contact: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of the stance that every foot is in, counted over all feet, −1 in the air; contact and
    result: shape (K, E).
    """
    begins = contact & ~np.vstack([np.zeros((1, contact.shape[1]), dtype=np.bool_), contact[:-1]])
    count = np.cumsum(begins, axis=0)
    before = np.concatenate([[0], np.cumsum(count[-1])[:-1]])
    return np.where(contact, before + count - 1, -1)


def feet_motion(subject: Motion[Any]) -> Played:
    """The motion of a plan, a walk, a leap or a crossing, timed as ``run`` times it where no joint
    asks for more time.

    A plan may also lift all limbs at once; the runner refuses such a plan.
    """
    if subject.has("parts"):
        return crossing_motion(subject)
    if subject.has("times_s"):
        return gait_motion(subject, subject.robot.foot_radii_m)
    return plan_motion(subject, uncarried=True) if subject.keyed else feet_of_leap(subject)
