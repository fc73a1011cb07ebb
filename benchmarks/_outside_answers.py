"""Forged answers and proofs, by somebody who had not read the verifier.

A kind takes a feasible posture problem with its answer, an infeasible one with its, a size from 1
(gross) towards 0 and a generator. It returns the line of a problem, the line of an answer, and why
that is no answer.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from _outside_files import NoForgery
from _outside_judge import more
from scipy.spatial.transform import Rotation

Lines = tuple[str, str, str]


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Honest pairs of a problem and its answer, as JSON has them."""

    problem: dict[str, Any]
    answer: dict[str, Any]
    refuted: dict[str, Any]
    proof: dict[str, Any]

    def changed(self, **values: Any) -> dict[str, Any]:
        """The feasible answer with other values."""
        return copy.deepcopy(self.answer) | values

    def claims_none(self, tree: Any, multipliers: Any, why: str) -> Lines:
        """That the feasible problem has no posture."""
        certificate = {"tree": tree, "multipliers": multipliers}
        return (
            json.dumps(self.problem),
            json.dumps({"status": "infeasible", "certificate": certificate}),
            why,
        )


Kind = Callable[[Pairs, float, np.random.Generator], Lines]
FEASIBLE = "the problem has a posture that holds"


def lighter(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """A part of the weight is carried by nobody."""
    forces = np.array(pairs.answer["forces_n"]) * (1.0 - 0.5 * size - 1e-3)
    missing = abs(forces[:, 2].sum() - pairs.problem["mass_kg"] * pairs.problem["gravity_m_s2"])
    why = more("missing weight", missing, 1e-3, "N")
    return json.dumps(pairs.problem), json.dumps(pairs.changed(forces_n=forces.tolist())), why


def leans(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """The body is elsewhere, within its ball, and the forces are as they were."""
    com = np.array(pairs.answer["com_m"]) + np.r_[(1e-3 + 0.05 * size) * _unit(rng, 2), 0.0]
    arms = np.array(pairs.answer["toes_m"]) - com
    moment = np.abs(np.cross(arms, pairs.answer["forces_n"]).sum(axis=0)).max()
    problem = pairs.problem | {"com_radius_m": 0.5}
    return (
        json.dumps(problem),
        json.dumps(pairs.changed(com_m=com.tolist())),
        more("moment", moment, 1e-3, "Nm"),
    )


def far_scaled(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """The same, over a length scale of kilometres and a force scale of meganewtons that the problem
    itself says.
    """
    problem, answer, why = leans(pairs, 0.2, rng)
    bounds = [
        contact | {"force_min": [0, -1, -1], "force_max": [1, 1, 1]}
        for contact in json.loads(problem)["contacts"]
    ]
    scales = {
        "length_scale_m": 10.0 ** (6.0 * size),
        "force_scale_n": 98.1 * 10.0 ** (4.0 * size),
        "contacts": bounds,
    }
    return json.dumps(json.loads(problem) | scales), answer, why


def stretches(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """On level ground, tilted as far as the problem lets it: legs reach by the small rotation, not
    truly.
    """
    limit = 0.2618 + 1.2 * size
    tilt = 0.99 * limit * rng.choice([-1.0, 1.0], size=3)
    true = Rotation.from_rotvec(tilt).as_matrix()
    contacts, toes, beyond = [], [], 0.0
    for contact in pairs.problem["contacts"]:
        hip = np.array(contact["shoulder_m"])
        linear, angles = hip + np.cross(tilt, hip), np.linspace(0.0, 2.0 * np.pi, 721)
        height = 0.25
        radius = np.sqrt(max(contact["reach_m"] ** 2 - (linear[2] + height) ** 2, 0.0)) * (
            1.0 - 1e-9
        )
        ring = linear[:2] + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        places = np.c_[ring, np.full(angles.size, -height)]
        over = np.where(
            places[:, :2] @ hip[:2] > 0.0, np.linalg.norm(places - true @ hip, axis=1), 0.0
        )
        toes.append(places[over.argmax()])
        beyond = max(beyond, over.max() - contact["reach_m"]) if radius else beyond
        square = [[x, y, -height] for x, y in ((2, 2), (-2, 2), (-2, -2), (2, -2))]
        contacts.append(
            contact
            | {
                "vertices_m": square,
                "normal": [0, 0, 1],
                "shear_reference": [1, 0, 0],
                "friction": 0.8,
                "force_min": [0, -1, -1],
                "force_max": [1, 1, 1],
            }
        )
    feet = np.array(toes)
    shares = np.linalg.solve(np.stack([np.ones(3), feet[:, 0], feet[:, 1]]), [1.0, 0.0, 0.0])
    if shares.min() < 0.0:
        raise NoForgery("the centre of mass is not over these feet")
    weight = pairs.problem["mass_kg"] * pairs.problem["gravity_m_s2"]
    forces = np.zeros((3, 3))
    forces[:, 2] = weight * shares
    problem = pairs.problem | {
        "com_nominal_m": [0.0, 0.0, 0.0],
        "tilt_limit_rad": limit,
        "contacts": contacts,
        "force_scale_n": weight,
    }
    answer = {
        "com_m": [0.0] * 3,
        "rotation_rad": tilt.tolist(),
        "toes_m": feet.tolist(),
        "forces_n": forces.tolist(),
    }
    return (
        json.dumps(problem),
        json.dumps(pairs.changed(**answer)),
        more("reach, truly", beyond, 1e-3, "m"),
    )


def pyramid(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """Feet push along the diagonal of a friction pyramid; that balances is repaired by a centre of
    mass and weight.
    """
    problem, answer = copy.deepcopy(pairs.problem), pairs.changed()
    forces = np.array(answer["forces_n"])
    contact = problem["contacts"][0]
    normal = np.array(contact["normal"])
    across = normal @ forces[0]
    least = np.linalg.norm(forces[0] - across * normal) / across
    contact["friction"] = float(least / (1.0 + 0.4 * size + 1e-3))
    over = (least - contact["friction"]) * across
    return (
        json.dumps(problem),
        json.dumps(answer),
        more("tangential force beyond friction", over, 1e-3, "N"),
    )


def words(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """Numbers are texts in Arabic-Indic digits: JSON has no such numbers."""
    digits = str.maketrans("0123456789", "٠١٢٣٤٥٦٧٨٩")
    forces = [
        [f"{value:.17g}".translate(digits) for value in row] for row in pairs.answer["forces_n"]
    ]
    text = json.dumps(pairs.changed(forces_n=forces), ensure_ascii=bool(rng.integers(2)))
    return json.dumps(pairs.problem), text, "docs/formats.md has numbers there, and these are texts"


def no_number(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """A value is none, none that can be, or true."""
    name = str(rng.choice(["com_m", "rotation_rad"]))
    value = [float("nan"), float("inf"), 1e308, -1e308, None, True, 10**400][int(rng.integers(7))]
    values = list(pairs.answer[name])
    values[int(rng.integers(3))] = value
    return (
        json.dumps(pairs.problem),
        json.dumps(pairs.changed(**{name: values})),
        f"{value!s:.9} is no place",
    )


def twice(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """A key comes twice: one reader takes the first, another the last."""
    key, value = ("mass_kg", 1e-3) if rng.integers(2) else ("com_radius_m", 1e3 * size)
    return (
        json.dumps(pairs.problem)[:-1] + f', "{key}": {value}}}',
        json.dumps(pairs.answer),
        "two values of a key",
    )


def bare(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """A claim without its evidence, or with the other one's."""
    claim = [
        {"status": "feasible"},
        {"status": "infeasible"},
        pairs.changed(status="infeasible"),
        {"status": "feasible", "certificate": pairs.proof["certificate"]},
        pairs.changed(status="undecided"),
    ][int(rng.integers(5))]
    return json.dumps(pairs.problem), json.dumps(claim), "nothing shows the claim"


def foreign(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """The proof of another problem, its multipliers scaled."""
    certificate = pairs.proof["certificate"]
    factor = 10.0 ** (300.0 * size) if rng.integers(2) else 10.0 ** (-300.0 * size)
    return pairs.claims_none(
        certificate["tree"], _times(certificate["multipliers"], factor), FEASIBLE
    )


def eased(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """A problem that has a posture, refuted by what refutes it with a little less friction."""
    import stancekit  # what makes the honest files

    low, high = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        with_it = stancekit.solve(_problem(_rough(pairs.problem, middle)))
        low, high = (low, middle) if with_it.solution is not None else (middle, high)
    refuted = stancekit.solve(_problem(_rough(pairs.problem, low))).certificate
    held = stancekit.solve(_problem(_rough(pairs.problem, high + 0.02 * size))).solution
    if refuted is None or held is None:
        raise NoForgery("no boundary between posture and proof")
    problem = json.dumps(_rough(pairs.problem, high + 0.02 * size))
    certificate = {
        "tree": np.asarray(refuted.tree).tolist(),
        "multipliers": np.asarray(refuted.multipliers).tolist(),
    }
    return problem, json.dumps({"status": "infeasible", "certificate": certificate}), FEASIBLE


def wild(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """A tree of random rows with random multipliers."""
    rows = int(1 + 8 * size)
    width = len(pairs.proof["certificate"]["multipliers"][0])
    tree = [
        [float(rng.integers(-2, 5)), float(rng.integers(-1, 4)), *rng.normal(size=3).round(3)]
        for _ in range(rows)
    ]
    multipliers = rng.normal(size=(rows, width)) * 10.0 ** rng.uniform(-5, 200 * size + 5)
    return pairs.claims_none(tree, multipliers.tolist(), FEASIBLE)


def pruned(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """A tree without some of its rows, or none at all."""
    certificate = pairs.proof["certificate"]
    keep = int(rng.integers(0, len(certificate["tree"])))
    return pairs.claims_none(
        certificate["tree"][:keep], certificate["multipliers"][:keep], FEASIBLE
    )


def boundless(pairs: Pairs, size: float, rng: np.random.Generator) -> Lines:
    """Multipliers that are as large as numbers are, so that sums of them are none."""
    certificate = pairs.proof["certificate"]
    huge = rng.choice([-1.0, 1.0], size=np.shape(certificate["multipliers"])) * 10.0 ** (
        290.0 + 18.0 * size
    )
    return pairs.claims_none(certificate["tree"], huge.tolist(), FEASIBLE)


def _rough(problem: dict[str, Any], share: float) -> dict[str, Any]:
    return problem | {
        "contacts": [c | {"friction": share * c["friction"]} for c in problem["contacts"]]
    }


def _problem(raw: dict[str, Any]) -> Any:
    import tempfile
    from pathlib import Path

    import stancekit

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "posture.json"
        path.write_text(json.dumps(raw))
        return stancekit.load(path)


def _times(multipliers: Any, factor: float) -> Any:
    with np.errstate(over="ignore"):
        return np.nan_to_num(np.array(multipliers) * factor).tolist()


def _unit(rng: np.random.Generator, size: int) -> Any:
    value = rng.normal(size=size)
    return value / np.linalg.norm(value)


ANSWERS: tuple[Kind, ...] = (
    lighter,
    leans,
    far_scaled,
    stretches,
    pyramid,
    words,
    no_number,
    twice,
    bare,
    foreign,
    eased,
    wild,
    pruned,
    boundless,
)
"""Of postures, and proofs that there are none."""
