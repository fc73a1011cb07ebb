"""A refusal by its kind: the class of the error, and the names that its one line must hold.

A name is a parameter, a key, a limb, a joint, a topic, a file, or a number that the test is about.
No other word of a message is asked for: ``messages.txt`` shows some as users read them, and every
``InvalidInput`` that the suite meets has to say where, what was expected and what came.
"""

from __future__ import annotations

import cProfile
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

from stancekit.planners.errors import InvalidInput, StancekitError, UnknownArgument

PLACE = re.compile(r"\S.*?: \S|expected |the Ray cluster at |e-stop ")
"""A line begins with the file, the option, the key or the part that it is about; where it begins
with ``expected``, the reader of a value in hand leaves that to its caller.
"""
EXPECTED_AND_CAME = re.compile(
    r"\bexpected .+(, |; |: | is )\S|\d.*, expected \S|\bexpected (none|no)\b"
)
"""What was expected and what came, in either order; where nothing was, the place is what came."""
OTHERWISE = re.compile(
    r"unknown (key|joint)|no such |is not installed|digest"  # what came is named; no other thing was expected
    r"|cannot be |for another|no legs are known|limbs alone"  # a thing without what is asked of it
    r"|^(port|servo|e-stop) |/joint_states|its stamps"  # a device: what it did is what came
    r"|measured .* after|times the |from where it should be|beyond its limit"  # a figure beside its limit
    r"|do not belong|does not point|its entries are|plans do not|rests at|would go|at most$"  # what is wrong
    r"|^the Ray cluster at |(method|planner) \S+: \w+: "  # a cluster; an error of somebody's own code
    r"|line \d+, column \d+|encoding|expected another"  # XML that is broken, in its parser's words
    r"|should (have|match)|unknown array|are missing|already|has lost|does not answer|is closed|pressed on|was \w+$"
)
"""Other ways to say it, in one place."""


@contextmanager
def heard(into: dict[str, bool]) -> Iterator[None]:
    """Keep the message of every error of the house that is made meanwhile, and whether it is an
    ``InvalidInput`` in the package's own words that a caller may meet: pydantic writes those of
    its validators anew, with their place.
    """

    def init(self: StancekitError, *arguments: object) -> None:
        Exception.__init__(self, *arguments)
        maker, line = sys._getframe(1), "" if any(map(callable, arguments)) else str(self)
        ours = isinstance(self, InvalidInput) and _module(maker).startswith("stancekit.")
        into[line] = ours and into.get(line, True) and not _is_within_pydantic(maker)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StancekitError, "__init__", init)
        yield


def assert_refusals_say(heard: dict[str, bool]) -> None:
    """Assert that every ``InvalidInput`` says where, what was expected and what came; one that is
    a part of another message says it there.
    """
    met = dict(heard)  # threads that end late still add to the other
    odd = [
        line
        for line, refusal in met.items()
        if refusal and not _says(line) and not any(line in other != line for other in met)
    ]
    assert not odd, f"expected one line, PLACE: expected ..., got ...; came {odd}"


def _module(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", ""))


def _is_within_pydantic(frame: FrameType | None) -> bool:
    while frame is not None and not _module(frame).startswith("pydantic"):
        frame = frame.f_back
    return frame is not None


def _says(line: str) -> bool:
    told = EXPECTED_AND_CAME.search(line) or OTHERWISE.search(line)
    return bool("\n" not in line and PLACE.match(line) and told)


@contextmanager
def refuses(
    *names: str | Path, kind: type[BaseException] = InvalidInput
) -> Iterator[pytest.ExceptionInfo[BaseException]]:
    """The block raises an error of exactly this class, in one line that holds every name.

    Arguments:
        names: what the message must name.
        kind: class of the error; a subclass is another kind, but for a keyword that is not taken.
    """
    __tracebackhide__ = True
    with pytest.raises(kind) as caught:
        yield caught
    assert caught.type in (kind, UnknownArgument), f"expected {kind.__name__}, got {caught.value!r}"
    assert_names(str(caught.value), *names)


@contextmanager
def at_once(calls: int) -> Iterator[None]:
    """The block makes no more calls of functions than this, whatever the computer does beside it."""
    with cProfile.Profile() as profile:
        yield
    made = sum(entry.callcount for entry in profile.getstats())
    assert made <= calls, f"expected {calls} calls or fewer, got {made}"


def assert_names(message: str, *names: str | Path) -> None:
    """Assert that a message is one line and holds every name whole: ``LF`` is not in ``LF_hip``."""
    __tracebackhide__ = True
    assert len(message.splitlines()) == 1, f"expected one line, got {message!r}"
    missing = [str(name) for name in names if not _whole(str(name)).search(message)]
    assert not missing, f"expected {', '.join(missing)} in {message!r}"


def _whole(name: str) -> re.Pattern[str]:
    before, after = (r"\b" if re.match(r"\w", edge) else "" for edge in (name[0], name[-1]))
    return re.compile(before + re.escape(name) + after)
