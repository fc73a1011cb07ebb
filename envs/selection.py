"""``stancekit/EnvelopeSelection-v0``: choose envelopes for one posture problem; the planner stack
judges.
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import settings_from
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import ROOM, Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked_int
from stancekit.planners.formats.question_file import read_envelopes
from stancekit.planners.projection.project import PROJECTIONS, Projection, project
from stancekit.planners.relaxation.envelope import (
    RELAXATIONS,
    Envelope,
    EnvelopeSet,
    RelaxationAnswer,
    expert_envelopes,
)
from stancekit.planners.search.answer import plan_of
from stancekit.planners.verify import check_postures
from stancekit.runner.control.envelope_choice import Predictor

from .distributions.postures import PostureDistribution, distribution
from .episodes import (
    USUAL,
    Judged,
    RewardWeights,
    Step,
    TaskEnv,
    boxes,
    checked_action,
    weighted,
)
from .scenes import LabelledScene, ProblemSource, SceneSettings, margin_info, seen

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VERTICES = 3
"""Corners of the patches that the environment's observation holds."""
ADMITTED = 1e-6
"""A projection counts when the verifier finds no violation above this (non-dimensional)."""
_IN_VAIN = 1e3 * ADMITTED
"""A moment that is proved to be left, or that a projection itself says it leaves, and that needs no
verifier to be refused."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Verdict:
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
_Asked = tuple[tuple[Envelope, ...], Array | None]
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


class SelectionTask:
    """Base of the single environment and of the batched one: spaces, scenes, and the judging of one
    action.

    The problem is that of ``EnvelopeSelectionEnv``. Compiled models are made once a task.
    """

    def __init__(self, problem: ProblemSource, settings: SelectionSettings) -> None:
        self.law = chosen = settings.kind(problem)
        library = settings.library
        self._problem = chosen.name
        self._count = len(chosen.legs)
        self._boxes = settings.boxes
        self._library = read_envelopes(library) if isinstance(library, str | Path) else library
        self._relaxation = RELAXATIONS.get(settings.relaxation)
        self._projections = tuple(settings.projections)
        self._keys = {way: f"project_{way.replace('-', '_')}" for way in self._projections}
        self._terms = weighted(settings.weights, RewardWeights, named=True)[1]
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
            **self._terms.nothing,
            **margin_info(None),
            **margin_info(None, "expert_"),
            "expert_point": None,
            "expert_lower_bound": 0.0,
            "p1_seconds": 0.0,
            "p2_seconds": 0.0,
            "expert_seconds": 0.0,
        }
        self._timing, self._margins = bool(settings.timing), bool(settings.margins)
        self._programs = Programs()
        self.scenes = settings.source(chosen, self._programs)
        self.observation_space = scene_space(self._count)
        self.action_space = self._make_action_space()
        if len(self._terms.by_key) > len(RewardWeights.__dataclass_fields__):
            scene = copy.copy(self.scenes).draw(np.random.default_rng(0))
            self.judge_all((scene,), (self._widest(),))  # which a user's term may not bear

    def _widest(self) -> Any:
        """An action: the first box of a library, or boxes as wide as the domain."""
        if self._library is not None:
            return np.int64(0)
        size = 6 * self._count
        box = np.repeat(np.array([-1.0, 1.0], dtype=np.float32), size)
        if self._relaxation.about_points:
            return np.concatenate([box, np.zeros(size, dtype=np.float32)])
        return np.tile(box, self._boxes)

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

    def judge_all(self, scenes: Sequence[LabelledScene], actions: Sequence[Any]) -> list[_Verdict]:
        """Relax over the boxes of an action a scene, project, compare with the expert, the postures
        of all verified together: every bit is that of one by one.
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
            if judged.postures
            else judged
            for judged, _ in tried
        ]
        share = (time.perf_counter() - begin) / max(len(postures), 1)
        return verified, [seconds + share * bool(judged.postures) for judged, seconds in tried]

    def _relax(self, scaled: Sequence[Scaled], asked: Sequence[_Asked]) -> list[RelaxationAnswer]:
        """P1 of every problem over the boxes of its action; problems of one layout are asked about
        together.
        """
        result = dict[int, RelaxationAnswer]()
        for layout in dict.fromkeys(one.layout for one in scaled):
            these = [index for index, one in enumerate(scaled) if one.layout == layout]
            answers = self._relaxation.answers(
                self._programs,
                [scaled[index] for index in these],
                [asked[index][0] for index in these],
                [point for index in these if (point := asked[index][1]) is not None],
            )
            result |= zip(these, answers, strict=True)
        return [result[index] for index in range(len(scaled))]

    def _project(
        self, scene: LabelledScene, answer: RelaxationAnswer, envelopes: Sequence[Envelope]
    ) -> _Projected:
        """From the point of P1 every projection; none of a scene that is proved to have no posture."""
        begin = time.perf_counter()
        postures: dict[Projection, Plan] = {}
        if answer.feasible and scene.lower_bound < _IN_VAIN and answer.point is not None:
            for way in self._projections:
                at = project(self._programs, way, scene.scaled, answer.point)
                if at.residual < _IN_VAIN:
                    postures[way] = plan_of(scene.problem, scene.scaled, scene.scaled.numbers, at)
        judged = Judged(
            scene=scene,
            answer=answer,
            envelope=envelopes[answer.chosen],
            projections=self._projections,
            postures=postures,
        )
        return judged, time.perf_counter() - begin

    def _envelopes(self, action: NDArray[Any]) -> _Asked:
        """The boxes of an action, and for relaxations about a point that of the one."""
        if self._library is not None:
            return (self._library.envelopes[int(action)],), None
        if self._relaxation.about_points:
            bounds, point = np.split(action, [12 * self._count])
            return (Envelope.from_vector(bounds),), point.reshape(-1, 6)
        return tuple(Envelope.from_vector(row) for row in action.reshape(self._boxes, -1)), None

    def _verdict(self, judged: Judged, p1_seconds: float, p2_seconds: float) -> _Verdict:
        """Verdict on an action whose postures the verifier accepted."""
        scene, answer, envelope = judged.scene, judged.answer, judged.envelope
        terms = self._terms.of(judged)
        info = {
            **self.before(scene),
            "p1_feasible": int(answer.feasible),
            "p1_right": int(judged.right),
            "is_success": int(judged.right and (judged.reached or not scene.feasible)),
            "margin": float(answer.margin),
            "gap": 0.0 if math.isnan(gap := answer.gap) else gap,
            "log_volume": envelope.log_volume(),
            "chosen": int(answer.chosen),
            **{self._keys[way]: int(way in judged.postures) for way in self._projections},
            **terms,
            **(margin_info(judged.posture) if self._margins else {}),
            "p1_seconds": p1_seconds if self._timing else 0.0,
            "p2_seconds": p2_seconds if self._timing else 0.0,
        }
        return _Verdict(
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


def scene_space(count: int) -> spaces.Dict:
    """The space of ``observe`` for this many contacts."""
    return boxes(
        {
            "vertices": (-ROOM, ROOM, count * VERTICES * 3),
            "frames": (-1.0, 1.0, count * 9),
            "friction": (0.0, ROOM, count),
            "shoulders": (-ROOM, ROOM, count * 3),
            "reach": (0.0, ROOM, count),
        }
    )


class LearnedSelector(Protocol):
    """A selector with its class of problems: what ``fit`` returns, and ``load`` reads."""

    @property
    def selector(self) -> Predictor:
        """Chooses boxes for an observation."""

    @property
    def problem_class(self) -> str:
        """Name of the distribution that it was learned for."""

    @property
    def relaxation(self) -> str:
        """The P1 that its boxes are for."""


def class_envelopes(learned: LearnedSelector) -> EnvelopeSet:
    """Envelopes of a selector's class of problems: its own, where it has some; else the expert's.

    Raises InvalidInput for a selector for another P1, and for a class that is neither of the ground
    nor of walls.
    """
    if learned.relaxation != "p1":
        raise InvalidInput(
            f"selector: expected one of boxes for P1 alone, got one for P1 {learned.relaxation}"
        )
    envelopes = getattr(learned.selector, "envelopes", None)
    if isinstance(envelopes, EnvelopeSet):
        return envelopes
    kind = distribution(learned.problem_class)
    if not isinstance(kind, PostureDistribution):
        got = learned.problem_class
        raise InvalidInput(f"problem class: expected one of the ground or of walls, got {got}")
    return expert_envelopes(kind.terrain, legs=kind.legs)


class EnvelopeSelectionEnv(TaskEnv[LabelledScene]):
    """Choose boxes for P1 in one scene; the reward compares P1 and P2 over them with the exact
    answer.

    ## Description

    One posture problem per episode (Lin et al. §III): can the robot hold still with N limbs on N
    patches? P1 relaxes the products m = p·f over a box of [p, f]. The agent chooses the box, and
    the planners evaluate it. All quantities are non-dimensional: lengths over the length scale,
    forces over the force scale.

    ## Observation Space

    A ``Dict`` of flat float32 ``Box``es, contact by contact:

    | name | shape | meaning |
    |---|---|---|
    | vertices | (9 * N,) | corners of the patches, world axes, three per patch |
    | frames | (9 * N,) | contact frames R_WC, columns n, y, z |
    | friction | (N,) | μ of the patches |
    | shoulders | (3 * N,) | shoulders v in the body frame |
    | reach | (N,) | Δ_FK of the limbs |

    ## Action Space

    ``Box(-1, 1, (boxes * 12 * N,), float32)``: of each box all lower and then all upper bounds,
    contact by contact the columns p_x p_y p_z f_n f_y f_z; a reversed pair is put in order. With
    ``relaxation="joint"`` 6N further numbers follow in the same columns: the point about which the
    gap of the lift (the relaxation without envelopes) is linearised. With ``library``:
    ``Discrete``, the index of one of its envelopes.

    ## Reward

    agreement · [P1 says what the expert says] + projection · [the first of ``projections`` reaches
    a verified posture] + tightness · (1 − mean width of the box / 2), with the weights of
    ``RewardWeights``.

    ## Starting State

    A scene of ``scenes``; without them one of ``problem``, labelled by the exact planner: half of
    them infeasible and none trivially so where ``balanced``, else as they come. ``scenes`` may be
    a ``Dataset`` with rows of ``problem``, or its folder: a pool, of which the part "train"
    (``Dataset.only``) is drawn from, or another, as FOLDER:test.

    ## Episode End

    Terminated after one step; never truncated.

    ## Info

    After a reset and a step (numeric, fixed shapes, the same keys): ``label``, ``p1_feasible``,
    ``p1_right`` (P1 says what the expert says), ``is_success`` (P1 is right and, where the expert
    has a posture, the first projection reaches one), ``margin``, ``gap``, ``log_volume``,
    ``chosen``, ``project_<way>`` for every projection asked for, ``reward_<term>``, the expert's
    ``expert_point`` (N, 6) (zeros where infeasible) and ``expert_lower_bound``, and ``p1_seconds``,
    ``p2_seconds``, ``expert_seconds``, which stay 0 unless ``timing``: a clock in ``info`` would
    make equal episodes differ. ``push_n`` (largest horizontal push at the body that is borne in
    every direction), ``support_m`` (distance from the centre of mass to the border of support) and
    ``friction_left`` (share of the friction that is not needed) are margins of the posture that was
    projected, ``expert_push_n``, ... of the expert's; they stay 0 unless ``margins``, and where
    there is no posture. After a reset all but the label and the expert's is 0.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | problem | 'wall-3' | a name (also ground-k, terrain-k), a YAML file, "FILE.py:NAME", what has ``sample`` |
    | robot | None | whose legs stand: a built-in name, a URDF, a YAML file; the default hexapod where None |
    | terrain | None | a mesh or grid that the scenes of ``terrain-k`` are cut from |
    | balanced | True | half of the scenes infeasible, none trivially |
    | scenes | None | a source that replaces ``problem``'s and ``balanced``, or a data set's folder, see above |
    | margins | False | measure the margins in ``info``, half a millisecond per posture with numba |
    | boxes | 1 | number of boxes in an action; P1 may use any one of them |
    | library | None | an ``EnvelopeSet``, or its file, to choose from |
    | relaxation | 'p1' | 'coned': with friction cones; 'joint': linked with the lift, over one box; "FILE.py:NAME" |
    | projections | ('fix-p',) | which P2 to run; the reward looks at the first |
    | weights | RewardWeights() | weights of the reward; or a mapping with some of its keys, and terms of your own |
    | timing | False | put seconds into ``info`` |
    | render_mode | None | "rgb_array" or "human" |

    ## Version History

    - v0: the first version
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 1}  # noqa: RUF012 — Gymnasium's own convention

    def __init__(
        self,
        problem: ProblemSource = "wall-3",
        *,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        super().__init__(render_mode)
        settings = settings_from(SelectionSettings, options, beside=("problem", "render_mode"))
        self._task = SelectionTask(problem, settings)
        self._law = self._task.law
        self._shown: tuple[Plan | None, Envelope | None] = (None, None)
        self.observation_space = self._task.observation_space
        self.action_space = self._task.action_space

    def _begin(self) -> tuple[LabelledScene, dict[str, Any]]:
        scene = self._task.scenes.draw(self.np_random)
        self._task.check(scene)
        self._shown = None, None
        return scene, self._task.before(scene)

    def _act(self, episode: LabelledScene, action: NDArray[np.float32] | np.int64) -> Step:
        """Relax over the chosen boxes, project, compare with the expert; the episode ends."""
        (verdict,) = self._task.judge_all((episode,), (checked_action(action, self.action_space),))
        self._shown = verdict.posture, verdict.envelope
        return Step(reward=verdict.reward, terminated=True, info=verdict.info, action=action)

    def _observe(self, episode: LabelledScene) -> dict[str, NDArray[np.float32]]:
        return seen(episode)

    def _drawn(self, episode: LabelledScene) -> Figure:
        return picture(episode, *self._shown)

    @property
    def scene(self) -> LabelledScene:
        """The scene of this episode, for policies that look at more than the observation."""
        return self._now("asking for its scene")


def picture(
    scene: LabelledScene, posture: Plan | None = None, envelope: Envelope | None = None
) -> Figure:
    """A scene, with the envelope chosen for it and the posture that P2 found in that."""
    from stancekit.views.postures import draw_posture

    label = "feasible" if scene.feasible else "infeasible"
    why = "no posture chosen yet" if envelope is None else "P2 found no posture from this envelope"
    return draw_posture(
        scene.problem, posture, envelope=envelope, caption=f"expert: {label}", why=why
    )
