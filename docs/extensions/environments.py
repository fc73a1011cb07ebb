"""A page an environment, in the form of Gymnasium's own: a table of spaces, a picture, and the docstring's sections."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import stancekit.envs

REWARDS = {
    "EnvelopeSelection": r"r = w_\text{agreement}\,[\text{P1 says what the expert says}]"
    r" + w_\text{projection}\,[\text{P2 reaches a verified posture}]"
    r" + w_\text{tightness}\,\left(1 - \tfrac12\,\overline{u - l}\right)",
    "EnvelopeRefinement": r"r = -\frac{\text{convex problems solved in the step}}{\text{budget}}"
    r" + [\text{verdict}]",
    "Traverse": r"r = w_\text{progress}\,\frac{\Delta s}{L} + w_\text{feasible}\,[\text{verified plan}]"
    r" - w_\text{failure}\,[\text{none, or its execution failed}] - w_\text{solve}\,n - w_\text{second}\,t",
    "WarpedGait": r"r = w_\text{verified}\,[\text{verifier accepts}] + w_\text{feasible}\,[\text{solve succeeds}]"
    r" - w_\text{iterations}\,\frac{k}{k_\text{most}} - w_\text{seconds}\,t",
}
"""The section Reward as a formula; what its letters are stands below it."""
PICTURE = "EnvelopeSelection", "Traverse", "WarpedGait"
"""Environments that can be drawn."""


def names() -> list[str]:
    """Ids of all environments of the package."""
    assert stancekit.envs is not None
    return sorted(name for name in gymnasium.registry if name.startswith("stancekit/"))


def short(name: str) -> str:
    """EnvelopeSelection of stancekit/EnvelopeSelection-v0."""
    return name.removeprefix("stancekit/").rsplit("-", 1)[0]


def page(name: str) -> str:
    """The page of an environment, Markdown."""
    env: Any = gymnasium.make(name)
    docstring = inspect.getdoc(type(env.unwrapped)) or ""
    brief, _, rest = docstring.partition("\n\n")
    brief, rest = (re.sub(r"``([^`]*)``", r"`\1`", text) for text in (brief, rest))
    rest = rest.replace("## Reward\n", f"## Reward\n\n$$\n{REWARDS[short(name)]}\n$$\n")
    picture = f"![One frame]({short(name)}.png)\n\n" if short(name) in PICTURE else ""
    many = "yes, `gymnasium.make_vec`" if gymnasium.spec(name).vector_entry_point else "Gymnasium's own wrappers"
    return f"""# {short(name)}

{picture}| | |
|---|---|
| Action space | `{env.action_space}` |
| Observation space | `{_space(env.observation_space)}` |
| Import | `gymnasium.make("stancekit.envs:{name}")` |
| Batches | {many} |

{brief}

{rest}
"""


def _space(space: Any) -> str:
    return "Dict(" + ", ".join(f"{key}: {box.shape}" for key, box in space.spaces.items()) + ")"


def draw(name: str, path: Path) -> None:
    """What ``render`` shows after a step, as a picture."""
    from matplotlib.image import imsave

    env: Any = gymnasium.make(name, render_mode="rgb_array")
    env.reset(seed=0)
    env.action_space.seed(0)
    action = np.zeros_like(env.action_space.sample()) if short(name) != "EnvelopeSelection" else _wide(env)
    env.step(action)
    imsave(path, env.render())
    env.close()


def _wide(env: Any) -> Any:
    """A box that leaves most in: lower bounds −.6, upper .6."""
    half = env.action_space.shape[0] // 2
    return np.concatenate([np.full(half, -0.6), np.full(half, 0.6)]).astype(np.float32)
