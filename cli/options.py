"""Options that several commands have: those that may be left out, of a planner, and files of pictures.

tyro knows ``Optional``; for ``X | None`` it imports typeguard, which takes .1 s.
"""

from __future__ import annotations

import dataclasses
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cache, partial
from inspect import cleandoc
from pathlib import Path
from types import MappingProxyType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    Optional,
    TypeAlias,
    get_type_hints,
)

import tyro
from tyro.constructors import (
    MISSING_NONPROP,
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from stancekit.planners.errors import InvalidInput

if TYPE_CHECKING:
    from stancekit import FootholdLimits, HeightField
    from stancekit.planners.files.arrays import Array
    from stancekit.planners.search.answer import Kind
    from stancekit.planners.terrain.import_options import ImportOptions


def rules(helps: bool) -> ConstructorRegistry:
    """The rule of tyro by which data classes become options, with their texts where these are
    shown: it takes long to read them from the source.
    """
    registry = ConstructorRegistry()
    registry.struct_rule(partial(_options_of, helps))
    return registry


def flowing(text: str) -> str:
    """The text with every paragraph on one line, unless it is a block of lines of their own."""
    paragraphs = re.split(r"\n\s*\n", cleandoc(text))
    return "\n\n".join(
        each if each.startswith(" ") else " ".join(each.split()) for each in paragraphs
    )


def _options_of(helps: bool, info: StructTypeInfo) -> StructConstructorSpec | None:
    """An option for each field of a data class; None for any other type."""
    cls = info.type
    if not dataclasses.is_dataclass(cls):
        return None
    types = get_type_hints(cls, include_extras=True)
    named = [
        StructFieldSpec(
            name=each.name,
            type=types[each.name],
            default=_default(each, info.default, types[each.name]),
            helptext=_texts(cls).get(each.name) if helps else "",
        )
        for each in dataclasses.fields(cls)
        if each.init
    ]
    return StructConstructorSpec(instantiate=cls, fields=tuple(named))


def _default(field: dataclasses.Field[Any], of: Any, type_: Any) -> Any:
    """The value of a field where nothing is asked: that of the instance that is the default, or its
    own.
    """
    if dataclasses.is_dataclass(of) and hasattr(of, field.name):
        return getattr(of, field.name)
    if field.default is not dataclasses.MISSING:
        return field.default
    if field.default_factory is not dataclasses.MISSING and field.default_factory is not type_:
        return field.default_factory()
    return MISSING_NONPROP


@cache
def _texts(cls: type[Any]) -> Mapping[str, str]:
    """The text of every field that has one, by its name, in the source of the class and of those
    that it comes from.
    """
    import docstring_parser

    return {
        said.arg_name: " ".join(said.description.split())
        for each in reversed(cls.__mro__[:-1])
        for said in docstring_parser.parse_from_object(each).params
        if said.description
    }


NAMES = MappingProxyType(
    {
        "stancekit.planners.projection.project:PROJECTIONS": (
            "stancekit.projections",
            ("fix-p", "fix-f", "fix-toes", "scp", "nlp", "lift-fix-p"),
        ),
        "stancekit.planners.relaxation.envelope:RELAXATIONS": (
            "stancekit.relaxations",
            ("p1", "joint", "coned", "lift"),
        ),
        "stancekit.planners.search.methods:METHODS": (
            "stancekit.planners",
            ("exact", "p1", "lift", "two-stage", "nlp", "micp"),
        ),
        "stancekit.planners.search.methods:COURSE_METHODS": (
            "stancekit.planners",
            ("two-stage", "micp", "nlp", "decoupled", "exact"),
        ),
        "stancekit.learners.training.fitting:METHODS": (
            "stancekit.methods",
            (
                "heuristic",
                "quantile",
                "gmm-printed",
                "gmm",
                "ga",
                "gradient",
                "modes",
                "neural",
                "joint",
            ),
        ),
        "stancekit.learners.selectors.selector:SELECTORS": ("stancekit.selectors", ()),
    }
)
"""By registry, or by tuple of our own names: the group of other packages' names, and our own,
for which `--help` would else load solvers and networks (a test holds them to be those that there
are)."""


def named(registry: str, metavar: str = "NAME|FILE.py:NAME") -> Any:
    """Annotation of an option that takes a name of this registry, a key of ``NAMES``."""

    def hint(default: str) -> str:
        from stancekit.planners.plugins import entry_points_of

        group, ours = NAMES[registry]
        others = [point.name for point in entry_points_of(group)]
        names = list(dict.fromkeys([*ours, *others]))
        known = [f"default: {default}"] if default not in ("", "None") else []
        known += [f"one of {', '.join([*names, 'FILE.py:NAME'])}"] if names else []
        return f"({'; '.join(known)})" if known else ""

    return tyro.conf.arg(metavar=metavar, help_behavior_hint=hint)


PROJECTION = named("stancekit.planners.projection.project:PROJECTIONS")
DISTRIBUTION = tyro.conf.arg(metavar="NAME")
ROBOT = tyro.conf.arg(metavar="FILE|NAME")
SURROGATE = tyro.conf.arg(metavar="FILE")
TERRAIN = tyro.conf.arg(metavar="FILE")


OptionalPath: TypeAlias = Annotated[Optional[Path], tyro.conf.arg(metavar="PATH")]  # noqa: UP045
OptionalInt: TypeAlias = Annotated[Optional[int], tyro.conf.arg(metavar="INT")]  # noqa: UP045
OptionalFloat: TypeAlias = Annotated[Optional[float], tyro.conf.arg(metavar="FLOAT")]  # noqa: UP045
OptionalWrench: TypeAlias = Annotated[Optional[str], tyro.conf.arg(metavar="FX,FY,FZ[,MX,MY,MZ]")]  # noqa: UP045
OptionalText: TypeAlias = Annotated[Optional[str], tyro.conf.arg(metavar="TEXT")]  # noqa: UP045
LONGEST_S = 1e6


def check_unused(options: Any, names: Iterable[str], of: str) -> None:
    """Raise InvalidInput for one of these options that was given.

    Arguments:
        options: the data class of the options.
        of: what has no use for them.
    """
    for name in names:
        if (came := getattr(options, name)) != getattr(type(options), name):
            raise InvalidInput(f"--{name.replace('_', '-')}: expected none with {of}, got {came}")


@dataclass
class MethodOptions:
    """Settings of methods, by their names in Python."""

    relaxation: Annotated[
        OptionalText, named("stancekit.planners.relaxation.envelope:RELAXATIONS")
    ] = None
    """First stage of two-stage: lift needs nothing learned; p1, the paper's, and coned and joint,
    which are tighter, are over --envelopes; the one that fits unless named."""
    envelopes: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """File of envelopes for p1, two-stage and micp, as `stancekit fit` writes it; over courses for
    two-stage also a file of modes."""
    projection: Annotated[OptionalText, PROJECTION] = None
    """Second stage of two-stage and micp, where scp unless another is named, and of p1 and lift.
    fix-p: the paper's. fix-toes: frees body and forces. scp: frees all, in steps."""
    solver: Literal["highs", "scip", "gurobi"] = "highs"
    """Solver of micp."""
    intervals: int = 4
    """Pieces of each axis in micp's grid, a power of two."""

    def settings(self, method: str, of: Kind, read: Callable[[Path], Any]) -> dict[str, Any]:
        """The settings that a method takes, by name.

        Raises InvalidInput for one that was given and that it has no use for.

        Arguments:
            of: the kind of question that it will be asked.
            read: reader of a file of envelopes.
        """
        from stancekit.planners.search.methods import COURSE_METHODS, METHODS, settings_of

        known = METHODS if of == "postures" else COURSE_METHODS
        takes = settings_of(method, of)
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        for each in fields(self) if method in known else ():
            name, value = each.name, given[each.name]
            if value != each.default and name not in takes:
                fitting = " or ".join(one for one in known if name in settings_of(one, of))
                option = "no-reserve" if name == "reserve" else name.replace("_", "-")
                raise InvalidInput(f"--{option}: expected --method {fitting} with it, got {method}")
        if self.envelopes is not None:
            given["envelopes"] = read(self.envelopes)
        return {k: v for k, v in given.items() if k in takes and v is not None}


@dataclass
class CourseMethodOptions(MethodOptions):
    """Settings of methods for courses."""

    reserve: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = True
    """Plan with all of the friction at once. Without --no-reserve, with 80 % of it where that has a
    plan, else with 90 %, else with all of it: what is executed then has something in hand.
    Two-stage only; there is a bound only of plans with all of it."""
    max_solves: OptionalInt = None
    """Limit of convex solves of each search for contacts, beside the time: with a time that is
    never met, a plan is the same on a busy computer. two-stage and exact."""


OF_METHOD = (tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="method"))
"""How ``MethodOptions`` are shown."""


def check_limit(time_limit_s: float | None) -> None:
    """Raise InvalidInput for a limit of time that is out of range."""
    if time_limit_s is not None and not 0.0 < time_limit_s <= LONGEST_S:
        got = f"got {time_limit_s:g}"
        raise InvalidInput(f"--time-limit-s: expected a number above 0, up to {LONGEST_S:g}, {got}")


def check_out(path: Path | None, *suffixes: str) -> None:
    """Raise InvalidInput for a file of --out that cannot be written, or ends otherwise."""
    from stancekit.planners.files.writing import check_writable

    if path is not None and suffixes and path.suffix not in suffixes:
        ends = " or ".join(suffixes)
        raise InvalidInput(f"--out: expected a name that ends in {ends}, got {path}")
    if path is not None:
        check_writable(path)


def check_drawn(
    picture: Path | None = None, video: Path | None = None, html: Path | None = None
) -> None:
    """Raise InvalidInput for a picture, film or page that cannot be written, or lacks a package."""
    if picture is not None:
        from stancekit.views.sheet import check_picture

        check_picture(picture)
    if video is not None:
        from stancekit.views.film import check_film

        check_film(video)
    if html is not None:
        from stancekit.views.page import check_page

        check_page(html)


def check_log(log: Path, others: Mapping[str, Path | str | None]) -> None:
    """Raise InvalidInput for a log that is none by its name, or that would be written over another
    file of the command.
    """
    if log.suffix != ".mcap":
        raise InvalidInput(f"--log: expected a name that ends in .mcap, got {log}")
    for name, other in others.items():
        if other is not None and os.path.realpath(other) == os.path.realpath(log):
            raise InvalidInput(f"--log: expected a file of its own, got that of {name}: {log}")


def wrench_numbers(text: str | None) -> tuple[float, ...] | None:
    """The numbers of a force and a moment on the body; None where the option was not given.

    Raises InvalidInput.
    """
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InvalidInput(
            f"wrench: expected FX,FY,FZ or FX,FY,FZ,MX,MY,MZ, got {text!r:.80}"
        ) from None


_OF_WALKS = ("heights_m", "smooth_m")
"""Options of files that are no field of ``ImportOptions`` by this name."""
OF_FILE = (tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="terrain's file"))
"""How the options of a ``TerrainFile`` are shown."""


@dataclass
class FileMeaning:
    """Options that say what the numbers of a terrain's file mean, but for a grid's spacing."""

    kind: Annotated[
        Optional[Literal["mesh", "grid", "cloud"]],  # noqa: UP045
        tyro.conf.arg(metavar="{mesh,grid,cloud}"),
    ] = None
    """What the file holds, where its name does not say: a .npy or .csv of three columns may be a
    cloud or a grid. A mesh that is called a grid is the map of its upper side."""
    unit_m: float = 1.0
    """What one unit of lengths in a file means [m]; 0.001 for millimetres."""
    up: Literal["x", "y", "z"] = "z"
    """Which axis of a mesh or cloud points up. With y, the file's z becomes x and its x becomes y;
    with x, its y becomes x and its z becomes y."""
    offset_m: Annotated[OptionalText, tyro.conf.arg(metavar="X,Y,Z")] = None
    """Added to every point, after unit and axis [m]; before a negative number the sign =, as in
    --offset-m=-1,0,0."""
    crop_m: Annotated[OptionalText, tyro.conf.arg(metavar="X,X,Y,Y[,Z,Z]")] = None
    """What is kept, from and to along each axis, after the offset [m]."""
    holes: Literal["no-go", "fill"] = "no-go"
    """What has no height (NaN, transparent pixels, cells without points): no terrain, or a membrane
    over it."""
    most_triangles: OptionalInt = None
    """A mesh with more is refused by its header; 200,000 unless given."""
    heights_m: Annotated[OptionalText, tyro.conf.arg(metavar="BLACK,WHITE")] = None
    """Heights of black and white in a .png [m]."""

    def asked(self) -> ImportOptions:
        """Import options that the reader wants.

        Raises InvalidInput.
        """
        from stancekit.planners.terrain.import_options import ImportOptions

        given = {name: value for name, value in vars(self).items() if name not in _OF_WALKS}
        for name, text, count in (
            ("height_m", self.heights_m, 2),
            ("offset_m", self.offset_m, 3),
            ("crop_m", self.crop_m, 6 if (self.crop_m or "").count(",") > 3 else 4),
        ):
            option = "--heights-m" if name == "height_m" else f"--{name.replace('_', '-')}"
            given[name] = None if text is None else numbers(text, option, float, count)
        with in_options():
            return ImportOptions(**{k: v for k, v in given.items() if v is not None})


@dataclass
class TerrainFile(FileMeaning):
    """Options that say what the numbers of a terrain's file mean."""

    spacing_m: float = 0.05
    """Grid spacing of a file, of the map that a cloud becomes, and at which a mesh is sampled for
    walks [m]."""
    smooth_m: float = 0.0
    """Deviation of a Gaussian that smooths heights for walks; a wall has to be wider than the
    grid's spacing [m]."""

    def read(self, name: str) -> HeightField:
        """The terrain of a name as one height at every place.

        Raises InvalidInput.
        """
        from stancekit import heights

        with in_options():
            return heights(name, smooth_m=self.smooth_m, **vars(self.asked()))


@dataclass
class FootholdOptions:
    """Options that say what counts as a foothold."""

    slope_rad: float = 0.6
    """Steepest ground to stand on [rad]."""
    headroom_m: OptionalFloat = None
    """What is free above a foothold, along its normal [m]; unless given, 0.1 of a robot of the
    default hexapod's size, and in proportion."""
    margin_m: OptionalFloat = None
    """Margin of footholds from the borders of their surface [m]; unless given, the radius of the
    robot's foot, else 0.02."""
    width_m: OptionalFloat = None
    """Least width of a foothold inside the margin [m]; unless given, likewise."""
    roughness_m: float = 0.006
    """How far heights of a map may be off a foothold's plane, rms [m]."""
    noise_m: OptionalFloat = None
    """Deviation of the sensor that made a map or a cloud, allowed for beside the roughness; unless
    given, it is estimated from the heights [m]."""

    def limits(self) -> FootholdLimits:
        """Limits of footholds.

        Raises InvalidInput.
        """
        from stancekit import FootholdLimits

        settings = {k: v for k, v in vars(self).items() if k != "headroom_m"}
        with in_options():
            return FootholdLimits(clearance_m=self.headroom_m, **settings)


@contextmanager
def in_options() -> Iterator[None]:
    """Let a reader's message name its settings as the options that give them."""
    try:
        yield
    except InvalidInput as error:
        message = re.sub(r"\bheight_m\b", "--heights-m", str(error))
        message = re.sub(r"\bclearance_m\b", "--headroom-m", message)
        known = [each.name for kind in (TerrainFile, FootholdOptions) for each in fields(kind)]
        names = "|".join([*known, "grid_m"])
        text = re.sub(rf"(?<![-\w.])({names})\b(=|: (?=\w+ ?))?", _as_option, message)
        raise type(error)(text) from None


def _as_option(found: re.Match[str]) -> str:
    """A setting as its option; ``kind`` and the like only where a value is set."""
    name, sign = found[1], found[2] or ""
    if not name.endswith(("_m", "_rad", "_triangles")) and not sign:
        return name
    return f"--{name.replace('_', '-')}{' ' if sign == '=' else sign}"


def numbers(text: str, option: str, kind: type, count: int) -> tuple[Any, ...]:
    """Read the numbers of an option, which are separated by commas.

    Raises InvalidInput.
    """
    try:
        parts = tuple(kind(part) for part in text.split(","))
    except ValueError:
        parts = ()
    if len(parts) != count:
        from stancekit.planners.files.documents import shown  # slow to import

        raise InvalidInput(
            f"{option}: expected {count} numbers with commas between them, got {shown(text)}"
        )
    return parts


def place(text: str, option: str) -> Array:
    """A place X,Y, shape (2,) [m]."""
    import numpy as np

    from stancekit.planners.files.documents import shown

    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x, y = np.nan, np.nan
    if not (np.isfinite(x) and np.isfinite(y)):
        raise InvalidInput(f"{option}: expected a place X,Y in metres, got {shown(text)}")
    return np.array([x, y])


def heading(text: str, way: Array, option: str = "--heading") -> float:
    """An angle, or that of the way to the goal [rad]."""
    from stancekit.planners.files.documents import shown

    if text == "goal":
        return math.atan2(way[1], way[0])
    try:
        return float(text)
    except ValueError:
        raise InvalidInput(
            f"{option}: expected an angle in rad, or goal, got {shown(text)}"
        ) from None
