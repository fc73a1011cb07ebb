"""The log: what is written comes back, whatever ends the writer, and nothing else is taken for a
log.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stancekit.runner.log import FORMAT, TOPICS, McapLog, read_log
from tests.emulators.faulty_disk import ended
from tests.emulators.memory_world import MemoryWorld
from tests.refusals import refuses

PLAN: dict[str, Any] = {
    "format": FORMAT,
    "digest": "d",
    "course": "walls",
    "joints": ["a"],
    "rate_hz": 100.0,
}


def command(k: int) -> dict[str, Any]:
    return {
        "time_s": 0.01 * k,
        "asked_rad": np.arange(24) + k,
        "sent_rad": np.zeros(24),
        "planned_rad": [0.0] * 24,
    }


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def test_messages_come_back_in_order_and_the_file_is_whole(path: Path) -> None:
    with McapLog(path, clock=iter(range(5, 50)).__next__) as log:
        log.write("plan", PLAN)
        log.write("command", command(1))
        log.write("decision", {"what": "stop", "why": "because"})
    recorded = read_log(path)
    assert recorded.whole
    assert [(message.topic, message.time_ns) for message in recorded.messages] == [
        ("plan", 5),
        ("command", 6),
        ("decision", 7),
    ]
    assert recorded.of("plan") == [PLAN]
    assert recorded.of("command")[0]["asked_rad"] == list(range(1, 25))


def test_the_index_of_the_file_is_one_that_other_readers_take(path: Path) -> None:
    from mcap.reader import make_reader

    with McapLog(path) as log:
        log.write("plan", PLAN)
        log.write("command", command(1))
    with open(path, "rb") as stream:
        found = [
            (schema.name, schema.encoding, channel.topic, json.loads(message.data))
            for schema, channel, message in make_reader(stream).iter_messages()
            if schema is not None
        ]
    assert [row[:3] for row in found] == [
        ("stancekit.plan", "jsonschema", "plan"),
        ("stancekit.command", "jsonschema", "command"),
    ]
    assert found[0][3] == PLAN


def test_every_topic_has_a_schema_that_names_its_keys(path: Path) -> None:
    from mcap.records import Schema
    from mcap.stream_reader import StreamReader

    with McapLog(path) as log:
        log.write("plan", PLAN)
    with open(path, "rb") as stream:
        schemas = {
            r.name: json.loads(r.data)
            for r in StreamReader(stream).records
            if isinstance(r, Schema)
        }
    assert {name: set(schema["required"]) for name, schema in schemas.items()} == {
        f"stancekit.{topic}": set(keys) for topic, keys in TOPICS.items()
    }


def test_a_log_cut_at_any_byte_reads_up_to_its_last_whole_message(path: Path) -> None:
    sizes = []
    with McapLog(path) as log:
        log.write("plan", PLAN)
        for k in range(4):
            sizes.append(path.stat().st_size)
            log.write("decision", {"what": "go", "why": str(k)})
        sizes.append(path.stat().st_size)
    content = path.read_bytes()
    for cut in range(sizes[0], sizes[-1]):
        path.write_bytes(content[:cut])
        recorded = read_log(path)
        assert not recorded.whole
        assert len(recorded.of("decision")) == sum(size <= cut for size in sizes[1:])


def test_what_was_written_before_a_kill_can_be_read(path: Path) -> None:
    code = (
        "import sys, os, time\n"
        "from stancekit.runner.log import McapLog, FORMAT\n"
        "log = McapLog(sys.argv[1])\n"
        f"log.write('plan', {PLAN!r})\n"
        "for k in range(100000):\n"
        "    log.write('decision', {'what': 'go', 'why': str(k)})\n"
        "    print(k, flush=True)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout is not None
        said = [int(writer.stdout.readline()) for _ in range(200)]
        os.kill(writer.pid, signal.SIGKILL)
    recorded = read_log(path)
    assert not recorded.whole
    found = [int(each["why"]) for each in recorded.of("decision")]
    assert found == list(range(len(found)))
    assert len(found) > said[-1]


def test_an_older_log_stays_until_the_new_one_is_ended(tmp_path: Path) -> None:
    path, beside = tmp_path / "run.mcap", tmp_path / "run.partial.mcap"
    with McapLog(path) as log:
        log.write("plan", PLAN)
    older = path.read_bytes()
    with McapLog(path) as log:
        log.write("plan", PLAN)
        log.write("decision", {"what": "go", "why": "new"})
        assert path.read_bytes() == older
        assert read_log(beside).of("decision") == [{"what": "go", "why": "new"}]
    assert os.listdir(tmp_path) == ["run.mcap"]
    assert (read_log(path).whole, len(read_log(path).messages)) == (True, 2)


def test_a_kill_before_any_call_leaves_the_older_log_or_the_new_one(
    tmp_path: Path, path: Path
) -> None:

    def write() -> int:
        with McapLog(path) as log:
            log.write("plan", PLAN)
            log.write("decision", {"what": "go", "why": "new"})
        return 0

    assert ended(write, tmp_path).code == 0
    older = path.read_bytes()
    count = len(ended(write, tmp_path).calls)
    assert count >= 5
    for call in range(1, count + 1):
        path.write_bytes(older)
        assert ended(write, tmp_path, call, "killed").code == -signal.SIGKILL
        assert path.read_bytes() == older or read_log(path).whole
        assert set(os.listdir(tmp_path)) <= {"run.mcap", "run.partial.mcap"}
        assert ended(write, tmp_path).code == 0
        assert os.listdir(tmp_path) == ["run.mcap"]


@pytest.mark.parametrize("older", [b"", b"an older log"])
def test_a_disk_that_is_full_ends_the_log_once_and_what_was_written_stays(
    tmp_path: Path, older: bytes, path: Path
) -> None:

    def write() -> int:
        log = McapLog(path)
        for k in range(50):
            try:
                log.write("decision", {"what": "go", "why": str(k)})
            except OSError as error:
                sys.stderr.write(f"{error}\n")
        log.close()
        return 0

    for call in range(1, 10):
        for file in tmp_path.iterdir():
            file.unlink()
        if older:
            path.write_bytes(older)
        done = ended(write, tmp_path, call)
        assert (done.code, done.said) == (0, f"[Errno 28] No space left on device: '{path}'\n")
        assert not older or path.read_bytes() == older
        kept = tmp_path / ("run.partial.mcap" if older else "run.mcap")
        assert kept.exists() == (call >= 4)  # two calls open it, then each message is a write


def test_two_runs_do_not_write_one_log(tmp_path: Path, path: Path) -> None:
    for _ in range(2):  # in its own place, then beside an older one
        with McapLog(path) as log:
            log.write("plan", PLAN)
            with McapLog(path) as other, refuses(path):
                other.write("plan", PLAN)
            log.write("decision", {"what": "go", "why": "on"})
        assert len(read_log(path).messages) == 2
    assert os.listdir(tmp_path) == ["run.mcap"]


def test_numbers_that_json_lacks_are_written_as_null(world: MemoryWorld, path: Path) -> None:
    state = world.connect((), np.zeros(24), np.array([np.nan, 1.0, np.inf]), np.eye(3))
    with McapLog(path) as log:
        log.write("plan", PLAN)
        log.write("measurement", vars(state))
    back = read_log(path).of("measurement")[0]
    assert back["position_m"] == [None, 1.0, None]
    np.testing.assert_array_equal(back["rotation"], np.eye(3))
    assert back["time_s"] == 0.0


@pytest.mark.parametrize("content", [b"", b"not an mcap file at all", b"\x89MCAP0\r\n"])
def test_what_is_no_log_is_refused_in_one_line(content: bytes, path: Path) -> None:
    path.write_bytes(content)
    with refuses(path):
        read_log(path)


def test_a_log_that_is_missing_or_cannot_be_written_is_bad_input(tmp_path: Path) -> None:
    with refuses("none.mcap"):
        read_log(tmp_path / "none.mcap")
    with refuses("no"):
        McapLog(tmp_path / "no" / "run.mcap")
