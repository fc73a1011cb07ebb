"""Legged robots learn and plan on hard terrain: what ``import stancekit`` gives.

Problems, courses, terrain, robots and envelopes; functions that answer, check, explain and draw them;
files. Every name is looked up when it is first asked for, so that the import itself takes no time
and loads no solver. The environments are Gymnasium's:
``gymnasium.make("stancekit.envs:stancekit/EnvelopeSelection-v0")``.

>>> import stancekit
>>> problem = stancekit.sample("wall-3", rng=8)[0]
>>> outcome = stancekit.solve(problem)
>>> outcome.status.value
'infeasible'
>>> stancekit.explain(outcome.certificate).message
'infeasible: the cheapest single change is friction of RR, from 0.5653 to at least 0.6986 (+24 %)'
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .answers import explain as explain, margins as margins, verify as verify
    from .courses import plan as plan
    from .datasets import label as label
    from .envs.data.dataset import Dataset as Dataset
    from .envs.data.leap_tries import LeapTries as LeapTries
    from .exports import Exported as Exported, export as export
    from .files import load as load, save as save
    from .learners.data.labelling import RecheckReport as RecheckReport
    from .learners.evaluation.evaluate import Comparison as Comparison, Score as Score
    from .learners.selectors.selector import Learned as Learned
    from .learners.surrogates.calibration import Screened as Screened
    from .motions import run as run, simulate as simulate
    from .pictures import draw as draw, film as film
    from .planners.answer.answer import Answer as Answer, Effort as Effort, Status as Status
    from .planners.answer.certificate import Certificate as Certificate, Way as Way
    from .planners.answer.motion import Motion as Motion
    from .planners.answer.report import Group as Group, Report as Report
    from .planners.answer.trajectory import WalkQuestion as WalkQuestion
    from .planners.errors import InvalidInput as InvalidInput, StancekitError as StancekitError
    from .planners.formats.motion_file import FileCheck as FileCheck
    from .planners.leap.method import LeapFinder as LeapFinder
    from .planners.problem.contact import Contact as Contact
    from .planners.problem.leap import Leap as Leap
    from .planners.problem.problem import Problem as Problem
    from .planners.problem.standing_map import StandingMap as StandingMap
    from .planners.problem.walk import Walk as Walk
    from .planners.projection.whole_body import WholeBodyLimits as WholeBodyLimits
    from .planners.relaxation.boxes import Modes as Modes
    from .planners.relaxation.envelope import Envelope as Envelope, EnvelopeSet as EnvelopeSet
    from .planners.robot.model import Limb as Limb, Robot as Robot, hexapod as hexapod
    from .planners.search.answer import PlanSettings as PlanSettings
    from .planners.search.exact import Exact as Exact
    from .planners.search.micp import Decoupled as Decoupled, Micp as Micp, Nlp as Nlp
    from .planners.search.two_stage import TwoStage as TwoStage
    from .planners.terrain.footholds import FootholdLimits as FootholdLimits, Footholds as Footholds
    from .planners.terrain.heightfield import HeightField as HeightField
    from .planners.terrain.patch import Patch as Patch
    from .planners.verify.explanation import Explanation as Explanation
    from .planners.warp.conformal import MapFit as MapFit
    from .postures import robot as robot, solve as solve
    from .runner.control.closed_loop import LoopReport as LoopReport
    from .runner.report import RunReport as RunReport
    from .runner.settings import RunSettings as RunSettings
    from .samples import sample as sample
    from .selectors import evaluate as evaluate, fit as fit, screen as screen, warp as warp
    from .standing import map as map
    from .terrains import heights as heights, terrain as terrain
    from .walks import walk as walk

    __version__: str

_HOMES = {
    "answers": (
        "explain",
        "margins",
        "verify",
    ),
    "courses": ("plan",),
    "datasets": ("label",),
    "envs.data.dataset": ("Dataset",),
    "envs.data.leap_tries": ("LeapTries",),
    "exports": (
        "Exported",
        "export",
    ),
    "files": (
        "load",
        "save",
    ),
    "learners.data.labelling": ("RecheckReport",),
    "learners.evaluation.evaluate": (
        "Comparison",
        "Score",
    ),
    "learners.selectors.selector": ("Learned",),
    "learners.surrogates.calibration": ("Screened",),
    "motions": (
        "run",
        "simulate",
    ),
    "pictures": (
        "draw",
        "film",
    ),
    "planners.answer.answer": (
        "Answer",
        "Effort",
        "Status",
    ),
    "planners.answer.certificate": (
        "Certificate",
        "Way",
    ),
    "planners.answer.motion": ("Motion",),
    "planners.answer.report": (
        "Group",
        "Report",
    ),
    "planners.answer.trajectory": ("WalkQuestion",),
    "planners.errors": (
        "InvalidInput",
        "StancekitError",
    ),
    "planners.formats.motion_file": ("FileCheck",),
    "planners.leap.method": ("LeapFinder",),
    "planners.problem.contact": ("Contact",),
    "planners.problem.leap": ("Leap",),
    "planners.problem.problem": ("Problem",),
    "planners.problem.standing_map": ("StandingMap",),
    "planners.problem.walk": ("Walk",),
    "planners.projection.whole_body": ("WholeBodyLimits",),
    "planners.relaxation.boxes": ("Modes",),
    "planners.relaxation.envelope": (
        "Envelope",
        "EnvelopeSet",
    ),
    "planners.robot.model": (
        "Limb",
        "Robot",
        "hexapod",
    ),
    "planners.search.answer": ("PlanSettings",),
    "planners.search.exact": ("Exact",),
    "planners.search.micp": ("Decoupled", "Micp", "Nlp"),
    "planners.search.two_stage": ("TwoStage",),
    "planners.terrain.footholds": (
        "FootholdLimits",
        "Footholds",
    ),
    "planners.terrain.heightfield": ("HeightField",),
    "planners.terrain.patch": ("Patch",),
    "planners.verify.explanation": ("Explanation",),
    "planners.warp.conformal": ("MapFit",),
    "postures": (
        "robot",
        "solve",
    ),
    "runner.control.closed_loop": ("LoopReport",),
    "runner.report": ("RunReport",),
    "runner.settings": ("RunSettings",),
    "samples": ("sample",),
    "selectors": (
        "evaluate",
        "fit",
        "screen",
        "warp",
    ),
    "standing": ("map",),
    "terrains": (
        "heights",
        "terrain",
    ),
    "walks": ("walk",),
}
"""Where each name lives: what the imports above say to type checkers, said to the interpreter
(compared by a test)."""
_HOME = {name: home for home, names in _HOMES.items() for name in names}


if not TYPE_CHECKING:  # or a checker would take any name for one that there is

    def __getattr__(name: str) -> Any:
        """A name from its home, at the first use (PEP 562)."""
        if name == "__version__":
            from importlib.metadata import version

            value: Any = version("stancekit")
        elif name in _HOME:
            value = getattr(import_module(f".{_HOME[name]}", __name__), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return [*_HOME, "__version__", "__doc__"]
