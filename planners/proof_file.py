"""Proof files ``stancekit/no-plan/1``: a course and a certificate that it has no plan, checked anew by who reads it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .documents import read_json
from .files import write_text
from .outcome import InvalidInput
from .refute_plan import PlanCertificate, PlanRefutation, check_plan_certificate
from .scene.course import Course
from .scene.course_json import course_from_json, course_to_json

FORMAT = "stancekit/no-plan/1"
KEYS = ("format", "course", "tree", "multipliers")


@dataclass(frozen=True, kw_only=True, eq=False)
class ProofCheck:
    """What a look at a proof file says."""

    path: str
    course: str
    proof: PlanRefutation

    @property
    def accepted(self) -> bool:
        """The certificate in the file proves that the course in the file has no plan."""
        return self.proof.accepted

    @property
    def message(self) -> str:
        """One line."""
        return f"{self.course}: {self.proof.message}"

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {
            "where": self.path,
            "kind": "no-plan",
            "verdict": "accepted" if self.accepted else "refused",
            "message": self.message,
            "leaves": self.proof.leaves,
        }


def write_proof(path: str | Path, course: Course, certificate: PlanCertificate) -> None:
    """Write a course and its certificate, whole or not at all. Raises InvalidInput where nothing can be written."""
    content = {
        "format": FORMAT,
        "course": course_to_json(course),
        "tree": certificate.tree.tolist(),
        "multipliers": certificate.multipliers.tolist(),
    }
    write_text(path, json.dumps(content, allow_nan=False) + "\n")


def read_proof(path: str | Path) -> tuple[Course, PlanCertificate]:
    """Read what ``write_proof`` wrote. Raises InvalidInput in one line for anything else."""
    data = read_json(path)
    if not is_proof(data):
        raise InvalidInput(f"{path}: expected format {FORMAT!r}")
    if set(data) != set(KEYS):
        names = ", ".join(sorted(set(data) ^ set(KEYS)))
        raise InvalidInput(f"{path}: expected the keys {', '.join(KEYS)}; missing or unknown: {names:.120}")
    try:
        course = course_from_json(data["course"])
    except InvalidInput as error:
        raise InvalidInput(f"{path}: course: {error}") from None
    return course, PlanCertificate(
        tree=_table(path, data, "tree", np.int_), multipliers=_table(path, data, "multipliers", np.float64)
    )


def check_proof_file(path: str | Path) -> ProofCheck:
    """Check a proof file by the independent checker. Raises InvalidInput for a file that cannot be read."""
    course, certificate = read_proof(path)
    return ProofCheck(path=str(path), course=course.name, proof=check_plan_certificate(course, certificate))


def is_proof(data: Any) -> bool:
    """Do parsed contents say that they are a proof?"""
    return isinstance(data, dict) and data.get("format") == FORMAT


def _table(path: str | Path, data: Mapping[str, Any], name: str, kind: type) -> np.ndarray[Any, Any]:
    """A table of numbers. Raises InvalidInput for anything else, and for fractions where whole numbers are due."""
    told = "whole numbers" if kind is np.int_ else "numbers"
    try:
        found = np.array(data[name])
        if found.ndim != 2 or found.dtype.kind not in ("i" if kind is np.int_ else "if"):
            raise ValueError
    except (ValueError, TypeError, OverflowError):
        raise InvalidInput(f"{path}: {name}: expected a table of {told}") from None
    return found.astype(kind)
