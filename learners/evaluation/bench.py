"""Table I again: label, learn by every method, compare on held-out terrains. What is done is kept
and used again.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.ledger import LabelPlan, software
from stancekit.envs.distributions.postures import distribution
from stancekit.envs.scenes import LabelledScene
from stancekit.planners.equilibrium.yardstick import yardstick
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import read_yaml, shown, validated
from stancekit.planners.files.writing import make_folder, write_text
from stancekit.planners.plugins import code_of
from stancekit.planners.projection.project import PROJECTIONS, Projection

from ..data.executors import Executor
from ..data.labelling import Quota, label
from ..selectors.selector import FixedSelector, Learned, load_selector
from ..training.fitting import METHODS, FitSettings, learn_selector
from .evaluate import TABLE_I, Score, evaluate, evaluate_lift, paper_row

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Definition of an experiment: its problems, amount of data and methods.

    The seeds of ``train``, ``calibration`` and ``test`` differ.

    Arguments:
        robot, terrain: files that the problems are of, where not the default hexapod and no
            terrain's.
        calibration: rows that methods may calibrate on; without it they keep a part of ``train``
            for that.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    problems: tuple[str, ...]
    train: Quota
    test: Quota
    calibration: Quota | None = None
    methods: tuple[str, ...]
    projections: tuple[Projection, ...]
    fit: FitSettings = field(default_factory=FitSettings)
    robot: str | None = None
    terrain: str | None = None

    def __post_init__(self) -> None:
        if self.train.seed == self.test.seed:
            raise InvalidInput(
                f"test.seed: expected another seed than train.seed, got {self.test.seed} for both"
            )
        if self.calibration is not None and self.calibration.seed in (
            self.train.seed,
            self.test.seed,
        ):
            got = self.calibration.seed
            raise InvalidInput(
                f"calibration.seed: expected another seed than train.seed and test.seed, got {got}"
            )
        for name in self.problems:
            distribution(name, robot=self.robot, terrain=self.terrain)
        for index, method in enumerate(self.methods):
            known = [name for name in METHODS.names() if name != "modes"]
            if method not in known and ".py:" not in method:
                raise InvalidInput(
                    f"methods[{index}]: expected one of {', '.join(known)}, got {method!r}"
                )
            if ".py:" in method:
                METHODS.get(method)  # what is no method is said before anything is labelled
            self.fit.check(method)
        for name in ("problems", "methods", "projections"):
            if not getattr(self, name):
                raise InvalidInput(f"{name}: expected one or more, got none")
        for name in self.projections:
            PROJECTIONS.get(name)

    @classmethod
    def from_yaml(
        cls, path: str | Path, *, quick: bool = False, overrides: Mapping[str, Any] | None = None
    ) -> Experiment:
        """Read an experiment file.

        Raises InvalidInput with every key that is wrong.

        Arguments:
            quick: with the keys of its section ``quick`` in place of the main ones.
            overrides: in place of either.
        """
        data = read_yaml(path)
        short = data.pop("quick", {})
        if quick and not (isinstance(short, dict) and short):
            raise InvalidInput(f"{path}: quick: expected keys of an experiment, got {shown(short)}")
        return validated(cls, (data | short if quick else data) | dict(overrides or {}), str(path))


_LABEL, _P1, _PROJECTION = 2.5, 0.8, 0.4
"""Cost of a row, of a scene's P1 and of one projection, in cone programs of ``yardstick``."""
_FIT: Mapping[str, Callable[[FitSettings, Quota], float]] = {
    "heuristic": lambda how, rows: 0.5 * (rows.feasible + rows.infeasible),
    "quantile": lambda how, rows: 0.5 * (rows.feasible + rows.infeasible),
    "gmm": lambda how, rows: 1.0 * how.clusters * how.steps * how.batch,
    "gradient": lambda how, rows: 0.8 * how.boxes * how.steps * how.batch,
    "ga": lambda how, rows: 0.3 * _size(how.genetic, population=40, generations=60, terrains=100),
    "neural": lambda how, rows: 3.0 * rows.feasible * _size(how.neural, margin_epochs=4),
    "joint": lambda how, rows: 5.0 * rows.feasible * _size(how.neural, margin_epochs=4),
    "rl": lambda how, rows: 8.0 * _size(how.rl, steps=40_000),
}
"""Cost of a fit by our methods, in the same."""


def _size(keys: Mapping[str, Any], **usual: int) -> float:
    return math.prod(float(keys.get(name, value)) for name, value in usual.items())


def expected_s(experiment: Experiment, workers: int = 1) -> float:
    """Rough wall-clock time of a whole run on idle cores [s], from its settings and the speed of
    this computer, which is measured. Methods that are not ours count as nothing.
    """
    how, methods, rows = experiment.fit, experiment.methods, experiment.train
    scenes = experiment.test.feasible + experiment.test.infeasible
    play = scenes * (_P1 + _PROJECTION * len(experiment.projections)) * (1 + len(methods))
    label = _LABEL * (rows.feasible + rows.infeasible + scenes)
    fits = {name: _FIT[name](how, rows) for name in methods if name in _FIT}
    printed = how.clusters * how.time_limit_s * ("gmm-printed" in methods)
    programs = (label + play + fits.pop("ga", 0.0)) / workers + sum(fits.values())
    return len(experiment.problems) * (programs * yardstick(60) / 60 + printed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Several selectors beside each other on the same rows, as ``evaluate`` makes it.

    ``markdown`` and ``picture`` are for a paper; ``to_json`` has the numbers.

    Arguments:
        problem_class: name of the class of problems.
        scores: a row per selector.
    Source:
        Lin et al. Table I.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> test = stancekit.label("wall-3", "test", rows=(6, 6), seed=1)
        >>> mine = {"mine": stancekit.fit(train, "quantile"), "lift": "lift"}
        >>> print(stancekit.evaluate(mine, test).markdown()[:9])
        ## wall-3
    """

    problem_class: str
    scores: tuple[Score, ...]

    def to_json(self) -> list[dict[str, Any]]:
        """A row per selector as JSON-ready numbers, with the paper's where it has some."""
        records = []
        for score in self.scores:
            record = {
                "problem_class": self.problem_class,
                **score.to_json(),
                "balanced": score.balanced,
            }
            paper = paper_row(self.problem_class, score.selector)
            records.append(record if paper is None else {**record, "paper": paper})
        return records

    def markdown(self) -> str:
        """The table in Markdown, with 95 % intervals and the paper's rows."""
        return "\n".join(markdown(self.problem_class, self.to_json()))

    def picture(self) -> Figure:
        """The shares as bars with 95 % intervals, and the paper's as markers."""
        from stancekit.views.comparison import ComparisonBar, draw_comparison

        bars = []
        for score in self.scores:
            shares = {"P1 feasible": score.p1_feasible, "P1 infeasible": score.p1_infeasible}
            shares |= {f"→ {way}": share for way, share in score.projected.items()}
            values = {name: share.value for name, share in shares.items() if share.of}
            paper = paper_row(self.problem_class, score.selector) or {}
            bars.append(
                ComparisonBar(
                    selector=score.selector,
                    values=values,
                    paper={
                        _MEASURES[key]: each
                        for key, each in paper.items()
                        if _MEASURES.get(key) in values
                    },
                    intervals={name: share.interval for name, share in shares.items() if share.of},
                )
            )
        return draw_comparison(
            bars,
            caption=f"{self.problem_class}: {bars and self.scores[0].p1_feasible.of} feasible "
            f"and {self.scores[0].p1_infeasible.of} infeasible held-out terrains",
        )


_MEASURES = {
    "p1_feasible": "P1 feasible",
    "p1_infeasible": "P1 infeasible",
    "project_fix_p": "→ fix-p",
    "project_nlp": "→ nlp",
}
"""Names of the paper's figures in pictures."""
_CLAIMS = ("P1 feasible", "P1 infeasible")
_IDENTITY = re.compile(r"-(of|on)-(.+?)-([0-9a-f]{6})[0-9a-f]{6}(?=-on-|$)")


def title_of(problem_class: str) -> str:
    """A class of problems in words: "terrain-3 of go1 (c828d3) on tiles (7802fa)", the digests of
    both files cut.
    """
    return _IDENTITY.sub(r" \1 \2 (\3)", problem_class)


def page(records: Sequence[Mapping[str, Any]], experiment: Experiment) -> str:
    """Markdown of rows as ``Score.to_json`` has them, with ``problem_class`` and ``balanced``.

    Sorted by the mean of both shares of P1; shares are % with Wilson 95 % intervals. The paper's
    rows have no rank: their scenes are other draws. Below the tables stand the data and, a line a
    selector, what it was learned with.
    """
    text = "% of held-out scenes, with 95 % intervals (Wilson); the best share is bold."
    lines = ["# Leaderboard: selectors of envelopes", "", text, ""]
    for name in dict.fromkeys(record["problem_class"] for record in records):
        lines += markdown(name, [record for record in records if record["problem_class"] == name])
    return "\n".join([*lines, *_data(experiment), *_cards(records), ""])


def markdown(name: str, records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines of the table of one class of problems."""
    ways = [
        key.removesuffix("_of").removeprefix("project_")
        for key in records[0]
        if key.startswith("project_") and key.endswith("_of")
    ]
    keys = ["p1_feasible", "p1_infeasible", *(f"project_{way}" for way in ways)]
    best = {
        key: max((row[key] for row in records if row[key] is not None), default=None)
        for key in keys
    }
    ranked = sorted(records, key=lambda row: -row["balanced"])
    counts = f"{records[0]['p1_feasible_of']} feasible and {records[0]['p1_infeasible_of']} infeasible scenes"
    lines = [f"## {title_of(name)}", "", f"{counts}.", ""]
    lines += [_row(["", "selector", *_CLAIMS, *(way.replace("_", "-") for way in ways), "P1 [ms]"])]
    lines += [_row(["---:", "---", *("---:" for _ in keys), "---:"])]
    for rank, row in enumerate(ranked, 1):
        shares = (_share(row, key, bold=row[key] == best[key]) for key in keys)
        lines.append(_row([str(rank), str(row["selector"]), *shares, _number(row.get("p1_ms"))]))
    for selector, figures in TABLE_I.get(name, {}).items():
        by_way = {"project_fix_p": figures[2], "project_nlp": figures[3]}
        shown = [figures[0], figures[1], *(by_way.get(key) for key in keys[2:])]
        lines.append(
            _row(
                [
                    "",
                    f"paper: {selector}",
                    *("–" if x is None else f"{100.0 * x:.1f}" for x in shown),
                    "–",
                ]
            )
        )
    return [*lines, ""]


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _share(row: Mapping[str, Any], key: str, *, bold: bool) -> str:
    if row[key] is None:
        return "–"
    low, high = row[f"{key}_interval"]
    value = f"**{100.0 * row[key]:.1f}**" if bold else f"{100.0 * row[key]:.1f}"
    return f"{value} [{100.0 * low:.1f}, {100.0 * high:.1f}]"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _data(experiment: Experiment) -> list[str]:
    """Section on the rows that the methods learned from and were judged on, and on versions."""
    lines = [
        "## Data",
        "",
        _row(["part", "feasible", "infeasible", "seed"]),
        _row(["---", "---:", "---:", "---:"]),
    ]
    for part in ("train", "calibration", "test"):
        quota = getattr(experiment, part)
        if quota is not None:
            lines.append(_row([part, *map(str, (quota.feasible, quota.infeasible, quota.seed))]))
    of = [
        f"{key} `{value}`"
        for key in ("robot", "terrain")
        if (value := getattr(experiment, key)) is not None
    ]
    proved = (
        "Every label has a posture or a certificate, which `stancekit verify FOLDER` checks again."
    )
    hard = "Infeasible scenes need their moment balance to be so." + (
        f" Of {', '.join(of)}." if of else ""
    )
    made = (
        "Made with " + ", ".join(f"{name} {version}" for name, version in software().items()) + "."
    )
    return [*lines, "", f"{proved} {hard}", "", made, ""]


def _cards(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line a learned selector: its file, what fitting took, and where it must not be used."""
    learned = [row for row in records if "fit_seconds" in row]
    lines = [
        "## Cards",
        "",
        _row(["selector", "of", "file", "fitted in [s]"]),
        _row(["---", "---", "---", "---:"]),
    ]
    lines += [
        _row(
            [
                str(row["selector"]),
                row["problem_class"],
                row.get("file") or "none kept",
                _number(row["fit_seconds"]),
            ]
        )
        for row in learned
    ]
    return [
        *lines,
        "",
        "A selector is for the class, the robot and the terrain of its row: it is refused for "
        "others. Nothing that it",
        "says has to be believed: postures and certificates are verified. Settings are those of "
        "the experiment's file,",
        "seeds those above; seconds are of the wall clock.",
    ]


Progress = Callable[[str, int, int], None]
_OnProgress = Callable[[str], Callable[[int, int], None]]
_SHARD_SIZE = 125


@dataclass(frozen=True, kw_only=True, eq=False)
class ClassResult(Comparison):
    """Results of a run for one class of problems.

    Arguments:
        labelling: summary of the training rows.
        learned: selectors by method.
        fresh: rows that this run made.
    """

    labelling: Mapping[str, Any]
    learned: Mapping[str, Learned]
    test: Dataset
    fresh: tuple[str, ...]


class _Row(BaseModel):
    """``METHOD.row.json``: what a row was made from and what it says."""

    model_config = ConfigDict(extra="forbid", strict=True, ser_json_inf_nan="constants")
    format: Literal["stancekit/bench-row/2"] = "stancekit/bench-row/2"
    fit_key: str
    file: str
    file_sha256: str
    fit_seconds: float
    row_key: str = ""
    score: Score | None = None

    __hash__: ClassVar[None]  # type: ignore[assignment]


def run(
    experiment: Experiment, folder: Path, *, executor: Executor, progress: Progress | None = None
) -> Iterator[ClassResult]:
    """Yield the result of every class as it comes; everything is kept in ``folder``.

    Data sets are gone on with, selectors and rows used again, wherever they follow from the same
    settings, data and software.

    Arguments:
        executor: where labelling, generations and rollouts run.

    Raises:
        InvalidInput: e.g. where a data set of another plan is in the folder.
    """
    for name in experiment.problems:
        make_folder(folder / name)

        def on_progress(stage: str, name: str = name) -> Callable[[int, int], None]:
            return lambda done, total: (
                None if progress is None else progress(f"{name}: {stage}", done, total)
            )

        yield _Class(experiment, name, folder / name, executor, on_progress).result()


class _Class:
    """The run of one class of problems."""

    def __init__(
        self,
        experiment: Experiment,
        name: str,
        folder: Path,
        executor: Executor,
        on_progress: _OnProgress,
    ) -> None:
        self._experiment, self._name, self._folder, self._run, self._told = (
            experiment,
            name,
            folder,
            executor,
            on_progress,
        )

    def result(self) -> ClassResult:
        """All rows of this class."""
        experiment = self._experiment
        train, labelling = self._label("train", experiment.train)
        calibration = (
            None
            if experiment.calibration is None
            else self._label("calibration", experiment.calibration)[0]
        )
        test, _ = self._label("test", experiment.test)
        scenes = scenes_of(test)
        scores: list[Score] = []
        learned: dict[str, Learned] = {}
        fresh: list[str] = []
        for method in experiment.methods:
            row, learned[method] = self._learned(method, train, calibration)
            score = self._score(method, row, learned[method], scenes, test)
            fresh += [] if score.notes["kept"] else [method]
            scores.append(score)
        scores.append(self._lift(scenes, test))
        fresh += [] if scores[-1].notes["kept"] else ["lift"]
        plain = tuple(
            replace(s, notes={k: v for k, v in s.notes.items() if k != "kept"}) for s in scores
        )
        return ClassResult(
            problem_class=test.problem_class,
            labelling=labelling,
            scores=plain,
            learned=learned,
            test=test,
            fresh=tuple(fresh),
        )

    def _label(self, part: str, quota: Quota) -> tuple[Dataset, Mapping[str, Any]]:
        plan = LabelPlan(
            distribution=self._name,
            robot=self._experiment.robot,
            terrain=self._experiment.terrain,
            shard_size=_SHARD_SIZE,
            **asdict(quota),
        )
        bar = self._told(f"label {part}")
        summary = label(
            plan,
            self._folder / part,
            run=self._run,
            progress=lambda state: bar(state.rows, plan.rows),
        )
        return Dataset.open(self._folder / part), summary.to_json()

    def _learned(
        self, method: str, train: Dataset, calibration: Dataset | None
    ) -> tuple[_Row, Learned]:
        """The selector that is there, or a new one; and its row as far as it is known."""
        digests = [
            train.header.digest,
            "" if calibration is None else calibration.header.digest,
            *([code] if (code := code_of(method)) else []),
        ]
        key = _digest(["fit", method, self._experiment.fit.concerning(method), digests, software()])
        row = self._read(method)
        if row is not None and row.fit_key == key and (self._folder / row.file).is_file():
            path = self._folder / row.file
            if hashlib.sha256(path.read_bytes()).hexdigest() == row.file_sha256:
                return row, load_selector(path)
        begin, checkpoint = perf_counter(), self._folder / f"{_stem(method)}.checkpoint-{key[:12]}"
        bar = self._told(f"fit {method}")
        settings = self._experiment.fit
        learned = learn_selector(
            method,
            train,
            settings,
            bar,
            calibration=calibration,
            checkpoint=checkpoint,
            run=self._run,
        )
        if code_of(method) and not isinstance(learned.selector, FixedSelector):
            blank = _Row(fit_key=key, file="", file_sha256="", fit_seconds=perf_counter() - begin)
            return (
                blank,
                learned,
            )  # no format of ours: judged as it is, and learned again by the next run
        path = self._folder / f"{_stem(method)}{learned.suffix}"
        learned.write(path)
        row = _Row(
            fit_key=key,
            file=path.name,
            file_sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
            fit_seconds=perf_counter() - begin,
        )
        self._write(method, row)
        return row, load_selector(path)

    def _score(
        self, method: str, row: _Row, learned: Learned, scenes: list[LabelledScene], test: Dataset
    ) -> Score:
        key = self._row_key(row.file_sha256 or row.fit_key, test)
        notes = {"fit_seconds": row.fit_seconds, "file": row.file}
        if row.row_key == key and row.score is not None:
            return replace(row.score, notes={**notes, "kept": True})
        score = evaluate(
            method,
            learned,
            scenes,
            problem_class=test.problem_class,
            projections=self._experiment.projections,
            progress=self._told(f"evaluate {method}"),
            run=self._run,
        )
        self._write(method, row.model_copy(update={"row_key": key, "score": score}))
        return replace(score, notes={**notes, "kept": False})

    def _lift(self, scenes: list[LabelledScene], test: Dataset) -> Score:
        key = self._row_key("lift", test)
        row = self._read("lift")
        if row is not None and row.row_key == key and row.score is not None:
            return replace(row.score, notes={"kept": True})
        projections = self._experiment.projections
        score = evaluate_lift(
            scenes, projections=projections, progress=self._told("evaluate lift"), run=self._run
        )
        row = _Row(fit_key="", file="", file_sha256="", fit_seconds=0.0, row_key=key, score=score)
        self._write("lift", row)
        return replace(score, notes={"kept": False})

    def _row_key(self, selector: str, test: Dataset) -> str:
        return _digest(
            [
                "row",
                selector,
                test.header.digest,
                list(self._experiment.projections),
                software(),
                *([code] if (code := code_of(*self._experiment.projections)) else []),
            ]
        )

    def _read(self, name: str) -> _Row | None:
        """A row that an earlier run kept; None where there is none that can be used."""
        try:
            return _Row.model_validate_json((self._folder / f"{_stem(name)}.row.json").read_bytes())
        except (OSError, ValidationError):
            return None

    def _write(self, name: str, row: _Row) -> None:
        write_text(self._folder / f"{_stem(name)}.row.json", row.model_dump_json(indent=1) + "\n")


def _stem(method: str) -> str:
    """The method's name as that of a file."""
    return re.sub(r"[^\w-]+", "-", method.replace(".py:", "-"))


def _digest(parts: list[Any]) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
