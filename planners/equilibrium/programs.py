"""Programs of the layouts met last, so that rows are written once a layout; shared by planners and
environments.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from types import MappingProxyType
from typing import Any, Literal, Protocol, TypeVar, cast, get_args, runtime_checkable

from ..files.arrays import checked_choice
from .moreau_solver import Device, MoreauSolver, check_device
from .rows import Rows

T = TypeVar("T")
Engine = Literal["rows", "moreau", "moreau-cpu"]
ENGINES: tuple[Engine, ...] = get_args(Engine)
DEVICES: Mapping[Engine, Device] = MappingProxyType({"moreau": "cuda", "moreau-cpu": "cpu"})
MOST = 64
"""Programs that are kept; a long course over many candidates takes some megabytes."""


@runtime_checkable
class Written(Protocol):
    """A convex program that is written as rows."""

    rows: Rows[Any]


class Programs:
    """Keeps the programs that were used last.

    What they answer does not depend on whether they were kept.

    One thread at a time may use them: a program holds the numbers of the problem that it solves. A
    copy (deepcopy, pickle) has none yet and writes its own.

    Arguments:
        engine: "rows" solves programs one by one; "moreau" too, and where many problems are asked
            about together, those on a CUDA device ("moreau-cpu": on the processor).

    Raises:
        InvalidInput: where that is not there.
    """

    def __init__(self, most: int = MOST, *, engine: Engine = "rows") -> None:
        checked_choice(engine, "engine", ENGINES)
        if engine in DEVICES:
            check_device(DEVICES[engine])
        self._most, self.engine = most, engine
        self._kept: OrderedDict[Hashable, object] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return {"_most": self._most, "engine": self.engine, "_kept": OrderedDict()}

    def get(self, make: Callable[..., T], *key: Hashable) -> T:
        """``make(*key)``, or what it made last time."""
        name = (make, *key)
        made = self._kept.get(name)
        if made is not None:
            self._kept.move_to_end(name)
        else:
            made = self._kept[name] = make(*key)
            if self.engine in DEVICES and isinstance(made, Written):
                made.rows.solve_together(MoreauSolver(made.rows, DEVICES[self.engine]).solve_all)
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
