"""A surrogate of feasibility for one class of problems: says feasible, infeasible or "ask", at an
error that is stated, and how far from the border. It is learned from labelled rows, and calibrated
on rows of each class that it has not seen.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveInt
from torch import Tensor, nn
from torch.nn import functional

from stancekit.planners.arguments import cached_property
from stancekit.planners.equilibrium.batch import PointBatch, ScaledBatch, slacks
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.codec import ALL_KEYS
from stancekit.planners.files.documents import (
    check_fields,
    file_or_named,
    parse_json,
    validated,
)
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.relaxation.envelope import check_learned

from ..selectors.network import (
    Architecture,
    AttentionBlock,
    Epochs,
    load_weights,
    read_tensors,
    undisturbed,
    write_tensors,
)
from ..training.loop import Checkpoint, StepsDone, run
from ..zoo import shipped
from .calibration import (
    ALARM,
    BINS,
    CONFIDENCE,
    KINDS,
    Likeness,
    Screened,
    checked_error,
    thresholds,
)
from .features import CORNER, TOKEN, Features, Seer

if TYPE_CHECKING:
    from stancekit.envs.data.dataset import Dataset

_CLIP = 8.0
"""Standard deviations beyond which a feature counts for no more."""


class SurrogateNetwork(nn.Module):
    """Scenes to a score, above 0 where feasible is likelier, and a margin, shape (B,) each.

    One token per contact without a position, so that the order of the contacts changes nothing, and
    means over the corners of a patch, so that theirs does not either.
    """

    token_mean: Tensor
    token_scale: Tensor
    corner_mean: Tensor
    corner_scale: Tensor

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        width, corner = architecture.width, architecture.corner_width
        for name, size in (("token", TOKEN), ("corner", CORNER)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_scale", torch.ones(size))
        self.corners = nn.Sequential(nn.Linear(CORNER, corner), nn.SiLU())
        self.embed = nn.Sequential(
            nn.Linear(TOKEN + 2 * corner, width), nn.SiLU(), nn.Linear(width, width)
        )
        self.blocks = nn.ModuleList(
            AttentionBlock(width, architecture.heads) for _ in range(architecture.layers)
        )
        self.head = nn.Sequential(
            nn.LayerNorm(2 * width), nn.Linear(2 * width, width), nn.SiLU(), nn.Linear(width, 2)
        )

    def fit_scales(self, tokens: Tensor, corners: Tensor) -> None:
        """Set the scales of the inputs from scenes like these."""
        for name, values in (("token", tokens), ("corner", corners)):
            flat = values.reshape(-1, values.shape[-1])
            setattr(self, f"{name}_mean", flat.mean(dim=0))
            setattr(self, f"{name}_scale", flat.std(dim=0).clamp(min=1e-3))

    def forward(self, tokens: Tensor, corners: Tensor) -> tuple[Tensor, Tensor]:
        """Score and margin.

        Arguments:
            tokens: shape (B, N, ``TOKEN``).
            corners: (B, N, U, ``CORNER``).
        """
        seen = ((corners - self.corner_mean) / self.corner_scale).clamp(-_CLIP, _CLIP)
        patch = self.corners(seen)
        patch = torch.cat([patch.mean(dim=2), patch.amax(dim=2)], dim=-1)
        of_contact = ((tokens - self.token_mean) / self.token_scale).clamp(-_CLIP, _CLIP)
        hidden: Tensor = self.embed(torch.cat([of_contact, patch], dim=-1))
        for block in self.blocks:
            hidden = block(hidden)
        out = self.head(torch.cat([hidden.mean(dim=1), hidden.amax(dim=1)], dim=-1))
        return out[:, 0], out[:, 1]


FORMAT = "stancekit/surrogate/2"
CHUNK = 1024
"""Problems whose scores are worked out at once."""
_BEYOND = 0.01
"""Distance beyond the numbers that were calibrated on a problem's may lie, in shares of their
range."""
_NEAR = 1e-3
"""Scores this close to a limit are worked out again in double precision, so that an answer does not
depend on which problems were scored together."""
_NUMBERS = ("x", "y", "z", "normal x", "normal y", "normal z", "friction")
CLIPPED = 0.1
"""The largest margin that is told."""


class Surrogate:
    """A trained network for one class of problems, and the scores of the rows that it was
    calibrated on.

    Arguments:
        like: a problem of the class.
        problem_class: its name.
        calibration: scores of held-out rows by their true class, ascending, single precision.
        ranges: least and largest number of each kind in the rows, see ``numbers``.
        likeness: histograms of the numbers and scores of the held-out rows.
        provenance: how it was learned, its card.
    """

    def __init__(
        self,
        network: SurrogateNetwork,
        *,
        like: Problem,
        problem_class: str,
        calibration: Mapping[str, Array],
        ranges: Array,
        likeness: Likeness | None = None,
        provenance: Mapping[str, Any] | None = None,
    ) -> None:
        self.network = network.eval()
        self.like, self.problem_class = like, problem_class
        self.calibration = {
            kind: np.sort(np.asarray(calibration[kind], dtype=np.float32)).astype(np.float64)
            for kind in KINDS
        }
        self.ranges = np.asarray(ranges, dtype=np.float64)
        columns = self.ranges[0].size + 1
        self.likeness = likeness or Likeness.of({kind: np.zeros((0, columns)) for kind in KINDS})
        self.provenance = dict(provenance or {})
        self.robot, self.legs = like.robot.identity, like.legs
        self.force_scale_n = float(like.force_scale_n or like.weight_n)
        self.length_scale_m = like.length_scale_m

    @cached_property
    def digest(self) -> str:
        """SHA-256 of class, network and calibration: what its answers follow from."""
        so_far = hashlib.sha256(f"{FORMAT} {self.problem_class} {self._like_text}".encode())
        so_far.update(json.dumps(asdict(self.network.architecture), sort_keys=True).encode())
        for name, tensor in sorted(self.network.state_dict().items()):
            so_far.update(name.encode() + tensor.numpy().tobytes())
        for kind in KINDS:
            so_far.update(kind.encode() + self.calibration[kind].tobytes())
        for array in (self.ranges, self.likeness.edges, self.likeness.counts):
            so_far.update(array.tobytes())
        return so_far.hexdigest()

    @cached_property
    def _like_text(self) -> str:
        return json.dumps(self.like.to_json(), sort_keys=True)

    @cached_property
    def seer(self) -> Seer:
        """The function that turns problems of its class into features."""
        return Seer.of(self.like)

    def thresholds(self, error: float) -> tuple[float, float]:
        """(low, high) of the score: below low infeasible, above high feasible, at this error."""
        return thresholds(self.calibration, error)

    @property
    def least_error(self) -> float:
        """The smallest error at which it says anything, by the number of rows of its
        calibration; 1 without any.
        """
        there = [len(rows) for rows in self.calibration.values() if len(rows)]
        if not there:
            return 1.0
        doubt = (1.0 - CONFIDENCE) / len(there)
        return min(-math.expm1(math.log(doubt) / count) for count in there)

    def check_fits(self, problem: Problem) -> None:
        """Raise InvalidInput unless the problem differs in its patches alone from those that it
        learned from.
        """
        learned = f"a surrogate learned for {self.problem_class}"
        if not problem.is_posture:
            raise InvalidInput(f"problem: expected a posture for {learned}, got a course")
        check_learned(self, problem, learned)
        mine, theirs = _fixed(self.like), _fixed(problem)
        for name, value in mine.items():
            if not np.array_equal(np.shape(value), np.shape(theirs[name])) or not np.allclose(
                value, theirs[name], rtol=1e-9, atol=1e-9
            ):
                raise InvalidInput(
                    f"{name}: expected that of {self.problem_class} for {learned}, got another"
                )

    def check_drawn(self, name: str, problem: Problem) -> None:
        """Raise InvalidInput unless it learned from the class of this name."""
        if name != self.problem_class:
            raise InvalidInput(
                f"screen: expected a surrogate for {name}, got one for {self.problem_class}"
            )
        self.check_fits(problem)

    def screen(self, batch: PostureBatch, error: float) -> Screened:
        """Answers at this error; "ask" also of a problem that lies beyond the rows of the
        calibration, and of all problems of a batch that is not drawn as its class is.

        Raises InvalidInput for problems of another class or robot.
        """
        checked_error(error)
        self.check_fits(batch.like)
        answered = self.answered(batch, self.thresholds(error), error)
        unlike, worst = self.likeness.unlike(self.compared(batch, answered.scores))
        if unlike > ALARM:
            return answered
        kinds = [kind for kind in KINDS if len(self.calibration[kind])]
        shifted = (
            f"problems: expected draws of {self.problem_class}, with any share of "
            f"{', '.join(kinds)} ones, got "
            f"others: {self._name_of(worst)} differ most, p < {max(unlike, 1e-99):.0e}"
        )
        return replace(answered, answers=np.full(len(batch), "ask"), shifted=shifted)

    def compared(self, batch: PostureBatch, scores: Array) -> Array:
        """Numbers of problems that are compared with those of the calibration, shape (B, C): of
        their patches, and their scores.
        """
        return np.column_stack([numbers(batch).reshape(len(batch), self.ranges[0].size), scores])

    def _name_of(self, column: int) -> str:
        """Name of a number that is compared."""
        if column == self.ranges[0].size:
            return "scores"
        limb, which = divmod(column, self.ranges.shape[2])
        name = _NUMBERS[which] if which < len(_NUMBERS) else "corners"
        return f"{name} of {self.legs[limb]}"

    def answered(self, batch: PostureBatch, limits: tuple[float, float], error: float) -> Screened:
        """``screen`` with thresholds that are known, of problems that fit."""
        (low, high), within = limits, self._within(batch)
        scores, margins = self.scores(batch)
        near = np.flatnonzero(np.minimum(np.abs(scores - low), np.abs(scores - high)) < _NEAR)
        if len(near):
            seen = self.seer.features(_part(batch, near))
            scores[near] = _run(self._double, seen, torch.float64)[0]
        answers = np.where(scores > high, "feasible", np.where(scores < low, "infeasible", "ask"))
        if low > high:  # both answers would be good enough: the likelier one
            between = (scores > high) & (scores < low)
            answers = np.where(between & (scores < 0.0), "infeasible", answers)
        answers = np.where(within, answers, "ask")
        return Screened(
            answers=answers,
            margins=np.clip(margins, -CLIPPED, CLIPPED),
            scores=scores,
            error=error,
            confidence=CONFIDENCE,
        )

    def scores(self, batch: PostureBatch) -> tuple[Array, Array]:
        """Scores and margins, shape (B,) each, of problems that fit."""
        parts = []
        for begin in range(0, len(batch), CHUNK):
            chosen = np.arange(begin, min(begin + CHUNK, len(batch)))
            seen = self.seer.features(_part(batch, chosen))
            parts.append(_run(self.network, seen, torch.float32))
        if not parts:
            return np.zeros(0), np.zeros(0)
        scores, margins = (np.concatenate(part) for part in zip(*parts, strict=True))
        return scores, margins

    @cached_property
    def _double(self) -> SurrogateNetwork:
        """The network in double precision."""
        return copy.deepcopy(self.network).double()

    def _within(self, batch: PostureBatch) -> NDArray[np.bool_]:
        """Tell whether each problem's patches are like those that it was calibrated on."""
        values = numbers(batch)
        if values.shape[1:] != self.ranges.shape[1:]:
            raise InvalidInput(
                f"contacts: expected patches of {self.ranges.shape[2] - len(_NUMBERS)} corners, got "
                f"{values.shape[2] - len(_NUMBERS)}"
            )
        room = _BEYOND * (self.ranges[1] - self.ranges[0]) + 1e-9
        return np.asarray(
            ((values >= self.ranges[0] - room) & (values <= self.ranges[1] + room)).all(axis=(1, 2))
        )

    def save(self, path: str | Path) -> None:
        """Write a safetensors file: network, calibration and card."""
        header = {
            "problem_class": self.problem_class,
            "like": self.like.to_json(),
            "robot": self.robot,
            "digest": self.digest,
            "architecture": asdict(self.network.architecture),
            "provenance": self.provenance,
        }
        extra: dict[str, Array] = {
            **{f"calibration.{kind}": self.calibration[kind].astype(np.float32) for kind in KINDS},
            "ranges": self.ranges,
            "likeness.edges": self.likeness.edges,
            "likeness.counts": self.likeness.counts,
        }
        tensors = {name: torch.from_numpy(values.copy()) for name, values in extra.items()}
        weights = {f"network.{name}": each for name, each in self.network.state_dict().items()}
        write_tensors(path, FORMAT, header, weights | tensors)

    write = save

    @classmethod
    def of(cls, surrogate: Any) -> Surrogate:
        """A surrogate, or that of a file.

        Raises InvalidInput.
        """
        if isinstance(surrogate, Surrogate):
            return surrogate
        if not isinstance(surrogate, str | Path):
            raise InvalidInput(
                "surrogate: expected what fit(rows, 'surrogate') returned, or its file, got "
                f"{surrogate!r:.80}"
            )
        return cls.read(surrogate)

    @classmethod
    @undisturbed()
    def read(cls, path: str | Path) -> Surrogate:
        """Read what ``save`` wrote.

        Raises InvalidInput for a file that is damaged or foreign.
        """
        header, tensors = read_tensors(path, FORMAT)
        raw = validated(_Header, header, str(path))
        try:
            like = Problem.from_json(raw.like, robot=None)
        except InvalidInput as error:
            raise InvalidInput(f"{path}: like: {error}") from None
        if not like.is_posture or like.robot.identity != raw.robot:
            raise InvalidInput(f"{path}: like: expected a posture of the robot {raw.robot!r}")
        weights = {
            name.removeprefix("network."): each
            for name, each in tensors.items()
            if name.startswith("network.")
        }
        rest = {name: each for name, each in tensors.items() if not name.startswith("network.")}
        wanted = {"ranges", "likeness.edges", "likeness.counts"}
        wanted |= {f"calibration.{kind}" for kind in KINDS}
        if set(rest) != wanted or any(rest[f"calibration.{kind}"].ndim != 1 for kind in KINDS):
            raise InvalidInput(
                f"{path}: expected the tensors {', '.join(sorted(wanted))}, got something else"
            )
        if rest["ranges"].ndim != 3 or rest["ranges"].shape[:2] != (2, len(like.contacts)):
            raise InvalidInput(
                f"{path}: tensor ranges: expected two rows per contact, got something else"
            )
        edges, counts = (rest[f"likeness.{name}"].double().numpy() for name in ("edges", "counts"))
        columns = rest["ranges"][0].numel() + 1
        if edges.shape != (columns, BINS - 1) or counts.shape != (len(KINDS), columns, BINS):
            raise InvalidInput(
                f"{path}: tensors likeness.*: expected {columns} histograms per class, got something else"
            )
        every = [edges, counts, *(rest[name].double().numpy() for name in wanted)]
        if not all(np.isfinite(each).all() for each in every) or (counts < 0.0).any():
            raise InvalidInput(f"{path}: expected finite numbers, and counts of 0 or more")
        with torch.device("meta"):
            network = SurrogateNetwork(raw.architecture)
        load_weights(network, weights, path)
        surrogate = cls(
            network,
            like=like,
            problem_class=raw.problem_class,
            calibration={kind: rest[f"calibration.{kind}"].double().numpy() for kind in KINDS},
            ranges=rest["ranges"].double().numpy(),
            likeness=Likeness(edges=edges, counts=counts),
            provenance=raw.provenance,
        )
        if surrogate.digest != raw.digest:
            raise InvalidInput(
                f"{path}: digest: expected {surrogate.digest[:12]}… as its content has it, got "
                f"{raw.digest[:12]}…"
            )
        return surrogate


class _Header(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    problem_class: str
    like: dict[str, Any]
    robot: str
    digest: str
    architecture: Annotated[Architecture, ALL_KEYS]
    provenance: dict[str, Any]


def numbers(batch: PostureBatch) -> Array:
    """Numbers of every patch by which a problem is known to be like others, shape (B, N, 7 + U):
    ``_NUMBERS``, and its corners' distances from the middle, ascending.
    """
    middle = batch.vertices_m.mean(axis=2)
    spokes = np.sort(np.linalg.norm(batch.vertices_m - middle[:, :, None], axis=-1), axis=-1)
    return np.concatenate([middle, batch.normals, batch.friction[..., None], spokes], axis=-1)


def as_batch(problems: Sequence[Problem] | PostureBatch) -> PostureBatch:
    """Problems as a batch.

    Raises InvalidInput where they differ in more than their patches.
    """
    if isinstance(problems, PostureBatch):
        return problems
    for index, problem in enumerate(problems):
        if not problem.is_posture:
            raise InvalidInput(f"problems[{index}]: expected a posture, got a course")
    return PostureBatch.stacked(list(problems))


@undisturbed()
def _run(network: SurrogateNetwork, features: Features, dtype: torch.dtype) -> tuple[Array, Array]:
    """Scores and margins in this precision."""
    with torch.no_grad():
        score, margin = network(*(torch.from_numpy(each).to(dtype) for each in features))
    return score.double().numpy(), margin.double().numpy()


def _part(batch: PostureBatch, chosen: NDArray[np.intp]) -> PostureBatch:
    """Some of a batch's patches, without frames."""
    return PostureBatch(
        like=batch.like,
        vertices_m=batch.vertices_m[chosen],
        normals=batch.normals[chosen],
        friction=batch.friction[chosen],
        convex=True,
    )


def _fixed(problem: Problem) -> dict[str, Any]:
    """Numbers of a problem that are the same in all of its class, by name."""
    contacts = problem.contacts
    none = np.zeros((1, 6))
    return {
        "mass_kg": problem.mass_kg,
        "gravity_m_s2": problem.gravity_m_s2,
        "com_nominal_m": problem.com_nominal_m,
        "com_radius_m": problem.com_radius_m,
        "tilt_limit_rad": problem.tilt_limit_rad,
        "wrench": none if problem.wrench is None else problem.wrench,
        **{
            name: np.array([getattr(contact, name) for contact in contacts])
            for name in ("shoulder_m", "reach_m", "force_min", "force_max")
        },
        "shear_reference": np.array([contact.patch.shear_reference for contact in contacts]),
        "reach_rows": np.concatenate(
            [np.zeros((0, 4))]
            + [
                np.column_stack([contact.reach_rows.normals, contact.reach_rows.bounds_m])
                for contact in contacts
                if contact.reach_rows is not None
            ]
        ),
    }


def surrogate_of(given: Any) -> Surrogate:
    """A surrogate: itself, that of a file, or the shipped one of a name.

    Raises InvalidInput.
    """
    if isinstance(given, str | Path):
        return Surrogate.read(file_or_named(given, shipped("surrogates")))
    return Surrogate.of(given)


def surrogate_for(problem: Problem) -> Surrogate:
    """The surrogate that ships for problems like this one.

    Raises InvalidInput where none does.
    """
    files = shipped("surrogates")
    for path in files.values():
        surrogate = Surrogate.read(path)
        try:
            surrogate.check_fits(problem)
        except InvalidInput:
            continue
        return surrogate
    raise InvalidInput(
        f"surrogate: expected a surrogate or its file, since none of those that ship "
        f"({', '.join(files)}) is for problems like these, got none: "
        "stancekit.fit(rows, 'surrogate') learns one"
    )


COLUMNS = ["problem", "label", "trivial", "lower_bound", "com_m", "rotation_rad", "toes_m"]
COLUMNS += ["forces_n"]
FARTHEST = 0.1
"""Margins beyond this count as this: near to the border is what matters."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledBatch:
    """Posture problems with their labels.

    Arguments:
        kinds: "feasible", "infeasible" or "trivial", shape (B,).
        margins: of a feasible one the least room that its witness has, of an infeasible one minus
            the moment that its proof says cannot be balanced, non-dimensional, shape (B,).
        screened: whether a row is of a screened set, which may teach and not calibrate, shape (B,);
            None for none.
    """

    batch: PostureBatch
    kinds: NDArray[np.str_]
    margins: Array
    screened: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.kinds)

    @classmethod
    def of(cls, datasets: Sequence[Dataset]) -> LabelledBatch:
        """The decided rows of data sets of one class, each problem once.

        Raises InvalidInput for rows of several classes or robots, and for rows on other than
        triangles.
        """
        _check_alike(datasets)
        first = datasets[0]
        like = next(iter(first.problems()), None)
        if like is None:
            raise InvalidInput(f"{first.ledger.folder}: expected labelled rows, got none")
        seen, patches, kinds, margins, screened = set[str](), [], [], [], []
        postures: dict[int, list[Array]] = {}
        for one in datasets:
            for raw in _raw(one):
                if raw["problem"] in seen or raw["label"] == "undecided":
                    continue
                seen.add(raw["problem"])
                contacts = parse_json(raw["problem"], "problem")["contacts"]
                patches.append([(c["vertices_m"], c["normal"], c["friction"]) for c in contacts])
                kinds.append("trivial" if raw["trivial"] else raw["label"])
                screened.append(one.header.plan.screen is not None)
                bound = float(raw["lower_bound"] or 0.0)
                margins.append(-1.0 if raw["trivial"] or not np.isfinite(bound) else -bound)
                if raw["label"] == "feasible" and raw["com_m"] is not None:
                    postures[len(kinds) - 1] = [
                        np.array(raw[name])
                        for name in ("com_m", "rotation_rad", "toes_m", "forces_n")
                    ]
        try:
            vertices, normals, friction = (
                np.array([[contact[k] for contact in row] for row in patches]) for k in range(3)
            )
        except ValueError:
            raise InvalidInput(
                f"{first.ledger.folder}: expected patches of as many corners each, got something else"
            ) from None
        batch = PostureBatch(like=like, vertices_m=vertices, normals=normals, friction=friction)
        values = np.array(margins)
        if postures:
            values[list(postures)] = _rooms(batch, postures)
        return cls(
            batch=batch,
            kinds=np.array(kinds, dtype=np.str_),
            margins=np.clip(values, -FARTHEST, FARTHEST),
            screened=np.array(screened) if any(screened) else None,
        )

    def select(self, chosen: NDArray[np.intp]) -> LabelledBatch:
        """Some of them, by index."""
        return LabelledBatch(
            batch=self.batch.select(chosen),
            kinds=self.kinds[chosen],
            margins=self.margins[chosen],
            screened=None if self.screened is None else self.screened[chosen],
        )

    def without(self, other: LabelledBatch) -> LabelledBatch:
        """Rows that are not in another batch."""
        seen = {corners.tobytes() for corners in other.batch.vertices_m}
        fresh = [k for k, each in enumerate(self.batch.vertices_m) if each.tobytes() not in seen]
        return self.select(np.array(fresh, dtype=np.intp))


def _check_alike(datasets: Sequence[Dataset]) -> None:
    """Raise InvalidInput unless data sets are of one class, robot and legs."""
    first = datasets[0]
    for other in datasets[1:]:
        for name in ("problem_class", "robot"):
            mine, theirs = (getattr(one, name) or "the default hexapod" for one in (first, other))
            if mine != theirs:
                raise InvalidInput(
                    f"data sets: expected rows of one class and robot, got {mine} and {theirs}"
                )
        if other.header.legs != first.header.legs:
            raise InvalidInput(
                f"data sets: expected rows of the same legs, got {first.header.legs} and "
                f"{other.header.legs}"
            )


def _raw(dataset: Dataset) -> list[dict[str, Any]]:
    """Columns of the chosen rows."""
    shards = range(dataset.header.plan.shards)
    rows = [row for k in shards for row in dataset.ledger.read(k, COLUMNS).to_pylist()]
    return [rows[k] for k in dataset.chosen.tolist()]


def _rooms(batch: PostureBatch, postures: dict[int, list[Array]]) -> Array:
    """The least room of witnesses, by the index of their problem."""
    index = np.array(list(postures), dtype=np.intp)
    some = ScaledBatch.of(batch.select(index))
    one, contacts = some.like, batch.like.contacts
    com, rotation, toes, forces = (np.array(part) for part in zip(*postures.values(), strict=True))
    shape = (len(index), len(contacts), 3)
    turned = np.matmul(some.frames.swapaxes(2, 3), forces.reshape(shape)[..., None])[..., 0]
    points = PointBatch(
        com=com.reshape(-1, 3) / one.length_m,
        rotation=rotation.reshape(-1, 3),
        toes=toes.reshape(shape) / one.length_m,
        forces=turned / one.force_n,
    )
    return np.asarray(slacks(some, points, list(Seer.of(batch.like).half_spaces)).min(axis=1))


_WARM = 0.1
"""Share of the steps in which the rate grows."""


@dataclass(frozen=True, kw_only=True)
class SurrogateSettings:
    """Settings of learning a surrogate.

    Arguments:
        width, layers, heads: size of the network.
        epochs: passes over the rows.
        batch: rows per step.
        rate: of AdamW.
        decay: of its weights.
        calibration: share of the rows of each class that is kept to calibrate on: more of them hold
            a smaller error, fewer teach more.
        margin: weight of the loss of the margin beside that of the answer.
        seed: of weights, batches and parts.
    """

    width: PositiveInt = 64
    layers: PositiveInt = 2
    heads: PositiveInt = 4
    epochs: PositiveInt = 40
    batch: PositiveInt = 256
    rate: Annotated[float, Field(gt=0.0, le=10.0)] = 2e-3
    decay: Annotated[float, Field(ge=0.0)] = 1e-2
    calibration: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.35
    margin: Annotated[float, Field(ge=0.0)] = 0.3
    seed: Annotated[int, Field(ge=0)] = 0

    def __post_init__(self) -> None:
        check_fields(self)


def fit_surrogate(
    datasets: Sequence[Dataset],
    settings: SurrogateSettings = SurrogateSettings(),
    progress: StepsDone | None = None,
    *,
    calibration: Dataset | None = None,
    checkpoint: Path | None = None,
) -> Surrogate:
    """Learn from the rows of data sets of one class.

    Arguments:
        checkpoint: file to go on from when learning was stopped.
        calibration: rows to calibrate on, besides the part of the others that is kept for that.

    Raises:
        InvalidInput: where feasible or infeasible rows are missing, or rows to calibrate on.
    """
    rows = LabelledBatch.of(datasets)
    origin = [one.origin for one in datasets]
    held = None
    if calibration is not None:
        _check_alike([datasets[0], calibration])
        held = LabelledBatch.of([calibration])
        if held.screened is not None:
            raise InvalidInput(
                "calibration: expected rows as they are drawn, got screened ones of "
                f"{calibration.ledger.folder}"
            )
        held = held.without(rows)
        origin.append(calibration.origin)
    surrogate = fit_rows(
        rows,
        settings,
        progress,
        problem_class=datasets[0].problem_class,
        origin={"datasets": origin},
        held=held,
        checkpoint=checkpoint,
    )
    if not any(map(len, surrogate.calibration.values())):
        raise InvalidInput(
            "calibration: expected rows as they are drawn, not screened ones, to calibrate on, got a "
            f"share of {settings.calibration:g} of {len(rows)} rows, which has none: more rows, a "
            "larger share, or a data set for it"
        )
    return surrogate


@undisturbed()
def fit_rows(
    rows: LabelledBatch,
    settings: SurrogateSettings,
    progress: StepsDone | None = None,
    *,
    problem_class: str,
    origin: dict[str, Any],
    held: LabelledBatch | None = None,
    checkpoint: Path | None = None,
) -> Surrogate:
    """Learn from labelled problems.

    Arguments:
        held: further rows to calibrate on.
    """
    begin = time.process_time()
    known = {kind: int((rows.kinds == kind).sum()) for kind in KINDS}
    if not known["feasible"] or not known["infeasible"] + known["trivial"]:
        counts = ", ".join(f"{count} {kind}" for kind, count in known.items())
        raise InvalidInput(f"data set: expected feasible and infeasible rows, got {counts}")
    learned, held_out = _parts(rows, settings.calibration, settings.seed)
    if len(set((rows.kinds[learned] == "feasible").tolist())) < 2:
        raise InvalidInput(
            "calibration: expected a share that leaves feasible and infeasible rows to learn "
            "from, got "
            f"{settings.calibration:g} of {len(rows)} rows"
        )
    seer = Seer.of(rows.batch.like)
    seen = seer.features(rows.batch)
    with undisturbed(settings.seed):
        sizes = {name: getattr(settings, name) for name in ("width", "layers", "heads")}
        network = SurrogateNetwork(Architecture(**sizes))
        _train(
            network,
            Features(*(each[learned] for each in seen)),
            rows.select(learned),
            settings,
            progress,
            Checkpoint.of(checkpoint, {**origin, "settings": asdict(settings)}),
        )
    surrogate = Surrogate(
        network,
        like=rows.batch.like,
        problem_class=problem_class,
        calibration={kind: np.zeros(0) for kind in KINDS},
        ranges=_ranges(rows, held),
    )
    parts = [rows.select(held_out)] + ([] if held is None else [held])
    kinds = np.concatenate([part.kinds for part in parts])
    scores = [surrogate.scores(part.batch)[0] for part in parts]
    compared = [
        surrogate.compared(part.batch, each) for part, each in zip(parts, scores, strict=True)
    ]
    calibrated = {kind: np.concatenate(scores)[kinds == kind] for kind in KINDS}
    likeness = Likeness.of({kind: np.concatenate(compared)[kinds == kind] for kind in KINDS})
    return Surrogate(
        network,
        like=rows.batch.like,
        problem_class=problem_class,
        calibration=calibrated,
        ranges=surrogate.ranges,
        likeness=likeness,
        provenance={
            **origin,
            "method": "surrogate",
            "settings": asdict(settings),
            "learned_from": {kind: int((rows.kinds[learned] == kind).sum()) for kind in KINDS},
            "calibrated_on": {kind: len(each) for kind, each in calibrated.items()},
            "confidence": CONFIDENCE,
            "symmetries": len(seer.turns),
            "right_alone": _right_alone(calibrated),
            "cpu_s": round(time.process_time() - begin, 1),
        },
    )


def _parts(
    rows: LabelledBatch, share: float, seed: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows to learn from and rows to calibrate on, of each class its share, drawn by the seed;
    never screened ones, which are not as they are drawn.
    """
    rng, held_out = np.random.default_rng(seed), []
    plain = np.ones(len(rows), dtype=bool) if rows.screened is None else ~rows.screened
    for kind in KINDS:
        mine = np.flatnonzero((rows.kinds == kind) & plain)
        held_out.append(rng.permutation(mine)[: round(share * len(mine))])
    chosen = np.sort(np.concatenate(held_out))
    return np.setdiff1d(np.arange(len(rows)), chosen), chosen


def _train(
    network: SurrogateNetwork,
    seen: Features,
    rows: LabelledBatch,
    settings: SurrogateSettings,
    progress: StepsDone | None,
    checkpoint: Checkpoint | None,
) -> None:
    tokens, corners = map(torch.from_numpy, seen)
    network.fit_scales(tokens, corners)
    wanted = torch.from_numpy((rows.kinds == "feasible").astype(np.float32))
    margins = torch.from_numpy(rows.margins.astype(np.float32)) / FARTHEST
    share = float(wanted.mean())
    weights = torch.where(wanted > 0.0, 0.5 / share, 0.5 / (1.0 - share))
    weights = weights.clamp(max=20.0)

    def loss(part: Tensor) -> Tensor:
        score, margin = network(tokens[part], corners[part])
        return _loss(score, margin, wanted[part], margins[part], weights[part], settings.margin)

    chance = torch.Generator().manual_seed(settings.seed)
    knobs = {name: getattr(settings, name) for name in ("epochs", "batch", "rate", "decay")}
    run(Epochs(network, loss, len(wanted), chance, warm=_WARM, **knobs), progress, checkpoint)
    with torch.no_grad():  # margins come back in their own unit
        last = network.head[-1]
        assert isinstance(last, torch.nn.Linear)
        last.weight[1] *= FARTHEST
        last.bias[1] *= FARTHEST


def _loss(
    score: Tensor, margin: Tensor, wanted: Tensor, margins: Tensor, weights: Tensor, share: float
) -> Tensor:
    """Cross-entropy of the answers, both classes alike, and the margins' absolute error, smooth
    near 0.
    """
    answer = functional.binary_cross_entropy_with_logits(score, wanted, weight=weights)
    return answer + share * functional.smooth_l1_loss(margin, margins, beta=0.2)


def _ranges(rows: LabelledBatch, held: LabelledBatch | None) -> Array:
    """Least and largest of each number of the patches, shape (2, N, K)."""
    values = numbers(rows.batch)
    if held is not None:
        values = np.concatenate([values, numbers(held.batch)])
    return np.stack([values.min(axis=0), values.max(axis=0)])


def _right_alone(scores: dict[str, Array]) -> dict[str, float]:
    """Share of the rows of each class that the sign of the score alone gets right."""
    return {
        kind: round(float(np.mean((each > 0.0) == (kind == "feasible"))), 4)
        for kind, each in scores.items()
        if len(each)
    }
