"""``stancekit picture``: solve a posture and draw it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from stancekit.planners.outcome import InvalidInput

from .console import out


@dataclass
class Picture:
    """Draw a posture problem with its answer: patches, limbs, contact forces in their friction cones, envelope."""

    file: Annotated[Path, tyro.conf.Positional]
    """Problem file; `stancekit sample wall-3 --out problem.json` makes one."""
    out: Path
    """Picture to write: .png, .pdf or .svg."""
    index: int = 0
    """Which problem of the file, from 0."""
    method: Literal["exact", "lift", "two-stage", "nlp", "none"] = "exact"
    """How to solve it; none draws the scene alone."""
    envelope: Path | None = None
    """Envelope file: drawn, and used by two-stage."""
    project: Literal["fix-p", "fix-f", "fix-toes", "scp", "nlp"] = "scp"
    """Projection of two-stage."""

    def run(self) -> int:
        """Solve, draw, write."""
        from stancekit.envs.picture import draw_posture, save
        from stancekit.planners.contact.methods import make_planner
        from stancekit.planners.files import read_envelopes, read_problems, read_text

        problems = list(read_problems(read_text(self.file), str(self.file)))
        if not 0 <= self.index < len(problems):
            raise InvalidInput(f"--index: expected 0 to {len(problems) - 1} for {self.file}, got {self.index}")
        problem = problems[self.index][1]
        if isinstance(problem, InvalidInput):
            raise problem
        envelopes = None if self.envelope is None else read_envelopes(self.envelope)
        if envelopes is not None:
            envelopes.check_fits(problem)
        caption, posture, chosen = "", None, 0
        if self.method != "none":
            outcome = make_planner(self.method, envelopes=envelopes, projection=self.project).solve(problem)
            posture = outcome.posture
            chosen = int(outcome.details.get("chosen", 0))
            caption = f"{outcome.method}: {outcome.status.value}, {1e3 * outcome.seconds:.1f} ms"
        envelope = None if envelopes is None else envelopes.envelopes[chosen]
        save(draw_posture(problem, posture, envelope=envelope, caption=caption), self.out)
        out.print(f"{self.out}: {caption or 'the scene alone'}", markup=False)
        return 0
