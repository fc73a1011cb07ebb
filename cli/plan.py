"""``stancekit plan``: key frames over a course."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast, get_args

import tyro

from stancekit.planners.errors import InvalidInput

from .between import Between
from .console import as_options, progress
from .names import PROJECTION, named
from .options import (
    OptionalFloat,
    OptionalInt,
    OptionalPath,
    OptionalText,
    OptionalWrench,
    check_drawn,
    check_planner,
    wrench_numbers,
)

if TYPE_CHECKING:
    from stancekit.planners.answer.answer import Answer
    from stancekit.planners.answer.crossing import Crossing
    from stancekit.planners.answer.leap_plan import LeapPlan
    from stancekit.planners.answer.plan import Plan
    from stancekit.planners.leap.finder import LeapFinder
    from stancekit.planners.search.answer import Planner
    from stancekit.planners.search.plan_settings import PlanSettings

SETTINGS = (
    "planner",
    "relaxation",
    "envelope",
    "envelopes",
    "projection",
    "solver",
    "intervals",
    "max_solves",
    "push_n",
    "wrench",
    "time_limit_s",
)
"""What a planner's complaint may begin with that is an option here."""
OF_LEAP = (
    "course",
    "planner",
    "policy",
    "robot",
    "reserve",
    "time_limit_s",
    "out",
    "proof",
    "picture",
    "video",
    "html",
    "json",
)
"""Options that a leap has a use for; any other is refused."""


@dataclass
class PlanCourse:
    """Plan the key frames of a climb: where every toe goes, where the body is, and what every limb
    carries.

    COURSE is a built-in one (stairs, walls, icy-walls, tube, ground-to-wall), a family's ground as
    stairs:0.5:7 (FAMILY:LEVEL:SEED), a YAML or JSON file of your own, or with --start and --goal a
    terrain's file or name, as `stancekit terrain` has them; a file of one posture problem is a
    course of one frame. A file with phases, or with a distribution, is a leap, and so is
    leap-hard:7 (CLASS:SEED): its planners are finder, farkas, rule, noise and random.

      stancekit plan walls --frames 8 --out climb.json --picture climb.png
      stancekit plan icy-walls --html climb.html
      stancekit plan rubble.stl --start 0,0 --goal 2,0.5 --robot go1.urdf
      stancekit verify climb.json
      stancekit plan leap-hard:0 --out leap.json --picture leap.png

    Over a terrain with a gap that key frames do not cross, a robot whose URDF has limits of its
    joints' torque and speed leaps: key frames, a leap, key frames, in one file.

    A plan that is found has been accepted by a verifier that knows nothing of planners: every
    stance of every key frame, and the way between. status is feasible, infeasible (with a proof
    that was checked) or undecided (a limit was met, or the planner cannot prove what it claims).
    bound is a proved lower bound on the objective of any plan: the difference is the most that a
    better plan could win.

    A course of more than 40 key frames (200 of a robot whose legs are not known) is planned in
    pieces; a run that is interrupted, or ends at its time limit, keeps what it has beside --out,
    and the same command goes on from there.

    Exit code 1 where there is no plan, and a line says which constraints fail, at which frame and
    limb, by how much.
    """

    course: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="COURSE")]
    """Built-in name, FAMILY:LEVEL:SEED, YAML or JSON file, or a terrain's file or name."""
    planner: Annotated[str, named("stancekit.planners.search.methods:COURSE_METHODS")] = "two-stage"
    """two-stage: convex relaxation and projection. exact: branch and bound to the best plan, for
    short courses. micp: piecewise McCormick grid. nlp: IPOPT. decoupled: positions first, forces
    after, a baseline that fails on ice. One of your own counts as far as the verifier accepts its
    plans and certificates."""
    relaxation: Annotated[
        OptionalText, named("stancekit.planners.relaxation.table:RELAXATIONS")
    ] = None
    """First stage of two-stage: lift needs nothing learned; p1, the paper's, and coned, which is
    tighter, are over --envelope; the one that fits unless named."""
    robot: Annotated[OptionalText, tyro.conf.arg(metavar="FILE|NAME")] = None
    """Another robot than the course's: a built-in name, a .urdf file, or a .yaml file that names
    one (extra robots). Plans use what its legs reach, and joint angles are found for every key
    frame. Of one posture's file: the robot whose limbs stand."""
    reach: Annotated[OptionalPath, tyro.conf.arg(metavar="FOLDER")] = None
    """Folder of reach polytopes (OBJ, as kinematic planners publish them) in place of the limbs'
    own reach."""
    envelope: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Envelope file for two-stage and micp, as `stancekit fit` writes it; for two-stage also a file
    of modes."""
    policy: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Policy of a leap: learned scores of candidates, as `stancekit fit` writes them, in place of
    the hand rule's."""
    projection: Annotated[str, PROJECTION] = "scp"
    """Second stage of two-stage and micp. fix-p: the paper's. fix-toes: frees body and forces. scp:
    frees all, in steps."""
    solver: Literal["highs", "scip", "gurobi"] = "highs"
    """Solver of micp."""
    intervals: int = 4
    """Pieces of each axis in micp's grid, a power of two."""
    reserve: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = True
    """Plan with all of the friction at once. Without --no-reserve, with 80 % of it where that has a
    plan, else with 90 %, else with all of it: what is executed then has something in hand.
    Two-stage only; there is a bound only of plans with all of it."""
    torque_nm: Annotated[OptionalFloat, tyro.conf.arg(metavar="NM")] = None
    """Plan so that no joint takes more torque, whatever it has [Nm] (extra robots). The plan says
    so, and verify holds it to that. Without it, a plan for a robot's file keeps to the file's
    limits."""
    torque_share: float = 0.9
    """Where a plan asks for more torque than there is, it is bent until this share of it is
    enough."""
    push_n: float = 0.0
    """Horizontal push at the body, in any direction, that every stance has to bear [N]. Without it
    a plan that bears 5 % of the weight is sought, then 2.5 %; what it bears is said. two-stage."""
    wrench: OptionalWrench = None
    """Force on the body beside its weight at every key frame [N], and moment about the centre of
    mass [Nm], in world axes: a payload, wind, a rope. The plan carries it, and a course that nobody
    can climb with it is infeasible."""
    between: Annotated[Between, tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="")] = field(
        default_factory=Between
    )
    """From where to where over a terrain's file."""
    clearance_m: float = 0.005
    """Where links go through each other or the terrain, at key frames or between them, a plan is
    bent until they are so far apart [m]."""
    frames: OptionalInt = None
    """Number of key frames M, where not the course's own."""
    time_limit_s: float = 60.0
    """Limit for all of it, bending and judging included; what is not decided by then is undecided,
    and what there is so far is said and written [s]."""
    max_solves: OptionalInt = None
    """Limit of convex solves of each search for contacts, beside the time: with a time that is
    never met, a plan is the same on a busy computer. two-stage and exact."""
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.json")] = None
    """Plan file, for `stancekit verify`, `stancekit simulate` and `stancekit run`."""
    proof: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.json")] = None
    """Where the course is infeasible: the proof, for `stancekit verify` and whoever doubts it."""
    leaps: bool = True
    """With --start and --goal: a robot that was named may leap where key frames have no plan. Without
    leaps, what no balanced motion does is infeasible, else undecided, with the proof all the same."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the plan: .png, .pdf or .svg."""
    video: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Film of the plan's motion (extra viz, and a GL library)."""
    html: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.html")] = None
    """Page in three dimensions that a browser opens from disk, without a network (extra viz)."""
    json: bool = False
    """One JSON object with the verdict and all numbers on standard output."""

    def run(self) -> int:
        """Plan, write what was asked for; exit code 1 without a plan."""
        from stancekit.planners.problem.leap_names import is_leap_file

        from .plan_answer import deliver

        answer = self._leap() if is_leap_file(self.course) else self._course()
        pictures = {name: getattr(self, name) for name in ("picture", "video", "html")}
        return deliver(
            answer,
            plan_file=self.out,
            proof=self.proof,
            pictures=pictures,
            json=self.json,
            time_limit_s=self.time_limit_s,
        )

    def _course(self) -> Answer[Plan] | Answer[Crossing]:
        """The answer to a course."""
        from stancekit.courses import plan

        begin = time.perf_counter()
        self._check()
        planner = self._planner()
        title = f"plan {Path(self.course).stem} by {self.planner}"
        with progress(title) as show, self.between.in_options():
            question = self.between.question(self.course, self.frames, self.robot, self.reach)
            what = self.between.asked(self.frames, self.robot, self.reach)
            left_s = max(
                begin + self.time_limit_s - time.perf_counter(), 0.0
            )  # a terrain has been read meanwhile
            with as_options("push_n", "wrench"):
                return cast(
                    "Answer[Plan] | Answer[Crossing]",
                    plan(
                        question,
                        planner,
                        **what,
                        settings=self._settings(),
                        time_limit_s=left_s,
                        progress=show,
                    ),
                )

    def _leap(self) -> Answer[LeapPlan]:
        """The answer to a leap.

        Raises InvalidInput for options that it has no use for.
        """
        from stancekit.courses import plan

        self._check_of_leap()
        self._check_files()
        finder = self._finder()
        with as_options("robot"), progress(f"plan {Path(self.course).stem} by {finder.order}"):
            return plan(self.course, finder, robot=self.robot, time_limit_s=self.time_limit_s)

    def _finder(self) -> LeapFinder:
        """The finder of leaps that the options ask for.

        Raises InvalidInput.
        """
        from stancekit.planners.leap.finder import LeapFinder, Order
        from stancekit.planners.leap.rule import Rule, Scorer

        orders = get_args(Order)
        if self.planner not in ("two-stage", *orders):
            raise InvalidInput(
                f"--planner: expected one of {', '.join(orders)} with a leap, got {self.planner}"
            )
        order: Any = "finder" if self.planner == "two-stage" else self.planner
        rule: Scorer = Rule()
        if self.policy is not None:
            if order == "random":
                raise InvalidInput(
                    "--policy: expected none with --planner random, which has no scores"
                )
            from stancekit.learners.leaps.scorer import LeapScorer

            rule = LeapScorer.read(self.policy)
        return LeapFinder(order=order, rule=rule, share=0.8 if self.reserve else 1.0)

    def _check_of_leap(self) -> None:
        """Raise InvalidInput for an option that was given and that a leap has no use for."""
        between = self.between
        for of in (self, between, between.file, between.footholds):
            plain: Any = PlanCourse(course="") if of is self else cast("Any", type(of))()
            for name, value in vars(plain).items():
                unused = is_dataclass(value) or getattr(of, name) == value
                if unused or (of is self and name in OF_LEAP):
                    continue
                option = name.replace("_", "-")
                raise InvalidInput(
                    f"--{option}: expected none with a leap, got {getattr(of, name)}"
                )

    def _settings(self) -> PlanSettings:
        """Settings that a plan has to keep and to bear, from the options.

        Raises InvalidInput.
        """
        from stancekit.planners.projection.whole_body_limits import WholeBodyLimits
        from stancekit.planners.search.plan_settings import PlanSettings

        with as_options("torque_nm", "torque_share", "clearance_m", "push_n", "wrench"):
            return PlanSettings(
                body=WholeBodyLimits(
                    torque_nm=self.torque_nm, share=self.torque_share, clearance_m=self.clearance_m
                ),
                push_n=self.push_n,
                wrench=wrench_numbers(self.wrench),
                standing=self.between.map,
                leaps=self.leaps,
                checkpoint=None if self.out is None else self.out.with_suffix(".partial.json"),
            )

    def _check(self) -> None:
        """Raise InvalidInput for an option that is out of range, for another planner, or a file
        that cannot be.
        """
        from stancekit.planners.search.methods import COURSE_METHODS

        check_planner(self, "planner", COURSE_METHODS, "courses")
        if self.policy is not None:
            raise InvalidInput(f"--policy: expected a leap with it, got {self.course}")
        self._settings()
        if self.relaxation is not None:
            from stancekit.planners.relaxation.table import RELAXATIONS

            with as_options(*SETTINGS):
                RELAXATIONS.get(self.relaxation)
        if self.relaxation not in (None, "lift") and self.envelope is None:
            raise InvalidInput(
                f"--relaxation: expected --envelope FILE with {self.relaxation}, got none"
            )
        if self.relaxation == "lift" and self.envelope is not None:
            raise InvalidInput("--envelope: expected a --relaxation over one with it, got lift")
        self._check_files()

    def _check_files(self) -> None:
        """Raise InvalidInput for a file that cannot be written, and for one that is to be two."""
        from stancekit.planners.files.writing import check_writable

        paths: dict[Path, str] = {}
        for name in ("proof", "out", "picture", "video", "html"):
            option, target = f"--{name}", getattr(self, name)
            first = option if target is None else paths.setdefault(target.resolve(), option)
            if first != option:
                raise InvalidInput(
                    f"{option}: expected another file than {first}, got {target} for both"
                )
        for path in (self.out, self.proof):
            if path is not None:
                check_writable(path)
                if path.suffix != ".json":
                    raise InvalidInput(
                        f"{path}: expected a name that ends in .json, got "
                        f"{path.suffix or 'no suffix'}"
                    )
        check_drawn(self.picture, self.video, self.html)

    def _planner(self) -> Planner:
        from stancekit.planners.search.methods import PlannerOptions, make_planner, settings_of

        boxes = None
        if self.envelope is not None:
            from stancekit.planners.formats.answer_file import read_boxes  # slow to import

            boxes = read_boxes(self.envelope)
        planner_settings = {
            "relaxation": self.relaxation,
            "envelopes": boxes,
            "projection": self.projection,
            "reserve": self.reserve,
            "max_solves": self.max_solves,
            "solver": self.solver,
            "intervals": self.intervals,
        }
        with as_options(*SETTINGS):
            names = settings_of(self.planner, "courses")
            options = PlannerOptions(time_limit_s=self.time_limit_s)
            settings = {name: value for name, value in planner_settings.items() if name in names}
            return make_planner(self.planner, options, of="courses", **settings)
