"""The batched environment against a bare planner loop and Gymnasium's own vector environments.

    python benchmarks/vector.py [--problem wall-3] [--envs 8] [--steps 40] [--rounds 5] [--pool
    FOLDER]

The bare loop labels the very problems that the environment drew (those that balancing threw away,
too) and puts the same scenes and actions through P1, fix-p and the verifier; both decide one
problem after the other (`benchmarks/environment.py` has what drawing in blocks saves). Sampling
these problems, which a loop over given scenes would not have to do, is timed apart. All take turns
in one process; processor times are compared. Then all ways of batching take turns, with the same
seeds and actions: wall clock, which says little where others compute, too, and processor time, of
the process that steps and of its children. "two cores": time of ours ÷ what two idle cores would
take of Gymnasium's asynchronous ones, which only wait for each other: what the one that steps does
and half of what its children do. --pool: a folder of `stancekit label` that all of these draw from;
the bare loop is left out.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from _bench import Options, launch
from gymnasium.vector import AutoresetMode, VectorEnv

from stancekit.envs.distributions.postures import PostureDistribution, distribution
from stancekit.envs.scenes import LabelledScene, OneByOne
from stancekit.envs.selection import ADMITTED
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.learners.selectors.selector import heuristic_envelope
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import Problem
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.search.answer import Acceptance, Clock, plan_of
from stancekit.planners.search.exact import Exact

NAME = "stancekit.envs:stancekit/EnvelopeSelection-v0"
ONE = "ours"
CORES = 2
WARM = 31
"""Steps before anything is timed: scenes are then drawn 32 at a time."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which problems, and for how long."""

    problem: str = "wall-3"
    envs: int = 8
    steps: int = 40
    rounds: int = 5
    pool: Path | None = None


def main(arguments: Arguments) -> None:
    """Measure and print."""
    found = {} if arguments.pool is not None else overhead(arguments)
    arguments.list(found | rates(arguments), problem=arguments.problem, envs=arguments.envs)


@dataclass(frozen=True)
class RecordedDistribution(PostureDistribution):
    """A distribution that remembers what it drew, and how long that took."""

    drawn: list[Problem] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def sample(self, rng: np.random.Generator) -> Problem:
        """Draw and remember."""
        begin = time.process_time()
        self.drawn.append(super().sample(rng))
        self.seconds.append(time.process_time() - begin)
        return self.drawn[-1]


class RecordedScenes(OneByOne):
    """Scenes, drawn one by one, that remember which of them were handed out."""

    def __init__(self, recorded: RecordedDistribution) -> None:
        super().__init__(recorded)
        self.kept: list[LabelledScene] = []

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Draw and remember."""
        self.kept.append(super().draw(rng))
        return self.kept[-1]

    def __copy__(self) -> RecordedScenes:
        return self  # one list for all sub-environments


def overhead(arguments: Arguments) -> dict[str, float]:
    """Processor time of environment and bare loop on the same problems, scenes and actions, in
    turns.
    """
    plain = distribution(arguments.problem)
    names = ("name", "terrain", "legs", "friction", "robot")
    recorded = RecordedDistribution(**{name: getattr(plain, name) for name in names})
    scenes = RecordedScenes(recorded)
    env = EnvelopeSelectionVectorEnv(arguments.envs, arguments.problem, scenes=scenes)
    bare = BareLoop()
    actions = actions_for(arguments.problem, arguments.envs)
    env.reset(seed=arguments.seed)
    env.step(actions)  # compiles
    bare.run(recorded.drawn, scenes.kept, actions[0])
    ours, theirs, sampling, steps = 0.0, 0.0, 0.0, 0
    for _ in range(arguments.rounds):
        recorded.drawn.clear()
        recorded.seconds.clear()
        scenes.kept[:] = scenes.kept[
            -arguments.envs :
        ]  # drawn by the last step, judged by the next
        begin = time.process_time()
        for _ in range(arguments.steps):
            env.step(actions)
        middle = time.process_time()
        bare.run(recorded.drawn, scenes.kept[: -arguments.envs], actions[0])
        end = time.process_time()
        ours, theirs, steps = (
            ours + middle - begin,
            theirs + end - middle,
            steps + arguments.steps * arguments.envs,
        )
        sampling += sum(recorded.seconds)
    return {
        "bare planner loop [ms a step, processor]": 1e3 * theirs / steps,
        "sampling [ms a step, processor]": 1e3 * sampling / steps,
        "environment [ms a step, processor]": 1e3 * ours / steps,
        "overhead over planners and sampling [%]": 100.0 * (ours / (theirs + sampling) - 1.0),
        "overhead over planners alone [%]": 100.0 * (ours / theirs - 1.0),
    }


class BareLoop:
    """Exact label, P1, fix-p and the verifier, with no environment around them."""

    def __init__(self) -> None:
        self._programs = Programs()
        self._expert = Exact(programs=self._programs)
        self._acceptance = Acceptance(tolerance=ADMITTED)

    def run(self, problems: list[Problem], scenes: list[LabelledScene], action: np.ndarray) -> None:
        """Label all problems; put all scenes through both stages."""
        envelope = Envelope.from_vector(action)
        for problem in problems:
            self._expert.solve(problem)
        for scene in scenes:
            scaled = Scaled.of(scene.problem)
            answer = self._programs.get(McCormick, scaled.layout).solve_any(scaled, (envelope,))
            if answer.feasible and answer.point is not None:
                point = project(self._programs, "fix-p", scaled, answer.point)
                if np.isfinite(point.residual):
                    self._acceptance.answer(
                        scene.problem,
                        plan=plan_of(scene.problem, scaled, scaled.numbers, point),
                        method="fix-p",
                        clock=Clock.start(),
                    )


def rates(arguments: Arguments) -> dict[str, float]:
    """Steps a second and a CPU-second, a step being one of one sub-environment; the ways take
    turns.
    """
    given: dict[str, Any] = {"problem": arguments.problem, "num_envs": arguments.envs}
    given |= {} if arguments.pool is None else {"scenes": str(arguments.pool)}
    same = {"autoreset_mode": AutoresetMode.SAME_STEP}
    ways: dict[str, dict[str, Any]] = {
        "Gymnasium Sync": {"vectorization_mode": "sync", "vector_kwargs": same},
        "Gymnasium Async": {"vectorization_mode": "async", "vector_kwargs": same},
        ONE: {},
    }
    actions, known = actions_for(arguments.problem, arguments.envs), set[int | None]()
    turns: dict[str, Turns] = {}
    for name, options in ways.items():
        turns[name] = Turns(gymnasium.make_vec(NAME, **given, **options))
        children = {process.pid for process in multiprocessing.active_children()}
        turns[name].children, known = sorted(children - known), known | children
        turns[name].warm(actions, arguments.seed)
    load = os.getloadavg()[0]
    for _ in range(arguments.rounds):
        for turn in turns.values():
            turn.take(actions, arguments.steps)
    steps = arguments.steps * arguments.envs
    found = {f"{name}: first step with compiling [s]": turn.first_s for name, turn in turns.items()}
    alone = sum(turns[ONE].cpu_s)
    for name, turn in turns.items():
        turn.env.close()
        led, apart = turn.cpu_s
        found[f"{name} [steps/s, wall]"] = steps / float(np.median(turn.wall_s))
        found[f"{name} [steps a CPU-second]"] = arguments.rounds * steps / (led + apart)
        both = led + apart / CORES if len(turn.children) > 1 else max(led, apart)
        found[f"{name} ÷ {ONE}, two cores"] = alone / both
    return found | {"load on this machine, before": load, "after": os.getloadavg()[0]}


@dataclass
class Turns:
    """One way, and what its turns took: wall clock each, and processor time in all, of its own and
    of its children.
    """

    env: VectorEnv
    children: Sequence[int | None] = ()
    first_s: float = 0.0
    wall_s: list[float] = field(default_factory=list)
    cpu_s: tuple[float, float] = (0.0, 0.0)

    def warm(self, actions: np.ndarray, seed: int) -> None:
        """Compile, and draw until blocks have their size."""
        begin = time.perf_counter()
        self.env.reset(seed=seed)
        self.env.step(actions)
        self.first_s = time.perf_counter() - begin
        for _ in range(WARM):
            self.env.step(actions)

    def take(self, actions: np.ndarray, steps: int) -> None:
        """Some more steps."""
        begin, own, apart = time.perf_counter(), time.process_time(), cpu_of(self.children)
        for _ in range(steps):
            self.env.step(actions)
        self.wall_s.append(time.perf_counter() - begin)
        own, apart = time.process_time() - own, cpu_of(self.children) - apart
        self.cpu_s = self.cpu_s[0] + own, self.cpu_s[1] + apart


def cpu_of(processes: Sequence[int | None]) -> float:
    """Processor time that these have taken [s] (Linux)."""
    fields = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in processes]
    return sum(int(its[11]) + int(its[12]) for its in fields) / os.sysconf("SC_CLK_TCK")


def actions_for(problem: str, envs: int) -> np.ndarray:
    """The heuristic box for every sub-environment."""
    problems = [distribution(problem).sample(np.random.default_rng(k)) for k in range(20)]
    box = heuristic_envelope(problem, problems).envelopes[0].to_vector().astype(np.float32)
    return np.tile(np.clip(box, -1.0, 1.0), (envs, 1))


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
