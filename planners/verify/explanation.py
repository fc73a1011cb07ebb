"""Why is there no posture, or no plan? What a certificate says of the reason: the smallest change
that would help.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.certificate import Certificate
from ..files.arrays import Array, lengths
from ..problem import Problem
from ..problem.contact import LINEAR
from ..problem.leap import Leap
from ..problem.passage import Passage
from .certificate import GAP, Forest, check_certificate, forest_of, posture_problem
from .lagrangian import (
    Leaves,
    Numbers,
    body_pulls,
    half_space_pulls,
    leaf_bounds,
    least_lagrangians,
    multipliers_of,
    with_sides,
)


@dataclass(frozen=True, kw_only=True)
class Relaxation:
    """The least value of one parameter, the others as they are, at which a certificate stops
    refuting its problem.

    It is necessary, not sufficient: below ``needed`` the problem stays infeasible.

    Arguments:
        needed: inf beyond the caps.
        leg: empty for parameters of the body, and of a course, whose parameters say where
            themselves.
        now, needed: in ``unit`` (SI; 1 for friction).
        frame, limbs: the key frame and the limbs that it is about; None and none where it is about
            all of them.
    """

    parameter: str
    leg: str
    now: float
    needed: float
    unit: str
    frame: int | None = None
    limbs: tuple[str, ...] = ()

    @property
    def relative(self) -> float:
        """Growth over the value now; inf where that is 0."""
        return (self.needed - self.now) / self.now if self.now > 0.0 else math.inf

    @property
    def words(self) -> str:
        """A few words beside a limb: what it has, and what it would need."""
        name, unit = self.parameter.partition(" ")[0], "" if self.unit == "1" else f" {self.unit}"
        if math.isinf(self.needed):
            return f"{name} {self.now:.4g}{unit}, and more of it does not help"
        bound = "needs" if self.needed > self.now else "holds at most"
        return f"{name} {self.now:.4g}{unit}, {bound} {self.needed:.3g}{unit}"


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Why a problem is infeasible, as ``explain`` says it.

    Arguments:
        relaxations: what each single parameter would have to become, the cheapest growth first.
        message: the first of them in one line.
    Source:
        Lagrangian bounds of E1-E11.

    Example:
        >>> import stancekit
        >>> outcome = stancekit.solve(stancekit.sample("wall-3", rng=8)[0])
        >>> stancekit.explain(outcome).relaxations[0].leg
        'RR'
    """

    relaxations: tuple[Relaxation, ...]
    message: str

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; an infinite ``needed`` becomes null."""
        rows = [
            {**vars(r), "needed": r.needed if math.isfinite(r.needed) else None}
            for r in self.relaxations
        ]
        return {"relaxations": rows, "message": self.message}


LIMITS = ("friction", "force", "reach", "body", "tilt")
"""Limits of all limbs together: friction, largest normal force, reach, the room of the centre of
mass, and the body's tilt."""
_GROWTHS = (0.1, 0.3, 1.0)
"""Shares by which every limit grows: the first that weakens a proof says which does most."""
SEVERAL = "several"
"""Where no single limit, twice as large, weakens the proof."""


def hindrances(certificates: Sequence[Certificate]) -> list[str]:
    """For each certificate, the limit whose relative growth, all else equal, lowers the proved
    bound most.

    The certificates are accepted, of posture problems that differ in their patches alone. A body
    without tilt gets none.
    """
    if not certificates:
        return []
    forest = Forest.of_postures([posture_problem(each) for each in certificates])
    leaves = forest.leaves({k: forest.replay(k, each) for k, each in enumerate(certificates)})
    numbers, names = forest.numbers, [SEVERAL] * len(certificates)
    now, of_limits = _bounds(numbers, leaves), {"force": leaves.upper[..., 0]}
    of_limits |= {name: getattr(numbers, field) for name, field in _FIELDS.items()}
    for share in _GROWTHS:
        grown = np.array(
            [_bounds(*_grown(numbers, leaves, name, share * of_limits[name])) for name in LIMITS]
        )
        for k in np.flatnonzero(grown.min(axis=0) < now - 1e-12):
            if names[k] == SEVERAL:
                names[k] = LIMITS[int(grown[:, k].argmin())]
    return names


def _bounds(numbers: Numbers, leaves: Leaves) -> Array:
    """Bound that the weakest leaf of every problem proves, shape (Q,)."""
    starts = np.searchsorted(leaves.problem, np.arange(len(numbers.friction)))
    return np.asarray(np.minimum.reduceat(leaf_bounds(numbers, leaves), starts))


_FIELDS = {"friction": "friction", "reach": "reach", "body": "com_radius", "tilt": "tilt"}
"""Limits that are a table of numbers."""


def _grown(
    numbers: Numbers, leaves: Leaves, limit: str, by: Array | float
) -> tuple[Numbers, Leaves]:
    """Problems with a limit of ``LIMITS`` larger by so much, non-dimensional; the force where its
    box has not been cut.
    """
    if limit == "force":
        most = numbers.force_max[leaves.problem, :, 0]
        upper = leaves.upper.copy()
        upper[..., 0] += by * (upper[..., 0] == most)
        return numbers, replace(leaves, upper=upper)
    changed: dict[str, Any] = {_FIELDS[limit]: getattr(numbers, _FIELDS[limit]) + by}
    if limit == "reach":
        reach = np.broadcast_to(by, numbers.reach.shape)
        changed["row_bounds"] = numbers.row_bounds + reach[:, numbers.schedule.row_limb]
    return replace(numbers, **changed), leaves


def halved(
    proves: Callable[[float], bool], low: float, high: float, times: int
) -> tuple[float, float]:
    """Ends of an interval that is halved so often: it still proves at the lower one, and no longer
    at the other.
    """
    for _ in range(times):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if proves(middle) else (low, middle)
    return low, high


_FRICTION_CAP, _REACH_CAP_M, _FORCE_CAP, _RADIUS_CAP_M, _TILT_CAP_RAD = (
    10.0,
    1.0,
    10.0,
    1.0,
    0.5 * math.pi,
)
"""``explain`` looks no further: largest friction and tilt, largest growth of reach, force (in its
scale), radius."""
_OF_COURSE = "of this course as it states its layout"
"""Subject of a proof about a course, whose frames, candidates and limits are part of the question."""
_FALLING = ("steps.progress_m", "steps.least_toe_m", "steps.least_rotation_rad")
"""Limits that have to fall."""
_SIDES = 64
"""Of the pyramids around friction cones by which it asks whether feet slip."""
_BISECTIONS = 30
_MOST_GRIP, _MOST_LENGTH, _COURSE_BISECTIONS = 3.0, 2.0, 12
"""For courses it looks no further than these (friction, to one part in 4,096; m or rad)."""


def explain(certificate: Certificate, *, tolerance: float | None = None) -> Explanation:
    """Measure how far each single parameter must change before a certificate fails: the parameters
    of a posture problem, the cheapest growth first, those of a course's weakest leaf, the one that
    changes least first, or friction and reach of a leap.

    A certificate that is not accepted explains nothing: no relaxations, and the message says why.

    Arguments:
        tolerance: as for ``check_certificate``; a leap has none.

    Raises:
        InvalidInput: for one that does not know its problem.
    """
    subject = certificate.refuted
    if isinstance(subject, Leap):
        from .leap_proof import explain_leap  # of leaps alone

        return explain_leap(certificate)
    if isinstance(subject, Passage):
        from .flood import explain_flood  # of passages alone

        return explain_flood(certificate)
    report = check_certificate(certificate, tolerance=tolerance)
    if not report.accepted:
        return Explanation(relaxations=(), message=f"nothing to explain: {report.message}")
    forest = forest_of(subject)
    leaves = forest.leaves({0: forest.replay(0, certificate)})
    slip = _slip(subject, forest.numbers)
    if slip is not None:  # wherever they are
        where = slip.parameter.removeprefix("friction everywhere, for ")
        reason = f"feet slip at {where}: friction everywhere would have to {_change(slip)}"
        explanation = Explanation(relaxations=(slip,), message=f"infeasible: {reason}")
    elif not subject.is_posture:
        explanation = _of_course(subject, forest.numbers, leaves)
    else:
        explanation = _of_posture(
            subject, forest.numbers, leaves, max(GAP if tolerance is None else tolerance, 0.0)
        )
    return explanation if subject.wrench is None else _of_wrench(subject, forest, explanation)


def _of_posture(problem: Problem, numbers: Numbers, leaves: Leaves, least: float) -> Explanation:
    unit_m, force = problem.unit_m, problem.force_n
    relaxations = []

    def search(
        name: str, leg: str, unit: str, now: float, cap: float, limit: str, along: Array | float
    ) -> None:
        """Bisect on the growth in (0, cap] of a limit along a direction; the bounds fall as it
        grows.
        """

        def proves(by: float) -> bool:
            return bool(np.all(leaf_bounds(*_grown(numbers, leaves, limit, by * along)) > least))

        lifts = cap > 0.0 and not proves(cap)
        by = halved(proves, 0.0, cap, _BISECTIONS)[0] if lifts else math.inf
        limbs = (leg,) if leg else ()
        relaxations.append(
            Relaxation(
                parameter=name, leg=leg, now=now, needed=now + by, unit=unit, frame=0, limbs=limbs
            )
        )

    for i, contact in enumerate(problem.contacts):
        one, mine = np.eye(len(problem.contacts))[i], numbers.schedule.limb == i
        mu, leg, most = contact.patch.friction, contact.leg, float(contact.force_max[0]) * force
        search("friction", leg, "1", mu, _FRICTION_CAP - mu, "friction", one)
        search("reach", leg, "m", contact.reach_m, _REACH_CAP_M, "reach", one / unit_m)
        search("force_max", leg, "N", most, _FORCE_CAP * force, "force", mine / force)
    radius_m, tilt = float(problem.com_radius_m[0]), float(numbers.tilt[0])
    search("com_radius", "", "m", radius_m, _RADIUS_CAP_M, "body", 1.0 / unit_m)
    search("tilt_limit", "", "rad", tilt, _TILT_CAP_RAD - tilt, "tilt", 1.0)
    relaxations.sort(key=lambda r: (math.isinf(r.needed), r.relative, r.needed - r.now))
    return Explanation(relaxations=tuple(relaxations), message=_cheapest(relaxations[0]))


def _cheapest(first: Relaxation) -> str:
    if math.isinf(first.needed):
        return "infeasible for more than one reason: no single parameter, however large, lifts this proof"
    name = first.parameter + (f" of {first.leg}" if first.leg else "")
    unit = "" if first.unit == "1" else f" {first.unit}"
    percent = 100.0 * first.relative
    change = (
        f" ({percent:{'+.2g' if percent < 99.5 else '+.0f'}} %)" if math.isfinite(percent) else ""
    )
    values = f"from {first.now:.4g}{unit} to at least {first.needed:.4g}{unit}"
    return f"infeasible: the cheapest single change is {name}, {values}{change}"


def _of_wrench(problem: Problem, forest: Forest, found: Explanation) -> Explanation:
    """Add the stance that holds the least of the wrench first, where that is the reason."""
    from .wrench_held import least_held  # Clarabel, of this alone

    held = least_held(forest.numbers, forest.patches)
    if held is None or problem.wrench is None:
        return found
    stance, share = problem.stances[held[0]], held[1]
    limbs = tuple(problem.legs[limb] for limb in stance.limbs)
    where = " ".join(limbs)
    where += "" if problem.is_posture else f" at frame {stance.frame}"
    force, moment = (float(lengths(part)) for part in np.split(problem.wrench[stance.frame], 2))
    now, unit = (force, "N") if force > 0.0 else (moment, "Nm")
    most = Relaxation(
        parameter=f"wrench on {where}",
        leg="",
        now=now,
        needed=share * now,
        unit=unit,
        frame=stance.frame,
        limbs=limbs,
    )
    message = f"infeasible: holds {most.needed:.3g} {unit} at most, of {now:.4g} {unit}: {where}"
    return Explanation(relaxations=(most, *found.relaxations), message=message)


def _of_course(course: Problem, numbers: Numbers, leaves: Leaves) -> Explanation:
    """The reason of the leaf whose Lagrangian is the least."""
    values, empty = least_lagrangians(numbers, leaves)
    value = np.where(empty, np.inf, values[1])
    weakest, groups = int(value.argmin()), int(np.sum(~empty))
    if not groups:
        return Explanation(relaxations=(), message="infeasible: no leaf has a choice left")
    relaxations, where = _limits(
        course, numbers, leaves.part(weakest, weakest + 1), float(value[weakest])
    )
    relaxations.sort(key=lambda r: abs(r.needed - r.now) / max(r.now, 0.05))
    if not relaxations or math.isinf(relaxations[0].needed):
        reason = f"the balances at {where} cannot be held; no single limit, however large, lifts this proof"
    else:
        first, *others = (r for r in relaxations if math.isfinite(r.needed))
        reason = f"with all else as it is, {first.parameter} would have to {_change(first)}"
        slippery = [r for r in others if r.parameter.startswith("friction")]
        if slippery and not first.parameter.startswith("friction"):
            reason += f", or {slippery[0].parameter} to {_change(slippery[0])}"
    many = f" (refuted for each of {groups} groups of choices)" if groups > 1 else ""
    return Explanation(
        relaxations=tuple(relaxations), message=f"infeasible: {reason}{many}; {_OF_COURSE}"
    )


def _slip(course: Problem, numbers: Numbers) -> Relaxation | None:
    """Least friction everywhere with which the feet of every stance could bear the weight, whatever
    the moments; None where it is there, or where no friction would do.

    The forces of the feet are in the sum of the cones of all their candidates, and the weight has
    to be, too.
    """
    if course.wrench is not None or numbers.force_min[0, :, 0].min(initial=0.0) < 0.0:
        return None
    turn = 2.0 * np.pi / _SIDES * np.arange(_SIDES)
    around = np.stack([np.cos(turn), np.sin(turn)])
    least, most, worst = 0.0, 0.0, None
    presses = course.force_bounds[1][:, 0] > 0.0

    def slips(candidates: NDArray[np.bool_], grip: float) -> bool:
        from scipy.optimize import nnls  # slow to import

        n, y, z = np.moveaxis(numbers.frames[0, candidates], -1, 0)
        friction = (numbers.friction[0, candidates] + grip) / np.cos(np.pi / _SIDES)
        shear = np.tensordot(around, np.stack([y, z]), axes=(0, 0))
        edges = (n + friction[:, None] * shear).reshape(-1, 3).round(9)
        return bool(nnls(np.unique(edges, axis=0).T, np.array([0.0, 0.0, 1.0]))[1] >= 1e-7)

    for stance in course.stances:
        holds = numbers.schedule.holds[stance.frame, list(stance.limbs)]
        under = np.isin(numbers.candidate, holds) & presses[numbers.candidate]
        if not under.any() or not slips(under, most):
            continue
        least, most, worst = most, _MOST_GRIP, stance
        if slips(under, most):
            return None
        least, most = halved(partial(slips, under), least, most, _COURSE_BISECTIONS)
    if worst is None or least == 0.0:  # any grip would do, if feet could press without end
        return None
    limbs = tuple(course.robot.limb_names[i] for i in worst.limbs)
    now = float(numbers.friction[0].max())
    return Relaxation(
        parameter=f"friction everywhere, for frame {worst.frame} on {', '.join(limbs)}",
        leg="",
        now=now,
        needed=now + least,
        unit="",
        frame=worst.frame,
        limbs=limbs,
    )


def _change(one: Relaxation) -> str:
    """Words for a change: which way, from which value, and to which at least or at most."""
    unit, rises = f" {one.unit}".rstrip(), one.needed > one.now
    verb, least = ("rise", "at least") if rises else ("fall", "at most")
    if (change := abs(one.needed - one.now)) < 1e-3:  # three digits would not show it
        return (
            f"{verb} from {one.now:.3g}{unit} by at least {_on_this_side(change, True):.3g}{unit}"
        )
    return (
        f"{verb} from {one.now:.3g}{unit} to {least} {_on_this_side(one.needed, rises):.3g}{unit}"
    )


def _on_this_side(value: float, rises: bool) -> float:
    """Three digits of a bound, rounded to where it is still one."""
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 2) if value else 1.0
    return (math.floor if rises else math.ceil)(value / step) * step


def _limits(
    course: Problem, numbers: Numbers, leaf: Leaves, value: float
) -> tuple[list[Relaxation], str]:
    """Values of each limit that would lift one leaf's proof, all else as it is; and where the proof
    pulls most.
    """
    names, who = course.robot.limb_names, numbers.schedule
    m = multipliers_of(who, leaf.multipliers)
    pushes = (lengths(m["nu_F"]) + lengths(m["nu_M"]))[0]
    hardest = int(pushes.argmax())
    stance = course.stances[hardest]
    limbs = tuple(names[i] for i in stance.limbs)
    where = f"frame {stance.frame} on {', '.join(limbs)}"
    relaxations = _lengths(course, numbers, leaf, m, value)
    if pushes[hardest] > 1e-6:
        under = np.isin(numbers.candidate, who.holds[stance.frame, list(stance.limbs)])
        now = float(
            numbers.friction[0, under & (leaf.pieces[0] >= 0)].max()
        )  # ice is there, too: the best grip
        for place, there, at, by_limbs in (
            (f"at {where}", under, stance.frame, limbs),
            ("everywhere", np.ones_like(under), None, ()),
        ):
            needed = now + _grip(numbers, leaf, there)
            relaxations.append(
                Relaxation(
                    parameter=f"friction {place}",
                    leg="",
                    now=now,
                    needed=needed,
                    unit="",
                    frame=at,
                    limbs=by_limbs,
                )
            )
            if math.isfinite(needed):
                break
    return relaxations, where


def _lengths(
    course: Problem, numbers: Numbers, leaf: Leaves, m: Mapping[str, Array], value: float
) -> list[Relaxation]:
    """Every limit that the Lagrangian is linear in, where a change within reason lifts the
    proof.
    """
    unit_m, steps = course.unit_m, course.steps
    gripped, reach = (
        half_space_pulls(numbers.schedule, numbers.row_normals[leaf.problem], m),
        lengths(m["reach"])[0],
    )
    if gripped is not None:
        for h, limb in enumerate(numbers.schedule.row_limb):
            reach[:, limb] += m["reach_rows"][0, :, h]
    pulls = m["reach"] if gripped is None else m["reach"] + gripped
    linear = with_sides(numbers, leaf)[2]
    pull = lengths(body_pulls(numbers, leaf.problem, pulls, m, linear)[0])[0]
    of_toes = numbers.schedule.least_toes
    between = m["relative_reach"][0]
    between, least_toes = np.split(between, [len(between) - of_toes])
    shares = np.maximum(leaf.sides[0, :, 3], 0.0)  # h δ of each least step
    least_toes = least_toes @ shares[:of_toes] / max(steps.least_toe_m / unit_m, 1e-9)
    least_turns = (
        m["linear_step"][0, :, -1:].sum(axis=1)[: len(shares) - of_toes] @ shares[of_toes:]
    )
    least_turns /= max(steps.least_rotation_rad, 1e-9)
    frame, limb = (int(i) for i in np.unravel_index(int(reach.argmax()), reach.shape))
    worst, owner = int(pull.argmax()), course.robot.limbs[limb]
    rows = (
        (
            float(reach[frame, limb]),
            f"reach of {owner.name} at frame {frame}",
            owner.reach_m,
            unit_m,
            "m",
        ),
        (
            float(reach.sum()),
            "reach of all limbs",
            min(limb.reach_m for limb in course.robot.limbs),
            unit_m,
            "m",
        ),
        (float(lengths(m["com_step"]).sum()), "steps.com_m", steps.com_m, unit_m, "m"),
        (float(lengths(m["toe_step"]).sum()), "steps.toe_m", steps.toe_m, unit_m, "m"),
        (float(between.sum()), "reach between feet", 0.0, unit_m, "m"),
        (float(least_toes), "steps.least_toe_m", steps.least_toe_m, unit_m, "m"),
        (float(least_turns), "steps.least_rotation_rad", steps.least_rotation_rad, 1.0, "rad"),
        (
            float(lengths(m["rotation_step"]).sum()),
            "steps.rotation_rad",
            steps.rotation_rad,
            1.0,
            "rad",
        ),
        (
            float(pull[worst]),
            f"com_radius_m at frame {worst}",
            float(course.com_radius_m[worst]),
            unit_m,
            "m",
        ),
        (float(m["progress"].sum()), "steps.progress_m", steps.progress_m, unit_m, "m"),
        *_linear(course, m),
    )
    about: dict[str, tuple[int, tuple[str, ...]]] = {
        f"reach of {owner.name} at frame {frame}": (frame, (owner.name,)),
        f"com_radius_m at frame {worst}": (worst, ()),
    }
    relaxations = []
    for size, name, now, scale, unit in rows:
        falls = name in _FALLING
        by = value / size * scale if size > 1e-9 else math.inf
        if by <= (now if falls else _MOST_LENGTH):
            at, limbs = about.get(name, (None, ()))
            relaxations.append(
                Relaxation(
                    parameter=name,
                    leg="",
                    now=now,
                    needed=now - by if falls else now + by,
                    unit=unit,
                    frame=at,
                    limbs=limbs,
                )
            )
    return relaxations


def _linear(
    course: Problem, m: Mapping[str, Array]
) -> Iterator[tuple[float, str, float, float, str]]:
    """(pull, name, limit, scale, unit) of further limits of the body's steps."""
    rows = np.repeat(
        list(course.steps.linear), [len(LINEAR[name][2]) for name in course.steps.linear]
    )
    used = m["linear_step"][0][:, : len(rows)]
    for name, limit in course.steps.linear.items():
        unit = LINEAR[name][1]
        pull = float(used[:, rows == name].sum())
        yield pull, f"steps.{name}", limit, course.unit_m if unit == "m" else 1.0, unit


def _grip(numbers: Numbers, leaf: Leaves, under: NDArray[np.bool_]) -> float:
    """Least friction on top, for all candidates in these candidates, that lifts a leaf's proof; inf
    where none does.
    """

    def proves(grip: float) -> bool:
        values, _ = least_lagrangians(
            replace(numbers, friction=numbers.friction + grip * under), leaf
        )
        return bool(values[1, 0] > 0.0)

    if proves(_MOST_GRIP):
        return math.inf
    return halved(proves, 0.0, _MOST_GRIP, _COURSE_BISECTIONS)[0]
