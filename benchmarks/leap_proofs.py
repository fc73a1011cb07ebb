"""Do refuted leaps have no leap, and are forged ones refused? Against an optimiser and a judge of
their own.

    python benchmarks/leap_proofs.py --choices 300 --scenes 50 --cuts 20000 --forged 200

Choices that a Farkas cut refutes, and the most favourable choices of scenes that a certificate
refutes, are given to IPOPT (casadi) from five starts: a program with the moments as they are, of
forces, toes and the body, which shares nothing with the finder, its cuts and their check but the
question (``_leap_nlp``). Whatever it finds is put to the judge below. Cuts are evaluated
on choices that were solved; forged leaps are put to the verifier.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from _bench import Options, launch
from _leap_nlp import LeapNlp

from stancekit import Motion, Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.leap.finder import LeapFinder, LeapSearch, find_leap
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.prove import MARGIN, proof_cut, ray
from stancekit.planners.leap.scp import attempt, plan_of
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.verify.leaps import check_leap

G = 9.81


def forged(plan: Motion, size: float, kind: str, rng: np.random.Generator) -> Motion:
    """A leap with one fault; size: from 2 to 10, in units of what the verifier lets pass."""
    leap = plan.problem
    arrays = {
        name: np.array(getattr(plan, name))
        for name in ("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad", "toes_m", "forces_n")
    }
    k, step = int(rng.integers(1, leap.intervals)), 1e-3 * size
    standing = np.argwhere(np.abs(arrays["forces_n"]).sum(axis=2) > 1.0)
    q, i = standing[int(rng.integers(len(standing)))]
    j = int(leap.holds[leap.interval_phases[q], i])
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    match kind:
        case "says where it is not":
            arrays["com_m"][k] += 0.1 * step * np.sign(direction)
        case "says another speed":
            arrays["velocity_m_s"][k] += step * np.sign(direction)
        case "says another momentum":
            arrays["momentum_m2_s"][k] += step * leap.limits.momentum_m2_s * np.sign(direction)
        case "pushes in the air":
            flight = int(np.flatnonzero((leap.holds[leap.interval_phases] < 0).all(axis=1))[0])
            arrays["forces_n"][flight, i] += step * leap.weight_n * direction
        case "off its patch":
            patch = leap.patch(j, plan.choice)
            arrays["toes_m"][j] += 0.1 * step * patch.normal
        case "pushes more":
            arrays["forces_n"][q, i] += 5.0 * step * leap.weight_n * direction
        case "pulls":
            patch = leap.patch(j, plan.choice)
            arrays["forces_n"][q, i] = -step * leap.weight_n * patch.normal
        case "slips":
            patch = leap.patch(j, plan.choice)
            across = np.cross(patch.normal, direction)
            across /= np.linalg.norm(across)
            normal = arrays["forces_n"][q, i] @ patch.normal
            shear = patch.friction * normal + step * leap.weight_n
            arrays["forces_n"][q, i] = normal * patch.normal + shear * across
        case "another patch":
            choice = plan.choice.copy()
            choice[j] = (choice[j] + 1) % len(leap.footholds[j].candidates)
            return Motion(problem=leap, timing=plan.timing, choice=choice, **arrays)
        case "without rest":
            arrays["forces_n"][0, i] += step * leap.weight_n * direction
    return Motion(problem=leap, timing=plan.timing, choice=plan.choice, **arrays)


KINDS = (
    "says where it is not",
    "says another speed",
    "says another momentum",
    "pushes in the air",
    "off its patch",
    "pushes more",
    "pulls",
    "slips",
    "another patch",
    "without rest",
)


def judged(plan: Motion) -> float:
    """How far a plan is from a leap, by sums written here: closed forms of c, v, L; the largest
    violation, scaled.
    """
    leap = plan.problem
    times, mass = plan.ends_s, leap.robot.mass_kg
    c, v, spun = (
        np.array(x) for x in (leap.start.com_m, leap.start.velocity_m_s, leap.start.momentum_m2_s)
    )
    worst = 0.0
    unit = leap.limits.momentum_m2_s
    for k in range(leap.intervals):
        says = (
            (plan.com_m[k] - c) / 0.1,
            plan.velocity_m_s[k] - v,
            (plan.momentum_m2_s[k] - spun) / unit,
        )
        worst = max(worst, *(float(np.abs(one).max()) for one in says))
        dt, holds = times[k + 1] - times[k], leap.holds[leap.interval_phases[k]]
        total, twist = np.zeros(3), np.zeros(3)
        for i, j in enumerate(holds):
            f = plan.forces_n[k, i]
            if j < 0:
                worst = max(worst, float(np.linalg.norm(f)) / leap.weight_n)
                continue
            patch = leap.patch(int(j), plan.choice)
            normal = f @ patch.normal
            slip = np.linalg.norm(f - normal * patch.normal) - patch.friction * normal
            most = leap.limits.force_share * leap.weight_n
            worst = max(worst, *(float(x) / leap.weight_n for x in (-normal, slip, normal - most)))
            total, twist = total + f / mass, twist + np.cross(plan.toes_m[j], f / mass)
        a = total - np.array([0.0, 0.0, G])
        spun = spun + dt * twist - np.cross(c * dt + v * dt**2 / 2 + a * dt**3 / 6, total)
        c, v = c + dt * v + dt**2 / 2 * a, v + dt * a
        if (k == 0 and leap.still[0]) or (k == leap.intervals - 1 and leap.still[1]):
            worst = max(worst, float(np.abs(a).max()) * dt)
    says = (
        (plan.com_m[-1] - c) / 0.1,
        plan.velocity_m_s[-1] - v,
        (plan.momentum_m2_s[-1] - spun) / unit,
    )
    worst = max(worst, *(float(np.abs(one).max()) for one in says))
    worst = max(worst, (float(np.linalg.norm(c - leap.goal.com_m)) - leap.goal_radius_m) / 0.1)
    worst = max(worst, float(np.abs(v).max()), float(np.abs(spun).max()) / unit)
    for j in range(len(leap.footholds)):
        patch, toe = leap.patch(j, plan.choice), plan.toes_m[j]
        worst = max(worst, abs(float((toe - patch.vertices_m.mean(axis=0)) @ patch.normal)) / 0.1)
    return worst


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """How much of each part; seconds: CPU-s for each."""

    choices: int = 300
    scenes: int = 50
    random: int = 60
    cuts: int = 20_000
    forged: int = 200
    seed: int = 43
    seconds: float = 1e9

    def tell(self, part: str, **figures: Any) -> None:
        """Print the row of a part."""
        self.say({"part": part, **figures})


def main(options: Asked) -> None:
    """Run all parts, one line each as it ends."""
    programs = Programs()
    honest = solved_and_cut(options, programs)
    forgeries(options, honest)
    refuted_scenes(options, programs)
    refuted_choices(options, programs)


def solved_and_cut(options: Asked, programs: Programs) -> list[Motion]:
    """Cuts that prove, of every scene, evaluated on the choices of it that are solved."""
    plans: list[Motion] = []
    evaluated, refuted, index, begin = 0, 0, 0, time.process_time()
    while evaluated < options.cuts and time.process_time() - begin < options.seconds:
        leap = leap_class("leap-hard").draw(np.random.default_rng([options.seed, 1, index]))
        index += 1
        search = LeapSearch(leap, LeapFinder(order="noise", solves=120, seed=index), programs)
        rows, solved = [], []
        for found in search.attempts():
            if found.refuted:
                rows.append(ray(search.last.numbers, found.solution))
            elif found.solved:
                plan = plan_of(search.last.numbers, found, "noise")
                if check_leap(plan).accepted:
                    solved.append(found.choice)
                    plans.append(plan)
        numbers = search.last.numbers
        rng = np.random.default_rng([options.seed, 2, index])
        for _ in range(60 if solved else 0):  # cuts of random choices, which fail more often
            tried = attempt(
                programs, numbers, np.array([rng.integers(len(w)) for w in numbers.scaled.which])
            )
            if tried.refuted:
                rows.append(ray(numbers, tried.solution))
        for row in rows if solved else []:
            cut = proof_cut(numbers, row)
            values = [cut.value(choice) for choice in solved]
            evaluated += len(values)
            refuted += sum(value > MARGIN for value in values)
    errors = [check_leap(plan).figures["momentum_error"] for plan in plans[:200]]
    options.tell(
        "cuts on solved choices",
        evaluated=evaluated,
        refuted=refuted,
        scenes=index,
        solved=len(plans),
        worst_error_of_L=max(errors, default=0.0),
        cpu_s=time.process_time() - begin,
    )
    return plans


def forgeries(options: Asked, honest: list[Motion]) -> None:
    """Forged leaps, judged here and put to the verifier."""
    accepted, bad, number = 0, 0, 0
    own = max((judged(plan) for plan in honest[: options.forged]), default=0.0)
    for number in range(options.forged if honest else 0):
        rng = np.random.default_rng([options.seed, 3, number])
        size = float(np.geomspace(2.0, 10.0, options.forged)[number])
        kind = KINDS[number % len(KINDS)]
        fake = forged(honest[number % len(honest)], size, kind, rng)
        wrong = judged(fake) > 1e-3
        bad += wrong
        if check_leap(fake).accepted:
            accepted += wrong
            if wrong:
                options.tell("accepted", kind=kind, size=size)
    options.tell(
        "forged leaps",
        forged=options.forged,
        wrong_by_own_judge=bad,
        accepted=accepted,
        honest_by_own_judge=own,
    )


def refuted_scenes(options: Asked, programs: Programs) -> None:
    """Scenes with a certificate: random choices of them by SCP without cuts, and one by the other
    optimiser.
    """
    scenes, solved, nlp_solved, nlp, index, begin = 0, 0, 0, 0, 0, time.process_time()
    tries = 0
    while scenes < options.scenes and time.process_time() - begin < options.seconds:
        leap = leap_class("leap-few").draw(np.random.default_rng([options.seed, 4, index]))
        index += 1
        outcome = find_leap(leap, LeapFinder(solves=8), programs=programs)
        if outcome.status is not Status.INFEASIBLE:
            continue
        scenes += 1
        numbers, rng = LeapNumbers.of(leap), np.random.default_rng([options.seed, 5, index])
        for _ in range(options.random):
            choice = np.array([rng.integers(len(which)) for which in numbers.scaled.which])
            found = attempt(programs, numbers, choice, share=1.0, stop=np.inf)
            tries += 1
            solved += found.solved
        best = LeapFinder().rule.scores(numbers).argmax(axis=1)
        nlp += 1
        nlp_solved += LeapNlp(leap).from_starts(leap, best, 5, rng).solved
    options.tell(
        "refuted scenes",
        scenes=scenes,
        drawn=index,
        random_tries=tries,
        solved=solved,
        nlp=nlp,
        nlp_solved=nlp_solved,
        cpu_s=time.process_time() - begin,
    )


def refuted_choices(options: Asked, programs: Programs) -> None:
    """Choices that a cut refutes, and as many solved ones, by the other optimiser."""
    begin, index = time.process_time(), 0
    count = {"refuted": 0, "solved": 0}
    agrees = {"refuted": 0, "solved": 0}
    while count["refuted"] < options.choices and time.process_time() - begin < options.seconds:
        leap = leap_class("leap-hard").draw(np.random.default_rng([options.seed, 6, index]))
        index += 1
        rng = np.random.default_rng([options.seed, 7, index])
        search = LeapSearch(leap, LeapFinder(order="noise", solves=30, seed=index), programs)
        numbers, of_scene = search.last.numbers, 0
        for found in search.attempts():
            kind = "solved" if found.solved else ""
            if (
                found.refuted
                and proof_cut(numbers, ray(numbers, found.solution)).value(found.choice) > MARGIN
            ):
                kind = "refuted"
            if not kind or of_scene >= 6 or (kind == "solved" and count["solved"] >= 30):
                continue
            of_scene += 1
            count[kind] += 1
            agrees[kind] += LeapNlp(leap).from_starts(leap, found.choice, 5, rng).solved
    options.tell(
        "choices by IPOPT from 5 starts",
        refuted=count["refuted"],
        refuted_and_solved=agrees["refuted"],
        solved_by_scp=count["solved"],
        solved_by_both=agrees["solved"],
        cpu_s=time.process_time() - begin,
    )


if __name__ == "__main__":
    launch(main, Asked, __doc__)
