"""Expert data for others: a labelled data set as a Minari data set of one-step episodes of
``EnvelopeSelection-v0``.
"""

from __future__ import annotations

import copy
import importlib
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from stancekit.envs.data.dataset import Dataset, LabelledPosture, scene_of
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.scenes import ListedScenes, SceneKind
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.writing import check_new_folder, failure_of, make_folder, replaced
from stancekit.planners.relaxation.envelope import Envelope

_ENVIRONMENT = "stancekit/EnvelopeSelection-v0"
_INFOS = ("label", "p1_feasible", "margin", "expert_lower_bound")
"""Entries of the info before and after the step that an episode keeps, each of shape (2, 1)."""


@dataclass(frozen=True, kw_only=True)
class Exported:
    """Record of what ``export`` wrote.

    Arguments:
        root: the folder to give to Minari as MINARI_DATASETS_PATH.
        dataset_id: the name to load it by.
        episodes: number of episodes.
        mean_reward: mean reward of the expert.
        agreement: share of the episodes in which P1 over the expert's box says what the label says.
    Source:
        None: Minari's format.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> stancekit.export(train, "minari").agreement  # doctest: +SKIP
        1.0
        >>> stancekit.Exported.__name__
        'Exported'
    """

    root: Path
    dataset_id: str
    episodes: int
    mean_reward: float
    agreement: float


def expert_action(row: LabelledPosture, room: float) -> NDArray[np.float32]:
    """The expert's box: the smallest one around the row's [p, f], every side moved out by ``room``,
    shape (12N,).

    The point is the witness where the problem is feasible, so P1 over the box must admit it; else
    the answer of P̄, which only the moment balance keeps out, and over a box so small P1 should say
    so. Non-dimensional, in [−1, 1].
    """
    if row.point is None:
        raise InvalidInput(
            f"shard {row.shard} row {row.row}: expected a row with a point, got a {row.kind} one"
        )
    bounds = Envelope.around(row.point[None]).widened(room).to_vector()
    action: NDArray[np.float32] = np.clip(bounds, -1.0, 1.0).astype(np.float32)
    return action


def export(
    dataset: Dataset,
    out: Path,
    *,
    room: float = 0.02,
    progress: Callable[[int, int], None] | None = None,
) -> Exported:
    """Write the feasible and hard infeasible rows as episodes of one step, below a new folder;
    whole or not at all.

    Observation, action, reward and info are what the environment gives. Raises InvalidInput where
    the folder is there already, or Minari is not installed.
    """
    minari = _minari()
    if not 0.0 < room <= 1.0:
        raise InvalidInput(f"room: expected a number between 0 and 1, got {room!r}")
    check_new_folder(out)
    make_folder(out.parent)
    dataset_id = f"stancekit/{dataset.problem_class}/expert-v0"
    rows = dataset.select(np.sort(np.concatenate([dataset.feasible, dataset.infeasible])))
    if not len(rows):
        raise InvalidInput(
            "data set: expected rows that are feasible or infeasible with a point, got none"
        )
    source = ListedScenes([scene_of(rows.row(0))])
    env = EnvelopeSelectionEnv(
        SceneKind(name=dataset.problem_class, legs=tuple(dataset.header.legs)), scenes=source
    )
    episodes = []
    for index, row in enumerate(rows.rows()):
        source.deal([scene_of(row)])
        shown = env.reset(seed=0 if index == 0 else None)
        episodes.append(_episode(minari, env, index, shown, expert_action(row, room)))
        if progress is not None:
            progress(index + 1, len(rows))
    with replaced(out, folder=True) as partial:

        def create() -> None:
            with _minari_root(partial):
                minari.create_dataset_from_buffers(
                    dataset_id,
                    episodes,
                    env=_spec(dataset.header.plan),
                    observation_space=env.observation_space,
                    action_space=env.action_space,
                    algorithm_name="stancekit exact planner",
                    requirements=[f"stancekit=={version('stancekit')}"],
                    description=_description(dataset, room),
                )
                written = load_exported(partial)
                if sum(1 for _ in written.iterate_episodes()) != len(episodes):
                    raise OSError("expected all episodes back")

        _apart(create)
    return Exported(
        root=out.resolve(),
        dataset_id=dataset_id,
        episodes=len(episodes),
        mean_reward=float(np.mean([episode.rewards[0] for episode in episodes])),
        agreement=float(
            np.mean([e.infos["label"][1, 0] == e.infos["p1_feasible"][1, 0] for e in episodes])
        ),
    )


def _apart(create: Callable[[], None]) -> None:
    """Do it in a process of its own: a full disk takes HDF5 down with the process.

    Raises OSError where it failed.
    """
    with TemporaryFile() as sink:
        process = os.fork()
        if not process:
            status = 1
            try:
                os.dup2(sink.fileno(), 2)
                create()
                status = 0
            except BaseException as error:  # the parent process reads it and raises
                os.write(2, f"{error}\n".encode(errors="replace"))
            finally:
                os._exit(status)  # and not by way of HDF5's own clean-up
        _, status = os.waitpid(process, 0)
        if status:
            sink.seek(0)
            raise failure_of("Minari", sink.read().decode(errors="replace"))


def load_exported(root: Path) -> Any:
    """The MinariDataset that ``export`` wrote below this folder.

    Raises InvalidInput.
    """
    minari = _minari()
    folders = sorted(root.glob("stancekit/*/expert-v0/data"))
    if len(folders) != 1:
        raise InvalidInput(f"{root}: expected one exported data set, found {len(folders)}")
    try:
        return minari.MinariDataset(folders[0])
    except (OSError, KeyError, ValueError, AssertionError) as error:
        raise InvalidInput(
            f"{folders[0]}: expected a whole Minari data set: {' '.join(str(error).split())}"
        ) from None


def _episode(
    minari: Any,
    env: EnvelopeSelectionEnv,
    index: int,
    shown: tuple[dict[str, NDArray[np.float32]], dict[str, Any]],
    action: NDArray[np.float32],
) -> Any:
    """One step as Minari keeps it: T actions, T + 1 observations and infos, with T = 1."""
    observation, before = shown
    after, reward, terminated, truncated, info = env.step(action)
    return minari.data_collector.EpisodeBuffer(
        id=index,
        observations={name: np.stack([observation[name], after[name]]) for name in observation},
        actions=action[None],
        rewards=[reward],
        terminations=[terminated],
        truncations=[truncated],
        infos={name: np.array([[before[name]], [info[name]]]) for name in _INFOS},
    )


def _spec(plan: LabelPlan) -> gymnasium.envs.registration.EnvSpec:
    """Specification from which ``recover_environment`` makes an environment: the environment of
    this class, robot and terrain.
    """
    spec = copy.deepcopy(gymnasium.spec(_ENVIRONMENT))
    files = {"robot": plan.robot, "terrain": plan.terrain}
    spec.kwargs = {
        "problem": plan.distribution,
        **{name: file for name, file in files.items() if file is not None},
    }
    return spec


def _description(dataset: Dataset, room: float) -> str:
    plan = dataset.header.plan
    return (
        f"One-step episodes of {_ENVIRONMENT}, {dataset.problem_class}, seed {plan.seed}: the "
        "action is the smallest "
        f"box around the exact planner's [p, f], every side moved out by {room:g}; around an "
        "answer without the moment "
        f"balance where the posture is infeasible. Source data set {dataset.header.digest[:16]}."
    )


def _minari() -> Any:
    try:
        for name in ("h5py", "minari.data_collector"):
            importlib.import_module(name)
        return importlib.import_module("minari")
    except ImportError as error:
        raise not_installed("export", error.name, "data sets of Minari", "data") from None


@contextmanager
def _minari_root(root: Path) -> Iterator[None]:
    """Let Minari write below this folder only, and keep its advice on authors and links to
    itself.
    """
    before = os.environ.get("MINARI_DATASETS_PATH")
    os.environ["MINARI_DATASETS_PATH"] = str(root)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        if before is None:
            del os.environ["MINARI_DATASETS_PATH"]
        else:
            os.environ["MINARI_DATASETS_PATH"] = before
