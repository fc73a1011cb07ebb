"""``stancekit/EnvelopeSelection-v0``: choose envelopes for one posture problem; the planner stack judges."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stancekit.planners.arrays import Array
from stancekit.planners.contact.envelope import Envelope, EnvelopeSet
from stancekit.planners.contact.planner import Acceptance
from stancekit.planners.contact.project import Point
from stancekit.planners.contact.relax import RelaxationAnswer
from stancekit.planners.contact.scaled import ScaledProblem
from stancekit.planners.contact.stages import PROJECTIONS, Projection, Stages
from stancekit.planners.files import read_envelopes
from stancekit.planners.outcome import InvalidInput, Outcome, Posture, Status

from .picture import draw_posture, to_rgb
from .scenes import SampledScenes, Scene, SceneSource
from .terrains import distribution

VERTICES = 3
"""Corners of the patches that the environment's observation holds."""
ADMITTED = 1e-6
"""A projection counts when the verifier finds no violation above this (non-dimensional)."""
_ROOM = 4.0  # bound on non-dimensional coordinates in an observation


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """What a step is worth: reward = agreement · [P1 says what the expert says] + projection · [the chosen projection
    reaches a verified posture] + tightness · [1 − mean width of the box / width of the domain].
    """

    agreement: float = 1.0
    projection: float = 0.5
    tightness: float = 0.1


class EnvelopeSelectionEnv(gym.Env[dict[str, NDArray[np.float32]], NDArray[np.float32] | np.int64]):
    """One step: see a scene, choose boxes for P1, be told how P1 and P2 fare with them against the exact answer.

    Observation, float32, non-dimensional (lengths / length scale), each array flattened contact by contact:
    ``vertices`` (N·3·3) patch corners in the world, ``frames`` (N·3·3) contact frames with columns n, y, z,
    ``friction`` (N), ``shoulders`` (N·3), ``reach`` (N).
    Action: bounds of ``boxes`` boxes, each all lower and then all upper bounds of [p, f], shape (boxes · 12N,) in
    [−1, 1] (a reversed pair is put in order); with ``library`` given, the index of one of its envelopes.
    Info after a step (numeric, fixed shapes): ``label``, ``p1_feasible``, ``margin``, ``gap``, ``log_volume``,
    ``chosen``, ``project_<way>`` for every projection asked for, ``reward_<term>``, the expert's ``expert_point``
    (N, 6) (zeros where infeasible) and ``expert_lower_bound``, and ``p1_seconds``, ``p2_seconds``, ``expert_seconds``,
    which stay 0 unless ``timing``: a clock in ``info`` would make equal episodes differ.

    problem: name of a distribution. balanced: half of the scenes infeasible, none trivially. scenes: replaces both.
    projections: which P2 to run; the reward looks at the first. library: an EnvelopeSet or the path of its file.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 1}  # noqa: RUF012 — Gymnasium's own convention

    def __init__(
        self,
        problem: str = "wall-3",
        *,
        boxes: int = 1,
        library: EnvelopeSet | str | Path | None = None,
        projections: tuple[Projection, ...] = ("fix-p",),
        weights: RewardWeights = RewardWeights(),
        balanced: bool = True,
        scenes: SceneSource | None = None,
        timing: bool = False,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise InvalidInput(f"render_mode: expected one of {self.metadata['render_modes']}, got {render_mode!r}")
        unknown = set(projections) - set(PROJECTIONS)
        if unknown or not projections:
            raise InvalidInput(f"projections: expected some of {', '.join(PROJECTIONS)}, got {list(projections)}")
        chosen = distribution(problem)
        self.render_mode = render_mode
        self._count = len(chosen.legs)
        self._boxes = boxes
        self._library = read_envelopes(library) if isinstance(library, str | Path) else library
        self._projections = tuple(projections)
        self._weights = weights
        self._timing = timing
        self._stages = Stages()
        self._scenes = scenes or SampledScenes(chosen, balanced=balanced, stages=self._stages)
        self._acceptance = Acceptance(tolerance=ADMITTED)
        self._scene: Scene | None = None
        self._scaled: ScaledProblem | None = None
        self._shown: tuple[Posture | None, Envelope | None] = (None, None)
        self.observation_space: spaces.Space[Any] = _observation_space(self._count)
        self.action_space = self._make_action_space()

    def _make_action_space(self) -> spaces.Space[Any]:
        if self._library is None:
            return spaces.Box(-1.0, 1.0, (self._boxes * 12 * self._count,), np.float32)
        if len(self._library.legs) != self._count:
            raise InvalidInput(f"library: expected envelopes for {self._count} contacts, got {len(self._library.legs)}")
        return spaces.Discrete(len(self._library.envelopes))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        """Draw the next scene."""
        super().reset(seed=seed)
        self._scene = self._scenes.draw(self.np_random)
        self._scaled = ScaledProblem.of(self._scene.problem)
        if self._scaled.size != (self._count, VERTICES):
            raise InvalidInput(
                f"scene: expected {self._count} contacts on triangles, got {self._scaled.size[0]} contacts on patches "
                f"of up to {self._scaled.size[1]} corners"
            )
        self._shown = (None, None)
        if self.render_mode == "human":
            self.render()
        return observe(self._scaled), {}

    def step(
        self, action: NDArray[np.float32] | np.int64
    ) -> tuple[dict[str, NDArray[np.float32]], float, bool, bool, dict[str, Any]]:
        """Relax over the chosen boxes, project, compare with the expert; the episode ends."""
        if self._scene is None or self._scaled is None:
            raise gym.error.ResetNeeded("reset the environment before the first step")
        envelopes = self._envelopes(action)
        begin = time.perf_counter()
        answer = self._stages.box(self._scaled).solve_any(self._scaled, envelopes)
        p1_seconds = time.perf_counter() - begin
        begin = time.perf_counter()
        projected = {way: self._project(way, answer) for way in self._projections}
        p2_seconds = time.perf_counter() - begin
        info = self._info(answer, envelopes[answer.chosen], projected)
        clock = self._timing
        info["p1_seconds"] = p1_seconds if clock else 0.0
        info["p2_seconds"] = p2_seconds if clock else 0.0
        info["expert_seconds"] = self._scene.expert_seconds if clock else 0.0
        reward = float(info["reward_agreement"] + info["reward_projection"] + info["reward_tightness"])
        found = next((outcome.posture for outcome in projected.values() if outcome and outcome.posture), None)
        self._shown = (found, envelopes[answer.chosen])
        if self.render_mode == "human":
            self.render()
        return observe(self._scaled), reward, True, False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the scene, and after a step the envelope and the posture that P2 found in it."""
        if self._scene is None:
            raise gym.error.ResetNeeded("reset the environment before rendering")
        posture, envelope = self._shown
        label = "feasible" if self._scene.feasible else "infeasible"
        figure = draw_posture(self._scene.problem, posture, envelope=envelope, caption=f"expert: {label}")
        pixels: NDArray[np.uint8] = to_rgb(figure)
        if self.render_mode == "human":
            _show(pixels)
            return None
        return pixels

    def _envelopes(self, action: NDArray[np.float32] | np.int64) -> tuple[Envelope, ...]:
        if self._library is not None:
            return (self._library.envelopes[int(action)],)
        bounds = np.asarray(action, dtype=np.float64).reshape(self._boxes, -1)
        return tuple(Envelope.from_vector(row) for row in bounds)

    def _project(self, way: Projection, answer: RelaxationAnswer) -> Outcome | None:
        """Project P1's point and have it verified; None where P1 gave no point or admits nothing."""
        assert self._scene is not None
        assert self._scaled is not None
        if not answer.feasible or answer.point is None:
            return None
        point: Point = self._stages.project(way, self._scaled, answer.point)
        if not np.isfinite(point.residual):
            return None
        posture = self._scaled.posture(com=point.com, rotation=point.rotation, toes=point.toes, forces=point.forces)
        return self._acceptance.outcome(self._scene.problem, method=way, begin=0.0, posture=posture)

    def _info(
        self, answer: RelaxationAnswer, envelope: Envelope, projected: dict[Projection, Outcome | None]
    ) -> dict[str, Any]:
        assert self._scene is not None
        assert self._scaled is not None
        reached = {way: outcome is not None and outcome.status is Status.FEASIBLE for way, outcome in projected.items()}
        agree = answer.known and answer.feasible == self._scene.feasible
        width = float(np.mean(envelope.high - envelope.low)) / 2.0
        weights = self._weights
        posture = self._scene.posture
        return {
            "label": int(self._scene.feasible),
            "p1_feasible": int(answer.feasible),
            "margin": float(answer.margin),
            "gap": float(np.nan_to_num(answer.gap)),
            "log_volume": envelope.log_volume(),
            "chosen": int(answer.chosen),
            **{f"project_{way.replace('-', '_')}": int(value) for way, value in reached.items()},
            "reward_agreement": weights.agreement * agree,
            "reward_projection": weights.projection * reached[self._projections[0]],
            "reward_tightness": weights.tightness * (1.0 - width),
            "expert_point": np.zeros((self._count, 6)) if posture is None else self._scaled.point(posture),
            "expert_lower_bound": float(self._scene.lower_bound),
        }


def observe(scaled: ScaledProblem) -> dict[str, NDArray[np.float32]]:
    """The observation of a scene, see ``EnvelopeSelectionEnv``."""

    def seen(values: Array, room: float) -> NDArray[np.float32]:
        return np.clip(values, -room, room).astype(np.float32).ravel()

    return {
        "vertices": seen(scaled.vertices, _ROOM),
        "frames": seen(scaled.frames, 1.0),
        "friction": seen(scaled.friction, _ROOM),
        "shoulders": seen(scaled.shoulders, _ROOM),
        "reach": seen(scaled.reach, _ROOM),
    }


def _observation_space(count: int) -> spaces.Dict:
    def box(low: float, high: float, size: int) -> spaces.Box:
        return spaces.Box(low, high, (size,), np.float32)

    return spaces.Dict(
        {
            "vertices": box(-_ROOM, _ROOM, count * VERTICES * 3),
            "frames": box(-1.0, 1.0, count * 9),
            "friction": box(0.0, _ROOM, count),
            "shoulders": box(-_ROOM, _ROOM, count * 3),
            "reach": box(0.0, _ROOM, count),
        }
    )


def _show(pixels: NDArray[np.uint8]) -> None:
    """Put a picture on the screen; on a machine without one matplotlib falls back to a backend that shows nothing."""
    import matplotlib.pyplot as plt

    plt.figure("stancekit", clear=True).figimage(pixels)
    plt.pause(0.001)
