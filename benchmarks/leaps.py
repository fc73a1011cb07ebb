"""Planners of leaps on scenes of a class: shares found within solves and CPU-s, and shares proved infeasible.

    python benchmarks/leaps.py --scenes 300 --seed 4300 --out leaps.jsonl

One line per scene is appended to the file, so that a run that was cut off goes on. Every method searches until
``--cpu`` CPU-s are spent; from when it found its plan all columns follow. Scenes that nobody solves count as failures.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.finder import LeapFinder, LeapSearch, find_leap
from stancekit.planners.leap.rule import Rule
from stancekit.planners.leap.scp import plan_of
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap

OLD_RULE = Rule(grip=3.0, grip_cap=0.3, room=20.0, room_cap=0.03)
"""The rule as it was first written."""
METHODS = {
    "random": LeapFinder(order="random", solves=100_000),
    "noise": LeapFinder(order="noise", solves=100_000),
    "old rule": LeapFinder(order="rule", rule=OLD_RULE, solves=100_000),
    "rule": LeapFinder(order="rule", solves=100_000),
    "farkas": LeapFinder(order="farkas", solves=100_000),
    "finder": LeapFinder(order="finder", solves=100_000),
}
CPU_S = (0.1, 0.25, 0.5, 1.0, 2.0)
SOLVES = (6, 12, 25, 50, 100)


def searched(leap: Leap, method: LeapFinder, programs: Programs, cpu_s: float) -> dict[str, Any]:
    """When a method found a plan that the verifier accepted: tries, solves and CPU-s, or None; and what it spent."""
    begin = time.process_time()
    search, refused, found = LeapSearch(leap, method, programs), 0, None
    for attempt in search.attempts():
        if attempt.solved:
            report = check_leap(plan_of(search.last.numbers, attempt, method.order))
            if report.accepted:
                found = {"momentum_error": report.figures["momentum_error"], "choice": attempt.choice.tolist()}
                break
            refused += 1
        if time.process_time() - begin > cpu_s:
            break
    spent = time.process_time() - begin
    return {
        "found": found is not None,
        "tries": search.tries,
        "solves": search.solves,
        "cpu_s": spent,
        "refused": refused,
        **(found or {}),
    }


def scene(name: str, seed: int, index: int) -> Leap:
    """The scene of a number: each has a generator of its own."""
    return leap_class(name).draw(np.random.default_rng([seed, index]), f"{name}-{seed}-{index}")


def main() -> None:
    """Run, or go on, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--distribution", default="leap-hard")
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--seed", type=int, default=4300)
    parser.add_argument("--cpu", type=float, default=2.0)
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--out", type=Path, default=Path("leaps.jsonl"))
    options = parser.parse_args()
    names = options.methods.split(",")
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    programs = Programs()
    for index in range(len(rows), options.scenes):
        leap = scene(options.distribution, options.seed, index)
        row: dict[str, Any] = {"index": index}
        for name in names:
            row[name] = searched(leap, METHODS[name], programs, options.cpu)
        if not any(row[name]["found"] for name in names):
            begin = time.process_time()
            proof = find_leap(leap, LeapFinder(solves=1, proof=200), programs=programs)
            leaves = 0 if proof.certificate is None else len(proof.certificate.multipliers)
            row["proof"] = {
                "proved": proof.status is Status.INFEASIBLE,
                "solves": proof.effort.solves,
                "leaves": leaves,
                "cpu_s": time.process_time() - begin,
            }
        rows.append(row)
        with options.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
    table(rows, names)


def table(rows: list[dict[str, Any]], names: list[str]) -> None:
    """Print shares with 95 % intervals (Wilson)."""
    count = len(rows)
    solved = np.array([any(row[name]["found"] for name in names) for row in rows])
    proofs = [row["proof"] for row in rows if "proof" in row]
    proved = sum(proof["proved"] for proof in proofs)
    print(f"{count} scenes; solved by any {share(int(solved.sum()), count)}; of the others proved infeasible "
          f"{proved} of {len(proofs)}")  # fmt: skip
    heads = [
        "method",
        "first try",
        *(f"≤{k} solves" for k in SOLVES),
        *(f"{s} cpu_s" for s in CPU_S),
        "any",
        "median cpu",
    ]
    print(" | ".join(heads))
    for name in names:
        got = [row[name] for row in rows]
        found = np.array([one["found"] for one in got])
        tries = np.array([one["tries"] for one in got])
        solves = np.array([one["solves"] for one in got])
        cpu = np.where(found, [one["cpu_s"] for one in got], np.inf)
        cells = [share(int((found & (tries == 1)).sum()), count)]
        cells += [share(int((found & (solves <= k)).sum()), count) for k in SOLVES]
        cells += [share(int((cpu <= s).sum()), count) for s in CPU_S]
        of_solved = float(np.median(cpu[solved])) if solved.any() else np.inf
        print(" | ".join([name, *cells, share(int(found.sum()), count), f"{of_solved:.3f} s"]))
    refused = sum(row[name]["refused"] for row in rows for name in names)
    errors = [row[name]["momentum_error"] for row in rows for name in names if row[name]["found"]]
    print(f"attempts that SCP solved and the verifier refused: {refused}; worst error of L, in units of its limit: "
          f"{max(errors, default=0.0):.2g} of {len(errors)} plans")  # fmt: skip
    spent = sum(row[name]["cpu_s"] for row in rows for name in names)
    tried = sum(row[name]["tries"] for row in rows for name in names)
    print(f"{tried} tries in {spent:.0f} CPU-s, {tried / max(spent, 1e-9):.0f} per CPU-s")


def share(k: int, n: int) -> str:
    """A share in percent with its interval."""
    if not n:
        return "–"
    z, p = 1.96, k / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return f"{100 * p:.0f} [{100 * max(middle - half, 0):.0f}, {100 * min(middle + half, 1):.0f}]"


if __name__ == "__main__":
    main()
