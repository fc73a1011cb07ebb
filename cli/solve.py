"""``stancekit solve``: answer posture problems."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.text import Text

from stancekit.planners.errors import InvalidInput

from .console import as_options, complain, emit, out, progress, results, text_of
from .options import (
    OF_FILE,
    OF_METHOD,
    FootholdOptions,
    MethodOptions,
    OptionalFloat,
    OptionalPath,
    OptionalText,
    TerrainFile,
    check_limit,
    check_out,
    in_options,
    named,
    place,
)

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit import Footholds, Problem, Robot
    from stancekit.planners.files.arrays import Array
    from stancekit.planners.problem.course_terrain import FileTerrain
    from stancekit.planners.search.answer import Planner


@dataclass
class Between:
    """The places between which a course is laid out."""

    start: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y")] = None
    """On a terrain's file or name: where the robot begins [m]. Frames, gait and candidates are laid
    out from there to the goal, the robot facing along x."""
    goal: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y")] = None
    """On a terrain's file or name: where its centre of mass is to end [m]."""
    friction: OptionalFloat = None
    """Friction coefficient of a terrain's file; 0.8 unless given. A course has its own, in its
    file."""
    map: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.npz")] = None
    """File of `stancekit map`, with a terrain's file or name: the way keeps off places where it is
    proved that the robot cannot stand, facing along x, and costs more where that is likely."""
    file: Annotated[TerrainFile, *OF_FILE] = field(default_factory=TerrainFile)
    """What the numbers of a terrain's file mean."""
    footholds: Annotated[FootholdOptions, tyro.conf.OmitArgPrefixes] = field(
        default_factory=FootholdOptions
    )
    """What counts as a foothold."""

    def question(
        self, name: str, frames: int | None, robot: str | None, reach: Path | None
    ) -> Footholds | Problem | str:
        """Course as ``stancekit.plan`` takes it.

        Raises InvalidInput for options that do not go together.
        """
        from stancekit.planners.problem.course_file import read_course
        from stancekit.planners.terrain.import_options import SUFFIXES

        suffix = Path(name).suffix.lower()
        if self.start is None and self.goal is None:
            if suffix in SUFFIXES:
                raise InvalidInput(
                    f"--start: expected --start X,Y and --goal X,Y with the terrain {name}, got "
                    "none"
                )
            self._check_unused(name)
            return name if reach is None else read_course(name, frames, robot, reach=reach)
        if self.start is None or self.goal is None:
            raise InvalidInput(
                "--start: expected --start X,Y and --goal X,Y together, got one of them"
            )
        if suffix not in SUFFIXES:
            from stancekit.planners.terrain.reference import (
                names_ground,
            )  # splines are slow to import

            if not names_ground(name):
                known = f"{', '.join(SUFFIXES)}, or a ground by its name"
                raise InvalidInput(
                    f"--start: expected a terrain's file as COURSE, {known}, got {name}"
                )
        return self.found(name, robot)

    def asked(self, frames: int | None, robot: str | None, reach: Path | None) -> dict[str, Any]:
        """The arguments of ``stancekit.plan`` that say where, in how many frames and by whom."""
        if self.start is None or self.goal is None:
            return {} if reach is not None else {"frames": frames, "robot": robot}
        start, goal = (place.tolist() for place in self.places())
        who: Robot | str | None = robot
        if reach is not None:
            from stancekit.planners.robot.reach_sets import read_reach
            from stancekit.planners.robot.robot_file import robot_of

            made = robot_of(robot or "hexapod")
            who = read_reach(reach, made.limb_names).applied(made)
        return {"frames": frames, "robot": who, "start": start, "goal": goal}

    def course(self, name: str, frames: int | None, robot: str | None) -> Problem:
        """The course of a file or a name, or over a terrain's file from start to goal.

        Raises InvalidInput.
        """
        from stancekit import Footholds
        from stancekit.planners.problem.course_between import laid_between
        from stancekit.planners.problem.course_file import read_course
        from stancekit.planners.problem.course_keys import AS_ASKED

        with self.in_options():
            question = self.question(name, frames, robot, None)
            if not isinstance(question, Footholds):
                return read_course(name, frames, robot)
            start, goal = (place.tolist() for place in self.places())
            return laid_between(question, start, goal, robot=robot, frames=frames)(
                "inner", AS_ASKED
            )

    @contextmanager
    def in_options(self) -> Iterator[None]:
        """Let messages name places and the terrain's settings as the options that give them."""
        with in_options(), as_options("frames", "start", "goal", standing="map"):
            yield

    def _check_unused(self, name: str) -> None:
        """Raise InvalidInput for what only a terrain's file has a use for."""
        for of, plain in (
            (self, Between()),
            (self.file, TerrainFile()),
            (self.footholds, FootholdOptions()),
        ):
            for key, value in vars(plain).items():
                if not hasattr(value, "__dataclass_fields__") and getattr(of, key) != value:
                    message = f"--{key.replace('_', '-')}: expected a terrain's file as COURSE, got {name}"
                    raise InvalidInput(
                        message + (_where_friction_is(name) if key == "friction" else "")
                    )

    def places(self) -> tuple[Array, Array]:
        """Start and goal, shape (2,) [m].

        Raises InvalidInput.
        """
        assert self.start is not None
        assert self.goal is not None
        return place(self.start, "--start"), place(self.goal, "--goal")

    def found(self, name: str, robot: str | None) -> Footholds:
        """The footholds of the terrain's file for the feet of a robot.

        Raises InvalidInput.
        """
        from stancekit import terrain

        friction, limits = self._friction(), self.footholds.limits()
        with in_options():
            return terrain(
                name, friction=friction, robot=robot, limits=limits, **vars(self.file.asked())
            )

    def terrain(self, name: str) -> FileTerrain:
        """The terrain's file as a description, whose footholds are found when they are asked
        for.
        """
        from stancekit.planners.problem.course_terrain import FileTerrain

        keys = vars(self.file.asked())
        return FileTerrain(
            file=str(Path(name).resolve()),
            footholds=self.footholds.limits(),
            friction=self._friction(),
            **{**keys, "kind": keys["kind"] or "file"},
        )

    def _friction(self) -> float:
        import math

        from stancekit.planners.terrain.footholds import FRICTION

        if self.friction is not None and not 0.0 <= self.friction < math.inf:
            raise InvalidInput(f"--friction: expected a number from 0 on, got {self.friction:g}")
        return FRICTION if self.friction is None else self.friction


def _where_friction_is(name: str) -> str:
    """Name the file to copy for a course that comes with the package."""
    from stancekit.planners.problem.course_file import builtin_courses

    if name not in builtin_courses():
        return "; a course has its friction in its file" if name.endswith((".yaml", ".yml")) else ""
    path = resources.files("stancekit.configs.courses") / f"{name}.yaml"
    return f"; its own friction is in its file: copy {path}, change it, and plan the copy"


_LIMITED = ("exact", "nlp", "micp")
"""The methods that have a use for a time limit."""


@dataclass
class SolvePostures:
    """Can the robot hold these postures, and how?

    One answer per problem, in input order.

    A FILE holds one problem, an array of them, or JSON lines; `-` is standard input. `stancekit
    sample wall-3` shows what a problem looks like.

    status is feasible (with a posture that the verifier accepted), infeasible (with a proof that it
    accepted) or undecided (a limit was met, a solver failed, or the method cannot prove what it
    claims; see claim). It always speaks of the problem itself: a relaxation over a learned envelope
    reports its margin in details and decides nothing alone. lower_bound is a proved bound on the
    moment residual in units of force scale × length scale, and 1e6 where a problem is infeasible
    even without the moment balance.

    Exit code 0 whatever the answers are; 2 if a problem could not be read, and then the others are
    still answered.
    """

    files: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE [FILE …]")]
    """Problem files, or - for standard input."""
    method: Annotated[str, named("stancekit.planners.search.methods:METHODS")] = "exact"
    """exact: branch and bound. p1: relaxation over an envelope. lift: relaxation without one.
    two-stage: relaxation (over the envelope, or the lift) and projection. nlp: IPOPT. micp:
    piecewise McCormick grid. One of your own counts as far as the verifier accepts its postures and
    certificates."""
    of_method: Annotated[MethodOptions, *OF_METHOD] = field(default_factory=MethodOptions)
    """Settings of the method."""
    time_limit_s: OptionalFloat = None
    """Limit per problem for exact, nlp and micp (30 unless another is given); what is not decided by
    then is undecided [s]."""
    certificate: bool = False
    """Add the certificate to infeasible answers, for `stancekit verify`."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """File for the answers, JSON lines, written at the end whole."""
    json: bool = False
    """One JSON object per line on standard output."""

    def run(self) -> int:
        """Answer every problem that can be read; exit code 2 if any could not."""
        from stancekit.planners.files.writing import write_text
        from stancekit.postures import planner_of, read_envelopes

        self._check()
        check_out(self.out)
        with as_options("method", "time_limit_s", *vars(self.of_method)):
            settings = self.of_method.settings(self.method, "postures", read_envelopes)
            planner = planner_of(self.method, time_limit_s=self.time_limit_s, **settings)
        problems = list(_problems(self.files))
        lines: list[dict[str, Any]] = []
        with progress(f"solve by {self.method}") as bar:
            for where, problem in problems:
                lines.append(self._answer(where, problem, planner))
                if self.json:
                    emit(lines[-1])
                bar(len(lines), len(problems))
        if self.out is not None:
            write_text(
                self.out, "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
            )
        if not self.json:
            out.print(_table(lines))
        return 2 if any(line["status"] == "invalid" for line in lines) else 0

    def _check(self) -> None:
        """Raise InvalidInput for an option that is out of range, or that the method does not
        know.
        """
        from stancekit.planners.search.methods import METHODS

        if not self.files:
            raise InvalidInput(
                "FILE: expected one or more problem files, got none (- is standard input)"
            )
        check_limit(self.time_limit_s)
        if self.method in METHODS and self.method not in _LIMITED and self.time_limit_s is not None:
            raise InvalidInput(
                f"--time-limit-s: expected --method {' or '.join(_LIMITED)} with it, got "
                f"{self.method}"
            )

    def _answer(
        self, where: str, problem: Problem | InvalidInput, planner: Planner
    ) -> dict[str, Any]:
        if isinstance(problem, InvalidInput):
            return _invalid(where, problem)
        from stancekit import solve

        try:
            outcome = solve(problem, planner)
        except InvalidInput as error:
            return _invalid(where, InvalidInput(f"{where}: {error}"))
        return {"where": where, **outcome.to_json(proof=self.certificate)}


def _problems(files: tuple[str, ...]) -> Iterator[tuple[str, Problem | InvalidInput]]:
    from stancekit.postures import read_problems

    for name in files:
        try:
            text = text_of(name)
        except InvalidInput as error:
            yield name, error
            continue
        yield from read_problems(text, name)


def _invalid(where: str, error: InvalidInput) -> dict[str, Any]:
    complain(f"stancekit: error: {error}")
    return {"where": where, "status": "invalid", "error": str(error)}


def _table(lines: list[dict[str, Any]]) -> Table:
    sides = {
        "problem": "left",
        "status": "left",
        "net moment": "right",
        "proved residual": "right",
        "ms": "right",
        "": "left",
    }
    rows, colour = (
        list[tuple[str | Text, ...]](),
        {"feasible": "green", "infeasible": "red", "undecided": "yellow", "invalid": "magenta"},
    )
    for line in lines:
        where, status = line["where"], Text(line["status"], style=colour[line["status"]])
        if line["status"] == "invalid":
            rows.append((where, status, "", "", "", "see the message above"))
            continue
        moment = "" if line["residual_nm"] is None else f"{line['residual_nm']:.1e} Nm"
        bound = "" if line["status"] != "infeasible" else f"> {line['lower_bound']:.2g}"
        message = line.get("message", "")
        rows.append((where, status, moment, bound, f"{1e3 * line['seconds']:.1f}", message))
    return results(sides, rows, folds=("problem", ""))
