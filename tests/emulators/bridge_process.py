"""An emulated rosbridge in a process of its own, as ``stancekit emulate rosbridge`` runs it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, Literal, Self


class BridgeProcess:
    """The robot of a plan behind a rosbridge; ``port`` is where. A context manager."""

    def __init__(self, plan: Path, ros: Literal[1, 2] = 2) -> None:
        command = [sys.executable, "-m", "stancekit.cli.main", "emulate", "rosbridge", str(plan)]
        self._child = subprocess.Popen(
            [*command, "--port", "0", "--ros", str(ros)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._child.stdout is not None
        self.port = int(json.loads(self._child.stdout.readline())["port"])

    def inject(self, kind: str) -> None:
        """Let a fault happen now."""
        self._ask(kind)

    def state(self) -> dict[str, Any]:
        """As of ``RosBridge``, and its log."""
        return self._ask("")

    def close(self) -> None:
        """End the process."""
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        self._child.stdin.close()
        self._child.wait(5.0)
        self._child.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _ask(self, line: str) -> dict[str, Any]:
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        self._child.stdin.write(line + "\n")
        self._child.stdin.flush()
        answer: dict[str, Any] = json.loads(self._child.stdout.readline())
        return answer
