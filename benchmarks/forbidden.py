"""Walks that friction forbids, said at the start, and walks near the limit that are not forbidden.

    python benchmarks/forbidden.py [--json]

20 that no robot can do: ground too steep for the friction, suction too weak for it, a goal on a
bank, ice too wide for the time. 40 that it can, 20 of them within a tenth of a limit. That they are
is shown apart from the argument, by a way of standing or of moving that exists: forces on the
nominal stance that carry the weight, within the cone of true normals and with no moment left, by a
linear program over inscribed pyramids; on level ground, a body that the whole cone pushes half the
time and brakes the other half, over feet that step on below it.

said: of those forbidden, how many; cpu_s: the longest that a sentence took.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import process_time

import numpy as np
from _bench import Options, launch
from scipy.optimize import linprog

from stancekit.planners.gait.forbidden import forbidden
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain

SIDES = 32
"""Of the pyramid within a cone."""
FRONT = (True, True, False, False)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One walk. possible: whether it can be done; near: within a tenth of a limit."""

    kind: str
    task: Walk
    possible: bool
    near: bool = False


def main(options: Options) -> None:
    """Print the table."""
    robot = anymal()
    rows = dict[tuple[str, bool, bool], list[tuple[bool, float, str]]]()
    for case in cases(options.seed):
        if case.possible and not (
            stands(case.task, case.task.start) and stands(case.task, case.task.goal)
        ):
            raise SystemExit(f"{case.kind}: expected forces that carry {robot.name}, found none")
        begin = process_time()
        said = forbidden(case.task, GaitSettings())
        rows.setdefault((case.kind, case.possible, case.near), []).append(
            (bool(said), process_time() - begin, said)
        )
    for (kind, possible, near), found in rows.items():
        row = {
            "kind": kind,
            "possible": possible,
            "near": near,
            "walks": len(found),
            "said": sum(said for said, _, _ in found),
            "cpu_s": max(cpu for _, cpu, _ in found),
            "first": found[0][2],
        }
        options.say(
            row,
            lambda r: (
                f"{r['kind']:38} {'possible' if r['possible'] else 'impossible':10} "
                f"{'near' if r['near'] else '':4} {r['said']:3} of {r['walks']:2} forbidden  "
                f"{r['cpu_s']:6.3f} CPU-s  {r['first']}"
            ),
        )


def cases(seed: int) -> Iterator[Case]:
    """All walks, the impossible ones first."""
    turns = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 20)
    for k, turn in enumerate(turns[:6]):
        yield Case(
            kind="ramp steeper than friction",
            task=on_ramp(0.45 + 0.05 * k, turn, 0.4),
            possible=False,
        )
    for k, turn in enumerate(turns[:4]):
        steep = on_ramp(0.8, turn, 0.3 + 0.05 * k, adhesive=FRONT, suction_n=5.0)
        yield Case(kind="suction too weak for the ramp", task=steep, possible=False)
    for k in range(3):
        bank = task(rising(0.9), 0.4 + 0.1 * k, (-1.2, 0.0), (1.5, 0.0))
        yield Case(kind="level start, goal on a bank", task=bank, possible=False)
    for duration_s in (2.0, 2.5, 3.0, 3.5):
        far = (0.021) * (0.25 * GRAVITY_M_S2 * duration_s**2 + 4.0 * reach_m())
        yield Case(
            kind="ice too wide for the time",
            task=task(level(), 0.001, (0, 0), (1.1 * far, 0.0), duration_s=duration_s),
            possible=False,
        )
    for k, turn in enumerate(turns[:3]):
        far = 1.3 * 0.021 * (0.25 * GRAVITY_M_S2 * 9.0 + 4.0 * reach_m())
        goal = far * np.array([np.cos(turn), np.sin(turn)])
        few = task(level(), 0.001, (0, 0), goal, duration_s=3.0, gait=("walk", "pace", "trot")[k])
        yield Case(kind="ice, another gait and direction", task=few, possible=False)
    for k, turn in enumerate(turns[:14]):
        share = 0.9 + 0.007 * k
        yield Case(
            kind="ramp that friction holds",
            task=on_ramp(share * 0.5, turn, 0.5),
            possible=True,
            near=True,
        )
    for share in (0.9, 0.93, 0.95, 0.97, 0.98, 0.99):
        far = share * 0.05 * 0.25 * GRAVITY_M_S2 * 9.0
        yield Case(
            kind="ice, pushed half the time",
            task=task(level(), 0.05, (0, 0), (far, 0.0), duration_s=3.0),
            possible=True,
            near=True,
        )
    for k, turn in enumerate(turns[:10]):
        yield Case(kind="ramp", task=on_ramp(0.04 * k, turn, 0.6), possible=True)
    for k in range(5):
        yield Case(
            kind="ice, slowly",
            task=task(level(), 0.02, (0, 0), (0.1 + 0.1 * k, 0.0)),
            possible=True,
        )
    ripple = reference_terrain("ripple")
    for k in range(5):
        yield Case(
            kind="ripple", task=task(ripple, 0.75, (0, 0), (0.3 * (k + 1), 0.1 * k)), possible=True
        )


def task(terrain: HeightField, friction: float, start, goal, **more) -> Walk:  # type: ignore[no-untyped-def]
    """ANYmal's walk from here to there."""
    places = {
        "start": np.asarray(start, dtype=float),
        "goal": np.asarray(goal, dtype=float),
    }
    return Walk(robot=anymal(), terrain=terrain, friction=friction, **places, **more)


def on_ramp(slope: float, turn: float, friction: float, **more) -> Walk:  # type: ignore[no-untyped-def]
    """On a plane that rises in one direction."""
    plane = HeightField.from_function(
        lambda x, y: slope * (np.cos(turn) * x + np.sin(turn) * y), 3.0, 0.1, name=f"ramp {slope:g}"
    )
    return task(plane, friction, (0.0, 0.0), (0.4, 0.1), **more)


def level() -> HeightField:
    """Level ground."""
    return HeightField.from_function(lambda x, y: 0.0 * x, 3.0, 0.1, name="level")


def rising(slope: float) -> HeightField:
    """Level, then a bank that does not end, with a bend of 20 cm between."""
    return HeightField.from_function(
        lambda x, y: slope * 0.2 * np.logaddexp(0.0, x / 0.2), 3.0, 0.1, name=f"bank {slope:g}"
    )


def reach_m() -> float:
    """How far the farthest corner of a foot's box is."""
    boxes = (
        np.maximum(np.abs(foot.reach_min_m), np.abs(foot.reach_max_m)) for foot in anymal().feet
    )
    return max(float(np.linalg.norm(box)) for box in boxes)


def stands(asked: Walk, xy: np.ndarray) -> bool:
    """Whether forces on the nominal stance carry the weight with the body above some point between
    the feet.
    """
    feet = asked.stance_m(xy)
    normals = asked.terrain.normal(feet[:, :2])
    edges, arms = list[np.ndarray](), list[np.ndarray]()
    for foot, normal in zip(feet, normals, strict=True):
        first = np.cross(normal, [0.0, 1.0, 0.0])
        first /= np.linalg.norm(first)
        second = np.cross(normal, first)
        for angle in 2.0 * np.pi * np.arange(SIDES) / SIDES:
            edge = normal + asked.friction * (np.cos(angle) * first + np.sin(angle) * second)
            edges.append(edge)
            arms.append(np.cross(foot - feet.mean(axis=0), edge))
    # Σ f = e_z and Σ r × f = c × e_z, whose c_x and c_y are free within 10 cm
    count = len(edges)
    rows = np.zeros((6, count + 2))
    rows[:3, :count], rows[3:, :count] = np.array(edges).T, np.array(arms).T
    rows[3, count + 1], rows[4, count] = -1.0, 1.0
    bounds = [(0.0, None)] * count + [(-0.1, 0.1)] * 2
    return bool(
        linprog(np.zeros(count + 2), A_eq=rows, b_eq=[0, 0, 1, 0, 0, 0], bounds=bounds).status == 0
    )


if __name__ == "__main__":
    launch(main, Options, __doc__)
