"""A film and the stream of a run, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from stancekit import Motion
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.gait_motion import WALK_SETTLE_S
from stancekit.planners.motion.motion import Samples, stacked
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.body_feedback import BodyFeedback
from stancekit.runner.control.tracker import Target
from stancekit.runner.log import Record
from stancekit.runner.prepared import Tracked
from stancekit.runner.run import Runner, Until
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds.world import Terrain, make_world
from stancekit.views.gaits import GaitView
from stancekit.views.plans import PlanView
from stancekit.views.scene import Animation, Scene

NAMES = (
    "com_m",
    "rotation_rad",
    "frame",
    "feet_m",
    "forces_n",
    "foothold",
    "origin_m",
    "angles_rad",
)


class Kept(Runner):
    """A runner that keeps what it streamed."""

    streamed: tuple[Target, ...] = ()

    def follow(
        self, tracked: Tracked, record: Record, until: Until = lambda target, state: False
    ) -> bool:
        """As of ``Runner``."""
        ended = super().follow(tracked, record, until)
        self.streamed = (tracked.first, *(target for target, _ in record.pairs))
        return ended


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """What differs most between a film and a stream, by name, in SI units; looked: how many samples
    that is of.
    """

    differs: dict[str, float]
    looked: int


def compared(subject: Motion, rate_hz: float = 100.0, *, blind: bool = True) -> Comparison:
    """Run a plan or a walk in MuJoCo, and compare what was sent with the pictures of its film.

    blind: the run uses nothing that is measured; else what its feet feel is fed back.
    """
    view = PlanView(subject) if subject.keyed else GaitView(subject)
    targets = streamed_targets(subject, rate_hz, blind=blind)
    film = view.film()
    times: Array = np.arange(len(film.moments)) * np.float64(film.step_s) + WALK_SETTLE_S
    if isinstance(view, PlanView):
        times = view.shown_s(len(film.moments))
    kept = [round(time_s * rate_hz) for time_s in times]
    kept = [row for row in kept if row < len(targets)]
    sent, seen = (
        stacked([sample_of(targets[row]) for row in kept]),
        view.motion.at(times[: len(kept)]),
    )
    differs = {name: _most(getattr(seen, name), getattr(sent, name)) for name in NAMES}
    differs["pictures"] = _drawn(view, film, [targets[row] for row in kept])
    return Comparison(differs=differs, looked=len(kept))


def streamed_targets(subject: Motion, rate_hz: float, *, blind: bool = True) -> tuple[Target, ...]:
    """What a run in MuJoCo streams from the beginning of the motion to its end."""
    settings = RunSettings(blind=blind, body=BodyFeedback())
    if subject.keyed:
        accepted: Accepted = Accepted.verified(subject, "plan")
        robot, ground = subject.problem.robot, cast("Terrain", subject.problem.terrain)
    else:
        walk = Accepted.verified(subject, "walk")
        accepted, robot, ground = walk, walk.robot, walk.plan.ground()
    with make_world("mujoco", robot, rate_hz=rate_hz) as world:
        runner = Kept(world, settings=settings)
        report = runner.run(accepted, ground)
    assert report.succeeded, report.message
    return runner.streamed


def sample_of(target: Target) -> Samples:
    """A target as a sample of a motion."""
    return replace(target.sample, origin_m=target.origin_m, angles_rad=target.angles_rad)


def _drawn(view: PlanView | GaitView, film: Animation, targets: list[Target]) -> float:
    """How far bodies of the pictures are from where the same view draws what was sent [m]."""
    worst = 0.0
    for moment, target in zip(film.moments, targets, strict=False):
        now = sample_of(target)
        drawn = (
            Scene(bodies=view.bodies(now))
            if isinstance(view, GaitView)
            else view.at(now, cone_m=0.3 * view.shape.size_m)
        )
        worst = max(worst, _apart(moment, drawn))
    return worst


def _apart(one: Scene, other: Scene) -> float:
    """The greatest distance of bodies of the same name that move."""
    places = {body.name: body.position_m for body in one.bodies}
    pairs = [(places[body.name], body.position_m) for body in other.bodies]
    assert len(pairs) > 6
    return max(float(np.abs(a - b).max()) for a, b in pairs)


def _most(one: Array | None, other: Array | None) -> float:
    assert one is not None
    assert other is not None
    return float(np.abs(np.asarray(one, dtype=float) - other).max())
