"""Writing files whole or not at all, and removing what killed writers left."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..errors import InvalidInput, require
from .documents import shown

FOLDER = "STANCEKIT_CACHE"


def cache_folder() -> Path:
    """Folder of measured workspaces and thinned meshes: $STANCEKIT_CACHE, or the user's folder for
    caches.
    """
    folder, users = os.environ.get(FOLDER), os.environ.get("XDG_CACHE_HOME")
    return (
        Path(folder) if folder else (Path(users) if users else Path.home() / ".cache") / "stancekit"
    )


SAME = 1e-9
"""Numbers so near to each other, absolutely or as a share, are the same: another machine rounds
otherwise."""


def first_difference(said: Any, expected: Any, where: str = "") -> str:
    """The first place where ``said`` is not ``expected``, as "key[3].name: expected this, got
    that"; empty where there is none. Numbers may differ by ``SAME``.
    """
    if isinstance(said, Mapping) and isinstance(expected, Mapping):
        for name in dict.fromkeys((*expected, *said)):
            place = f"{where}.{name}" if where else str(name)
            if name not in said:
                return f"{place}: expected this key, got nothing"
            if name not in expected:
                return f"{place}: expected nothing, got {shown(said[name])}"
            if difference := first_difference(said[name], expected[name], place):
                return difference
        return ""
    if isinstance(said, list | tuple) and isinstance(expected, list | tuple):
        if len(said) != len(expected):
            return f"{where}: expected {len(expected)}, got {len(said)}"
        each = (
            first_difference(*pair, f"{where}[{i}]")
            for i, pair in enumerate(zip(said, expected, strict=True))
        )
        return next(filter(None, each), "")
    same = (
        abs(said - expected) <= SAME * max(1.0, abs(expected))
        if _number(said) and _number(expected)
        else said == expected
    )
    return "" if same else f"{where}: expected {shown(expected)}, got {shown(said)}"


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


TEMPORARY = re.compile(r"\.(?P<name>.+)\.\d+(-[0-9a-f]{8})?\.tmp", re.DOTALL)
"""Names of what is being written: those of its target and of the process, and a number of its
own."""
_LONGEST_NAME = 255 - len("..4194304-01234567.tmp")
"""Longest name of a target, in bytes, on Linux."""
_TRIES = 100
"""Number of tries of names for what is being written: another one is needed where somebody took it
away before it was locked."""


def write_text(path: str | Path, text: str) -> None:
    """Write a file whole or not at all, as ``write_bytes``."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all, as ``replaced``; a device or a pipe is written to as it is.

    Raises InvalidInput where nothing can be written.
    """
    check_writable(path)
    if _is_special(path):
        try:
            Path(path).write_bytes(content)
        except OSError as error:
            raise _unwritable(path, error) from None
        return
    with replaced(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """A new and empty file beside a path, to be written to; when the block ends it is what the path
    leads to.

    Whatever was there stays until then, also when the process is killed, the disk is full or the
    machine stops; a link stays a link. The new file is locked while it is written, and those that no
    process has locked any more are removed: they are what killed writers of this path left.

    Raises:
        InvalidInput: where nothing can be written, also for an OSError from the block.
    """
    target = check_writable(path)
    require(not _is_special(target), f"{path}: expected a file, found a device or a pipe")
    remove_leftovers(target.parent, target.name.__eq__)
    try:
        temporary, lock = _locked(target)
        try:
            yield temporary
            os.fsync(lock)
            os.replace(temporary, target)
            _sync(target.parent)
        finally:
            with suppress(OSError):
                temporary.unlink()
            os.close(lock)
    except OSError as error:
        raise _unwritable(path, error) from None


def remove_leftovers(folder: Path, of: Callable[[str], bool]) -> None:
    """Remove what killed processes were writing beside the targets whose names ``of`` says yes to.

    What a living process writes is locked, on whichever machine that shares the folder, and stays;
    and so does what cannot be locked or removed.
    """
    with suppress(OSError):
        for name in os.listdir(folder):
            match = TEMPORARY.fullmatch(name)
            if match is not None and of(match["name"]):
                with suppress(OSError):
                    _remove_unlocked(folder / name)


def make_folder(folder: Path) -> None:
    """Make a folder for results, unless there is one.

    Raises InvalidInput where there is no room for one.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        reason = getattr(error, "strerror", error)
        raise InvalidInput(f"{folder}: expected a folder or room for one, got {reason}") from None


def check_writable(path: str | Path) -> Path:
    """Check a path for writing before the work whose result goes there.

    Raises InvalidInput if none can be.
    """
    path = Path(path)
    try:
        target = path.resolve()
        require(not path.is_dir(), f"{path}: cannot be written: {os.strerror(errno.EISDIR)}")
        require(
            path.parent.is_dir(), f"{path}: expected an existing folder {path.parent}, found none"
        )
        require(
            os.access(path if _is_special(path) else target.parent, os.W_OK),
            f"{path}: cannot be written: {os.strerror(errno.EACCES)}",
        )
        if len(os.fsencode(target.name)) > _LONGEST_NAME:
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
    except (OSError, RuntimeError, ValueError) as error:
        # RuntimeError: links that lead back to themselves; ValueError: a name that no file can have
        raise (error if isinstance(error, InvalidInput) else _unwritable(path, error)) from None
    return target


def _is_special(path: str | Path) -> bool:
    """Is something there that is neither file nor folder: a device, a pipe?"""
    path = Path(path)
    return path.exists() and not path.is_file() and not path.is_dir()


def _unwritable(path: str | Path, error: Exception) -> InvalidInput:
    """The one line on an error of the system, or of a library that wraps one."""
    number = getattr(error, "errno", None)
    reason = (
        os.strerror(number)
        if number
        else (str(error).strip() or type(error).__name__).splitlines()[0]
    )
    return InvalidInput(f"{path}: cannot be written: {reason}")


def failure_of(name: str, said: str) -> OSError:
    """Reason why another program, or a library in a process of its own, failed to write, by its
    last words.
    """
    known = (
        number
        for number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
        if os.strerror(number) in said
    )
    number = next(known, None)
    if number is not None:
        return OSError(number, os.strerror(number))
    return OSError(
        f"{name} failed: {said.strip().splitlines()[-1] if said.strip() else 'without a word'}"
    )


def _locked(target: Path) -> tuple[Path, int]:
    """A new file beside the target, and the descriptor that holds its lock."""
    for _ in range(_TRIES):
        temporary = target.with_name(f".{target.name}.{os.getpid()}-{secrets.token_hex(4)}.tmp")
        lock = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        with suppress(
            OSError
        ):  # a file system without locks: nobody will take it for a leftover either
            fcntl.flock(lock, fcntl.LOCK_EX)
        if os.fstat(lock).st_nlink:
            return temporary, lock
        os.close(lock)  # another process took it for a leftover before it was locked
    raise FileNotFoundError(
        errno.ENOENT, os.strerror(errno.ENOENT)
    )  # a folder that takes no files, as /proc


def _remove_unlocked(path: Path) -> None:
    """Remove what no process has locked.

    Raises OSError for what is locked.
    """
    lock = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        path.unlink()
    finally:
        os.close(lock)


def _sync(folder: Path) -> None:
    """Make a new name last, where the file system can: the file itself is there already."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
