"""Programs of the layouts met last, so that rows are written once a layout; shared by planners and environments."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import TypeVar, cast

T = TypeVar("T")
MOST = 64
"""Programs that are kept; a long course over many candidates takes some megabytes."""


class Programs:
    """Keeps the programs that were used last. What they answer does not depend on whether they were kept."""

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._kept: OrderedDict[Hashable, object] = OrderedDict()

    def get(self, make: Callable[..., T], *key: Hashable) -> T:
        """``make(*key)``, or what it made last time."""
        name = (make, *key)
        if name in self._kept:
            self._kept.move_to_end(name)
        else:
            self._kept[name] = make(*key)
            if len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return cast(T, self._kept[name])
