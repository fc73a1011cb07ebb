"""Planners of leaps side by side on scenes of a class: the share that each finds within so many
solves, and its time.

Every method on every scene is a line of a file, written when it is measured: a run that is stopped
goes on with the next one, and more scenes or methods are measured beside those that there are.
Scenes that nobody solves are failures.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked, checked_choice, checked_int
from stancekit.planners.leap.finder import LeapFinder, LeapSearch, find_leap
from stancekit.planners.leap.nlp import LeapNlp
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.rule import Rule
from stancekit.planners.leap.scp import plan_from, plan_of
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap

from ..leaps.kinds import SCORER
from ..zoo import shipped

FIRST_RULE = Rule(grip=3.0, grip_cap=0.3, room=20.0, room_cap=0.03)
"""The hand rule as it was first written, before its constants were chosen on training scenes."""
MANY = 1_000_000
FINDERS = {
    "random": LeapFinder(order="random", solves=MANY),
    "noise": LeapFinder(order="noise", solves=MANY),
    "rule": LeapFinder(order="rule", rule=FIRST_RULE, solves=MANY),
    "rule-tuned": LeapFinder(order="rule", solves=MANY),
    "farkas": LeapFinder(order="farkas", solves=MANY),
    "finder": LeapFinder(order="finder", solves=MANY),
}
METHODS = (*FINDERS, "ipopt")
AGAIN = {"noise": ("noise-again", LeapFinder(order="noise", solves=MANY, seed=1))}
"""Methods that draw, by another name with another seed."""
TUNED = {
    "finder-tuned": LeapFinder(
        rule=Rule(grip=3.0, grip_cap=0.3, room=14.0, room_cap=-0.09), solves=MANY
    )
}
"""The finder with the rule's constants chosen on the 900 scenes from which learned scores are
learned, too."""
UNLEARNED = (*METHODS, *TUNED, *(name for name, _ in AGAIN.values()))
"""Names of all methods but learned scores."""
PROOF = "proof"
"""In place of a method's name: the search for a proof on a scene that no method solved."""
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
        ipopt_s: CPU time at most of IPOPT per scene, which takes choices in the order of the tuned
            rule [s].
        proof: convex problems at most in search of a proof where nobody found a plan, 0 for none.
    """

    distribution: str = "leap-hard"
    scenes: int = 1000
    seed: int = 4400
    methods: tuple[str, ...] = METHODS
    solves: int = 50
    ipopt_s: float = 4.0
    proof: int = 200

    def __post_init__(self) -> None:
        leap_class(self.distribution)
        checked_int(self.scenes, "scenes", least=1)
        checked_int(self.seed, "seed", least=0)
        checked_int(self.solves, "solves", least=1)
        checked_int(self.proof, "proof", least=0)
        checked(self.ipopt_s, "ipopt_s", above=0.0)
        for method in self.methods:
            if not is_scorer(method):
                checked_choice(method, "method", UNLEARNED)
        if len({name_of(method) for method in self.methods}) < len(self.methods):
            raise InvalidInput(
                f"methods: expected different names, got {', '.join(map(name_of, self.methods))}"
            )

    def scene(self, index: int) -> Leap:
        """The scene of a number, which has a generator of its own."""
        rng = np.random.default_rng([self.seed, index])
        return leap_class(self.distribution).draw(rng, f"{self.distribution}-{self.seed}-{index}")

    @property
    def shared(self) -> dict[str, Any]:
        """Settings that all rows share: those measured with other values are not gone on with."""
        return {name: getattr(self, name) for name in ("distribution", "seed", "solves", "ipopt_s")}


def run(
    settings: LeapBenchSettings,
    folder: Path,
    on_progress: Callable[[str, int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Measure what the folder does not have; return the row of every method on every scene, proofs
    among them.

    Raises InvalidInput where the folder holds rows of other settings, or lines that are none.
    """
    path = folder / ROWS
    rows = _kept(path, settings)
    bench = _Bench(settings)
    with path.open("a", encoding="utf-8") as file:
        if not path.stat().st_size:
            file.write(json.dumps(settings.shared) + "\n")
        for index in range(settings.scenes):
            if on_progress is not None:
                on_progress(f"{settings.distribution} {index}", index, settings.scenes)
            for row in bench.missing(index, rows):
                rows[index, row["method"]] = row
                file.write(json.dumps(row) + "\n")
                file.flush()
    if on_progress is not None:
        on_progress("done", settings.scenes, settings.scenes)
    wanted = {*map(name_of, settings.methods), PROOF}
    return [
        row
        for (index, method), row in sorted(rows.items())
        if index < settings.scenes and method in wanted
    ]


def _kept(path: Path, settings: LeapBenchSettings) -> dict[tuple[int, str], dict[str, Any]]:
    """The rows that a folder has.

    A last line that a stopped run left unfinished is taken off.
    """
    if not path.exists():
        return {}
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        path.write_text(whole, encoding="utf-8")
    rows: dict[tuple[int, str], dict[str, Any]] = {}
    for number, line in enumerate(whole.splitlines()):
        try:
            row = json.loads(line)
            if number:
                rows[int(row["scene"]), str(row["method"])] = row
        except (ValueError, TypeError, KeyError):
            raise InvalidInput(
                f"{path}: line {number + 1}: expected a row of bench leaps, got {line[:60]!r}"
            ) from None
        if number == 0 and row != settings.shared:
            raise InvalidInput(f"{path}: expected rows of {settings.shared}, got those of {row}")
    return rows


class _Bench:
    """Programs that are compiled once for all scenes of a class."""

    def __init__(self, settings: LeapBenchSettings) -> None:
        self._settings, self._programs = settings, Programs()
        self._finders = {
            name_of(method): _finder(method, settings.seed)
            for method in settings.methods
            if method != "ipopt"
        }
        self._nlps: dict[tuple[Any, ...], LeapNlp] = {}

    def missing(
        self, index: int, rows: Mapping[tuple[int, str], dict[str, Any]]
    ) -> Iterator[dict[str, Any]]:
        """The rows of a scene that are not there yet, its proof last."""
        names = list(map(name_of, self._settings.methods))
        todo = [name for name in names if (index, name) not in rows]
        solved = any(row["found"] for (scene, _), row in rows.items() if scene == index)
        leap = self._settings.scene(index)
        for method in todo:
            row = (
                self._by_ipopt(leap)
                if method == "ipopt"
                else self._by_finder(leap, self._finders[method])
            )
            solved = solved or row["found"]
            yield {"scene": index, "method": method, **row}
        if not solved and self._settings.proof and (index, PROOF) not in rows:
            yield {"scene": index, "method": PROOF, **self._proof(leap)}

    def _by_finder(self, leap: Leap, method: LeapFinder) -> dict[str, Any]:
        """Until a plan that the verifier accepts, or the solves are spent."""
        begin = time.process_time()
        search, refused = LeapSearch(leap, method, self._programs), 0
        solved = False
        for attempt in search.attempts():
            if attempt.solved:
                solved = check_leap(plan_of(search.last.numbers, attempt, method.order)).accepted
                refused += not solved
            if solved or search.solves >= self._settings.solves:
                break
        seconds = time.process_time() - begin
        solved = solved and search.solves <= self._settings.solves
        return {
            "found": solved,
            "tries": search.tries,
            "solves": search.solves,
            "cpu_s": seconds,
            "refused": refused,
        }

    def _by_ipopt(self, leap: Leap) -> dict[str, Any]:
        """IPOPT on the tuned rule's choices, one after the other, on every timing in turn."""
        numbers = [LeapNumbers.of(leap, timing) for timing in range(len(leap.timings_s))]
        nlps = [
            self._nlp(leap, timing) for timing in range(len(numbers))
        ]  # compiled once, which no row counts
        begin, tries, refused, solved = time.process_time(), 0, 0, False
        search = LeapSearch(leap, FINDERS["rule-tuned"], self._programs)
        for timing, choice in search.choices():
            nlp, numbers_of_timing = nlps[timing], numbers[timing]
            point = nlp.solve(leap, choice, nlp.nominal(leap, choice, numbers_of_timing))
            tries += 1
            if point.solved:
                plan = plan_from(numbers_of_timing, choice, point.toes_m, point.forces_n, "ipopt")
                solved = check_leap(plan).accepted
                refused += not solved
            if solved or time.process_time() - begin > self._settings.ipopt_s:
                break
        seconds = time.process_time() - begin
        return {
            "found": solved,
            "tries": tries,
            "solves": tries,
            "cpu_s": seconds,
            "refused": refused,
        }

    def _nlp(self, leap: Leap, timing: int) -> LeapNlp:
        corners = max(
            len(patch.vertices_m) for foothold in leap.footholds for patch in foothold.candidates
        )
        key = (leap.timings_s[timing], corners, leap.holds.tobytes())
        if key not in self._nlps:
            self._nlps[key] = LeapNlp(leap, timing, corners=corners, reserve=True)
        return self._nlps[key]

    def _proof(self, leap: Leap) -> dict[str, Any]:
        begin = time.process_time()
        answer = find_leap(
            leap, LeapFinder(solves=1, proof=self._settings.proof), programs=self._programs
        )
        leaves = 0 if answer.certificate is None else len(answer.certificate.multipliers)
        return {
            "found": False,
            "proved": answer.status is Status.INFEASIBLE,
            "leaves": leaves,
            "solves": answer.effort.solves,
            "cpu_s": time.process_time() - begin,
        }


def name_of(method: str) -> str:
    """The name of a method in rows and tables: its own, or that of its file."""
    return Path(method).stem if method.endswith(SCORER) else method


def is_scorer(method: str) -> bool:
    """Tell whether it is a file of learned scores, or the name of one that ships."""
    return method.endswith(SCORER) or method in shipped("scorers")


def _finder(method: str, seed: int) -> LeapFinder:
    if is_scorer(method):
        from ..leaps.scorer import LeapScorer  # torch takes a while to load

        scorer = LeapScorer.read(method)
        if scorer.origin.get("seed") == seed:
            raise InvalidInput(
                f"seed: expected another one than that of the scenes which {method} learned from, "
                f"{seed}"
            )
        return LeapFinder(order="finder", rule=scorer, solves=MANY)
    return {**FINDERS, **TUNED, **dict(AGAIN.values())}[method]


def table(rows: Sequence[Mapping[str, Any]], distribution: str) -> list[dict[str, Any]]:
    """A line per method: shares of all of its scenes, and the median CPU time of those that anybody
    solves.

    Shares are triples, with the ends of their 95 % intervals (Wilson). cpu_s: of the scenes that
    anybody solves, those that the method does not solve taken as infinite; null where that is the
    median. share_of_union: of the same scenes, those that the method solves within 25 solves.
    """
    solved = {row["scene"] for row in rows if row["found"]}
    lines = []
    known = UNLEARNED
    measured = {row["method"]: None for row in rows if row["method"] != PROOF}
    others = [method for method in measured if method not in known]
    for method in (*(method for method in known if method in measured), *others):
        rows_of_method = [row for row in rows if row["method"] == method]
        within = {row["scene"]: row["solves"] for row in rows_of_method if row["found"]}
        shared = [row for row in rows_of_method if row["scene"] in solved]
        cpu_s = (
            float(np.median([row["cpu_s"] if row["found"] else math.inf for row in shared]))
            if shared
            else math.inf
        )
        count, union = len(rows_of_method), len(shared)
        lines.append(
            {
                "distribution": distribution,
                "method": method,
                "learned": method in others,
                "scenes": count,
                "solved": share(len(within), count),
                "solved_by_any": share(union, count),
                "first_try": share(
                    sum(row["found"] and row["tries"] == 1 for row in rows_of_method), count
                ),
                "within_12_solves": share(sum(solves <= 12 for solves in within.values()), count),
                "within_25_solves": share(sum(solves <= 25 for solves in within.values()), count),
                "share_of_union": share(sum(solves <= 25 for solves in within.values()), union),
                "cpu_s": cpu_s if math.isfinite(cpu_s) else None,
                "tries_per_cpu_s": sum(row["tries"] for row in rows_of_method)
                / max(sum(row["cpu_s"] for row in rows_of_method), 1e-9),
                "refused": sum(row["refused"] for row in rows_of_method),
            }
        )
    return lines


def proofs(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Proofs about the scenes that no method solves: how many, how many of these are proved
    infeasible, and the share.
    """
    solved = {row["scene"] for row in rows if row["found"]}
    open_ = [row for row in rows if row["method"] == PROOF and row["scene"] not in solved]
    proved = sum(row["proved"] for row in open_)
    return {"unsolved": len(open_), "proved": proved, "share": share(proved, len(open_))}


def share(count: int, of: int) -> tuple[float, float, float] | None:
    """A share and the ends of its 95 % interval (Wilson); None of nothing."""
    if not of:
        return None
    z, p = 1.96, count / of
    middle = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z / (1 + z * z / of) * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    return p, max(middle - half, 0.0), min(middle + half, 1.0)
