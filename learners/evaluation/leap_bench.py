"""Methods that choose a leap's contacts on scenes of a class: whether each finds a leap, within how
many solves, and its time.

Every method on every scene is a line of a file, written when it is measured: a run that is stopped
goes on with the next one, and more scenes or methods are measured beside those that there are.
Scenes without a solution are failures.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_choice, checked_int
from stancekit.planners.files.writing import make_folder
from stancekit.planners.leap.finder import LeapFinder, LeapSearch
from stancekit.planners.leap.scp import Rule, plan_of
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap

from ..leaps.kinds import SCORER
from ..zoo import shipped

MANY = 1_000_000
FINDERS = {
    "random": LeapFinder(order="random", solves=MANY),
    "noise": LeapFinder(order="noise", solves=MANY),
    "rule-tuned": LeapFinder(order="rule", solves=MANY),
    "farkas": LeapFinder(order="farkas", solves=MANY),
    "finder": LeapFinder(order="finder", solves=MANY),
}
AGAIN = {"noise": ("noise-again", LeapFinder(order="noise", solves=MANY, seed=1))}
"""Methods that draw, by another name with another seed."""
TUNED = {
    "finder-tuned": LeapFinder(
        rule=Rule(grip=3.0, grip_cap=0.3, room=14.0, room_cap=-0.09), solves=MANY
    )
}
"""The finder with the rule's constants chosen on the 900 scenes from which learned scores are
learned, too."""
UNLEARNED = (*FINDERS, *TUNED, *(name for name, _ in AGAIN.values()))
"""Names of all methods but learned scores."""
ROWS = "rows.jsonl"


@dataclass(frozen=True, kw_only=True)
class LeapBenchSettings:
    """Settings of the measurement.

    Arguments:
        distribution: a class of ``configs/leaps.yaml``.
        scenes: how many, from number 0 on.
        seed: of all of them.
        methods: of ``UNLEARNED``, and files of learned scores, or names of such that ship.
        solves: convex problems at most per method and scene, which does not depend on how busy the
            computer is.
    """

    distribution: str = "leap-hard"
    scenes: int = 1000
    seed: int = 4400
    methods: tuple[str, ...] = tuple(FINDERS)
    solves: int = 50

    def __post_init__(self) -> None:
        leap_class(self.distribution)
        checked_int(self.scenes, "scenes", least=1)
        checked_int(self.seed, "seed", least=0)
        checked_int(self.solves, "solves", least=1)
        for method in self.methods:
            if not is_scorer(method):
                checked_choice(method, "method", UNLEARNED)
        if len({_name_of(method) for method in self.methods}) < len(self.methods):
            raise InvalidInput(
                f"methods: expected different names, got {', '.join(map(_name_of, self.methods))}"
            )

    def scene(self, index: int) -> Leap:
        """The scene of a number, which has a generator of its own."""
        rng = np.random.default_rng([self.seed, index])
        return leap_class(self.distribution).draw(rng, f"{self.distribution}-{self.seed}-{index}")

    @property
    def shared(self) -> dict[str, Any]:
        """Settings that all rows share: those measured with other values are not gone on with."""
        return {name: getattr(self, name) for name in ("distribution", "seed", "solves")}


def run(
    settings: LeapBenchSettings,
    folder: Path,
    on_progress: Callable[[str, int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Measure what the folder does not have; return the row of every method on every scene.

    Raises InvalidInput where the folder holds rows of other settings, or lines that are none.
    """
    programs = Programs()
    with kept_rows(folder / ROWS, settings.shared) as (rows, add):
        finders = {_name_of(method): _finder(method, settings.seed) for method in settings.methods}
        for index in range(settings.scenes):
            if on_progress is not None:
                on_progress(f"{settings.distribution} {index}", index, settings.scenes)
            missing = [method for method in finders if (index, method) not in rows]
            leap = settings.scene(index) if missing else None
            for method in missing:
                assert leap is not None
                found = by_finder(leap, finders[method], settings.solves, programs)
                add({"scene": index, "method": method, **found})
    if on_progress is not None:
        on_progress("done", settings.scenes, settings.scenes)
    return [
        row
        for (index, method), row in sorted(rows.items())
        if index < settings.scenes and method in finders
    ]


_Rows = dict[tuple[int, str], dict[str, Any]]


@contextmanager
def kept_rows(
    path: Path, head: Mapping[str, Any]
) -> Iterator[tuple[_Rows, Callable[[dict[str, Any]], None]]]:
    """The rows of methods on scenes that a file has, and a function that adds one to both: a run
    that is stopped goes on.

    Arguments:
        head: what all rows share; a file with another one is refused.

    Raises InvalidInput, also where no folder can be made for the file.
    """
    make_folder(path.parent)
    rows = _kept(path, head)
    with path.open("a", encoding="utf-8") as file:
        if not path.stat().st_size:
            file.write(json.dumps(head) + "\n")

        def add(row: dict[str, Any]) -> None:
            rows[row["scene"], row["method"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()

        yield rows, add


def _kept(path: Path, head: Mapping[str, Any]) -> _Rows:
    """The rows that a file has.

    A last line that a stopped run left unfinished is taken off.
    """
    if not path.exists():
        return {}
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        path.write_text(whole, encoding="utf-8")
    rows: _Rows = {}
    for number, line in enumerate(whole.splitlines()):
        try:
            row = json.loads(line)
            if number:
                rows[int(row["scene"]), str(row["method"])] = row
        except (ValueError, TypeError, KeyError):
            raise InvalidInput(
                f"{path}: line {number + 1}: expected a row of bench room, of a method on a scene, "
                f"got {line[:60]!r}"
            ) from None
        if number == 0 and row != head:
            raise InvalidInput(f"{path}: expected rows of {head}, got those of {str(row)[:80]}")
    return rows


def by_finder(leap: Leap, method: LeapFinder, solves: int, programs: Programs) -> dict[str, Any]:
    """Search until a plan that the verifier accepts, or so many solves are spent."""
    begin = time.process_time()
    search, refused = LeapSearch(leap, method, programs), 0
    solved = False
    for attempt in search.attempts():
        if attempt.solved:
            solved = check_leap(plan_of(search.last.numbers, attempt, method.order)).accepted
            refused += not solved
        if solved or search.solves >= solves:
            break
    seconds = time.process_time() - begin
    return {
        "found": solved and search.solves <= solves,
        "tries": search.tries,
        "solves": search.solves,
        "cpu_s": seconds,
        "refused": refused,
    }


def _name_of(method: str) -> str:
    """The name of a method in rows and tables: its own, or that of its file."""
    return Path(method).stem if method.endswith(SCORER) else method


def is_scorer(method: str) -> bool:
    """Tell whether it is a file of learned scores, or the name of one that ships."""
    return method.endswith(SCORER) or method in shipped("scorers")


def _finder(method: str, seed: int) -> LeapFinder:
    if is_scorer(method):
        from ..leaps.policy import LeapScorer  # torch takes a while to load

        scorer = LeapScorer.read(method)
        if scorer.origin.get("seed") == seed:
            raise InvalidInput(
                f"seed: expected another one than that of the scenes which {method} learned from, "
                f"{seed}"
            )
        return LeapFinder(order="finder", rule=scorer, solves=MANY)
    return {**FINDERS, **TUNED, **dict(AGAIN.values())}[method]


def share(count: int, of: int) -> tuple[float, float, float] | None:
    """A share and the ends of its 95 % interval (Wilson); None of nothing."""
    if not of:
        return None
    z, p = 1.96, count / of
    middle = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z / (1 + z * z / of) * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    return p, max(middle - half, 0.0), min(middle + half, 1.0)
