"""``stancekit verify``: check answers again, knowing nothing of how they were made."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from stancekit.planners.errors import InvalidInput

from .console import complain, emit, out, text_of
from .options import OptionalPath, OptionalText

TOLERANCE = 1e-6
TOLD_M = 1e-3
"""A toe that is farther out of reach with the exact rotation than with I + [Θ]× by this is told of [m]."""
EVIDENCE = {"feasible": "posture", "infeasible": "certificate"}
"""What an answer of each status has to hold; none for one that decides nothing."""


@dataclass
class Verify:
    """Check answers again: postures and proofs, a data set, a plan of key frames, a gait.

    With one file, `stancekit verify plan.json`, a plan of key frames, a proof that there is none, or a gait trajectory
    is checked against the course or terrain in the file, whatever the file says of itself.

    With two, `stancekit verify problems.jsonl answers.jsonl`, the n-th answer is taken for the n-th problem; answers
    are what `stancekit solve --certificate --out answers.jsonl` writes.

    With a folder, `stancekit verify data/wall-3`, every witness and every certificate of a data set is checked.

    No solver takes part. Exit code 1 if anything is refused, and that is also what happens to a claim that comes
    without its evidence.
    """

    problems: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PROBLEMS")]
    """Problem file, or - for standard input; or a data set, by folder or, where it ships, by name; a plan; a gait."""
    answers: Annotated[OptionalPath, tyro.conf.Positional, tyro.conf.arg(metavar="[ANSWERS]")] = None
    """File of answers, or - for standard input; none for a data set, a plan or a gait."""
    tolerance: float = TOLERANCE
    """Largest violation of an accepted posture (non-dimensional)."""
    robot: Annotated[OptionalText, tyro.conf.arg(metavar="FILE")] = None
    """The robot that a plan or a gait is for, a .urdf or a .yaml file: an own copy of it that differs is refused."""
    course: Annotated[OptionalText, tyro.conf.arg(metavar="COURSE")] = None
    """The course that a plan is for, as `stancekit plan` takes it, for the robot of --robot: a plan of other terrain,
    friction, start, goal, limits or robot is refused."""
    explain: bool = False
    """Say for every proof what would have to give, and by how much at least."""
    json: bool = False
    """One JSON object a line."""

    def run(self) -> int:
        """Verify and print the verdicts."""
        if not 0.0 < self.tolerance < 1.0:
            raise InvalidInput(f"--tolerance: expected a number between 0 and 1, got {self.tolerance:g}")
        for option, wanted in (("robot", "a plan's or a gait's"), ("course", "a plan's")):
            if getattr(self, option) is not None and not (self.answers is None and self.problems.is_file()):
                raise InvalidInput(f"--{option}: expected {wanted} file with it")
        if self.answers is None:
            if not self.problems.exists():
                from stancekit.envs.data.pools import folder_of

                self.problems = folder_of(self.problems)  # one that ships
            if not self.problems.exists():
                raise InvalidInput(f"{self.problems}: expected a plan, proof, gait or data set, found nothing there")
            return self._file() if self.problems.is_file() else self._dataset()
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
                out.print(f"{record['where']}: {record['verdict']}: {record['message']}")
        return 2 if invalid else int(refused > 0)

    def _file(self) -> int:
        """A plan of key frames or a gait trajectory: one verdict."""
        from stancekit.planners.files.documents import read_json
        from stancekit.planners.formats import plan_file, proof_file

        name = str(self.problems)
        try:
            data = read_json(self.problems)
        except InvalidInput as error:
            if self.problems.suffix == ".json" and "broken at" in str(error):
                raise
            data = None  # problems come as JSON lines, too
        if self.explain and not proof_file.is_proof(data):
            raise InvalidInput(f"--explain: expected a file of answers with it, got {name} alone")
        of_plan = plan_file.is_plan_file(self.problems)
        of_walk = not of_plan and not proof_file.is_proof(data) and _is_walk(data)
        if self.robot is not None and not (of_plan or of_walk):
            raise InvalidInput(f"--robot: expected a plan or a gait with it, got {name}")
        if self.course is not None and not of_plan:
            raise InvalidInput(f"--course: expected a plan with it, got {name}")
        if of_plan:
            checked = plan_file.check_file(
                self.problems, tolerance=self.tolerance, robot=self._robot(),
                course=None if self.course is None else self._course,
            )  # fmt: skip
            accepted, message, found = checked.accepted, checked.message, checked.to_json()
        elif proof_file.is_proof(data):
            if self.tolerance != TOLERANCE:
                raise InvalidInput("--tolerance: expected none with a proof, which has to hold with room for any plan")
            proof = proof_file.check_proof_file(self.problems)
            accepted, message, found = proof.accepted, proof.message, proof.to_json()
        elif of_walk:
            from stancekit.planners.formats import trajectory_file as record  # splines are slow to import

            if self.tolerance != TOLERANCE:
                raise InvalidInput("--tolerance: expected none with a gait, whose groups have limits of their own")
            report = record.check_file(self.problems, robot=self._walker())
            accepted, message = report.accepted, report.message
            verdict = "accepted" if accepted else "refused"
            found = {"where": name, "kind": "gait", "verdict": verdict, **report.to_json()}
        else:
            raise InvalidInput(
                f"{name}: expected a data set folder, a plan, a proof or a gait, or a file of answers after it"
            )
        if self.json:
            emit(found)
        else:
            out.print(f"{name}: {message}")
        return int(not accepted)

    def _robot(self) -> Any:
        """The model of --robot; what reads it is slow to import."""
        if self.robot is None:
            return None
        from stancekit.planners.robot.robot_file import named_robot

        return named_robot(self.robot)

    def _walker(self) -> Any:
        """The same as a walker."""
        if self.robot is None:
            return None
        from stancekit.planners.robot.walker import named_walker

        return named_walker(self.robot)

    def _course(self, frames: int) -> Any:
        """The course of --course, of so many key frames where it can be had with others than its own."""
        from stancekit.planners.problem.course_file import read_course

        name = self.course or ""
        robot = None if Path(name).suffix == ".json" else self.robot
        course = read_course(name, None, robot)
        try:
            return course if course.frames == frames else read_course(name, frames, robot)
        except InvalidInput:
            return course

    def _dataset(self) -> int:
        from stancekit.envs.data.dataset import Dataset
        from stancekit.learners.data.labelling import recheck

        if self.explain or self.tolerance != TOLERANCE:
            option = "--explain" if self.explain else "--tolerance"
            raise InvalidInput(f"{option}: expected a file of answers with it, got a data set, which has its own plan")
        report = recheck(Dataset.open(self.problems))
        if self.json:
            emit(report.to_json())
        else:
            for name, value in report.to_json().items():
                out.print(f"{name:16} {value}")
        return int(not report.accepted)

    def _verdicts(self, answers: Path) -> Iterator[dict[str, Any]]:
        from stancekit.planners.formats.answer_file import answer_from_json, json_records, read_problems

        problems = list(read_problems(text_of(self.problems), str(self.problems)))
        claims = list(json_records(text_of(answers), str(answers)))
        if len(problems) != len(claims):
            raise InvalidInput(f"{answers}: expected {len(problems)} answers, one a problem, got {len(claims)}")
        for (where, problem), (place, claim) in zip(problems, claims, strict=True):
            if isinstance(problem, InvalidInput) or isinstance(claim, InvalidInput):
                wrong = problem if isinstance(problem, InvalidInput) else claim
                yield {"where": where, "verdict": "invalid", "message": str(wrong)}
                continue
            try:
                yield {"where": where, **self._verdict(problem, answer_from_json(claim), _status(claim))}
            except InvalidInput as error:
                yield {"where": where, "verdict": "invalid", "message": f"{place}: {error}"}

    def _verdict(self, problem: Any, answer: Any, status: str) -> dict[str, Any]:
        from stancekit.planners.answer.outcome import Posture
        from stancekit.planners.verify import check_certificate, check_posture, explain

        kind = None if answer is None else "posture" if isinstance(answer, Posture) else "certificate"
        if kind != EVIDENCE.get(status):
            hint = " (solve with --certificate)" if status == "infeasible" else ""
            message = f"it says {status} and comes with {_a(kind)}, expected {_a(EVIDENCE.get(status))}{hint}"
            return {"verdict": "refused", "message": message}
        if kind is None:
            return {"verdict": "unclaimed", "message": f"the answer is {status}: nothing to check"}
        if kind == "posture":
            report = check_posture(problem, answer, tolerance=self.tolerance)
            verdict = "accepted" if report.accepted else "refused"
            message = _bare(report.message)
            if report.exact_reach_m > TOLD_M:
                message += f"; {1e3 * report.exact_reach_m:.0f} mm out of reach with the exact rotation"
            return {"verdict": verdict, "kind": "posture", "message": message, "digest": report.digest,
                    "exact_reach_m": report.exact_reach_m if math.isfinite(report.exact_reach_m) else None,
                    "residual_nm": report.residual_nm if math.isfinite(report.residual_nm) else None}  # fmt: skip
        proof = check_certificate(problem, answer)
        message = _bare(proof.message)
        if self.explain and proof.accepted:
            message += "; " + explain(problem, answer).message
        verdict = "accepted" if proof.accepted else "refused"
        return {"verdict": verdict, "kind": "certificate", "message": message,
                "lower_bound": min(proof.lower_bound, 1e6), "leaves": proof.leaves}  # fmt: skip


def _status(claim: Any) -> str:
    """The status that an answer claims; where it has none, the one that its evidence speaks for."""
    from stancekit.planners.files.arrays import checked_choice

    known = ("feasible", "infeasible", "undecided", "invalid")
    status = claim.get("status", "infeasible" if "certificate" in claim else "feasible" if "toes_m" in claim else None)
    checked_choice(status, "status", known)
    return str(status)


def _a(kind: str | None) -> str:
    return "nothing" if kind is None else f"a {kind}"


def _bare(message: str) -> str:
    """The verifier's message without the verdict that it begins with."""
    return message.removeprefix("accepted: ").removeprefix("rejected: ")


def _is_walk(data: Any) -> bool:
    """Whether what a file holds is a gait."""
    from stancekit.planners.formats.trajectory_file import is_trajectory  # splines are slow to import

    return is_trajectory(data)
