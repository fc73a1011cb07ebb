"""Are forged crossings refused? Faults in seams, leaps and proofs of a crossing that the verifier
accepts, each put to it.

    python benchmarks/forged_crossings.py CROSSING.json [OTHER.json]

A row a forgery: the group that refuses it, or that it was accepted. OTHER is a crossing of another
robot, whose parts are put in. Exit code 1 if anything is accepted that should not be, or the
crossing itself is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from _bench import Options, launch

from stancekit import Certificate, Motion
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import StancekitError
from stancekit.planners.formats.motion_file import read_motion
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import attempt, plan_of
from stancekit.planners.problem.contact import Foothold
from stancekit.planners.problem.leap import Leap
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.verify.crossings import check_crossing
from stancekit.planners.verify.geometry import patch_distances

ASIDE_M = np.array([0.0, 2e-3, 0.0])
"""Seams are moved by this [m]."""


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """A crossing that is accepted, and one of another robot."""

    crossing: Annotated[Path, tyro.conf.Positional]
    other: Annotated[Path | None, tyro.conf.Positional] = None


def main(asked: Asked) -> int:
    """Forge, verify and print."""
    honest = read_motion(asked.crossing)[0]
    other = None if asked.other is None else read_motion(asked.other)[0]
    report = check_crossing(honest)
    asked.say({"forgery": "none", "accepted": report.accepted, "refused by": report.message})
    wrong, count = int(not report.accepted), 0
    for name, fake in forgeries(honest, other):
        count += 1
        if isinstance(fake, str):
            asked.say({"forgery": name, "accepted": False, "refused by": fake})
            continue
        report = check_crossing(fake)
        refusing = [group.name for group in report.groups if group.verdict == "violated"]
        said = ", ".join(refusing) or report.message
        wrong += report.accepted
        asked.say({"forgery": name, "accepted": report.accepted, "refused by": said})
    asked.say({"forgeries": count, "accepted": wrong})
    return int(wrong > 0)


def forgeries(honest: Motion, other: Motion | None) -> Iterator[tuple[str, Motion | str]]:
    """Forged crossings by name; in place of one that cannot be made, why not."""
    k = next(k for k, part in enumerate(honest.parts) if part.has("timing"))
    leap, after = honest.parts[k], honest.parts[k + 1]

    def exchanged(part: Motion, at: int = k) -> Motion:
        parts = list(honest.parts)
        parts[at] = part
        return replace(honest, parts=tuple(parts))

    def proved(certificate: Certificate) -> Motion:
        return replace(honest, problem=replace(honest.problem, certificate=certificate))

    for name, part in leaps(leap, honest.problem.terrain):
        yield name, part if isinstance(part, str) else exchanged(part)
    com = replace(after, com_m=after.com_m + ASIDE_M)
    yield "body elsewhere after landing", exchanged(com, k + 1)
    toes = replace(after, toes_m=after.toes_m + ASIDE_M)
    yield "toes elsewhere after landing", exchanged(toes, k + 1)
    turned = replace(after, rotation_rad=after.rotation_rad + np.array([0.0, 0.0, 0.15]))
    yield "body turned after landing", exchanged(turned, k + 1)
    if after.joints_rad is not None:
        bent = after.joints_rad + 0.3 * np.eye(1, after.joints_rad.shape[1])
        yield "a joint bent after landing", exchanged(replace(after, joints_rad=bent), k + 1)
    before, rest = honest.parts[:k], honest.parts[k + 1 :]
    yield "no leap", replace(honest, parts=(*before, *rest))
    yield "no last climb", replace(honest, parts=(*before, leap))
    yield "the leap twice", replace(honest, parts=(*before, leap, leap, *rest))
    yield "the last climb first", replace(honest, parts=(after, leap, before[0]))
    swapped = replace(leap, toes_m=np.roll(leap.toes_m, len(leap.problem.robot.limbs), axis=0))
    yield "the leap backwards", exchanged(swapped)
    proof = honest.problem.certificate
    if proof is not None and proof.problem is not None:
        steps = proof.problem.steps
        longer = replace(proof.problem, steps=replace(steps, toe_m=1.2 * steps.toe_m))
        for name, problem in (("proof of shorter steps", longer), ("proof without a course", None)):
            try:
                yield name, proved(replace(proof, problem=problem))
            except StancekitError as error:
                yield name, str(error)
    if other is not None:
        yield "leap of another robot", exchanged(other.parts[1])
        yield "last climb of another robot", exchanged(other.parts[-1], len(honest.parts) - 1)
        if other.problem.certificate is not None:
            yield "proof of another robot", proved(other.problem.certificate)


def deepest(plan: Motion, terrain: Sequence[Patch]) -> tuple[int, np.ndarray]:
    """The limb and the place between its toes before and after a leap that is farthest from all
    ground.
    """
    holds, shares = plan.problem.holds, np.linspace(0.0, 1.0, 21)[:, None]
    best, found = -1.0, (0, np.zeros(3))
    for limb, (leaves, lands) in enumerate(zip(holds[0], holds[-1], strict=True)):
        a, b = plan.toes_m[leaves], plan.toes_m[lands]
        for place in a + shares * (b - a):
            away = patch_distances(
                [one.vertices_m for one in terrain], np.tile(place, (len(terrain), 1))
            )
            if away.min() > best:
                best, found = float(away.min()), (limb, place)
    return found


def leaps(plan: Motion, terrain: Sequence[Patch]) -> Iterator[tuple[str, Motion | str]]:
    """Forged leaps by name."""
    leap = plan.problem
    stands, limbs = leap.holds[leap.interval_phases], len(leap.robot.limbs)
    air = int(np.flatnonzero((stands < 0).all(axis=1))[0])
    lands = leap.holds[-1]

    def pushed(interval: int, limb: int, force_n: np.ndarray) -> Motion:
        forces = plan.forces_n.copy()
        forces[interval, limb] += force_n
        return replace(plan, forces_n=forces)

    def asked(**changes: object) -> Motion | str:
        try:
            return replace(plan, problem=replace(leap, **changes))
        except StancekitError as error:
            return str(error)

    up = np.array([0.0, 0.0, leap.weight_n])
    yield "pushes in the air", pushed(air, 0, 0.05 * up)
    yield "pushes harder", replace(plan, forces_n=1.02 * plan.forces_n)
    yield "pushes harder, and says so", integrated(plan, 1.02 * plan.forces_n)
    squeezed = plan.forces_n.copy()
    first, last = (plan.toes_m[stands[air - 1, limb]] for limb in (0, limbs - 1))
    along = 0.4 * leap.weight_n * (last - first) / np.linalg.norm(last - first)
    squeezed[air - 1, [0, -1]] += [along, -along]
    yield "two legs press against each other", replace(plan, forces_n=squeezed)
    times = leap.timings_s[plan.timing]
    yield (
        "flies for longer",
        asked(timings_s=((times[0], times[1] + 0.02, *times[2:]),) * len(leap.timings_s)),
    )
    moving = replace(leap.start, velocity_m_s=np.array([0.05, 0.0, 0.0]))
    yield "begins in motion", asked(start=moving)
    yield "ends in motion", asked(goal=replace(leap.goal, velocity_m_s=moving.velocity_m_s))
    elsewhere = replace(leap.start, com_m=leap.start.com_m + ASIDE_M)
    yield (
        "body elsewhere before take-off",
        replace(plan, com_m=plan.com_m + ASIDE_M, problem=replace(leap, start=elsewhere)),
    )
    yield "begins 2 mm aside", shifted(plan, ASIDE_M)
    limb, middle = deepest(plan, terrain)
    yield "a toe in the gap", placed(plan, int(lands[limb]), middle)
    yield (
        "a toe in the gap, on a patch of its own",
        placed(plan, int(lands[limb]), middle, patch_too=True),
    )
    rough = tuple(
        replace(
            one,
            candidates=tuple(patch.with_friction(2.0 * patch.friction) for patch in one.candidates),
        )
        for one in leap.footholds
    )
    yield "rougher ground", asked(footholds=rough)
    yield "legs drawn up late", replace(plan, gather=np.array([0.49, 0.1]))
    numbers = LeapNumbers.of(leap, plan.timing)
    unbent = plan_of(numbers, attempt(Programs(), numbers, plan.choice, stop=np.inf), "unbent")
    yield "as it was before it was bent", unbent


def integrated(plan: Motion, forces_n: np.ndarray) -> Motion:
    """A plan of other forces, whose body does what they ask for."""
    from stancekit.planners.leap.scp import plan_from

    numbers = LeapNumbers.of(plan.problem, plan.timing)
    return plan_from(numbers, plan.choice, plan.toes_m, forces_n, "forged")


def placed(plan: Motion, j: int, toe_m: np.ndarray, *, patch_too: bool = False) -> Motion:
    """A plan with a toe elsewhere, and its patch there, too."""
    toes, leap = plan.toes_m.copy(), plan.problem
    away = np.array([*(toe_m - toes[j])[:2], 0.0])
    toes[j] += away
    if patch_too:
        leap = replace(
            leap,
            footholds=tuple(
                moved(one, away) if number == j else one
                for number, one in enumerate(leap.footholds)
            ),
        )
    return replace(plan, toes_m=toes, problem=leap)


def moved(foothold: Foothold, away_m: np.ndarray) -> Foothold:
    """A foothold with all of its candidates elsewhere."""
    return replace(
        foothold,
        toe_m=None if foothold.toe_m is None else foothold.toe_m + away_m,
        candidates=tuple(
            replace(patch, vertices_m=patch.vertices_m + away_m) for patch in foothold.candidates
        ),
    )


def shifted(plan: Motion, away_m: np.ndarray) -> Motion:
    """All of a leap elsewhere: honest in itself, and no part of this crossing."""
    leap: Leap = plan.problem
    leap = replace(
        leap,
        footholds=tuple(moved(one, away_m) for one in leap.footholds),
        start=replace(leap.start, com_m=leap.start.com_m + away_m),
        goal=replace(leap.goal, com_m=leap.goal.com_m + away_m),
    )
    return replace(plan, problem=leap, com_m=plan.com_m + away_m, toes_m=plan.toes_m + away_m)


if __name__ == "__main__":
    launch(main, Asked, __doc__)
