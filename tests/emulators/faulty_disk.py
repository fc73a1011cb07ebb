"""A disk that is full from some call on, or a process that is killed between two calls; for
whatever Python writes.

``ended`` runs a piece of work in a forked process. Every call below a folder that changes it is
counted: opening for writing, every write to a file, fsync, renaming, removing, making a folder. At
the one asked for, and from then on, the disk is full: half of what was to be written is, the rest
and everything that is new is refused; or the process is gone.
"""

from __future__ import annotations

import builtins
import errno
import io
import mmap
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

CHANGES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
ROOM = ("open", "write", "fsync", "rename", "mkdir")
"""Calls that need room on the disk."""

Fault = Literal["full", "killed"]


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a piece of work ended. code: of exit, or minus the signal. said, out: on standard error
    and output.

    calls: what it did below the folder, one "what NAME" a call, the one that failed last where it
    was killed.
    """

    code: int
    said: str
    out: str
    calls: tuple[str, ...]


def ended(work: Callable[[], int], folder: Path, at: int = 0, fault: Fault = "full") -> Ended:
    """Do some work in a process of its own, and let this call, from 1, fail; 0: none of them."""
    with (
        tempfile.TemporaryFile() as calls,
        tempfile.TemporaryFile() as said,
        tempfile.TemporaryFile() as out,
    ):
        sys.stdout.flush()
        sys.stderr.flush()
        process = os.fork()
        if not process:
            code = 70
            try:
                os.dup2(out.fileno(), 1)
                os.dup2(said.fileno(), 2)
                sys.stdout, sys.stderr = (
                    io.TextIOWrapper(io.FileIO(k, "w", closefd=False)) for k in (1, 2)
                )
                _Disk(folder.resolve(), calls.fileno(), at, fault).install()
                code = _code(work)
                sys.stdout.flush()
            except OSError:
                code = 71
            finally:
                sys.stderr.flush()
                os._exit(code)
        _, status = os.waitpid(process, 0)
        texts = [_content(stream) for stream in (said, out, calls)]
        return Ended(
            code=os.waitstatus_to_exitcode(status),
            said=texts[0],
            out=texts[1],
            calls=tuple(texts[2].splitlines()),
        )


def _code(work: Callable[[], int]) -> int:
    try:
        return work()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1


def _content(stream: IO[bytes]) -> str:
    stream.seek(0)
    return stream.read().decode(errors="replace")


class _Disk:
    """What the calls of this process meet; for good, so only for a process that ends."""

    def __init__(self, folder: Path, calls: int, at: int, fault: Fault) -> None:
        self._folder, self._calls, self._at, self._fault = f"{folder}{os.sep}", calls, at, fault
        self._count = memoryview(mmap.mmap(-1, 8)).cast(
            "q"
        )  # of this process and those that it forks

    def install(self) -> None:
        """From now on."""
        sys.addaudithook(self._heard)
        real_open, real_fsync = io.open, os.fsync

        def opened(file: Any, mode: str = "r", *rest: Any, **more: Any) -> Any:
            path = self._path(file)
            if path is None or not set(mode) & set("wax+"):
                return real_open(file, mode, *rest, **more)
            raw = _Counted(file, mode.replace("b", "").replace("t", ""))
            raw.disk, raw.path = self, path
            stream = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
            return stream if "b" in mode else io.TextIOWrapper(stream, encoding="utf-8")

        def fsync(descriptor: int) -> None:
            self.call("fsync", self._path(descriptor))
            real_fsync(descriptor)

        io.open = builtins.open = opened
        os.fsync = fsync

    def call(self, what: str, path: str | None) -> bool:
        """Count a call; whether it is to fail. It may be the last of this process."""
        if path is None:
            return False
        self._count[0] += 1
        os.write(self._calls, f"{what} {path.removeprefix(self._folder)!r}\n".encode())
        struck = 0 < self._at <= self._count[0]
        if struck and self._fault == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if struck and what in ROOM and what != "write":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)
        return struck

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(arguments[2], int) and arguments[2] & CHANGES:
            path = self._path(arguments[0])
            makes = path is not None and arguments[2] & os.O_CREAT and not os.path.exists(path)
            self.call("open" if makes else "reopen", path)
        elif event in ("os.rename", "os.remove", "os.mkdir", "os.rmdir"):
            self.call(event.removeprefix("os."), self._path(arguments[0]))

    def _path(self, file: Any) -> str | None:
        """The path of a file or descriptor, if it is below the folder, or the folder."""
        try:
            named = (
                os.readlink(f"/proc/self/fd/{file}") if isinstance(file, int) else os.fsdecode(file)
            )
        except (OSError, TypeError):
            return None
        path = os.path.abspath(named)
        return path if f"{path}{os.sep}".startswith(self._folder) else None


class _Counted(io.FileIO):
    """A file whose writes are counted."""

    disk: _Disk
    path: str

    def write(self, data: Any) -> int:
        """All of it, or half where the disk is full; then none."""
        if self.disk.call("write", self.path):
            content = memoryview(data).cast("B")
            super().write(content[: len(content) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), self.path)
        return super().write(data)
