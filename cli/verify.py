"""``stancekit verify``: check answers again, knowing nothing of how they were made."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from stancekit.planners.outcome import InvalidInput

from .console import complain, emit, out


@dataclass
class Verify:
    """Check postures and proofs of infeasibility against their problems, or a whole data set against itself.

    `stancekit verify problems.jsonl answers.jsonl` takes the n-th answer for the n-th problem; answers are what
    `stancekit solve --certificate --out answers.jsonl` writes. `stancekit verify data/wall-3` checks every witness and
    every certificate of a data set. No solver takes part. Exit code 1 if anything is refused.
    """

    problems: Annotated[Path, tyro.conf.Positional]
    """Problem file, or a data set folder."""
    answers: Annotated[Path | None, tyro.conf.Positional] = None
    """File of answers; none for a data set."""
    tolerance: float = 1e-6
    """Largest violation of an accepted posture (non-dimensional)."""
    explain: bool = False
    """Say for every proof what would have to give, and by how much at least."""
    json: bool = False
    """One JSON object a line."""

    def run(self) -> int:
        """Verify and print the verdicts."""
        if not 0.0 < self.tolerance < 1.0:
            raise InvalidInput(f"--tolerance: expected a number between 0 and 1, got {self.tolerance:g}")
        if self.answers is None:
            return self._dataset()
        refused = 0
        invalid = 0
        for record in self._verdicts(self.answers):
            refused += record["verdict"] == "refused"
            invalid += record["verdict"] == "invalid"
            if record["verdict"] == "invalid":
                complain(f"stancekit: error: {record['message']}")
            if self.json:
                emit(record)
            else:
                out.print(f"{record['where']}: {record['verdict']}: {record['message']}", markup=False)
        return 2 if invalid else int(refused > 0)

    def _dataset(self) -> int:
        from stancekit.learners.dataset import Dataset
        from stancekit.learners.labelling import recheck

        if self.problems.is_file():
            raise InvalidInput(f"{self.problems}: expected a data set folder, or a file of answers after it")
        report = recheck(Dataset.open(self.problems))
        if self.json:
            emit(report.to_json())
        else:
            for name, value in report.to_json().items():
                out.print(f"{name:16} {value}")
        return int(not report.accepted)

    def _verdicts(self, answers: Path) -> Iterator[dict[str, Any]]:
        from stancekit.planners.files import answer_from_json, json_records, read_problems, read_text

        problems = list(read_problems(read_text(self.problems), str(self.problems)))
        claims = list(json_records(read_text(answers), str(answers)))
        if len(problems) != len(claims):
            raise InvalidInput(f"{answers}: expected {len(problems)} answers, one a problem, got {len(claims)}")
        for (where, problem), (place, claim) in zip(problems, claims, strict=True):
            if isinstance(problem, InvalidInput) or isinstance(claim, InvalidInput):
                wrong = problem if isinstance(problem, InvalidInput) else claim
                yield {"where": where, "verdict": "invalid", "message": str(wrong)}
                continue
            try:
                yield {"where": where, **self._verdict(problem, answer_from_json(claim))}
            except InvalidInput as error:
                yield {"where": where, "verdict": "invalid", "message": f"{place}: {error}"}

    def _verdict(self, problem: Any, answer: Any) -> dict[str, Any]:
        from stancekit.planners.outcome import Posture
        from stancekit.planners.verify import check_certificate, check_posture, explain

        if answer is None:
            return {"verdict": "unclaimed", "message": "the answer holds neither a posture nor a certificate"}
        if isinstance(answer, Posture):
            report = check_posture(problem, answer, tolerance=self.tolerance)
            verdict = "accepted" if report.accepted else "refused"
            return {"verdict": verdict, "kind": "posture", "message": report.message, "digest": report.digest,
                    "residual_nm": report.residual_nm if math.isfinite(report.residual_nm) else None}  # fmt: skip
        proof = check_certificate(problem, answer)
        message = proof.message
        if self.explain and proof.accepted:
            message += "; " + explain(problem, answer).message
        verdict = "accepted" if proof.accepted else "refused"
        return {"verdict": verdict, "kind": "certificate", "message": message,
                "lower_bound": min(proof.lower_bound, 1e6), "leaves": proof.leaves}  # fmt: skip
