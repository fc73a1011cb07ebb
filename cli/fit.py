"""``stancekit fit``: learn a selector from a data set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from stancekit.planners.errors import InvalidInput

from .console import as_options, emit, out, progress
from .names import ROBOT, TERRAIN, named
from .options import OptionalPath, OptionalText

if TYPE_CHECKING:
    from stancekit.learners.data.executor import Executor
    from stancekit.learners.training.fit_settings import FitSettings
    from stancekit.planners.relaxation.envelope import EnvelopeSet


@dataclass
class Fit:
    """Learn a selector of envelopes from a labelled data set and write it to a file.

    heuristic: the expert's bounds of paper E. quantile: the box that leaves a share of the solutions out on each side.
    gmm-printed: paper E's Algorithm 2 line by line. gmm: Algorithm 2 with its boundary fitted by P1's own margins.
    ga: paper E's genetic algorithm. gradient: boxes that descend P1's margins together. chooser: those, and a network
    that picks one a terrain. neural: a network from terrain to box. joint: one to box and point, for P1 joined with
    the lift. rl: a policy learned in the environment. modes: a box a terrain, forces in world axes, between which
    `stancekit plan --envelope` switches.
    """

    dataset: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER [FOLDER …]")]
    """Data set folder of `stancekit label`; for modes one a terrain, in the order in which z counts them."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """File to write: JSON for envelopes, safetensors for what has a network."""
    part: Literal["all", "train", "test"] = "all"
    """Of the rows: all, or a part of the split by hash; what is fitted to "train" can be evaluated on "test"."""
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
    """Envelopes of gradient and chooser."""
    threshold: float = 0.05
    """Least membership probability of a kept solution (p_th of Algorithm 2)."""
    steps: int = 80
    """Steps of the margin descent: more is better and slower."""
    time_limit_s: float = 12.0
    """Limit of the printed boundary program, a cluster [s]."""
    seed: int = 0
    """Seed of mixture and descent."""
    config: OptionalPath = None
    """YAML file with the settings of ga, neural, chooser and rl, each under its name (ga: genetic)."""
    calibration: OptionalPath = None
    """Data set folder to calibrate a neural selector on; without it a part of the data set is kept for that."""
    checkpoint: OptionalPath = None
    """File (rl: folder) by which ga, neural and rl go on where they were stopped."""
    workers: int = 1
    """Processes of ga, which tests a generation on all of them; the result does not depend on them."""
    executor: Literal["processes", "ray"] = "processes"
    """Where ga tests a generation: on this machine, or on a Ray cluster."""
    address: OptionalText = None
    """Ray cluster: host:port of its head, auto, or local."""
    json: bool = False
    """Print the result as one JSON object."""

    def run(self) -> int:
        """Fit and write."""
        from stancekit.envs.data.dataset import Dataset
        from stancekit.learners.data.origin import check_of
        from stancekit.learners.selectors.selector import FixedSelector
        from stancekit.learners.training.fitting import learn
        from stancekit.planners.files.writing import check_writable
        from stancekit.planners.formats.answer_file import write_boxes
        from stancekit.planners.relaxation.modes import Modes

        check_writable(self.out)
        if not self.dataset:
            raise InvalidInput("FOLDER: expected a data set folder, got none")
        datasets = [Dataset.open(folder).only(self.part) for folder in self.dataset]
        for dataset in datasets:
            check_of(dataset, self.robot, self.terrain)
        held = None if self.calibration is None else Dataset.open(self.calibration)
        settings, run = self._settings(), self._executor()
        with progress(f"fit {self.method}") as bar:
            learned = learn(self.method, datasets, settings, bar, calibration=held, checkpoint=self.checkpoint, run=run)
        if isinstance(learned, Modes):
            write_boxes(self.out, learned)
            return self._said(learned.boxes.problem_class, "modes", learned.boxes)
        learned.write(self.out)
        fixed = learned.selector.envelopes if isinstance(learned.selector, FixedSelector) else None
        return self._said(learned.problem_class, "envelopes", fixed)

    def _said(self, problem_class: str, what: str, fitted: EnvelopeSet | None) -> int:
        """Say what was written: boxes, or a network."""
        record: dict[str, Any] = {"out": str(self.out), "method": self.method, "problem_class": problem_class}
        line = f"{self.out}: a network for {problem_class}"
        if fitted is not None:
            widths = [float((envelope.high - envelope.low).mean()) for envelope in fitted.envelopes]
            record |= {what: len(widths), "mean_width": widths, "provenance": dict(fitted.provenance)}
            shown = ", ".join(f"{width:.3f}" for width in widths)
            line = f"{self.out}: {len(widths)} {what[:-1]}(s) for {problem_class}, mean width {shown}"
        if self.json:
            emit(record)
        else:
            out.print(line)
        return 0

    def _executor(self) -> Executor:
        """Where generations run. Raises InvalidInput, also where the method has none."""
        from stancekit.learners.data.executors import executor
        from stancekit.learners.training.fit_settings import SPREAD

        given = {"workers": self.workers != 1, "executor": self.executor != "processes", "address": self.address}
        for name, wanted in given.items():
            if wanted and self.method not in SPREAD:
                raise InvalidInput(f"--{name}: expected with --method {' or '.join(SPREAD)}, got {self.method}")
        with as_options():
            return executor(self.executor, workers=self.workers, address=self.address)

    def _settings(self) -> FitSettings:
        """The options and what the configuration file adds. Raises InvalidInput."""
        from stancekit.learners.training.fit_settings import FitSettings
        from stancekit.planners.files.arrays import checked_int
        from stancekit.planners.files.documents import read_yaml
        from stancekit.planners.files.validation import typed

        checked_int(self.seed, "--seed", least=0)
        if not 0.0 <= self.threshold < 1.0:
            raise InvalidInput(f"--threshold: expected a number in [0, 1), got {self.threshold:g}")
        if not self.time_limit_s > 0.0:
            raise InvalidInput(f"--time-limit-s: expected a number above 0, got {self.time_limit_s:g}")
        own = ("share", "clusters", "threshold", "boxes", "steps", "time_limit_s", "seed")
        given = {name: getattr(self, name) for name in own}
        extra = {} if self.config is None else read_yaml(self.config)
        for name in extra:
            if name in own:
                raise InvalidInput(f"{self.config}: {name}: expected as an option, --{name.replace('_', '-')}")
        with as_options():
            FitSettings(**given).check_used(self.method)  # what is wrong with the options is not the file's fault
        try:
            settings = typed(FitSettings, {**given, **extra}, "")
            settings.check(self.method)
        except InvalidInput as error:
            raise InvalidInput(f"{self.config or '--config'}: {error}") from None
        return settings
