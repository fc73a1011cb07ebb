"""``stancekit/EnvelopeRefinement-v0``: cut the boxes of P1 until a posture is found or there is
proved to be none.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.answer.answer import Status
from stancekit.planners.arguments import settings_from
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import Array, checked_int
from stancekit.planners.projection.project import PROJECTIONS, Projection
from stancekit.planners.search.answer import Acceptance
from stancekit.planners.search.exact import BoxSearch

from .episodes import (
    USUAL_SEARCH,
    SearchWeights,
    Step,
    TaskEnv,
    boxes,
    checked_action,
    flat,
    weighted,
)
from .scenes import MAX_DRAWS, LabelledScene, ProblemSource, SceneSettings, margin_info, seen
from .selection import VERTICES, scene_space

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Observation = dict[str, NDArray[np.float32]]
_ROOM = 4.0  # bound on non-dimensional coordinates in an observation
_COUNT_UNIT = 64.0  # depths and numbers of open boxes are told in this unit


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinementSettings(SceneSettings):
    """Keywords of ``EnvelopeRefinementEnv`` beside its problem; its page has their meaning.

    Raises InvalidInput.
    """

    projection: Projection = "fix-toes"
    budget: int = 200
    weights: SearchWeights | Mapping[str, float] = USUAL_SEARCH
    programs: Programs | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        weighted(self.weights, SearchWeights)
        PROJECTIONS.get(self.projection)
        checked_int(self.budget, "budget", least=1)


class _Refined(NamedTuple):
    """A scene and the search of it."""

    scene: LabelledScene
    search: BoxSearch


class EnvelopeRefinementEnv(TaskEnv[_Refined]):
    """Split the boxes of P1 until a posture is found, or until it is proved that none exists.

    ## Description

    One posture problem per episode. The search is ``BoxSearch``, best first, from bounds that
    contain every posture. A cut halves the current box in one of its 6N dimensions. If one half is
    refuted, as often happens, the box shrinks to the other half; otherwise both halves stay in the
    search. Interval propagation then tightens the other dimensions. Either verdict comes with
    evidence: a verified posture, or a proof.

    ## Observation Space

    A ``Dict`` of flat float32 ``Box``es, non-dimensional: the scene as in ``EnvelopeSelectionEnv``,
    and the search:

    | name | shape | meaning |
    |---|---|---|
    | vertices | (9 * N,) | corners of the patches, world axes, three per patch |
    | frames | (9 * N,) | contact frames R_WC, columns n, y, z |
    | friction | (N,) | μ of the patches |
    | shoulders | (3 * N,) | shoulders v in the body frame |
    | reach | (N,) | Δ_FK of the limbs |
    | low | (6 * N,) | lower bounds of the current box, contact by contact p_x p_y p_z f_n f_y f_z |
    | high | (6 * N,) | upper bounds |
    | point | (6 * N,) | P1's point in the box |
    | gap | (6 * N,) | the largest |m_jk − p_j f_k| in which the dimension takes part |
    | margin | (1,) | margin of P1 |
    | depth | (1,) | depth of the box in the tree, in units of 64 |
    | open | (1,) | number of boxes that are open, in units of 64 |
    | left | (1,) | share of the budget that is left |

    ## Action Space

    ``Discrete(6 * N)``: the dimension to halve, contact · 6 + column.

    ## Reward

    −solves · (convex problems solved in the step) / ``budget``, and +success with the verdict, with
    the weights of ``SearchWeights``, which are 1.

    ## Starting State

    A scene of ``scenes``, or of ``problem``, that the first box does not decide; scenes that need
    no cut are skipped.

    ## Episode End

    Terminated when P1's point projects onto a verified posture, or when all boxes are refuted.
    Truncated when ``budget`` convex problems have been solved.

    ## Info

    After a reset and a step (numeric, fixed shapes): ``solves``, ``open``, ``refuted``, ``depth``,
    ``verdict`` (1 feasible, 0 infeasible, −1 open), ``is_success`` (there is a verdict), the
    expert's ``label``, and ``push_n``, ``support_m``, ``friction_left``, the margins of the posture
    that was found, as in ``EnvelopeSelectionEnv``.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | problem | 'wall-3' | as for ``EnvelopeSelectionEnv`` |
    | robot | None | whose legs stand: a built-in name, a URDF, a YAML file; the default hexapod where None |
    | terrain | None | a mesh or grid that the scenes of ``terrain-k`` are cut from |
    | balanced | True | half of the scenes infeasible, none trivially |
    | scenes | None | a source, a ``Dataset``, or its folder, whose part "train" is drawn from, or FOLDER:test |
    | margins | False | measure the margins in ``info``, half a millisecond per posture with numba |
    | projection | 'fix-toes' | the P2 that is tried at every box |
    | budget | 200 | convex problems per episode |
    | weights | SearchWeights() | weights of the reward; or a mapping with some of its keys, and terms of your own |
    | programs | None | compiled models to share with other environments of this process |
    | render_mode | None | "rgb_array" |

    ## Version History

    - v0: the first version
    """

    def __init__(
        self,
        problem: ProblemSource = "wall-3",
        *,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        super().__init__(render_mode)
        settings = settings_from(RefinementSettings, options, beside=("problem", "render_mode"))
        self._law = chosen = settings.kind(problem)
        self._count = len(chosen.legs)
        self._projection: Projection = settings.projection
        self._budget, self._margins = settings.budget, bool(settings.margins)
        self._programs = settings.programs or Programs()
        self._acceptance = Acceptance()
        self._scenes = settings.source(chosen, self._programs)
        self.observation_space = refinement_space(self._count)
        self.action_space = spaces.Discrete(6 * self._count)
        self._weights, self._terms = weighted(settings.weights, SearchWeights)
        if self._terms.by_key:
            scene = copy.copy(self._scenes).draw(np.random.default_rng(0))
            self._try_terms(scene.problem, self._info(self._begun(scene)))

    def _begin(self) -> tuple[_Refined, dict[str, Any]]:
        """Draw scenes until one is not settled by its first box.

        Raises PlanningFailed after MAX_DRAWS.
        """
        for _ in range(MAX_DRAWS):
            scene = self._scenes.draw(self.np_random)
            if scene.scaled.size != (self._count, VERTICES):
                raise InvalidInput(
                    f"scene: expected {self._count} contacts on triangles, got the size "
                    f"{scene.scaled.size}"
                )
            begun = self._begun(scene)
            search = begun.search
            if search.verdict is Status.UNDECIDED and search.solves < self._budget:
                return begun, self._info(begun)
        raise PlanningFailed(f"no scene in {MAX_DRAWS} draws that its first box leaves open")

    def _begun(self, scene: LabelledScene) -> _Refined:
        """The search of a scene, its first box visited."""
        search = BoxSearch(
            scene.problem,
            scene.scaled,
            self._programs,
            projection=self._projection,
            acceptance=self._acceptance,
        )
        return _Refined(scene, search)

    def _act(self, episode: _Refined, action: np.int64) -> Step:
        """Halve the current box in this dimension."""
        scene, search = episode
        before = search.solves
        search.cut(int(checked_action(action, self.action_space)))
        ended = search.verdict is not Status.UNDECIDED
        return Step(
            reward=self._weights.of(ended, (search.solves - before) / self._budget),
            terminated=ended,
            truncated=not ended and search.solves >= self._budget,
            info=self._info(episode),
            question=scene.problem,
            answer=search.posture if ended else None,
            action=action,
        )

    @property
    def scene(self) -> LabelledScene:
        """The scene of this episode, for policies that look at more than the observation."""
        return self._now("asking for its scene").scene

    def _drawn(self, episode: _Refined) -> Figure:
        """The scene with the current box, or with the posture where one was found."""
        from stancekit.views.postures import draw_posture

        scene, search = episode
        words = {
            Status.FEASIBLE: "a posture was found",
            Status.INFEASIBLE: "there is proved to be none",
        }
        state = words.get(search.verdict, f"{search.open} boxes are open")
        box = search.current.box if search.verdict is Status.UNDECIDED else None
        caption = f"{search.solves} of {self._budget} convex problems: {state}"
        return draw_posture(scene.problem, search.posture, envelope=box, caption=caption, why=state)

    def _observe(self, episode: _Refined) -> _Observation:
        scene, search = episode
        node = search.current if search.open else None
        zeros = np.zeros(6 * self._count)
        return seen(scene) | {
            "low": flat(zeros if node is None else node.box.low, _ROOM),
            "high": flat(zeros if node is None else node.box.high, _ROOM),
            "point": flat(zeros if node is None else node.point, _ROOM),
            "gap": flat(zeros if node is None else gap_by_dimension(node.gaps), _ROOM),
            "margin": flat(0.0 if node is None else node.margin, _ROOM),
            "depth": flat(0.0 if node is None else node.depth / _COUNT_UNIT, _ROOM),
            "open": flat(search.open / _COUNT_UNIT, _ROOM),
            "left": flat(max(0.0, 1.0 - search.solves / self._budget), _ROOM),
        }

    def _info(self, episode: _Refined) -> dict[str, Any]:
        scene, search = episode
        posture = search.posture if self._margins else None
        verdicts = {Status.FEASIBLE: 1, Status.INFEASIBLE: 0, Status.UNDECIDED: -1}
        return {
            "solves": search.solves,
            "open": search.open,
            "refuted": search.refuted,
            "depth": search.current.depth if search.open else 0,
            "verdict": verdicts[search.verdict],
            "label": int(scene.feasible),
            "is_success": int(search.verdict is not Status.UNDECIDED),
            **margin_info(posture),
        }


def gap_by_dimension(gaps: Array) -> Array:
    """The largest |m_jk − p_j f_k| that each of p_x p_y p_z f_n f_y f_z has part in.

    Arguments:
        gaps: (N, 3, 3); to (N, 6).
    """
    return np.concatenate([gaps.max(axis=2), gaps.max(axis=1)], axis=1)


def refinement_space(count: int) -> spaces.Dict:
    """The observation space of ``EnvelopeRefinementEnv`` for this many contacts."""
    dimensions = dict.fromkeys(("low", "high", "point"), (-_ROOM, _ROOM, 6 * count))
    numbers = {"gap": (0.0, _ROOM, 6 * count), "margin": (-_ROOM, _ROOM, 1), "left": (0.0, 1.0, 1)}
    numbers |= dict.fromkeys(("depth", "open"), (0.0, _ROOM, 1))
    return spaces.Dict({**scene_space(count).spaces, **boxes(dimensions | numbers).spaces})
