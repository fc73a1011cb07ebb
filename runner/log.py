"""The log of a run: MCAP, one JSON message after the other, readable up to the last one whatever
ends the process.

Five topics, each with its JSON Schema: ``plan`` (which, its digest, how it was timed), ``command``
(what was asked and what was sent), ``measurement`` (the world's state), ``decision`` (what the
runner did, and why) and ``verdict`` (how it ended). There are no chunks: a message is in the file
as soon as it is written.
"""

from __future__ import annotations

import fcntl
import io
import json
import math
import os
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, is_dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.arrays import Array, archive_of
from stancekit.planners.files.documents import decoded, parse_json, read_bytes, shown
from stancekit.planners.files.writing import check_writable
from stancekit.planners.motion.motion import Samples
from stancekit.planners.robot.kinematics import Kinematics

from .control.foot_placement import touch_n
from .control.tracker import Target
from .worlds.world import State


@dataclass
class Record:
    """Targets and measurements of one motion.

    Arguments:
        pairs: target and state of every control period.
        began_s: when each was sent, on the performance counter.
    """

    pairs: list[tuple[Target, State]] = field(default_factory=list)
    began_s: list[float] = field(default_factory=list)

    def add(self, target: Target, state: State, began_s: float) -> None:
        """One control period."""
        self.pairs.append((target, state))
        self.began_s.append(began_s)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """A record as arrays, a row a control period, T of them; N limbs, J joints.

    Arguments:
        com_m, planned_com_m: shape (T, 3).
        frame: progress in key frames, shape (T,).
        origin_m, rotation: of the body's frame, shape (T, 3), (T, 3, 3).
        feet_m: centres, shape (T, N, 3).
        rolled_m: of that, what they should have rolled since they were put down.
        forces_n, planned_forces_n: shape (T, N, 3).
        angles_rad, torques_nm, planned_torques_nm: shape (T, J).
        foothold: what every limb should stand on, −1 in the air, shape (T, N).
        bump_n: terrain on anything but feet, shape (T,).
        touch_n: force above which a foot touches.
    """

    time_s: Array
    frame: Array
    com_m: Array
    planned_com_m: Array
    origin_m: Array
    rotation: Array
    feet_m: Array
    rolled_m: Array
    forces_n: Array
    planned_forces_n: Array
    angles_rad: Array
    torques_nm: Array
    planned_torques_nm: Array
    foothold: Array
    bump_n: Array
    touch_n: float

    @classmethod
    def of(cls, record: Record, kinematics: Kinematics) -> Trace:
        """The arrays of a record.

        Arguments:
            kinematics: of the robot, for its centre of mass.
        """
        pairs = record.pairs
        samples, states = [target.sample for target, _ in pairs], [state for _, state in pairs]
        return cls(
            time_s=np.array([s.time_s for s in states]),
            frame=np.array([p.frame for p in samples]),
            com_m=np.array(
                [s.position_m + s.rotation @ kinematics.com_offset(s.angles_rad) for s in states]
            ),
            planned_com_m=np.array([p.com_m for p in samples]),
            origin_m=np.array([s.position_m for s in states]),
            rotation=np.array([s.rotation for s in states]),
            feet_m=np.array([s.feet_m for s in states]),
            rolled_m=np.array([target.rolled_m for target, _ in pairs]),
            forces_n=np.array([s.forces_n for s in states]),
            planned_forces_n=np.array([p.forces_n for p in samples]),
            angles_rad=np.array([s.angles_rad for s in states]),
            torques_nm=np.array([s.torques_nm for s in states]),
            planned_torques_nm=np.array([target.torques_nm for target, _ in pairs]),
            foothold=np.array([p.foothold for p in samples]),
            bump_n=np.array([s.bump_n for s in states]),
            touch_n=touch_n(kinematics.weight_n),
        )

    def sample(self, row: int, planned: Samples) -> Samples:
        """The robot after a control period as a sample of its motion.

        Arguments:
            planned: the sample that the motion has then, for the surfaces, which was not measured.
        """
        from scipy.spatial.transform import Rotation  # slow to import

        return replace(
            planned,
            com_m=self.com_m[row],
            rotation_rad=Rotation.from_matrix(self.rotation[row]).as_rotvec(),
            frame=self.frame[row],
            feet_m=self.feet_m[row],
            forces_n=self.forces_n[row],
            foothold=self.foothold[row],
            origin_m=self.origin_m[row],
            angles_rad=self.angles_rad[row],
            torques_nm=self.torques_nm[row],
        )

    def slips(self, footholds: int) -> Array:
        """Slips of every foothold's foot from where it touched, while it should stand, shape (P,)
        [m].

        That is its centre's path less what it should have rolled; of one that never touches, from
        where it should have.
        """
        result, feet = np.zeros(footholds), self.feet_m - self.rolled_m
        for foothold, (rows, limbs, first) in enumerate(self._stood(footholds)):
            if len(rows):
                moved = feet[rows[first:], limbs[first:]] - feet[rows[first], limbs[first]]
                result[foothold] = float(np.linalg.norm(moved, axis=1).max())
        return result

    def late(self, footholds: int) -> Array:
        """Delays with which each foothold's foot touched after it should stand, shape (P,) [s]."""
        since = [
            self.time_s[rows[first]] - self.time_s[rows[0]] if len(rows) else 0.0
            for rows, _, first in self._stood(footholds)
        ]
        return np.array(since)

    def found(self, footholds: int) -> NDArray[np.bool_]:
        """Tell which footholds' feet touched while it should stand; true of those that never
        should, shape (P,).
        """
        touches = np.linalg.norm(self.forces_n, axis=-1) > self.touch_n
        return np.array(
            [
                not len(rows) or bool(touches[rows, limbs].any())
                for rows, limbs, _ in self._stood(footholds)
            ]
        )

    def _stood(self, footholds: int) -> Iterator[tuple[NDArray[np.int_], NDArray[np.int_], int]]:
        """Yield for each foothold the rows and the limbs of the samples in which its foot should
        stand there, and the position in these of the first one that touches; 0 if none does.
        """
        touches = np.linalg.norm(self.forces_n, axis=-1) > self.touch_n
        for foothold in range(footholds):
            rows, limbs = np.nonzero(self.foothold == foothold)
            yield rows, limbs, int(np.argmax(touches[rows, limbs])) if len(rows) else 0

    def to_npz(self) -> bytes:
        """All arrays by their names, as a NumPy archive."""
        return archive_of({item.name: getattr(self, item.name) for item in fields(self)})


FORMAT = "stancekit/run/1"
_LARGEST_TIME = 1e9
"""Largest value of times [s] and rates [Hz] in a log."""
TOPICS: Mapping[str, dict[str, str]] = MappingProxyType(
    {
        "plan": {
            "format": "string",
            "digest": "string",
            "course": "string",
            "joints": "array",
            "rate_hz": "number",
        },
        "command": {
            "time_s": "number",
            "asked_rad": "array",
            "sent_rad": "array",
            "planned_rad": "array",
        },
        "measurement": {"time_s": "number", "angles_rad": "array", "position_m": "array"},
        "target": {"time_s": "number", "origin_m": "array"},
        "decision": {"what": "string", "why": "string"},
        "verdict": {"succeeded": "boolean", "message": "string"},
    }
)
"""The topics, and what every message of each has at least, by JSON type; arrays are of numbers, null
where they were not finite, but for the names of joints."""
_KINDS: dict[str, Any] = {"string": str, "number": float | int, "boolean": bool, "array": list}


class Log:
    """Log in which a run writes down what happens; this one forgets everything."""

    def write(self, topic: str, content: Mapping[str, Any]) -> None:
        """Write one message."""


class McapLog(Log):
    """An MCAP file.

    A context manager. Raises InvalidInput where it cannot be written, or without the package mcap.

    A log that is there already stays until this one is ended: then this one takes its place, and
    until then it grows beside it in NAME.partial.mcap. That is where what was written is found
    after a run that was killed, or that could not write on; the next log of that name begins there
    anew. Where nothing is there, the log grows in its own place. Two runs at once do not write one
    log: the second is refused at its first message.

    Arguments:
        clock: clock of the messages, in nanoseconds since 1970; it may be set back, order is the
            file's.
    """

    def __init__(self, path: str | Path, clock: Callable[[], int] = time.time_ns) -> None:
        if find_spec("mcap") is None:
            raise not_installed("--log", "mcap", "logs of runs", "viz")
        self._path, self._clock = Path(path), clock
        self._target = self._place = check_writable(path)
        self._counts, self._channels = dict.fromkeys(TOPICS, 0), dict[str, int]()
        self._stream: IO[bytes] | None = None
        self._writer: Any = None
        self._lost = False

    def _begin(self) -> IO[bytes]:
        """The file, with its head."""
        from mcap.writer import CompressionType, IndexType, Writer

        if self._target.is_file():
            os.close(self._claimed(os.O_RDONLY))
            self._place = self._target.with_suffix(f".partial{self._target.suffix}")
        self._stream = stream = os.fdopen(self._claimed(os.O_WRONLY | os.O_CREAT), "wb")
        if self._place.is_file():
            stream.truncate()
        self._writer = Writer(
            stream, use_chunking=False, compression=CompressionType.NONE, index_types=IndexType.NONE
        )
        self._writer.start(profile="", library="stancekit")
        for topic, keys in TOPICS.items():
            schema = {
                "title": f"stancekit.{topic}",
                "type": "object",
                "required": list(keys),
                "properties": {key: {"type": kind} for key, kind in keys.items()},
            }
            number = self._writer.register_schema(
                f"stancekit.{topic}", "jsonschema", json.dumps(schema).encode()
            )
            self._channels[topic] = self._writer.register_channel(topic, "json", number)
        return stream

    def _claimed(self, how: int) -> int:
        """A descriptor of the file with its lock.

        Raises InvalidInput where another run has it.
        """
        descriptor = os.open(self._place, how, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            raise InvalidInput(
                f"{self._path}: expected a log of its own, another run is writing to it"
            ) from None
        except OSError:  # a file system without locks
            pass
        return descriptor

    def write(self, topic: str, content: Mapping[str, Any]) -> None:
        """Write one message, and hand it to the operating system.

        Numbers that are not finite become null.

        Raises OSError, naming the file, where it cannot be written: what was written before stays,
        and nothing is written any more, so that an ending is not disturbed by a disk that is full.
        """
        if self._lost:
            return
        data = json.dumps(plain(content), allow_nan=False, separators=(",", ":")).encode()
        with self._named():
            stream = self._stream or self._begin()
            now = self._clock()
            self._counts[topic] += 1
            self._writer.add_message(self._channels[topic], now, data, now, self._counts[topic])
            stream.flush()

    def close(self) -> None:
        """End the file properly, and put it in its place; once is enough.

        Raises OSError as ``write``.
        """
        if self._stream is None or self._stream.closed:
            return
        with self._named():
            self._writer.finish()
            self._stream.flush()
            with suppress(OSError):  # a pipe
                os.fsync(self._stream.fileno())
            if self._place != self._target:
                os.replace(self._place, self._target)
            self._stream.close()

    @contextmanager
    def _named(self) -> Iterator[None]:
        """An error of the system names the file; it is the end of the log, and of a file without a
        message.
        """
        try:
            yield
        except OSError as error:
            self._lost = True
            with suppress(OSError):
                if self._stream is not None:
                    self._stream.close()
            if sum(self._counts.values()) <= 1:
                with suppress(OSError):
                    self._place.unlink()
            raise OSError(error.errno, error.strerror, str(self._path)) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()


@dataclass(frozen=True, kw_only=True)
class Message:
    """One message of a log.

    Arguments:
        time_ns: since 1970.
    """

    topic: str
    time_ns: int
    content: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A log that was read.

    Arguments:
        whole: it was ended properly; else the process was, and all that it wrote is here.
    """

    messages: tuple[Message, ...]
    whole: bool

    def of(self, topic: str) -> list[dict[str, Any]]:
        """The contents of a topic's messages, in order."""
        return [message.content for message in self.messages if message.topic == topic]


def read_log(path: str | Path) -> Recorded:
    """Read a log to its end, or to where its writer was killed.

    Raises InvalidInput for what is no log of a run.
    """
    path = Path(path)
    try:
        from mcap.records import Channel, Chunk, Footer, Message as Raw
    except ImportError:
        raise not_installed(str(path), "mcap", "logs of runs", "viz") from None
    messages, topics, whole = list[Message](), dict[int, str](), False
    for record in _records(path):
        if isinstance(record, Footer):
            whole = True
        elif isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Chunk):
            raise InvalidInput(f"{path}: expected a log without chunks, as it was written")
        elif isinstance(record, Raw) and topics.get(record.channel_id) in TOPICS:
            topic, where = topics[record.channel_id], f"{path}: {topics[record.channel_id]}"
            content = parse_json(decoded(record.data, where), where)
            _check_message(topic, content, where)
            messages.append(Message(topic=topic, time_ns=record.log_time, content=content))
    first = messages[0].content if messages else {}
    if first.get("format") != FORMAT:
        version = first.get("format", "no messages")
        raise InvalidInput(f"{path}: expected a log of format {FORMAT!r}, got {shown(version)}")
    if messages[0].topic != "plan":
        raise InvalidInput(f"{path}: expected the topic plan first, got {messages[0].topic}")
    return Recorded(messages=tuple(messages), whole=whole)


def _check_message(topic: str, content: Any, where: str) -> None:
    """Raise InvalidInput unless a message is what its topic's are."""
    wanted = TOPICS[topic]
    if not isinstance(content, dict) or not set(wanted) <= set(content):
        raise InvalidInput(
            f"{where}: expected an object with {', '.join(wanted)}, got something else"
        )
    for name, kind in wanted.items():
        value: Any = content[name]
        if not isinstance(value, _KINDS[kind]) or (isinstance(value, bool) and kind != "boolean"):
            raise InvalidInput(f"{where}: {name}: expected {kind}, got {shown(value)}")
        if name == "joints" and not all(isinstance(item, str) for item in value):
            raise InvalidInput(f"{where}: {name}: expected texts, got {shown(value)}")
        if kind == "array" and name != "joints":
            table(value, (None,), f"{where}: {name}")
        if kind == "number" and not abs(value) <= _LARGEST_TIME:
            raise InvalidInput(
                f"{where}: {name}: expected a number up to {_LARGEST_TIME:g}, got {shown(value)}"
            )


def table(value: Any, shape: tuple[int | None, ...], where: str) -> Array:
    """Numbers of a message in this shape, None where any length will do; null is NaN.

    Raises InvalidInput.
    """
    try:
        values = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(f"{where}: expected numbers, got {shown(value)}") from None
    if values.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, values.shape, strict=True)
    ):
        raise InvalidInput(f"{where}: expected numbers of shape {shape}, got {values.shape}")
    return values


def _records(path: Path) -> Iterator[Any]:
    """The records of a file, as far as they are whole."""
    from mcap.exceptions import EndOfFile, InvalidMagic
    from mcap.stream_reader import StreamReader

    content = read_bytes(path)
    records = StreamReader(
        io.BytesIO(content), record_size_limit=len(content), emit_chunks=True
    ).records
    while True:
        try:
            record = next(records, None)
        except (EndOfFile, struct.error):  # the writer was killed
            return
        except InvalidMagic:
            raise InvalidInput(f"{path}: expected an MCAP file, got something else") from None
        except Exception as error:  # what mcap's readers meet
            why = " ".join(str(error).split()) or type(error).__name__
            raise InvalidInput(f"{path}: expected an MCAP file, broken: {why:.120}") from None
        if record is None:
            return
        yield record


def plain(value: Any) -> Any:
    """JSON-ready: arrays as lists, data classes by their fields, what is not finite as null."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist()) if not np.isfinite(value).all() else value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if is_dataclass(value):
        return plain(vars(value))
    return None if isinstance(value, float) and not math.isfinite(value) else value
