"""The runner: an accepted plan, forwarded to a world one control period after the other, and what
came of it.

Before the first motion: the plan's verdict, its robot, and inverse kinematics of the whole motion,
slowed down to what the joints can do. Then the soft start from the pose that was measured, then the
motion; limbs are unloaded before they lift and loaded after they land, as ``plan_motion`` has it.
Whatever happens, it ends as was asked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from math import acos, sqrt
from typing import Any

import numpy as np

from stancekit.planners.errors import HardwareFault
from stancekit.planners.files.arrays import Array

from .acceptance import Accepted
from .control.estimation import LegOdometry, SilentFeet
from .control.tracker import Target
from .log import FORMAT, Log, Record
from .motion.time_parametrization import rise_m, soft_motion, soft_start
from .prepared import (
    Prepared,
    Resumption,
    Tracked,
    body_from,
    prepare,
)
from .report import RunReport
from .safety.estop import Source, Stopped, on_signals, watched
from .safety.guard import Ended, SafeWorld, end
from .safety.heartbeat import HeartbeatMonitor
from .settings import RunSettings
from .worlds.world import JointBus, State, Terrain

Progress = Callable[[int, int], None]
Until = Callable[[Target, State], bool]


class Runner:
    """Runs plans and gaits on one world, once; it closes the world.

    Arguments:
        dry: send nothing to anything real.
        sources: sources of stops, beside those of the settings and the world's latch.
        log: log of the run.
        progress: called with (key frames done, all).
        monitor: entered already; it acts where this process cannot.
    """

    def __init__(
        self,
        world: JointBus,
        *,
        settings: RunSettings = RunSettings(),
        dry: bool = True,
        sources: Sequence[Source] = (),
        log: Log = Log(),
        progress: Progress = lambda done, total: None,
        monitor: HeartbeatMonitor | None = None,
    ) -> None:
        self.settings, self.log = settings, log
        self._logs = type(log) is not Log  # else nothing is made ready to be written
        self.latch, self._progress = world.latch, progress
        sources = (*settings.stops, *sources, *(() if monitor is None else (monitor.gone,)))
        self.world = SafeWorld(
            world, limits=settings.limits, dry=dry, sources=sources, monitor=monitor
        )
        self._found: Array | None = None
        self._prepared: Prepared | None = None
        self.state: State | None = None

    def run(
        self,
        accepted: Accepted[Any],
        terrain: Terrain | None = None,
    ) -> RunReport:
        """Run one plan, or gait, from its beginning to its end.

        Arguments:
            terrain: the terrain of the world, if it is not the one in the plan.

        Raises:
            InvalidInput: for a plan that cannot be run, before anything moves. The reason for a
                stop on the way is in the report.
        """
        begin, record = time.perf_counter(), Record()
        prepared = self.prepare(accepted)

        def motion() -> str:
            self.follow(prepared, record)
            return self.goal(record)

        ended, message = self.perform(prepared, motion, terrain)
        if not message and ended.left == "left to the device":
            message = ended.message
        report = RunReport.of(
            record,
            prepared,
            self.world,
            self.settings,
            ended=ended,
            message=message,
            wall_s=time.perf_counter() - begin,
        )
        self.log.write("verdict", report.to_json())
        return report

    def perform(
        self,
        prepared: Prepared,
        motion: Callable[[], str],
        terrain: Terrain | None = None,
    ) -> tuple[Ended, str]:
        """Arm, go to the first pose, perform ``motion``, and bring the robot to its ending,
        whatever happens.

        Arguments:
            motion: returns what is wrong at its end, else empty. Returns the robot's ending, and
                what went wrong. Errors that are neither stops nor hardware faults are raised after
                the ending.
        """
        self._prepared, message = prepared, ""
        with on_signals(self.latch), self.world, watched(self.latch):
            try:
                self._begin(prepared, terrain)
                message = motion()
            except (Stopped, HardwareFault) as error:
                message = str(error)
            except BaseException as error:  # the log keeps its message; it is raised again
                message = f"{type(error).__name__}: {error}"
                raise
            finally:
                self.latch.lands = False  # what comes now is no leap, and a stop is obeyed at once
                ended = self._finish(message)
        return ended, message

    def prepare(
        self,
        accepted: Accepted[Any],
        resumption: Resumption | None = None,
    ) -> Prepared:
        """Check that a plan, or a gait, fits the world, and time it.

        Raises InvalidInput.

        Arguments:
            resumption: how a robot that stands already takes up a plan.
        """
        prepared = prepare(accepted, self.world, self.settings, resumption)
        self._prepared = prepared
        self.log.write("plan", {"format": FORMAT, **prepared.entry(self.world)})
        return prepared

    def _begin(self, prepared: Prepared, terrain: Terrain | None) -> None:
        """Measure, arm, and go softly to the first pose.

        Raises InvalidInput where there is no clear path to it.

        Arguments:
            terrain: what the world has, where that is not what the plan's course says.
        """
        first = prepared.first
        rotation, origin = first.sample.rotation, first.origin_m
        if terrain is not None and self.world.kind == "simulation":
            feet = origin + prepared.kinematics.feet(first.angles_rad) @ rotation.T
            rise = rise_m(terrain, feet, prepared.kinematics.radii_m)
            origin = origin + np.array([0.0, 0.0, rise])
            if rise > 0.0:
                self.decide("start", f"{1e3 * rise:.0f} mm higher: a foot was in the ground")
        terrain = prepared.terrain if terrain is None else terrain
        state = self.world.connect(terrain, first.angles_rad, origin, rotation)
        self.log.write("measurement", vars(state))
        self.state, self._found = state, np.array(state.angles_rad)
        if (wrench := self._carry(0.0)) is not None and wrench.any():
            self.decide(
                "wrench",
                f"{np.array2string(wrench, precision=4)} N and Nm on the body beside its weight",
            )
        path = self._path(prepared, state, first.angles_rad)
        if self.world.real and not self.world.dry:
            self.decide("armed", "torque on, at the measured pose")
        self.world.arm()
        if (evidence := self.world.world.report()) and not self.world.dry:
            self.decide("e-stop", evidence)
        far = float(np.abs(state.angles_rad - first.angles_rad).max())
        self.decide(
            "soft start",
            f"{far:.3f} rad to the first pose, over {len(path)} pose{'s' * (len(path) > 1)}",
        )
        self.go(path)
        if self.world.preload(first.targets_rad):
            self.decide("loaded", "from the beginning")
        elif not prepared.sees and self.world.drives.yields:
            self.go([first.targets_rad], first.angles_rad)
        self.decide(
            "motion",
            f"{prepared.motion.duration_s:.1f} s at {prepared.motion.pace:.2f} of the pace asked for "
            f"{prepared.motion.bound_by}",
        )

    def go(self, path: Sequence[Array], stays: Array | None = None) -> None:
        """Along joint poses, softly, one after the other.

        Arguments:
            stays: where the joints are all the while, the rest loads.
        """
        for pose in path:
            for targets in soft_motion(
                self.world.last_rad, pose, self.settings.speed_rad_s, self.world.rate_hz
            ):
                self.send(targets, pose, None if stays is None else targets - stays)

    def follow(
        self, tracked: Tracked, record: Record, until: Until = lambda target, state: False
    ) -> bool:
        """The motion to its end, or to where ``until`` says so.

        Returns whether it ended.
        """
        assert self.state is not None
        plan = None if self._prepared is None else self._prepared.accepted.plan
        self.world.leaps = plan is not None and (plan.has("timing") or plan.has("parts"))
        source = body_from(self.world, self.settings)
        kinematics, rate_hz = tracked.tracker.kinematics, self.world.rate_hz
        odometry = LegOdometry(kinematics, tracked.first, rate_hz, felt=tracked.sees)
        silent = SilentFeet(rate_hz, kinematics.weight_n, kinematics.robot.limb_names)
        seen = self.state if source == "the world" else None
        felt, total = (
            tracked.first.sample.forces_n,
            0.0 if self._prepared is None else self._prepared.last_frame,
        )
        while (target := tracked.next(felt, seen)) is not None:
            began = time.perf_counter()
            self._commit(float(target.sample.frame))
            self._carry(float(target.sample.frame))
            state = self.send(target.targets_rad, target.angles_rad, tracked.lean(target))
            record.add(target, state, began)
            if self._logs:
                self.log.write("target", {"time_s": state.time_s, **target.entry()})
            felt, seen = state.forces_n, state if source == "the world" else None
            seen = odometry.seen(target, state) if source == "leg odometry" else seen
            self.check_body(target, state)
            if tracked.sees and (why := silent.found(target, state, tracked.tracker.seeks)):
                self.world.trip(why)
            self._progress(int(target.sample.frame), int(total))
            if until(target, state):
                return False
        self.latch.lands = False
        self.latch.check()
        return True

    def _commit(self, time_s: float) -> None:
        """Tell the latch whether a leap is under way that ends on its feet or not at all: a robot
        that holds its joints in the air falls, so a stop lands it first.
        """
        if self.world.leaps and self._prepared is not None:
            committed_s = self._prepared.motion.committed_s
            self.latch.lands = any(begin < time_s < end for begin, end in committed_s)

    def _carry(self, frame: float) -> Array | None:
        """Let a simulated body bear what is on it beside its weight at a key frame, or between two,
        and return that.
        """
        wrench: Array | None = None
        if self.settings.wrench is not None:
            wrench = np.array(self.settings.wrench)
        elif self._prepared is not None and self._prepared.accepted.plan.keyed:
            wrench = self._prepared.accepted.plan.problem.wrench_at(frame)
        if wrench is not None:
            self.world.carry(wrench)
        return wrench

    def send(self, targets: Array, planned: Array, lean: Array | None = None) -> State:
        """Send one command and log it.

        Arguments:
            lean: as of ``SafeWorld.step``.

        Raises Stopped, HardwareFault.
        """
        state = self.world.step(targets, lean)
        if self._logs:
            entry = {"asked_rad": targets, "sent_rad": state.sent_rad, "planned_rad": planned}
            self.log.write("command", {"time_s": state.time_s, **entry})
            self.log.write("measurement", vars(state))
        self.state = state
        return state

    def goal(self, record: Record) -> str:
        """Fault of the joints' final places; empty where nothing is."""
        target, state = record.pairs[-1]
        away = np.abs(state.angles_rad - target.angles_rad)
        worst = int(np.argmax(away))
        if away[worst] <= (limit := self.settings.tolerance.joint_rad):
            return ""
        return f"joint {self.world.joints[worst]}: ended {away[worst]:.3f} rad from the plan, limit {limit:g} rad"

    def decide(self, what: str, why: str) -> None:
        """Log a decision."""
        self.log.write(
            "decision",
            {"what": what, "why": why, "time_s": self.state.time_s if self.state else 0.0},
        )

    def _finish(self, message: str) -> Ended:
        """Leave the robot as it should be left, and only then say so: a log may be what failed."""
        home: Sequence[Array] | None = None
        lost = ""
        if message:
            self.latch.trip(message)
        if self._found is None:
            return Ended(left="as it was", message="nothing was sent", seconds=0.0)
        if (
            self.settings.ending == "home"
            and self._prepared
            and self.state
            and not self.latch.tripped
        ):
            try:
                home = self._path(self._prepared, self.state, self._found)
            except Exception as error:  # a way home is any planner's; the robot is held without one
                lost = str(error)
        ended = end(self.world, self.settings.ending, home, self.settings.speed_rad_s)
        for what, why in (("stop", message), ("no way home", lost)):
            if why:
                self.decide(what, why)
        self.decide(
            "end",
            f"{ended.left} after {ended.seconds:.3f} s{': ' * bool(ended.message)}{ended.message}",
        )
        return ended

    def _path(self, prepared: Prepared, state: State, goal_rad: Array) -> list[Array]:
        """A clear path from the measured pose to this one."""
        sample = prepared.first.sample
        return soft_start(
            prepared.kinematics,
            () if self.settings.hung else prepared.surfaces,
            (state.position_m, state.rotation),
            np.array(state.angles_rad),
            goal_rad,
            sample.normals,
            prepared.clearance_m,
        )

    def check_body(self, target: Target, state: State) -> None:
        """Stop where the body is not where it should be."""
        if not self.world.senses or self.world.dry:
            return
        off = state.position_m - target.origin_m
        away = sqrt(float(off @ off))
        trace = float(np.vdot(target.sample.rotation, state.rotation))
        turned = acos(min(max((trace - 1.0) / 2.0, -1.0), 1.0))
        limits, counted = (
            self.settings.tolerance,
            "" if self._prepared is None else self._prepared.counted,
        )
        if away > limits.body_m or turned > limits.body_rad:
            self.world.trip(
                f"body: {1e3 * away:.0f} mm and {turned:.2f} rad from the plan at "
                f"{target.sample.frame:.1f} {counted}, "
                f"limits {1e3 * limits.body_m:.0f} mm and {limits.body_rad:g} rad"
            )
