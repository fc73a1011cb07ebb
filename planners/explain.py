"""Why is a posture infeasible? What its certificate says of the reason: the smallest change that would help."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .outcome import Certificate
from .refute import check_certificate, leaf_bounds, numbers_of, replay
from .scene import PostureProblem

FRICTION_CAP, REACH_CAP_M, FORCE_CAP, RADIUS_CAP_M, TILT_CAP_RAD = 10.0, 1.0, 10.0, 1.0, 0.5 * math.pi
"""``explain`` looks no further: largest friction and tilt, largest growth of reach, force (in its scale), radius."""
BISECTIONS = 30


@dataclass(frozen=True, kw_only=True)
class Relaxation:
    """The least value of one parameter, the others as they are, at which a certificate stops refuting its problem.

    It is necessary, not sufficient: below ``needed`` the problem stays infeasible. needed: inf beyond the caps.
    leg: empty for parameters of the body. now, needed: in ``unit`` (SI; 1 for friction).
    """

    parameter: str
    leg: str
    now: float
    needed: float
    unit: str

    @property
    def relative(self) -> float:
        """Growth over the value now; inf where that is 0."""
        return (self.needed - self.now) / self.now if self.now > 0.0 else math.inf


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Why a problem is infeasible: what each single parameter would have to become, the cheapest growth first."""

    relaxations: tuple[Relaxation, ...]
    message: str

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; an infinite ``needed`` becomes null."""
        rows = [{**vars(r), "needed": r.needed if math.isfinite(r.needed) else None} for r in self.relaxations]
        return {"relaxations": rows, "message": self.message}


def explain(problem: PostureProblem, certificate: Certificate, *, tolerance: float = 1e-4) -> Explanation:
    """Say how far each single parameter must grow before the certificate stops refuting the problem.

    Parameters: friction, reach and largest normal force of each contact, COM radius, tilt limit. A certificate that
    is not accepted explains nothing: no relaxations and a message that says why.
    """
    report = check_certificate(problem, certificate, tolerance=tolerance)
    if not report.accepted:
        return Explanation(relaxations=(), message=f"nothing to explain: {report.message}")
    numbers, leaves, least = numbers_of(problem), replay(problem, certificate), max(tolerance, 0.0)
    length, force = problem.length_scale_m, problem.moment_scale_nm / problem.length_scale_m
    found = []

    def search(name: str, leg: str, unit: str, now: float, cap: float, grow: Callable[[float], Array]) -> None:
        """Bisect on the growth in (0, cap]; the bounds fall as it grows."""
        low, high = 0.0, cap
        if cap <= 0.0 or np.all(grow(cap) > least):
            low = math.inf
        else:
            for _ in range(BISECTIONS):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if np.all(grow(middle) > least) else (low, middle)
        found.append(Relaxation(parameter=name, leg=leg, now=now, needed=now + low, unit=unit))

    for i, contact in enumerate(problem.contacts):
        one = np.eye(len(problem.contacts))[i]
        outermost = np.zeros(leaves.upper.shape, dtype=bool)
        outermost[:, i, 0] = leaves.upper[:, i, 0] == contact.force_max[0]

        def friction(by: float, one: Array = one) -> Array:
            return leaf_bounds(replace(numbers, friction=numbers.friction + by * one), leaves)

        def reach(by: float, one: Array = one) -> Array:
            return leaf_bounds(replace(numbers, reach=numbers.reach + by / length * one), leaves)

        def normal_force(by: float, outermost: NDArray[np.bool_] = outermost) -> Array:
            return leaf_bounds(numbers, replace(leaves, upper=leaves.upper + by / force * outermost))

        mu = contact.patch.friction
        search("friction", contact.leg, "1", mu, FRICTION_CAP - mu, friction)
        search("reach", contact.leg, "m", contact.reach_m, REACH_CAP_M, reach)
        search("force_max", contact.leg, "N", float(contact.force_max[0]) * force, FORCE_CAP * force, normal_force)
    search(
        "com_radius", "", "m", problem.com_radius_m, RADIUS_CAP_M,
        lambda by: leaf_bounds(replace(numbers, com_radius=numbers.com_radius + by / length), leaves),
    )  # fmt: skip
    search(
        "tilt_limit", "", "rad", problem.tilt_limit_rad, TILT_CAP_RAD - problem.tilt_limit_rad,
        lambda by: leaf_bounds(replace(numbers, tilt=numbers.tilt + by), leaves),
    )  # fmt: skip
    found.sort(key=lambda r: (math.isinf(r.needed), r.relative, r.needed - r.now))
    return Explanation(relaxations=tuple(found), message=_cheapest(found[0]))


def _cheapest(first: Relaxation) -> str:
    if math.isinf(first.needed):
        return "infeasible for more than one reason: no single parameter, however large, lifts this proof"
    name = first.parameter + (f" of {first.leg}" if first.leg else "")
    unit = "" if first.unit == "1" else f" {first.unit}"
    change = f" ({100.0 * first.relative:+.2g} %)" if math.isfinite(first.relative) else ""
    values = f"from {first.now:.4g}{unit} to at least {first.needed:.4g}{unit}"
    return f"infeasible: the cheapest single change is {name}, {values}{change}"
