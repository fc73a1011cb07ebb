"""Base of the single selection environment and of the batched one: spaces, scenes, and the judging
of one action.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.features import ROOM
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked_int
from stancekit.planners.files.validation import shown
from stancekit.planners.formats.answer_file import read_envelopes
from stancekit.planners.projection.project import PROJECTIONS, Projection, project
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.relaxed import RelaxationAnswer
from stancekit.planners.relaxation.table import RELAXATIONS
from stancekit.planners.search.answer import plan_of
from stancekit.planners.verify import check_postures

from .margins import margin_info
from .reward import USUAL, Judged, RewardWeights, Term, weighted
from .scene_sources import ProblemSource, SceneSettings
from .scenes import LabelledScene

VERTICES = 3
"""Corners of the patches that the environment's observation holds."""
ADMITTED = 1e-6
"""A projection counts when the verifier finds no violation above this (non-dimensional)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """Verdict on one action on one scene.

    Arguments:
        posture: the answer of P2, or None.
        envelope: the box of P1.
    """

    reward: float
    info: dict[str, Any]
    posture: Plan | None
    envelope: Envelope


_Projected = tuple[Judged, float]
"""An action with the postures that its projections end in, and the time that they took [s]."""
Asked = tuple[tuple[Envelope, ...], Array | None]
"""Boxes, and for relaxations about a point that of the one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SelectionSettings(SceneSettings):
    """Keywords of the environments beside their problem; the page of ``EnvelopeSelectionEnv`` has
    their meaning.

    Raises InvalidInput for what does not go together.
    """

    boxes: int = 1
    library: EnvelopeSet | str | Path | None = None
    relaxation: str = "p1"
    projections: Sequence[Projection] = ("fix-p",)
    weights: RewardWeights | Mapping[str, float] = USUAL
    timing: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.projections:
            raise InvalidInput("projections: expected one or more, got none")
        for name in self.projections:
            PROJECTIONS.get(name)
        checked_int(self.boxes, "boxes", least=1)
        relaxation = RELAXATIONS.get(self.relaxation)
        if not relaxation.over_boxes:
            raise InvalidInput(
                "relaxation: expected one over boxes, which an action chooses, got "
                f"{self.relaxation}"
            )
        if relaxation.about_points and (self.boxes, self.library) != (1, None):
            got = f"{self.boxes} boxes and {'no' if self.library is None else 'a'} library"
            raise InvalidInput(
                f"relaxation: expected {self.relaxation} over one box without a library, got it "
                f"with {got}"
            )

    @property
    def rewards(self) -> dict[str, tuple[float, Term]]:
        """Weight and function of every term of the reward, see ``weighted``.

        Raises InvalidInput.
        """
        return weighted(self.weights)


class SelectionTask:
    """Base of the single environment and of the batched one: spaces, scenes, and the judging of one
    action.

    The problem is that of ``EnvelopeSelectionEnv``. Compiled models are made once a task.
    """

    def __init__(self, problem: ProblemSource, settings: SelectionSettings) -> None:
        chosen = settings.kind(problem)
        library = settings.library
        self._problem = chosen.name
        self._count = len(chosen.legs)
        self._boxes = settings.boxes
        self._library = read_envelopes(library) if isinstance(library, str | Path) else library
        self._relaxation = RELAXATIONS.get(settings.relaxation)
        self._projections = tuple(settings.projections)
        self._keys = {way: f"project_{way.replace('-', '_')}" for way in self._projections}
        self._unmeasured = margin_info(None) | margin_info(None, "expert_")
        self._nothing: dict[str, Any] = {
            "label": 0,
            "p1_feasible": 0,
            "p1_right": 0,
            "is_success": 0,
            "margin": 0.0,
            "gap": 0.0,
            "log_volume": 0.0,
            "chosen": 0,
            **dict.fromkeys(self._keys.values(), 0),
            **dict.fromkeys(settings.rewards, 0.0),
            **self._unmeasured,
            "expert_point": None,
            "expert_lower_bound": 0.0,
            "p1_seconds": 0.0,
            "p2_seconds": 0.0,
            "expert_seconds": 0.0,
        }
        self._terms = settings.rewards
        self._timing, self._margins = bool(settings.timing), bool(settings.margins)
        self._programs = Programs()
        self.scenes = settings.source(chosen, self._programs)
        self.observation_space = scene_space(self._count)
        self.action_space = self._make_action_space()

    def _make_action_space(self) -> spaces.Space[Any]:
        if self._library is None:
            each = 18 if self._relaxation.about_points else 12
            return spaces.Box(-1.0, 1.0, (self._boxes * each * self._count,), np.float32)
        if self._library.problem_class != self._problem or len(self._library.legs) != self._count:
            learned = f"{self._library.problem_class} and the legs {', '.join(self._library.legs)}"
            raise InvalidInput(
                f"library: expected envelopes learned for {self._problem}, got some for {learned}"
            )
        if self._boxes != 1:
            raise InvalidInput(
                "boxes: expected 1 with a library, whose envelopes are chosen one by one, got "
                f"{self._boxes}"
            )
        return spaces.Discrete(len(self._library.envelopes))

    def check(self, scene: LabelledScene) -> None:
        """Raise InvalidInput where a scene does not fit the observation."""
        size = scene.scaled.size
        if size != (self._count, VERTICES):
            raise InvalidInput(
                f"scene: expected {self._count} contacts on triangles, got {size[0]} contacts on "
                "patches "
                f"of up to {size[1]} corners"
            )

    def judge(self, scene: LabelledScene, action: NDArray[np.float32] | np.int64) -> Verdict:
        """Relax over the chosen boxes, project, compare with the expert."""
        return self.judge_all((scene,), (action,))[0]

    def judge_all(
        self, scenes: Sequence[LabelledScene], actions: Sequence[Any] | NDArray[Any]
    ) -> list[Verdict]:
        """``judge`` of an action a scene, the postures of all verified together: every bit is that
        of one by one.
        """
        choices = [self._envelopes(action) for action in actions]
        begin = time.perf_counter()
        answers = self._relax([scene.scaled for scene in scenes], choices)
        each = (time.perf_counter() - begin) / max(len(choices), 1)
        tried = [
            self._project(scene, answer, envelopes)
            for scene, answer, (envelopes, _) in zip(scenes, answers, choices, strict=True)
        ]
        verified, p2_seconds = self._verified(tried)
        return [
            self._verdict(judged, each, seconds)
            for judged, seconds in zip(verified, p2_seconds, strict=True)
        ]

    def _verified(self, tried: Sequence[_Projected]) -> tuple[list[Judged], list[float]]:
        """The actions with those postures alone that the verifier accepts, and the time that each
        action took to project and to verify.
        """
        begin = time.perf_counter()
        postures = [posture for judged, _ in tried for posture in judged.postures.values()]
        worst = iter(check_postures(postures).tolist() if postures else ())
        verified = [
            replace(
                judged,
                postures={
                    way: posture
                    for way, posture in judged.postures.items()
                    if not next(worst) > ADMITTED
                },
            )
            for judged, _ in tried
        ]
        share = (time.perf_counter() - begin) / max(len(postures), 1)
        return verified, [seconds + share * bool(judged.postures) for judged, seconds in tried]

    def _relax(self, scaled: Sequence[Scaled], asked: Sequence[Asked]) -> list[RelaxationAnswer]:
        """P1 of every problem over the boxes of its action; problems of one layout are asked about
        together.
        """
        result = dict[int, RelaxationAnswer]()
        for layout in dict.fromkeys(one.layout for one in scaled):
            these = [index for index, one in enumerate(scaled) if one.layout == layout]
            problems, boxes = (
                [scaled[index] for index in these],
                [asked[index][0] for index in these],
            )
            points = [point for index in these if (point := asked[index][1]) is not None]
            answers = self._relaxation.answers(self._programs, problems, boxes, points)
            result |= zip(these, answers, strict=True)
        return [result[index] for index in range(len(scaled))]

    def _project(
        self, scene: LabelledScene, answer: RelaxationAnswer, envelopes: Sequence[Envelope]
    ) -> _Projected:
        """From the point of P1 every projection."""
        begin = time.perf_counter()
        postures: dict[Projection, Plan] = {}
        if answer.feasible and answer.point is not None:
            points = {
                way: project(self._programs, way, scene.scaled, answer.point)
                for way in self._projections
            }
            postures = {
                way: plan_of(scene.problem, scene.scaled, scene.scaled.numbers, at)
                for way, at in points.items()
                if np.isfinite(at.residual)
            }
        judged = Judged(
            scene=scene,
            answer=answer,
            envelope=envelopes[answer.chosen],
            projections=self._projections,
            postures=postures,
        )
        return judged, time.perf_counter() - begin

    def _envelopes(self, action: NDArray[np.float32] | np.int64) -> Asked:
        """The boxes of an action, and for relaxations about a point that of the one."""
        if np.shape(action) != self.action_space.shape:
            raise InvalidInput(
                f"action: expected shape {self.action_space.shape}, got {np.shape(action)}"
            )
        if self._library is not None:
            if not self.action_space.contains(np.int64(action)):
                raise InvalidInput(
                    f"action: expected 0 to {len(self._library.envelopes) - 1}, got {action}"
                )
            return (self._library.envelopes[int(action)],), None
        flat = _numbers(action)
        if self._relaxation.about_points:
            bounds, point = np.split(flat, [12 * self._count])
            return (Envelope.from_vector(bounds),), point.reshape(-1, 6)
        return tuple(Envelope.from_vector(row) for row in flat.reshape(self._boxes, -1)), None

    def _verdict(self, judged: Judged, p1_seconds: float, p2_seconds: float) -> Verdict:
        """Verdict on an action whose postures the verifier accepted."""
        scene, answer, envelope = judged.scene, judged.answer, judged.envelope
        terms = {key: weight * float(term(judged)) for key, (weight, term) in self._terms.items()}
        clock = self._timing
        info = {
            "label": int(scene.feasible),
            "p1_feasible": int(answer.feasible),
            "p1_right": int(judged.right),
            "is_success": int(judged.right and (judged.reached or not scene.feasible)),
            "margin": float(answer.margin),
            "gap": 0.0 if math.isnan(gap := answer.gap) else gap,
            "log_volume": envelope.log_volume(),
            "chosen": int(answer.chosen),
            **{self._keys[way]: int(way in judged.postures) for way in self._projections},
            **terms,
            **self._margins_of(scene, judged.posture),
            "expert_point": scene.point.copy(),
            "expert_lower_bound": float(scene.lower_bound),
            "p1_seconds": p1_seconds if clock else 0.0,
            "p2_seconds": p2_seconds if clock else 0.0,
            "expert_seconds": scene.expert_seconds if clock else 0.0,
        }
        return Verdict(
            reward=float(sum(terms.values())), info=info, posture=judged.posture, envelope=envelope
        )

    def before(self, scene: LabelledScene) -> dict[str, Any]:
        """The info of a scene before any action: what the expert knows, and 0 for all that an
        action comes to.
        """
        expert = scene.margins if self._margins else {}
        return {
            **self._nothing,
            **expert,
            "label": int(scene.feasible),
            "expert_point": scene.point.copy(),
            "expert_lower_bound": float(scene.lower_bound),
            "expert_seconds": scene.expert_seconds if self._timing else 0.0,
        }

    def _margins_of(self, scene: LabelledScene, posture: Plan | None) -> dict[str, float]:
        """The margins of a posture that was found and of the expert's, where they are asked for."""
        return margin_info(posture) | scene.margins if self._margins else self._unmeasured


def _numbers(action: Any) -> Array:
    """The numbers of an action.

    Raises InvalidInput for what is none, or not finite.
    """
    flat = np.asarray(action)
    if flat.dtype.kind not in "fiu" or not np.isfinite(flat).all():
        raise InvalidInput(f"action: expected finite numbers, got {shown(action)}")
    return flat.astype(np.float64)


def scene_space(count: int) -> spaces.Dict:
    """The space of ``observe`` for this many contacts."""

    def box(low: float, high: float, size: int) -> spaces.Box:
        return spaces.Box(low, high, (size,), np.float32)

    return spaces.Dict(
        {
            "vertices": box(-ROOM, ROOM, count * VERTICES * 3),
            "frames": box(-1.0, 1.0, count * 9),
            "friction": box(0.0, ROOM, count),
            "shoulders": box(-ROOM, ROOM, count * 3),
            "reach": box(0.0, ROOM, count),
        }
    )
