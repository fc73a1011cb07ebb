"""A class says its fields once, and files, readers and the reference of keys have them from
there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np
import pytest
from pydantic import BaseModel

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, read_only
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
    loaded = from_json(Cart, {**WRITTEN, "load_kg": 3})
    assert to_json(loaded) == {**WRITTEN, "load_kg": 3.0}


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
    assert wheel is not None
    assert np.array_equal(wheel.centre_m, [1.0, 2.0])
    assert Written(wheel=wheel).wheel is wheel
    assert Written(wheel=wheel).model_dump() == {"wheel": to_json(wheel)}
