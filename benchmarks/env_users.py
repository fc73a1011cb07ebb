"""Every registered environment as those who use it do: Gymnasium, stable-baselines3, Minari,
copies, JSON.

    python benchmarks/env_users.py [--steps 200] [--folder out/users] [--only Traverse …]

A row an environment and a check: what was seen, and how long it took. Environments are made by
their id, with their own defaults; stable-baselines3 is given the id. A copy and a pickle are taken
after a reset and after three steps, and have to go on to the last bit as the original does. With
--folder a row that is there is not measured again. Exit code 1 where a check fails.
"""

from __future__ import annotations

import copy
import os
import pickle
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import gymnasium as gym
import stable_baselines3
from _bench import Options, Row, kept, launch
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

import stancekit.envs  # noqa: F401 — registers them
from tests.envs.test_contract import IDS, same, steps


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """How many steps, of which environments, and where rows are kept."""

    steps: int = 200
    only: tuple[str, ...] = ()
    """Parts of names; all where none is given."""
    folder: Path | None = None


def main(arguments: Arguments) -> None:
    """Ask all of all and print a row each."""
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch:
        os.environ["MINARI_DATASETS_PATH"] = scratch
        for name in IDS:
            if arguments.only and not any(part in name for part in arguments.only):
                continue
            for check, asked in checks(name, arguments.steps).items():
                path = (
                    arguments.folder or Path(scratch)
                ) / f"{name.partition('/')[2]}-{check.replace(' ', '-')}.json"
                row = kept(path, partial(measured, name, check, asked))
                arguments.say(row)
                wrong += row["seen"] != "right"
    sys.exit(int(wrong > 0))


def measured(name: str, check: str, asked: Callable[[], bool]) -> Row:
    """One check of one environment."""
    begin = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            seen = "right" if asked() else "WRONG"
    except Exception as error:
        seen = f"{type(error).__name__}: {error}"
    return {
        "environment": name,
        "check": check,
        "seen": seen,
        "seconds": round(time.perf_counter() - begin, 1),
    }


def checks(name: str, count: int) -> dict[str, Callable[[], bool]]:
    """All checks of an environment by their names."""
    box = isinstance(gym.make(name).action_space, gym.spaces.Box)
    agents = ("PPO", "SAC", "TD3") if box else ("PPO",)
    found: dict[str, Callable[[], bool]] = {
        f"sb3 {agent}": partial(trained, name, agent, count) for agent in agents
    }
    found |= {
        f"{how} after {done} steps": partial(copied, name, how, done)
        for how in COPIES
        for done in (0, 3)
    }
    return {
        "check_env": partial(checked, name),
        "minari": partial(collected, name),
        "json": partial(again, name),
    } | found


def checked(name: str) -> bool:
    """Gymnasium's checker."""
    check_env(gym.make(name, render_mode="rgb_array").unwrapped)
    return True


def trained(name: str, agent: str, count: int) -> bool:
    """An agent of stable-baselines3 for so many steps, made by the environment's id."""
    more = (
        {"n_steps": count // 2, "batch_size": count // 2}
        if agent == "PPO"
        else {"learning_starts": count // 2}
    )
    policy = (
        "MultiInputPolicy"
        if isinstance(gym.make(name).observation_space, gym.spaces.Dict)
        else "MlpPolicy"
    )
    return (
        getattr(stable_baselines3, agent)(policy, name, **more).learn(count).num_timesteps == count
    )


def collected(name: str) -> bool:
    """An episode that Minari's collector keeps, with infos."""
    import minari

    env = minari.DataCollector(gym.make(name), record_infos=True)
    env.reset(seed=0)
    while not any(env.step(env.action_space.sample())[2:4]):
        pass
    kept_set = env.create_dataset(
        f"{name.partition('/')[2].lower()}/random-v0", algorithm_name="random"
    )
    infos = next(kept_set.iterate_episodes()).infos
    return kept_set.total_episodes == 1 and infos is not None and "is_success" in infos


def again(name: str) -> bool:
    """The environment of its spec after JSON resets as it does."""
    env = gym.make(name)
    return same(gym.make(EnvSpec.from_json(env.spec.to_json())).reset(seed=2), env.reset(seed=2))


COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda env: pickle.loads(pickle.dumps(env))}


def copied(name: str, how: str, done: int) -> bool:
    """A copy goes on as the original does."""
    env = gym.make(name)
    env.reset(seed=3)
    env.action_space.seed(5)
    steps(env, done)
    other = COPIES[how](env)
    return same(steps(other), steps(env))


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
