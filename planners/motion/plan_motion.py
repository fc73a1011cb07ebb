"""A plan as a timed motion: load moves to the limbs that stay, the others lift, swing and are put
down, the body moves.

Between two key frames one support holds. Body pose and forces run along the straight line between
its two stances with one common progress, so that every point on the way is in balance as both ends
are (toes held, linear in c and f).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..files.arrays import Array, check_numbers
from ..robot.leg import rotation_of
from .motion import Played, Samples, smooth, smooth_rate
from .path import PathMoments, PlanPath, Segment, path_of

KNOTS = 10
"""Postures are chosen so often in every phase."""
_Phase = tuple[float, Segment, Array, Array]
"""How long a segment of the path takes [s], and the forces that it begins and ends with."""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Durations of the phases.

    Arguments:
        settle_s: at rest before and after.
        transfer_s: load from one stance to the next.
        lift_s, place_s: along the patch's normal.
        foot_m_s, body_m_s, body_rad_s: greatest mean speeds of a swing, which lasts swing_s or
            longer.
    """

    settle_s: float = 0.4
    transfer_s: float = 0.5
    lift_s: float = 0.25
    place_s: float = 0.3
    swing_s: float = 0.6
    foot_m_s: float = 0.4
    body_m_s: float = 0.15
    body_rad_s: float = 0.3

    def __post_init__(self) -> None:
        check_numbers(self, "timing.", above=self.__annotations__)

    def at_pace(self, pace: float) -> Timing:
        """Timing that is faster by this factor."""
        faster = {item.name: getattr(self, item.name) for item in fields(self)}
        for name in faster:
            if name.endswith("_s"):
                faster[name] *= (
                    pace if name in ("foot_m_s", "body_m_s", "body_rad_s") else 1.0 / pace
                )
        return Timing(**faster)


def plan_motion(
    plan: Plan,
    timing: Timing = Timing(),
    forces_n: Array | None = None,
    longer: Array | None = None,
    standing_n: Mapping[int, Array] | None = None,
    *,
    uncarried: bool = False,
) -> Played:
    """A plan over time; ``Samples.frame`` counts key frames.

    Arguments:
        forces_n: of its stances, shape (S, N, 3) [N]; the plan's own where None. Those of soles have
            their moments about their middles behind them, shape (S, N, 6) [N, Nm].
        longer: so many times as long as ``Timing`` says every phase lasts, shape (P,).
        standing_n: of all limbs where no limb lifts, at its beginning and while the body moves
            alone, by key frame, shape (N, 3) [N] each; where there are none those carry that are to
            carry next.
        uncarried: all limbs may lift at once.

    Raises:
        InvalidInput: where all limbs lift at once unless they may: no limb carries, and no position
            control can do that.
    """
    lifts_all = uncarried and plan.problem.uncarried
    path = PlanPath(plan, uncarried=True) if lifts_all else path_of(plan)
    forces = plan.forces_n if forces_n is None else forces_n
    if (moments := plan.moments_nm) is not None:
        forces = np.concatenate([forces[..., :3], moments], axis=2)
    phases = _phases(path, timing, forces, standing_n or {})
    seconds = np.array([phase[0] for phase in phases])
    segments = tuple(phase[1] for phase in phases)
    of = _tables(path, segments, np.array([phase[2:] for phase in phases]))
    foothold = np.array([segment.foothold for segment in segments])

    def lasting(seconds: Array) -> Played:
        ends = np.cumsum(seconds)

        def at(times_s: float | Array) -> Samples:
            phase, s, rate = _passed(ends, seconds, times_s)
            along, speed = s[..., None], rate[..., None]
            forces = of["forces"][phase] + along[..., None] * of["loaded"][phase]
            return Samples(
                com_m=of["com"][phase] + along * of["moved"][phase],
                velocity_m_s=speed * of["moved"][phase],
                rotation_rad=of["rotation"][phase] + along * of["turned"][phase],
                rotation_rate_rad_s=speed * of["turned"][phase],
                frame=of["frame"][phase] + s * of["frames"][phase],
                feet_m=of["feet"][phase] + along[..., None] * of["stepped"][phase],
                radii_m=path.radii_m,
                forces_n=forces[..., :3],
                moments_nm=forces[..., 3:] if forces.shape[-1] > 3 else None,
                foothold=foothold[phase],
                normals=of["normals"][phase] + along[..., None] * of["tilted"][phase],
                friction=of["friction"][phase],
            )

        begun = (ends - seconds)[:, None] + (np.arange(KNOTS) / KNOTS) * seconds[:, None]
        return Played(
            at=at,
            knots_s=np.append(begun, ends[-1]),
            solids=path.solids,
            stances=tuple(
                f"{each.limb}, put down at frame {each.frame}," for each in plan.problem.footholds
            ),
            rest_s=float(seconds[0]),
            path=path,
            segments=segments,
            seconds=seconds,
            lasting=lasting,
        )

    return lasting(seconds if longer is None else seconds * longer)


def key_sample(path: PlanPath, frame: int) -> Samples:
    """A key frame as its plan has it, at rest, with the mean force of its stances.

    Angles are the plan's, the body is where legs that weigh nothing have it.
    """
    plan = path.plan
    holds = plan.problem.holds[frame]
    origin = plan.com_m[frame] - rotation_of(plan.rotation_rad[frame]) @ plan.problem.robot.origin_m
    return Samples(
        com_m=plan.com_m[frame],
        velocity_m_s=np.zeros(3),
        rotation_rad=plan.rotation_rad[frame],
        rotation_rate_rad_s=np.zeros(3),
        frame=np.array(float(frame)),
        feet_m=path.feet_m[holds],
        radii_m=path.radii_m,
        forces_n=plan.forces_at(frame),
        foothold=holds,
        normals=path.normals[holds],
        friction=path.friction[holds],
        origin_m=None if plan.joints_rad is None else origin,
        angles_rad=None if plan.joints_rad is None else plan.joints_rad[frame],
    )


def moments_at(motion: Played, times_s: Array) -> PathMoments:
    """Moments of body and feet of a plan's motion at times, whatever the forces."""
    assert motion.path is not None
    assert motion.seconds is not None
    phases, s, _ = _passed(np.cumsum(motion.seconds), motion.seconds, times_s)
    return motion.path.at(
        [(motion.segments[phase], s[k : k + 1]) for k, phase in enumerate(phases.tolist())]
    )


def step_s(motion: Played, frame: int) -> tuple[float, float]:
    """When the step of a plan's motion to a key frame begins, and when it ends [s]."""
    assert motion.path is not None
    assert motion.seconds is not None
    of = {id(segment) for segment in motion.path.steps[frame - 1]}
    indices = [index for index, segment in enumerate(motion.segments) if id(segment) in of]
    ends = np.cumsum(motion.seconds)
    first, last = indices[0], indices[-1]
    return float(ends[first] - motion.seconds[first]), float(ends[last])


def reached_s(motion: Played) -> Array:
    """When a plan's motion reaches each key frame, shape (M,) [s]."""
    assert motion.path is not None
    steps = range(1, len(motion.path.steps) + 1)
    return np.array([0.0, *(step_s(motion, frame)[1] for frame in steps)])


def _passed(
    ends: Array, seconds: Array, times_s: float | Array
) -> tuple[NDArray[np.int_], Array, Array]:
    """Phase at each time, the share of its path that is passed, and the rate of that [1/s].

    Arguments:
        ends, seconds: when each phase ends, and how long it lasts, shape (P,) [s].
    """
    when = np.asarray(times_s, dtype=np.float64)
    phase = np.minimum(ends.searchsorted(when, side="left"), len(ends) - 1)
    lasts = seconds[phase]
    passed = np.minimum(np.maximum((when - (ends[phase] - lasts)) / lasts, 0.0), 1.0)
    return phase, smooth(passed), smooth_rate(passed) / lasts


def _tables(path: PlanPath, segments: tuple[Segment, ...], forces: Array) -> dict[str, Array]:
    """Tables of what every phase begins with and adds, by name, one row per phase.

    Arguments:
        forces: with which each begins and ends, shape (P, 2, N, 3) or (P, 2, N, 6).
    """
    plan = path.plan
    frames = np.array([segment.frames for segment in segments])
    feet = np.array([segment.feet_m for segment in segments])
    ups = np.array([segment.ups for segment in segments])
    (a, b), last = frames.T, frames[:, 1] - frames[:, 0]
    return {
        "com": plan.com_m[a],
        "moved": plan.com_m[b] - plan.com_m[a],
        "rotation": plan.rotation_rad[a],
        "turned": plan.rotation_rad[b] - plan.rotation_rad[a],
        "frame": a.astype(np.float64),
        "frames": last.astype(np.float64),
        "feet": feet[:, 0],
        "stepped": feet[:, 1] - feet[:, 0],
        "forces": forces[:, 0],
        "loaded": forces[:, 1] - forces[:, 0],
        "normals": ups[:, 0],
        "tilted": ups[:, 1] - ups[:, 0],
        "friction": path.friction[np.array([segment.surface for segment in segments])],
    }


def _phases(
    path: PlanPath, timing: Timing, forces_n: Array, standing_n: Mapping[int, Array]
) -> list[_Phase]:
    """The phases in order, those that take no time left out."""

    def carried(frame: int, step: int) -> Array:
        """Forces at a frame of those that carry during the step to key frame ``step``; where all of
        them do, those with which all stand, or else the mean of what the plan has there.
        """
        support = path.support(step)
        if len(support) == len(path.plan.problem.robot.limbs) and frame in standing_n:
            return standing_n[frame]
        return path.plan.forces_at(frame, support, forces_n)

    last, load = path.plan.problem.frames - 1, carried(0, 1)
    result = [(timing.settle_s, path.standing(0), standing_n.get(0, load), load)]
    for k in range(1, last + 1):
        before, after = carried(k - 1, k), carried(k, k)
        result.append((timing.transfer_s, path.standing(k - 1), load, before))
        result += _step(path, timing, k, before, after)
        load = after
    end = carried(last, last + 1)
    result.append((timing.transfer_s, path.standing(last), load, end))
    result.append((2.0 * timing.settle_s, path.standing(last), end, end))
    return [phase for phase in result if phase[0] > 0.0]


def _step(path: PlanPath, timing: Timing, k: int, before: Array, after: Array) -> list[_Phase]:
    """Lift, swing and place the limbs of frame k; the body moves during the swing."""
    plan, parts = path.plan, path.steps[k - 1]
    across = parts[1] if len(parts) == 3 else parts[0]
    swing_s = max(
        timing.swing_s,
        across.length_m / timing.foot_m_s,
        float(np.linalg.norm(plan.com_m[k] - plan.com_m[k - 1])) / timing.body_m_s,
        float(np.linalg.norm(plan.rotation_rad[k] - plan.rotation_rad[k - 1])) / timing.body_rad_s,
    )
    if len(parts) < 3:
        return [(swing_s, across, before, after)]
    lift_s, place_s = (
        seconds * segment.length_m / path.lift_m
        for seconds, segment in ((timing.lift_s, parts[0]), (timing.place_s, parts[2]))
    )
    return [
        (lift_s, parts[0], before, before),
        (swing_s, across, before, after),
        (place_s, parts[2], after, after),
    ]
