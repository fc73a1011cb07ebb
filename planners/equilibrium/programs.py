"""Programs of the layouts met last, so that rows are written once a layout; shared by planners and
environments.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast

T = TypeVar("T")
MOST = 64
"""Programs that are kept; a long course over many candidates takes some megabytes."""


class Programs:
    """Keeps the programs that were used last.

    What they answer does not depend on whether they were kept.

    One thread at a time may use them: a program holds the numbers of the problem that it solves. A
    copy (deepcopy, pickle) has none yet and writes its own.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._kept: OrderedDict[Hashable, object] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return {"_most": self._most, "_kept": OrderedDict()}

    def get(self, make: Callable[..., T], *key: Hashable) -> T:
        """``make(*key)``, or what it made last time."""
        name = (make, *key)
        made = self._kept.get(name)
        if made is not None:
            self._kept.move_to_end(name)
        else:
            made = self._kept[name] = make(*key)
            if len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return cast(T, made)


class _Thread(threading.local):
    """Storage of one thread."""

    def __init__(self) -> None:
        self.programs = Programs()


_THREAD = _Thread()


def programs_of_this_thread() -> Programs:
    """The programs of the thread that asks: for tasks in a worker process, which come one by one
    and are alike.
    """
    return _THREAD.programs
