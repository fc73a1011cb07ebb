"""Planners of leaps side by side on scenes of a class: how many each finds within 12 and 25 convex
problems, and in what time.

    python benchmarks/leaps.py [--distribution leap-hard] [--scenes 1000] [--seed 4400]
        [--method NAME ...] [--solves 50] [--ipopt-s 4] [--proof 200] [--out out/bench-leaps] [--json]

Methods: those of ``stancekit bench room`` (random; noise, the rule with noise, and single changes;
rule-tuned, the hand rule with constants chosen on training scenes; farkas, with cuts that prove;
finder, with cuts that guide, too; files of learned scores); rule, as it was first written; ipopt, a
nonlinear program on the tuned rule's choices. Of scenes that nobody solves a proof is sought. All
scenes count: those that nobody solves are failures. Rows are kept in the folder of --out: a run that
is stopped goes on where it was, and more scenes or methods are measured beside them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Lines, Options, launch
from _leap_nlp import LeapNlp

from stancekit.learners.evaluation.room import (
    FINDERS,
    MANY,
    UNLEARNED,
    LeapBenchSettings,
    by_finder,
    run,
    share,
)
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.finder import LeapFinder, LeapSearch, find_leap
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import Rule, plan_from
from stancekit.planners.problem.leap import Leap
from stancekit.planners.verify.leaps import check_leap

FIRST_RULE = Rule(grip=3.0, grip_cap=0.3, room=20.0, room_cap=0.03)
"""The hand rule as it was first written, before its constants were chosen on training scenes."""
METHODS = ("random", "noise", "rule", "rule-tuned", "farkas", "finder", "ipopt")
"""Methods in the order of the table."""
FURTHER = ("rule", "ipopt")
"""Those that the bench of leaps does not have."""
PROOF = "proof"
"""In place of a method's name: the search for a proof on a scene that no method solved."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which scenes, by which methods, and how long."""

    distribution: str = "leap-hard"
    scenes: int = 1000
    """Scenes, from number 0 on."""
    seed: int = 4400
    method: tuple[str, ...] = METHODS
    solves: int = 50
    """Convex problems at most per method and scene."""
    ipopt_s: float = 4.0
    """CPU time at most of IPOPT per scene [s]."""
    proof: int = 200
    """Convex problems at most in search of a proof; 0 for none."""
    out: Path = Path("out/bench-leaps")


def main(arguments: Arguments) -> None:
    """Measure what is missing, and print a row per method, and one of proofs."""
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = measured(arguments)
    for line in table(rows, arguments.distribution):
        arguments.say(line, _line)
    arguments.say({"distribution": arguments.distribution, **proofs(rows)}, _proved)


def measured(arguments: Arguments) -> list[dict[str, Any]]:
    """The row of every method on every scene, proofs among them."""
    settings = LeapBenchSettings(
        distribution=arguments.distribution,
        scenes=arguments.scenes,
        seed=arguments.seed,
        methods=tuple(name for name in arguments.method if name not in FURTHER),
        solves=arguments.solves,
    )
    rows = run(settings, arguments.out)
    budget = f"{arguments.solves}-{arguments.ipopt_s:g}-{arguments.proof}"
    name = f"further-{arguments.distribution}-{arguments.seed}-{budget}.jsonl"
    kept, programs, nlps = Lines(arguments.out / name), Programs(), dict[Any, LeapNlp]()

    def row(index: int, method: str) -> dict[str, Any]:
        key = f"{index} {method}"
        if key in kept.rows:
            return kept.rows[key]
        leap = settings.scene(index)
        if method == "ipopt":
            found = by_ipopt(leap, arguments.ipopt_s, programs, nlps)
        elif method == "rule":
            finder = LeapFinder(order="rule", rule=FIRST_RULE, solves=MANY)
            found = by_finder(leap, finder, arguments.solves, programs)
        else:
            found = proof(leap, arguments.proof, programs)
        return kept.add(key, {"scene": index, "method": method, **found})

    further = [name for name in FURTHER if name in arguments.method]
    rows += [row(index, method) for index in range(arguments.scenes) for method in further]
    solved = {each["scene"] for each in rows if each["found"]}
    unsolved = [index for index in range(arguments.scenes) if index not in solved]
    return rows + [row(index, PROOF) for index in unsolved if arguments.proof]


def by_ipopt(
    leap: Leap, limit_s: float, programs: Programs, nlps: dict[Any, LeapNlp]
) -> dict[str, Any]:
    """IPOPT on the tuned rule's choices, one after the other, on every timing in turn."""
    numbers = [LeapNumbers.of(leap, timing) for timing in range(len(leap.timings_s))]
    compiled = [_nlp(leap, timing, nlps) for timing in range(len(numbers))]  # which no row counts
    begin, tries, refused, solved = time.process_time(), 0, 0, False
    search = LeapSearch(leap, FINDERS["rule-tuned"], programs)
    for timing, choice in search.choices():
        nlp, numbers_of_timing = compiled[timing], numbers[timing]
        point = nlp.solve(leap, choice, nlp.nominal(leap, choice, numbers_of_timing))
        tries += 1
        if point.solved:
            plan = plan_from(numbers_of_timing, choice, point.toes_m, point.forces_n, "ipopt")
            solved = check_leap(plan).accepted
            refused += not solved
        if solved or time.process_time() - begin > limit_s:
            break
    seconds = time.process_time() - begin
    return {
        "found": solved,
        "tries": tries,
        "solves": tries,
        "cpu_s": seconds,
        "refused": refused,
    }


def _nlp(leap: Leap, timing: int, nlps: dict[Any, LeapNlp]) -> LeapNlp:
    corners = max(
        len(patch.vertices_m) for foothold in leap.footholds for patch in foothold.candidates
    )
    key = (leap.timings_s[timing], corners, leap.holds.tobytes())
    if key not in nlps:
        nlps[key] = LeapNlp(leap, timing, corners=corners, reserve=True)
    return nlps[key]


def proof(leap: Leap, solves: int, programs: Programs) -> dict[str, Any]:
    """Search for a proof that there is no leap."""
    begin = time.process_time()
    answer = find_leap(leap, LeapFinder(solves=1, proof=solves), programs=programs)
    leaves = 0 if answer.certificate is None else len(answer.certificate.multipliers)
    return {
        "found": False,
        "proved": answer.status is Status.INFEASIBLE,
        "leaves": leaves,
        "solves": answer.effort.solves,
        "cpu_s": time.process_time() - begin,
    }


def table(rows: Sequence[Mapping[str, Any]], distribution: str) -> list[dict[str, Any]]:
    """A line per method: shares of all of its scenes, and the median CPU time of those that anybody
    solves.

    Shares are triples, with the ends of their 95 % intervals (Wilson). cpu_s: of the scenes that
    anybody solves, those that the method does not solve taken as infinite; null where that is the
    median. share_of_union: of the same scenes, those that the method solves within 25 solves.
    """
    solved = {row["scene"] for row in rows if row["found"]}
    lines = []
    known = tuple(dict.fromkeys((*METHODS, *UNLEARNED)))
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


def _line(line: Mapping[str, Any]) -> str:
    names = ("first_try", "within_12_solves", "within_25_solves", "solved", "share_of_union")
    cpu_s = "–" if line["cpu_s"] is None else f"{line['cpu_s']:.3f}"
    return f"{line['method']:14} {'  '.join(_percent(line[name]) for name in names)}  {cpu_s} CPU s"


def _proved(line: Mapping[str, Any]) -> str:
    return f"of {line['unsolved']} scenes that nobody solves {line['proved']} are proved infeasible"


def _percent(value: tuple[float, float, float] | None) -> str:
    return "–" if value is None else "{:.0f} [{:.0f}, {:.0f}]".format(*(100.0 * p for p in value))


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
