"""Sources of an environment's scenes: labelled posture problems, drawn at random or listed."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import cached_property
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled, observe, observe_batch
from stancekit.planners.errors import InvalidInput, PlanningFailed, StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.problem.posture_batch import Sampler
from stancekit.planners.search.answer import Acceptance, plan_of
from stancekit.planners.search.batch import stands, unsupported
from stancekit.planners.search.cuts import CutSearch
from stancekit.planners.search.exact import Exact
from stancekit.planners.verify import check_certificates, check_postures
from stancekit.planners.verify.margins import MARGINS, stance_margins, verdict_yields_m
from stancekit.planners.verify.stance_margin import compiled

from .distributions.postures import Distribution, Repeatable, distribution_of


def margin_info(plan: Plan | None, prefix: str = "") -> dict[str, float]:
    """The least margins over the stances of a plan, under the names that they have in a report;
    zeros without a plan.

    Arguments:
        prefix: prefix of the keys.
    """
    if plan is None:
        return {f"{prefix}{name}": 0.0 for name in MARGINS}
    compiled()  # as there are many steps
    found = stance_margins(plan, yields_m=verdict_yields_m(plan))
    return {f"{prefix}{name}": float(values.min()) for name, values in found.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledScene:
    """One problem with the expert's answer.

    Arguments:
        feasible: the label.
        posture: the expert's witness, None where infeasible.
        lower_bound: bound that the expert's certificate proves, if infeasible.
        expert_seconds: 0 where the label was read from a data set.
    """

    problem: Problem
    feasible: bool
    posture: Plan | None
    lower_bound: float = 0.0
    expert_seconds: float = 0.0

    @cached_property
    def scaled(self) -> Scaled:
        """The numbers of the problem."""
        return Scaled.of(self.problem)

    @cached_property
    def observation(self) -> dict[str, NDArray[np.float32]]:
        """Observation of the scene (``features.observe``); not to be written to."""
        return observe(self.scaled)

    @cached_property
    def point(self) -> Array:
        """[p, f] of the witness (``Scaled.point``), zeros where there is none, shape (N, 6)."""
        if self.posture is None:
            return np.zeros((len(self.problem.contacts), 6))
        return self.scaled.point(self.posture)

    @cached_property
    def margins(self) -> dict[str, float]:
        """Margins of the witness (``margin_info``), under the keys of ``info``; measured when first
        asked for.
        """
        return margin_info(self.posture, "expert_")


def seen(scene: LabelledScene) -> dict[str, NDArray[np.float32]]:
    """The observation of a scene, in arrays of its own."""
    return {name: values.copy() for name, values in scene.observation.items()}


def all_seen(scenes: Sequence[LabelledScene]) -> dict[str, NDArray[np.float32]]:
    """The observations of scenes of one size, a row each."""
    return {
        name: np.stack([scene.observation[name] for scene in scenes])
        for name in scenes[0].observation
    }


@dataclass(frozen=True, kw_only=True)
class SceneKind:
    """Class of scenes that come from elsewhere, such as a data set: their class by name, and their
    limbs.
    """

    name: str
    legs: tuple[str, ...]


class _SceneSource(Protocol):
    """Anything that hands out scenes."""

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Return the next scene."""


@runtime_checkable
class _Rows(Protocol):
    """A ``Dataset``, whose module takes a while to load."""

    def rows(self) -> Iterator[Any]:
        """Its rows."""

    def only(self, part: Any) -> Any:
        """Those of a part."""


class ListedScenes:
    """Given scenes in their order, over and over; for evaluation."""

    def __init__(self, scenes: Sequence[LabelledScene]) -> None:
        self.deal(scenes)

    def deal(self, scenes: Sequence[LabelledScene]) -> None:
        """Hand out these from now on.

        Raises InvalidInput where there are none.
        """
        if not scenes:
            raise InvalidInput("scenes: expected one or more, got none")
        self._scenes = tuple(scenes)
        self._next = 0

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Return the next scene of the list; ``rng`` is not used."""
        scene = self._scenes[self._next % len(self._scenes)]
        self._next += 1
        return scene


MAX_DRAWS = 10_000
"""Problems that a scene may take."""
MOST_AHEAD = 32
"""Scenes that are drawn together, at most."""
BLOCK = 16
"""Problems that are sampled together."""


class OneByOne:
    """Scenes sampled and decided one by one, each when it is asked for.

    The arguments are those of ``SampledScenes``.

    What ``SampledScenes`` gives is held equal to this.
    """

    def __init__(
        self, distribution: Distribution, *, balanced: bool = True, programs: Programs | None = None
    ) -> None:
        self._distribution, self._balanced = distribution, balanced
        self._expert = Exact(programs=programs)

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Draw a scene.

        Raises PlanningFailed where a label does not come up in MAX_DRAWS draws.
        """
        wanted = bool(rng.integers(2))
        for _ in range(MAX_DRAWS):
            problem = self._distribution.sample(rng)
            outcome = self._expert.solve(problem)
            if outcome.status is Status.UNDECIDED:
                continue
            scene = LabelledScene(
                problem=problem,
                feasible=outcome.status is Status.FEASIBLE,
                posture=outcome.solution,
                lower_bound=outcome.bound,
                expert_seconds=outcome.effort.seconds,
            )
            if not self._balanced or (scene.feasible == wanted and not outcome.details["trivial"]):
                return scene
        raise _never(self._distribution)


class SampledScenes:
    """Scenes sampled from a distribution and labelled by the exact planner.

    A generator is left as it would be if only the scene that was asked for had been drawn, and who
    draws from it meanwhile, or seeds it anew, has what was drawn ahead forgotten. A distribution
    whose draws cannot be repeated, and a generator whose state is no PCG64's, are drawn from one by
    one.

    Arguments:
        balanced: toss a coin for the label and draw until it comes, leaving out what is infeasible
            even without its moment balance; else scenes come at their natural rates. Undecided
            problems are drawn again.
        ahead: scenes that are drawn together, at most; a source that is asked with ever new
            generators draws fewer.
    """

    def __init__(
        self,
        distribution: Distribution,
        *,
        balanced: bool = True,
        programs: Programs | None = None,
        ahead: int = MOST_AHEAD,
    ) -> None:
        programs = programs or Programs()
        self._distribution, self._balanced = distribution, balanced
        self._expert = Exact(programs=programs)
        self._one_by_one = OneByOne(distribution, balanced=balanced, programs=programs)
        self._source = distribution if isinstance(distribution, Repeatable) else None
        self._whole = bool(getattr(distribution, "whole_words", False))
        self._most, self._count = ahead, 1
        self._ahead: deque[_Drawn] = deque()
        self._like: tuple[Problem, Scaled] | None = None  # of the last batch, and its numbers
        self._rest: _Block | None = None
        self._last: Any = None  # state of the generator after the scene that was handed out last

    def __copy__(self) -> SampledScenes:
        """A source of the same that keeps its own scenes ahead and shares the compiled models."""
        programs = self._expert.kept
        return SampledScenes(
            self._distribution, balanced=self._balanced, programs=programs, ahead=self._most
        )

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Draw a scene.

        Raises PlanningFailed where a label does not come up in MAX_DRAWS draws.
        """
        if self._source is None or not isinstance(rng.bit_generator, np.random.PCG64):
            return self._one_by_one.draw(rng)
        state = rng.bit_generator.state
        if not self._ahead or self._ahead[0].before != state:
            self._count = min(self._most, 2 * self._count) if state == self._last else 1
            self._ahead = deque(self._draw_ahead(rng, self._source))
        scene = self._ahead.popleft()
        rng.bit_generator.state = self._last = scene.after
        return scene.scene

    def _draw_ahead(self, rng: np.random.Generator, source: Repeatable) -> list[_Drawn]:
        """The next scenes, one at least.

        Raises what drawing the first of them raises.
        """
        claims: list[_Claim] = []
        while len(claims) < self._count:
            before, wanted = rng.bit_generator.state, bool(rng.integers(2))
            try:
                claim = self._next(rng, source, wanted)
            except StancekitError:
                if not claims:
                    raise
                break  # it is raised when its turn comes
            claims.append(replace(claim, before=before, after=rng.bit_generator.state))
        draws = _verified(claims, self._expert.acceptance)
        if draws:
            return draws
        rng.bit_generator.state = claims[
            0
        ].before  # the verifier refused the first: rare, and not worth a block
        before, scene = claims[0].before, self._one_by_one.draw(rng)
        return [_Drawn(scene=scene, before=before, after=rng.bit_generator.state)]

    def _next(self, rng: np.random.Generator, source: Repeatable, wanted: bool) -> _Claim:
        """The claim of the next scene; the generator is left behind its draw."""
        left = MAX_DRAWS
        while left:
            block, state = self._block(rng, source, left), rng.bit_generator.state
            count = min(left, len(block.batch) - block.next)
            for k in range(block.next, block.next + count):
                claim = (
                    None
                    if block.hopeless[k]
                    else self._claimed(block.batch, block.scaled, k, wanted)
                )
                if claim is not None:
                    rng.bit_generator.state = (
                        {**state, "state": block.begin["state"]} if self._whole else block.begin
                    )
                    source.skip(rng, k + 1)
                    self._rest = replace(block, next=k + 1, at=rng.bit_generator.state["state"])
                    return claim
            rng.bit_generator.state = {**state, "state": block.end} if self._whole else state
            self._rest, left = None, left - count
        raise _never(self._distribution)

    def _block(self, rng: np.random.Generator, source: Repeatable, most: int) -> _Block:
        """The problems that come next, what is left of those sampled last or others.

        Raises what sampling one raises.

        A coin takes half a word of the generator, so every other one leaves the words to come where
        they were.
        """
        rest, begin = self._rest, rng.bit_generator.state
        if (
            self._whole
            and rest is not None
            and rest.at == begin["state"]
            and rest.next < len(rest.batch)
        ):
            return rest
        try:
            batch = source.batch(rng, min(most, BLOCK) if self._balanced else 1)
        except InvalidInput:  # the draw that fails may not come to its turn
            rng.bit_generator.state = begin
            batch = source.batch(rng, 1)
        scaled, end = self._scaled(batch), rng.bit_generator.state["state"]
        hopeless = (
            unsupported(scaled).tolist() if self._balanced else [False]
        )  # none of these is wanted
        return _Block(batch=batch, scaled=scaled, hopeless=hopeless, begin=begin, at=None, end=end)

    def _scaled(self, batch: PostureBatch) -> ScaledBatch:
        """Numbers of a batch; what problems of one ``like`` share is worked out once."""
        if self._like is None or self._like[0] is not batch.like:
            self._like = batch.like, ScaledBatch.of(batch).like
        return ScaledBatch.of(batch, self._like[1])

    def _claimed(
        self, batch: PostureBatch, scaled: ScaledBatch, k: int, wanted: bool
    ) -> _Claim | None:
        """Claim of the search about the k-th problem; None for a problem that cannot become the
        wanted scene.
        """
        begin, numbers = time.perf_counter(), scaled.problem(k)
        sought = (Status.FEASIBLE if wanted else Status.INFEASIBLE) if self._balanced else None
        if sought is Status.INFEASIBLE and stands(
            self._expert.kept, numbers, scaled.near_corners[k]
        ):
            return None
        search = self._expert.search(numbers, wanted=sought)
        feasible = search.found is not None
        if (search.stopped and not feasible) or (
            self._balanced and (feasible != wanted or search.trivial)
        ):
            return None
        seconds = time.perf_counter() - begin
        return _Claim(problem=batch.problem(k), scaled=numbers, search=search, seconds=seconds)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Block:
    """Problems that were sampled together.

    Arguments:
        next: number of the first problem that was not looked at.
        hopeless: truth values, True for problems of which even P̄ is infeasible.
        begin: state of the generator before the first problem.
        at, end: its words at the next one and after the last.
    """

    batch: PostureBatch
    scaled: ScaledBatch
    hopeless: list[bool]
    begin: Any
    at: Any
    end: Any
    next: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Claim:
    """A problem of a scene to come, what its search claims, and the generator's states before and
    after its draws.
    """

    problem: Problem
    scaled: Scaled
    search: CutSearch
    seconds: float
    before: Any = None
    after: Any = None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Drawn:
    """A scene, and the generator's states before and after its draws."""

    scene: LabelledScene
    before: Any
    after: Any


def _verified(claims: Sequence[_Claim], accept: Acceptance) -> list[_Drawn]:
    """The scenes of these claims, up to the first that the verifier refuses."""
    begin = time.perf_counter()
    places, proofs = dict[int, Plan](), dict[int, Certificate]()
    for k, claim in enumerate(claims):
        if claim.search.found is not None:
            places[k] = plan_of(claim.problem, claim.scaled, *claim.search.found)
        elif (proof := claim.search.certificate()) is not None:
            proofs[k] = proof.of(claim.problem)
    worst = check_postures(list(places.values()))
    bounds = check_certificates(list(proofs.values()))
    bound = dict(zip(proofs, bounds.tolist(), strict=True))
    right = {k for k, off in zip(places, worst.tolist(), strict=True) if off <= accept.tolerance}
    right |= {k for k, value in bound.items() if value > accept.gap}
    share, draws = (time.perf_counter() - begin) / len(claims), []
    seen = observe_batch([claim.scaled for claim in claims])
    for k, claim in enumerate(claims):
        if k not in right:
            break
        scene = LabelledScene(
            problem=claim.problem,
            feasible=k in places,
            posture=places.get(k),
            lower_bound=bound.get(k, 0.0),
            expert_seconds=claim.seconds + share,
        )
        vars(scene)["scaled"] = claim.scaled  # known already
        vars(scene)["observation"] = {name: values[k] for name, values in seen.items()}
        draws.append(_Drawn(scene=scene, before=claim.before, after=claim.after))
    return draws


def _never(distribution: Distribution) -> PlanningFailed:
    return PlanningFailed(f"{distribution.name}: no scene of the wanted label in {MAX_DRAWS} draws")


ProblemSource = str | Sampler | SceneKind
"""A distribution by name or as it is, as ``label`` takes it, or the kind of scenes that come from
elsewhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneSettings:
    """Keywords of the environments beside their problem: where scenes are from, and whether margins
    are measured; the page of ``EnvelopeSelectionEnv`` has their meaning.
    """

    robot: str | Path | None = None
    terrain: str | Path | None = None
    balanced: bool = True
    scenes: _SceneSource | _Rows | str | Path | None = None
    margins: bool = False

    def __post_init__(self) -> None:
        if (
            self.scenes is not None
            and not isinstance(self.scenes, str | Path | _Rows)
            and not self.balanced
        ):
            raise InvalidInput(
                "balanced: expected True beside a source of scenes, which draws as it likes, got "
                "False"
            )

    def kind(self, problem: ProblemSource) -> Distribution | SceneKind:
        """The distribution, or what is known of one; by name as ``distribution`` has it.

        Raises InvalidInput.
        """
        if not isinstance(problem, SceneKind):
            return distribution_of(problem, robot=self.robot, terrain=self.terrain)
        if self.robot is not None or self.terrain is not None:
            raise InvalidInput(
                f"robot, terrain: expected none beside {problem.name}, which has its own"
            )
        return problem

    def source(self, kind: Distribution | SceneKind, programs: Programs) -> _SceneSource:
        """The scenes that were given, those of a data set, of its folder's part, or some of a
        distribution.

        Raises InvalidInput where there are none, and for a folder that is no pool of such scenes.
        """
        if isinstance(self.scenes, str | Path | _Rows):
            from .data.dataset import ScenePool  # Arrow takes a while to load

            rows: Any = self.scenes
            return ScenePool.open(rows, of=kind.name, legs=kind.legs, balanced=self.balanced)
        if self.scenes is not None:
            return self.scenes
        if isinstance(kind, SceneKind):
            raise InvalidInput(f"scenes: expected some of {kind.name}, got none")
        return SampledScenes(kind, balanced=self.balanced, programs=programs)
