"""Files ``stancekit/crossing/1``: climbs and leaps one after the other, each as its own file has it,
and the proof that key frames alone do not, where there is one.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..answer.certificate import Crossing
from ..answer.plan import LeapPlan, Plan
from ..errors import InvalidInput
from ..files.documents import read_json, shown
from ..files.writing import write_text
from ..problem.leap import is_leap
from ..verify import check_plan
from ..verify.crossings import check_crossing
from .leap_file import leap_content, leap_from
from .motion_file import FileCheck
from .plan_file import plan_content, plan_from
from .proof_file import proof_content, proof_from

FORMAT = "stancekit/crossing/1"
KEYS = ("format", "name", "parts", "refusal", "proof", "sha256")
_MOST_PARTS = 64


def write_crossing(path: str | Path, crossing: Crossing) -> None:
    """Write a crossing, whole or not at all.

    Raises InvalidInput for a name that does not end in .json, and where nothing can be written.
    """
    if Path(path).suffix != ".json":
        raise InvalidInput(
            f"{path}: expected a crossing's name to end in .json, got "
            f"{Path(path).suffix or 'no suffix'}"
        )
    proof = crossing.certificate
    content = {
        "format": FORMAT,
        "name": crossing.name,
        "parts": [
            leap_content(part.problem, part)
            if isinstance(part, LeapPlan)
            else plan_content(part, check_plan(part, joints=True, margins=True), path)
            for part in crossing.parts
        ],
        "refusal": crossing.refusal,
        "proof": None if proof is None else proof_content(proof, path),
    }
    text = json.dumps({**content, "sha256": _seal(content)}, allow_nan=False)
    write_text(path, text + "\n")


def read_crossing(path: str | Path) -> Crossing:
    """Read a crossing.

    Raises InvalidInput in one line for anything else, and for a file that was changed since.
    """
    data = read_json(path)
    if not _is_crossing(data):
        raise InvalidInput(f"{path}: expected format {FORMAT!r}, got {shown(data)}")
    if set(data) != set(KEYS):
        names = ", ".join(sorted(set(data) ^ set(KEYS)))
        raise InvalidInput(
            f"{path}: expected the keys {', '.join(KEYS)}; missing or unknown: {names:.120}"
        )
    if _seal({name: data[name] for name in KEYS[:-1]}) != data["sha256"]:
        raise InvalidInput(f"{path}: digest mismatch: the file was changed after it was written")
    name, parts, refusal = data["name"], data["parts"], data["refusal"]
    if not isinstance(name, str) or not isinstance(refusal, str):
        raise InvalidInput(f"{path}: name, refusal: expected text, got something else")
    if not isinstance(parts, list) or not 0 < len(parts) <= _MOST_PARTS:
        raise InvalidInput(f"{path}: parts: expected 1 to {_MOST_PARTS} parts, got something else")
    read = tuple(_part(part, f"{path}: parts[{k}]") for k, part in enumerate(parts))
    proof = None if data["proof"] is None else proof_from(data["proof"], f"{path}: proof")[1]
    try:
        return Crossing(name=name, parts=read, refusal=refusal, certificate=proof)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None


def _is_crossing(data: Any) -> bool:
    """Tell whether parsed contents say that they are a crossing."""
    return isinstance(data, Mapping) and data.get("format") == FORMAT


def is_crossing_file(path: str | Path) -> bool:
    """Tell whether a file that is there says that it is a crossing."""
    if Path(path).suffix != ".json" or not Path(path).is_file():
        return False
    try:
        return _is_crossing(read_json(path))
    except InvalidInput:
        return False


def check_file(path: str | Path) -> FileCheck:
    """Check the crossing in a file, every part and every seam.

    Raises InvalidInput for a file that holds none.
    """
    report = check_crossing(read_crossing(path))
    return FileCheck(path=str(path), kind="crossing", report=report, message=report.message)


def _part(data: Any, where: str) -> Plan | LeapPlan:
    """A part of a crossing.

    Raises InvalidInput.
    """
    if not isinstance(data, Mapping):
        raise InvalidInput(f"{where}: expected a plan or a leap, got {shown(data)}")
    if not is_leap(data):
        return plan_from(data, Path(where))[0]
    plan = leap_from(data, where).plan
    if plan is None:
        raise InvalidInput(f"{where}: expected a leap with a plan, got the question alone")
    return plan


def _seal(content: Mapping[str, Any]) -> str:
    """SHA-256 of everything else in the file, as canonical JSON."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
