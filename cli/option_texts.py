"""Options of commands as tyro reads them from data classes, their texts on one line each, so that a
terminal breaks them where it ends.

tyro joins the lines of a text but for those that begin with a sign or are set in, and breaks what
it has joined once more (https://github.com/brentyi/tyro/issues/429).
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from functools import cache, partial
from inspect import cleandoc
from typing import Any, get_type_hints

from tyro.constructors import (
    MISSING_NONPROP,
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)


def rules() -> ConstructorRegistry:
    """The rule of tyro by which data classes become options."""
    registry = ConstructorRegistry()
    registry.struct_rule(_options_of)
    return registry


def flowing(text: str) -> str:
    """The text with every paragraph on one line, unless it is a block of lines of their own."""
    paragraphs = re.split(r"\n\s*\n", cleandoc(text))
    return "\n\n".join(
        each if each.startswith(" ") else " ".join(each.split()) for each in paragraphs
    )


def _options_of(info: StructTypeInfo) -> StructConstructorSpec | None:
    """An option for each field of a data class; None for any other type."""
    cls = info.type
    if not dataclasses.is_dataclass(cls):
        return None
    types, texts = get_type_hints(cls, include_extras=True), cache(partial(_texts, cls))
    named = [
        StructFieldSpec(
            name=each.name,
            type=types[each.name],
            default=_default(each, info.default, types[each.name]),
            helptext=partial(_text, texts, each.name),
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


def _text(texts: Callable[[], dict[str, str]], name: str) -> str | None:
    """The text of one field, which is read from the source when it is shown."""
    return texts().get(name)


def _texts(cls: type[Any]) -> dict[str, str]:
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
