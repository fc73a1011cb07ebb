"""A page an environment, in the form of Gymnasium's own: a table of spaces, a picture, and the
docstring's sections.
"""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Sequence
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import stancekit.envs

ROOM = Path(__file__).parents[1] / "environments" / "room.jsonl"
"""Lines of ``bench room --json``, each with its command; or of an environment, why it has none."""
REWARDS = {
    "EnvelopeSelection": (
        r"r &= w_\text{agreement}\;[\text{P1 says what the expert says}] \\"
        r"&+ w_\text{projection}\;[\text{P2 reaches a verified posture}] \\"
        r"&+ w_\text{tightness}\;(1 - \tfrac{1}{2}\,\text{mean width of the box})",
        "stancekit.envs.episodes:RewardWeights",
    ),
    "EnvelopeRefinement": (
        r"r &= [\text{verdict}] - \frac{\text{convex problems solved}}{\text{budget}}",
        "",
    ),
    "Traverse": (
        r"r &= w_\text{progress}\;\frac{\Delta s}{L} + w_\text{feasible}\;[\text{verified plan}] \\"
        r"&- w_\text{failure}\;[\text{no plan, or its execution failed}] \\"
        r"&- w_\text{solve}\;n - w_\text{second}\;t",
        "stancekit.envs.traverse:TraverseWeights",
    ),
    "WarpedGait": (
        r"r &= w_\text{verified}\;[\text{the verifier accepts}] + w_\text{feasible}\;[\text{the solve succeeds}] \\"
        r"&- w_\text{iterations}\;\frac{k}{k_\text{limit}} - w_\text{seconds}\;t",
        "stancekit.envs.warped_gait:GaitRewardWeights",
    ),
    "LeapChoice": (
        r"r = [\text{the verifier accepts a leap}] - \frac{\text{convex problems solved}}{\text{solves}}",
        "",
    ),
}
"""The section Reward as a formula, and where its weights are."""
PICTURE = "EnvelopeSelection", "LeapChoice", "Traverse", "WarpedGait"
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
    rest = re.sub(
        r"## Reward\n\n(.*?)(?=\n## )", lambda said: _reward(short(name), said[1]), rest, flags=re.S
    )
    picture = f"![One frame]({short(name)}.png)\n\n" if short(name) in PICTURE else ""
    many = (
        "yes, `gymnasium.make_vec`"
        if gymnasium.spec(name).vector_entry_point
        else "Gymnasium's own wrappers"
    )
    return f"""# {short(name)}

{picture}| | |
|---|---|
| Action space | `{env.action_space}` |
| Observation space | `{_space(env.observation_space)}` |
| Import | `gymnasium.make("stancekit.envs:{name}")` |
| Batches | {many} |

{brief}

{rest.rstrip()}

{_room(short(name))}"""


def _room(name: str) -> str:
    """What ``bench room`` printed for an environment, as a table below its command; or why there is
    none.
    """
    lines = [json.loads(line) for line in ROOM.read_text(encoding="utf-8").splitlines()]
    own = [line for line in lines if line["environment"].startswith(name)]
    text = ["## Room for learning", ""]
    for command in dict.fromkeys(line["command"] for line in own if "said" not in line):
        mine = [line for line in own if line.get("command") == command]
        first = mine[0]
        text += ["```sh", command, "```", ""]
        text += [
            f"{first['environment']}, {first['scenes']} scenes; oracle: {first['oracle_budget']}; learned:"
        ]
        text += [
            f"{first['learned_by'] or 'nothing'}. Shares in percent, differences in points, 95 % intervals;"
        ]
        text += ["gains are paired over the scenes. *again*: the oracle with other seeds.", ""]
        text += [
            "| budget | random | best unlearned control | learned | learned − control | oracle | again | room |"
        ]
        text += ["|---|---|---|---|---|---|---|---|", *map(_row, mine), ""]
    return "\n".join([*text, *(f"{line['said']}\n" for line in own if "said" in line)])


def _row(line: dict[str, Any]) -> str:
    shares = {
        key: _share(line[key], 100.0) for key in ("random", "control", "learned", "oracle", "again")
    }
    control = f"{shares['control']} ({line['controlled_by']})"
    gain = _share(line["gain"], 1.0, "+.1f")
    cells = [
        line["budget"],
        shares["random"],
        control,
        shares["learned"],
        gain,
        shares["oracle"],
        shares["again"],
    ]
    return f"| {' | '.join(cells)} | {line['room']:.0f} |"


def _share(value: Sequence[float] | None, factor: float, how: str = ".0f") -> str:
    if value is None:
        return "–"
    middle, low, high = (format(factor * each, how).replace("-", "−") for each in value)
    return f"{middle} [{low}, {high}]"


def _reward(name: str, said: str) -> str:
    """The formula, what the docstring says in words, and the weights."""
    formula, place = REWARDS[name]
    text = " ".join(said.split())
    lines = [
        "## Reward",
        "",
        "$$",
        r"\begin{aligned}",
        formula,
        r"\end{aligned}",
        "$$",
        "",
        text,
        "",
    ]
    if place:
        module, kind = place.split(":")
        weights = getattr(import_module(module), kind)()
        lines += [f"| weight of `{kind}` | default |", "|---|---|"]
        lines += [
            f"| {field.name} | {getattr(weights, field.name):g} |" for field in fields(weights)
        ]
    return "\n".join([*lines, ""])


def _space(space: Any) -> str:
    return "Dict(" + ", ".join(f"{key}: {box.shape}" for key, box in space.spaces.items()) + ")"


def draw(name: str, path: Path) -> None:
    """What ``render`` shows after a step, as a picture."""
    from matplotlib.image import imsave

    env: Any = gymnasium.make(name, render_mode="rgb_array")
    env.reset(seed=0)
    env.action_space.seed(0)
    action = (
        np.zeros_like(env.action_space.sample())
        if short(name) != "EnvelopeSelection"
        else _wide(env)
    )
    env.step(action)
    imsave(path, env.render())
    env.close()


def _wide(env: Any) -> Any:
    """A box that leaves most in: lower bounds −.6, upper .6."""
    half = env.action_space.shape[0] // 2
    return np.concatenate([np.full(half, -0.6), np.full(half, 0.6)]).astype(np.float32)
