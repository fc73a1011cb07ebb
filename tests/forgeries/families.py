"""All families of forgeries: the honest thing bound into every kind, the verifier's word, and the
judge's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from stancekit.planners.verify import check_certificate, check_plan
from stancekit.planners.verify.trajectories import check_trajectory

from . import judge_walks, links, stances, walks
from .crawl import crawl


@dataclass(frozen=True, kw_only=True)
class Family:
    """kinds: by name, what forges one of a size; verdict: whether it is accepted, and the group
    that refused it.
    """

    name: str
    kinds: Mapping[str, Callable[[float, np.random.Generator], Any]]
    verdict: Callable[[Any], tuple[bool, str]]
    judge: Callable[[Any], str]


def families() -> Iterator[Family]:
    """Walks, plans, links, postures, proofs."""
    walk = crawl()
    yield Family(
        name="walks",
        kinds={name: partial(forge, walk) for name, forge in walks.KINDS.items()},
        verdict=lambda one: _of_report(check_trajectory(one)),
        judge=judge_walks.inexecutable,
    )
    plan = stances.honest_plan()
    yield Family(
        name="plans",
        kinds={name: partial(forge, plan) for name, forge in stances.PLANS.items()},
        verdict=lambda one: _of_report(check_plan(one)),
        judge=stances.plan_fault,
    )
    yield Family(name="links", kinds=links.KINDS, verdict=links.verdict, judge=links.fault)
    posture = stances.honest_posture()
    yield Family(
        name="postures",
        kinds={name: partial(forge, posture) for name, forge in stances.POSTURES.items()},
        verdict=lambda one: _of_report(check_plan(one)),
        judge=stances.posture_fault,
    )
    proofs = stances.proof_kinds()
    yield Family(
        name="proofs",
        kinds=proofs,
        verdict=lambda pair: (check_certificate(pair[1].of(pair[0])).accepted, "proof"),
        judge=lambda pair: "there is a posture" if stances.has_witness(pair[0]) else "",
    )


def _of_report(report: Any) -> tuple[bool, str]:
    return report.accepted, report.refused[0].name if report.refused else report.defect
