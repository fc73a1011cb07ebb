"""Whole trajectories as goals: sent, watched, and cancelled whatever happens on the way."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array

from .bridge import RosLink
from .goal import Goal, follow_goal, speeds, trajectory
from .robot import POLL_S, RosRobot

_PROBE_S = 3.0
"""Length of the goal that is cancelled before any other is sent."""
_TRIES = 3
"""So often it is sent before a robot is refused that acts on none."""
_ACTIVE_S = 0.3
"""So long is waited for a sign that a goal of ROS 2 is acted on: its feedback, which some
controllers do not send."""
AGAIN_S = 0.1
"""A cancel may be lost: it is sent again so often until the goal has ended."""
_REPLACED_S = 0.5
"""A goal that a cancel did not end in this time is replaced."""


class Follower:
    """Sends goals to one robot, one at a time.

    ``stop`` may be called from another thread.
    """

    def __init__(self, robot: RosRobot) -> None:
        self._robot = robot
        self._stop, self._fed, self._cancels = threading.Event(), threading.Event(), False

    def ready(self) -> None:
        """Take goals again after ``stop``."""
        self._stop.clear()

    def stop(self) -> None:
        """Let the goal that is on its way be cancelled, and send none until ``ready``."""
        self._stop.set()

    def follow(
        self, first_rad: Array, times_s: Array, angles_rad: Array, on_feedback: Callable[[], None]
    ) -> None:
        """Send a trajectory and wait for its end.

        Arguments:
            first_rad: where the robot is held now, shape (J,).
            on_feedback: called after feedback.

        Raises:
            InvalidInput: where the robot does not cancel goals, HardwareFault for one that did not
                succeed, after cancelling it; Stopped after a stop, before it was sent.
        """
        if not self._cancels:
            self._probe(first_rad)
        if self._stop.is_set():
            raise HardwareFault("trajectory: stopped before it was sent")
        goal = self._send(times_s, angles_rad, speeds(times_s, angles_rad, first_rad))
        setup = self._robot.setup
        end = time.monotonic() + float(times_s[-1]) + setup.goal_s + setup.timeout_s
        while not goal.done.wait(POLL_S):
            if self._fed.is_set():
                self._fed.clear()
                on_feedback()
            why = self._robot.trouble()
            if why is None and self._robot.latch.tripped:
                why = self._robot.latch.reason
            if why is None and self._stop.is_set():
                why = "trajectory: stopped on the way"
            if why is None and time.monotonic() > end:
                why = f"trajectory: not at its end {setup.goal_s + setup.timeout_s:g} s after it should be"
            if why is not None:
                raise HardwareFault(f"{why}; {self._cancelled(goal)}")
        if goal.ended != "succeeded":
            raise HardwareFault(f"trajectory: {goal.ended}")

    def _probe(self, first_rad: Array) -> None:
        """Send a goal that holds the pose and cancel it: some rosbridges read no cancel while a
        goal is on its way.

        In ROS 1 it is sent again where nothing comes of it: an action server that connects late
        hears no earlier one.
        """
        setup = self._robot.setup
        for _ in range(_TRIES if setup.ros == 1 else 1):
            goal = self._send(
                np.array([_PROBE_S]), first_rad[None, :], np.zeros((1, len(first_rad)))
            )
            if goal.active.wait(setup.timeout_s if setup.ros == 1 else _ACTIVE_S):
                break
            goal.cancel(self._robot.link)
        begin = time.monotonic()
        self._cancel(goal, self._robot.link)
        took = time.monotonic() - begin
        if (goal.ended or "").startswith("rejected"):
            raise InvalidInput(
                f"{self._robot.setup.controller}: a goal that holds the measured pose was "
                f"{goal.ended}"
            )
        if not goal.done.is_set() or took > 0.5 * _PROBE_S:
            hint = (
                ": start the rosbridge with send_action_goals_in_new_thread:=true"
                if setup.ros == 2
                else ""
            )
            raise InvalidInput(
                f"rosbridge {setup.url}: expected a cancelled goal to end at once, it did not{hint}"
            )
        self._cancels = True

    def _send(self, times_s: Array, angles_rad: Array, rates: Array) -> Goal:
        robot, setup = self._robot, self._robot.setup
        angles, rates = robot.mapping.to_ros(angles_rad), robot.mapping.direction * rates
        path = trajectory(robot.mapping.names, times_s, angles, rates, setup.ros)

        def fed(feedback: Any) -> None:
            try:
                robot.states.actual(feedback)
            except InvalidInput as error:
                robot.link.complain(f"feedback: {error}")
            else:
                self._fed.set()

        goal = follow_goal(
            path, robot.mapping.names, setup.path_rad, setup.goal_rad, setup.goal_s, setup.ros
        )
        goals = robot.goals
        return robot.link.through(robot.latch, lambda: goals.send(goal, fed))

    def _cancelled(self, goal: Goal) -> str:
        """Cancel, over a new connection if the old one is of no use; what to say of that."""
        setup = self._robot.setup
        if self._robot.link.alive:
            self._cancel(goal, self._robot.link)
            return (
                "it is cancelled" if goal.done.is_set() else "the robot did not confirm the cancel"
            )
        again = RosLink(setup.host, setup.port, min(setup.timeout_s, 1.0))
        try:
            again.open()
        except InvalidInput:
            return "it could not be cancelled"
        try:
            for _ in range(2):
                goal.cancel(again)
                self._robot.halt(again)
                time.sleep(AGAIN_S)
        finally:
            again.close()
        return "a cancel was sent over a new connection"

    def _cancel(self, goal: Goal, link: RosLink) -> None:
        """Cancel once it is active, and again until it has ended; one that does not is replaced,
        where that can be.
        """
        begin = time.monotonic()
        end = begin + self._robot.setup.timeout_s
        while not goal.done.is_set() and time.monotonic() < end and link.alive:
            if goal.active.wait(AGAIN_S):
                goal.cancel(link)
                goal.done.wait(AGAIN_S)
            if time.monotonic() - begin > _REPLACED_S:
                goal.cancel(link)
                self._robot.halt()
