"""YAML, which PyYAML reads and writes: loaded where a file is YAML, and few are."""

from __future__ import annotations

import re
from typing import Any

import yaml

from ..errors import InvalidInput
from .documents import NULL

_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def check_growth(text: str, deepest: int, most: int) -> None:
    """Raise InvalidInput where the document is too deep or holds too many values once its aliases
    are replaced.
    """
    count, sizes = 0, dict[str, tuple[int, int]]()  # values and depth of what an anchor stands for
    stack = list[tuple[str | None, int]]()
    depths = [0]  # below each open collection
    for event in yaml.parse(text, Loader=_Parser):
        depth = 0
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise InvalidInput(f"expected an anchor before its alias, got *{event.anchor}")
            size, depth = sizes[event.anchor]
            count += size
        elif isinstance(event, yaml.ScalarEvent):
            count += 1
            if "\0" in event.value:
                raise InvalidInput(NULL)
            if event.anchor is not None:
                sizes[event.anchor] = 1, 0
        elif isinstance(event, yaml.CollectionStartEvent):
            stack.append((event.anchor, count))
            depths.append(0)
            count += 1
            if event.anchor is not None:
                sizes.pop(event.anchor, None)
        elif isinstance(event, yaml.CollectionEndEvent):
            (anchor, begun), depth = stack.pop(), depths.pop() + 1
            if anchor is not None:
                sizes[anchor] = count - begun, depth
        depths[-1] = max(depths[-1], depth)
        if len(stack) + depths[-1] > deepest:
            raise InvalidInput(f"expected {deepest} levels of nesting or fewer, got more")
        if count > most:
            raise InvalidInput(f"expected {most} values or fewer, aliases replaced, got more")


class Once(_Parser):  # type: ignore[misc]
    """Refuses a key that is there twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """The mapping of a node."""
        seen = set[Any]()
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                continue
            name = (
                self.construct_object(key, deep=True) if isinstance(key, yaml.ScalarNode) else None
            )
            if name is None:
                raise yaml.constructor.ConstructorError(
                    None, None, "expected texts as keys", key.start_mark
                )
            if name in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{name}: expected this key once", key.start_mark
                )
            seen.add(name)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep=deep)
        return mapping


class Quoting(yaml.SafeDumper):
    """Quotes texts that are numbers to the reader."""


for _class in (Once, Quoting):
    _class.add_implicit_resolver(  # 1e-3 is a number, as in YAML 1.2
        "tag:yaml.org,2002:float",
        re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
        list("+-.0123456789"),
    )
