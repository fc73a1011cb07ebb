"""MICP (Lin et al. §II and Table II, [11]): m = p f over a grid of McCormick cells, by branch and
bound in binaries.

The program is ``relaxation.papers.micp``; which candidate patch a toe takes is binary, too. An
envelope comes in as rows of its own over the whole grid (Lin et al.), or as the box that the grid
divides. HiGHS has no second-order cones: with tangent planes around them "infeasible" holds for the
cones, too, while a point may leave them; with planes inside them a point holds, and "infeasible"
says nothing. Whatever a solver claims, its point is projected and verified.
"""

from __future__ import annotations

import time
from importlib import util

import numpy as np

from ..answer.answer import Answer
from ..answer.plan import Plan
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Scaled
from ..errors import InvalidInput, not_installed
from ..files.arrays import checked, checked_choice
from ..problem import Problem
from ..projection.project import PROJECTIONS, Projection, project
from ..relaxation.boxes import boxes_of
from ..relaxation.envelope import Envelope, EnvelopeSet
from ..relaxation.mccormick import domain_of
from ..relaxation.micp import (
    SOLVERS,
    MicpGrid,
    MicpProgram,
    axes_of,
    cell_error,
    cones_of,
    meet,
    of_layout,
    of_several_frames,
    unit_domain,
)
from ..relaxation.papers import Breaks
from .answer import Acceptance, Claim, Kind, TimeLimited, check_unused, kind_of, plan_of
from .clock import Clock
from .least_steps import over_sides

LEAST_S = 1e-3
"""A solver is given this much time even where writing the model down took all of it [s]."""


class MicpPlanner(TimeLimited):
    """The papers' planner: claims of a mixed-integer solver, of which only verified witnesses
    become an answer.

    Arguments:
        solver: "highs", "scip" or "gurobi".
        envelope: a box over the stance contacts, or a learned set of one; it confines the search,
            so that "infeasible" then speaks of the envelope only.
        gap: relative, to which a course's objective is minimised (with planes from below, by
            tangents of its squares); None takes the first point, which is all that a claim needs.
        time_limit_s: the solver's.
    """

    name = "micp"

    def __init__(
        self,
        *,
        solver: str = "highs",
        grid: MicpGrid = MicpGrid(),
        envelope: Envelope | EnvelopeSet | None = None,
        gap: float | None = None,
        projection: Projection = "scp",
        time_limit_s: float | None = None,
        acceptance: Acceptance = Acceptance(),
        programs: Programs | None = None,
    ) -> None:
        checked_choice(solver, "solver", SOLVERS)
        if util.find_spec(SOLVERS[solver][0]) is None:
            raise not_installed("solver", SOLVERS[solver][0], repr(solver), "exact")
        cones_of(grid, solver)
        PROJECTIONS.get(projection)
        if isinstance(envelope, EnvelopeSet) and len(envelope.envelopes) > 1:
            raise InvalidInput(
                f"envelopes: expected one envelope for micp, got {len(envelope.envelopes)}"
            )
        self.solver, self.grid, self.envelope = solver, grid, envelope
        self.gap = None if gap is None else checked(gap, "gap", least=0.0)
        self.projection: Projection = projection
        self.time_limit_s = (
            None if time_limit_s is None else checked(time_limit_s, "time_limit_s", above=0.0)
        )
        self.acceptance, self._programs = acceptance, programs or Programs()

    def check(self, kind: Kind) -> None:
        """Raise InvalidInput for a setting that this kind of question has no use for."""
        if kind == "postures":
            check_unused(self, envelope_use="rows", gap=None, projection="scp")

    @property
    def envelope_use(self) -> str:
        """The use that the grid makes of an envelope."""
        return self.grid.envelope_use

    @over_sides
    def solve(self, problem: Problem) -> Answer[Plan]:
        """Ask the solver, then project and verify what it found.

        Raises InvalidInput for an envelope of other limbs.
        """
        clock, scaled = Clock.start(), Scaled.of(problem)
        with clock.compiling():
            program = self.program(problem)
        begin = time.process_time()
        answer = program.solve(
            scaled, max(self.limit_s(kind_of(problem)) - clock.elapsed(), LEAST_S)
        )
        clock.count(1, answer.seconds)
        details = program.figures | {
            "solver_s": answer.seconds,
            "solver_cpu_s": time.process_time() - begin,
        }
        details["cell_error"] = cell_error(self.boxes(problem)[0], self.grid.counts)
        point, message = None, answer.message
        if answer.point is not None and answer.choice is not None and answer.moments is not None:
            details["claimed_residual"] = float(np.abs(answer.moments).max())
            unit_nm = scaled.force_n * scaled.length_m
            details["claimed_residual_nm"] = unit_nm * float(
                np.linalg.norm(answer.moments, axis=1).max()
            )
            point = project(
                self._programs, self.projection, scaled.chosen(answer.choice), answer.point
            )
            clock.count(point.solves, point.seconds)
        if point is None or not np.isfinite(point.residual):
            point = None
            message = (
                message
                or f"{self.solver} says {answer.claim}; neither a certificate nor toes that hold came with it"
            )
        plan: Plan | None = None
        if point is not None and answer.choice is not None:
            made = {"planner": self.name, "solver": self.solver, "projection": self.projection}
            plan = plan_of(problem, scaled, answer.choice, point, provenance=made)
        claim = Claim(plan=plan, word=answer.claim, message=message, details=details)
        return self.acceptance.answer(problem, claim, method=self.name, clock=clock)

    def program(self, problem: Problem) -> MicpProgram:
        """The program of a problem; postures of one layout share one, which then has the numbers of
        this one.
        """
        scaled, (domain, envelope) = Scaled.of(problem), self.boxes(problem)
        breaks = Breaks.of(domain, self.grid.counts)
        if problem.is_posture and envelope is None:
            symbols, program = self._programs.get(of_layout, scaled.layout, self.grid, self.solver)
            symbols.load(scaled, breaks)
            return program
        gap = None if problem.is_posture else self.gap
        axes = axes_of(scaled)
        return MicpProgram(
            scaled, breaks, self.grid, solver=self.solver, axes=axes, envelope=envelope, gap=gap
        )

    def boxes(self, problem: Problem) -> tuple[Envelope, Envelope | None]:
        """The domain that the grid divides, and the box of the envelope rows, where there are
        any.
        """
        scaled, envelope = Scaled.of(problem), self.box(problem)
        domain = (
            domain_of(scaled, axes_of(scaled))
            if self.grid.domain == "course"
            else unit_domain(scaled)
        )
        if envelope is not None and self.grid.envelope_use == "shrink":
            return meet(envelope, domain), None
        return domain, envelope

    def box(self, problem: Problem) -> Envelope | None:
        """The envelope over the stance contacts of a problem.

        Raises InvalidInput where it was learned for others.
        """
        if self.envelope is None:
            return None
        scaled = Scaled.of(problem)
        contacts = len(scaled.force_min)
        if not problem.is_posture:
            for row in of_several_frames(scaled)[:1]:
                stance, limb, _ = (part[row] for part in scaled.layout.contacts)
                raise InvalidInput(
                    f"frame {scaled.layout.stance_frames[stance]}, limb "
                    f"{problem.robot.limb_names[limb]}: expected "
                    "candidate patches that share one contact frame, for an envelope on the forces "
                    "in it; got several"
                )
        if isinstance(self.envelope, EnvelopeSet):
            if not problem.is_posture:
                return boxes_of(problem, self.envelope)[0]
            self.envelope.check_fits(problem)
            return self.envelope.envelopes[0]
        if self.envelope.contacts != contacts:
            raise InvalidInput(
                f"contacts: expected {self.envelope.contacts} for this envelope, got {contacts}"
            )
        return self.envelope
