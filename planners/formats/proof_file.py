"""Proof files ``stancekit/proof/1``: a posture problem or a course, and a certificate that it has
no answer. Whoever reads one checks it anew.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from ..answer.certificate import Certificate
from ..errors import InvalidInput
from ..files.arrays import Array, plain_numbers
from ..files.documents import read_json, shown
from ..files.writing import write_text
from ..problem import Problem
from ..problem.leap import Leap
from ..problem.passage import Passage
from ..problem.posture import FORMAT as POSTURE
from ..verify import check_certificate, explain
from .motion_file import FileCheck

FORMAT = "stancekit/proof/1"
KEYS = ("format", "subject", "tree", "multipliers")


def write_proof(path: str | Path, certificate: Certificate) -> None:
    """Write a certificate and its posture problem or course, whole or not at all.

    Raises InvalidInput where nothing can be written, and for a certificate of something else.
    """
    write_text(path, json.dumps(proof_content(certificate, path), allow_nan=False) + "\n")


def proof_content(certificate: Certificate, where: str | Path) -> dict[str, Any]:
    """Content of a proof's file.

    Raises InvalidInput for a proof about a leap.
    """
    subject = certificate.refuted
    if isinstance(subject, Leap):
        raise InvalidInput(
            f"{where}: expected a proof about a posture problem or a course, got one about a leap"
        )
    return {"format": FORMAT, "subject": subject.to_json(), **certificate.to_json()}


def read_proof(path: str | Path) -> tuple[Problem | Passage, Certificate]:
    """The problem or the passage, and its certificate, of what ``write_proof`` wrote.

    Raises InvalidInput in one line for anything else.
    """
    return proof_from(read_json(path), path)


def proof_from(data: Any, path: str | Path) -> tuple[Problem | Passage, Certificate]:
    """The problem and its certificate of a file's content, see ``read_proof``."""
    if not is_proof(data):
        came = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise InvalidInput(f"{path}: expected format {FORMAT!r}, got {shown(came)}")
    if set(data) != set(KEYS):
        names = ", ".join(sorted(set(data) ^ set(KEYS)))
        raise InvalidInput(
            f"{path}: expected the keys {', '.join(KEYS)}; missing or unknown: {names:.120}"
        )
    subject = data["subject"]
    of_passage = isinstance(subject, Mapping) and subject.get("format") == Passage.FORMAT
    try:
        problem = Passage.from_json(subject) if of_passage else Problem.from_json(subject)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: subject: {error}") from None
    try:
        certificate = Certificate.from_arrays(_table(data, "tree"), _table(data, "multipliers"))
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
    return problem, certificate.of(problem)


def check_proof_file(path: str | Path) -> FileCheck:
    """Check a proof file by the independent checker.

    Raises InvalidInput for a file that cannot be read.
    """
    subject, certificate = read_proof(path)
    proof = check_certificate(certificate)
    reason = explain(certificate).message if proof.accepted else proof.message
    kind: Literal["no-plan", "no-posture"] = "no-plan"
    name = subject.name
    if isinstance(subject, Problem) and subject.is_posture:
        kind, name = "no-posture", f"posture on {', '.join(subject.legs)}"
    return FileCheck(path=str(path), kind=kind, report=proof, message=f"{name}: {reason}")


def is_proof(data: Any) -> bool:
    """Do parsed contents say that they are a proof?"""
    return isinstance(data, dict) and data.get("format") == FORMAT


def _is_posture(data: Any) -> bool:
    return isinstance(data, dict) and data.get("format") == POSTURE


def _table(data: Mapping[str, Any], name: str) -> Array:
    """A table of numbers.

    Raises InvalidInput for anything else.
    """
    try:
        numbers = plain_numbers(data[name])
        if numbers.ndim != 2:
            raise ValueError
    except (ValueError, TypeError, OverflowError):
        raise InvalidInput(f"{name}: expected a table of numbers, got something else") from None
    return numbers
