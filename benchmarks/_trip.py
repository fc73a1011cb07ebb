"""One trip through the package, counted: `python benchmarks/_trip.py plan walls`, or `step`.

The package is that of the process, whatever its checkout. Nothing of it but the command is imported
before the trip begins.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import CodeType, FrameType
from typing import Any

UNNAMED = ("<module>", "<genexpr>", "<listcomp>", "<dictcomp>", "<setcomp>", "<lambda>")
"""Code that is no function of its own: an import, or a part of the function around it."""


class Trip:
    """The files and functions of a package that are called, and the objects of its dataclasses that
    are made, while it is counted.

    Arguments:
        package: name of the package.
        folder: where the interpreter finds its files.
    """

    def __init__(self, package: str, folder: str) -> None:
        self.package, self.folder = package, folder + os.sep
        self.called = Counter[CodeType]()
        self.made = Counter[type]()

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Count what is called meanwhile, in threads that are begun, too."""
        threading.setprofile(self._count)
        sys.setprofile(self._count)
        try:
            yield
        finally:
            sys.setprofile(None)
            threading.setprofile(None)

    def _count(self, frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call":
            return
        if code.co_name == "__init__" and code.co_filename == "<string>":  # as dataclasses write it
            self.made[type(frame.f_locals["self"])] += 1
        elif code.co_filename.startswith(self.folder) and code.co_name not in UNNAMED:
            self.called[code] += 1

    def figures(self) -> dict[str, int]:
        """How many files, functions, types and objects."""
        own = [kind for kind in self.made if kind.__module__.split(".")[0] == self.package]
        return {
            "files": len({code.co_filename for code in self.called}),
            "functions": len({(code.co_filename, code.co_qualname) for code in self.called}),
            "types": len({(kind.__module__, kind.__qualname__) for kind in own}),
            "objects": sum(self.made[kind] for kind in own),
        }


def step() -> None:
    """One step of an environment that chooses envelopes."""
    import gymnasium

    environment = gymnasium.make("stancekit.envs:stancekit/EnvelopeSelection-v0")
    environment.reset(seed=0)
    environment.action_space.seed(0)
    environment.step(environment.action_space.sample())


def main() -> int:
    """Make the trip, and print its figures on the last line of the standard error."""
    import stancekit
    from stancekit.cli.main import main as command

    trip = Trip("stancekit", os.path.dirname(stancekit.__file__))
    work: Callable[[], None] = step if sys.argv[1:] == ["step"] else command
    code: Any = 0
    with trip.counted():
        try:
            work()
        except SystemExit as end:
            code = end.code
    print(json.dumps(trip.figures()), file=sys.stderr)
    return int(code or 0)


if __name__ == "__main__":
    sys.exit(main())
