"""Every world behind the same guard: clipping, refusal of what is no number, the stop latch, the
watchdog, deviation; and how a run ends.

What was really sent comes back in ``State.sent_rad``. After a stop nothing is sent any more; what
is asked for then is counted and refused. What is real is armed for a plan only, and the plan is
verified then, from its own numbers.

After a stop nothing moves any more: of the endings only hold and torque-off are left then, and home
becomes hold. Where an arming was interrupted, no torque is on that was off before, whatever was
asked for.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NoReturn, Self

import numpy as np

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array, check_numbers, checked, collect_errors

from ..motion.time_parametrization import soft_motion
from ..worlds.world import (
    Drives,
    JointBus,
    State,
    Terrain,
    check_state,
    check_world,
)
from .estop import Source, StopLatch, Stopped
from .heartbeat import HeartbeatMonitor


class Watchdog:
    """Trips the latch where ``kick`` was not called for ``limit_s``; begins with the first kick.

    A context manager.

    While it is entered, and from ``guard`` on, it does so where the process stood still for so
    long, kicked or not.

    Arguments:
        clock: in seconds, never set back; what the wall clock does is no matter. A limit of
            infinity watches nothing.
        monitor: gets the same.
    """

    def __init__(
        self,
        latch: StopLatch,
        limit_s: float,
        clock: Callable[[], float] = time.monotonic,
        monitor: HeartbeatMonitor | None = None,
    ) -> None:
        self.limit_s = limit_s
        self._monitor = monitor
        self._latch, self._clock = latch, clock
        self._last: float | None = None
        self._pulse: float | None = None  # when its thread ran last
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def kick(self) -> None:
        """The loop lives.

        One that comes too late trips the latch itself.
        """
        self.look()
        self._last = self._clock()
        if self._monitor is not None:
            self._monitor.beat()

    def guard(self) -> None:
        """Watch from now on that the process does not hang, whatever the loop waits for."""
        self._pulse = None if self._thread is None else self._clock()

    def rest(self) -> None:
        """Watch nothing until the next kick, or ``guard``."""
        self._last = self._pulse = None
        if self._monitor is not None:
            self._monitor.rest()

    def look(self) -> None:
        """Trip the latch where the last kick, or the last sign of life of the process, is too long
        ago.
        """
        for last, who in (
            (self._last, "the loop was silent"),
            (self._pulse, "the process stood still"),
        ):
            if (
                last is not None
                and not self._latch.tripped
                and (silent := self._clock() - last) > self.limit_s
            ):
                self._latch.trip(
                    f"host watchdog: {who} for {silent:.3f} s, limit {self.limit_s:g} s"
                )

    def __enter__(self) -> Self:
        if self.limit_s < float("inf"):
            self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *raised: object) -> None:
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(0.2 * self.limit_s):
            self.look()
            if self._pulse is not None:
                self._pulse = self._clock()


_FORGIVEN = 0.5
"""So many periods in which a joint was away are made up for by one in which it was not."""
_STILL_RAD, _SENT_RAD = 0.02, 0.1
"""A robot has not moved where none of its joints has turned by STILL_RAD, of several that were sent
SENT_RAD away."""
_SATURATED = 1.5
"""A target so many times as far from its joint as gives all of its torque is one that the joint
does not follow."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits within which the guard lets commands through, and at which it stops.

    Arguments:
        margin_rad: distance kept from the joints' limits.
        velocity_share: of the joints' greatest velocity.
        step_rad: most that a target may change in one control period.
        path_rad, path_s: a joint that is farther than this from what it was sent, for this long,
            stops the run.
        silent_s: the longest time between two commands to something real; pauses of a simulation,
            or of a dry run, do no harm.
    """

    margin_rad: float = 0.0
    velocity_share: float = 1.0
    step_rad: float = 0.1
    path_rad: float = 0.3
    path_s: float = 0.1
    silent_s: float = 0.25

    def __post_init__(self) -> None:
        above, least = ("step_rad", "path_rad", "silent_s"), ("margin_rad", "path_s")
        collect_errors(
            lambda: checked(self.velocity_share, "limits.velocity_share", above=0.0, most=1.0),
            lambda: check_numbers(self, "limits.", above=above, least=least),
        )


class SafeWorld:
    """A world with the guard, the latch and the watchdog around it.

    It owns the world, and closes it.

    Arguments:
        dry: nothing is sent to anything real, whose joints are taken to be where they would have been
            sent, its body where it was, its feet to feel nothing. A simulation is nothing real.
            latch: the world's.
        sources: asked before every command. sent, clipped, refused: numbers of commands that went
            through, that were changed on the way, and that came after the stop. armed: an arming
            came to its end, or none is needed.
        monitor: gets a beat for every command.
        leaps: a leap runs: its targets are held within limits without their loads, or joints that
            push off at their limits and land there would push too late, and too little. Nothing
            real leaps.
    """

    def __init__(
        self,
        world: JointBus,
        *,
        limits: Limits = Limits(),
        dry: bool = True,
        sources: Sequence[Source] = (),
        clock: Callable[[], float] = time.monotonic,
        monitor: HeartbeatMonitor | None = None,
    ) -> None:
        check_world(world)
        self.world, self.limits, self.latch = world, limits, world.latch
        self.name, self.kind, self.robot, self.servo = (
            world.name,
            world.kind,
            world.robot,
            world.servo,
        )
        self.joints, self.rate_hz, self.drives = world.joints, world.rate_hz, world.drives
        self.gravity_m_s2, self.senses = world.gravity_m_s2, world.senses
        self.capabilities = world.capabilities
        self._bounds = _bounds(self.capabilities, self.rate_hz, limits)
        self._path = np.full(len(world.joints), limits.path_rad)
        if world.kind != "hardware":
            saturated = _SATURATED * self.drives.torque_nm / self.drives.stiffness_nm_rad
            self._path = np.maximum(self._path, saturated)
        self.real = world.kind == "hardware"
        self.dry = dry and self.real
        self.sent = self.clipped = self.refused = 0
        self.armed = not self.real
        moves = self.real and not self.dry  # else nothing can move, and a pause harms nobody
        self.watchdog = Watchdog(
            world.latch, limits.silent_s if moves else float("inf"), clock, monitor
        )
        self.latch.listen(*sources, self.watchdog.look)
        world.beat = self.watchdog.kick  # to wait for a device is not to be silent
        self._state: State | None = None
        self._last: Array | None = None
        self._away = self._lean = np.zeros(len(world.joints))
        self._first: Array | None = None
        self._loads: Array | None = None
        self.leaps = False

    def connect(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Connect the world.

        A real robot is only measured and does not move.

        Raises Stopped, InvalidInput, HardwareFault.
        """
        self._ask()
        state = self.world.connect(terrain, angles_rad, position_m, rotation)
        self._check_measured(state)
        self._state = state
        self._first = self._last = np.array(state.angles_rad, dtype=float)
        self._away = self._lean = np.zeros(len(self.joints))
        self._loads = None
        return state

    def preload(self, targets_rad: Array) -> bool:
        """Let a simulation begin with its joints loaded, as if it had been sent this before;
        whether it is one that can. What is real is sent its loads softly.
        """
        if self.real or not self.world.preload(targets_rad):
            return False
        self._last = np.array(targets_rad, dtype=float)
        return True

    def carry(self, wrench: Array) -> None:
        """Let a simulated body bear this force and moment beside its weight, shape (6,); a real one
        does already.
        """
        if not self.real:
            self.world.carry(wrench)

    @property
    def last_rad(self) -> Array:
        """Targets that were sent last, or measured where nothing was sent, shape (J,).

        Raises InvalidInput before ``connect``.
        """
        if self._last is None:
            raise InvalidInput("world: expected connect before anything else, got no connect")
        return self._last

    def arm(self) -> None:
        """Let something real move: its torque is switched on at the pose where it is.

        Raises Stopped, HardwareFault, after which no torque is on that was off before.
        """
        self._ask()
        if self.dry:
            return
        self.watchdog.guard()
        try:
            self.world.arm()
        finally:
            self.armed = self.world.armed or not self.real

    def step(self, targets_rad: Array, lean_rad: Array | None = None) -> State:
        """Send what of the targets is within limits.

        Raises Stopped after a stop, and with the command that causes one; HardwareFault where the
        world does.

        Arguments:
            lean_rad: how much of the targets are loads, by which joints yield to them, shape (J,);
                None: as much as before. In a dry run they yield to them as planned.
        """
        last = self.last_rad
        self._lean = self._lean if lean_rad is None else np.array(lean_rad, dtype=float)
        self._ask()
        targets = np.asarray(targets_rad, dtype=float)
        if targets.shape != last.shape or not np.isfinite(targets).all():
            self.trip(
                f"command refused: expected {len(last)} finite targets, got "
                f"{_wrong(targets, self.joints)}"
            )
        sent = self._bounded(targets)
        self.watchdog.kick()
        try:
            self._state = state = self._sent(sent)
            self._check_measured(state)
        except Stopped:
            self.refused += 1
            raise
        except HardwareFault as error:
            self.latch.trip(str(error))
            raise
        self.armed = True
        self.sent += 1
        self.clipped += int(np.any(np.abs(sent - targets) > 1e-9))
        self._last = np.array(state.sent_rad, dtype=float)
        if self.dry:
            state = replace(state, angles_rad=state.angles_rad - self._lean)
        self._check_deviation(state)
        return state

    def _sent(self, targets: Array) -> State:
        """The state after these targets, or as it would be.

        A device asks the latch itself, directly before it writes.
        """
        if not self.real:
            with self.latch.sending():
                self.world.send(targets, self._lean if self.leaps else None)
            return self.world.read()
        if not self.dry:
            self.world.send(targets)
            return self.world.read()
        before, period_s = self._state, 1.0 / self.rate_hz
        assert before is not None
        return replace(
            before,
            time_s=before.time_s + period_s,
            angles_rad=targets,
            rates_rad_s=(targets - before.angles_rad) / period_s,
            sent_rad=targets,
        )

    def trip(self, reason: str) -> NoReturn:
        """Stop for this reason, and raise Stopped."""
        self.latch.trip(reason, at_once=True)
        raise Stopped(self.latch.reason)

    def _bounded(self, targets_rad: Array) -> Array:
        """The targets within limits; those of a leap, its angles alone, beside which are loads."""
        if not self.leaps:
            return self.within(targets_rad)
        loads = self._lean if self._loads is None else self._loads
        self._loads = self._lean
        wanted = targets_rad - self._lean
        angles = self.within(wanted, self.last_rad - loads)
        return np.where(angles == wanted, targets_rad, angles + self._lean)

    def within(self, targets_rad: Array, last_rad: Array | None = None) -> Array:
        """The targets within the limits of position, velocity and step, shape (J,) [rad].

        Arguments:
            last_rad: the ones before, those sent last where None.
        """
        last, (lower, upper, most) = self.last_rad if last_rad is None else last_rad, self._bounds
        # a joint that begins beyond its limits comes back no faster than any other moves
        return np.asarray(
            np.minimum(
                np.maximum(np.minimum(np.maximum(targets_rad, lower), upper), last - most),
                last + most,
            )
        )

    def close(self) -> None:
        """Close the world."""
        self.watchdog.rest()
        self.world.close()

    def __enter__(self) -> Self:
        self.watchdog.__enter__()
        return self

    def __exit__(self, *raised: object) -> None:
        self.watchdog.__exit__(*raised)
        self.close()

    def _ask(self) -> None:
        """Raise Stopped where a stop is asked for; of a leap that is in the air, after it has
        landed.
        """
        try:
            self.latch.check()
        except Stopped:
            self.refused += 1
            raise

    def _check_measured(self, state: State) -> None:
        check_state(state, len(self.joints), len(self.robot.limbs), self.name)

    def _check_deviation(self, state: State) -> None:
        """Stop where a joint does not go where it is sent.

        A period in which it seems to be there makes up for half a one in which it is not, so that
        measurements of which every other one is nonsense do not hide it.
        """
        away = np.abs(state.angles_rad - state.sent_rad + self._lean)
        self._away = np.where(
            away > self._path, self._away + 1.0, np.maximum(self._away - _FORGIVEN, 0.0)
        )
        worst = int(self._away.argmax())
        if self._away[worst] > self.limits.path_s * self.rate_hz + 1e-6:
            limit = f"more than {self._path[worst]:g} rad for {self.limits.path_s:g} s"
            hint = (
                "; no joint has moved at all: does the robot take commands?"
                if self._still(state)
                else ""
            )
            self.trip(
                f"joint {self.joints[worst]}: {away[worst]:.3f} rad from where it was sent, "
                f"{limit}{hint}"
            )

    def _still(self, state: State) -> bool:
        """Tell whether joints were sent away from where they were measured first, and none has
        moved.
        """
        if self._first is None or np.abs(state.angles_rad - self._first).max() > _STILL_RAD:
            return False
        return bool(np.count_nonzero(np.abs(state.sent_rad - self._first) > _SENT_RAD) > 1)


def _bounds(can: Drives, rate_hz: float, limits: Limits) -> tuple[Array, Array, Array]:
    """The least and the greatest angle of every joint, and how far it may move in a period, shape
    (J,) each.
    """
    middle = 0.5 * (can.lower_rad + can.upper_rad)
    lower = np.minimum(can.lower_rad + limits.margin_rad, middle)
    upper = np.maximum(can.upper_rad - limits.margin_rad, middle)
    return (
        lower,
        upper,
        np.minimum(limits.velocity_share * can.velocity_rad_s / rate_hz, limits.step_rad),
    )


def _wrong(targets: Array, joints: Sequence[str]) -> str:
    if targets.shape != (len(joints),):
        return f"shape {targets.shape}"
    index = int(np.flatnonzero(~np.isfinite(targets))[0])
    return f"{targets[index]} for {joints[index]}"


Ending = Literal["hold", "home", "torque-off"]
_Left = Literal["held", "home", "torque off", "left to the device", "as it was"]


@dataclass(frozen=True, kw_only=True)
class Ended:
    """End of a motion or of a stop.

    Arguments:
        left: the state in which the robot is.
        message: why it is another than was asked for, empty where it is not.
        seconds: from the stop, or from the end of the motion, until then.
    """

    left: _Left
    message: str
    seconds: float


def end(
    world: SafeWorld, ending: Ending, home: Sequence[Array] | None, speed_rad_s: float
) -> Ended:
    """Bring the robot into the state that was asked for; it never raises for what goes wrong on the
    way.

    Arguments:
        home: joint angles on the way there, home last, shape (J,) [rad] each, gone along at this
            speed; None where there is no path.
    """
    stopped = world.latch.tripped
    begin = world.latch.time_s if stopped else time.monotonic()
    left: _Left
    if world.dry:
        left, message = "as it was", "dry run: nothing was sent"
    elif ending == "torque-off":
        left, message = _relaxed(world)
    else:
        message = ""
        if ending == "home" and (stopped or home is None):
            message = (
                "home is not gone to after a stop" if stopped else "there is no clear way home"
            )
        elif ending == "home" and home is not None:
            message = _homeward(world, home, speed_rad_s)
        left, message = _held(world, message)
        if left == "held" and not world.armed:
            left, message = "as it was", "it was not armed"
        if ending == "home" and left == "held" and not message:
            left = "home"
    world.watchdog.rest()
    return Ended(left=left, message=message, seconds=time.monotonic() - begin)


def _homeward(world: SafeWorld, home: Sequence[Array], speed_rad_s: float) -> str:
    """Go home slowly; why not, where that was stopped."""
    try:
        for pose in home:
            for targets in soft_motion(world.last_rad, pose, speed_rad_s, world.rate_hz):
                world.step(targets)
    except (Stopped, HardwareFault) as error:
        return f"stopped on the way home: {error}"
    except Exception as error:  # whatever fails on the way home, the robot is to stop
        world.latch.trip(f"{type(error).__name__}: {error}")
        return f"stopped on the way home: {world.latch.reason}"
    return ""


def _held(world: SafeWorld, message: str) -> tuple[_Left, str]:
    wrong = _done(world.world.stop)
    if wrong:
        return "left to the device", f"{message}; {wrong}" if message else wrong
    return "held", message


def _relaxed(world: SafeWorld) -> tuple[_Left, str]:
    if not world.real:
        return "held", f"world {world.name} has no switch for its torque"
    wrong = _done(lambda: world.world.stop(torque_off=True))
    return ("left to the device", wrong) if wrong else ("torque off", "")


def _done(verb: Callable[[], str]) -> str:
    """Have a device do it, once more where that is cut off (by a second Ctrl-C); what went wrong,
    or may still move, empty if nothing.
    """
    wrong = ""
    for _ in range(2):
        try:
            return verb()
        except HardwareFault as error:
            return str(error)
        except BaseException as error:  # told as its outcome: nothing may end a stop
            wrong = f"{type(error).__name__}: {error}"
    return wrong
