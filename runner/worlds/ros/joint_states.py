"""Joints behind a rosbridge: the set-up file, which says what ROS calls them and which controller moves
them; newest angles, rates and efforts, how old they are, and nonsense refused by name; and the state
that their controller publishes: where it wants them.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import LARGEST, Array
from stancekit.planners.files.documents import Strict, shown

from ..hardware import Turning
from ..world import SetupFile, own

_Name = Annotated[str, Field(pattern=r"^/[A-Za-z0-9_/]+$")]


@dataclass(frozen=True, kw_only=True)
class RosJoint(Strict):
    """Name of a joint in ROS, and how it counts: ros = direction · angle + offset_rad."""

    name: Annotated[str, Field(min_length=1)]
    direction: Literal[-1, 1] = 1
    offset_rad: Annotated[float, Field(ge=-6.3, le=6.3)] = 0.0


@dataclass(frozen=True, kw_only=True)
class RosSetup(SetupFile):
    """A robot behind a rosbridge.

    Arguments:
        host: host of the rosbridge.
        port: its port.
        ros: version of ROS, by which messages are named and stamped.
        controller: name of a joint trajectory controller.
        joint_states: topic of the joint angles.
        estop: topic of std_msgs/Bool, true for pressed.
        controller_manager: manager that switches the controller off, the nearest to torque off.
        lead_s: time from sending a target to reaching it; motion lags by it, and ends within it
            when the connection is lost.
        stale_s: largest age of a measurement.
        timeout_s: time to wait for an answer.
    """

    format: Literal["stancekit/ros/1"] = "stancekit/ros/1"
    host: Annotated[str, Field(min_length=1)] = "127.0.0.1"
    port: Annotated[int, Field(ge=1, le=65535)] = 9090
    ros: Literal[1, 2] = 2
    controller: _Name = "/joint_trajectory_controller"
    joint_states: _Name = "/joint_states"
    estop: _Name | None = None
    controller_manager: _Name | None = None
    lead_s: Annotated[float, Field(ge=0.01, le=0.5)] = 0.06
    stale_s: Annotated[float, Field(ge=0.01, le=1.0)] = 0.2
    timeout_s: Annotated[float, Field(ge=0.1, le=30.0)] = 3.0
    joints: Annotated[dict[str, RosJoint], Field(min_length=1)]

    def __post_init__(self) -> None:
        if wrong := own(
            {joint: each.name for joint, each in self.joints.items()}, "name", "a name of its own"
        ):
            raise InvalidInput("; ".join(wrong))

    @property
    def url(self) -> str:
        """Address of the rosbridge."""
        return f"ws://{self.host}:{self.port}"


def same_names(joints: Sequence[str], **settings: Any) -> RosSetup:
    """A setup whose controller calls the joints as the robot does, e.g. ``LF_yaw``, and counts the
    same way.
    """
    return RosSetup(joints={name: RosJoint(name=name) for name in joints}, **settings)


class Mapping(Turning):
    """Joints in the robot's order, as ROS counts them; names: what it calls them."""

    def __init__(self, setup: RosSetup, joints: Sequence[str]) -> None:
        setup.check(joints)
        mapped = [setup.joints[name] for name in joints]
        self.names = tuple(each.name for each in mapped)
        super().__init__([each.direction for each in mapped], [each.offset_rad for each in mapped])


_KEPT = 100
"""Messages that are remembered: two seconds of 50 Hz."""
_FEW = 5
"""Fewer messages say nothing of a clock."""
_DRIFT = 0.05
"""A clock that goes so much faster or slower than ours is that of a simulation, and no time can be
told by it."""


class RobotClock:
    """Stamps [s] of a publisher's messages against the times at which they came,
    ``time.monotonic``.
    """

    def __init__(self) -> None:
        self._heard: deque[tuple[float, float]] = deque(maxlen=_KEPT)  # arrival, and stamp
        self._arrivals: deque[float] = deque(maxlen=_KEPT)
        self._lock = threading.Lock()

    def take(self, stamp_s: float | None, arrival_s: float) -> float:
        """Note a message; return when it was measured, by our clock [s].

        The quickest of the messages counts as one that took no time. A message without a stamp, or
        of a clock that goes at another speed than ours, counts as measured when it came.
        """
        with self._lock:
            self._arrivals.append(arrival_s)
            if stamp_s is None:
                self._heard.clear()
                return arrival_s
            self._heard.append((arrival_s, stamp_s))
            if not self._steady():
                return arrival_s
            return min(arrival_s, stamp_s + self._offset_s())

    def at(self, time_s: float) -> float | None:
        """The robot's time [s] at a local time, a little early; None if unknown."""
        with self._lock:
            if len(self._heard) < _FEW or not self._steady():
                return None
            return time_s - self._offset_s()

    def period_s(self) -> float:
        """Median time between two messages [s]; 0 before there are some."""
        with self._lock:
            times = list(self._arrivals)
        return median(b - a for a, b in pairwise(times)) if len(times) > 2 else 0.0

    def _offset_s(self) -> float:
        return min(arrival - stamp for arrival, stamp in self._heard)

    def _steady(self) -> bool:
        """Tell whether it goes as fast as ours: the quickest messages of both halves took the same
        time.
        """
        heard = list(self._heard)
        half = len(heard) // 2
        if half < _FEW:
            return True
        early, late = (
            min(part, key=lambda each: each[0] - each[1]) for part in (heard[:half], heard[half:])
        )
        apart_s = late[0] - early[0]
        return abs((late[0] - late[1]) - (early[0] - early[1])) <= max(_DRIFT * apart_s, 0.02)


def stamp_of(message: Any) -> float | None:
    """The stamp of a message of ROS 1 or 2 [s]; None where it has none, or 0."""
    stamp = _stamp(message)
    whole, nanos = stamp.get("secs", stamp.get("sec")), stamp.get("nsecs", stamp.get("nanosec"))
    if type(whole) is not int or type(nanos) is not int:
        return None
    seconds = float(whole) + 1e-9 * float(nanos)
    return seconds if 0.0 < seconds < 1e11 else None


def version_of(message: Any) -> int | None:
    """The version of ROS whose stamps look like this message's; None where it has none."""
    stamp = _stamp(message)
    return 1 if "secs" in stamp else 2 if "sec" in stamp else None


def _stamp(message: Any) -> dict[str, Any]:
    header = message.get("header") if isinstance(message, dict) else None
    stamp = header.get("stamp") if isinstance(header, dict) else None
    return stamp if isinstance(stamp, dict) else {}


_SLACK_RAD, _SLACK = 0.05, 1.5
_STAMPED_S, _UNSTAMPED_S = 0.02, 0.1
"""A joint is believed to have turned by SLACK times its greatest velocity, for so much longer than
is known, and by SLACK_RAD more; what is measured farther away is nonsense."""
_LATE_S = 0.25
"""Two messages are taken to be measured no longer apart than this more than they came."""
_REST_RAD = 0.004
"""A joint that moves less is at rest."""
_PUBLISHERS = 64
"""Groups of joints of which the clock is remembered."""


class JointStates:
    """The newest of every joint, put together from messages that may each speak of some; written by
    one thread. moved_s: when a joint was measured last to have moved, ``time.monotonic``; -inf for
    never.

    Arguments:
        velocity_rad_s: the greatest that a joint can have, shape (J,).
    """

    def __init__(self, mapping: Mapping, joints: Sequence[str], velocity_rad_s: Array) -> None:
        self._mapping, self._joints = mapping, tuple(joints)
        self._index = {name: i for i, name in enumerate(mapping.names)}
        self._fastest = _SLACK * velocity_rad_s
        self._lock = threading.Lock()
        self._table = np.zeros((3, len(self._joints)))
        self._seen_s = np.full(len(self._joints), -np.inf)  # when measured
        self._came_s = np.full(len(self._joints), -np.inf)
        self._rest, self.moved_s = np.full(len(self._joints), np.inf), -np.inf
        self._clocks: dict[tuple[str, ...], RobotClock] = {}
        self.others: set[str] = set()

    def take(self, message: Any) -> None:
        """A sensor_msgs/JointState.

        Raises InvalidInput for nonsense about one of the robot's joints.

        Nonsense is also an angle that its joint cannot have come to since it was measured last.
        """
        names = _list(message, "name")
        mine = {k: self._index[name] for k, name in enumerate(names) if _text(name) in self._index}
        if len(self.others) < _PUBLISHERS:
            self.others.update(str(name) for name in names if _text(name) not in self._index)
        if not mine:
            return
        rows = [_list(message, key) for key in ("position", "velocity", "effort")]
        if len(rows[0]) != len(names):
            raise InvalidInput(f"expected {len(names)} positions, one per name, got {len(rows[0])}")
        now = time.monotonic()
        key = tuple(sorted(names[k] for k in mine))
        if len(self._clocks) < _PUBLISHERS:
            self._clocks.setdefault(key, RobotClock())
        clock = self._clocks.get(key)
        stamp_s = stamp_of(message)
        measured_s = now if clock is None else clock.take(stamp_s, now)
        slack_s = _UNSTAMPED_S if stamp_s is None else _STAMPED_S
        with self._lock:
            table = self._table.copy()
            for place, index in mine.items():
                for row, values in enumerate(rows):
                    if len(values) == len(names) and (row == 0 or values[place] is not None):
                        table[row, index] = _number(values[place], names[place])
            indices = np.array(list(mine.values()))
            self._check_jumps(table[0], indices, (measured_s, now), slack_s)
            self._table = table
            self._seen_s[indices] = np.maximum(self._seen_s[indices], measured_s)
            self._came_s[indices] = now
            if np.any(np.abs(table[0, indices] - self._rest[indices]) > _REST_RAD):
                self._rest[indices], self.moved_s = table[0, indices], measured_s

    def read(self) -> tuple[Array, Array, Array]:
        """Angles, rates and torques in the robot's order, each shape (J,)."""
        with self._lock:
            table = self._table.copy()
        turned = self._mapping.direction
        return self._mapping.angles(table[0]), turned * table[1], turned * table[2]

    def as_told(self) -> tuple[Array, Array, Array]:
        """Angles and rates as ROS counts, and when they were measured (-inf for never), each shape
        (J,).
        """
        with self._lock:
            return self._table[0].copy(), self._table[1].copy(), self._seen_s.copy()

    def age_s(self) -> Array:
        """Age of each joint's measurement, shape (J,) [s]; inf for never."""
        with self._lock:
            return np.asarray(time.monotonic() - self._seen_s)

    def period_s(self) -> float:
        """Time between two measurements of the joint that is measured most rarely [s]; 0 before it
        is known.
        """
        return max((clock.period_s() for clock in self._clocks.values()), default=0.0)

    def silent(self, since_s: float) -> list[str]:
        """Joints that were not measured for so long, by both names where they differ."""
        pairs = zip(self._joints, self._mapping.names, self.age_s(), strict=True)
        return [
            ours if ours == theirs else f"{ours} ({theirs})"
            for ours, theirs, age in pairs
            if age > since_s
        ]

    def _check_jumps(
        self, positions: Array, indices: Array, times_s: tuple[float, float], slack_s: float
    ) -> None:
        """Raise InvalidInput for joints that are measured where they cannot have come to.

        Arguments:
            times_s: when they were measured, and when that was heard.
            slack_s: how wrong the former may be.
        """
        measured_s, now_s = times_s
        before, seen_s = self._table[0, indices], self._seen_s[indices]
        known = np.isfinite(seen_s)
        apart_s = np.where(known, np.abs(measured_s - np.where(known, seen_s, 0.0)), np.inf)
        came_s = np.where(known, now_s - np.where(known, self._came_s[indices], 0.0), np.inf)
        apart_s = np.minimum(apart_s, came_s + _LATE_S)
        jump = np.abs(positions[indices] - before)
        far = known & (jump > _SLACK_RAD + self._fastest[indices] * (apart_s + slack_s))
        if far.any():
            k = int(np.argmax(np.where(far, jump, 0.0)))
            index = int(indices[k])
            raise InvalidInput(
                f"{self._joints[index]}: measured {positions[index]:.3f} rad {1e3 * came_s[k]:.0f} "
                "ms after "
                f"{before[k]:.3f}, faster than it can turn ({self._fastest[index] / _SLACK:.1f} "
                "rad/s): two publishers?"
            )


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) else None


def _list(message: Any, key: str) -> list[Any]:
    values = message.get(key, []) if isinstance(message, dict) else None
    if not isinstance(values, list):
        raise InvalidInput(f"expected {key} to be a list, got {shown(values, 40)}")
    return values


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise InvalidInput(f"{name}: expected a finite number, got {shown(value, 40)}")
    return float(value)


_REMEMBERED_S, _REMEMBERED = 1.0, 25
"""Targets that a controller may still be on its way from: those of the last second, and at least so
many."""
_FOREIGN_RAD, FOREIGN = 0.05, 3
"""A controller that wants a joint so far from all of them, so many times in a row, follows somebody
else."""
_APART_RAD, _APART_S, _APART = 0.05, 0.1, 5
"""Two measurements of a joint may differ by so much, and by what it turns in this time; not so
often."""
_FORGIVEN = 0.2
"""One that does not differ makes up for so many that do: every other one may be nonsense."""
_BUSY_RAD_S = 0.02
_HEARD_RAD = 3e-7
"""A controller that wants the joints so near to where they were sent has taken that, by single
precision, too."""
_SLOW_S = 0.25
"""A command that was not late and is not acted on so long after it should be was lost."""


class ControllerState:
    """The newest state of a controller, in the robot's order of joints and as ROS counts; written
    by one thread.

    names: its joints, empty before the first message. heard_s: when the newest state was measured,
    ``time.monotonic``; -inf for never. clock: the one that it judges commands by.

    Arguments:
        late_s: after which a command that was sent is acted on, or never.
    """

    def __init__(
        self, mapping: Mapping, joints: Sequence[str], states: JointStates, late_s: float = 0.26
    ) -> None:
        self.names: tuple[str, ...] = ()
        self.clock = RobotClock()
        self._mapping, self._joints, self._states = mapping, tuple(joints), states
        self._late_s = late_s + _SLOW_S
        self._lock = threading.Lock()
        self.heard_s = -np.inf
        self._desired: Array | None = None
        self._actual: Array | None = None
        self._speed, self._wanted = np.zeros(len(joints)), np.zeros(len(joints))
        self._sent: deque[tuple[float, Array]] = deque()
        self._foreign = self._apart = self._unheard = np.zeros(len(joints))
        self._differ = np.zeros((2, len(joints)))

    def take(self, message: Any) -> None:
        """A control_msgs/JointTrajectoryControllerState of any version.

        Raises InvalidInput for nonsense.
        """
        names = message.get("joint_names") if isinstance(message, dict) else None
        if not isinstance(names, list):
            raise InvalidInput(f"expected joint_names to be a list, got {shown(names, 40)}")
        now = time.monotonic()
        heard_s = self.clock.take(stamp_of(message), now)
        names = [str(name) for name in names]
        desired = _point(message, names, self._mapping, "desired", "reference")
        actual = _point(message, names, self._mapping, "actual", "feedback")
        with self._lock:
            self.names, self.heard_s = tuple(names), heard_s
            rests = _same(self._desired, desired[0])
            self._desired, self._actual = desired[0], actual[0]
            self._speed = np.abs(actual[1])
            self._wanted = np.abs(np.nan_to_num(desired[1]))
            self._foreign = np.where(self._beside(self._sent), self._foreign + 1.0, 0.0)
            lately = [each for each in self._sent if heard_s - self._late_s < each[0] <= heard_s]
            self._unheard = (
                np.where(self._beside(lately), self._unheard + 1.0, 0.0)
                if rests
                else self._unheard * 0.0
            )
            self._compare(heard_s)

    def wants(self, positions: Array) -> bool | None:
        """Tell whether it wants the joints there, shape (J,) as ROS counts, or whole turns away;
        None where it does not say.
        """
        with self._lock:
            return None if self._desired is None else _same(self._desired, positions)

    def sent(self, positions: Array) -> None:
        """Note a target that is sent, shape (J,) as ROS counts; the first one is gone to from where
        it is now.
        """
        now = time.monotonic()
        with self._lock:
            if not self._sent and self._desired is not None:
                self._sent.append((now, self._desired))
            self._sent.append((now, positions))
            while len(self._sent) > _REMEMBERED and self._sent[0][0] < now - _REMEMBERED_S:
                self._sent.popleft()

    def trouble(self) -> str | None:
        """Fault of a controller that takes no commands, follows another client, or measures joints
        elsewhere than they are sent; None for none of these.
        """
        with self._lock:
            if self._unheard.max() >= FOREIGN and self._desired is not None:
                index = int(np.argmax(self._unheard))
                return (
                    f"{self._joints[index]}: the controller still wants {self._desired[index]:.3f} "
                    "rad, "
                    f"{self._sent[-1][1][index]:.3f} was sent: it takes no commands"
                )
            if self._foreign.max() >= FOREIGN and self._desired is not None:
                index = int(np.argmax(self._foreign))
                return (
                    f"{self._joints[index]}: the controller wants {self._desired[index]:.3f} rad, "
                    "which was not sent: "
                    "another client?"
                )
            if self._apart.max() >= _APART:
                index = int(np.argmax(self._apart))
                wanted, measured = self._differ[:, index]
                return (
                    f"{self._joints[index]}: joint states say {wanted:.3f} rad, while its "
                    "controller measures "
                    f"{measured:.3f}: two publishers?"
                )
        return None

    def busy(self) -> str | None:
        """Reason to send nothing now: it moves joints already.

        None where it does not.
        """
        with self._lock:
            index = int(np.argmax(self._wanted))
            if self._wanted[index] <= _BUSY_RAD_S:
                return None
            return f"{self._joints[index]}: the controller turns it by {self._wanted[index]:.2f} rad/s: another client?"

    def _beside(self, sent: Sequence[tuple[float, Array]]) -> Array:
        """Tell which joints it wants elsewhere than at any of these targets, or between them, shape
        (J,).
        """
        if not sent or self._desired is None:
            return np.zeros(len(self._joints), dtype=bool)
        targets = np.array([positions for _, positions in sent])
        low, high = targets.min(axis=0) - _FOREIGN_RAD, targets.max(axis=0) + _FOREIGN_RAD
        return np.asarray((self._desired < low) | (self._desired > high))

    def _compare(self, heard_s: float) -> None:
        """Hold its measurement against what joint states say."""
        if self._actual is None:
            return
        wanted, rates, seen_s = self._states.as_told()
        speed = np.nan_to_num(np.maximum(np.abs(rates), self._speed), nan=np.inf)
        between_s = np.where(np.isfinite(seen_s), np.abs(heard_s - seen_s), np.inf)
        with np.errstate(invalid="ignore"):
            allowed = np.nan_to_num(_APART_RAD + (_APART_S + between_s) * speed, nan=_APART_RAD)
        off = np.abs(wanted - self._actual) > allowed
        off &= np.isfinite(seen_s)
        worse = off & (self._apart + 1.0 >= _APART)
        self._differ[:, worse] = np.stack([wanted, self._actual])[:, worse]
        self._apart = np.where(off, self._apart + 1.0, np.maximum(self._apart - _FORGIVEN, 0.0))


def _point(
    message: Any, names: list[str], mapping: Mapping, *keys: str
) -> tuple[Array | None, Array]:
    """Positions and velocities of one of these points in the robot's order; None, and NaN, where it
    has none.
    """
    unknown = np.full(len(mapping.names), np.nan)
    point: dict[str, Any] = next(
        (message[key] for key in keys if isinstance(message.get(key), dict)), {}
    )
    rows = [point.get(key) for key in ("positions", "velocities")]
    if sorted(names) != sorted(mapping.names):
        return None, unknown
    order = [names.index(name) for name in mapping.names]
    result = [
        np.array([_finite(values[k]) for k in order])
        if isinstance(values, list) and len(values) == len(names)
        else unknown
        for values in rows
    ]
    return (result[0] if np.isfinite(result[0]).all() else None), result[1]


def _same(one: Array | None, other: Array | None) -> bool:
    """Tell whether all joints are at the same places, or whole turns away."""
    if one is None or other is None:
        return False
    return bool(np.abs(np.remainder(one - other + np.pi, 2.0 * np.pi) - np.pi).max() <= _HEARD_RAD)


def _finite(value: Any) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if number and abs(value) <= LARGEST else float("nan")
