"""The runner: an accepted plan, forwarded to a world one control period after the other, and what came of it.

Before the first motion: the plan's verdict, its robot, and inverse kinematics of the whole motion, slowed down to what
the joints can do. Then the soft start from the pose that was measured, then the motion; limbs are unloaded before they
lift and loaded after they land, as ``Motion`` has it. Whatever happens, it ends as was asked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count

import numpy as np

from stancekit.planners.errors import HardwareFault
from stancekit.planners.files.arrays import Array, checked, gathered
from stancekit.planners.robot.kinematics import Kinematics, rotation_of

from .acceptance import Accepted
from .accepted_gait import AcceptedGait, PreparedGait, prepared_gait
from .control.tracker import Feel, Target
from .log import FORMAT, Log, NoLog, state_json
from .motion.soft_start import soft_motion, soft_start
from .motion.timeline import Timing
from .prepared import Playable, Prepared, check_hung, prepared_plan
from .report import Rows, RunReport, reported
from .safety.ending import Ended, Ending, end
from .safety.estop import on_signals, watched
from .safety.guard import Limits, SafeWorld
from .safety.heartbeat import Guardian
from .safety.latch import Source, Stopped
from .worlds.world import State, Terrain, World

Progress = Callable[[int, int], None]
Until = Callable[[Target, State], bool]


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """How a plan is run.

    speed_rad_s: of the soft start, and of the way home. body_m, body_rad: a body farther than this from where it should
    be stops the run, where the world measures it. goal_rad: how far joints may be from the plan's at the end.
    ending: the state to leave the robot in. hung: the robot hangs in a stand, level and off the ground: its feet carry
    nothing and meet nothing; for what is real only.
    """

    timing: Timing = field(default_factory=Timing)
    feel: Feel = field(default_factory=Feel)
    limits: Limits = field(default_factory=Limits)
    speed_rad_s: float = 0.4
    body_m: float = 0.10
    body_rad: float = 0.5
    goal_rad: float = 0.1
    ending: Ending = "hold"
    hung: bool = False

    def __post_init__(self) -> None:
        names = ("speed_rad_s", "body_m", "body_rad", "goal_rad")
        gathered(*(lambda n=n: checked(getattr(self, n), n, above=0.0) for n in names))


class Runner:
    """Runs plans and gaits on one world, once; it closes the world.

    dry: send nothing to anything real. sources: of stops, beside whoever trips the world's latch. log: of everything.
    progress: called with (key frames done, all). guardian: entered already; it acts where this process cannot.
    """

    def __init__(
        self,
        world: World,
        *,
        settings: RunSettings = RunSettings(),
        dry: bool = True,
        sources: Sequence[Source] = (),
        log: Log = NoLog(),
        progress: Progress = lambda done, total: None,
        guardian: Guardian | None = None,
    ) -> None:
        self.settings, self.log = settings, log
        self.latch, self._progress = world.latch, progress
        sources = (*sources, *(() if guardian is None else (guardian.gone,)))
        self.world = SafeWorld(world, limits=settings.limits, dry=dry, sources=sources, guardian=guardian)
        self._found: Array | None = None
        self._counted = Playable.counted
        self.state: State | None = None

    def run(self, accepted: Accepted | AcceptedGait, terrain: Terrain | None = None) -> RunReport:
        """One plan, or gait, from its beginning to its end.

        terrain: what the world has, where that is not what the plan says. Raises InvalidInput for what cannot be run,
        before anything moves; what stops it on the way is in the report.
        """
        begin = time.perf_counter()
        prepared: Playable
        prepared = self.prepare(accepted) if isinstance(accepted, Accepted) else self.prepare_gait(accepted)
        rows, message = Rows(), ""
        with self.watched():
            try:
                self.begin(prepared, terrain)
                self.follow(prepared, rows)
                message = self.goal(rows)
            except (Stopped, HardwareFault) as error:
                message = str(error)
            except BaseException as error:
                message = f"{type(error).__name__}: {error}"
                raise
            finally:
                ended = self.finish(prepared, message)
        report = reported(prepared, self.world, rows, ended, message, time.perf_counter() - begin)
        self.log.write("verdict", report.to_json())
        return report

    @contextmanager
    def watched(self) -> Iterator[None]:
        """The world open, signals and sources heard: what a run is within."""
        with on_signals(self.latch), self.world, watched(self.latch):
            yield

    def prepare(self, accepted: Accepted, kinematics: Kinematics | None = None) -> Prepared:
        """Check that the plan fits the world, and time it. Raises InvalidInput."""
        settings = self.settings
        check_hung(settings.hung, self.world)
        timing, feel, hung = settings.timing, settings.feel, settings.hung
        prepared = prepared_plan(accepted, self.world, timing, feel, hung=hung, kinematics=kinematics)
        self._note(prepared)
        return prepared

    def prepare_gait(self, accepted: AcceptedGait) -> PreparedGait:
        """The same of a gait."""
        settings = self.settings
        check_hung(settings.hung, self.world)
        prepared = prepared_gait(accepted, self.world, settings.timing, settings.feel, hung=settings.hung)
        self._note(prepared)
        return prepared

    @property
    def begun(self) -> bool:
        """Whether the world was reset: from then on something may move."""
        return self._found is not None

    def begin(self, prepared: Playable, terrain: Terrain | None = None) -> None:
        """Measure, arm, and go softly to the first pose. Raises InvalidInput where there is no clear way to it.

        terrain: what the world has, where that is not what the plan's course says.
        """
        first = prepared.first
        rotation = rotation_of(first.instant.rotation_rad)
        terrain = prepared.terrain if terrain is None else terrain
        state = self.world.reset(terrain, first.angles_rad, first.origin_m, rotation)
        self.log.write("measurement", state_json(state))
        self.state, self._found = state, np.array(state.angles_rad)
        way = self._way(prepared, state, first.angles_rad)
        if self.world.real and not self.world.dry:
            self.decide("armed", "torque on, at the measured pose")
        self.world.arm(prepared.content, prepared.digest)
        far = float(np.abs(state.angles_rad - first.angles_rad).max())
        self.decide("soft start", f"{far:.3f} rad to the first pose, over {len(way)} pose{'s' * (len(way) > 1)}")
        self.go(way)
        self.decide("motion", f"{prepared.motion.seconds:.1f} s at pace {prepared.pace:.2f} {prepared.bound_by}")

    def go(self, way: Sequence[Array]) -> None:
        """Along joint poses, softly, one after the other."""
        for pose in way:
            for targets in soft_motion(self.world.last_rad, pose, self.settings.speed_rad_s, self.world.rate_hz):
                self.send(targets, pose)

    def follow(self, prepared: Playable, rows: Rows, until: Until = lambda target, state: False) -> bool:
        """The motion to its end, or to where ``until`` says so. Returns whether it ended."""
        assert self.state is not None
        felt, self._counted = prepared.first.instant.forces_n, prepared.counted
        for k in count(1):
            target = prepared.next(felt, k / self.world.rate_hz)
            if target is None:
                break
            began = time.perf_counter()
            state = self.send(prepared.sendable(target), target.angles_rad)
            rows.add(target, state, time.perf_counter() - began, began)
            felt = state.forces_n
            self.check_body(target, state)
            self._progress(int(target.instant.frame), int(prepared.total))
            if until(target, state):
                return False
        return True

    def send(self, targets: Array, planned: Array) -> State:
        """One command, logged. Raises Stopped, HardwareFault."""
        state = self.world.step(targets)
        self.log.write(
            "command",
            {"time_s": state.time_s, "asked_rad": targets, "sent_rad": state.sent_rad, "planned_rad": planned},
        )
        self.log.write("measurement", state_json(state))
        self.state = state
        return state

    def goal(self, rows: Rows) -> str:
        """What is wrong with where the joints are at the end; empty where nothing is."""
        target, state = rows.pairs[-1]
        away = np.abs(state.angles_rad - target.angles_rad)
        worst = int(np.argmax(away))
        if away[worst] <= self.settings.goal_rad:
            return ""
        limit = self.settings.goal_rad
        return f"joint {self.world.joints[worst]}: ended {away[worst]:.3f} rad from the plan, limit {limit:g} rad"

    def decide(self, what: str, why: str) -> None:
        """Log a decision."""
        self.log.write("decision", {"what": what, "why": why})

    def finish(self, prepared: Playable, message: str) -> Ended:
        """Leave the robot as it should be left, and only then say so: a log may be what failed."""
        home: Sequence[Array] | None = None
        lost = ""
        if message:
            self.latch.trip(message)
        if self._found is None:
            return Ended(left="as it was", message="nothing was sent", seconds=0.0)
        if self.settings.ending == "home" and self.state is not None and not self.latch.tripped:
            try:
                home = self._way(prepared, self.state, self._found)
            except Exception as error:
                lost = str(error)
        ended = end(self.world, self.settings.ending, home, self.settings.speed_rad_s)
        for what, why in (("stop", message), ("no way home", lost)):
            if why:
                self.decide(what, why)
        self.decide("end", f"{ended.left} after {ended.seconds:.3f} s{': ' * bool(ended.message)}{ended.message}")
        return ended

    def _note(self, prepared: Playable) -> None:
        """Log what is run."""
        world = self.world
        self.log.write(
            "plan",
            {
                "format": FORMAT, "digest": prepared.digest, "course": prepared.name, "source": prepared.source,
                "joints": list(world.joints), "rate_hz": world.rate_hz, "world": world.name, "dry": world.dry,
                "pace": prepared.pace, "bound_by": prepared.bound_by, "seconds": prepared.motion.seconds,
                "sees": prepared.sees, "frames": prepared.total + 1, **prepared.logged(),
            },
        )  # fmt: skip

    def _way(self, prepared: Playable, state: State, goal_rad: Array) -> list[Array]:
        """A clear way from the measured pose to this one."""
        instant = prepared.first.instant
        return soft_start(
            prepared.kinematics,
            () if self.settings.hung else prepared.surfaces,
            (state.position_m, state.rotation),
            np.array(state.angles_rad),
            goal_rad,
            instant.normals,
            prepared.clearance_m,
        )

    def check_body(self, target: Target, state: State) -> None:
        """Stop where the body is not where it should be."""
        if not self.world.capabilities.has_body_pose or self.world.dry:
            return
        away = float(np.linalg.norm(state.position_m - target.origin_m))
        between = rotation_of(target.instant.rotation_rad).T @ state.rotation
        turned = float(np.arccos(np.clip((np.trace(between) - 1.0) / 2.0, -1.0, 1.0)))
        if away > self.settings.body_m or turned > self.settings.body_rad:
            self.world.trip(
                f"body: {1e3 * away:.0f} mm and {turned:.2f} rad from the plan at {target.instant.frame:.1f} "
                f"{self._counted}, limits {1e3 * self.settings.body_m:.0f} mm and {self.settings.body_rad:g} rad"
            )
