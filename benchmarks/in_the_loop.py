"""What a trained selector contributes where it is used: first plans on random ice, and windows of
``Traverse-v0``.

    python benchmarks/in_the_loop.py --selectors gmm.json neural.safetensors [--count 40]
    [--episodes 20] [--seed 0]
        [--frames 8] [--regions 4] [--ice 0.5] [--course walls] [--horizon 2] [--runs 10] [--shares
        1 0.7] [--json]

The selectors are files of `stancekit fit`, of a class whose legs the courses stand on (wall-3).
"lift": the two-stage planner, no selector. A selector's box is asked first in every plan, and the
lift where there is no plan within it, so that it costs time at worst. All ways plan the same
courses, after one that nobody counts.

Ice: walls with random panels without friction, planned whole; found: a verified plan. Its median
processor time has the interval of order statistics, and "÷ lift" that of the courses both found.
Windows: episodes of ``Traverse-v0`` over perturbed courses, --horizon key frames a window; reached:
at the last frame. "by the policy": plans within what the selector chose, of all that its way made.
Intervals of shares are Wilson's; all are of 95 %.

Unknown friction: the closed loop in MuJoCo over --runs perturbed courses, in a world that has one
of --shares of the friction that they say; the loop is told nothing, and estimates it from what feet
feel (``closed_loop.py``, "anew"). All plans are made by the way's planner, the first one, too.
succeeded: all key frames were reached and nothing stopped it. of solvable: of the courses for which
the lift has a plan when it is told. A part with a count of 0 is left out.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import comb
from pathlib import Path

import numpy as np
from _bench import Options, Row, launch, markdown
from closed_loop import Ran, course_of, solved, summary

from stancekit import Answer, Motion
from stancekit.envs.distributions.courses import icy_walls
from stancekit.envs.traverse import TraverseEnv
from stancekit.learners.evaluation.evaluate import Share
from stancekit.motions import policy_of
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.problem import Problem
from stancekit.planners.problem.contact import NoFooting
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.search.two_stage import TwoStage
from stancekit.runner.control.closed_loop import ClosedLoop
from stancekit.runner.control.envelope_choice import Observation, SelectorPolicy
from stancekit.runner.run import Runner
from stancekit.runner.worlds.world import make_world

LIFT = "lift"


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which selectors, and on what."""

    selectors: tuple[Path, ...]
    count: int = 40
    """Walls with ice."""
    frames: int = 8
    regions: int = 4
    ice: float = 0.5
    episodes: int = 20
    """Of Traverse-v0."""
    course: str = "walls"
    horizon: int = 2
    runs: int = 10
    """In the closed loop, a share of friction."""
    shares: tuple[float, ...] = (1.0, 0.7)


def main(arguments: Arguments) -> None:
    """Measure and print."""
    like = read_course("icy-walls")
    policies = {path.name: policy_of(str(path), like) for path in arguments.selectors}
    for part, wanted in (
        (on_ice, arguments.count),
        (walked, arguments.episodes),
        (unknown_friction, arguments.runs),
    ):
        if wanted:
            part(
                arguments,
                {LIFT: Way(None)} | {name: Way(policy) for name, policy in policies.items()},
            )


@dataclass
class Way:
    """A planner, with a selector's policy or without. seconds: of every plan that was found, by
    course, CPU [s].
    """

    policy: SelectorPolicy | None
    seconds: dict[int, float] = field(default_factory=dict)
    name: str = "two-stage"

    def __post_init__(self) -> None:
        self._lift = TwoStage()
        self.forget()

    def forget(self) -> None:
        """Begin to count."""
        self.inside = self.plans = 0
        self.seconds.clear()

    def solve(self, course: Problem) -> Answer[Motion]:
        """Plan, and count whose plan it is."""
        if self.policy is None:
            outcome = self._lift.solve(course)
        else:
            self.policy.planners.clear()
            window = Observation(
                window=course, standing=None, state=None, friction_share=1.0, frame=0
            )
            outcome = self.policy(window).solve(course)
            self.inside += self.policy.answers[0]
        self.plans += outcome.solution is not None
        return outcome

    @property
    def share(self) -> str:
        """Of the plans, those within what the selector chose."""
        return "" if self.policy is None else shown(Share(hits=self.inside, of=self.plans))


def on_ice(arguments: Arguments, ways: dict[str, Way]) -> None:
    """Time to a first verified plan."""
    rng = np.random.default_rng(arguments.seed)
    courses = [icy(arguments, rng) for _ in range(arguments.count + 1)]
    for index, course in enumerate(courses):
        if index == 1:  # the first one compiled
            for way in ways.values():
                way.forget()
        for way in ways.values():
            begin = time.process_time()
            if way.solve(course).solution is not None:
                way.seconds[index] = time.process_time() - begin
    for name, way in ways.items():
        both = way.seconds.keys() & ways[LIFT].seconds.keys()
        ratio = [way.seconds[index] / ways[LIFT].seconds[index] for index in both]
        arguments.say(
            {
                "ice": name,
                "found": shown(Share(hits=len(way.seconds), of=arguments.count)),
                "CPU s to it": median(list(way.seconds.values())),
                "÷ lift": median(ratio),
                "by the policy": way.share,
            }
        )


def icy(arguments: Arguments, rng: np.random.Generator) -> Problem:
    """Walls with ice that have something for every toe."""
    while True:
        try:
            return icy_walls(rng, arguments.frames, arguments.regions, ice=arguments.ice)
        except (NoFooting, InvalidInput):
            continue


def walked(arguments: Arguments, ways: dict[str, Way]) -> None:
    """Windows of Traverse-v0."""
    for name, way in ways.items():
        env = TraverseEnv((arguments.course,), horizon=arguments.horizon, planners=[way])
        reached = begun = windows = planned = 0
        begin = 0.0
        for episode in range(arguments.episodes + 1):
            if episode == 1:
                way.forget()
                windows = planned = begun = reached = 0
                begin = time.process_time()
            try:
                env.reset(seed=arguments.seed + episode)
            except PlanningFailed:
                continue
            begun, over = begun + 1, False
            while not over:
                _, _, ended, cut, info = env.step(np.int64(0))
                windows, planned, over = windows + 1, planned + info["feasible"], ended or cut
            reached += info["frame"] == frames_of(env) - 1
        seconds = time.process_time() - begin
        arguments.say(
            {
                "windows": name,
                "verified": shown(Share(hits=planned, of=windows)),
                "reached": shown(Share(hits=reached, of=begun)),
                "CPU s a window": f"{seconds / windows:.3f}",
                "by the policy": way.share,
            }
        )


def unknown_friction(arguments: Arguments, ways: dict[str, Way]) -> None:
    """Closed loops that are not told the friction."""
    for share in arguments.shares:
        for name, way in ways.items():
            begin, made, runs = time.process_time(), np.zeros(2, dtype=int), list[Ran]()
            for index in range(arguments.runs):
                if way.policy is not None:
                    way.policy.planners.clear()
                course = course_of(arguments.course, arguments.seed, index, amount=1.0)
                runs.append(loop(course, share, way.policy))
                made += (0, 0) if way.policy is None else way.policy.answers
            told, (inside, without) = summary(runs), made.tolist()
            arguments.say(
                {
                    "friction": share,
                    "way": name,
                    "succeeded": shown(Share(hits=told["succeeded"], of=told["runs"])),
                    "of solvable": f"{told['of_solvable']}/{told['solvable']}",
                    "refused": told["refused"],
                    "by the policy": ""
                    if way.policy is None
                    else shown(Share(hits=inside, of=inside + without)),
                    "replans": told["replans"],
                    "planning s": told["plan_s"],
                    "CPU s a run": f"{(time.process_time() - begin) / arguments.runs:.1f}",
                }
            )


def loop(course: Problem, share: float, policy: SelectorPolicy | None) -> Ran:
    """One closed loop over a course, in a world that has this share of its friction."""
    has = slippery(course, share)
    world = make_world("mujoco", course.robot, gravity_m_s2=course.gravity_m_s2)
    try:
        report = ClosedLoop(course, Runner(world), policy).run(has.terrain)
    except (PlanningFailed, InvalidInput) as error:
        world.close()
        return Ran(solvable=solved(has), why=f"not begun: {error}")
    return Ran(solvable=solved(has), why=report.message, report=report)


def frames_of(env: TraverseEnv) -> int:
    """Key frames of the course that is walked."""
    assert env._episode is not None
    return env._episode.frames


def shown(share: Share) -> str:
    """Counts and interval."""
    low, high = share.interval
    return f"{share.hits}/{share.of} [{low:.2f}, {high:.2f}]"


def median(values: Sequence[float]) -> str:
    """The median and the interval of order statistics, 95 %; nothing of nothing."""
    some, n = np.sort(np.asarray(values)), len(values)
    if not n:
        return "–"
    below = np.cumsum([comb(n, k) * 0.5**n for k in range(n)])
    low = int((below <= 0.025).sum())  # P(fewer than low below the median) ≤ 2.5 %
    first, last = (some[low - 1], some[n - low]) if low else (some[0], some[-1])
    return f"{np.median(some):.3f} [{first:.3f}, {last:.3f}]"


def ice(rows: list[Row]) -> Iterable[str]:
    """First plans on random ice (docs/learning.md)."""
    return part(rows, "ice", ("found", "CPU s to it", "÷ lift", "by the policy"))


def windows(rows: list[Row]) -> Iterable[str]:
    """Windows of Traverse-v0 (docs/learning.md)."""
    return part(rows, "windows", ("verified", "reached", "CPU s a window", "by the policy"))


def friction(rows: list[Row]) -> Iterable[str]:
    """Closed loops (docs/learning.md)."""
    names = ("friction", "succeeded", "of solvable", "replans", "CPU s a run", "by the policy")
    return part(rows, "way", names)


def part(rows: list[Row], way: str, names: Sequence[str]) -> Iterable[str]:
    """The rows that name their planner so."""
    return markdown(
        ("planner", *names),
        (
            (planner if planner == LIFT else f"{Path(planner).stem}, then the lift", *rest)
            for planner, *rest in (
                [row[name] for name in (way, *names)] for row in rows if way in row
            )
        ),
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__, ice=ice, windows=windows, friction=friction)
