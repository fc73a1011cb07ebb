"""A class says its fields once, and files, readers and the reference of keys have them from
there.
"""

from __future__ import annotations

import io
import struct
import tracemalloc
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np
import pytest
from pydantic import BaseModel

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, array_of, read_only, unpacked
from stancekit.planners.files.codec import (
    INLINE,
    KEYS,
    LATER,
    UNWRITTEN,
    Within,
    check_limits,
    from_json,
    keys_of,
    to_json,
)
from tests.damage import bombs
from tests.refusals import refuses


@dataclass(frozen=True, kw_only=True, eq=False)
class Wheel:
    """A wheel."""

    centre_m: Array
    radius_m: Annotated[float, Within(above=0.0, most=2.0)] = 0.5
    spokes: Annotated[int, Within(least=0)] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre_m", read_only(self.centre_m, (2,), "centre_m"))
        check_limits(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class Paint:
    """What a cart looks like."""

    colour: str


@dataclass(frozen=True, kw_only=True, eq=False)
class _CartKeys:
    """The keys of a cart."""

    FORMAT: ClassVar = "cart/1"

    wheels: tuple[Wheel, ...]

    def value(self) -> Cart:
        """The cart."""
        return Cart(wheels=self.wheels, paint=Paint(colour="red"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Cart:
    """A cart."""

    FORMAT: ClassVar = "cart/2"

    wheels: tuple[Wheel, ...] = field(metadata={"key": "on"})
    paint: Paint = field(metadata=INLINE)
    load_kg: float = field(default=0.0, metadata=LATER)
    driver: str = field(default="nobody", metadata=UNWRITTEN)


@dataclass(frozen=True, kw_only=True, eq=False)
class OldCart(Cart):
    """A cart whose files have other keys."""

    KEYS: ClassVar = _CartKeys


TOO_DEEP = "expected lists of numbers, got lists that are nested too deep"
NESTED: Any = 1.0
for _ in range(3000):
    NESTED = [NESTED]
CART = Cart(wheels=(Wheel(centre_m=[0.1, 2.0]),), paint=Paint(colour="blue"), driver="Ann")
WRITTEN: dict[str, Any] = {
    "format": "cart/2",
    "on": [{"centre_m": [0.1, 2.0], "radius_m": 0.5, "spokes": None}],
    "colour": "blue",
}


def test_a_value_is_written_by_its_fields_and_read_again():
    assert to_json(CART) == WRITTEN
    assert list(to_json(CART)) == list(WRITTEN)
    again = from_json(Cart, WRITTEN)
    assert again.wheels[0].centre_m.tobytes() == CART.wheels[0].centre_m.tobytes()
    assert (again.paint.colour, again.load_kg, again.driver) == ("blue", 0.0, "nobody")
    assert to_json(from_json(Cart, {**WRITTEN, "load_kg": 3})) == {**WRITTEN, "load_kg": 3.0}


def test_another_form_is_read_by_its_keys():
    cart = from_json(OldCart, {"format": "cart/1", "wheels": [{"centre_m": [1, 2]}]}, whole=False)
    assert cart.paint.colour == "red"
    assert cart.wheels[0].radius_m == 0.5


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"colour": ...}, "colour: expected this key, got nothing"),
        ({"collar": "x"}, "collar: unknown key, did you mean 'colour'?"),
        ({"format": "cart/3"}, "format: expected 'cart/2', got 'cart/3'"),
        ({"driver": "x"}, "driver: unknown key"),
        ({"load_kg": "3"}, "load_kg: expected a valid number, got '3'"),
        ({"load_kg": True}, "load_kg: expected a valid number, got True"),
        ({"on": {}}, "on: expected a list in brackets, got {}"),
        ({"on": [7]}, "on[0]: expected a valid dictionary, got 7"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_by_its_key(change, said):
    keys = {key: value for key, value in {**WRITTEN, **change}.items() if value is not ...}
    with pytest.raises(InvalidInput) as refusal:
        from_json(Cart, keys)
    assert str(refusal.value) == said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"centre_m": [0, True]}, "on[0].centre_m[1]: expected a valid number, got True"),
        ({"centre_m": [[0, None]]}, "on[0].centre_m[0][1]: expected a valid number, got None"),
        ({"centre_m": 5}, "on[0].centre_m: expected a list in brackets, got 5"),
        ({"centre_m": NESTED}, f"on[0].centre_m{8 * '[0]'}: {TOO_DEEP}"),
        ({"centre_m": [1.0]}, "on[0].centre_m: expected shape (2,), got (1,)"),
        ({"radius_m": ...}, "on[0].radius_m: expected this key, got nothing"),
        ({"radius_m": 3.0}, "on[0].radius_m: expected a number in (0, 2], got 3"),
        ({"spokes": -1}, "on[0].spokes: expected a number in [0, 1e+06], got -1"),
        ({"spokes": 1.5}, "on[0].spokes: expected a valid integer, got 1.5"),
    ],
)
def test_what_is_wrong_deep_inside_has_its_place(change, said):
    wheel = {**WRITTEN["on"][0], **change}
    keys = {key: value for key, value in wheel.items() if value is not ...}
    with pytest.raises(InvalidInput) as refusal:
        from_json(Cart, {**WRITTEN, "on": [keys]}, where="a.json")
    assert str(refusal.value) == f"a.json: {said}"


def test_limits_hold_in_python_too_and_stand_in_the_reference():
    with refuses("radius_m"):
        Wheel(centre_m=[0, 0], radius_m=-1.0)
    schema = keys_of(Wheel, whole=False).model_json_schema()["properties"]
    assert (schema["radius_m"]["exclusiveMinimum"], schema["radius_m"]["maximum"]) == (0.0, 2.0)
    assert schema["centre_m"] == {"items": {"type": "number"}, "title": "Centre M", "type": "array"}


def test_a_value_may_be_part_of_what_a_person_writes():
    class Written(BaseModel):
        wheel: Annotated[Wheel, KEYS] | None = None

    wheel = Written.model_validate({"wheel": {"centre_m": [1, 2]}}).wheel
    assert np.array_equal(wheel.centre_m, [1.0, 2.0])
    assert Written(wheel=wheel).wheel is wheel
    assert Written(wheel=wheel).model_dump() == {"wheel": to_json(wheel)}


ARRAYS = {
    "whole": np.arange(12).reshape(3, 4),
    "columns": np.asfortranarray(np.random.default_rng(0).normal(size=(3, 4))),
    "truth": np.array([True, False]),
    "text": np.array("stancekit/x/1"),
    "none": np.zeros((0, 3)),
    "big": np.arange(3.0).astype(">f8"),
}


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
def test_what_numpy_writes_comes_back_to_the_bit(write):
    box = io.BytesIO()
    write(box, **ARRAYS)
    found = unpacked(box.getvalue(), "f.npz")
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert found[name].tobytes() == array.tobytes()
    single = io.BytesIO()
    np.save(single, ARRAYS["columns"])
    np.testing.assert_array_equal(array_of(single.getvalue(), "f.npy"), ARRAYS["columns"])


def headed(descr, shape, data=b"\0" * 32):
    text = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (headed("<f8", "(10**12,)"), "expected arrays without pickle: malformed node or string"),
        (
            headed("<f8", "(1000000000000,)"),
            "expected 8e+12 bytes of shape (1000000000000,), got 32",
        ),
        (headed("<f8", "(3,)"), "expected 24 bytes of shape (3,), got 32"),
        (headed("|O", "(4,)"), "expected numbers or texts, got object"),
        (headed("<U0", "(99999999999,)"), "expected numbers or texts, got <U0"),
        (headed("<f8", "(-4,)"), "expected up to 8 lengths, got (-4,)"),
        (headed("|b1", "(32,)", b"\x02" * 32), "expected truth values of 0 and 1"),
        (headed("<f8", "(" * 5000), "expected arrays without pickle: "),
        (b"\x93NUMPY\x09\x00" + bytes(20), "expected version 1.0 or 2.0 of .npy, got 9.0"),
        (b"", "expected arrays without pickle: "),
    ],
)
def test_headers_that_promise_what_the_bytes_do_not_hold_are_refused(content, said):
    with pytest.raises(InvalidInput) as caught:
        array_of(content, "f.npy")
    assert said in str(caught.value)
    assert str(caught.value).startswith("f.npy: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("honest", [True, False])
def test_an_archive_that_unfolds_is_refused_before_it_does(honest):
    content = bombs.packed("x", 300, honest=honest)
    assert len(content) < 400_000
    tracemalloc.start()
    with refuses("f.npz"):
        unpacked(content, "f.npz")
    assert tracemalloc.get_traced_memory()[1] < 2_000_000
    tracemalloc.stop()
