"""The errors that Stancekit raises on purpose; their messages carry the evidence."""

from __future__ import annotations

import json
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from importlib import import_module
from pathlib import Path
from typing import Any


@contextmanager
def interruptible(*numbers: signal.Signals) -> Iterator[Callable[[], bool]]:
    """Yield a function that says whether one of these signals came; a second one raises
    KeyboardInterrupt at once.

    Outside the main thread, which alone hears of signals, nothing comes.
    """
    came: list[int] = []

    def note(number: int, _frame: Any) -> None:
        if came:
            raise KeyboardInterrupt
        came.append(number)

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class StancekitError(Exception):
    """Root of the errors that Stancekit raises on purpose.

    Source:
        Below it: ``InvalidInput``, ``PlanningFailed`` and ``HardwareFault``.

    Example:
        >>> import stancekit
        >>> issubclass(stancekit.InvalidInput, stancekit.StancekitError)
        True
    """


class InvalidInput(StancekitError, ValueError):
    """Input that cannot be used.

    The message says where, what was expected and what came; a ``ValueError``, too.

    Source:
        Every constructor and reader.

    Example:
        >>> import stancekit
        >>> stancekit.sample("wall-3", 0)
        Traceback (most recent call last):
        stancekit.planners.errors.InvalidInput: count: expected 1 to 1000000, got 0
    """


class UnknownArgument(InvalidInput, TypeError):
    """A keyword that is not taken; a ``TypeError``, too, as Python's own, by which libraries that try
    a keyword know that there is none.
    """


class NoColumn(InvalidInput, AttributeError):
    """A column that this kind of motion lacks; an ``AttributeError``, too, by which ``hasattr`` says
    no.
    """


class NoPlace(InvalidInput):
    """The robot finds no foothold at its start or goal: the question is valid, and this is its
    answer.
    """


class PlanningFailed(StancekitError):
    """No plan was found; the message says why.

    Arguments:
        args: the message, or a function that words it, for whoever asks.
    """

    def __str__(self) -> str:
        return str(self.args[0]()) if any(map(callable, self.args[:1])) else super().__str__()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self)!r})"

    def __reduce__(self) -> tuple[type[PlanningFailed], tuple[str]]:
        return type(self), (str(self),)


class HardwareFault(StancekitError):
    """A device did not do what it was asked, or fell silent; the message says which part and what
    was seen.
    """


class TimeEnded(PlanningFailed):
    """Work that was given a deadline did not end by then; whoever gave it goes on with what there
    is.
    """


_ENDS: ContextVar[float] = ContextVar("when the time ends", default=math.inf)
"""Deadline of the work that goes on (``time.perf_counter()``)."""


@contextmanager
def until(deadline: float) -> Iterator[None]:
    """What checks the time meanwhile ends by this deadline (``time.perf_counter()``)."""
    token = _ENDS.set(deadline)
    try:
        yield
    finally:
        _ENDS.reset(token)


def not_installed(where: str, package: str | None, use: str, extra: str) -> InvalidInput:
    """The refusal of what needs a package that is not installed, with the command that installs it.

    Arguments:
        where: the option, the file, or the part of Stancekit that needs it.
        package: the package.
        use: what it is needed for.
        extra: the extra of Stancekit that installs it.
    """
    return InvalidInput(
        f"{where}: expected {package} for {use}, it is not installed: {install_command(extra)}"
    )


def installed(module: str, where: str, package: str, use: str, extra: str) -> Any:
    """A module of a package that may not be installed.

    Raises InvalidInput where it is not, with arguments as of ``not_installed``.
    """
    try:
        return import_module(module)
    except ImportError:
        raise not_installed(where, package, use, extra) from None


def install_command(extra: str) -> str:
    """The command that installs an extra where it is typed, quoted for every shell: from the
    checkout that an editable installation follows, or by the package's name.
    """
    folder = _checkout()
    if folder is None:
        return f'pip install "stancekit[{extra}]"'
    return f'pip install -e "{"." if folder == Path.cwd() else folder}[{extra}]"'


def package_command(package: str) -> str:
    """The command that installs a package that no extra of Stancekit brings."""
    return f"pip install {package}"


def _checkout() -> Path | None:
    """The folder that an editable installation follows (PEP 610); None for any other one."""
    from importlib.metadata import PackageNotFoundError, distribution  # slow to import
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    try:
        origin = json.loads(distribution("stancekit").read_text("direct_url.json") or "{}")
    except PackageNotFoundError:
        return None
    editable = origin.get("dir_info", {}).get("editable", False)
    return Path(url2pathname(urlsplit(origin["url"]).path)) if editable else None


def require(holds: object, otherwise: str) -> None:
    """Raise InvalidInput with these words where something does not hold."""
    if not holds:
        raise InvalidInput(otherwise)


@contextmanager
def located(where: str) -> Iterator[None]:
    """What is refused within says where: this stands before it unless it begins with it, or with the
    file that it begins with, already.
    """
    try:
        yield
    except InvalidInput as error:
        told, file = str(error), where.partition(": ")[0]
        raise (error if told.startswith(file) else InvalidInput(f"{where}: {told}")) from None


def check_time(deadline: float | None = None, *, doing: str = "") -> None:
    """Raise TimeEnded after a deadline (``time.perf_counter()``), by default that of ``until``.

    Arguments:
        doing: what the time ended in, "while a way was looked for".
    """
    if time.perf_counter() > (_ENDS.get() if deadline is None else deadline):
        raise TimeEnded(f"the time limit ended {doing}".rstrip())
