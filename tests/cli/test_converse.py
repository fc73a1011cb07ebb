"""What an emulated device says on a terminal, to people, and in a pipe, to programs."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys

from stancekit.cli.converse import short

PROGRAM = """
from stancekit.cli.converse import converse

def inject(kind):
    raise ValueError(f"expected a fault, got {kind}")

converse({"port": 1}, inject, lambda: {"now_s": 1.23456789, "log_s": [0.5] * 1000})
"""


def test_people_read_short_numbers_and_how_long_a_list_is() -> None:
    state = {
        "now_s": 27155.542875992,
        "on": True,
        "rad": [0.12345, 1],
        "log": [["stream", 1.0]] * 33,
    }
    assert short(state) == {"now_s": 27155.543, "on": True, "rad": [0.123, 1], "log": "33 of them"}


def test_a_state_is_short_on_a_terminal_and_whole_in_a_pipe() -> None:
    command = [sys.executable, "-c", PROGRAM]
    piped = subprocess.run(
        command, input="\nwhat\n", capture_output=True, text=True, check=True
    ).stdout.splitlines()
    where, state, refused = map(json.loads, piped)
    assert where == {"port": 1}
    assert (state["now_s"], len(state["log_s"])) == (1.23456789, 1000)
    assert refused == state | {"error": "expected a fault, got what"}
    ours, theirs = pty.openpty()
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=theirs, text=True) as child:
        os.close(theirs)
        child.communicate("\nwhat\n")
    shown = [json.loads(line) for line in os.read(ours, 65536).decode().splitlines()]
    os.close(ours)
    assert shown == [
        where,
        {"now_s": 1.235, "log_s": "1000 of them"},
        {"error": "expected a fault, got what"},
    ]
