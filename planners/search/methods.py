"""The methods that answer postures and courses: a value each, with its settings; their names; what
is made of them.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, get_args, runtime_checkable

from ..arguments import check_argument
from ..equilibrium.programs import Programs
from ..errors import InvalidInput
from ..files.arrays import check_numbers, checked_choice
from ..files.documents import shown
from ..plugins import Registry, foreign, takes
from ..projection.project import PROJECTIONS, Projection
from .answer import (
    COURSE_LIMIT_S,
    POSTURE_LIMIT_S,
    Acceptance,
    Kind,
    Planner,
)

if (
    TYPE_CHECKING
):  # what a planner needs is imported when it is asked for: a command waits for nothing else
    from ..relaxation.boxes import Modes
    from ..relaxation.envelope import EnvelopeSet

_Solver = Literal["highs", "scip", "gurobi"]
_EnvelopeUse = Literal["rows", "shrink"]
MOST_INTERVALS = 64
"""A finer grid takes minutes to write down and more memory than most machines have."""
SETTINGS: Mapping[str, Any] = MappingProxyType(
    {
        "envelopes": None,
        "relaxation": None,
        "projection": None,
        "solver": "highs",
        "intervals": 4,
        "envelope_use": "rows",
        "gap": None,
    }
)
"""Settings of methods that a planner from elsewhere can be given, too, and what it reads where it
was not."""


@dataclass(frozen=True, kw_only=True)
class PlannerOptions:
    """Options of every planner beside the settings of its method.

    A planner from elsewhere is called with one, and reads settings as attributes, for example
    ``options.envelopes``.

    Arguments:
        of: the kind of question that it will be asked; None where that may be either.
        time_limit_s: of one problem; ``POSTURE_LIMIT_S`` or ``COURSE_LIMIT_S`` where None [s].
        acceptance: when a claim counts.
        programs: compiled models to share.
        settings: by name, for a planner from elsewhere, see ``SETTINGS``.

    Raises:
        InvalidInput: for a limit that is negative.
    """

    of: Kind | None = None
    time_limit_s: float | None = None
    acceptance: Acceptance = field(default_factory=Acceptance)
    programs: Programs | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_numbers(self, least=("time_limit_s",))

    def __getattr__(self, name: str) -> Any:
        if name in SETTINGS:
            return self.settings.get(name, SETTINGS[name])
        raise AttributeError(f"PlannerOptions has no {name!r}")

    def limit(self, default_s: float) -> float:
        """The time limit, or this one where none was given [s]."""
        return default_s if self.time_limit_s is None else self.time_limit_s


@runtime_checkable
class Method(Protocol):
    """A way to answer problems, with its settings, for example ``TwoStage(projection="fix-p")``."""

    name: ClassVar[str]

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner, for what ``options.of`` says.

        Raises InvalidInput where there is none, or settings do not fit the kind of question; where
        that may be either, the planner refuses what it cannot answer.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Exact:
    """Branch and bound to a verdict with its evidence; of courses to the best plan, for short ones.

    Arguments:
        gap: of courses, relative: a plan this close to the best counts as best.
        max_solves: convex solves of one answer at most, beside the limit of time; None for no such
            limit. With a ``time_limit_s`` that is never met, 1e6, the answer is the same on a busy
            computer.

    Raises:
        InvalidInput: for numbers that are negative.
    Source:
        Spatial branch and bound over E1-E11.

    Example:
        >>> import stancekit
        >>> stancekit.solve(stancekit.sample("wall-3", rng=8)[0], stancekit.Exact()).status.value
        'infeasible'
    """

    gap: float = 1e-3
    max_solves: int | None = None
    name: ClassVar[str] = "exact"

    def __post_init__(self) -> None:
        check_argument("gap", self.gap, float)
        check_argument("max_solves", self.max_solves, int | None)
        check_numbers(self, least=("gap", "max_solves"))

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner.

        Raises InvalidInput, see ``Method``.
        """
        from .exact import ExactPlanner

        return _checked_for(
            options.of,
            ExactPlanner(
                gap=self.gap,
                max_solves=self.max_solves,
                time_limit_s=options.time_limit_s,
                acceptance=options.acceptance,
                programs=options.programs,
            ),
        )


@dataclass(frozen=True, kw_only=True)
class TwoStage:
    """The two stages of Lin et al.: P1, a convex relaxation, then P2, a projection onto the
    bilinear surface m = p·f.

    Arguments:
        relaxation: P1, a name of ``RELAXATIONS``; where None "p1" with envelopes, and without any
            the lift.
        envelopes: learned boxes that P1 is over; of courses also ``Modes``, between which stances
            choose.
        projection: P2, a name of ``PROJECTIONS``; None puts P1's own point to the verifier, of
            postures.
        reserve: of courses: plan with 80 % of the friction where that has a plan, else with 90 %,
            else with all.
        max_solves: of courses: convex solves of one search at most, beside the limit of time; None
            for no such limit. With a ``time_limit_s`` that is never met, 1e6, the plan is the same
            on a busy computer.

    Raises:
        InvalidInput: for an unknown name, envelopes that are missing, and envelopes that the lift
            has no use for.
    Source:
        Lin et al. §II, §III.

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.solve(problem, stancekit.TwoStage(projection="fix-p")).status.value
        'feasible'
    """

    relaxation: str | None = None
    envelopes: EnvelopeSet | Modes | None = None
    projection: Projection | None = "scp"
    reserve: bool = True
    max_solves: int | None = None
    name: ClassVar[str] = "two-stage"

    def __post_init__(self) -> None:
        from ..relaxation.boxes import Modes
        from ..relaxation.envelope import EnvelopeSet
        from ..relaxation.relaxed import RELAXATIONS

        check_argument("relaxation", self.relaxation, str | None)
        check_argument("envelopes", self.envelopes, EnvelopeSet | Modes | None)
        check_argument("projection", self.projection, str | None)
        check_argument("reserve", self.reserve, bool)
        check_argument("max_solves", self.max_solves, int | None)
        check_numbers(self, least=("max_solves",))
        if self.projection is not None:
            PROJECTIONS.get(self.projection)
        if self.relaxation is None:
            return
        over_boxes = RELAXATIONS.get(self.relaxation).over_boxes
        if over_boxes and self.envelopes is None:
            raise InvalidInput(
                f"envelopes: expected an envelope for the relaxation {self.relaxation}, got none"
            )
        if not over_boxes and self.envelopes is not None:
            raise InvalidInput(
                f"envelopes: expected none for the {self.relaxation}, which has no use for them"
            )

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner.

        Raises InvalidInput, see ``Method``.
        """
        from .two_stage import TwoStagePlanner

        return _checked_for(
            options.of,
            TwoStagePlanner(
                self.envelopes,
                relaxation=self.relaxation or "p1",
                projection=self.projection,
                reserve=self.reserve,
                max_solves=self.max_solves,
                time_limit_s=options.time_limit_s,
                acceptance=options.acceptance,
                programs=options.programs,
            ),
        )


@dataclass(frozen=True, kw_only=True)
class Micp:
    """A piecewise McCormick grid, mixed-integer; needs the extra exact for other solvers than
    HiGHS.

    Arguments:
        solver: "highs", "scip" or "gurobi".
        intervals: pieces of each axis of the grid, a power of two.
        envelopes: one learned box that the grid is over.
        envelope_use: of courses: the box as "rows", or to "shrink" the grid.
        gap: of courses, relative; None takes the first point.
        projection: of courses, P2 after the grid.

    Raises:
        InvalidInput: for a solver, a use or a projection that there is not, and for several
            envelopes.
    Source:
        Lin et al. §IV; the grid is that of piecewise McCormick envelopes.

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.solve(problem, stancekit.Micp(intervals=2)).status.value
        'feasible'
    """

    solver: _Solver = "highs"
    intervals: int = 4
    envelopes: EnvelopeSet | None = None
    envelope_use: _EnvelopeUse = "rows"
    gap: float | None = None
    projection: Projection = "scp"
    name: ClassVar[str] = "micp"

    def __post_init__(self) -> None:
        from ..relaxation.boxes import Modes
        from ..relaxation.envelope import EnvelopeSet

        check_argument("envelopes", self.envelopes, EnvelopeSet | Modes | None)
        check_argument("intervals", self.intervals, int)
        if self.intervals > MOST_INTERVALS:
            raise InvalidInput(
                f"intervals: expected {MOST_INTERVALS} or less, got {shown(self.intervals)}"
            )
        check_argument("gap", self.gap, float | None)
        check_argument("projection", self.projection, str)
        checked_choice(self.solver, "solver", get_args(_Solver))
        checked_choice(self.envelope_use, "envelope_use", get_args(_EnvelopeUse))
        check_numbers(self, least=("gap",))
        PROJECTIONS.get(self.projection)
        if isinstance(self.envelopes, Modes):
            raise InvalidInput("envelopes: expected one envelope for micp, got modes")

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner.

        Raises InvalidInput, see ``Method``.
        """
        from ..relaxation.micp import MicpGrid
        from .micp import MicpPlanner

        return _checked_for(
            options.of,
            MicpPlanner(
                solver=self.solver,
                grid=MicpGrid(intervals=self.intervals, envelope_use=self.envelope_use),
                envelope=self.envelopes,
                gap=self.gap,
                projection=self.projection,
                time_limit_s=options.time_limit_s,
                acceptance=options.acceptance,
                programs=options.programs,
            ),
        )


@dataclass(frozen=True, kw_only=True)
class Nlp:
    """The nonlinear program as it is, solved by IPOPT.

    Source:
        Lin et al. §IV-A (NLP in Table I).

    Example:
        >>> import stancekit
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> stancekit.solve(problem, stancekit.Nlp()).status.value
        'feasible'
    """

    name: ClassVar[str] = "nlp"

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner.

        Raises InvalidInput, see ``Method``.
        """
        from .micp import NlpPlanner

        return NlpPlanner(
            time_limit_s=options.time_limit_s,
            acceptance=options.acceptance,
            programs=options.programs,
        )


@dataclass(frozen=True, kw_only=True)
class Decoupled:
    """Positions first and forces after, for courses: a baseline that fails on ice; done long before
    any time limit.

    Source:
        None: the common order of planners without forces.

    Example:
        >>> import stancekit
        >>> stancekit.plan("stairs", stancekit.Decoupled(), frames=3).status.value
        'feasible'
    """

    name: ClassVar[str] = "decoupled"

    def planner(self, options: PlannerOptions) -> Planner:
        """Make the planner.

        Raises InvalidInput, see ``Method``.
        """
        from .micp import DecoupledPlanner

        planner = DecoupledPlanner(acceptance=options.acceptance, programs=options.programs)
        return _checked_for(options.of, planner)


def _checked_for(kind: Kind | None, planner: Any) -> Planner:
    """A planner of the package.

    Raises InvalidInput for a setting that this kind of question has no use for; None is either
    kind, of which the planner refuses what it cannot answer.
    """
    if kind is not None:
        planner.check(kind)
    made: Planner = planner
    return made


def p1(
    *,
    envelopes: EnvelopeSet | None = None,
    relaxation: str = "p1",
    projection: Projection | None = None,
) -> TwoStage:
    """P1 over envelopes without P2, unless a projection is named; what the text "p1" stands for."""
    return TwoStage(relaxation=relaxation, envelopes=envelopes, projection=projection)


def lift(*, projection: Projection | None = None) -> TwoStage:
    """The lift without P2, unless a projection is named; what the text "lift" stands for."""
    return TwoStage(relaxation="lift", projection=projection)


_Make = Callable[..., Any]
_OWN: Mapping[str, _Make] = MappingProxyType(
    {
        "exact": Exact,
        "p1": p1,
        "lift": lift,
        "two-stage": TwoStage,
        "nlp": Nlp,
        "micp": Micp,
        "decoupled": Decoupled,
    }
)
METHODS = ("exact", "p1", "lift", "two-stage", "nlp", "micp")
"""The names of the package's own methods for postures."""
COURSE_METHODS = ("two-stage", "micp", "nlp", "decoupled", "exact")
"""The names of those for courses."""
_OWN_OF: Mapping[Kind | None, tuple[str, ...]] = MappingProxyType(
    {"postures": METHODS, "courses": COURSE_METHODS, None: tuple(_OWN)}
)
_COURSE_ALONE = ("reserve", "envelope_use", "gap")
"""Settings that concern courses alone; of ``Micp`` also its projection, of ``TwoStage`` its limit
of solves."""


def _is_own(it: object) -> bool:
    """Tell whether it is one of the package's methods; what compares in a way of its own is asked
    nothing.
    """
    return any(it is one for one in _OWN.values())


def _accepted(it: Any) -> bool:
    return _is_own(it) or takes(it, 1)


PLANNERS: Registry[_Make] = Registry(
    "method",
    "stancekit.planners",
    _OWN,
    expected="something to call with PlannerOptions",
    accepts=_accepted,
)
"""All planners: called with ``PlannerOptions``, a class or function gives something with ``solve``,
which answers posture problems, courses, or both. One that answers one kind alone says so by an
attribute ``answers``, "postures" or "courses"."""
_CALLED: Mapping[Kind | None, str] = MappingProxyType(
    {"postures": "method", "courses": "planner", None: "method"}
)
"""Name of a planner in messages."""


def known(of: Kind | None = None) -> tuple[str, ...]:
    """The names of all planners of this kind of question, as far as their names say; nothing is
    imported.
    """
    return (*_OWN_OF[of], *(name for name in PLANNERS.names() if name not in _OWN))


def _named(name: str, of: Kind | None) -> _Make:
    """Maker of the planner of this name.

    Raises InvalidInput for a name that nobody has for this kind of question.
    """
    called = _CALLED[of]
    if name not in _OWN:
        return PLANNERS.get(name, called=called, known=known(of))
    if name not in _OWN_OF[of]:  # known without a look at other packages
        raise PLANNERS.unknown(name, called, known(of))
    return PLANNERS.get(name)


def settings_of(name: str, of: Kind | None = "postures") -> tuple[str, ...]:
    """The names of the settings that a method takes; of one from elsewhere all that there are.

    Arguments:
        of: the kind of question; None for the settings of either.
    """
    make = _named(name, of)
    if not _is_own(make):
        return tuple(SETTINGS)
    parameters = tuple(inspect.signature(make).parameters)
    if of != "postures":
        return parameters
    more = "projection" if make is Micp else "max_solves" if make is TwoStage else ""
    return tuple(one for one in parameters if one not in (*_COURSE_ALONE, more))


def make_planner(
    method: str | Method,
    options: PlannerOptions = PlannerOptions(),
    *,
    of: Kind | None = None,
    **settings: Any,
) -> Planner:
    """Make a planner.

    What is not the package's own answers through the verifier.

    Arguments:
        method: a value with its settings; or the text that stands for one, a name of ``PLANNERS``
            or "FILE.py:NAME", with ``settings``.
        of: the kind of question that it will be asked, in place of the one in ``options``: what
            does not fit it is refused at once.

    Raises:
        InvalidInput: for an unknown method, a setting that it does not take, an envelope that is
            missing, or a solver that is not installed.
    """
    if of is not None and of != options.of:
        options = replace(options, of=of)
    of = options.of
    if not isinstance(method, str):
        return _checked(method, settings).planner(options)
    make = _named(method, of)
    if _is_own(make):
        value = (
            _value(make, method, settings, settings_of(method, of)) if settings else _plain(make)
        )
        return value.planner(options)
    from .answer import VerifiedPlanner

    whole_s = options.limit(POSTURE_LIMIT_S if of == "postures" else COURSE_LIMIT_S)

    def remake(limit_s: float) -> Planner:
        limited = replace(options, time_limit_s=min(limit_s, whole_s))
        return make(_copied(limited, whole_s, settings))  # type: ignore[no-any-return]

    with foreign(f"{_CALLED[of]} {method}"):
        planner = remake(whole_s)
    return VerifiedPlanner(
        planner,
        method,
        options.acceptance,
        called=_CALLED[of],
        envelopes=settings.get("envelopes"),
        remake=remake,
    )


def through_verifier(planner: Planner, of: Kind) -> Planner:
    """A planner for this kind of question, which answers through the verifier unless it is the
    package's own.
    """
    from .answer import VerifiedPlanner, check_answers

    if type(planner).__module__.startswith("stancekit."):
        check_answers(planner, of, "method")
        return planner
    return VerifiedPlanner(planner, _called(planner), Acceptance(), called=_CALLED[of])


@functools.cache
def _plain(make: _Make) -> Method:
    """The method with its settings as they are: a value, and so made once."""
    method: Method = make()
    return method


def _value(make: _Make, name: str, settings: Mapping[str, Any], taken: tuple[str, ...]) -> Method:
    """The method of a text.

    Raises InvalidInput for a setting that it does not take.
    """
    for setting, value in settings.items():
        if setting not in taken and not (setting in SETTINGS and value == SETTINGS[setting]):
            came = shown(value) if isinstance(value, str | int | float) else type(value).__name__
            raise InvalidInput(
                f"{setting}: expected none for {name}, which has no use for it, got {came}"
            )
    method: Method = make(**{name: value for name, value in settings.items() if name in taken})
    return method


def _checked(method: Method, settings: Mapping[str, Any]) -> Method:
    """A method that is a value, which has its settings already.

    Raises InvalidInput for others beside them.
    """
    if not isinstance(method, Method):
        raise InvalidInput(
            f"method: expected a name, or a method like TwoStage(), got {shown(method)}"
        )
    if settings:
        raise InvalidInput(
            f"{next(iter(settings))}: expected none beside {method}, which has its settings"
        )
    return method


def _called(planner: object) -> str:
    return str(getattr(planner, "name", type(planner).__name__))


def _copied(options: PlannerOptions, limit_s: float, settings: Mapping[str, Any]) -> PlannerOptions:
    """Options for a planner from elsewhere, which may write to what it is given; with a time limit
    always.
    """
    return replace(
        options,
        programs=Programs(),
        acceptance=replace(options.acceptance),
        time_limit_s=options.limit(limit_s),
        settings=dict(settings),
    )
