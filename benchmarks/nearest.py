"""Warm starts from the K nearest solved problems, for MICP and for complementarity constraints, beside
the two-stage planner and the exact one (after the abstract of Lin, Frontiers in Robotics and AI 12,
January 2026, doi 10.3389/frobt.2025.1656564).

    python benchmarks/nearest.py [--problem wall-3] [--postures 100] [--solved 200] [--frames 1 4 8]
    [--courses 20] [--solved-courses 30] [--near 5] [--cold 5] [--limit-s 10] [--seed 0] [--json]

Written anew: of the paper its abstract and the first page were read, of its code nothing. Its
problems have binaries and products. Here the products are the moments; the binaries are the patch
that every toe takes (key frames of `icy-walls`, four candidates each), and in MICP the cell of a grid
of 4 intervals in which every p_j and f_k lies.

micp: HiGHS, the first point, from nothing (--cold problems of each size, it is slow). micp, near:
patches and cells of the K nearest solved problems, nearest first; all binaries being fixed, what is
left is convex (P1 over the cells as boxes), and the first that has an answer is projected and
verified. mpcc: IPOPT, true products, shares z of patches in [0, 1] with Σ z (1 − z) ≤ ε, ε first 0.1
and then 0.001, from the middle of everything. mpcc, near: the same from the points of the K nearest.
Postures of --problem have one patch per toe, so that no complementarity is left in theirs.

Problems are compared by middle, normal and friction of their patches, each in units of its
deviation over the solved ones. Known courses are solved by the two-stage planner, known postures by
the exact one. Success: the verifier accepts. Times: CPU seconds per problem without
compiling, all tries of a method together (the slowest 95 %, too), and of those that succeeded the median objective over that
of the exact planner.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as cs
import numpy as np
from _bench import Options, Row, cell, launch, markdown
from scipy.optimize import nnls

from stancekit import Answer, Motion, Status
from stancekit.envs.distributions.courses import perturbed
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.learners.evaluation.evaluate import Share
from stancekit.planners.equilibrium.layout import Layout
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Point, Scaled, cones_met
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.projection.nlp import CONVERGED
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick, domain_of
from stancekit.planners.search.answer import Acceptance, Clock, plan_of
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.micp import Micp
from stancekit.planners.search.two_stage import TwoStage

INTERVALS = 4
"""Of the grid, per p_j and f_k."""
RELAXED = (0.1, 1e-3)
"""ε of the complementarity constraints, one solve after the other."""
OPTIONS = 8
"""Most candidates of a toe that are compared."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which problems, and how many are solved before."""

    problem: str = "wall-3"
    postures: int = 100
    solved: int = 200
    frames: tuple[int, ...] = (1, 4, 8)
    courses: int = 20
    solved_courses: int = 30
    course: str = "icy-walls"
    near: int = 5
    cold: int = 5
    limit_s: float = 10.0
    """Time limit of MICP from nothing, and of the exact planner per course, by the clock; what the
    latter has then is what objectives are held against."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """A solved problem: its features, patches and point."""

    features: Array
    choice: Array
    point: Point
    cells: Array
    """Number of the interval of every p_j and f_k, shape (B, 6)."""


def main(arguments: Arguments) -> None:
    """Measure and print."""
    rng = np.random.default_rng(arguments.seed)
    if arguments.postures:
        draw = partial(DISTRIBUTIONS[arguments.problem].sample, rng)
        counts = (arguments.solved, arguments.postures)
        exact, quick = Exact(), TwoStage()
        for row in measured(draw, counts, exact, quick, exact, arguments):
            arguments.say({"problems": arguments.problem, **row})
    for frames in arguments.frames:
        draw = partial(drawn_course, arguments.course, frames, rng)
        counts = (arguments.solved_courses, arguments.courses)
        exact, teacher = (
            Exact(time_limit_s=arguments.limit_s),
            TwoStage(),
        )
        for row in measured(draw, counts, exact, TwoStage(), teacher, arguments):
            arguments.say({"problems": f"{arguments.course}, M = {frames}", **row})


def drawn_course(name: str, frames: int, rng: np.random.Generator) -> Problem:
    """A perturbed course."""
    return perturbed(name, rng, frames=frames)


def measured(
    draw: Callable[[], Problem],
    counts: tuple[int, int],
    exact: Any,
    quick: Any,
    teacher: Any,
    its: Arguments,
) -> Iterator[Row]:
    """One row per method, on problems that the exact planner has an answer to; teacher: solves
    those that are known.
    """
    known, asked, exact_s = list[Known](), list[tuple[Problem, Answer[Motion]]](), list[float]()
    while len(known) < counts[0]:
        problem = draw()
        answer = teacher.solve(problem)
        if answer.status is Status.FEASIBLE:
            known.append(of(problem, answer))
    while len(asked) < counts[1]:
        problem = draw()
        began = time.process_time()
        answer = exact.solve(problem)
        seconds = time.process_time() - began
        if answer.status is Status.FEASIBLE:
            asked.append((problem, answer))
            exact_s.append(seconds)
    yield row("exact", [(True, s, 1.0) for s in exact_s])
    programs, solvers = Programs(), dict[Layout, Complementary]()
    cold = Micp(intervals=INTERVALS, time_limit_s=its.limit_s)
    ways: dict[str, Callable[[Problem], Answer[Motion] | None]] = {
        "two-stage": quick.solve,
        "micp": cold.solve,
        "micp, near": partial(by_cells, programs, known, its.near),
        "mpcc": partial(by_points, programs, solvers, (), 1),
        "mpcc, near": partial(by_points, programs, solvers, known, its.near),
    }
    for name, way in ways.items():
        way(asked[0][0])  # compiles
        if name.startswith("mpcc"):
            for problem, _ in asked:
                solver_of(solvers, Scaled.of(problem))
        found = list[tuple[bool, float, float]]()
        for problem, best in asked[: its.cold] if name == "micp" else asked:
            began = time.process_time()
            answer = way(problem)
            seconds = time.process_time() - began
            good = answer is not None and answer.status is Status.FEASIBLE
            ratio = float("nan")
            if good and answer is not None and best.objective > 1e-6:
                ratio = answer.objective / best.objective
            found.append((good, seconds, ratio))
        yield row(name, found)


def row(name: str, found: Sequence[tuple[bool, float, float]]) -> Row:
    """Figures of a method."""
    share = Share(hits=sum(good for good, *_ in found), of=len(found))
    ratios = [ratio for _, _, ratio in found if np.isfinite(ratio)]
    seconds = [each for _, each, _ in found]
    return {
        "method": name,
        "success": share.hits,
        "of": share.of,
        "interval": [round(each, 3) for each in share.interval],
        "cpu_ms": round(1e3 * float(np.median(seconds)), 1),
        "p95_ms": round(1e3 * float(np.quantile(seconds, 0.95)), 1),
        "objective": round(float(np.median(ratios)), 4) if ratios else None,
    }


def of(problem: Problem, answer: Answer[Motion]) -> Known:
    """A solved problem as one to start from."""
    plan = answer.solution
    assert plan is not None
    scaled = Scaled.of(problem)
    choice = scaled.numbers if problem.is_posture else np.asarray(plan.choice)
    chosen = scaled.chosen(choice)
    stance, limb, _ = chosen.layout.contacts
    world = plan.forces_n[stance, limb] / chosen.force_n
    forces = np.matmul(chosen.contact_frames.transpose(0, 2, 1), world[..., None])[..., 0]
    point = Point(
        com=plan.com_m / chosen.length_m,
        rotation=np.asarray(plan.rotation_rad),
        toes=plan.toes_m / chosen.length_m,
        forces=forces,
        residual=0.0,
    )
    domain = domain_of(chosen)
    width = np.maximum(domain.high - domain.low, 1e-9) / INTERVALS
    cells = np.floor((at(chosen, point) - domain.low) / width)
    return Known(
        features=features(scaled),
        choice=choice,
        point=point,
        cells=np.clip(cells, 0, INTERVALS - 1),
    )


def at(chosen: Scaled, point: Point) -> Array:
    """[p, f] of every stance contact, shape (B, 6)."""
    stance, _, foothold = chosen.layout.contacts
    frame = chosen.layout.stance_frames[stance]
    return np.hstack([point.toes[foothold] - point.com[frame], point.forces])


def features(scaled: Scaled) -> Array:
    """Middle, normal and friction of every candidate patch, zeros where a toe has fewer."""
    table = np.zeros((scaled.layout.footholds, OPTIONS, 7))
    places = scaled.layout.candidate_footholds, scaled.numbers
    middles = np.array([piece.mean(axis=0) for piece in scaled.pieces])
    table[places] = np.column_stack([middles, scaled.frames[:, :, 0], scaled.friction])
    return table.ravel()


def nearest_of(known: Sequence[Known], scaled: Scaled, count: int) -> list[Known]:
    """The nearest solved problems, nearest first."""
    table = np.array([one.features for one in known])
    deviation = np.maximum(table.std(axis=0), 1e-6)
    away = np.linalg.norm((table - features(scaled)) / deviation, axis=1)
    return [known[int(k)] for k in np.argsort(away, kind="stable")[:count]]


def accepted(
    programs: Programs, problem: Problem, scaled: Scaled, choice: Array, start: Point, method: str
) -> Answer[Motion] | None:
    """The verified plan that a point projects to, None where there is none."""
    chosen = scaled.chosen(choice)
    point = project(programs, "scp", chosen, start)
    if not np.isfinite(point.residual):
        return None
    answer = Acceptance().answer(
        problem, plan=plan_of(problem, scaled, choice, point), method=method, clock=Clock.start()
    )
    return answer if answer.status is Status.FEASIBLE else None


def by_cells(
    programs: Programs, known: Sequence[Known], near: int, problem: Problem
) -> Answer[Motion] | None:
    """MICP with all binaries from a neighbour, the next one where it has no answer."""
    scaled = Scaled.of(problem)
    for one in nearest_of(known, scaled, near):
        choice = scaled.numbers[patches_of(scaled, one)]
        chosen = scaled.chosen(choice)
        domain = domain_of(chosen)
        width = (domain.high - domain.low) / INTERVALS
        low = domain.low + one.cells * width
        program = programs.get(McCormick, chosen.layout, "contact", problem.is_posture)
        relaxed = program.solve(chosen, Envelope(low=low, high=low + np.maximum(width, 0.0)))
        if not relaxed.known or not relaxed.feasible or relaxed.point is None:
            continue
        start = relaxed.point
        answer = accepted(programs, problem, scaled, choice, start, "micp, near")
        if answer is not None:
            return answer
    return None


def by_points(
    programs: Programs,
    solvers: dict[Layout, Complementary],
    known: Sequence[Known],
    near: int,
    problem: Problem,
) -> Answer[Motion] | None:
    """Complementarity constraints from a neighbour's point, the next one where IPOPT fails; from the
    middle of everything without neighbours.
    """
    scaled = Scaled.of(problem)
    solver = solver_of(solvers, scaled)
    starts = [middle(scaled)]
    if known:
        starts = [beginning(scaled, one) for one in nearest_of(known, scaled, near)]
    for start in starts:
        found = solver.solve(scaled, start)
        if found is None:
            continue
        choice, point = found
        answer = accepted(programs, problem, scaled, choice, point, "mpcc")
        if answer is not None:
            return answer
    return None


def solver_of(solvers: dict[Layout, Complementary], scaled: Scaled) -> Complementary:
    """The program of a problem's layout, compiled where it is not there."""
    if scaled.layout not in solvers:
        solvers[scaled.layout] = Complementary(scaled.layout, scaled.weights is not None)
    return solvers[scaled.layout]


class Complementary:
    """The program of one layout: shares of patches and true products, ε a parameter.

    x = (c, Θ, λ, f), a force per stance contact and candidate; rows as in ``projection.nlp``, and
    beside them f_n ≤ z f_max and Σ z (1 − z) ≤ ε per foothold. Reach is that of balls.
    """

    def __init__(self, layout: Layout, aims: bool) -> None:
        assert not layout.reach_rows
        assert not layout.loaded
        self.layout, frames = layout, layout.frames
        contact, candidate = layout.contact_candidates
        vertices, candidates = len(layout.vertex_footholds), len(layout.candidate_footholds)
        data = {
            "vertices": cs.SX.sym("vertices", 3, vertices),
            "frames": cs.SX.sym("frames", 3, 3 * candidates),
            "friction": cs.SX.sym("friction", candidates),
            "most": cs.SX.sym("most", len(layout.contacts[0])),
            "com": cs.SX.sym("com0", 3, frames),
            "numbers": cs.SX.sym("numbers", 5 + frames),
            "shoulders": cs.SX.sym("shoulders", 3, layout.limbs),
            "reach": cs.SX.sym("reach", layout.limbs),
            "direction": cs.SX.sym("direction", 3, frames - 1),
            "progress": cs.SX.sym("progress", frames - 1),
            "goal": cs.SX.sym("goal", 3),
            "aim": cs.SX.sym("aim", 4),
        }
        weight, epsilon = data["numbers"][0], data["numbers"][1]
        com, turn = cs.SX.sym("c", 3, frames), cs.SX.sym("t", 3, frames)
        shares, forces = cs.SX.sym("l", vertices), cs.SX.sym("f", 3, len(contact))
        z = [
            cs.sum1(shares[np.flatnonzero(layout.vertex_candidates == k).tolist()])
            for k in range(candidates)
        ]
        toes = [
            data["vertices"][:, under] @ shares[under]
            for p in range(layout.footholds)
            for under in [np.flatnonzero(layout.vertex_footholds == p).tolist()]
        ]
        borne = [cs.SX.zeros(3) for _ in layout.contacts[0]]
        rows = list[Any]()
        for n, (b, k) in enumerate(zip(contact.tolist(), candidate.tolist(), strict=True)):
            f = forces[:, n]
            borne[b] += data["frames"][:, 3 * k : 3 * k + 3] @ f
            rows += [
                cs.sumsqr(f[1:]) - (data["friction"][k] * f[0]) ** 2,
                f[0] - z[k] * data["most"][b],
            ]
        net = [cs.vertcat(0, 0, -weight) for _ in layout.stances]
        moment = [cs.SX.zeros(3) for _ in layout.stances]
        for b, (s, _, p) in enumerate(zip(*(x.tolist() for x in layout.contacts), strict=True)):
            net[s] += borne[b]
            moment[s] += cs.cross(toes[p] - com[:, layout.stances[s][0]], borne[b])
        equal = [sum(z[k] for k in where) - 1 for where in of_footholds(layout)]
        equal += [*net, *moment]
        for where in of_footholds(layout):
            if len(where) > 1:
                rows.append(sum(z[k] * (1 - z[k]) for k in where) - epsilon)
        for k in range(frames):
            rows.append(cs.sumsqr(com[:, k] - data["com"][:, k]) - data["numbers"][5 + k] ** 2)
            for i in range(layout.limbs):
                v = data["shoulders"][:, i]
                leg = toes[layout.holds[k][i]] - com[:, k] - v - cs.cross(turn[:, k], v)
                rows.append(cs.sumsqr(leg) - data["reach"][i] ** 2)
        steps = data["numbers"][2:5]
        for k in range(frames - 1):
            step, turned = com[:, k + 1] - com[:, k], turn[:, k + 1] - turn[:, k]
            rows += [cs.sumsqr(step) - steps[0] ** 2, cs.sumsqr(turned) - steps[2] ** 2]
            rows.append(data["progress"][k] - cs.dot(data["direction"][:, k], step))
        walked = [toes[after] - toes[before] for before, after in layout.moves.tolist()]
        rows += [cs.sumsqr(step) - steps[1] ** 2 for step in walked]
        x = cs.vertcat(*(cs.vec(part) for part in (com, turn, shares, forces)))
        start = cs.SX.sym("start", x.numel())
        cost = 0.5 * (1e-6 if aims else 1e-2) * cs.sumsqr(x - start)
        if aims:
            cost += data["aim"][0] * cs.sumsqr(com[:, -1] - data["goal"])
            cost += data["aim"][1] * cs.sumsqr(com[:, 1:] - com[:, :-1])
            cost += data["aim"][2] * sum((cs.sumsqr(step) for step in walked), start=0)
            cost += data["aim"][3] * cs.sumsqr(turn)
        packed = cs.vertcat(*(cs.vec(part) for part in data.values()), start)
        left, right = cs.vertcat(*equal), cs.vertcat(*rows)
        self._low = np.r_[np.zeros(left.numel()), np.full(right.numel(), -np.inf)]
        self._solver = cs.nlpsol(
            "mpcc",
            "ipopt",
            {"x": x, "p": packed, "f": cost, "g": cs.vertcat(left, right)},
            {
                "ipopt": {
                    "print_level": 0,
                    "sb": "yes",
                    "max_iter": 300,
                    "max_cpu_time": 10.0,
                    "tol": 1e-7,
                },
                "print_time": False,
                "show_eval_warnings": False,
            },
        )

    def solve(self, scaled: Scaled, start: Array) -> tuple[Array, Point] | None:
        """Choice and point, None where IPOPT did not converge."""
        layout, x = self.layout, start
        several = any(len(counts) > 1 for counts in layout.corners)
        low, high = bounds(scaled)
        for epsilon in RELAXED if several else RELAXED[-1:]:
            answer = self._solver(
                x0=np.clip(x, low, high),
                p=np.concatenate([numbers(scaled, epsilon), x]),
                lbx=low,
                ubx=high,
                lbg=self._low,
                ubg=np.zeros(len(self._low)),
            )
            if str(self._solver.stats()["return_status"]) not in CONVERGED:
                return None
            x = np.asarray(answer["x"], dtype=np.float64).ravel()
        return rounded(scaled, x)


def of_footholds(layout: Layout) -> list[list[int]]:
    """Candidates of every foothold."""
    owner = np.asarray(layout.candidate_footholds)
    return [np.flatnonzero(owner == p).tolist() for p in range(layout.footholds)]


def numbers(scaled: Scaled, epsilon: float) -> Array:
    """The program's parameters."""
    layout, aim = scaled.layout, np.zeros(4)
    if scaled.weights is not None:
        its = scaled.weights
        aim = np.array([its.goal, its.com_step, its.toe_step, its.tilt / scaled.length_m**2])
    return np.concatenate(
        [
            scaled.vertices.ravel(),
            scaled.frames.transpose(0, 2, 1).ravel(),
            scaled.friction,
            scaled.force_max[:, 0],
            scaled.com.ravel(),
            [scaled.weight, epsilon, *scaled.steps, *scaled.com_radius],
            scaled.shoulders.ravel(),
            scaled.reach,
            scaled.direction[: layout.frames - 1].ravel(),
            scaled.progress[: layout.frames - 1],
            scaled.goal,
            aim,
        ]
    )


def bounds(scaled: Scaled) -> tuple[Array, Array]:
    """Bounds of x."""
    contact, candidate = scaled.layout.contact_candidates
    low, high = cones_met(
        scaled.force_min[contact], scaled.force_max[contact], scaled.friction[candidate]
    )
    low = np.minimum(low, 0.0)
    tilt, weights = np.full(scaled.com.size, scaled.tilt), np.zeros(len(scaled.vertices))
    radius = scaled.com_radius[:, None]
    return (
        np.concatenate([(scaled.com - radius).ravel(), -tilt, weights, low.ravel()]),
        np.concatenate([(scaled.com + radius).ravel(), tilt, weights + 1.0, high.ravel()]),
    )


def middle(scaled: Scaled) -> Array:
    """x amid all patches, the weight shared by the contacts."""
    layout = scaled.layout
    owner = np.asarray(layout.vertex_footholds)
    shares = 1.0 / np.bincount(owner)[owner]
    contact, candidate = layout.contact_candidates
    stance = layout.contacts[0][contact]
    forces = (
        scaled.frames[candidate][:, 2, :] * (scaled.weight / np.bincount(stance)[stance])[:, None]
    )
    forces[:, 0] = np.maximum(forces[:, 0], 0.25 * scaled.force_max[contact, 0])
    return np.concatenate([scaled.com.ravel(), np.zeros(scaled.com.size), shares, forces.ravel()])


def patches_of(scaled: Scaled, known: Known) -> list[int]:
    """The candidate of every foothold that a neighbour stands on, by its number; the one nearest to
    its toe where there are fewer here.
    """
    places = list[int]()
    for p, where in enumerate(of_footholds(scaled.layout)):
        same = [k for k in where if scaled.numbers[k] == known.choice[p]]
        away = [np.linalg.norm(scaled.pieces[k].mean(axis=0) - known.point.toes[p]) for k in where]
        places.append(same[0] if same else where[int(np.argmin(away))])
    return places


def beginning(scaled: Scaled, known: Known) -> Array:
    """x at a neighbour's point: its patches, with its toes put on them as near as they go."""
    layout, shares = scaled.layout, np.zeros(len(scaled.vertices))
    places = patches_of(scaled, known)
    for p, k in enumerate(places):
        corners = scaled.pieces[k]
        rows = np.vstack([corners.T, 10.0 * np.ones(len(corners))])
        weights = nnls(rows, np.append(known.point.toes[p], 10.0))[0]
        at_vertices = np.flatnonzero(np.asarray(layout.vertex_candidates) == k)
        shares[at_vertices] = weights / max(weights.sum(), 1e-9)
    contact, candidate = layout.contact_candidates
    foothold = layout.contacts[2][contact]
    mine = np.array([places[int(p)] == int(k) for p, k in zip(foothold, candidate, strict=True)])
    forces = np.where(mine[:, None], known.point.forces[contact], 0.0)
    return np.concatenate(
        [known.point.com.ravel(), known.point.rotation.ravel(), shares, forces.ravel()]
    )


def rounded(scaled: Scaled, x: Array) -> tuple[Array, Point]:
    """The patches of the largest shares, and the point on them."""
    layout = scaled.layout
    com, turn, shares, forces = np.split(
        x, np.cumsum([scaled.com.size, scaled.com.size, len(scaled.vertices)])
    )
    forces, candidates = forces.reshape(-1, 3), len(layout.candidate_footholds)
    z = np.bincount(np.asarray(layout.vertex_candidates), np.maximum(shares, 0.0), candidates)
    chosen = [max(where, key=lambda k: z[k]) for where in of_footholds(layout)]
    toes = np.zeros((layout.footholds, 3))
    for p, k in enumerate(chosen):
        at_vertices = np.flatnonzero(np.asarray(layout.vertex_candidates) == k)
        weights = np.maximum(shares[at_vertices], 0.0)
        toes[p] = weights @ scaled.vertices[at_vertices] / max(weights.sum(), 1e-9)
    contact, candidate = layout.contact_candidates
    foothold = layout.contacts[2][contact]
    mine = np.array([chosen[int(p)] == int(k) for p, k in zip(foothold, candidate, strict=True)])
    point = Point(
        com=com.reshape(-1, 3),
        rotation=turn.reshape(-1, 3),
        toes=toes,
        forces=forces[mine],
        residual=float("inf"),
    )
    return scaled.numbers[np.array(chosen)], point


NAMES = {
    "two-stage": "two-stage, lift",
    "micp": "micp from nothing",
    "mpcc": "mpcc from the middle",
}


def page(rows: list[Row]) -> Iterable[str]:
    """A row a method (docs/reproduction.md)."""
    head = ("problems", "method", "success", "95 % interval", "CPU-ms", "objective")
    return markdown(
        head,
        (
            (
                row["problems"],
                NAMES.get(row["method"], row["method"]),
                f"{row['success']} of {row['of']}",
                "[{:.0f}, {:.0f}]".format(*(100 * end for end in row["interval"])),
                f"{cell(row['cpu_ms'])} ({cell(row['p95_ms'])})",
                "" if row["objective"] is None else f"{row['objective']:.2f}",
            )
            for row in rows
        ),
    )


if __name__ == "__main__":
    launch(main, Arguments, __doc__, page=page)
