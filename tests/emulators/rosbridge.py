"""A rosbridge with a robot behind it: a real websocket server on loopback, ROS 1 or 2, and its
faults.

It is as unkind as a real one: what is published on a topic that was advertised just before comes
late, or never; a controller that does not run says nothing; subscriptions of another type than the topic's are
silent, as are types that it does not know; a stamp in the past makes a trajectory void. Where the
computer is too slow the robot's time stands still meanwhile, so that no joint seems to jump; and
while a host that counts what it hears has not yet been run, so that nothing seems to be late.

It speaks the public rosbridge v2 protocol: every operation and message that comes is held against
the fields and types of ``rosbridge_protocol``, and what does not conform is answered with a status
message and kept in ``errors``, as a rosbridge refuses messages that do not fit their type. Times
are ``time.monotonic``.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from operator import itemgetter
from typing import Any, Literal, Self

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from .rosbridge_protocol import Client, operation_wrong, path_wrong
from .trajectory_controller import Controller

FAULTS = (
    "rosbridge gone",
    "connection lost",
    "silent",
    "not json",
    "no operation",
    "null angle",
    "half a message",
    "delay",
    "stuck joint",
    "e-stop",
    "status error",
    "controller off",
    "frozen",
    "zeros",
    "shifted",
    "wheels",
    "e-stop gone",
    "e-stop released",
    "other client",
    "one jump",
    "commands lost",
)
TICK_S = 0.005
MOST_S = 0.03
"""The robot's time goes on by no more than this at once."""
HEARD_S = 3.0
"""The robot's time waits so long for a host that has yet to hear what was sent."""
CONNECT_S = 0.1
"""A topic that is advertised has its subscribers so much later; what was published meanwhile comes
then."""
KEPT_S = 1.0
"""It comes no more where they are later than this: then it is lost."""
FROZEN_S = 4.0
"""A rosbridge that is frozen reads and sends nothing for so long, and then everything."""
SECOND_S = 0.04
"""Period of a second publisher of joint states."""
EPOCH_S = 1.7e9
"""The robot's clock when the emulator's ``time.monotonic`` is 0."""
Estops = Literal["regular", "latched", "quiet", "none", "other type"]
"""An e-stop that says twice a second that it is not pressed, says so once, says nothing until it is
pressed; no e-stop; and one whose messages are of another type."""


class RosBridge:
    """A server; ``port`` is where.

    A context manager.

    names: of the robot's joints, other: of joints that only publish their state. ros: 1 or 2.
    rate_hz: of the joint states. estop: on /e_stop. rosapi: whether there is one. stamps: of the
    states, none are 0. clock_s: how far the robot's clock is off. connect_s: so long after a topic
    was advertised the robot hears what is published there. misses: it hears nothing before the
    topic was advertised anew. log: every command with its time: ("stream" | "late stream" | "halt"
    | "switch", time), late those that came too late to be acted on. errors:
    what was against the protocol.
    """

    def __init__(
        self,
        names: Sequence[str],
        angles_rad: Sequence[float] | None = None,
        *,
        ros: Literal[1, 2] = 2,
        rate_hz: float = 100.0,
        controller: str = "/joint_trajectory_controller",
        other: Sequence[str] = (),
        port: int = 0,
        estop: Estops = "latched",
        rosapi: bool = True,
        stamps: bool = True,
        clock_s: float = 0.0,
        connect_s: float = CONNECT_S,
        misses: bool = False,
    ) -> None:
        start = np.zeros(len(names)) if angles_rad is None else np.array(angles_rad, dtype=float)
        self.robot, self.ros, self.controller = Controller(list(names), start), ros, controller
        self.log: list[tuple[str, float]] = []
        self.errors: list[str] = []
        self.received: list[dict[str, Any]] = []
        self._other, self._period_s = list(other), 1.0 / rate_hz
        self._estop, self._rosapi, self._stamps, self._epoch_s = (
            estop,
            rosapi,
            stamps,
            EPOCH_S + clock_s,
        )
        self._connect_s, self._misses = connect_s, misses
        self._thaw_s, self._second_s, self._regular_s, self._phase = 0.0, 0.0, 0.0, 0
        self._nanos = "nanosec" if ros == 2 else "nsecs"
        self._lock, self._ending = threading.RLock(), threading.Event()
        self._clients: list[Client] = []
        self._due: list[tuple[float, Callable[[], object]]] = []
        self._faults: set[str] = set()
        self._server = serve(
            self._serve, "127.0.0.1", port, logger=logging.Logger("quiet", logging.CRITICAL)
        )
        self.port = int(self._server.socket.getsockname()[1])
        self.robot.now_s = self._ticked_s = self._heard_s = time.monotonic()
        self.robot.stop()
        for target in (self._server.serve_forever, self._live):
            threading.Thread(target=target, daemon=True).start()

    def inject(self, kind: str, at_s: float = 0.0) -> None:
        """Let a fault of ``FAULTS`` happen in so many seconds."""
        if kind not in FAULTS:
            raise ValueError(f"kind: expected one of {', '.join(FAULTS)}, got {kind!r}")
        self._later(at_s, self._happen, kind)

    def _later(self, after_s: float, act: Callable[..., object], *arguments: Any) -> None:
        """Do something in so many seconds."""
        with self._lock:
            self._due.append((time.monotonic() + after_s, partial(act, *arguments)))

    def state(self) -> dict[str, Any]:
        """State of the joints, JSON-ready."""
        with self._lock:
            return {
                "now_s": time.monotonic(),
                "position_rad": self.robot.position.tolist(),
                "rate_rad_s": self.robot.rate.tolist(),
                "desired_rad": self.robot.desired()[0].tolist(),
                "on": self.robot.on,
                "log": list(self.log),
            }

    def close(self) -> None:
        """Stop; once is enough."""
        self._ending.set()
        self._gone()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _gone(self) -> None:
        self._server.shutdown()
        self._drop()

    def _drop(self) -> None:
        for client in list(self._clients):
            client.drop()

    def _serve(self, socket: ServerConnection) -> None:
        client = Client(socket)
        with self._lock:
            self._clients.append(client)
        try:
            for text in socket:
                self._hear(client, str(text))
        except (ConnectionClosed, OSError):
            pass
        finally:
            with self._lock:
                self._clients.remove(client)
            client.end()

    def _hear(self, client: Client, text: str) -> None:
        """One message."""
        while (wait_s := self._thaw_s - time.monotonic()) > 0.0:
            time.sleep(wait_s)
        if "silent" in self._faults:
            return
        try:
            message = json.loads(text)
            wrong = operation_wrong(message)
        except json.JSONDecodeError:
            message, wrong = {}, "not JSON"
        if wrong is not None:
            self._refuse(client, message.get("id") if isinstance(message, dict) else None, wrong)
            return
        with self._lock:
            self.received.append(message)
        getattr(self, "_" + message["op"])(client, message)

    def _refuse(self, client: Client, message: Any, why: str) -> None:
        with self._lock:
            self.errors.append(why)
        self._say(
            client,
            {"op": "status", "level": "error", "msg": why}
            | ({} if message is None else {"id": message}),
        )

    def _advertise(self, client: Client, message: dict[str, Any]) -> None:
        """A type that this ROS does not know is logged there, and nobody is told."""
        if not self._knows(message["type"]):
            with self._lock:
                self.errors.append(f"{message['topic']}: unknown type {message['type']}")
        client.advertised.setdefault(message["topic"], time.monotonic())

    def _knows(self, kind: str) -> bool:
        """Tell whether this ROS knows the name of a type; ROS 2 takes those of ROS 1, too."""
        return kind.count("/") == 1 or (self.ros == 2 and kind.count("/") == 2)

    def _unadvertise(self, client: Client, message: dict[str, Any]) -> None:
        with self._lock:
            client.advertised.pop(message["topic"], None)
            client.ended.add(message["topic"])

    def _subscribe(self, client: Client, message: dict[str, Any]) -> None:
        """A type that this ROS does not know, or that is not the topic's, is logged there, and
        nobody is told.
        """
        topic, kind = message["topic"], message.get("type", "")
        if (kind and not self._knows(kind)) or (topic == "/e_stop" and self._estop == "other type"):
            return
        with self._lock:
            client.topics.add(topic)
            if topic == "/e_stop" and self._estop == "latched":
                self._say(
                    client,
                    {"op": "publish", "topic": topic, "msg": {"data": "e-stop" in self._faults}},
                )

    def _unsubscribe(self, client: Client, message: dict[str, Any]) -> None:
        with self._lock:
            client.topics.discard(message["topic"])

    def _publish(self, client: Client, message: dict[str, Any]) -> None:
        """Hold back messages that come before the topic has its subscribers, as long as a rosbridge
        keeps them.
        """
        since_s = time.monotonic() - client.advertised.setdefault(
            message["topic"], time.monotonic()
        )
        missed = self._misses and message["topic"] not in client.ended
        if (
            "commands lost" in self._faults
            or missed
            or (since_s < self._connect_s and self._connect_s > KEPT_S)
        ):
            return
        if since_s < self._connect_s:
            self._later(self._connect_s - since_s, self._published, client, message)
        else:
            self._published(client, message)

    def _published(self, client: Client, message: dict[str, Any]) -> None:
        topic, message_fields = message["topic"], message["msg"]
        with self._lock:
            if topic == f"{self.controller}/{'joint_trajectory' if self.ros == 2 else 'command'}":
                if (wrong := path_wrong(message_fields, self._nanos)) is not None:
                    self._refuse(client, message.get("id"), wrong)
                    return
                loaded = self.robot.load(message_fields, self._nanos, self._epoch_s)
                what = (
                    "halt"
                    if not message_fields["points"]
                    else "stream"
                    if loaded
                    else "late stream"
                )
                self.log.append((what, time.monotonic()))

    def _call_service(self, client: Client, message: dict[str, Any]) -> None:
        values = self._service(message["service"], message.get("args", {}))
        known = values is not None
        answer = {
            "op": "service_response",
            "service": message["service"],
            "result": known,
            "values": values if known else "service does not exist",
        }
        self._say(client, answer | ({"id": message["id"]} if "id" in message else {}))

    def _service(self, service: str, request: Any) -> dict[str, Any] | None:
        """The answer of a service; None where there is none of this name."""
        if service == "/controller_manager/switch_controller":
            with self._lock:
                self.log.append(("switch", time.monotonic()))
                self.robot.on = bool(
                    request.get("activate_controllers") or request.get("start_controllers")
                )
                self.robot.stop()
            return {"ok": True}
        if service == "/controller_manager/list_controllers":
            return {"controller": [self._listed()]}
        if not self._rosapi or not service.startswith("/rosapi/"):
            return None
        there = self._estop != "none" and "e-stop gone" not in self._faults
        kind = "std_msgs/Int8" if self._estop == "other type" else "std_msgs/Bool"
        kind = kind.replace("/", "/msg/") if self.ros == 2 else kind
        estop = request.get("topic") == "/e_stop" if isinstance(request, dict) else False
        answers: dict[str, dict[str, Any]] = {
            "/rosapi/publishers": {"publishers": ["/estop_node"] if estop and there else []},
            "/rosapi/topic_type": {"type": kind if estop and there else ""},
            "/rosapi/topics_for_type": {"topics": self._topics_of(request, kind if there else "")},
            "/rosapi/get_time": {"time": {}},
        }
        return answers.get(service)

    def _topics_of(self, request: Any, estop: str) -> list[str]:
        wanted = str(request.get("type", "")).replace("/msg/", "/")
        of = {"/joint_states": "sensor_msgs/JointState", "/e_stop": estop.replace("/msg/", "/")}
        return [topic for topic, kind in of.items() if kind == wanted]

    def _listed(self) -> dict[str, Any]:
        """The controller, as its manager lists it."""
        name, on = self.controller.rsplit("/", 1)[-1], self.robot.on
        if self.ros == 1:
            resources = [
                {
                    "hardware_interface": "PositionJointInterface",
                    "resources": list(self.robot.names),
                }
            ]
            return {
                "name": name,
                "state": "running" if on else "stopped",
                "claimed_resources": resources,
            }
        interfaces = [f"{joint}/position" for joint in self.robot.names]
        claimed = interfaces if on else []
        return {
            "name": name,
            "state": "active" if on else "inactive",
            "claimed_interfaces": claimed,
            "required_command_interfaces": interfaces,
        }

    def _feedback(self) -> dict[str, Any]:
        with self._lock:
            actual, (desired, rate) = self.robot.position, self.robot.desired()
            return {
                "joint_names": list(self.robot.names),
                "desired": {"positions": desired.tolist(), "velocities": rate.tolist()},
                "actual": {"positions": actual.tolist(), "velocities": self.robot.rate.tolist()},
                "error": {"positions": (desired - actual).tolist()},
            }

    def _say(self, client: Client, message: Any) -> None:
        if "silent" not in self._faults:
            client.say(
                message,
                max(time.monotonic() + (0.5 if "delay" in self._faults else 0.0), self._thaw_s),
            )

    def _header(self) -> dict[str, Any]:
        """With the robot's time, or 0."""
        now_s = self.robot.now_s + self._epoch_s if self._stamps else 0.0
        whole = int(now_s)
        stamp = {"sec" if self.ros == 2 else "secs": whole, self._nanos: int(1e9 * (now_s - whole))}
        return {"header": {"stamp": stamp, "frame_id": ""}}

    def _tell(self, topic: str, said: Any) -> None:
        for client in [each for each in self._clients if topic in each.topics]:
            self._say(client, {"op": "publish", "topic": topic, "msg": said})

    def _live(self) -> None:
        """Move the robot, publish, let faults happen."""
        published = 0.0
        while not self._ending.is_set():
            time.sleep(TICK_S)
            with self._lock:
                now = time.monotonic()
                due = sorted((item for item in self._due if item[0] <= now), key=itemgetter(0))
                self._due = [item for item in self._due if item[0] > now]
                for _, act in due:
                    try:
                        act()
                    except Exception as error:  # a bad message must not stop the robot
                        self.errors.append(f"{type(error).__name__}: {error}")
                passed_s = 0.0 if self._awaited(now) else min(now - self._ticked_s, MOST_S)
                self.robot.advance(self.robot.now_s + passed_s)
                self._ticked_s = now
                self._others_live(now)
                if self.robot.now_s >= published + self._period_s - 0.5 * TICK_S:
                    published = self.robot.now_s
                    self._speak()

    def _awaited(self, now: float) -> bool:
        """Tell whether a host has still to hear what was sent, for ``HEARD_S`` at most."""
        if not any(client.behind() for client in list(self._clients)):
            self._heard_s = now
        return now - self._heard_s < HEARD_S and self._heard_s < now

    def _others_live(self, now: float) -> None:
        """Other publishers, and another client of the controller."""
        names, joints = list(self.robot.names), len(self.robot.names)
        if now < self._second_s + SECOND_S:
            return
        self._second_s, self._phase = now, self._phase + 1
        second: dict[str, tuple[list[str], list[float]]] = {
            "zeros": (names, [0.0] * joints),
            "shifted": (names, (self.robot.position + 0.2).tolist()),
            "one jump": (names, (self.robot.position + 2.0).tolist()),
            "wheels": (["left_wheel", "right_wheel"], []),
        }
        for kind in self._faults & set(second):
            names_live, positions = second[kind]
            states = {
                "name": names_live,
                "position": positions,
                "velocity": [0.5] * len(names_live),
            }
            self._tell("/joint_states", self._header() | states)
        self._faults.discard("one jump")
        if "other client" in self._faults:
            point = (self.robot.position + 0.3 * np.sin(0.5 * self._phase)).tolist()
            whole = "sec" if self.ros == 2 else "secs"
            after = {whole: 0, self._nanos: 60_000_000}
            path = {
                "joint_names": names,
                "points": [{"positions": point, "time_from_start": after}],
            }
            self.robot.load(path, self._nanos, self._epoch_s)
        if (
            self._estop == "regular"
            and now > self._regular_s + 0.5
            and "e-stop gone" not in self._faults
        ):
            self._regular_s = now
            self._tell("/e_stop", {"data": "e-stop" in self._faults})

    def _speak(self) -> None:
        """Joint states, and the controller's state."""
        names, robot = [*self.robot.names, *self._other], self.robot
        rest = [0.0] * len(self._other)
        positions: list[Any] = [*robot.position.tolist(), *rest]
        if "null angle" in self._faults:
            positions[0] = None
        if "half a message" in self._faults:
            positions = positions[: len(positions) // 2]
        fields_sent = {
            "name": names,
            "position": positions,
            "velocity": [*robot.rate.tolist(), *rest],
            "effort": [],
        }
        self._tell("/joint_states", self._header() | fields_sent)
        if robot.on:
            state = self._header() | self._feedback()
            self._tell(
                f"{self.controller}/{'controller_state' if self.ros == 2 else 'state'}", state
            )
        if "e-stop" in self._faults:
            self._tell("/e_stop", {"data": True})
        if "not json" in self._faults:
            self._shout("{what?")
        if "no operation" in self._faults:
            self._shout({"hello": "world"})
        if "status error" in self._faults:
            self._shout({"op": "status", "level": "error", "msg": "type of topic differs"})

    def _shout(self, message: Any) -> None:
        for client in self._clients:
            self._say(client, message)

    def _happen(self, kind: str) -> None:
        self.log.append((f"fault: {kind}", time.monotonic()))
        if kind == "rosbridge gone":
            threading.Thread(target=self._gone, daemon=True).start()
        elif kind == "connection lost":
            self._drop()
        elif kind == "stuck joint":
            self.robot.stuck[0] = True
        elif kind == "controller off":
            self.robot.on = False
        elif kind == "frozen":
            self._thaw_s = time.monotonic() + FROZEN_S
        elif kind == "e-stop released":
            self._faults.discard("e-stop")
        else:
            self._faults.add(kind)
