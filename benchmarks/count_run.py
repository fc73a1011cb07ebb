"""What one command builds and judges: courses parsed, robots parsed, pinocchio models, verdicts.

    python benchmarks/count_run.py run plan.json --world mujoco

A name that is counted and that the package has no more is an error: the table below is to be kept
up.
"""

from __future__ import annotations

import collections
import functools
import importlib
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from typing import Any

COUNTED = {
    "plans judged": ("stancekit.planners.verify.plans:check_plan",),
    "whole bodies judged": ("stancekit.planners.verify.joints:check_whole_body",),
    "joints judged": ("stancekit.planners.verify.joints:joint_report",),
    "walks judged": ("stancekit.planners.verify.trajectories:check_trajectory",),
}
"""By what is said of them: the functions whose calls are counted, wherever they were imported."""

counts: collections.Counter[str] = collections.Counter()


def counted(
    function: Callable[..., Any], name: str, when: Callable[..., bool] = lambda *a: True
) -> Any:
    """The function, whose calls are counted under a name where ``when`` says so."""

    @functools.wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        counts[name] += when(*args)
        return function(*args, **kwargs)

    return wrapper


def watch() -> None:
    """Count from now on: every module that has one of the functions by name gets one that
    counts.
    """
    originals: dict[int, Any] = {}
    for name, places in COUNTED.items():
        for place in places:
            module, _, attribute = place.partition(":")
            function = getattr(
                importlib.import_module(module), attribute
            )  # an error where it is no more
            originals[id(function)] = counted(function, name)

    for module in [
        one for key, one in sys.modules.items() if key.startswith("stancekit") and one is not None
    ]:
        for attribute, value in list(vars(module).items()):
            if id(value) in originals and callable(value):
                setattr(module, attribute, originals[id(value)])


def main() -> int:
    """Run the command whose arguments these are, and print the counts to standard error."""
    read = ElementTree.fromstring

    def is_robot(text: Any, *_: Any) -> bool:
        return "<robot" in str(text)[:4000]

    ElementTree.fromstring = counted(read, "robots parsed", is_robot)
    import pinocchio

    for name in ("buildModelFromXML", "buildModelFromUrdf"):
        setattr(pinocchio, name, counted(getattr(pinocchio, name), "pinocchio models"))
    watch()
    from stancekit.planners.problem import Problem

    Problem.from_json = staticmethod(counted(Problem.from_json, "courses parsed"))  # type: ignore[assignment]
    from stancekit.cli.main import main as command

    sys.argv = ["stancekit", *sys.argv[1:]]
    code = 0
    try:
        command()
    except SystemExit as end:
        code = int(end.code or 0)
    print(dict(counts), file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
