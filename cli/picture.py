"""``stancekit picture``: solve a posture and draw it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from json import loads
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from stancekit.planners.errors import InvalidInput

from .console import out, tell, text_of
from .options import PROJECTION, OptionalPath, check_out


@dataclass
class Picture:
    """Draw a posture problem with its answer, or the file of a motion or a proof: terrain, limbs,
    contact forces in their friction cones; of a proof the limb to blame and what it lacks.
    """

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """Problem file, - for standard input, or the file of a plan, a walk, a leap or a proof;
    `stancekit sample wall-3 --out problem.json` makes one."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Picture to write: .png, .pdf or .svg."""
    index: int = 0
    """Which problem of the file, from 0."""
    method: Literal["exact", "lift", "two-stage", "nlp", "none"] = "exact"
    """How to solve it; none draws the scene alone."""
    envelopes: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Envelope file: drawn, and used by two-stage."""
    projection: Annotated[str, PROJECTION] = "scp"
    """Projection of two-stage."""
    json: bool = False
    """Print what was drawn as one JSON object."""

    def run(self) -> int:
        """Solve, draw, write."""
        from stancekit import draw, explain, load
        from stancekit.planners.formats.motion_file import is_evidence
        from stancekit.postures import planner_of, read_envelopes, read_problems

        check_out(self.out)
        text, content = text_of(self.file), None
        with suppress(ValueError):
            content = loads(text)
        if is_evidence(content):
            draw(load(self.file), out=self.out)
            out.print(f"{self.out}: {self.file}", highlight=False)
            return 0
        problems = list(read_problems(text, str(self.file)))
        if not 0 <= self.index < len(problems):
            raise InvalidInput(
                f"--index: expected 0 to {len(problems) - 1} for {self.file}, got {self.index}"
            )
        where, problem = problems[self.index]
        if isinstance(problem, InvalidInput):
            raise problem
        envelopes = None if self.envelopes is None else read_envelopes(self.envelopes)
        if envelopes is not None:
            try:
                envelopes.check_fits(problem)
            except InvalidInput as error:
                raise InvalidInput(f"{where}: {error}") from None
        caption, why, answer, chosen, status = "", "", None, 0, None
        if self.method != "none":
            staged, boxed = self.method in ("lift", "two-stage"), self.method == "two-stage"
            settings: dict[str, Any] = {"projection": self.projection} if staged else {}
            if boxed and envelopes is not None:
                settings["envelopes"] = envelopes
            outcome = planner_of(self.method, **settings).solve(problem)
            answer, status = outcome.solution or outcome.certificate, outcome.status.value
            chosen = int(outcome.details.get("chosen", 0))
            caption = (
                f"{outcome.method}: {outcome.status.value}, {1e3 * outcome.effort.seconds:.1f} ms"
            )
            why = "" if outcome.certificate is None else explain(outcome).message
        envelope = None if envelopes is None else envelopes.envelopes[chosen]
        draw(problem, answer, envelope=envelope, caption=caption, out=self.out)
        tell(
            self.json,
            {"where": where, "out": str(self.out), "method": self.method, "status": status},
            f"{self.out}: {'; '.join(filter(None, (caption, why))) or 'the scene alone'}",
        )
        return 0
