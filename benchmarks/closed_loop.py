"""The closed loop on courses with less friction than was planned with: planning anew against the first plan alone.

    python benchmarks/closed_loop.py [--courses walls …] [--shares 1 0.7 0.5] [--count 5] [--seed 0] [--world mujoco]
        [--amount 1] [--replan-m 0.012] [--no-reserve] [--modes once anew anew-unlearned] [--late] [--json]

The first course is the built-in one, the others have other heights, distances, leans, friction and panels
(``distributions.courses.perturbed``, --amount); they are planned with the friction that they say. The world has only a
share of that, everywhere, from the start, or (--late, in MuJoCo) from a random time of the run on, between 0.5 and
12 s. "once" follows the first plan to its end; "anew" stops where feet slide, presses harder, puts down what is in the
air, and plans the rest again from there, with the friction that those feet felt; it plans again, too, where body or
feet are farther than --replan-m from the plan. "anew-unlearned" does so, too, but does not estimate the friction. All
three run the same courses and the same first plans. A run is a success where all key frames were reached, nothing
stopped it, and the centre of mass ended within 3 cm of its last plan's.
Plans keep a reserve of friction where there is one (``search.friction_margin``); --no-reserve plans with all of it.

The simulated world stands still while a plan is made: times of planning are told beside, not lived through.

"solvable" is how many courses the planner finds a plan for when it is told the true friction (with no reserve): what
no loop can be expected to exceed by much. The interval is Wilson's, 95 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from _bench import Options, launch

from stancekit.envs.distributions.courses import perturbed
from stancekit.learners.evaluation.evaluate import Share
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.problem.course import Course
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.friction_margin import SHARES, slippery
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.planners.terrain import Patch
from stancekit.runner.control.closed_loop import ClosedLoop, LoopReport, LoopSettings
from stancekit.runner.run import Runner
from stancekit.runner.worlds import make_world
from stancekit.runner.worlds.world import World
from tests.emulators.slipping import SlippingWorld

LATE_S = (0.5, 12.0)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which courses, how slippery, and which loops."""

    courses: tuple[str, ...] = ("walls",)
    shares: tuple[float, ...] = (1.0, 0.7, 0.5)
    modes: tuple[Literal["once", "anew", "anew-unlearned"], ...] = ("once", "anew", "anew-unlearned")
    world: str = "mujoco"
    count: int = 5
    amount: float = 1.0
    replan_m: float = LoopSettings.replan_m
    late: bool = False
    reserve: bool = True


def main(arguments: Arguments) -> None:
    """Measure and print."""
    if arguments.late and arguments.world != "mujoco":
        raise SystemExit("--late: only in mujoco")
    shares = SHARES if arguments.reserve else (1.0,)
    for name in arguments.courses:
        refused = dict[int, str]()  # what cannot be begun cannot be begun with any friction under it
        courses = [course_of(name, arguments.seed, index, arguments.amount) for index in range(arguments.count)]
        for share in arguments.shares:
            solvable = sum(solved(slippery(course, share)) for course in courses)
            for mode in arguments.modes:
                settings = settings_of(mode, arguments.replan_m, shares)
                runs = list[LoopReport | str]()
                for index, course in enumerate(courses):
                    at_s = float(np.random.default_rng([arguments.seed, index, 1]).uniform(*LATE_S))
                    world = losing(course, share, at_s) if arguments.late else plain(course, arguments.world)
                    terrain = course.terrain if arguments.late else slippery(course, share).terrain
                    runs.append(refused.get(index) or walked(course, terrain, settings, world))
                    if isinstance(runs[-1], str):
                        refused[index] = runs[-1]
                record = {
                    "course": name,
                    "friction": share,
                    "mode": mode,
                    "world": arguments.world,
                    "late": arguments.late,
                }
                record |= {"solvable": solvable} | summary(runs)
                arguments.say(record, line)
                for index, run in enumerate(runs):
                    if (why := run if isinstance(run, str) else run.message) and not arguments.json:
                        print(f"    {index}: {why}", flush=True)


def course_of(name: str, seed: int, index: int, amount: float) -> Course:
    """The course of one index, the same for every share and mode; the first is not perturbed."""
    if index == 0:
        return read_course(name)
    return perturbed(name, np.random.default_rng([seed, index]), amount=amount)


def settings_of(mode: str, replan_m: float, shares: tuple[float, ...]) -> LoopSettings:
    """The loop of one mode."""
    if mode == "once":
        return LoopSettings(replan_m=float("inf"), shares=shares)
    return LoopSettings(replan_m=replan_m, shares=shares, learn_friction=mode == "anew")


def solved(course: Course) -> bool:
    """Whether the planner finds a plan."""
    return TwoStageCoursePlanner().solve(course).plan is not None


def plain(course: Course, name: str) -> World:
    """A world by its name."""
    return make_world(name, course.robot, gravity_m_s2=course.gravity_m_s2)


def losing(course: Course, share: float, at_s: float) -> World:
    """A world that has this share of the friction from a time on."""
    world = SlippingWorld(course.robot, share=share, gravity_m_s2=course.gravity_m_s2)
    world.inject("friction differs", at_s)
    return world


def walked(course: Course, terrain: Sequence[Patch], settings: LoopSettings, world: World) -> LoopReport | str:
    """One run; why there was none where nothing could be run at all."""
    try:
        return ClosedLoop(course, Runner(world), settings=settings).run(terrain)
    except (PlanningFailed, InvalidInput) as error:
        world.close()
        return f"not begun: {error}"


def summary(runs: Sequence[LoopReport | str]) -> dict[str, Any]:
    """Counts, and medians of the runs that were begun."""
    begun = [run for run in runs if not isinstance(run, str)]
    good = sum(run.succeeded for run in begun)

    def median(key: str) -> float | None:
        return float(np.median([getattr(run, key) for run in begun])) if begun else None

    return {
        "runs": len(begun), "refused": len(runs) - len(begun), "succeeded": good,
        "interval": Share(hits=good, of=len(begun)).interval if begun else (0.0, 1.0),
        "replans": median("replans"), "share_estimated": median("friction_share"), "frames": median("frames"),
        "deviation_mm": None if not begun else 1e3 * (median("deviation_m") or 0.0), "seconds": median("seconds"),
        "plan_s": median("plan_s"),
    }  # fmt: skip


def line(record: dict[str, Any]) -> str:
    """A record for people."""
    low, high = record["interval"]
    text = f"{record['course']:15s} friction × {record['friction']:<5g}{record['mode']:15s} "
    text += f"{record['succeeded']}/{record['runs']} [{low:.2f}, {high:.2f}], solvable {record['solvable']}"
    if record["runs"]:
        text += (
            f"; replans {record['replans']:g}, estimated × {record['share_estimated']:.2f}, off by "
            f"{record['deviation_mm']:.0f} mm, planning {record['plan_s']:.1f} s of {record['seconds']:.1f} s of motion"
        )
    return text + (f"; {record['refused']} refused" if record["refused"] else "")


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
