"""What ROS says of the joints: newest angles, rates and efforts, how old they are, and nonsense refused by name."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import LARGEST, Array
from stancekit.planners.files.validation import shown

from .setup import Mapping


class JointStates:
    """The newest of every joint, put together from messages that may each speak of some; written by one thread."""

    def __init__(self, mapping: Mapping, joints: Sequence[str]) -> None:
        self._mapping, self._joints = mapping, tuple(joints)
        self._index = {name: i for i, name in enumerate(mapping.names)}
        self._lock = threading.Lock()
        self._table = np.zeros((3, len(self._joints)))
        self._seen_s = np.full(len(self._joints), -np.inf)
        self.others: set[str] = set()

    def take(self, message: Any) -> None:
        """A sensor_msgs/JointState. Raises InvalidInput for nonsense about one of the robot's joints."""
        names = _list(message, "name")
        rows = [_list(message, key) for key in ("position", "velocity", "effort")]
        if len(rows[0]) != len(names):
            raise InvalidInput(f"expected {len(names)} positions, one a name, got {len(rows[0])}")
        now = time.monotonic()
        with self._lock:
            for place, name in enumerate(names):
                index = self._index.get(name) if isinstance(name, str) else None
                if index is None:
                    self.others.add(str(name))
                    continue
                for row, values in enumerate(rows):
                    if len(values) == len(names) and (row == 0 or values[place] is not None):
                        self._table[row, index] = _number(values[place], name)
                self._seen_s[index] = now

    def actual(self, feedback: Any) -> None:
        """Feedback of a FollowJointTrajectory goal: its ``actual`` is a measurement, too."""
        point = feedback.get("actual") if isinstance(feedback, dict) else None
        if isinstance(point, dict):
            named = {"name": feedback.get("joint_names"), "position": point.get("positions")}
            self.take(named | {"velocity": point.get("velocities") or [], "effort": []})

    def read(self) -> tuple[Array, Array, Array]:
        """Angles, rates and torques in the robot's order, each shape (J,)."""
        with self._lock:
            table = self._table.copy()
        turned = self._mapping.direction
        return self._mapping.from_ros(table[0]), turned * table[1], turned * table[2]

    def age_s(self) -> Array:
        """How long ago each joint was heard of, shape (J,) [s]; inf for never."""
        with self._lock:
            return np.asarray(time.monotonic() - self._seen_s)

    def silent(self, since_s: float) -> list[str]:
        """Joints of which nothing was heard for so long, by both names where they differ."""
        pairs = zip(self._joints, self._mapping.names, self.age_s(), strict=True)
        return [ours if ours == theirs else f"{ours} ({theirs})" for ours, theirs, age in pairs if age > since_s]


def _list(message: Any, key: str) -> list[Any]:
    values = message.get(key, []) if isinstance(message, dict) else None
    if not isinstance(values, list):
        raise InvalidInput(f"expected {key} to be a list, got {shown(values, 40)}")
    return values


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise InvalidInput(f"{name}: expected a finite number, got {shown(value, 40)}")
    return float(value)
