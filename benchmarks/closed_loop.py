"""The closed loop where the world is not as planned: less friction, moved walls, a missing patch, a
push.

    python benchmarks/closed_loop.py [--courses walls …] [--wrong friction moved missing pushed]
    [--shares 1 0.7 0.5]
        [--moved-m 0.02] [--moved-deg 1] [--push 0.4] [--count 5] [--first 1] [--seed 0] [--world
        mujoco] [--amount 1] [--replan-m 0.012] [--no-reserve] [--modes once anew anew-unlearned]
        [--late] [--json]

The first course is the built-in one, the others have other heights, distances, leans, friction and
panels (``distributions.courses.perturbed``, --amount); they are planned with the friction that they
say. --wrong says what the world has instead: "friction": only a share of it, everywhere, from the
start, or (--late, in MuJoCo) from a random time of the run on, between 0.5 and 12 s. "moved": every
plane is up to --moved-m nearer or farther along its normal, and turned by up to --moved-deg about
an axis in it, but for where feet stand at first. "missing": nothing is there within 4 cm of one of
the places where a foot should come down. "pushed": a force of half to all of --push of the weight,
from anywhere, on the body for .1 to .3 s, between 0.5 and 12 s.

"once" follows the first plan to its end; "anew" stops where feet slide, presses harder, puts down
what is in the air, and plans the rest again from there, with the friction that feet felt; it takes
a step back that came down on nothing and plans again without that place, and plans again, too,
where body or feet are farther than --replan-m from the plan, with surfaces where feet find them.
"anew-unlearned" does so, too, but does not estimate the friction. All three run the same courses
and the same first plans. A run is a success where all key frames were reached, nothing stopped it,
and the centre of mass ended within 3 cm of its last plan's. "stood": of those that were none, how
many stopped with the body at rest; the others fell. Plans keep a reserve of friction where there is
one (``search.friction_margin``); --no-reserve plans with all of it.

The simulated world stands still while a plan is made: times of planning are told beside, not lived
through.

"solvable" is how many courses the planner finds a plan for when it is told what there is (with no
reserve): what no loop can be expected to exceed by much. "of those" counts successes among them.
The interval is Wilson's, 95 %.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from _bench import Options, launch
from _perturbed import Perturbed, missing, moved, pushed

from stancekit.envs.distributions.courses import perturbed
from stancekit.learners.evaluation.evaluate import Share
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.friction_margin import SHARES, plan_with_reserve, slippery
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.search.witness import with_whole_body
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.closed_loop import ClosedLoop, LoopReport
from stancekit.runner.run import Runner
from stancekit.runner.settings import LoopSettings
from stancekit.runner.worlds.world import JointBus, make_world
from tests.emulators.slipping import SlippingWorld

LATE_S = (0.5, 12.0)
REST_M_S = 0.05
ENDS = ("share", "low", "high")


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which courses, how many, in which world, and what of it is wrong."""

    courses: tuple[str, ...] = ("walls",)
    wrong: tuple[Literal["friction", "moved", "missing", "pushed"], ...] = ("friction",)
    shares: tuple[float, ...] = (1.0, 0.7, 0.5)
    moved_m: float = 0.02
    moved_deg: float = 1.0
    push: float = 0.4
    modes: tuple[Literal["once", "anew", "anew-unlearned"], ...] = (
        "once",
        "anew",
        "anew-unlearned",
    )
    world: str = "mujoco"
    count: int = 5
    first: int = 0
    amount: float = 1.0
    replan_m: float = LoopSettings.replan_m
    late: bool = False
    reserve: bool = True


@dataclass(frozen=True, kw_only=True)
class Ran:
    """One run. solvable: with what there is. why: it was not begun, or no success. stood: the body
    was at rest.
    """

    solvable: bool
    why: str
    stood: bool = True
    report: LoopReport | None = None


def main(arguments: Arguments) -> None:
    """Measure and print."""
    if arguments.late and arguments.world != "mujoco":
        raise SystemExit("--late: only in mujoco")
    cells = [
        (wrong, share)
        for wrong in arguments.wrong
        for share in (arguments.shares if wrong == "friction" else (1.0,))
    ]
    for name in arguments.courses:
        indices = range(arguments.first, arguments.first + arguments.count)
        begun = [
            first_plan(course_of(name, arguments.seed, index, arguments.amount), arguments)
            for index in indices
        ]
        for wrong, share in cells:
            for mode in arguments.modes:
                plans = zip(indices, begun, strict=True)
                runs = [ran(plan, index, wrong, share, mode, arguments) for index, plan in plans]
                head = {
                    "course": name,
                    "wrong": wrong,
                    "friction_share": share,
                    "mode": mode,
                    "world": arguments.world,
                }
                arguments.say(head | {"late": arguments.late} | summary(runs), line)
                for index, run in zip(indices, runs, strict=True):
                    if run.why and not arguments.json:
                        unsolvable = "" if run.solvable else " (not solvable)"
                        print(f"    {index}: {run.why}{unsolvable}", flush=True)


def first_plan(course: Problem, arguments: Arguments) -> Accepted | str:
    """What is begun with, the same for all that is wrong; why there is none."""
    shares = SHARES if arguments.reserve else (1.0,)
    outcome = plan_with_reserve(TwoStage(), course, shares, presses=())
    if outcome.solution is None:
        return f"not begun: {outcome.message or outcome.status.value}"
    why = ""
    for bent in (False, True):  # where bodies collide, as the loop does it
        found = with_whole_body(outcome).solution if bent else outcome.solution
        try:
            accepted = Accepted.verified(found or outcome.solution, course.name)
            with make_world(
                arguments.world, course.robot, gravity_m_s2=course.gravity_m_s2
            ) as world:
                Runner(world).prepare(accepted)
            return accepted
        except InvalidInput as error:
            why = f"not begun: {error}"
    return why


def ran(
    plan: Accepted | str, index: int, wrong: str, share: float, mode: str, arguments: Arguments
) -> Ran:
    """One run of one course in one world."""
    if isinstance(plan, str):
        return Ran(solvable=False, why=plan)
    course, rng = plan.plan.problem, np.random.default_rng([arguments.seed, index, 1])
    settings = settings_of(mode, arguments.replan_m, SHARES if arguments.reserve else (1.0,))
    has, world = Perturbed(terrain=course.terrain, course=slippery(course, share)), None
    if wrong == "moved":
        has = moved(plan.plan, rng, arguments.moved_m, np.deg2rad(arguments.moved_deg))
    elif wrong == "missing":
        has = missing(plan.plan, rng)
    elif wrong == "pushed":
        has = pushed(plan.plan, rng, arguments.push)
    elif arguments.late:
        world = losing(course, share, float(rng.uniform(*LATE_S)))
    else:
        has = Perturbed(terrain=has.course.terrain, course=has.course)
    world = world or make_world(
        arguments.world,
        course.robot,
        gravity_m_s2=course.gravity_m_s2,
        imperfections=has.imperfections,
    )
    solvable, runner = solved(has.course), Runner(world)
    try:
        report = ClosedLoop(course, runner, settings=settings).run(has.terrain, first=plan)
    except (PlanningFailed, InvalidInput) as error:
        world.close()
        return Ran(solvable=solvable, why=f"not begun: {error}")
    stood = runner.state is not None and float(np.linalg.norm(runner.state.velocity[:3])) < REST_M_S
    return Ran(solvable=solvable, why=report.message, stood=stood, report=report)


def course_of(name: str, seed: int, index: int, amount: float) -> Problem:
    """The course of one index, the same for every share and mode; the first is not perturbed."""
    if index == 0:
        return read_course(name)
    return perturbed(name, np.random.default_rng([seed, index]), amount=amount)


def settings_of(mode: str, replan_m: float, shares: tuple[float, ...]) -> LoopSettings:
    """The loop of one mode."""
    if mode == "once":
        return LoopSettings(replan_m=float("inf"), shares=shares)
    return LoopSettings(replan_m=replan_m, shares=shares, learn_friction=mode == "anew")


def solved(course: Problem) -> bool:
    """Whether the planner finds a plan."""
    return TwoStage().solve(course).solution is not None


def losing(course: Problem, share: float, at_s: float) -> JointBus:
    """A world that has this share of the friction from a time on."""
    world = SlippingWorld(course.robot, share=share, gravity_m_s2=course.gravity_m_s2)
    world.inject("friction differs", at_s)
    return world


def summary(runs: Sequence[Ran]) -> dict[str, Any]:
    """Counts, and medians of the runs that were begun."""
    begun = [run.report for run in runs if run.report is not None]
    good = sum(report.succeeded for report in begun)
    solvable = [run for run in runs if run.solvable and run.report is not None]

    def median(key: Callable[[LoopReport], float]) -> float | None:
        return float(np.median([key(report) for report in begun])) if begun else None

    slid = [report.friction for report in begun if report.friction.slides]
    return {
        "runs": len(begun),
        "refused": len(runs) - len(begun),
        "succeeded": good,
        "interval": Share(hits=good, of=len(begun)).interval if begun else (0.0, 1.0),
        "solvable": len(solvable),
        "of_solvable": sum(not run.why for run in solvable),
        "stood": sum(run.stood for run in runs if run.why and run.report is not None),
        "replans": median(lambda report: report.replans),
        "frames": median(lambda report: report.frames),
        "slid": len(slid),
        "friction": [float(np.median([getattr(each, end) for each in slid])) for end in ENDS]
        if slid
        else None,
        "deviation_mm": median(lambda report: 1e3 * report.deviation_m),
        "seconds": median(lambda r: r.seconds),
        "plan_s": median(lambda report: report.plan_s),
    }


def line(record: dict[str, Any]) -> str:
    """A record for people."""
    low, high = record["interval"]
    what = (
        f"friction × {record['friction_share']:g}"
        if record["wrong"] == "friction"
        else record["wrong"]
    )
    text = f"{record['course']:15s} {what:16s}{record['mode']:15s} {record['succeeded']}/{record['runs']} "
    text += (
        f"[{low:.2f}, {high:.2f}], solvable {record['solvable']}, of those {record['of_solvable']}"
    )
    if record["runs"]:
        text += f"; stood {record['stood']} of the rest; replans {record['replans']:g}"
        if record["friction"]:
            share, least, most = record["friction"]
            text += f", {record['slid']} slid: × {share:.2f} [{least:.2f}, {most:.2f}]"
        text += (
            f", off by {record['deviation_mm']:.0f} mm, planning {record['plan_s']:.1f} s of {record['seconds']:.1f} s "
            "of motion"
        )
    return text + (f"; {record['refused']} refused" if record["refused"] else "")


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
