"""Margins of stances in arrays against their cone program, one direction at a time, by Clarabel."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

import stancekit
from stancekit.planners.files.arrays import Array
from stancekit.planners.verify import stance_margin
from stancekit.planners.verify.stance_margin import Margins, places, pushes
from tests.refusals import refuses


def drawn(rng: np.random.Generator, n: int) -> dict[str, Array]:
    """A stance of n contacts, some on slopes, some steep, some with little friction."""
    turn = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    points = 0.4 * np.column_stack([np.cos(turn), np.sin(turn), rng.normal(0.0, 0.2, n)])
    normals = np.column_stack([*rng.normal(0.0, rng.choice([0.1, 0.6]), (2, n)), np.ones(n)])
    return {
        "subject": points + rng.normal(0.0, 0.05, (n, 3)),
        "normals": normals / np.linalg.norm(normals, axis=1, keepdims=True),
        "friction": rng.uniform(0.2, 0.9, n),
        "com_m": np.array([*rng.normal(0.0, 0.15, 2), 0.4]),
        "low": np.full(n, rng.choice([0.0, 0.02])),
        "high": np.full(n, rng.choice([0.7, 2.0])),
        "wrench": rng.choice([0.0, 0.1]) * rng.normal(size=6),
    }


def stances(n: int, count: int) -> dict[str, Array]:
    rows = [drawn(np.random.default_rng((n, k)), n) for k in range(count)]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def support(row: dict[str, Array], shifts: Array, direction: Array) -> float:
    """How far the set of shifts goes in a direction; −inf where it is empty."""
    force, shift = cp.Variable(row["normals"].shape), cp.Variable(2)
    press = cp.sum(cp.multiply(force, row["normals"]), axis=1)
    slide = force - cp.multiply(press[:, None], row["normals"])
    arms = row["subject"] - row["com_m"]
    moment = sum(np.cross(arm, np.eye(3)).T @ force[i] for i, arm in enumerate(arms))
    borne = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) - row["wrench"]
    program = cp.Problem(
        cp.Maximize(direction @ shift),
        [
            cp.hstack([cp.sum(force, axis=0), moment]) + shifts @ shift == borne,
            cp.norm(slide, axis=1) <= cp.multiply(row["friction"], press),
            press >= row["low"],
            press <= row["high"],
        ],
    )
    return float(program.solve(solver=cp.CLARABEL))


@pytest.mark.parametrize("push", [False, True])
@pytest.mark.parametrize("n", [2, 3, 4, 6])
def test_bounds_are_those_of_the_cone_program(n: int, push: bool) -> None:
    """The margin is the least of the support function, inside and outside."""
    asked = stances(n, 8)
    found = stancekit.margins(**asked, push=push, yields_m=0.06)
    assert (found.lower <= found.upper).all()
    known = np.isfinite(found.upper)
    assert known.any()
    assert (found.upper[known] - found.lower[known] <= 1e-4).mean() > 0.8
    borne = found.stances.borne
    shifts = pushes(borne, 0.06) if push else places(borne)
    for i in range(8):
        row = {name: values[i] for name, values in asked.items()}
        if found.upper[i] == np.inf:  # one contact alone can carry: a set without an inside
            continue
        if found.upper[i] == -np.inf:
            assert support(row, shifts[i], np.array([1.0, 0.0])) == -np.inf
            continue
        assert found.lower[i] - 1e-6 <= support(row, shifts[i], found.direction[i])
        assert support(row, shifts[i], found.direction[i]) <= found.upper[i] + 1e-6
        turn = np.random.default_rng(i).uniform(0.0, 2.0 * np.pi)
        across = support(row, shifts[i], np.array([np.cos(turn), np.sin(turn)]))
        assert across >= found.lower[i] - 1e-6


def test_an_empty_set_is_proved_in_six_lines() -> None:
    """w b + Σ max −(B' w) f < 0: no forces of the cones have that sum and moment."""
    asked = stances(4, 60)
    found = stancekit.margins(**(asked | {"friction": 0.3 * asked["friction"]}))
    empty = np.flatnonzero(found.upper == -np.inf)
    assert 5 < len(empty) < 55
    at = found.stances
    for i in empty:
        part, w = slice(4 * i, 4 * i + 4), found.multiplier[i]
        g = -(w[:3] + np.cross(w[3:], at.arms_m[part]))
        normal = (g * at.normals[part]).sum(axis=1)
        slide = np.linalg.norm(g - normal[:, None] * at.normals[part], axis=1)
        best = normal + at.friction[part] * slide
        most = np.maximum(best * at.low[part], best * at.high[part])
        assert w @ at.borne[i] + most.sum() < 0.0


def test_the_gradient_is_that_of_differences() -> None:
    """In random directions of points, normals, friction and centre of mass, where nothing kinks."""
    asked, rng, step = stances(4, 16), np.random.default_rng(3), 1e-3
    names = ("subject", "normals", "friction", "com_m")
    found = stancekit.margins(**asked, tolerance=1e-5)
    holds = found.lower > 0.01
    assert holds.sum() > 4
    for name, slopes in zip(names, found.gradient(), strict=True):
        way = rng.normal(size=asked[name].shape)
        if name == "normals":
            way -= asked[name] * (way * asked[name]).sum(axis=2, keepdims=True)
        sides = list[Margins]()
        for sign in (-1.0, 1.0):
            moved = asked[name] + sign * step * way
            if name == "normals":
                moved /= np.linalg.norm(moved, axis=2, keepdims=True)
            sides.append(stancekit.margins(**(asked | {name: moved}), tolerance=1e-5))
        measured = (sides[1].upper[holds] - sides[0].upper[holds]) / (2.0 * step)
        said = (slopes * way).reshape(16, -1).sum(axis=1)[holds]
        assert np.median(np.abs(said - measured)) < 2e-3
        assert np.abs(said - measured).max() < 0.01


def test_a_batch_is_answered_as_its_rows_are_one_by_one() -> None:
    """Compiled where many are asked and numba is there, and not for a few."""
    asked = stances(3, stance_margin.MANY + 1)
    found = stancekit.margins(**asked)
    few = stancekit.margins(**{name: values[:5] for name, values in asked.items()})
    np.testing.assert_allclose(found.lower[:5], few.lower, atol=1e-9)
    np.testing.assert_allclose(found.upper[:5], few.upper, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("normals", 2.0),
        ("friction", 0.0),
        ("friction", 1000.0),
        ("com_m", np.nan),
        ("high", -1.0),
        ("subject", np.nan),
        ("subject", 200.0),  # millimetres
    ],
)
def test_a_row_that_cannot_be_is_named(name: str, value: float) -> None:
    asked = stances(3, 4)
    asked[name][2] = value
    with refuses(name, "2"):
        stancekit.margins(**asked)


@pytest.mark.parametrize("push", [False, True])
def test_what_bears_nothing_is_as_if_it_were_not_there(push: bool) -> None:
    asked, contacts = stances(5, 6), ("subject", "normals", "friction", "low", "high")
    few = {name: row[:, :3] if name in contacts else row for name, row in asked.items()}
    alone = stancekit.margins(**few, push=push)
    every, bears = stancekit.margins(**asked).stances, np.arange(30) % 5 < 3
    with_idle = replace(every, low=every.low * bears, high=every.high * bears)
    found = with_idle.margins(pushes(every.borne) if push else places(every.borne))
    np.testing.assert_array_equal(np.isfinite(found.upper), np.isfinite(alone.upper))
    np.testing.assert_allclose(found.lower, alone.lower, rtol=0.02, atol=1e-4)
    assert np.isfinite(found.lower).any()
