"""Files: any of Stancekit's, read by what they say they are, and written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

from stancekit import Answer, Certificate, EnvelopeSet, InvalidInput, Modes, Motion, Problem
from stancekit.learners.leaps.kinds import SCORER, Scores
from stancekit.planners.arguments import came, checked
from stancekit.planners.files.documents import read_json, read_text, read_yaml, shown
from stancekit.planners.files.writing import write_text
from stancekit.planners.formats.motion_file import read_evidence, write_certificate, write_motion
from stancekit.planners.formats.question_file import (
    read_envelopes,
    read_leap,
    read_modes,
    read_problems,
    write_boxes,
)
from stancekit.planners.problem.course_file import builtin_courses, read_course
from stancekit.planners.problem.leap import Leap, is_leap
from stancekit.planners.robot.walker import named_walker
from stancekit.planners.terrain.families import drawn_name
from stancekit.planners.verify.judge import judge

if TYPE_CHECKING:
    from stancekit.learners.selectors.selector import Learned

    Saved = (
        Problem
        | Leap
        | EnvelopeSet
        | Modes
        | Answer[Any]
        | Motion[Any]
        | Certificate
        | Learned
        | Scores
    )
else:
    Saved = Any  # selectors take a while to load, and ``save`` says itself what has no file

Kind = TypeVar("Kind")
_READERS: Mapping[str, Callable[[Path], Any]] = {
    "posture": lambda path: _only(_problems(path), path),
    "course": read_course,
    "envelope": read_envelopes,
    "modes": read_modes,
    "leap": read_leap,
    "motion": lambda path: read_evidence(path)[0],
    "certificate": lambda path: read_evidence(path)[0],
}
"""By what stands between the slashes of a file's format, e.g. ``stancekit/motion/1``."""


@overload
def load(path: str | Path) -> Any: ...
@overload
def load(path: str | Path, kind: type[Kind]) -> Kind: ...
@checked
def load(path: str | Path, kind: type[Any] = object) -> Any:
    """Read any of Stancekit's files; its format is read from the file.

    Arguments:
        path: a file, or the folder of a data set; or the name of a course that ``plan`` takes
            ("walls", "stairs:0.5:7"), where there is no such file.
        kind: expected type, e.g. ``stancekit.Motion``, known to type checkers, too; by default any.

    Returns:
        Problem, or a list of them where the file holds JSON lines or an array
        (``stancekit/posture/1``, ``stancekit/course/1``, or YAML); Leap (``stancekit/leap/1``, or
        YAML); EnvelopeSet; Modes; the Motion of a motion
        (``stancekit/motion/1``); the Certificate of a proof, which knows its problem; Dataset;
        LeapTries; Robot that walks (YAML or URDF); what a safetensors file of a neural selector,
        or policy holds, as ``Learned``; LeapScorer; Surrogate. Nothing is unpickled.

    Raises:
        InvalidInput: for a file that is missing, damaged or foreign, or of another kind.
    Source:
        docs/formats.md.

    Example:
        >>> import stancekit
        >>> stancekit.save(stancekit.plan("stairs", frames=2).solution, "climb.json")
        >>> stancekit.load("climb.json", stancekit.Motion).problem.name
        'stairs'
    """
    value = _read(Path(path))
    if not isinstance(value, kind):
        raise InvalidInput(f"{path}: expected a {kind.__name__}, got a {type(value).__name__}")
    return value


@checked
def save(thing: Saved | Sequence[Problem], path: str | Path) -> None:
    """Write a thing to a file that ``load`` reads back, whole or not at all.

    Arguments:
        thing: a posture problem, several of them (JSON lines), a course, a leap, envelopes, modes,
            a motion (a plan of a course, a walk, a leap, a crossing), a certificate, or what
            ``fit`` returned. A motion is verified, and the verdict is written with it. Of an answer
            its solution is written, with the report that it came with, or else its certificate. A
            data set is a folder that ``label`` writes.
        path: the file; .json, but .safetensors for what has a network.

    Raises:
        InvalidInput: for another kind of thing, an answer with neither, and where nothing can be
            written.
    Source:
        docs/formats.md.

    Example:
        >>> import stancekit
        >>> problems = stancekit.sample("wall-3", 2, rng=0)
        >>> stancekit.save(problems, "postures.jsonl")
        >>> [problem.legs for problem in stancekit.load("postures.jsonl")]
        [('RF', 'RR', 'LM'), ('RF', 'RR', 'LM')]
    """
    report = None
    if isinstance(thing, Answer):
        report, content = thing.report, thing.solution or thing.certificate
        if content is None:
            raise InvalidInput(
                f"{path}: expected an answer with a solution or a certificate, got "
                f"{thing.status.value}"
            )
        thing = content
    match thing:
        case Problem():
            lines = Path(path).suffix == ".jsonl"
            write_text(path, json.dumps(thing.to_json(), indent=None if lines else 1) + "\n")
        case Leap():
            write_text(path, json.dumps(thing.to_json(), allow_nan=False) + "\n")
        case EnvelopeSet() | Modes():
            write_boxes(path, thing)
        case Motion():
            write_motion(path, thing, report or judge(thing))
        case Certificate():
            write_certificate(path, thing)
        case [Problem(), *_] if all(isinstance(one, Problem) and one.is_posture for one in thing):
            problems = [one for one in thing if isinstance(one, Problem)]
            write_text(path, "".join(json.dumps(one.to_json()) + "\n" for one in problems))
        case Scores():
            if Path(path).suffix != SCORER:
                raise InvalidInput(
                    f"{path}: expected a name that ends in {SCORER} for scores, got something else"
                )
            thing.write(path)
        case _:
            from stancekit.learners.selectors.selector import Learned

            if not isinstance(thing, Learned):
                raise InvalidInput(
                    "thing: expected a problem, a leap, envelopes, modes, an answer, a motion, a "
                    "certificate, or what fit returned, got "
                    f"{came(thing)}"
                )
            thing.write(Path(path))


def _read(path: Path) -> Any:
    if _is_folder(path):
        from stancekit.envs.data.leap_tries import open_rows

        return open_rows(path)
    if (str(path) in builtin_courses() or drawn_name(str(path))) and not path.exists():
        return read_course(path)
    if path.suffix == SCORER:
        from stancekit.learners.selectors.selector import read_weights

        return read_weights(path)
    if path.suffix in (".yaml", ".yml"):
        data = read_yaml(path)
        if is_leap(data):
            return read_leap(path)
        return read_course(path) if "terrain" in data else named_walker(path)
    if path.suffix == ".urdf":
        return named_walker(path)
    if path.suffix != ".json":
        return _problems(path)
    data = read_json(path)
    if isinstance(data, list):
        return _problems(path)
    format_ = data.get("format") if isinstance(data, dict) else type(data).__name__
    house, *rest = str(format_).split("/")
    if house != "stancekit" or len(rest) != 2 or rest[0] not in _READERS:
        known = ", ".join(f"stancekit/{name}" for name in _READERS)
        raise InvalidInput(f"{path}: expected a format of {known}, got {shown(format_)}")
    return _READERS[rest[0]](path)


def _problems(path: Path) -> list[Problem]:
    """All problems of a file.

    Raises InvalidInput for the first that is none.
    """
    problems = []
    for _, problem in read_problems(read_text(path), str(path)):
        if isinstance(problem, InvalidInput):
            raise problem
        problems.append(problem)
    return problems


def _only(problems: list[Problem], path: Path) -> Problem:
    if len(problems) != 1:
        raise InvalidInput(f"{path}: expected one problem, got {len(problems)}")
    return problems[0]


def _is_folder(path: Path) -> bool:
    """Tell whether a folder has this name; False for a name that no file can have."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False
