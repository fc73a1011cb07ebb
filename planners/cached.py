"""Properties that are worked out once."""

from __future__ import annotations

import functools
from typing import Any, TypeVar, overload

T = TypeVar("T")


class cached_property(functools.cached_property[T]):
    """Python's own as it is from 3.12 on: without the lock that all instances of a class share.

    A process that is forked off while another thread works a property out finds that lock held, and
    waits for ever. Two threads may work a value out at the same time; the one that was kept first
    is what both get.
    """

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> cached_property[T]: ...
    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> T: ...
    def __get__(
        self, instance: object | None, owner: type[Any] | None = None
    ) -> cached_property[T] | T:
        """The value, which is kept in the instance, where it is found without this the next
        time.
        """
        if instance is None:
            return self
        assert self.attrname is not None  # the class has given it its name
        value: T = vars(instance).setdefault(self.attrname, self.func(instance))
        return value
