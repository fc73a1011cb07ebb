"""Dataclasses of commands: methods that wait for their first call do what Python's own do."""

from __future__ import annotations

import dataclasses
from dataclasses import FrozenInstanceError, dataclass

import pytest

from stancekit.cli import dataclass_methods


def made(frozen: bool = True) -> type:
    """A dataclass as it is made now."""

    @dataclass(frozen=frozen, kw_only=True, order=True)
    class Point:
        x: float
        y: tuple[int, ...] = ()

    return Point


@pytest.fixture
def waiting(monkeypatch):
    """The dataclass with methods that wait."""
    if not hasattr(dataclasses, dataclass_methods.COMPILER):
        pytest.skip("this Python compiles all methods of a class at once")
    monkeypatch.setattr(
        dataclasses,
        dataclass_methods.COMPILER,
        dataclass_methods._when_called(dataclasses._create_fn),
    )
    return made()


def test_methods_that_wait_do_what_pythons_own_do(waiting):
    own = made()
    for kind in (waiting, own, waiting):  # first and later calls
        one, other, next_one = kind(x=1.0), kind(x=1.0), kind(x=2.0)
        assert (one == other, one == next_one, one < next_one) == (True, False, True)
        assert hash(one) == hash(own(x=1.0))
        assert repr(one) == repr(own(x=1.0))
        for change in (lambda it: setattr(it, "x", 3.0), lambda it: delattr(it, "x")):
            with pytest.raises(FrozenInstanceError):
                change(one)
        assert one.__eq__(1) is NotImplemented
        with pytest.raises(TypeError, match="keyword argument 'z'"):
            kind(x=1.0, z=2.0)
    assert waiting.__eq__.__qualname__ == own.__eq__.__qualname__


def test_a_class_below_a_frozen_one_may_have_fields_of_its_own(waiting):
    @dataclass(frozen=True, kw_only=True)
    class Named(waiting):
        name: str = ""

    assert Named(x=1.0, name="a") != Named(x=1.0, name="b")
    with pytest.raises(FrozenInstanceError):
        Named(x=1.0).name = "c"  # type: ignore[misc]


def test_the_compiler_is_replaced_once(monkeypatch):
    if not hasattr(dataclasses, dataclass_methods.COMPILER):
        pytest.skip("this Python compiles all methods of a class at once")
    monkeypatch.setattr(dataclasses, dataclass_methods.COMPILER, dataclasses._create_fn)
    dataclass_methods.compile_when_called()
    once = getattr(dataclasses, dataclass_methods.COMPILER)
    dataclass_methods.compile_when_called()
    assert getattr(dataclasses, dataclass_methods.COMPILER) is once
