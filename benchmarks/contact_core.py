"""One contact core for postures and plans: how fast it plans, plans anew and proves, and what its
proofs are worth.

    # process start to verified file, in pairs
    python benchmarks/contact_core.py start --against ../other-checkout
    python benchmarks/contact_core.py replan     # receding horizon, nothing kept
    # panels of ice: found, proved, open
    python benchmarks/contact_core.py ice --frames 8 --count 200
    # postures that only cuts in space refute
    python benchmarks/contact_core.py cuts --count 80
    # the same posture held over 2 and 3 frames
    python benchmarks/contact_core.py copies --count 12
    # certificates put to other problems
    python benchmarks/contact_core.py foreign --count 5000

CPU times of one process on one thread; a yardstick, 1,000 cold solves of a fixed cone program, is
timed in the same run and stands beside every table. ``--against`` names a checkout of another
version; its command is run in turn with ours.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from _bench import Options, launch
from _checkouts import checkouts, of_checkout
from _yardstick import yardstick

from stancekit.envs.distributions.courses import icy_walls
from stancekit.envs.distributions.postures import DISTRIBUTIONS, distribution
from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_spec
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.pieces import Standing
from stancekit.planners.search.plan_course import replan
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate

ICE, CANDIDATES = 0.55, 3
WINDOWS = 12


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which table, and how much of it."""

    table: Annotated[
        Literal["start", "replan", "ice", "cuts", "copies", "foreign"], tyro.conf.Positional
    ] = "replan"
    count: int = 15
    """Pairs of runs (start), courses (ice), postures a class (cuts, copies), tries (foreign)."""
    frames: int = 30
    """Key frames a course (start, ice), or a window (replan)."""
    courses: tuple[str, ...] = ("walls", "icy-walls")
    """Built-in names or YAML files (start, replan)."""
    against: Path | None = None
    """Another checkout, in which `python setup.py links` was run, whose command is run in turn with
    ours (start)."""
    seed: int = 2026
    time_limit_s: float = 4.0
    """Of a course (ice)."""


def start(options: Arguments) -> Iterator[dict[str, Any]]:
    """Process start to verified file: the whole command, imports included."""
    sides = checkouts(options.against)
    for course in options.courses:
        found: dict[str, list[float]] = {name: [] for name in sides}
        for _ in range(options.count):
            for name, folder in sides.items():
                found[name].append(_command(folder, course, options.frames))
        row: dict[str, Any] = {"course": course, "frames": options.frames, "pairs": options.count}
        row |= {f"{name}_cpu_s": float(np.median(times)) for name, times in found.items()}
        if "before" in found:
            ratios = np.array(found["after"]) / np.array(found["before"])
            row["ratio"] = float(np.median(ratios))
        yield row


def _command(folder: Path, course: str, frames: int) -> float:
    """CPU time [s] of ``stancekit plan`` of one checkout."""
    path = str(Path(course).resolve()) if Path(course).suffix else course
    with tempfile.TemporaryDirectory() as place:
        words = ["-m", "stancekit.cli.main", "plan", path, "--out", str(Path(place) / "plan.json")]
        words += [] if Path(course).suffix else ["--frames", str(frames)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        quiet: dict[str, Any] = {
            "env": of_checkout(folder),
            "cwd": place,
            "capture_output": True,
            "check": False,
        }
        done = subprocess.run([sys.executable, *words], **quiet)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise SystemExit(f"{folder}: {course}: {done.stderr.decode().strip()}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def windows(options: Arguments) -> Iterator[dict[str, Any]]:
    """Re-planning over a horizon: one frame is executed, its toes stay, everything else is new."""
    for name in options.courses:
        spec, horizon = read_spec(name), options.frames - 1
        course = build_course(
            spec if Path(name).suffix else spec.with_frames(options.frames + WINDOWS),
            Path(name).parent,
        )
        horizon = min(horizon, course.frames - WINDOWS // 2 - 2)
        outcome, times, trees = replan(None, course, horizon=horizon), list[float](), 0
        for frame in range(1, WINDOWS + 1):
            if outcome.solution is None:
                break
            state = _reached(outcome.solution)
            begin = time.process_time()
            outcome = replan(state, course, frame=frame, horizon=horizon)
            times.append(time.process_time() - begin)
            trees += outcome.details["nodes"] > 1 or outcome.details["cuts"] > 0
        yield {
            "course": name,
            "horizon": horizon + 1,
            "windows": len(times),
            "with_tree": trees,
            "median_ms": 1e3 * float(np.median(times)),
            "max_ms": 1e3 * max(times),
            "lost": outcome.solution is None,
        }


def _reached(plan: Any) -> Standing:
    """Where the robot stands at the second frame of a plan."""
    return Standing(
        com_m=plan.com_m[1],
        rotation_rad=plan.rotation_rad[1],
        toes_m=plan.toes_at(1),
        patches=tuple(plan.problem.patch(int(p), plan.choice) for p in plan.problem.holds[1]),
    )


def ice(options: Arguments) -> Iterator[dict[str, Any]]:
    """Walls of panels that are ice by a chance of .55, three candidates a toe."""
    planner, rows = (
        TwoStage(time_limit_s=options.time_limit_s),
        list[tuple[str, float]](),
    )
    for index in range(options.count):
        seed = np.random.SeedSequence(options.seed, spawn_key=(options.frames, index))
        course = icy_walls(np.random.default_rng(seed), options.frames, CANDIDATES, ice=ICE)
        begin = time.process_time()
        status = planner.solve(course).status
        rows.append((status.value, time.process_time() - begin))
    counts, times = (
        Counter(status for status, _ in rows),
        np.array([seconds for _, seconds in rows]),
    )
    median, p90, most = np.percentile(times, [50, 90, 100])
    yield {
        "frames": options.frames,
        "courses": options.count,
        "limit_s": options.time_limit_s,
        "found": counts["feasible"],
        "proved": counts["infeasible"],
        "open": counts["undecided"],
        "median_ms": 1e3 * median,
        "p90_ms": 1e3 * p90,
        "max_ms": 1e3 * most,
    }


def refuted(name: str, seed: int) -> Iterator[Problem]:
    """Natural draws whose infeasibility takes cuts in space."""
    rng, exact, source = np.random.default_rng(seed), Exact(), distribution(name)
    while True:
        problem = source.sample(rng)
        outcome = exact.solve(problem)
        if (
            outcome.status is Status.INFEASIBLE
            and not outcome.details["trivial"]
            and outcome.details["nodes"] > 1
        ):
            yield problem


def cuts(options: Arguments, frames: tuple[int, ...] = (1,)) -> Iterator[dict[str, Any]]:
    """Postures that cuts refute, as courses: refuted, certificates accepted, and the time beside
    the posture's.
    """
    for name in DISTRIBUTIONS:
        for copies in frames:
            exact, planner = Exact(), TwoStage()
            statuses, accepted, posture_s, course_s = (
                Counter[str](),
                0,
                list[float](),
                list[float](),
            )
            for problem, _ in zip(refuted(name, options.seed), range(options.count), strict=False):
                course = repeated(problem.course(), copies)
                begin = time.process_time()
                exact.solve(problem)
                middle = time.process_time()
                outcome = planner.solve(course)
                course_s.append(time.process_time() - middle)
                posture_s.append(middle - begin)
                statuses[outcome.status.value] += 1
                if outcome.certificate is not None:
                    accepted += check_certificate(outcome.certificate).accepted
            yield {
                "class": name,
                "frames": copies,
                "postures": options.count,
                "seed": options.seed,
                **statuses,
                "accepted": accepted,
                "posture_ms": 1e3 * float(np.median(posture_s)),
                "median_ms": 1e3 * float(np.median(course_s)),
                "max_ms": 1e3 * max(course_s),
            }


def repeated(course: Problem, frames: int) -> Problem:
    """The first frame of a course, held for so many frames."""
    return replace(
        course,
        lifts=((),) * frames,
        com_nominal_m=np.repeat(course.com_nominal_m[:1], frames, axis=0),
        com_radius_m=np.repeat(course.com_radius_m[:1], frames),
    )


def foreign(options: Arguments) -> Iterator[dict[str, Any]]:
    """Certificates put to problems that have a posture: other problems, or trees and multipliers
    that were changed.
    """
    for name in DISTRIBUTIONS:
        rng, exact, source = np.random.default_rng(options.seed), Exact(), distribution(name)
        feasible, proofs = list[Problem](), list[Certificate]()
        while len(feasible) < 60 or len(proofs) < 20:
            problem = source.sample(rng)
            outcome = exact.solve(problem)
            if outcome.certificate is not None:
                proofs.append(outcome.certificate)
            elif outcome.status is Status.FEASIBLE:
                feasible.append(problem)
        accepted = 0
        for _ in range(options.count):
            proof, problem = (
                proofs[rng.integers(len(proofs))],
                feasible[rng.integers(len(feasible))],
            )
            accepted += check_certificate(_changed(proof, rng).of(problem), tolerance=0.0).accepted
        yield {"class": name, "tries": options.count, "accepted": accepted}


def _changed(proof: Certificate, rng: np.random.Generator) -> Certificate:
    """The certificate as it is, or with noise on its multipliers, a scale on some, or an entry of
    its tree moved.
    """
    tree, multipliers = proof.tree.copy(), proof.multipliers.copy()
    kind = rng.integers(4)
    if kind == 1:
        multipliers += rng.normal(scale=10.0 ** rng.uniform(-6, 0), size=multipliers.shape)
    elif kind == 2:
        multipliers[:, rng.integers(multipliers.shape[1])] *= rng.normal() * 10.0
    elif kind == 3:
        tree[rng.integers(len(tree)), rng.integers(5)] += rng.choice([-1.0, 1.0, 0.3])
    return Certificate(tree=tree, multipliers=multipliers)


TABLES: dict[str, Callable[[Arguments], Iterator[dict[str, Any]]]] = {
    "start": start,
    "replan": windows,
    "ice": ice,
    "cuts": cuts,
    "foreign": foreign,
    "copies": lambda options: cuts(options, (2, 3)),
}


def main(options: Arguments) -> None:
    """Print the table and the yardstick."""
    options.say({"yardstick_cpu_s": round(yardstick(), 3)})
    for row in TABLES[options.table](options):
        options.say(
            {
                name: round(value, 3) if isinstance(value, float) else value
                for name, value in row.items()
            }
        )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
