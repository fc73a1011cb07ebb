"""The verifier's word on an answer, as plain values: a group per kind of constraint, and a report
of them.

One report and one group are of everything that is judged: postures, plans of key frames, walks, and
proofs that there is no answer. Judging and explaining are functions of the layers above
(``verify``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Generic, Literal, TypeVar

from ..arguments import cached_property
from .motion import Evidence, seal
from .plan import LEAP_BODY, MARGIN, WHOLE_BODY

GROUPS = MappingProxyType(
    {
        "patch": "m",
        "force_balance": "N",
        "moment_balance": "Nm",
        "friction": "N",
        "force_bounds": "N",
        "reach": "m",
        "tilt": "rad",
        "com": "m",
    }
)
"""The groups of constraints of a posture in the order of a report, and the unit of what is
violated."""
PLAN_GROUPS = MappingProxyType(
    {
        **GROUPS,
        "terrain": "m",
        "idle_force": "N",
        "start": "m",
        "schedule": "",
        "com_step": "m",
        "toe_step": "m",
        "relative_reach": "m",
        "rotation_step": "rad",
        "progress": "m",
    }
)
"""Those of a plan: those of its stances, and what couples its key frames."""
LATE = "the time limit ended"
"""The beginning of a group's message where the time ended before the group was checked."""
_NOWHERE = {
    "schedule": "no limb carries there as the schedule says",
    "terrain": "its foothold is no piece of the terrain",
}
"""What it means that a group's value is infinite."""
S = TypeVar("S", bound=Evidence, covariant=True)
_Verdict = Literal["holds", "violated", "not checked", "not asked for"]
_BODY_VERDICTS = {"holds": "checked", "violated": "failed"}
"""The words of a line for the verdicts on joints, torque, bodies and motion."""


@dataclass(frozen=True, slots=True)
class Group:
    """The verifier's word on one group of constraints.

    Arguments:
        name: name of the group, unique in its report.
        value: the worst that was measured, in ``unit``; 0 where nothing is violated, inf where
            nothing could be measured.
        limit: largest value that is accepted, in ``unit``.
        unit: unit of both, SI; "1" or empty for a share.
        where: limb, "limb component", foot, joint or link, "torso", or an axis; empty for the whole
            body.
        when: key frame, with the share of the way to the next as its fraction, or seconds of a
            walk; None where the group has no moment.
        limb: limb of ``where``; empty if it is no limb.
        message: why the group is violated or was not checked, in words.
        scale: value of a violation of 1, for groups whose values are violations; else None.
        verdict: "holds", "violated", "not checked" or "not asked for"; if empty, value and limit
            are compared.
        figures: further measurements, for people and files.
    Source:
        E1-E11; W2-W7.

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.verify(stancekit.solve(problem).solution).group("reach").verdict
        'holds'
    """

    name: str
    value: float = 0.0
    limit: float = 0.0
    unit: str = ""
    where: str = ""
    when: float | None = None
    limb: str = ""
    message: str = ""
    scale: float | None = None
    verdict: _Verdict | Literal[""] = ""
    figures: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.verdict:
            object.__setattr__(self, "verdict", "holds" if self.value <= self.limit else "violated")

    @property
    def worst(self) -> float:
        """The violation without its unit, 0 where there is none: the value in ``scale``, or what of
        it is beyond the limit, as a share of the limit.
        """
        if self.scale is not None:
            return self.value / self.scale
        if self.value <= self.limit:
            return 0.0
        return (self.value - self.limit) / self.limit if self.limit > 0.0 else math.inf

    @property
    def frame(self) -> int:
        """The key frame, −1 where the group has no moment."""
        return -1 if self.when is None else math.floor(self.when)

    @property
    def share(self) -> float:
        """Share of the way from its key frame to the next at which the moment is."""
        return 0.0 if self.when is None else self.when % 1.0

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; what is not finite becomes null."""
        return {
            "group": self.name,
            "verdict": self.verdict,
            "value": or_null(self.value),
            "limit": or_null(self.limit),
            "worst": or_null(self.worst),
            "unit": self.unit,
            "where": self.where,
            "limb": self.limb,
            "when": self.when,
            "message": self.message,
            "figures": dict(self.figures),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Report(Generic[S]):
    """The verifier's word on a posture, a plan, a walk, or a proof that there is no answer.

    Arguments:
        groups: each group of constraints with its worst place.
        answer: the answer judged, with its problem.
        tolerance: largest violation that is accepted, without unit; 0 of a walk, whose groups have
            limits of their own.
        figures: further measurements, of which none is judged. Of a posture and a plan:
            residual_nm, the norm of the net moment about the centre of mass at the worst stance
            [Nm]; linearisation_m, farthest that I + [Θ]× puts a shoulder from where exp([Θ]×) does
            [m]; exact_reach_m, how far a toe is out of reach with the exact rotation [m]. Of a
            plan, too: between, the largest violation at the points between frames; proved, on how
            many steps from frame to frame limbs carry all the way; goal_m, distance of the last
            centre of mass from the goal [m]. Of a walk: peak acceleration and balances in units of
            g and m·g, the friction that the standing feet need, that which the ground within 15 mm
            of them would need, and the share of their samples outside their cones. Of a proof:
            lower_bound, the proved least moment residual; leaves, how many were checked; weakest,
            the leaf of the least bound.
        limits: for a walk, the limit of each group by name; else empty.
        defect: reason why nothing could be checked; else empty.
        remark: margin in words: the push that a posture or every stance of a plan bears, or the
            friction that the feet of a walk need; empty if not measured.
        said: for a proof, the verdict in one line by its judge; else it is composed from the
            groups.
        more_doubts: what the reader of a ground's file mended or left out, one line each.
    Source:
        E1-E11; W2-W7, between the knots, too; Lagrangian bounds of E1-E11 of a proof.

    Example:
        >>> import stancekit
        >>> report = stancekit.plan("walls", frames=2).report
        >>> report.accepted, report.group("torque").verdict
        (True, 'holds')
    """

    groups: tuple[Group, ...]
    answer: S = field(repr=False)
    tolerance: float
    figures: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    defect: str = ""
    remark: str = ""
    said: str = ""
    more_doubts: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"Report({self.message})"

    @property
    def doubts(self) -> tuple[str, ...]:
        """What readers of the robot's and the ground's files guessed, mended or left out, one line
        each.
        """
        return tuple(dict.fromkeys((*self.answer.doubts, *self.more_doubts)))

    @property
    def accepted(self) -> bool:
        """No group is violated, and there was something to check."""
        return not self.defect and not any(group.verdict == "violated" for group in self.groups)

    @property
    def worst(self) -> float:
        """Largest violation of all groups without unit; of a plan, those of contacts."""
        return max(group.worst for group in self._of_contacts)

    @property
    def contacts(self) -> bool:
        """Tell whether a plan's contacts are within the tolerance, whatever the joints can do."""
        return not self.defect and not any(
            group.verdict == "violated" for group in self._of_contacts
        )

    def group(self, name: str) -> Group:
        """The group of that name; raises KeyError for a name that the report does not have."""
        for group in self.groups:
            if group.name == name:
                return group
        raise KeyError(
            f"expected one of {', '.join(group.name for group in self.groups)}, got {name!r}"
        )

    @property
    def refused(self) -> tuple[Group, ...]:
        """The groups that are violated, the worst first."""
        broken = [group for group in self.groups if group.verdict == "violated"]
        return tuple(sorted(broken, key=lambda g: -g.value / max(g.limit, 1e-12)))

    @property
    def checked(self) -> tuple[str, ...]:
        """The groups that were judged; those of contacts are one, "contacts", of a posture and of a
        plan.
        """
        judged = [group.name for group in self.groups if group.verdict in _BODY_VERDICTS]
        body = set(self._body) - {MARGIN}
        return ("contacts", *(name for name in judged if name in body)) if body else tuple(judged)

    @property
    def unchecked(self) -> tuple[str, ...]:
        """The requested groups that could not be checked."""
        return tuple(group.name for group in self.groups if group.verdict == "not checked")

    @property
    def late(self) -> bool:
        """Tell whether some groups were left unchecked since the time had ended."""
        return any(
            group.verdict == "not checked" and group.message.startswith(LATE)
            for group in self.groups
        )

    @cached_property
    def hindrance(self) -> str:
        """Why no runner executes the motion, whatever the world; empty where one may."""
        return self.answer.hindrance(self.unchecked)

    @property
    def body_message(self) -> str:
        """One line on the requested groups of a plan's whole body; empty without any."""
        remarks = list[tuple[str, str]]()
        for group in self._of_body:
            if group.verdict == "not asked for" or (
                group.name == MARGIN and group.verdict == "holds"
            ):
                continue
            name, verdict = group.name, _BODY_VERDICTS.get(group.verdict, "NOT CHECKED")
            reason = f" ({group.message})" if group.message and verdict != "failed" else ""
            if reason and remarks and remarks[-1][1] == verdict + reason:
                name = f"{remarks.pop()[0]}, {name}"
            remarks.append((name, verdict + reason))
        return "; ".join(f"{name}: {verdict}" for name, verdict in remarks)

    @property
    def failures(self) -> str:
        """The groups of the whole body that failed, and why; empty where nothing did."""
        failed = [group for group in self._of_body if group.verdict == "violated"]
        return "; ".join(f"{group.name}: {group.message}" for group in failed)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of question, answer, verdict and what was checked, as canonical JSON; a runner asks
        for it.
        """
        return verdict_digest(
            {
                "accepted": self.accepted,
                "tolerance": or_null(self.tolerance),
                "checked": list(self.checked),
                "limits": dict(self.limits),
            },
            self.answer.digest,
        )

    @property
    def message(self) -> str:
        """One line: the verdict, what was not checked, every group that is refused, the worst
        first, and the reason if an accepted answer cannot be executed.
        """
        if self.said:
            return self.said
        if self.defect:
            return f"rejected: {self.defect}"
        if not self.accepted:
            return f"rejected: {'; '.join(map(self._refusal, self.refused))}"
        count = sum(group.verdict == "holds" for group in self.groups)
        each = "; " if self.unchecked else ": all "
        line = f"{acceptance_word(self.unchecked)}{each}{count} groups within their limits"
        return f"{line}; cannot be executed: {self.hindrance}" if self.hindrance else line

    def _refusal(self, group: Group) -> str:
        """Where and when a group is refused, and by how much; or why, where its judge says it."""
        if group.message:
            return f"{group.name}: {group.message}"
        moment = "" if group.when is None else self.answer.moment(group.when)
        place = f" ({', '.join(filter(None, (moment, group.where)))})".replace(" ()", "")
        if math.isinf(group.value):
            return f"{group.name}{place}: {_NOWHERE.get(group.name, 'no number')}"
        size, limit = (
            f"{number:.3g} {group.unit}".removesuffix(" 1").rstrip()
            for number in (group.value, group.limit)
        )
        return f"{group.name}{place}: {size}" + (f", limit {limit}" if group.limit else "")

    @cached_property
    def _body(self) -> tuple[str, ...]:
        return whole_body(self.answer)

    @property
    def _of_body(self) -> list[Group]:
        """The groups of a plan's whole body and of its margins, or of a leap's whole body."""
        return [group for group in self.groups if group.name in self._body]

    @property
    def _of_contacts(self) -> list[Group]:
        """All groups but those of the whole body and of margins."""
        return [group for group in self.groups if group.name not in self._body]

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; what is not finite becomes null."""
        return {
            "accepted": self.accepted,
            "message": self.message,
            "digest": self.digest,
            "tolerance": or_null(self.tolerance),
            "checked": list(self.checked),
            "not_checked": list(self.unchecked),
            "limits": dict(self.limits),
            "doubts": list(self.doubts),
            "figures": finite(self.figures),
            "groups": [group.to_json() for group in self.groups],
        }


def verdict_digest(verdict: Mapping[str, Any], answer: str) -> str:
    """SHA-256 of a verdict, as a report's JSON has it, and of the digest of what it speaks of.

    Raises KeyError for a verdict that is none.
    """
    told = {name: verdict[name] for name in ("accepted", "tolerance", "checked", "limits")}
    return seal({**told, "answer": answer})


def whole_body(answer: Evidence) -> tuple[str, ...]:
    """The groups of the whole body, beside those of contacts, by the columns that there are."""
    if not answer.has("choice"):
        return ()
    return LEAP_BODY if answer.has("timing") else (*WHOLE_BODY, MARGIN)


def acceptance_word(unchecked: Sequence[str]) -> str:
    """The word for what is accepted, with the groups that could not be checked."""
    if not unchecked:
        return "accepted"
    *most, last = unchecked
    names = f"{', '.join(most)} and {last} are" if most else f"{last} is"
    return f"accepted as far as checked: {names} not"


def or_null(number: float) -> float | None:
    """The number, or None where it is not finite: JSON has no other."""
    return number if math.isfinite(number) else None


def finite(figures: Mapping[str, float]) -> dict[str, float | None]:
    """Figures as JSON-ready values."""
    return {name: or_null(value) for name, value in figures.items()}
