"""What networks that propose postures and proofs settle, what they change, and what labels cost
with them.

    python benchmarks/proposers.py                           # train a pair a class, then measure
    python benchmarks/proposers.py --folder out/proposers    # with CLASS.safetensors of `stancekit
    proposers`

Shares are of natural draws. Settled without a solver: by a proposed proof, by the fixed iteration
or by a proposed posture, each accepted by the verifier. Labels are made in processes of their own,
in turns with and without proposers, after a warm-up and with everything counted but the training.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _bench import ROOT, Options, Row, launch, markdown, spread
from labels import child, compare

from stancekit.envs.distributions.postures import distribution
from stancekit.learners.proposers.proposer import Proposers
from stancekit.learners.proposers.training import ProposerSettings, train_proposers
from stancekit.planners.search.answer import Acceptance
from stancekit.planners.search.batch import solve_all
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.proposals import proved, witnessed

BLOCK = 512


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """What is measured."""

    folder: Path | None = None
    """Where the files of proposers are, and are put where they are missing."""
    kinds: tuple[str, ...] = ("wall-3", "ground-3", "wall-5")
    draws: int = 2048
    """Natural draws whose verdicts are compared."""
    rows: int = 1000
    """Labels a run."""
    pairs: int = 3
    balanced: bool = False


def main(given: Arguments) -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as spare:
        for kind in given.kinds:
            path = trained(kind, given.folder or Path(spare), given)
            shares(kind, Proposers.load(path, problem_class=kind), given)
            if given.pairs:
                cost(kind, path, given)


def trained(kind: str, folder: Path, given: Arguments) -> Path:
    """The file of a class, trained where it is missing."""
    path = folder / f"{kind}.safetensors"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        begin = time.process_time()
        train_proposers(distribution(kind), ProposerSettings(seed=given.seed)).save(path)
        given.say({"class": kind, "training CPU-s": round(time.process_time() - begin, 1)})
    return path


def shares(kind: str, proposers: Proposers, given: Arguments) -> None:
    """What is settled by whom, and how many verdicts differ."""
    source, rng = distribution(kind), np.random.default_rng(10_000 + given.seed)
    plain, asked = (planner(each) for each in (None, proposers))
    kinds, settled, differ = Counter[str](), Counter[str](), 0
    for begin in range(0, given.draws, BLOCK):
        batch = source.batch(rng, min(BLOCK, given.draws - begin))
        before, after = solve_all(plain, batch), solve_all(asked, batch)
        kinds.update(str(one.status.value) for one in before)
        kinds["trivially so"] += sum(bool(one.details["trivial"]) for one in before)
        pairs = zip(before, after, strict=True)
        differ += sum(
            (a.status, a.details["trivial"]) != (b.status, b.details["trivial"]) for a, b in pairs
        )
        proofs = set(proved(proposers, batch, Acceptance()))
        postures = set(witnessed(proposers, batch, Acceptance()))
        settled["by proofs"] += len(proofs)
        settled["by postures"] += len(postures)
        settled["by either, nothing else asked"] += len(proofs | postures)
        settled["without a solver, without proposers"] += sum(
            one.effort.solves == 0 for one in before
        )
        settled["without a solver"] += sum(one.effort.solves == 0 for one in after)
    given.say(
        {
            "class": kind,
            "draws": given.draws,
            "verdicts that differ": differ,
            **shared(kinds, given.draws),
            "settled": shared(settled, given.draws),
        }
    )


def cost(kind: str, path: Path, given: Arguments) -> None:
    """CPU seconds for 1,000 natural samples, in alternating pairs, and row by row what is equal."""
    found: dict[str, list[float]] = {"without": [], "with": []}
    slowest: dict[str, list[float]] = {"without": [], "with": []}
    for pair in range(given.pairs):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("without", "with") if pair % 2 == 0 else ("with", "without"):
                file = str(path.resolve()) if name == "with" else None
                ran = child(ROOT, [kind, given.rows, given.balanced, f"{folder}/{name}", file])
                found[name].append(1e3 * ran["cpu"] / ran["drawn"])
                slowest[name].append(ran["p99"])
            if pair == 0:
                compare(kind, Path(folder) / "without" / "set", Path(folder) / "with" / "set")
    given.say(
        {
            "class": kind,
            **{name: spread(each) for name, each in found.items()},
            "without ÷ with": spread(np.divide(found["without"], found["with"])),
            **{f"p99 {name} [ms]": spread(each) for name, each in slowest.items()},
        }
    )


def planner(proposers: Proposers | None) -> ExactPlanner:
    """As labelling has it: no clock takes part."""
    return ExactPlanner(max_nodes=500, time_limit_s=math.inf, proposers=proposers)


def shared(counts: Counter[str], of: int) -> dict[str, str]:
    """Shares in percent."""
    return {name: f"{count / of:.1%}" for name, count in counts.items()}


def settled(rows: list[Row]) -> Iterable[str]:
    """What is settled by whom, of all draws (docs/proposers.md)."""
    found = [row for row in rows if "settled" in row]
    head = ("class", "infeasible", "feasible", *found[0]["settled"])
    return markdown(
        head,
        (
            (row["class"], row["infeasible"], row["feasible"], *row["settled"].values())
            for row in found
        ),
    )


def costs(rows: list[Row]) -> Iterable[str]:
    """CPU-s for 1,000 natural samples (docs/proposers.md)."""
    found = [row for row in rows if "without" in row]
    return markdown(list(found[0]), (row.values() for row in found))


if __name__ == "__main__":
    launch(main, Arguments, __doc__, settled=settled, costs=costs)
