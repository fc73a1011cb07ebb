"""Second look at a file, whatever the file says of itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from ..verify import Report


@dataclass(frozen=True, kw_only=True, eq=False)
class FileCheck:
    """Result of a second look at a file of a plan, a proof, a leap or a walk.

    Arguments:
        path: of the file.
        kind: what it holds: a proof is that there is "no-plan", "no-posture" or "no-leap".
        report: the verifier's.
        message: all of it in one line.
        same: the verdict that the file claims is the one of this look.
        founded: somebody can check what the file lists as checked.
    Source:
        docs/formats.md.

    Example:
        >>> import stancekit
        >>> stancekit.save(stancekit.plan("stairs", frames=2).solution, "climb.json")
        >>> check = stancekit.verify("climb.json")
        >>> check.kind, check.accepted
        ('plan', True)
    """

    path: str
    kind: Literal["plan", "no-plan", "no-posture", "leap", "no-leap", "crossing", "gait", "motion"]
    report: Report[Any]
    message: str
    same: bool = True
    founded: bool = True

    @property
    def accepted(self) -> bool:
        """The answer is accepted, and the file says nothing else of it than can be checked."""
        return self.report.accepted and self.same and self.founded

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        verdict = "accepted" if self.accepted else "refused"
        record = {"where": self.path, "kind": self.kind, "verdict": verdict}
        if self.kind in ("gait", "motion"):
            return {**record, **self.report.to_json()}
        if self.kind in ("plan", "leap", "crossing"):
            return {**record, "message": self.message, "report": self.report.to_json()}
        return {**record, "message": self.message, "leaves": self.report.figures["leaves"]}
