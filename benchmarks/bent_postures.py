"""Postures of the whole body: how many of a class are accepted with joints, torques and bodies,
straight and bent.

    python benchmarks/bent_postures.py [--problem wall-3] [--robot hexapod] [--torque-nm 10]
    [--scenes 150] python benchmarks/bent_postures.py --scenes 300 --steps 1 2 4   # room: what
    fewer steps leave of what all find

Scenes that no lift refutes are answered by the two-stage planner for contacts and forces; its
posture gets joints and the forces that spare them most, with toes, body and joints as they are.
Beside it `plan` with the robot, which bends. Both are judged by the verifier: joints, torques,
bodies, margins. With ``--steps`` the whole body is bent in so many steps at most, too, and room is
what any of these finds less what the one within that budget does, in points.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from _bench import Options, launch

import stancekit
from stancekit.envs.distributions.postures import distribution
from stancekit.learners.evaluation.room import share
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.robot.robot_file import robot_of
from stancekit.planners.search.witness import with_whole_body


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which class and robot, and how many scenes."""

    problem: str = "wall-3"
    robot: str = "hexapod"
    torque_nm: float = 10.0
    scenes: int = 150
    seed: int = 10_000
    steps: tuple[int, ...] = ()


def main(arguments: Arguments) -> None:
    """Measure and print."""
    own = arguments.robot != "hexapod"
    drawn, robot = (
        distribution(arguments.problem, robot=arguments.robot if own else None),
        robot_of(arguments.robot),
    )
    limits = WholeBodyLimits(torque_nm=arguments.torque_nm)
    ways = {
        "straight": 0,
        **{f"steps {count}": count for count in arguments.steps},
        "bent": limits.steps,
    }
    accepted: dict[str, list[bool]] = {name: [] for name in ways}
    seconds, seed, scenes = dict.fromkeys(ways, 0.0), arguments.seed, 0
    while scenes < arguments.scenes:
        problem = drawn.sample(np.random.default_rng(seed))
        seed += 1
        began = time.process_time()
        straight = stancekit.solve(problem, "two-stage")
        if straight.solution is None:
            continue
        scenes += 1
        course = problem.course(robot=robot)
        order = [problem.legs.index(name) for name in course.robot.limb_names]
        found = straight.solution
        plan = replace(
            found, problem=course, toes_m=found.toes_m[order], forces_n=found.forces_n[:, order]
        )
        bare = replace(straight, solution=plan, problem=course)
        for name, steps in ways.items():
            if name == "straight":
                answer = with_whole_body(bare, replace(limits, steps=0))
            else:
                began = time.process_time()
                answer = stancekit.plan(
                    problem,
                    robot=robot,
                    settings=stancekit.PlanSettings(body=replace(limits, steps=steps)),
                )
            seconds[name] += time.process_time() - began
            accepted[name].append(answer.status.value == "feasible")
    union = np.any(list(accepted.values()), axis=0).mean()
    shown: dict[str, float] = {}
    for name, each in accepted.items():
        middle, low, high = share(sum(each), scenes) or (np.nan, np.nan, np.nan)
        shown |= {
            f"{name}, accepted": middle,
            f"{name}, accepted from": low,
            f"{name}, accepted to": high,
        }
        shown[f"{name}, ms"] = 1e3 * seconds[name] / scenes
        if arguments.steps:
            shown[f"{name}, room"] = 100.0 * float(union - np.mean(each))
    arguments.list(shown, problem=arguments.problem, robot=arguments.robot, scenes=scenes)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
