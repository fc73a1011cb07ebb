"""``stancekit/EnvelopeSelection-v0``: choose envelopes for one posture problem; the planner stack
judges.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import settings_from
from stancekit.planners.relaxation.envelope import Envelope

from .episodes import check_options, checked_render_mode, checked_seed
from .reward import RewardWeights as RewardWeights
from .scene_sources import ProblemSource
from .scenes import LabelledScene, seen
from .selection_task import SelectionSettings, SelectionTask

WINDOW = "stancekit"


class EnvelopeSelectionEnv(gym.Env[dict[str, NDArray[np.float32]], NDArray[np.float32] | np.int64]):
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
    the folder of a data set of ``stancekit label`` with rows of ``problem``: a pool, of which the
    part "train" (``Dataset.only``) is drawn from.

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
    | margins | False | measure the margins in ``info``, some milliseconds per posture |
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
        self.render_mode = checked_render_mode(render_mode, self.metadata)
        settings = settings_from(SelectionSettings, options, beside=("problem", "render_mode"))
        self._task = SelectionTask(problem, settings)
        self._scene: LabelledScene | None = None
        self._shown: tuple[Plan | None, Envelope | None] = (None, None)
        self.observation_space: spaces.Space[Any] = self._task.observation_space
        self.action_space = self._task.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        """Draw the next scene."""
        check_options(options)
        super().reset(seed=checked_seed(seed))
        self._scene = self._task.scenes.draw(self.np_random)
        self._task.check(self._scene)
        self._shown = (None, None)
        if self.render_mode == "human":
            self.render()
        return seen(self._scene), self._task.before(self._scene)

    def step(
        self, action: NDArray[np.float32] | np.int64
    ) -> tuple[dict[str, NDArray[np.float32]], float, bool, bool, dict[str, Any]]:
        """Relax over the chosen boxes, project, compare with the expert; the episode ends."""
        if self._scene is None:
            raise gym.error.ResetNeeded("reset the environment before the first step")
        verdict = self._task.judge(self._scene, action)
        self._shown = (verdict.posture, verdict.envelope)
        if self.render_mode == "human":
            self.render()
        return seen(self._scene), verdict.reward, True, False, verdict.info

    @property
    def scene(self) -> LabelledScene:
        """The scene of this episode, for policies that look at more than the observation."""
        if self._scene is None:
            raise gym.error.ResetNeeded("reset the environment before asking for its scene")
        return self._scene

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the scene, and after a step the envelope and the posture that P2 found in it."""
        if self._scene is None:
            raise gym.error.ResetNeeded("reset the environment before rendering")
        pixels = picture(self._scene, *self._shown)
        if self.render_mode == "human":
            _show(pixels)
            return None
        return pixels

    def close(self) -> None:
        """Close the window, if there is one."""
        if self.render_mode == "human":
            _hide()


def picture(
    scene: LabelledScene, posture: Plan | None = None, envelope: Envelope | None = None
) -> NDArray[np.uint8]:
    """The pixels of a scene, with the envelope chosen for it and the posture that P2 found in
    that.
    """
    from stancekit.views.postures import draw_posture
    from stancekit.views.sheet import to_rgb

    label = "feasible" if scene.feasible else "infeasible"
    why = "no posture chosen yet" if envelope is None else "P2 found no posture from this envelope"
    return to_rgb(
        draw_posture(scene.problem, posture, envelope=envelope, caption=f"expert: {label}", why=why)
    )


def _show(pixels: NDArray[np.uint8]) -> None:
    """Put a picture on the screen; on a machine without one matplotlib falls back to a backend that
    shows nothing.
    """
    import matplotlib.pyplot as plt

    plt.figure(WINDOW, clear=True).figimage(pixels, resize=True)
    plt.pause(0.001)


def _hide() -> None:
    import matplotlib.pyplot as plt

    plt.close(WINDOW)
