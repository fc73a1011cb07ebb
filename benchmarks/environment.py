"""``EnvelopeSelection-v0``: steps a CPU-second of fresh scenes in blocks, one by one, and of a
pool; the same bits.

    python benchmarks/environment.py [--problem wall-3] [--steps 10000] [--pool FOLDER] [--against
    CHECKOUT] [--seed 0]

Fresh scenes, drawn in blocks as by default, and scenes drawn one by one take turns in one process,
with the same seed and actions (the heuristic box, moved by normal noise of .05); every observation,
reward and ``info`` is compared, bit for bit. The pool is a folder of `stancekit label`, or, without
one, the fresh scenes once more. A yardstick, cold solves of one fixed cone program of a posture's
size in which nothing is ours, is timed between the turns, and so is P1 alone, loaded and solved
cold, on the scenes of the run. The bare planners take turns, too, on the problems, scenes and boxes
that the environments had: drawing all problems, the exact search of every scene that was kept, to
its end, and P1 in a program that is kept. --digest: only play, so many fresh steps and so many of a
pool of the first fresh scenes, and print the digests of all that the environment said. --against:
the same here and in another checkout, in which `python setup.py links` was run.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from _bench import Options, launch
from _checkouts import checkouts, of_checkout
from _yardstick import yardstick
from vector import actions_for

from stancekit.envs.distributions.postures import PostureDistribution
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.problem import PostureBatch
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import Boxed, McCormick
from stancekit.planners.search.exact import Exact

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
    from stancekit.envs.scenes import SampledScenes

    kept, found = Kept(SampledScenes(distribution(arguments.problem))), []
    for of_pool in (False, True):
        source = pool_source(arguments, kept.scenes) if of_pool else kept
        env = EnvelopeSelectionEnv(arguments.problem, scenes=source)
        sha = hashlib.sha256()
        for said in played(env, arguments):
            sha.update(as_bytes(said))
        found.append(sha.hexdigest())
    return f"fresh {found[0]} pool {found[1]}"


Said = list[tuple[str, Any]]
"""Everything that an environment says of a step, by names."""


def played(env: EnvelopeSelectionEnv, arguments: Arguments) -> Iterator[Said]:
    """Play, and tell what the environment says of each step."""
    for step, action in enumerate(actions_of(arguments)):
        observation, _ = env.reset(seed=arguments.seed if step == 0 else None)
        after, reward, _, _, info = env.step(action)
        yield [*observation.items(), *after.items(), ("reward", reward), *info.items()]


def actions_of(arguments: Arguments) -> Iterator[Any]:
    """The actions, the same for every way."""
    rng, base = np.random.default_rng(arguments.seed), actions_for(arguments.problem, 1)[0]
    for _ in range(arguments.steps):
        moved = base + NOISE * rng.standard_normal(len(base))
        yield np.clip(moved, -1.0, 1.0).astype(np.float32)


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
    from stancekit.envs.scenes import OneByOne, SampledScenes

    law = TimedDraws.of(distribution(arguments.problem))
    kept = Kept(SampledScenes(law))
    sources: dict[str, Any] = {"fresh, in blocks": kept, "fresh, one by one": OneByOne(law)}
    ways = {
        name: Way(played(EnvelopeSelectionEnv(law, scenes=it), arguments))
        for name, it in sources.items()
    }
    pool, bare, actions = Way(iter(())), Bare(), actions_of(arguments)
    cold, yard, solves, equal, drawing = 0.0, 0.0, 0, True, 0.0
    for begin in range(0, arguments.steps, TURN):
        steps = min(TURN, arguments.steps - begin)
        yard, solves = yard + yardstick(SOLVES), solves + SOLVES
        for name, way in ways.items():
            law.seconds.clear()
            way.turn(steps)
            drawing += sum(law.seconds) if name == "fresh, in blocks" else 0.0
        equal = equal and ways["fresh, in blocks"].last == ways["fresh, one by one"].last
        if begin == 0:
            dealt = pool_source(arguments, kept.scenes)
            pool = Way(played(EnvelopeSelectionEnv(arguments.problem, scenes=dealt), arguments))
            next(pool.said)  # compiles
            bare.relax("P1, pool", dealt.scenes, [next(actions)])
            bare.search("searches", kept.scenes[:1])
            bare.seconds.clear()
        pool.turn(steps - (begin == 0))
        boxes = [next(actions) for _ in range(steps - (begin == 0))]
        bare.search("searches", kept.scenes[-len(boxes) :])
        bare.relax("P1, fresh", kept.scenes[-len(boxes) :], boxes)
        bare.relax("P1, pool", dealt.scenes[-len(boxes) :], boxes)
        cold += timed(lambda: p1_cold(kept.scenes[-SOLVES:]))
    one, count = yard / solves, arguments.steps
    found = {"bits that differ, of all that is said": float(not equal), "yardstick [ms]": 1e3 * one}
    found["P1 alone, set up and solved cold [ms]"] = 1e3 * cold / solves
    for name, way in [*ways.items(), ("pool", pool)]:
        found[f"{name}: steps a CPU-second"] = count / way.seconds
        found[f"{name}: a step in yardsticks"] = way.seconds / count / one
        found[f"{name}: a step in cold solves of P1"] = way.seconds / count / (cold / solves)
    alone = {"draws": drawing, **bare.seconds}
    found |= {f"bare, {name} [ms a step]": 1e3 * took / count for name, took in alone.items()}
    fresh = alone["draws"] + alone["searches"] + alone["P1, fresh"]
    found["fresh, in blocks: speed, of bare planners'"] = fresh / ways["fresh, in blocks"].seconds
    found["pool: speed, of bare P1's"] = alone["P1, pool"] / pool.seconds
    return found


@dataclass(frozen=True)
class TimedDraws(PostureDistribution):
    """A distribution that remembers how long its draws took [s]."""

    seconds: list[float] = field(default_factory=list)

    @classmethod
    def of(cls, law: Any) -> TimedDraws:
        """The same distribution, timed."""
        return cls(**{each.name: getattr(law, each.name) for each in fields(law)})

    def batch(self, rng: np.random.Generator, count: int) -> PostureBatch:
        """Draw and remember."""
        begin = time.process_time()
        batch = super().batch(rng, count)
        self.seconds.append(time.process_time() - begin)
        return batch


class Bare:
    """The planners without an environment around them, their programs kept.

    seconds: that they took, by name.
    """

    def __init__(self) -> None:
        self._programs, self.seconds = Programs(), defaultdict[str, float](float)
        self._expert = Exact(programs=self._programs)

    def search(self, name: str, scenes: Sequence[Any]) -> None:
        """The exact search of each, to its end."""
        begin = time.process_time()
        for scene in scenes:
            self._expert.search(scene.scaled)
        self.seconds[name] += time.process_time() - begin

    def relax(self, name: str, scenes: Sequence[Any], actions: Sequence[Any]) -> None:
        """P1 of each over the box of an action."""
        model = self._programs.get(McCormick, scenes[0].scaled.layout)
        boxes = [Envelope.from_vector(action.astype(np.float64)) for action in actions]
        begin = time.process_time()
        for scene, box in zip(scenes, boxes, strict=True):
            model.solve_any(scene.scaled, (box,))
        self.seconds[name] += time.process_time() - begin


class Kept:
    """A source that remembers what it handed out."""

    def __init__(self, source: Any) -> None:
        self._source, self.scenes = source, list[Any]()

    def draw(self, rng: np.random.Generator) -> Any:
        """Draw and remember."""
        self.scenes.append(self._source.draw(rng))
        return self.scenes[-1]


def pool_source(arguments: Arguments, scenes: list[Any]) -> Kept:
    """A pool: of the folder, or of the scenes of the first turn."""
    from stancekit.envs.distributions.postures import distribution
    from stancekit.envs.scenes import ListedScenes, SceneSettings

    if arguments.pool is None:
        return Kept(ListedScenes(scenes[:TURN]))
    law = distribution(arguments.problem)
    return Kept(SceneSettings(scenes=arguments.pool).source(law, Programs()))


def p1_cold(scenes: list[Any]) -> None:
    """P1 over the middle half of the domain, numbers loaded and a solver set up for each scene."""
    import clarabel

    from stancekit.planners.equilibrium.rows import solver_settings

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
