"""``stancekit plan``: key frames over a course."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast, get_args

import tyro
from rich.text import Text

from stancekit.planners.errors import InvalidInput, NoPlace, TimeEnded, until

from .console import as_options, complain, emit, out, progress, results, say, show
from .options import (
    OF_METHOD,
    CourseMethodOptions,
    OptionalFloat,
    OptionalInt,
    OptionalPath,
    OptionalText,
    OptionalWrench,
    check_drawn,
    check_limit,
    check_unused,
    named,
    wrench_numbers,
)
from .solve import Between

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit import Answer, Leap, LeapFinder, Motion
    from stancekit.planners.answer.certificate import Way
    from stancekit.planners.answer.plan import LeapPlan, Plan
    from stancekit.planners.search.answer import Planner, PlanSettings


def _deliver(
    answer: Answer[Plan] | Answer[LeapPlan] | Answer[Motion[Way]],
    course: str,
    *,
    plan_file: Path | None,
    proof: Path | None,
    pictures: Mapping[str, Path | None],
    json: bool,
    time_limit_s: float,
) -> int:
    """Write the files that were asked for, and say what there is; exit code 1 without a plan.

    Arguments:
        course: name of what was asked, where the answer has none.
        pictures: the files of ``show``, by its names.
        time_limit_s: the limit that there was [s].
    """
    solution, report = answer.solution, answer.report
    accepted = answer.status.value == "feasible" and report is not None and report.accepted
    reason = re.sub(r"^(start|goal):", r"--\1:", _reason_of(answer))
    name = str(getattr(solution, "name", "") or getattr(answer.problem, "name", "") or course)
    written = _write(answer, plan_file, proof, pictures)
    if json:
        emit({"course": name, **_record(answer, reason), "files": [str(path) for path in written]})
    else:
        out.print(_table_of(answer, name))
        say((*_lines(answer), *_doubts(answer, time_limit_s)))
        refused = (
            "" if report is None or report.accepted else ", of a plan that the verifier refuses"
        )
        say(answer.doubts, "doubt: {}")
        say((f"{path}{'' if path == proof else refused}" for path in written), "wrote {}")
    if not accepted:
        complain(f"stancekit: no plan: {name}: {reason or answer.claim or answer.status.value}")
    if proof is not None and proof not in written:
        complain(f"{proof}: not written, since nothing is proved")
    return int(not accepted)


def _write(
    answer: Answer[Any], plan_file: Path | None, proof: Path | None, pictures: Mapping[str, Any]
) -> list[Path]:
    """Write the files; their names."""
    written: list[Path] = []
    if plan_file is None and proof is None and not any(pictures.values()):
        return written
    from stancekit import save

    if plan_file is not None and answer.solution is not None and answer.report is not None:
        with progress(f"write {plan_file}"):
            save(answer, plan_file)
        written.append(plan_file)
    certificate = answer.certificate or getattr(answer.solution, "certificate", None)
    if proof is not None and certificate is not None:
        save(certificate, proof)
        written.append(proof)
    if answer.solution is not None and answer.report is not None:
        written += show(answer.solution, **pictures)
    elif pictures["picture"] is not None and answer.problem is not None:
        from stancekit import draw

        draw(answer, out=pictures["picture"])
        written.append(pictures["picture"])
    return written


def _table_of(answer: Answer[Any], name: str) -> Table:
    """One row: what was planned, how, and what came of it."""
    sides = {
        "course": "left",
        "method": "left",
        "frames": "right",
        "status": "left",
        "objective": "right",
        "bound": "right",
        "compile": "right",
        "solve": "right",
    }
    status = answer.status.value
    colour = {"feasible": "green", "infeasible": "red", "undecided": "yellow"}[status]
    frames = _frames(answer)
    row = (
        name,
        answer.method,
        "–" if frames is None else str(frames),
        Text(status, style=colour),
        _number(answer.objective),
        _number(answer.bound),
        f"{answer.effort.compile_s:.2f} s",
        f"{answer.effort.seconds:.3f} s",
    )
    return results(sides, [row], folds=("course",))


def _reason_of(answer: Answer[Any]) -> str:
    """The planner's message; of what is refuted, the reason that the proof gives, and the sets it
    is over.
    """
    if answer.certificate is None or answer.problem is None or answer.status.value != "infeasible":
        return answer.message
    from stancekit.planners.verify import explain

    reason = explain(answer.certificate).message
    return (
        reason
        if answer.sets is None
        else f"{reason}; proved over the {answer.sets} sets of its legs"
    )


def _number(value: float) -> str:
    """Four digits, or a dash."""
    return f"{value:.4g}" if math.isfinite(value) else "–"


def _bent_lines(details: Mapping[str, float]) -> Iterator[str]:
    """Lines on how planning with the whole body changed the largest torque and the deepest
    collision, and on what a larger torque is for; nothing where it had nothing to do.
    """
    steps = int(details.get("torque_steps", 0.0))
    how = f"in {steps} step{'s' * (steps != 1)}" if steps else "by other forces"
    torque, share, depth = (  # before and after, NaN where it is not known
        (details.get(f"{name}_before", math.nan), details.get(name, math.nan))
        for name in ("torque_nm", "torque_share", "depth_m")
    )
    if torque[0] != torque[1] and math.isfinite(torque[1]):
        why = ""
        if torque[1] > torque[0]:
            eased = (
                f"where the joint nearest to its limit needs {share[0]:.0%} → {share[1]:.0%} of it"
            )
            why = f", {eased}" if share[1] < share[0] else ", the price of bodies that keep apart"
        figures = [f"{each:.1f}" for each in torque]
        if figures[0] != figures[1]:
            yield f"torque: {figures[0]} → {figures[1]} Nm {how}{why}"
    if depth[0] != depth[1] and math.isfinite(depth[1]):
        yield f"deepest collision: {1e3 * depth[0]:.1f} → {1e3 * depth[1]:.1f} mm {how}"


def _frames(answer: Answer[Any]) -> int | None:
    """The number of key frames; None of a leap, and of a crossing, whose parts have their own."""
    return getattr((answer.solution or answer).problem, "frames", None)


def _lines(answer: Answer[Any]) -> Iterator[str]:
    """Lines about what was found, below its table."""
    solution = answer.solution
    if solution is None or answer.report is None:
        return
    if solution.has("parts"):
        yield from _crossing_lines(answer, solution)
    elif solution.has("timing"):
        yield from _leap_lines(answer, solution)
    else:
        yield from _course_lines(answer, solution)


def _course_lines(answer: Answer[Plan], plan: Plan) -> Iterator[str]:
    report = answer.report
    assert report is not None
    share = plan.provenance.get("friction_share", 1.0)
    if share != 1.0:
        yield f"planned with {100 * share:.0f} % of the friction"
    if press := plan.provenance.get("press_share"):
        yield f"every foot that carries presses with {100 * press:.0f} % of the weight or more"
    if (wrench := plan.problem.wrench) is not None:
        force_n, moment_nm = (
            float((part**2).sum(axis=1).max() ** 0.5) for part in (wrench[:, :3], wrench[:, 3:])
        )
        yield f"carries up to {force_n:.3g} N and {moment_nm:.3g} Nm on the body beside its weight"
    if layout := plan.provenance.get("layout"):
        yield f"laid out differently, since no plan was accepted as asked: {layout}"
    goal_mm = 1e3 * report.figures["goal_m"]
    yield f"verifier: {report.message}; the last key frame is {goal_mm:.0f} mm from the goal"
    yield from _bent_lines(answer.details)
    yield report.body_message
    yield report.remark
    yield from (f"cannot be run: {line}" for line in plan.problem.robot.unrunnable)
    if plan.modes is not None:
        terrain = (
            ""
            if plan.problem.modes is None
            else f"; of the terrain: {' '.join(map(str, plan.problem.modes))}"
        )
        yield f"modes z: {' '.join(map(str, plan.modes.tolist()))}{terrain}"


def _leap_lines(answer: Answer[LeapPlan], plan: LeapPlan) -> Iterator[str]:
    """Lines about a leap; of a robot with a body each group with what it was before bending, and
    what was bent.
    """
    from stancekit.planners.answer.plan import LEAP_BODY

    report = answer.report
    assert report is not None
    yield f"{answer.effort.tries} tries, {answer.effort.solves} solves"
    yield f"verifier: {report.message}"
    if not plan.problem.robot.own:
        return
    for group in report.groups:
        if group.name not in LEAP_BODY:
            continue
        before = answer.details.get(f"{group.name}_before")
        was = "" if before is None else f", before bending {before:.3g}"
        where = (
            f" ({group.where}, {group.when:.2f} s)"
            if group.where and group.when is not None
            else ""
        )
        unit = "" if group.unit == "1" else f" {group.unit}"
        sentence = (
            group.message
            if group.verdict == "not checked"
            else (f"{group.value:.3g} of {group.limit:g}{unit}{where}{was}")
        )
        yield f"{group.name}: {group.verdict}: {sentence}"
    yield "torque: effort and velocity of the robot's file with a line between them; no motor is looked up"
    timing = plan.problem.timings_s[plan.timing]
    if timing not in cast("Leap", answer.problem).timings_s:
        yield f"bent: phases of {', '.join(f'{s:.2f}' for s in timing)} s"


def _crossing_lines(answer: Answer[Motion[Way]], crossing: Motion[Way]) -> Iterator[str]:
    assert answer.report is not None
    yield f"key frames alone: {crossing.problem.refusal}"
    if crossing.problem.certificate is not None:
        from stancekit.planners.verify import explain

        yield f"  proved: {explain(crossing.problem.certificate).message}"
    for k, part in enumerate(crossing.parts, 1):
        first, last = (part.com_m[i] for i in (0, -1))
        way = f"from ({first[0]:.2f}, {first[1]:.2f}) to ({last[0]:.2f}, {last[1]:.2f})"
        if part.has("timing"):
            phases = part.problem.timings_s[part.timing]
            yield f"{k}: leap {way}, phases of {', '.join(f'{s:.2f}' for s in phases)} s"
        else:
            yield f"{k}: climb {way}, {part.problem.frames} key frames"
    yield f"verifier: {answer.report.message}"


def _doubts(answer: Answer[Any], time_limit_s: float) -> Iterator[str]:
    """Lines on why what was found is no plan yet."""
    from stancekit.planners.answer.report import LATE

    if answer.report is not None and answer.report.accepted and answer.status.value == "undecided":
        yield f"not accepted as a plan: {answer.message}"
    if (at := answer.message.find(LATE)) >= 0:
        yield f"{answer.message[at:]}; --time-limit-s sets it, now to {time_limit_s:g} s"


def _record(answer: Answer[Any], reason: str) -> dict[str, Any]:
    """Everything as one JSON object."""
    from stancekit.planners.answer.report import or_null
    from stancekit.planners.verify import explain

    effort = answer.effort
    numbers = {
        "objective": answer.objective,
        "bound": answer.bound,
        "residual": answer.residual,
        "compile_s": effort.compile_s,
        "seconds": effort.seconds,
        "solver_seconds": effort.solver_s,
    }
    record: dict[str, Any] = {
        "frames": _frames(answer),
        "method": answer.method,
        "status": answer.status.value,
        **{key: or_null(value) for key, value in numbers.items()},
        "solves": effort.solves,
        "tries": effort.tries,
        "sets": answer.sets,
        "claim": answer.claim,
        "message": reason,
        "doubts": list(answer.doubts),
        "details": {key: or_null(float(value)) for key, value in answer.details.items()},
    }
    if answer.certificate is not None:
        record["leaves"] = len(answer.certificate.multipliers)
        record["proof"] = explain(answer.certificate).message
    if answer.solution is not None and answer.report is not None:
        record["verdict"] = answer.report.to_json()
        record |= _solution_record(answer.solution)
    return record


def _solution_record(solution: Motion[Any]) -> dict[str, Any]:
    if solution.has("parts"):
        return {
            "refusal": solution.problem.refusal,
            "proved": solution.problem.certificate is not None,
            "parts": list(solution.part_words),
        }
    record = {"plan": {name: array.tolist() for name, array in solution.arrays().items()}}
    if solution.has("timing"):
        return record
    return {
        **record,
        "cannot_run": list(solution.robot.unrunnable),
    }


OF_LEAP = (
    "course",
    "method",
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
    method: Annotated[str, named("stancekit.planners.search.methods:COURSE_METHODS")] = "two-stage"
    """two-stage: convex relaxation and projection. exact: branch and bound to the best plan, for
    short courses. micp: piecewise McCormick grid. nlp: IPOPT. decoupled: positions first, forces
    after, a baseline that fails on ice. One of your own counts as far as the verifier accepts its
    plans and certificates."""
    of_method: Annotated[CourseMethodOptions, *OF_METHOD] = field(
        default_factory=CourseMethodOptions
    )
    """Settings of the planner."""
    robot: Annotated[OptionalText, tyro.conf.arg(metavar="FILE|NAME")] = None
    """Another robot than the course's: a built-in name, a .urdf file, or a .yaml file that names
    one (extra robots). Plans use what its legs reach, and joint angles are found for every key
    frame. Of one posture's file: the robot whose limbs stand."""
    reach: Annotated[OptionalPath, tyro.conf.arg(metavar="FOLDER")] = None
    """Folder of reach polytopes (OBJ, as kinematic planners publish them) in place of the limbs'
    own reach."""
    policy: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Policy of a leap: learned scores of candidates, as `stancekit fit` writes them, in place of
    the hand rule's."""
    torque_nm: Annotated[OptionalFloat, tyro.conf.arg(metavar="NM")] = None
    """Plan so that no joint takes more torque, whatever it has [Nm] (extra robots). The plan says
    so, and verify holds it to that. Without it, a plan for a robot's file keeps to the file's
    limits."""
    torque_share: float = 0.9
    """Where a plan asks for more torque than there is, it is bent until this share of it is
    enough."""
    push_n: float = 0.0
    """Horizontal push at the body, in any direction, that every stance has to bear [N]. Without it
    a plan that bears 5 % of the weight is sought, then 2.5 %. two-stage."""
    margins: bool = False
    """Say how large a push every stance of the plan bears, how far the centre of mass may move, and
    how much of the friction is needed."""
    prefer_margin: bool = False
    """Prefer postures with more margin: the plan whose stances bear the largest push, up to 40 % of
    the weight, while there is time. two-stage."""
    wrench: OptionalWrench = None
    """Force on the body beside its weight at every key frame [N], and moment about the centre of
    mass [Nm], in world axes: a payload, wind, a rope. The plan carries it; a course that cannot be
    climbed with it is infeasible.
    """
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
    out: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.json")] = None
    """Plan file, for `stancekit verify`, `stancekit simulate` and `stancekit run`."""
    proof: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.json")] = None
    """Where the course is infeasible: the proof, for `stancekit verify` and whoever doubts it."""
    leaps: bool = True
    """With --start and --goal: a robot that was named may leap where key frames have no plan. Without
    leaps, what no balanced motion does is infeasible, else undecided, with the proof all the same."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture of the plan, or of why there is none: .png, .pdf or .svg."""
    video: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Film of the plan's motion (extra viz, and a GL library)."""
    html: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE.html")] = None
    """Page in three dimensions that a browser opens from disk, without a network (extra viz)."""
    json: bool = False
    """One JSON object with the verdict and all numbers on standard output."""

    def run(self) -> int:
        """Plan, write what was asked for; exit code 1 without a plan."""
        from stancekit.planners.problem.leap import is_leap_file

        answer = self._leap() if is_leap_file(self.course) else self._course()
        pictures = {name: getattr(self, name) for name in ("picture", "video", "html")}
        return _deliver(
            answer,
            Path(self.course).stem,
            plan_file=self.out,
            proof=self.proof,
            pictures=pictures,
            json=self.json,
            time_limit_s=self.time_limit_s,
        )

    def _course(self) -> Answer[Plan] | Answer[Motion[Way]]:
        """The answer to a course."""
        from stancekit.courses import plan, unmet

        begin = time.perf_counter()
        self._check()
        planner = self._planner()
        title = f"plan {Path(self.course).stem} by {self.method}"
        with progress(title) as show, self.between.in_options():
            try:
                with until(begin + self.time_limit_s):
                    question = self.between.question(
                        self.course, self.frames, self.robot, self.reach
                    )
            except (NoPlace, TimeEnded) as error:  # a ground with nothing to stand on
                return unmet(error, self.method, self.robot)
            what = self.between.asked(self.frames, self.robot, self.reach)
            left_s = max(
                begin + self.time_limit_s - time.perf_counter(), 0.0
            )  # a terrain has been read meanwhile
            with as_options("push_n", "wrench", "prefer_margin"):
                return cast(
                    "Answer[Plan] | Answer[Motion[Way]]",
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
        from stancekit import plan

        self._check_of_leap()
        self._check_files()
        finder = self._finder()
        with as_options("robot"), progress(f"plan {Path(self.course).stem} by {finder.order}"):
            return plan(self.course, finder, robot=self.robot, time_limit_s=self.time_limit_s)

    def _finder(self) -> LeapFinder:
        """The finder of leaps that the options ask for.

        Raises InvalidInput.
        """
        from stancekit.planners.leap.method import LeapFinder, Order, Rule, Scorer

        orders = get_args(Order)
        if self.method not in ("two-stage", *orders):
            raise InvalidInput(
                f"--method: expected one of {', '.join(orders)} with a leap, got {self.method}"
            )
        order: Any = "finder" if self.method == "two-stage" else self.method
        rule: Scorer = Rule()
        if self.policy is not None:
            if order == "random":
                raise InvalidInput(
                    "--policy: expected none with --method random, which has no scores"
                )
            from stancekit.learners.leaps.policy import LeapScorer

            rule = LeapScorer.read(self.policy)
        return LeapFinder(order=order, rule=rule, share=0.8 if self.of_method.reserve else 1.0)

    def _check_of_leap(self) -> None:
        """Raise InvalidInput for an option that was given and that a leap has no use for."""
        between = self.between
        for of in (self, self.of_method, between, between.file, between.footholds):
            used = OF_LEAP if of in (self, self.of_method) else ()
            names = (
                name
                for name, value in vars(of).items()
                if not is_dataclass(value) and name not in used
            )
            check_unused(of, names, "a leap")

    def _settings(self) -> PlanSettings:
        """Settings that a plan has to keep and to bear, from the options.

        Raises InvalidInput.
        """
        from stancekit import PlanSettings, WholeBodyLimits

        with as_options("torque_nm", "torque_share", "clearance_m", "push_n", "wrench"):
            return PlanSettings(
                body=WholeBodyLimits(
                    torque_nm=self.torque_nm, share=self.torque_share, clearance_m=self.clearance_m
                ),
                push_n=self.push_n,
                margins=self.margins,
                prefer_margin=self.prefer_margin,
                wrench=wrench_numbers(self.wrench),
                standing=self.between.map,
                leaps=self.leaps,
                checkpoint=None if self.out is None else self.out.with_suffix(".partial.json"),
            )

    def _check(self) -> None:
        """Raise InvalidInput for an option that is out of range, for another planner, or a file
        that cannot be.
        """
        check_limit(self.time_limit_s)
        check_unused(self, ("policy",), f"the course {self.course}")
        if self.between.start is None and not self.leaps:
            raise InvalidInput("--no-leaps: expected --start and --goal with it, got none")
        self._settings()
        self._check_files()

    def _check_files(self) -> None:
        """Raise InvalidInput for a file that cannot be written, and for one that is to be two."""
        from stancekit.planners.files.writing import check_writable

        paths: dict[Path, str] = {}
        for name in ("proof", "out", "picture", "video", "html"):
            option, target = f"--{name}", getattr(self, name)
            first = option if target is None else paths.setdefault(check_writable(target), option)
            if first != option:
                raise InvalidInput(
                    f"{option}: expected another file than {first}, got {target} for both"
                )
        for path in (self.out, self.proof):
            if path is not None and path.suffix != ".json":
                raise InvalidInput(
                    f"{path}: expected a name that ends in .json, got {path.suffix or 'no suffix'}"
                )
        check_drawn(self.picture, self.video, self.html)

    def _planner(self) -> Planner:
        from stancekit.planners.formats.question_file import read_boxes  # slow to import
        from stancekit.planners.search.methods import PlannerOptions, make_planner

        options = PlannerOptions(time_limit_s=self.time_limit_s)
        with as_options("method", "time_limit_s", *vars(self.of_method)):
            settings = self.of_method.settings(self.method, "courses", read_boxes)
            return make_planner(self.method, options, of="courses", **settings)
