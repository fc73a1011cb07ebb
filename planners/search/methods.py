"""Names of the methods that answer postures and courses, and what is made of them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ..equilibrium.programs import Programs
from ..errors import InvalidInput
from ..files.arrays import check_numbers
from ..files.documents import shown
from ..plugins import Registry, foreign, takes
from ..projection.project import Projection
from .answer import (
    COURSE_LIMIT_S,
    POSTURE_LIMIT_S,
    Acceptance,
    Kind,
    Method,
    Planner,
    VerifiedPlanner,
)
from .two_stage import TwoStage

if TYPE_CHECKING:
    from ..relaxation.envelope import EnvelopeSet

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
        time_limit_s: limit per problem; ``POSTURE_LIMIT_S`` or ``COURSE_LIMIT_S`` where None [s].
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
_OWN: Mapping[str, _Make | str] = MappingProxyType(
    {
        "exact": "stancekit.planners.search.exact:Exact",
        "p1": p1,
        "lift": lift,
        "two-stage": TwoStage,
        "nlp": "stancekit.planners.search.micp:Nlp",
        "micp": "stancekit.planners.search.micp:Micp",
        "decoupled": "stancekit.planners.search.micp:Decoupled",
    }
)
METHODS = ("exact", "p1", "lift", "two-stage", "nlp", "micp")
"""The names of the package's own methods for postures."""
COURSE_METHODS = ("two-stage", "micp", "nlp", "decoupled", "exact")
"""The names of those for courses."""
_OWN_OF: Mapping[Kind | None, tuple[str, ...]] = MappingProxyType(
    {"postures": METHODS, "courses": COURSE_METHODS, None: tuple(_OWN)}
)


def _is_own(it: object) -> bool:
    """Tell whether it is one of the package's methods; what compares in a way of its own is asked
    nothing.
    """
    of_ours = isinstance(it, type) and issubclass(it, Method)
    return of_ours or any(it is one for one in _OWN.values())


def _accepted(it: Any) -> bool:
    return isinstance(it, Method) or _is_own(it) or takes(it, 1)


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


def known(of: Kind | None = None) -> tuple[str, ...]:
    """The names of all planners of this kind of question, as far as their names say; nothing is
    imported.
    """
    return (*_OWN_OF[of], *(name for name in PLANNERS.names() if name not in _OWN))


def _named(name: str, of: Kind | None) -> _Make:
    """Maker of the planner of this name.

    Raises InvalidInput for a name that this kind of question does not know.
    """
    if name not in _OWN:
        return PLANNERS.get(name, known=known(of))
    if name not in _OWN_OF[of]:  # known without a look at other packages
        raise PLANNERS.unknown(name, known(of))
    return PLANNERS.get(name)


def settings_of(name: str, of: Kind | None = "postures") -> tuple[str, ...]:
    """The names of the settings that a method takes; of one from elsewhere all that there are.

    Arguments:
        of: the kind of question; None for the settings of either.
    """
    make = _named(name, of)
    if not _is_own(make):
        return tuple(SETTINGS)
    unsaid = {each.name for each in fields(Method)}
    if of == "postures":
        unsaid |= set(getattr(make, "OF_COURSES", ()))
    return tuple(one for one in inspect.signature(make).parameters if one not in unsaid)


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
        return _optioned(_checked(method, settings), options)
    make = _named(method, of)
    if isinstance(make, Method):
        given = {name: value for name, value in settings.items() if value != SETTINGS.get(name)}
        return _optioned(_checked(make, given), options)
    if _is_own(make):
        return _optioned(_value(make, method, settings, settings_of(method, of)), options)
    whole_s = options.limit(POSTURE_LIMIT_S if of == "postures" else COURSE_LIMIT_S)

    def remake(limit_s: float) -> Planner:
        limited = replace(options, time_limit_s=min(limit_s, whole_s))
        return make(  # type: ignore[no-any-return]
            replace(  # copies, since theirs may write to what it is given; with a time limit always
                limited,
                programs=Programs(),
                acceptance=replace(limited.acceptance),
                time_limit_s=limited.limit(whole_s),
                settings=dict(settings),
            )
        )

    with foreign(f"method {method}"):
        planner = remake(whole_s)
    return VerifiedPlanner(
        planner,
        method,
        options.acceptance,
        envelopes=settings.get("envelopes"),
        remake=remake,
    )


def through_verifier(planner: Planner, of: Kind) -> Planner:
    """A planner for this kind of question, which answers through the verifier unless it is the
    package's own.
    """
    if isinstance(planner, Method):
        planner.check(of)
    if isinstance(planner, Method | VerifiedPlanner):
        return planner
    name = str(getattr(planner, "name", type(planner).__name__))
    return VerifiedPlanner(planner, name, Acceptance())


def _optioned(method: Method, options: PlannerOptions) -> Method:
    """A method with options, beside what it has itself.

    Raises InvalidInput for a setting that this kind of question has no use for; None is either
    kind, of which the method refuses what it cannot answer.
    """
    more: dict[str, Any] = {}
    if options.time_limit_s is not None:
        own_s = method.time_limit_s
        more["time_limit_s"] = (
            options.time_limit_s if own_s is None else min(own_s, options.time_limit_s)
        )
    if options.acceptance != Acceptance():
        more["acceptance"] = options.acceptance
    if options.programs is not None and method.programs is None:
        more["programs"] = options.programs
    method = replace(method, **more) if more else method
    if options.of is not None:
        method.check(options.of)
    return method


def _value(make: _Make, name: str, settings: Mapping[str, Any], taken: tuple[str, ...]) -> Method:
    """The method of a text.

    Raises InvalidInput for a setting that it does not take.
    """
    for setting, value in settings.items():
        if setting not in taken and not (setting in SETTINGS and value == SETTINGS[setting]):
            came = shown(value) if isinstance(value, str | int | float) else type(value).__name__
            raise InvalidInput(
                f"{setting}: expected none for {name}, which does not use it, got {came}"
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
