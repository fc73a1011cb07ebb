"""A robot behind a rosbridge as a world (extra ``machines``), driven by a joint trajectory controller
of ROS 1 or 2.

Every period a trajectory of one point is published, the target, to be reached ``lead_s`` later, on
the controller's topic, and each replaces the one before. A lost connection, or a host that died,
leaves the controller with one point less than ``lead_s`` away: it goes there and holds. (An action
goal a period would not do: a rosbridge keeps a client and a thread for each.)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from typing import Any, Literal, Self

import numpy as np

from stancekit.planners.errors import HardwareFault, InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot import Robot
from stancekit.planners.robot.leg import Actuators
from stancekit.planners.robot.robot_file import Servo

from ...safety.estop import StopLatch
from ..hardware import HardwareWorld, listed
from ..world import Drives, EstopCheck, WorldSettings
from .bridge import POLL_S, Estop, Message, RosLink, waited
from .joint_states import ControllerState, JointStates, Mapping, RosSetup, version_of

_RUNNING = ("running", "active")
_DEFAULT = "/controller_manager"


def _joints(controller: dict[str, Any]) -> frozenset[str]:
    """Joints among what it claims, of either version of ROS."""
    claimed = controller.get("claimed_resources") or []
    names = {
        str(name)
        for each in claimed
        if isinstance(each, dict)
        for name in each.get("resources") or []
    }
    interfaces = (
        controller.get("required_command_interfaces") or controller.get("claimed_interfaces") or []
    )
    return frozenset(names | {str(each).rsplit("/", 1)[0] for each in interfaces})


_LOOK_S = 0.5
"""So long is listened at least, for nonsense between what makes sense."""
_PATIENCE = 3.0
"""A controller is waited for so many times as long where joint states are heard: its topic is
subscribed to later."""
_FEW = 3
"""Joint states are late after so many of their periods, where that is more than ``stale_s``."""
_PERIODS = 2
"""Nothing is sent while the newest joint states are older than so many periods, of theirs and of
the commands."""
_ANSWER_S = 0.1
"""So long a rosbridge may take to answer before it is asked again."""
_STILL_S, _REST_S = 0.15, 1.0
"""A robot that did not move for STILL_S is at rest; so long is waited for that after a stop."""
_AGAIN_S = 0.5
"""A command that arms it is sent again so long after it should have been acted on."""
_FORGOTTEN_S = 10.5
"""A rosbridge publishes a topic for 10 s after its last advertiser left."""
_NOTICED_RAD = 9e-7
"""A controller says that it wants a joint so far away, and no joint turns by so little."""
_JOINT_STATE, _STATE = (
    ("sensor_msgs", "JointState"),
    ("control_msgs", "JointTrajectoryControllerState"),
)


class RosRobot:
    """One connection to one robot.

    ``listen`` first; a robot that is lost stays lost. J joints.

    Arguments:
        velocity_rad_s: the greatest of the joints, shape (J,).
        latch: whatever moves it passes this. stopped: its controller, which the manager can switch
            on, does not run.

    Raises:
        InvalidInput: for a setup that lacks joints, and without roslibpy.
    """

    def __init__(
        self, setup: RosSetup, joints: Sequence[str], latch: StopLatch, velocity_rad_s: Array
    ) -> None:
        self.setup, self.mapping, self.latch = setup, Mapping(setup, joints), latch
        self.states = JointStates(self.mapping, joints, velocity_rad_s)
        self.controller = ControllerState(
            self.mapping, joints, self.states, setup.lead_s + setup.stale_s
        )
        self.link = RosLink(setup.host, setup.port, setup.timeout_s)
        self.estop = None if setup.estop is None else Estop(self.link, setup.estop)
        self.stopped = False
        self._joints = tuple(joints)
        self._sent_s, self._void_s = -np.inf, -np.inf

    def connect(self) -> None:
        """Connect and subscribe; nothing is sent that could move the robot.

        Raises InvalidInput.
        """
        setup = self.setup
        self.link.open()
        self.link.subscribe(setup.joint_states, self.kind(*_JOINT_STATE), self._measure)
        state = "controller_state" if setup.ros == 2 else "state"
        self.link.subscribe(f"{setup.controller}/{state}", self.kind(*_STATE), self.controller.take)
        if setup.ros == 2:  # its name before Iron
            self.link.subscribe(
                f"{setup.controller}/state", self.kind(*_STATE), self.controller.take
            )
        if self.estop is not None:
            self.estop.subscribe(self.kind("std_msgs", "Bool"))
        self.link.advertise(self._command, self.kind("trajectory_msgs", "JointTrajectory"))
        self.listen()

    def listen(self) -> None:
        """Wait until the robot has spoken of all joints, and see that its controller means the same
        ones.

        A controller that its manager lists as stopped says nothing, and is asked for its joints
        there. Raises InvalidInput for silence, nonsense, and joints that do not match.
        """
        setup = self.setup
        begin, late, missing = time.monotonic(), False, list(self._joints)
        listed: tuple[str, frozenset[str]] | None = None
        while not late and self.trouble(silence=False) is None:
            time.sleep(POLL_S)
            spent_s, missing = time.monotonic() - begin, self.states.silent(self._stale_s())
            if not missing and self.controller.names and spent_s > _LOOK_S:
                break
            if (
                not missing
                and spent_s > 2.0 * _LOOK_S
                and setup.controller_manager is not None
                and listed is None
            ):
                listed = self._listed()
                if listed[0] not in ("", *_RUNNING):
                    break
            late = spent_s > setup.timeout_s * (1.0 if missing else _PATIENCE)
        if (trouble := self.trouble(silence=False)) is not None:
            raise InvalidInput(trouble)
        if late and missing:
            raise InvalidInput(f"rosbridge {setup.url}: {self._unheard_states(missing)}")
        state, joints = listed or ("", frozenset())
        self.stopped = not self.controller.names and state not in ("", *_RUNNING)
        if not (self.stopped or self.controller.names):
            raise InvalidInput(f"rosbridge {setup.url}: {self._unheard_controller()}")
        self._check_names(self.controller.names or joints)

    def started(self) -> None:
        """Wait for the controller that was switched on.

        Raises HardwareFault where it stays silent, or has others' joints.
        """
        if not waited(lambda: bool(self.controller.names), self.setup.timeout_s):
            raise HardwareFault(f"{self.setup.controller}: switched on, and nothing heard of it")
        try:
            self._check_names(self.controller.names)
        except InvalidInput as error:
            raise HardwareFault(str(error)) from None
        self.stopped = False

    def trouble(self, *, silence: bool = True) -> str | None:
        """Present fault, None if there is none.

        Arguments:
            silence: joints that were not heard of lately are, and an e-stop.
        """
        result = self.link.trouble()
        if result is None and self.estop is not None and self.estop.pressed:
            result = f"e-stop pressed on {self.estop.topic}"
        if result is None and (why := self.controller.trouble()) is not None:
            result = f"{self.setup.joint_states if 'publishers' in why else self.setup.controller}: {why}"
        if result is None and silence and (late := self.states.silent(self._stale_s())):
            result = f"{self.setup.joint_states}: {listed(late)}: nothing heard for {1e3 * self._stale_s():.0f} ms"
        if result is None and silence and self.estop is not None:
            result = self.estop.lost()
        return result

    def fresh(self, period_s: float) -> bool:
        """Tell whether the newest joint states are young enough to send something.

        Arguments:
            period_s: of the commands.
        """
        return bool(self.states.age_s().max() <= _PERIODS * max(self.states.period_s(), period_s))

    def wake(self, period_s: float) -> None:
        """Wait for joint states that are fresh enough, before anything is sent.

        Raises InvalidInput for a trouble, and where none come.

        Arguments:
            period_s: of the commands.
        """
        waited(
            lambda: self.fresh(period_s) or self.trouble(silence=False) is not None,
            self.setup.timeout_s,
            self.latch.check,
        )
        if (trouble := self.trouble()) is not None:
            raise InvalidInput(trouble)

    def stream(self, targets_rad: Array) -> None:
        """Publish a trajectory that goes to these targets, shape (J,), ``lead_s`` ahead; it
        replaces the one before.

        Where the controller's clock is known, one that comes later than that is reached when it
        would be ``stale_s`` late, and one that comes later still is dropped; in ROS 2 all that come
        later than ``lead_s`` are. Raises Stopped after a stop, HardwareFault where it cannot be
        sent.
        """
        setup, now = self.setup, time.monotonic()
        point, stamp_s = self.mapping.told(targets_rad), self.controller.clock.at(now)
        late = stamp_s is not None and setup.ros == 1
        times_s = np.array([setup.lead_s, setup.lead_s + setup.stale_s] if late else [setup.lead_s])
        path = trajectory(
            self.mapping.names,
            times_s,
            np.tile(point, (len(times_s), 1)),
            setup.ros,
            stamp_s or 0.0,
        )
        self.controller.sent(point)
        kind = self.kind("trajectory_msgs", "JointTrajectory")
        self.link.through(self.latch, lambda: self.link.publish(self._command, kind, path))
        self._sent_s = now
        self._void_s = np.inf if stamp_s is None else now + float(times_s[-1])

    def take_over(self, pose_rad: Array, period_s: float) -> None:
        """Have the controller hold a pose, shape (J,), and wait until it says that it wants that.

        Its connection to what a rosbridge publishes may come seconds after its states are heard:
        what is sent before is lost, and with what is sent then it would jump. So it is sent the
        pose again until it wants it; where that does not come, the topic is advertised anew. Where
        it wanted the pose before, one joint is sent NOTICED_RAD beside it. Raises InvalidInput for
        a controller that takes no commands, HardwareFault for a trouble and for one that says
        nothing, Stopped after a stop.

        Arguments:
            period_s: of the commands.
        """
        pose, begin_s = pose_rad.copy(), time.monotonic()
        if self.controller.wants(self.mapping.told(pose)):
            pose[0] -= np.copysign(_NOTICED_RAD, pose[0])
        for again in (False, True):
            if again:
                self._readvertise()
            if self._imposed(pose, period_s):
                return
        spent_s = time.monotonic() - begin_s
        name, trouble = self.setup.controller, self.trouble()
        if trouble is not None or self.controller.heard_s < begin_s:
            raise HardwareFault(trouble or f"{name}: nothing heard of it for {spent_s:.0f} s")
        raise InvalidInput(
            f"{name}: expected it to hold the pose that is sent on {self._command}, it took no "
            "command for "
            f"{spent_s:.0f} s: is that its topic?"
        )

    def _imposed(self, pose_rad: Array, period_s: float) -> bool:
        """Send a pose until the controller wants it; whether it does in time."""
        point, end = (
            self.mapping.told(pose_rad),
            time.monotonic() + _PATIENCE * self.setup.timeout_s,
        )
        while time.monotonic() < end:
            if self.fresh(period_s):
                self.stream(pose_rad)
            over_s = time.monotonic() + self.setup.lead_s
            again_s = over_s + max(_AGAIN_S, 2.0 * self.controller.clock.period_s())
            while time.monotonic() < again_s:
                if (trouble := self.trouble(silence=False)) is not None:
                    raise HardwareFault(trouble)
                wants = self.controller.wants(point)
                if wants is not False and self.controller.heard_s > over_s:
                    return True
                time.sleep(POLL_S)
        return False

    def _readvertise(self) -> None:
        """Have the rosbridge publish commands anew.

        A subscriber of ROS 1 that did not come to connect when it was told of a publisher does not
        try again before it is told of another one.
        """
        self.link.unadvertise(self._command)
        waited(lambda: self.trouble(silence=False) is not None, _FORGOTTEN_S, self.latch.check)
        self.link.advertise(self._command, self.kind("trajectory_msgs", "JointTrajectory"))

    def settle(self, period_s: float, beat: Callable[[], None]) -> str:
        """Wait until nothing moves any more; what may still come, empty where nothing may.

        A rosbridge that is late is sent a command to hold, for what waits in it.

        Arguments:
            period_s: of the commands.
            beat: called while it waits.
        """
        if self._sent_s == -np.inf:
            return ""
        late = self.link.alive and not self.fresh(period_s)
        if late and self.setup.ros == 1:  # without points it holds where it is, and drops the rest
            nothing = np.zeros((0, len(self._joints)))
            holds = trajectory(self.mapping.names, np.zeros(0), nothing, 1)
            kind = self.kind("trajectory_msgs", "JointTrajectory")
            self.link.publish(self._command, kind, holds)
        end, read = time.monotonic() + _REST_S, False
        while time.monotonic() < end and self.link.alive:
            beat()
            read = read or self.link.answers(_ANSWER_S)
            now, newest_s = time.monotonic(), time.monotonic() - float(self.states.age_s().max())
            still_s = newest_s - max(self.states.moved_s, self._sent_s + self.setup.lead_s)
            if read and still_s > _STILL_S and self.fresh(period_s):
                return ""
            time.sleep(POLL_S)
        now = time.monotonic()
        if read and self.fresh(period_s):
            return "it still moves: another client of the controller?"
        void = self._void_s + self.setup.stale_s
        if now < void < np.inf:
            beat()
            time.sleep(min(void - now, _REST_S))
        what = "the connection is lost" if not self.link.alive else "nothing is heard"
        if void < np.inf:
            return (
                f"{what}; what was sent is out of date by its stamps, and is not acted on any more"
            )
        since = f"{now - self._sent_s:.1f} s ago"
        return (
            f"{what}; commands that were sent up to {since} have no stamps, and may still move it, "
            "for up to "
            f"{self.setup.lead_s:g} s, whenever the rosbridge goes on"
        )

    def switch(self, on: bool) -> None:
        """Switch the controller on or off.

        Raises HardwareFault where that is refused, or the manager is not there; and Stopped after a
        stop, for on.
        """
        manager, ros = self.setup.controller_manager, self.setup.ros
        if manager is None:
            raise HardwareFault(
                "torque: cannot be switched, the setup names no controller_manager; the robot holds"
            )
        verbs = ("activate", "deactivate") if ros == 2 else ("start", "stop")
        lists = {
            f"{verb}_controllers": [self._name] if on == (k == 0) else []
            for k, verb in enumerate(verbs)
        }
        kind = self.kind("controller_manager_msgs", "SwitchController", "srv")
        try:
            with self.latch.sending() if on else nullcontext():
                answer = self.link.call(
                    f"{manager}/switch_controller", kind, lists | {"strictness": 1}
                )
        except InvalidInput as error:
            raise HardwareFault(f"torque: {error}") from None
        if answer.get("ok") is not True:
            raise HardwareFault(
                f"torque: {manager} did not switch {self._name} {'on' if on else 'off'}"
            )

    def _listed(self) -> tuple[str, frozenset[str]]:
        """State of the setup's controller, and the joints that it moves; empty where nothing answers,
        or does not know it.
        """
        manager = self.setup.controller_manager or _DEFAULT
        kind = self.kind("controller_manager_msgs", "ListControllers", "srv")
        with suppress(InvalidInput):
            answer = self.link.call(f"{manager}/list_controllers", kind, {})
            for each in answer.get("controller") or []:
                if isinstance(each, dict) and each.get("name") == self._name:
                    return str(each.get("state")), _joints(each)
        return "", frozenset()

    def kind(self, package: str, name: str, sort: Literal["msg", "srv"] = "msg") -> str:
        """The type of a message, or of a service, as this ROS names it."""
        return f"{package}/{sort}/{name}" if self.setup.ros == 2 else f"{package}/{name}"

    @property
    def _name(self) -> str:
        """The controller as its manager calls it."""
        return self.setup.controller.rsplit("/", 1)[-1]

    @property
    def _command(self) -> str:
        return f"{self.setup.controller}/{'joint_trajectory' if self.setup.ros == 2 else 'command'}"

    def _stale_s(self) -> float:
        """Largest age of joint states; some periods for a robot that sends them rarely."""
        return max(self.setup.stale_s, _FEW * min(self.states.period_s(), 1.0))

    def _measure(self, message: Any) -> None:
        version = version_of(message)
        if version not in (None, self.setup.ros):
            raise InvalidInput(
                f"its stamps are those of ROS {version}: ros: {version} in the setup?"
            )
        self.states.take(message)

    def _check_names(self, names: Sequence[str] | frozenset[str]) -> None:
        wrong = sorted(set(names).symmetric_difference(self.mapping.names))
        if wrong:
            raise InvalidInput(
                f"{self.setup.controller}: expected the joints of the setup, they differ in "
                f"{listed(wrong)}"
            )

    def _unheard_states(self, missing: Sequence[str]) -> str:
        """Message for joints that were not heard of, with what to do."""
        topic, others = self.setup.joint_states, sorted(self.states.others)
        if len(missing) < len(self._joints) or others:
            there = f"; other names there: {listed(others)}" if others else ""
            return f"{topic}: expected all joints, nothing of {listed(missing)}{there}"
        message = f"expected joint states on {topic}, heard none"
        if self._heard_as_other(topic):
            other = 3 - self.setup.ros
            return f"{message} of ROS {self.setup.ros}; there are some of ROS {other}: ros: {other} in the setup"
        there_are = self.link.topics_of("/".join(_JOINT_STATE)) or []
        if elsewhere := [each for each in there_are if each != topic]:
            return f"{message}; there are some on {listed(elsewhere)}"
        return message

    def _heard_as_other(self, topic: str) -> bool:
        """Tell whether joint states of the other version of ROS are published."""
        if self.setup.ros == 1:
            return False  # a rosbridge of ROS 2 takes the names of ROS 1
        heard = list[Any]()
        self.link.subscribe(topic, "/".join(_JOINT_STATE), heard.append)
        waited(lambda: bool(heard), self.setup.timeout_s)
        return any(version_of(message) == 1 for message in heard)

    def _unheard_controller(self) -> str:
        """Message for a controller that was not heard of, with what to do."""
        setup = self.setup
        message = f"expected the state of {setup.controller}, heard nothing"
        state, _ = self._listed()
        if not state:
            return f"{message}: is it running?"
        says = f"{setup.controller_manager or _DEFAULT} says that it is {state}"
        if state in _RUNNING:
            return f"{message}, although {says}: does it publish its state?"
        return f"{message}: {says}; start it, or name controller_manager in the setup"


def trajectory(
    names: tuple[str, ...],
    times_s: Array,
    positions: Array,
    ros: Literal[1, 2],
    stamp_s: float = 0.0,
) -> Message:
    """A JointTrajectory; shapes (T,), (T, J). Without velocities the controller goes in straight
    lines.

    Arguments:
        stamp_s: when it begins, by the robot's clock; one that has ended by then when it arrives is
            dropped. A stamp of 0 is "from when it arrives". Where it is left out, a rosbridge
            writes its own clock's time into it.
    """
    points = [
        {"positions": positions[k].tolist(), "time_from_start": duration(float(time_s), ros)}
        for k, time_s in enumerate(times_s)
    ]
    header = {"stamp": duration(stamp_s, ros), "frame_id": ""}
    return {"header": header, "joint_names": list(names), "points": points}


def duration(seconds: float, ros: Literal[1, 2]) -> Message:
    """A duration as ROS 1 or ROS 2 writes it."""
    whole, nanos = divmod(round(seconds * 1e9), 1_000_000_000)
    return {"sec": whole, "nanosec": nanos} if ros == 2 else {"secs": whole, "nsecs": nanos}


class RosWorld(HardwareWorld):
    """Joints that a controller moves; ``stop`` may come from another thread.

    Torques are the efforts that ROS reports. Raises InvalidInput for a setup that lacks joints, and
    without roslibpy or pinocchio.

    Arguments:
        estop: how the e-stop of the setup is known to work before the robot is armed.
    """

    name = "ros"
    wrong = "is its name or offset right"

    def __init__(
        self,
        robot: Robot,
        setup: RosSetup,
        servo: Servo | None = None,
        *,
        rate_hz: float | None = None,
        actuators: Actuators | None = None,
        estop: EstopCheck = "heard",
    ) -> None:
        drives = Drives.of(robot.legs_with(servo or robot.servo), actuators)
        known = actuators is not None and all(
            each.stiffness_nm_rad is not None for each in drives.actuators
        )
        super().__init__(robot, servo, replace(drives, yields=known), rate_hz)
        self.alone = f"the controller goes to its last target, {setup.lead_s:g} s away, and holds"
        self.setup, self.estop, self._evidence = setup, estop, ""
        self._robot = self._made()
        self._switched = False  # on, by an arming that did not end well

    @classmethod
    def make(cls, settings: WorldSettings) -> Self:
        """Make the world, see ``JointBus``."""
        setup = settings.device(RosSetup, "a set-up file", cls.name)
        return cls(
            settings.robot,
            setup,
            settings.servo,
            rate_hz=settings.rate_hz,
            actuators=settings.actuators,
            estop=settings.estop,
        )

    def stop(self, *, torque_off: bool = False) -> str:
        """Send nothing any more: the controller holds its last target, and a rosbridge that is late
        is sent a hold for what waits in it; or it is switched off. Then wait until nothing moves,
        and say what may still come.

        After an arming that was interrupted it is switched off; raises HardwareFault where that
        cannot be done.
        """
        self.armed = False
        if self._switched or (torque_off and self._open):
            self._robot.switch(False)
            self._switched = False
        return "" if torque_off else self._robot.settle(1.0 / self.rate_hz, self.beat)

    def report(self) -> str:
        """Evidence about the e-stop, of the last arming."""
        return self._evidence

    def close(self) -> None:
        """Disconnect; the robot holds."""
        self.armed = self._open = False
        self._robot.link.close()

    def _reached(self) -> tuple[Array, Array, Array]:
        """Connect, check the controller's joints, measure.

        Raises InvalidInput where no rosbridge is, where it answers nonsense, for joints that do not
        match, and an e-stop that is pressed.
        """
        self.close()
        self._robot, self._driven = self._made(), False
        try:
            self._robot.connect()
        except BaseException:
            self._robot.link.close()
            raise
        self._open = True
        return self._robot.states.read()

    def _switched_on(self) -> None:
        """Have the controller hold the measured pose, switched on if the setup names its manager.

        Raises InvalidInput for an e-stop that would not be heard, for joints that another node
        moves, and for a controller that takes no commands.
        """
        period_s = 1.0 / self.rate_hz
        self._robot.wake(period_s)
        stop = self._robot.estop
        self._evidence = "" if stop is None else stop.confirm(self.estop)
        if not self._robot.stopped and (busy := self._robot.controller.busy()) is not None:
            raise InvalidInput(f"{self.setup.controller}: {busy}")
        self._driven = True
        if self.setup.controller_manager is not None:
            self.latch.check()
            self._switched = True
            self._robot.switch(True)
            self._robot.started()
        self._robot.wake(period_s)
        self._sent = self._robot.states.read()[0]
        self._robot.take_over(self._sent, period_s)
        self.latch.check()
        self._switched = False

    def _put(self, angles_rad: Array) -> Array:
        """Stream targets, once joint states are fresh: or they would wait with what was sent
        before.
        """
        self._check()
        while not self._robot.fresh(1.0 / self.rate_hz):
            self.latch.check()
            self.beat()
            time.sleep(POLL_S)
            self._check()
        self._robot.stream(angles_rad)
        return angles_rad

    def _measured(self) -> tuple[Array, Array, Array]:
        self._check()
        return self._robot.states.read()

    def _made(self) -> RosRobot:
        return RosRobot(self.setup, self.joints, self.latch, self.capabilities.velocity_rad_s)

    def _check(self) -> None:
        """Raise HardwareFault for whatever is wrong now."""
        if (trouble := self._robot.trouble()) is not None:
            raise HardwareFault(trouble)
