"""``EnvelopeSelection-v0``: steps a CPU-second of fresh scenes in blocks, one by one, and of a
pool; the same bits.

    python benchmarks/environment.py [--problem wall-3] [--steps 10000] [--pool FOLDER] [--against
    CHECKOUT] [--seed 0]

Fresh scenes, drawn in blocks as by default, and scenes drawn one by one take turns in one process,
with the same seed and actions (the heuristic box, moved by normal noise of .05); every observation,
reward and ``info`` is compared, bit for bit. The pool is a folder of `stancekit label`, or, without
one, the fresh scenes once more. A yardstick, cold solves of one fixed cone program of a posture's
size in which nothing is ours, is timed between the turns, and so is P1 alone, loaded and solved
cold, on the scenes of the run. --digest: only play, so many fresh steps and so many of a pool of
the first fresh scenes, and print the digests of all that the environment said. --against: the same
here and in another checkout, in which `python setup.py links` was run.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, checkouts, launch, of_checkout
from _yardstick import yardstick
from vector import actions_for

from stancekit.envs.selection import EnvelopeSelectionEnv

TURN = 250
"""Steps of one way before it is the next one's turn."""
SOLVES = 20
"""Of the yardstick, a turn."""
NOISE = 0.05


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which scenes, and how many steps."""

    problem: str = "wall-3"
    steps: int = 10_000
    pool: Path | None = None
    against: Path | None = None
    digest: bool = False
    """Only play, and print the digests of what was said."""


def main(arguments: Arguments) -> None:
    """Measure and print."""
    if arguments.digest:
        print(digest(arguments))
    elif arguments.against is not None:
        found = {
            name: digest_of(folder, arguments)
            for name, folder in checkouts(arguments.against).items()
        }
        arguments.list({"the same": float(len(set(found.values())) == 1)}, **found)
    else:
        arguments.list(rates(arguments), problem=arguments.problem, steps=arguments.steps)


def digest_of(folder: Path, arguments: Arguments) -> str:
    """What this script says in another checkout."""
    command = [
        sys.executable,
        __file__,
        "--digest",
        "--problem",
        arguments.problem,
        "--steps",
        str(arguments.steps),
    ]
    command += ["--seed", str(arguments.seed)]
    done = subprocess.run(
        command, env=of_checkout(folder), check=True, capture_output=True, text=True
    )
    print(f"{folder}: {done.stdout.strip()}", flush=True)
    return done.stdout.strip()


def digest(arguments: Arguments) -> str:
    """SHA-256 of all observations, rewards and infos of fresh steps, and of steps of a pool."""
    from stancekit.envs.distributions.postures import distribution
    from stancekit.envs.sampling import SampledScenes

    kept, found = Kept(SampledScenes(distribution(arguments.problem))), []
    for of_pool in (False, True):
        env = (
            pool_env(arguments, kept.scenes)
            if of_pool
            else EnvelopeSelectionEnv(arguments.problem, scenes=kept)
        )
        sha = hashlib.sha256()
        for said in played(env, arguments):
            sha.update(as_bytes(said))
        found.append(sha.hexdigest())
    return f"fresh {found[0]} pool {found[1]}"


Said = list[tuple[str, Any]]
"""Everything that an environment says of a step, by names."""


def played(env: EnvelopeSelectionEnv, arguments: Arguments) -> Iterator[Said]:
    """Play, and tell what the environment says of each step."""
    rng, base = np.random.default_rng(arguments.seed), actions_for(arguments.problem, 1)[0]
    for step in range(arguments.steps):
        observation, _ = env.reset(seed=arguments.seed if step == 0 else None)
        moved = base + NOISE * rng.standard_normal(len(base))
        after, reward, _, _, info = env.step(np.clip(moved, -1.0, 1.0).astype(np.float32))
        yield [*observation.items(), *after.items(), ("reward", reward), *info.items()]


def as_bytes(said: Said) -> bytes:
    """The same to the last bit."""
    return b"".join(name.encode() + np.asarray(value).tobytes() for name, value in said)


@dataclass
class Way:
    """Steps of one way so far, and what they took [s]."""

    said: Iterator[Said]
    seconds: float = 0.0
    last: list[bytes] = field(default_factory=list)

    def turn(self, steps: int) -> None:
        """Some more steps."""
        begin = time.process_time()
        said = [next(self.said) for _ in range(steps)]
        self.seconds += time.process_time() - begin
        self.last = [as_bytes(each) for each in said]


def rates(arguments: Arguments) -> dict[str, float]:
    """Play all ways in turns."""
    from stancekit.envs.distributions.postures import distribution
    from stancekit.envs.sampling import OneByOne, SampledScenes

    law = distribution(arguments.problem)
    kept = Kept(SampledScenes(law))
    sources: dict[str, Any] = {"fresh, in blocks": kept, "fresh, one by one": OneByOne(law)}
    ways = {
        name: Way(played(EnvelopeSelectionEnv(law, scenes=it), arguments))
        for name, it in sources.items()
    }
    pool = Way(iter(()))
    cold, yard, solves, equal = 0.0, 0.0, 0, True
    for begin in range(0, arguments.steps, TURN):
        steps = min(TURN, arguments.steps - begin)
        yard, solves = yard + yardstick(SOLVES), solves + SOLVES
        for way in ways.values():
            way.turn(steps)
        equal = equal and ways["fresh, in blocks"].last == ways["fresh, one by one"].last
        if begin == 0:
            pool = Way(played(pool_env(arguments, kept.scenes), arguments))
            pool.turn(1)  # compiles
            pool.seconds = 0.0
        pool.turn(steps - (begin == 0))
        cold += timed(lambda: p1_cold(kept.scenes[-SOLVES:]))
    one, count = yard / solves, arguments.steps
    found = {"bits that differ, of all that is said": float(not equal), "yardstick [ms]": 1e3 * one}
    found["P1 alone, set up and solved cold [ms]"] = 1e3 * cold / solves
    for name, way in [*ways.items(), ("pool", pool)]:
        found[f"{name}: steps a CPU-second"] = count / way.seconds
        found[f"{name}: a step in yardsticks"] = way.seconds / count / one
        found[f"{name}: a step in cold solves of P1"] = way.seconds / count / (cold / solves)
    return found


class Kept:
    """A source that remembers what it handed out."""

    def __init__(self, source: Any) -> None:
        self._source, self.scenes = source, list[Any]()

    def draw(self, rng: np.random.Generator) -> Any:
        """Draw and remember."""
        self.scenes.append(self._source.draw(rng))
        return self.scenes[-1]


def pool_env(arguments: Arguments, scenes: list[Any]) -> EnvelopeSelectionEnv:
    """The environment on a pool: of the folder, or of the scenes of the first turn."""
    from stancekit.envs.scenes import PooledScenes

    if arguments.pool is not None:
        return EnvelopeSelectionEnv(arguments.problem, scenes=arguments.pool)
    return EnvelopeSelectionEnv(arguments.problem, scenes=PooledScenes(scenes[:TURN]))


def p1_cold(scenes: list[Any]) -> None:
    """P1 over the middle half of the domain, numbers loaded and a solver set up for each scene."""
    import clarabel

    from stancekit.planners.equilibrium.clarabel_settings import solver_settings
    from stancekit.planners.relaxation.envelope import Envelope
    from stancekit.planners.relaxation.mccormick import Boxed, McCormick

    model = McCormick(scenes[0].scaled.layout)
    half = np.full(scenes[0].point.shape, 0.5)
    box = Envelope(low=-half, high=half)
    for scene in scenes:
        data = model.rows.load(Boxed(scene.scaled, boxes=(box,)))
        clarabel.DefaultSolver(
            *data, model.rows.cone_list, solver_settings(equilibrate=False)
        ).solve()


def timed(work: Callable[[], None]) -> float:
    """CPU time [s]."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
