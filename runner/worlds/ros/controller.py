"""State that a joint trajectory controller publishes: its joints, where it wants them, and where it
measures them.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import LARGEST, Array
from stancekit.planners.files.documents import shown

from .joint_states import JointStates, RobotClock, stamp_of
from .setup import Mapping

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

    names: its joints, empty before the first message. clock: the one that it judges commands by.

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
        self._heard_s = -np.inf
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
            self.names, self._heard_s = tuple(names), heard_s
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

    def heard_s(self) -> float:
        """When the newest state was measured, ``time.monotonic``; -inf for never."""
        return self._heard_s

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
        """Why nobody should send it anything now: it moves joints already.

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
