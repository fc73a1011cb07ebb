"""``stancekit fit``: learn a selector from a data set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from stancekit.planners.errors import InvalidInput

from .console import as_options, emit, out, progress, tell
from .options import ROBOT, TERRAIN, OptionalPath, OptionalText, check_out, named

if TYPE_CHECKING:
    from stancekit import Dataset, EnvelopeSet
    from stancekit.learners.data.executors import Executor

_LEAP_SCORES = ("additive", "set")
"""Methods that learn from tries of leaps."""
_SURROGATE = "surrogate"
"""The method that learns feasibility itself."""
_SETTINGS = ("share", "clusters", "threshold", "boxes", "steps", "time_limit_s", "seed")
"""Settings of methods that are options here."""


@dataclass
class Fit:
    """Learn a selector of envelopes from a labelled data set and write it to a file.

    METHOD is one of

      heuristic      the expert's bounds of Lin et al.
      quantile       the box that leaves a share of the solutions out on each side
      gmm-printed    Lin et al.'s Algorithm 2 line by line
      gmm            Algorithm 2 with its boundary fitted by P1's own margins
      ga             Lin et al.'s genetic algorithm
      gradient       boxes that descend P1's margins together
      neural         a network from terrain to box
      joint          one to box and point, for P1 joined with the lift
      rl             a policy learned in the environment
      modes          a box a terrain, between which `stancekit plan --envelopes` switches
      surrogate      feasibility itself, for `stancekit map`, `label --screen` and `screen`
      additive, set  scores of candidates for `stancekit plan --policy`, of leaps' labelled tries
    """

    dataset: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER [FOLDER …]")
    ]
    """Data set folder of `stancekit label`; for modes one a terrain, in the order in which z counts
    them; for surrogate one or more of one class."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """File to write: JSON for envelopes, safetensors for what has a network."""
    part: Literal["all", "train", "test", "calibration"] = "all"
    """Part of the rows: all, or a part of the split by hash; what is fitted to "train" can be
    evaluated on "test"."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot that the data set must be of; one of another is refused."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Terrain's file that the data set must be of."""
    method: Annotated[str, named("stancekit.learners.training.fitting:METHODS")] = "gmm"
    """How to learn."""
    share: float = 0.05
    """Share of the solutions outside a quantile box, on each side of each dimension."""
    clusters: int = 1
    """Envelopes to learn (n of Algorithm 2)."""
    boxes: int = 1
    """Envelopes of gradient."""
    threshold: float = 0.05
    """Least membership probability of a kept solution (p_th of Algorithm 2)."""
    steps: int = 80
    """Steps of the margin descent: more is better and slower."""
    time_limit_s: float = 12.0
    """Limit of the printed boundary program, a cluster [s]."""
    seed: int = 0
    """Seed of mixture and descent."""
    config: OptionalPath = None
    """YAML file with the settings of ga, neural and rl, each under its name (ga: genetic),
    or with those of surrogate, additive and set."""
    calibration: OptionalPath = None
    """Data set folder to calibrate a neural selector on; without it a part of the data set is kept
    for that. Of surrogate: further rows to calibrate on."""
    checkpoint: OptionalPath = None
    """File (rl: folder) by which a method that takes long goes on where it was stopped."""
    workers: int = 1
    """Processes of ga, which tests a generation on all of them; the result does not depend on
    them."""
    executor: Literal["processes", "ray"] = "processes"
    """Where ga tests a generation: on this machine, or on a Ray cluster."""
    address: OptionalText = None
    """Ray cluster: host:port of its head, auto, or local."""
    json: bool = False
    """Print the result as one JSON object."""

    def run(self) -> int:
        """Fit and write."""
        from stancekit import Modes
        from stancekit.selectors import fit, rows_of

        check_out(self.out)
        if not self.dataset:
            raise InvalidInput("FOLDER: expected a data set folder, got none")
        if self.method in _LEAP_SCORES:
            return self._scores()
        rows = [rows_of(folder, self.part, self.robot, self.terrain) for folder in self.dataset]
        if self.method == _SURROGATE:
            return self._surrogate(rows)
        settings, workers = self._settings(), self._executor()
        with progress(f"fit {self.method}") as bar:
            learned = fit(
                rows,
                self.method,
                calibration=self.calibration,
                checkpoint=self.checkpoint,
                workers=workers,
                progress=bar,
                **settings,
            )
        if isinstance(learned, Modes):
            from stancekit import save

            save(learned, self.out)
            return self._said(learned.boxes.problem_class, "modes", learned.boxes)
        learned.write(self.out)
        try:
            fixed = learned.envelopes
        except InvalidInput:  # a network chooses them by the scene
            fixed = None
        return self._said(learned.problem_class, "envelopes", fixed)

    def _scores(self) -> int:
        """Fit the scores of leaps' candidates and write them."""
        from stancekit import fit
        from stancekit.planners.files.documents import read_yaml

        if len(self.dataset) > 1:
            raise InvalidInput(
                f"FOLDER: expected one folder of tries with {self.method}, got {len(self.dataset)}"
            )
        settings = {
            "seed": self.seed,
            "part": self.part,
            **({} if self.config is None else read_yaml(self.config)),
        }
        with progress(f"fit {self.method}") as bar:
            scorer: Any = fit(
                self.dataset[0],
                self.method,
                checkpoint=self.checkpoint,
                progress=bar,
                **settings,
            )
        scorer.write(self.out)
        origin = scorer.origin
        tell(
            self.json,
            {"out": str(self.out), "method": self.method, "origin": origin},
            f"{self.out}: scores for {origin['class']} from {origin['rows']} tries",
        )
        return 0

    def _surrogate(self, rows: list[Dataset]) -> int:
        """Fit a surrogate of feasibility and write it."""
        from stancekit import fit
        from stancekit.planners.files.documents import read_yaml

        settings = {"seed": self.seed, **({} if self.config is None else read_yaml(self.config))}
        with progress(f"fit {self.method}") as bar:
            surrogate = fit(
                rows,
                "surrogate",
                calibration=self.calibration,
                checkpoint=self.checkpoint,
                progress=bar,
                **settings,
            )
        surrogate.save(self.out)
        card = surrogate.provenance
        if self.json:
            emit(
                {
                    "out": str(self.out),
                    "method": self.method,
                    "problem_class": surrogate.problem_class,
                    "least_error": surrogate.least_error,
                    "card": card,
                }
            )
            return 0
        counts = [
            ", ".join(f"{count} {kind}" for kind, count in card[name].items() if count)
            for name in ("learned_from", "calibrated_on")
        ]
        out.print(f"{self.out}: a surrogate for {surrogate.problem_class}, from {counts[0]} rows")
        out.print(
            f"  calibrated on {counts[1]} others: errors of {100 * surrogate.least_error:.2g} % "
            "and more can be "
            "stated of one answer at least",
            highlight=False,
        )
        return 0

    def _said(self, problem_class: str, what: str, fitted: EnvelopeSet | None) -> int:
        """Say what was written: boxes, or a network."""
        record: dict[str, Any] = {
            "out": str(self.out),
            "method": self.method,
            "problem_class": problem_class,
        }
        line = f"{self.out}: a network for {problem_class}"
        if fitted is not None:
            widths = [float((envelope.high - envelope.low).mean()) for envelope in fitted.envelopes]
            record |= {
                what: len(widths),
                "mean_width": widths,
                "provenance": dict(fitted.provenance),
            }
            shown = ", ".join(f"{width:.3f}" for width in widths)
            line = (
                f"{self.out}: {len(widths)} {what[:-1]}(s) for {problem_class}, mean width {shown}"
            )
        tell(self.json, record, line)
        return 0

    def _executor(self) -> Executor | int:
        """Executor in which generations run; 1 where the method has none.

        Raises InvalidInput for another wish there.
        """
        from stancekit.selectors import SPREAD, executor

        options = {
            "workers": self.workers != 1,
            "executor": self.executor != "processes",
            "address": self.address,
        }
        for name, wanted in options.items():
            if wanted and self.method not in SPREAD:
                raise InvalidInput(
                    f"--{name}: expected with --method {' or '.join(SPREAD)}, got {self.method}"
                )
        if self.method not in SPREAD:
            return 1
        with as_options():
            return executor(self.executor, workers=self.workers, address=self.address)

    def _settings(self) -> dict[str, Any]:
        """The options and what the configuration file adds.

        Raises InvalidInput.
        """
        from stancekit.planners.files.arrays import checked_int
        from stancekit.selectors import settings_of

        checked_int(self.seed, "--seed", least=0)
        if not 0.0 <= self.threshold < 1.0:
            raise InvalidInput(f"--threshold: expected a number in [0, 1), got {self.threshold:g}")
        if not self.time_limit_s > 0.0:
            raise InvalidInput(
                f"--time-limit-s: expected a number above 0, got {self.time_limit_s:g}"
            )
        with as_options(*_SETTINGS):
            return settings_of(
                self.method, {name: getattr(self, name) for name in _SETTINGS}, self.config
            )
