"""External wrenches: forces and moments that act on the body beside its weight, as a payload, wind
and a rope do.

They are F and M of E5 and E6 without gravity: the contacts' forces add up to w e_z − F, their
moments about the centre of mass to −M. Both are given on every key frame, in world axes. Between
two frames the force and its moment about the origin of the world go over from the one to the other
linearly, as the contacts' forces do, so that what holds at both frames holds all the way between.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidInput
from ..files.arrays import Array, cross, read_only
from ..files.documents import shown

MOST_WEIGHTS = 100.0
"""No posture bears a force of so many times the weight, nor such a moment at an arm of the length
scale."""


def checked_wrench(
    value: ArrayLike, shape: tuple[int, ...], *, weight_n: float, length_m: float
) -> Array:
    """A read-only copy of wrenches, the last axis of ``shape`` being 6: force [N] and moment [Nm].

    Arguments:
        value: the wrenches.
        shape: expected shape.
        weight_n: weight of the robot [N].
        length_m: length scale.

    Raises:
        InvalidInput: for what is no such array, and for magnitudes beyond any posture.
    """
    wrench = read_only(value, shape, "wrench")
    for part, what, unit, most in (
        (wrench[..., :3], "force", "N", MOST_WEIGHTS * weight_n),
        (wrench[..., 3:], "moment", "Nm", MOST_WEIGHTS * weight_n * length_m),
    ):
        largest = float(np.linalg.norm(part, axis=-1).max())
        if largest > most:
            raise InvalidInput(
                f"wrench: expected a {what} of at most {most:.4g} {unit}, {MOST_WEIGHTS:g} times "
                "the weight and beyond "
                f"any posture, got {largest:.4g} {unit}"
            )
    return wrench


def wrench_of(value: ArrayLike) -> Array:
    """One wrench of three numbers, a force, or of six, a force and a moment; shape (6,).

    Raises InvalidInput.
    """
    size = (
        np.shape(value)
        if isinstance(value, np.ndarray)
        else (len(value),)
        if isinstance(value, Sequence)
        else ()
    )
    if size not in ((3,), (6,)) or isinstance(value, str):
        raise InvalidInput(
            "wrench: expected 3 numbers, a force [N], or 6, a force and a moment about the centre "
            "of mass [Nm], "
            f"got {shown(value)}"
        )
    part = read_only(value, size, "wrench")
    return np.concatenate([part, np.zeros(6 - len(part))])


def at_point(force_n: ArrayLike, moment_nm: ArrayLike, at_m: ArrayLike) -> Array:
    """The wrench about the centre of mass of a force at a point of the body and a moment, shape
    (6,).

    Arguments:
        force_n: the force, shape (3,) [N].
        moment_nm: the moment, shape (3,) [Nm].
        at_m: vector from the centre of mass to the point where the force acts, shape (3,) [m].
    """
    force = np.asarray(force_n, dtype=np.float64)
    moment = np.asarray(moment_nm, dtype=np.float64) + cross(
        np.asarray(at_m, dtype=np.float64), force
    )
    return np.concatenate([force, moment])
