"""Archives in bounds: what numpy writes comes back to the bit, and a header is believed as far as
the bytes go.
"""

import io
import struct
import tracemalloc

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import array_of, unpacked
from tests.damage import bombs
from tests.refusals import refuses

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
