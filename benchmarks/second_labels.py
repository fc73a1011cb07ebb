"""Labels against a second exact solver: what the exact planner says of natural postures, and what
SCIP says.

nice -n 15 python benchmarks/second_labels.py --count 3334 --problem wall-3 --json

The second solver has the nonconvex problem as docs/formats.md has it, written here anew from the
file's numbers: no relaxation, no row and no bound is shared. A contradiction is a posture called
feasible that SCIP proves infeasible with every constraint as it stands, or one called infeasible
for which SCIP has a point that holds, by this file's own arithmetic, to 1e-7. A point that holds
only to SCIP's own tolerance is counted apart, as near; what took too long is unknown.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from _bench import Options, launch
from numpy.typing import NDArray
from pyscipopt import Model, quicksum

import stancekit

HOLDS = 1e-7
"""Largest violation of a point that holds, in units of force scale and length scale."""
Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which postures, and for how long."""

    problem: str = "wall-3"
    """Class of the postures, as `stancekit sample` names it."""
    count: int = 1000
    """How many postures, as they are drawn."""
    limit_s: float = 20.0
    """Of the second solver, a posture."""
    report_every: int = 500
    """A row of the table after so many."""


@dataclass(frozen=True, kw_only=True)
class Second:
    """What the second solver says: feasible, infeasible or unknown; worst: violation of its
    point.
    """

    label: str
    worst: float = float("nan")
    cpu_s: float = 0.0


def frames(contact: Any) -> Array:
    """Contact frame of a patch: columns n, y, z."""
    n = contact.patch.normal
    z = contact.patch.shear_reference - (contact.patch.shear_reference @ n) * n
    z = z / np.linalg.norm(z)
    return np.stack([n, np.cross(z, n), z], axis=1)


def second(problem: stancekit.Problem, limit_s: float) -> Second:
    """Ask SCIP for a posture; forces in units of the force scale."""
    model = Model()
    model.hideOutput()
    model.setParam("limits/time", limit_s)
    model.setParam("limits/solutions", 1)
    model.setParam("numerics/feastol", 1e-9)
    weight = problem.mass_kg * problem.gravity_m_s2 / problem.force_scale_n
    home, radius = problem.com_nominal_m[0], float(problem.com_radius_m[0])
    com = [_free(model, c, radius) for c in home]
    tilt = [_free(model, 0.0, problem.tilt_limit_rad) for _ in range(3)]
    model.addCons(
        quicksum((c - float(n)) * (c - float(n)) for c, n in zip(com, home, strict=True))
        <= radius**2
    )
    net: list[Any] = [0.0, 0.0, -weight]
    moment: list[Any] = [-weight * com[1], weight * com[0], 0.0]
    columns = []
    for contact in problem.contacts:
        toe, force = _contact(model, contact, com, tilt)
        columns.append((toe, force))
        net = [a + b for a, b in zip(net, force, strict=True)]
        moment = [
            moment[0] + toe[1] * force[2] - toe[2] * force[1],
            moment[1] + toe[2] * force[0] - toe[0] * force[2],
            moment[2] + toe[0] * force[1] - toe[1] * force[0],
        ]
    for row in (*net, *moment):
        model.addCons(row == 0.0)
    started = time.process_time()
    model.optimize()
    spent = time.process_time() - started
    if model.getNSols():
        solution = model.getBestSol()
        value = np.vectorize(
            lambda expression: model.getSolVal(solution, expression), otypes=[float]
        )
        point = [(value(np.array(toe)), value(np.array(force))) for toe, force in columns]
        return Second(
            label="feasible",
            worst=worst(problem, value(np.array(com)), value(np.array(tilt)), point),
            cpu_s=spent,
        )
    return Second(
        label="infeasible" if model.getStatus() == "infeasible" else "unknown", cpu_s=spent
    )


def worst(
    problem: stancekit.Problem, com: Array, tilt: Array, point: list[tuple[Array, Array]]
) -> float:
    """Largest violation of a posture, from the problem's numbers alone; lengths over the length
    scale.
    """
    length, weight = (
        problem.length_scale_m,
        problem.mass_kg * problem.gravity_m_s2 / problem.force_scale_n,
    )
    up = np.array([0.0, 0.0, weight])
    net = sum((f for _, f in point), -up)
    moment = sum((np.cross(t - com, f) for t, f in point), np.zeros(3)) / length
    found = [
        *np.abs(net),
        *np.abs(moment),
        (np.linalg.norm(com - problem.com_nominal_m[0]) - problem.com_radius_m[0]) / length,
        np.abs(tilt).max() - problem.tilt_limit_rad,
    ]
    for contact, (toe, force) in zip(problem.contacts, point, strict=True):
        hip = com + contact.shoulder_m + np.cross(tilt, contact.shoulder_m)
        local = frames(contact).T @ force
        corners = contact.patch.vertices_m
        edges = np.roll(corners, -1, axis=0) - corners
        outward = np.cross(edges, contact.patch.normal)
        outward /= np.linalg.norm(outward, axis=1)[:, None]
        outward *= np.sign(np.einsum("ij,ij->i", outward, corners - corners.mean(axis=0)))[:, None]
        found += [
            (np.linalg.norm(toe - hip) - contact.reach_m) / length,
            np.hypot(local[1], local[2]) - contact.patch.friction * local[0],
            np.max(contact.force_min - local),
            np.max(local - contact.force_max),
            abs(contact.patch.normal @ (toe - corners.mean(axis=0))) / length,
            np.max(np.einsum("ij,ij->i", outward, toe - corners)) / length,
        ]
    return float(max(found))


def _free(model: Any, middle: float, radius: float) -> Any:
    return model.addVar(lb=float(middle) - float(radius), ub=float(middle) + float(radius))


def _contact(
    model: Any, contact: Any, com: list[Any], tilt: list[Any]
) -> tuple[list[Any], list[Any]]:
    """Toe and force of one foot as expressions, with what binds them."""
    corners = contact.patch.vertices_m
    shares = [model.addVar(lb=0.0, ub=1.0) for _ in corners]
    model.addCons(quicksum(shares) == 1.0)
    toe = []
    for axis in range(3):
        place = model.addVar(lb=float(corners[:, axis].min()), ub=float(corners[:, axis].max()))
        model.addCons(
            place == quicksum(s * float(c) for s, c in zip(shares, corners[:, axis], strict=True))
        )
        toe.append(place)
    local = [
        model.addVar(lb=float(a), ub=float(b))
        for a, b in zip(contact.force_min, contact.force_max, strict=True)
    ]
    model.addCons(
        local[1] * local[1] + local[2] * local[2] <= contact.patch.friction**2 * local[0] * local[0]
    )
    model.addCons(local[0] >= 0.0)
    bound = float(np.abs(np.r_[contact.force_min, contact.force_max]).max()) * 2.0
    force = []
    for axis, row in enumerate(frames(contact)):
        part = model.addVar(lb=-bound, ub=bound, name=f"f{axis}")
        model.addCons(part == quicksum(float(r) * v for r, v in zip(row, local, strict=True)))
        force.append(part)
    s = contact.shoulder_m
    turned = [
        tilt[1] * s[2] - tilt[2] * s[1],
        tilt[2] * s[0] - tilt[0] * s[2],
        tilt[0] * s[1] - tilt[1] * s[0],
    ]
    legs = [t - c - float(a) - r for t, c, a, r in zip(toe, com, s, turned, strict=True)]
    model.addCons(quicksum(leg * leg for leg in legs) <= contact.reach_m**2)
    return toe, force


def main(options: Arguments) -> None:
    """Print the counts."""
    counts: Counter[str] = Counter()
    spent = [0.0, 0.0]
    for done, problem in enumerate(
        stancekit.sample(options.problem, options.count, rng=options.seed), start=1
    ):
        started = time.process_time()
        ours = str(stancekit.solve(problem).status.value)
        spent[0] += time.process_time() - started
        theirs = second(problem, options.limit_s)
        spent[1] += theirs.cpu_s
        holds = theirs.label != "feasible" or theirs.worst <= HOLDS
        counts[f"{ours}, second {theirs.label if holds else 'near'}"] += 1
        counts["contradictions"] += {ours, theirs.label} == {"feasible", "infeasible"} and holds
        if done % options.report_every == 0 or done == options.count:
            options.say(
                {
                    "problem": options.problem,
                    "seed": options.seed,
                    "done": done,
                    "contradictions": counts["contradictions"],
                }
                | {
                    name: count
                    for name, count in sorted(counts.items())
                    if name != "contradictions"
                }
                | {"exact_cpu_s": round(spent[0], 1), "second_cpu_s": round(spent[1], 1)}
            )


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
